"""Arithmetic with quantities: what it calculates, and what it refuses."""

import pytest

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


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("= wall", 0.012, "m"),
        ("=2*wall+3 mm", 0.027, "m"),
        ("= -(wall / 2) + wall", 0.006, "m"),
        ("= wall / n", 0.004, "m"),
        ("= 30 N/um * 2", 6e7, "N/m"),
        ("= load / (n * wall)", 2000.0 / 0.036, "N/m"),
        ("= [10 N m] / wall", 10.0 / 0.012, "N"),
        ("= 7850 kg/m^3 * wall * wall * wall", 7850.0 * 0.012**3, "kg"),
        ("= 1 m / t", 1000.0, ""),
        ("= 50 %", 0.5, ""),
        ("= 10 - 4 - 3", 3.0, ""),
        ("= 24 / 4 / 3", 2.0, ""),
        ("= 2 + 3 * 4", 14.0, ""),
    ],
)
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


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("= wall + 3", "adds a plain number"),
        ("= wall + load", "adds a value in"),
        ("= wall / 0", "divides by zero"),
        ("= 1 / (n - 3)", "divides by zero"),
        ("= 0 / 0", "divides by zero"),
        ("= (wall", "closing parenthesis"),
        ("= wall)", "cannot be read from"),
        ("= wall wall", "cannot be read from"),
        ("= 2 *", "lacks a value"),
        ("=", "lacks a value"),
        ("= wall ** 2", "lacks a value"),
        ("= foo", "unknown parameter 'foo'"),
        ("= 3 zz", "unit"),
        ("= [wall]", "no number with a unit"),
        ("= 10 N/t", "two ways"),
        ("= __import__('os')", "unknown parameter"),
        ("= wall.real", "cannot be read"),
        ("= 1e9999", "cannot be read"),
        ("= " + "(" * 50 + "1" + ")" * 50, "nested"),
        ("= " + "-" * 60 + "1", "nested"),
        ("= " + "1 + " * 80 + "1", "longer than"),
    ],
)
def test_what_is_no_arithmetic_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ExpressionError, match=reason.replace("(", r"\(")):
        calculate(text, look_up, NAMES)


def test_only_texts_with_the_mark_are_expressions() -> None:
    assert is_expression(" = wall")
    assert not is_expression("wall")
    assert not is_expression(3)
    assert sole_name("= wall ") == "wall"
    assert sole_name("= 2 * wall") is None
