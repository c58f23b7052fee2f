"""Validation rows as a JSON list."""

import dataclasses
import json
import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from headstock.validation.case_rows import ValidationRow


def rows_as_json(rows: Sequence[ValidationRow]) -> str:
    """A JSON list with one object per row; numbers that do not exist are ``null``."""
    entries = [{key: _plain(value) for key, value in dataclasses.asdict(row).items()} for row in rows]
    return json.dumps(entries, indent=1, allow_nan=False) + "\n"


def write_rows(rows: Sequence[ValidationRow], path: Path) -> None:
    """Write rows to a JSON file, whole or not at all.

    Raises:
        OSError: The folder cannot be written.
    """
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(rows_as_json(rows))
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).replace(path)
    except OSError:
        Path(temporary).unlink(missing_ok=True)
        raise


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value
