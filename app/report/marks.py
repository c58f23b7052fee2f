"""What a report was made of, in its head: where nothing of that changed, it is not made again."""

import hashlib
import json
import re
from pathlib import Path

import headstock.app
from headstock.pipeline.results.files import PUBLISHED, REPORT_FILE
from headstock.pipeline.results.results import Results
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.outputs import are_intact

EFFECTS_FILE = "effects.json"  # beside the results of the scene that it is of
HEAD_BYTES = 4096
MARK = re.compile(rb'<meta name="headstock-content" content="([0-9a-f]+)">')


def mark_report(folder: Path, run: Results, *, figures: bool) -> str:
    """Return a SHA-256 of what a report, tables, modes and figures are made of.

    Args:
        folder: Of the results.
        figures: Whether there are pictures of the machine.
    """
    effects = folder / EFFECTS_FILE
    stamp = effects.stat().st_mtime_ns if effects.is_file() else None
    content = [run.files, figures, stamp, code_fingerprint(headstock.app)]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def is_published(folder: Path, mark: str) -> bool:
    """Return whether the report of a folder has this mark, and nothing beside it was changed since."""
    try:
        with (folder / REPORT_FILE).open("rb") as file:
            found = MARK.search(file.read(HEAD_BYTES))
    except OSError:
        return False
    same = found is not None and found[1].decode() == mark
    return same and are_intact(folder, (REPORT_FILE,), PUBLISHED)
