"""Compiled templates in the user's store: compiling those of a report takes longer than a warm run
computes.
"""

import contextlib
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket

from headstock.pipeline.storage.atomic_files import write_atomically
from headstock.pipeline.storage.store import default_store_root, read_own_file


class TemplateCode(jinja2.BytecodeCache):
    """Python code of templates, run only where nobody else may have written it; jinja2 compares
    versions and the text of the template.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Take what was compiled before, where it can be believed."""
        with contextlib.suppress(OSError):
            bucket.bytecode_from_string(read_own_file(_find_place(bucket)))

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep what was compiled; where that cannot be, it is compiled again."""
        place = _find_place(bucket)
        with contextlib.suppress(OSError):
            place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_atomically(place, bucket.bytecode_to_string(), mode=0o600)


def _find_place(bucket: Bucket) -> Path:
    return default_store_root() / "templates" / bucket.key
