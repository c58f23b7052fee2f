"""Claims about the JSON list of validation rows."""

import json

import numpy as np
import pytest

from common import approx
from headstock.validation.references.rows import (
    Target,
    compare_bound,
    compare_value,
    failed_computation,
    rows_as_json,
)

CONTRACT = {
    "case",
    "quantity",
    "value",
    "reference",
    "unit",
    "relative_error",
    "tolerance",
    "kind",
    "passed",
}


def test_the_text_is_strict_json_with_the_agreed_keys_and_null_for_missing_numbers() -> None:
    text = rows_as_json([compare_bound("a", "q", 1e-12, 1e-9), failed_computation("b", "why")])
    entries = json.loads(text, parse_constant=lambda token: pytest.fail(f"{token} is not JSON"))
    assert all(set(entry) >= CONTRACT for entry in entries)
    assert [entry["value"] for entry in entries] == [1e-12, None]
    assert [entry["passed"] for entry in entries] == [True, False]


def test_numbers_of_numpy_are_written_like_any_other() -> None:
    target = Target(np.float64(2.0), "Hz", np.float64(0.1), "closed form")
    entry = json.loads(rows_as_json([compare_value("a", "q", np.float64(2.1), target)]))[0]
    assert entry["passed"] is True
    assert entry["relative_error"] == approx(0.05)
