"""Strict JSON: lists, mappings, texts and finite numbers, in one layout."""

import json
import math
from collections.abc import Mapping, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.reading.names import RESULT_FORMAT
from headstock.solvers.errors import AccuracyError

type JsonValue = str | float | bool | None | Sequence[JsonValue] | Mapping[str, JsonValue]
type JsonTable = dict[str, JsonValue]


def dump_json(content: Mapping[str, object] | Sequence[Mapping[str, object]]) -> str:
    """Strict JSON text: a number that is not finite is an error, not ``NaN``."""
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def dump_summary(content: Mapping[str, object]) -> str:
    """Strict JSON text of a summary, with the number of its format first."""
    return dump_json({"format": RESULT_FORMAT, **content})


def check_finite(what: str, values: FloatArray | Sequence[float]) -> list[float]:
    """The values ``(n,)`` as a plain list.

    Raises:
        AccuracyError: One of them is not a finite number.
    """
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise AccuracyError(
            f"{what} holds values that are not finite: {array[~np.isfinite(array)][:3].tolist()}"
        )
    return [float(value) for value in array]


def null_open(what: str, values: FloatArray, *, free: bool) -> list[list[float | None]]:
    """The rows of values as plain lists.

    Args:
        what: Named in the error where they are refused.
        values: ``(m, n)``.
        free: Motions are free: NaN becomes null.

    Raises:
        AccuracyError: One of them is infinite, or not a number although no motion is free.
    """
    check_finite(what, values[~np.isnan(values)] if free else values.ravel())
    return [[None if np.isnan(value) else float(value) for value in row] for row in values]


def find_known(value: float | None) -> float | None:
    """Return a number for JSON or a cell; None where it is not known or not finite."""
    return float(value) if value is not None and math.isfinite(value) else None


def nest_known(values: FloatArray) -> list[JsonValue]:
    """Return an array as nested lists; None for what is not finite."""
    return [nest_known(row) if row.ndim else find_known(row) for row in values]
