"""Quantities: right values, one float per physical value whatever the unit, and refusals that say
what to write.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cases import cases
from headstock.scene.reading import units
from headstock.scene.reading.units import DIMENSIONS, Dimension, UnitError, parse_quantity


@cases
def test_a_quantity_is_read_in_si_to_the_last_bit(text: str, dimension: str, value: float) -> None:
    quantity = parse_quantity(text, getattr(units, dimension))
    assert quantity.value == value
    assert quantity.dimension is getattr(units, dimension)


@cases
def test_what_is_no_such_quantity_is_refused_with_a_reason(
    text: object, dimension: str, fragment: str
) -> None:
    with pytest.raises(UnitError, match=r"write") as caught:
        parse_quantity(text, getattr(units, dimension))
    assert fragment in str(caught.value)


@pytest.mark.parametrize(
    ("value", "fragment"),
    [(None, "is not a length"), (10**5000, "more than 40 digits"), ("1 " + "m" * 200, "too long")],
    ids=["nothing", "huge integer", "long text"],
)
def test_what_no_file_or_no_line_can_hold_is_refused_too(value: object, fragment: str) -> None:
    with pytest.raises(UnitError, match=r"write") as caught:
        parse_quantity(value, units.LENGTH)
    assert fragment in str(caught.value)


@pytest.mark.parametrize("dimension", DIMENSIONS, ids=lambda dimension: dimension.name)
def test_the_example_shown_for_a_dimension_is_accepted(dimension: Dimension) -> None:
    assert parse_quantity(dimension.example, dimension).value > 0.0


@pytest.mark.parametrize("dimension", DIMENSIONS, ids=lambda dimension: dimension.name)
def test_dimensions_exclude_each_other(dimension: Dimension) -> None:
    for other in DIMENSIONS:
        if other is not dimension:
            with pytest.raises(UnitError):
                parse_quantity(dimension.example, other)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(DIMENSIONS))
def test_a_float_written_in_si_comes_back_bit_for_bit_or_is_larger_than_any_machine(
    value: float, dimension: Dimension
) -> None:
    if abs(value) <= dimension.most:
        assert parse_quantity(f"{value!r} {dimension.unit}", dimension).value == value
    else:
        with pytest.raises(UnitError, match="check its unit"):
            parse_quantity(f"{value!r} {dimension.unit}", dimension)


@given(
    st.decimals(-100_000, 100_000, places=6, allow_nan=False),
    st.sampled_from(["um", "mm", "cm", "m"]),
)
def test_the_prefix_does_not_change_the_float(number: object, unit: str) -> None:
    exponent = {"um": -6, "mm": -3, "cm": -2, "m": 0}[unit]
    assert parse_quantity(f"{number} {unit}", units.LENGTH) == parse_quantity(
        f"{number}e{exponent} m", units.LENGTH
    )


@given(st.text(max_size=100))
def test_no_text_does_anything_but_parse_or_be_refused(text: str) -> None:
    try:
        value = parse_quantity(text, *DIMENSIONS).value
    except UnitError:
        return
    assert math.isfinite(value)
