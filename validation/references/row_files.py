"""Validation rows as a JSON list."""

import dataclasses
import json
import math
from collections.abc import Sequence

from headstock.validation.references.rows import ValidationRow


def rows_as_json(rows: Sequence[ValidationRow]) -> str:
    """A JSON list with one object per row; numbers that do not exist are ``null``."""
    entries = [{key: _plain(value) for key, value in dataclasses.asdict(row).items()} for row in rows]
    return json.dumps(entries, indent=1, allow_nan=False) + "\n"


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value
