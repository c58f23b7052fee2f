"""Strict JSON: plain lists of finite numbers."""

import json
from typing import Any

import numpy as np

from headstock.solvers.errors import AccuracyError

Json = dict[str, Any]


def dump_json(content: Any) -> str:
    """Strict JSON text: a number that is not finite is an error, not ``NaN``."""
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def check_finite(what: str, values: Any) -> Any:
    """The values as plain lists.

    Raises:
        AccuracyError: One of them is not a finite number.
    """
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise AccuracyError(f"{what} holds values that are not finite: {array[~np.isfinite(array)][:3].tolist()}")
    return array.tolist()


def null_open(what: str, values: Any, *, free: bool) -> Any:
    """The values as plain lists, where motions are ``free`` with null in place of NaN.

    Raises:
        AccuracyError: One of them is infinite, or not a number although no motion is free.
    """
    array = np.asarray(values, dtype=float)
    if not free:
        return check_finite(what, array)
    check_finite(what, array[~np.isnan(array)])
    found = array.astype(object)
    found[np.isnan(array)] = None
    return found.tolist()
