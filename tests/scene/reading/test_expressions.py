"""Arithmetic with quantities: what it calculates, and what it refuses."""

import pytest

from cases import cases
from common import approx
from headstock.scene.reading.expressions import ExpressionError, calculate, is_expression, sole_name
from headstock.scene.reading.units import DIMENSIONS, Measure, parse_quantity, read_measure

NAMES = {
    "wall": read_measure("12", "mm"),
    "n": read_measure("3", ""),
    "t": read_measure("1", "mm"),
    "load": read_measure("2", "kN"),
}


def look_up(name: str) -> Measure:
    if name not in NAMES:
        raise ExpressionError(f"names the unknown parameter {name!r}")
    return NAMES[name]


@cases
def test_values_are_calculated_with_their_units(text: str, value: float, unit: str) -> None:
    found = calculate(text, look_up, NAMES)
    assert float(found.value) == approx(value, rel=1e-15)
    written = found.written()
    if unit:
        # the scene reads it back as what it is
        assert parse_quantity(written, *DIMENSIONS).value == approx(value, rel=1e-15)
        assert found.powers == read_measure("1", unit).powers
    else:
        assert isinstance(written, int | float)


def test_decimal_numbers_stay_what_they_are() -> None:
    assert calculate("= 38 mm / 2", look_up, NAMES).written() == "0.019 m"
    assert calculate("= 0.1 mm + 0.2 mm", look_up, NAMES).written() == "0.0003 m"
    assert calculate("= 4 * 5", look_up, NAMES).written() == 20


@cases
def test_what_is_no_arithmetic_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ExpressionError, match=reason.replace("(", r"\(")):
        calculate(text, look_up, NAMES)


def test_only_texts_with_the_mark_are_expressions() -> None:
    assert is_expression(" = wall")
    assert not is_expression("wall")
    assert not is_expression(3)
    assert sole_name("= wall ") == "wall"
    assert sole_name("= 2 * wall") is None
