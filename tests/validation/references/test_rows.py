"""Claims about the rows of the validation table and their JSON list."""

import json
import math
from collections.abc import Callable

import numpy as np
import pytest

from common import approx
from headstock.validation.references.rows import (
    ReferenceCase,
    Target,
    ValidationRow,
    compare_bound,
    compare_order,
    compare_value,
    compare_values,
    failed_computation,
    rows_as_json,
    show,
)

CASE = ReferenceCase(
    "x", "X", "two numbers", "published", "a book", 1e-2, "none", "Hz", {"f1": 10.0, "f2": 20.0}
)


def passes(compare: Callable[[float], ValidationRow], *values: float) -> list[float]:
    """The values that pass."""
    return [value for value in values if compare(value).passed]


def test_a_value_passes_up_to_its_tolerance_on_either_side() -> None:
    target = Target(100.0, "Hz", 0.01, "published")
    found = passes(lambda value: compare_value("q", value, target), 98.9, 99.1, 100.9, 101.1)
    assert found == [99.1, 100.9]


@pytest.mark.parametrize(("value", "right", "error"), [(99.0, 100.0, -0.01), (-5.5, -5.0, 0.1)])
def test_the_relative_error_keeps_its_sign(value: float, right: float, error: float) -> None:
    row = compare_value("q", value, Target(right, "Hz", 0.2, "published"))
    assert row.relative_error == approx(error)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_never_passes(value: float) -> None:
    assert not compare_value("q", value, Target(1.0, "-", 1e9, "published")).passed
    assert not compare_bound("q", value, math.inf).passed
    assert not show("q", value, "-").passed


def test_a_bound_is_compared_with_zero_on_both_sides() -> None:
    values = (-2e-9, -1e-9, 0.0, 1e-9, 2e-9)
    assert passes(lambda value: compare_bound("q", value, 1e-9), *values) == [-1e-9, 0.0, 1e-9]


def test_an_order_passes_within_a_fifth_of_one() -> None:
    values = (2.79, 2.81, 3.19, 3.21)
    found = passes(lambda value: compare_order("q", [1.0, 2.0**-value], 3.0), *values)
    assert found == [2.81, 3.19]


def test_a_row_that_is_shown_only_has_neither_reference_nor_tolerance() -> None:
    row = show("q", 3.0, "Hz")
    assert row.passed and row.kind == "shown only"
    assert math.isnan(row.reference) and math.isnan(row.tolerance)


def test_every_value_of_a_reference_case_gets_a_row_with_its_provenance() -> None:
    rows = compare_values(CASE, [10.05, 21.0], notes=["", "why"])
    assert [(row.quantity, row.passed, row.kind, row.note) for row in rows] == [
        ("f1", True, "published", ""),
        ("f2", False, "published", "why"),
    ]


def test_too_few_values_are_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        compare_values(CASE, [10.0])


def test_a_failed_computation_is_a_failed_row_with_the_reason() -> None:
    row = failed_computation("it broke")
    assert not row.passed and row.note == "it broke"


CONTRACT = {
    *("case", "quantity", "value", "reference", "unit", "relative_error", "tolerance", "kind"),
    "passed",
}


def test_the_text_is_strict_json_with_the_agreed_keys_and_null_for_missing_numbers() -> None:
    text = rows_as_json([compare_bound("q", 1e-12, 1e-9), failed_computation("why")])
    entries = json.loads(text, parse_constant=lambda token: pytest.fail(f"{token} is not JSON"))
    assert all(set(entry) >= CONTRACT for entry in entries)
    assert [entry["value"] for entry in entries] == [1e-12, None]
    assert [entry["passed"] for entry in entries] == [True, False]


def test_numbers_of_numpy_are_written_like_any_other() -> None:
    target = Target(np.float64(2.0), "Hz", np.float64(0.1), "closed form")
    entry = json.loads(rows_as_json([compare_value("q", np.float64(2.1), target)]))[0]
    assert entry["passed"] is True
    assert entry["relative_error"] == approx(0.05)
