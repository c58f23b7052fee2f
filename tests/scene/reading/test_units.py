"""Quantities: right values, one float per physical value whatever the unit, and refusals that say
what to write.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from headstock.scene.reading import units
from headstock.scene.reading.units import DIMENSIONS, Dimension, UnitError, parse_quantity


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("210 GPa", units.PRESSURE, 210e9),
        ("210000 MPa", units.PRESSURE, 210e9),
        ("210000 N/mm^2", units.PRESSURE, 210e9),
        ("7.85e-9 t/mm^3", units.DENSITY, 7850.0),
        ("7.85 g/cm^3", units.DENSITY, 7850.0),
        ("7850 kg/m³", units.DENSITY, 7850.0),
        ("380 N/um", units.STIFFNESS, 380e6),
        ("380 N/µm", units.STIFFNESS, 380e6),
        ("1 N m/rad", units.ROTATIONAL_STIFFNESS, 1.0),
        ("1.405 kN*m/mrad", units.ROTATIONAL_STIFFNESS, 1.405e6),
        ("20 N s/m", units.DAMPING, 20.0),
        ("5 N m s/rad", units.ROTATIONAL_DAMPING, 5.0),
        ("9.81 m/s^2", units.ACCELERATION, 9.81),
        ("3000 mm/min", units.SPEED, 0.05),
        ("60 rpm", units.ANGULAR_SPEED, 2.0 * math.pi),
        ("180 deg", units.ANGLE, math.pi),
        ("1 rev", units.ANGLE, 2.0 * math.pi),
        ("1.5 kHz", units.FREQUENCY, 1500.0),
        ("2 %", units.RATIO, 0.02),
        ("0.02", units.RATIO, 0.02),
        ("4 GB", units.MEMORY, 4e9),
        ("  -12mm ", units.LENGTH, -0.012),
        ("1 in", units.LENGTH, 0.0254),
        ("2 hours", units.TIME, 7200.0),
        ("3 kilonewtons", units.FORCE, 3000.0),
        ("3 N/mm mm/m**2", units.PRESSURE, 3.0),
        ("1 1/ms", units.RATE, 1000.0),
    ],
)
def test_a_quantity_is_read_in_si_to_the_last_bit(
    text: str, dimension: Dimension, value: float
) -> None:
    quantity = parse_quantity(text, dimension)
    assert quantity.value == value
    assert quantity.dimension is dimension


@pytest.mark.parametrize(
    ("text", "dimension", "fragment"),
    [
        ("1e3 N", units.LENGTH, "is a force, not a length"),
        ("5 rad/s", units.FREQUENCY, "is an angular speed, not a frequency"),
        ("50 Hz", units.ANGULAR_SPEED, "is a frequency, not an angular speed"),
        ("10 N m", units.ROTATIONAL_STIFFNESS, "is a moment, not a rotational stiffness"),
        ("5", units.LENGTH, "is a plain number, not a length"),
        ("1e400 m", units.LENGTH, "range of floating-point numbers"),
        ("1e300 Gm", units.PRESSURE, "is a length"),
        ("1e308 km", units.LENGTH, "range of floating-point numbers"),
        ("1e-320 um", units.LENGTH, "range of floating-point numbers"),
        ("nan m", units.LENGTH, "not one real number"),
        ("inf m", units.LENGTH, "not one real number"),
        ("1+2j m", units.LENGTH, "is not a unit"),
        ("1,5 mm", units.LENGTH, "not one real number"),
        ("2*3 m", units.LENGTH, "is not a unit"),
        ("9**9**9 m", units.LENGTH, "is not a unit"),
        ("1 m**9**9**9", units.LENGTH, "is not a unit"),
        ("0x10 mm", units.LENGTH, "is not a unit"),
        ("3 foo", units.LENGTH, "unknown unit 'foo'"),
        ("3 k%", units.RATIO, "unknown unit 'k%'"),
        ("3 ss", units.TIME, "unknown unit 'ss'"),
        ("", units.LENGTH, "not one real number"),
        ("1 " + "m" * 200, units.LENGTH, "too long"),
        (38, units.LENGTH, 'such as "38 mm"'),
        (math.nan, units.LENGTH, "not finite"),
        (math.inf, units.LENGTH, "not finite"),
        (True, units.LENGTH, "is not a length"),
        (None, units.LENGTH, "is not a length"),
        pytest.param(10**5000, units.LENGTH, "more than 40 digits", id="huge integer"),
        (["1 m"], units.LENGTH, "is not a length"),
    ],
)
def test_what_is_no_such_quantity_is_refused_with_a_reason(
    text: object, dimension: Dimension, fragment: str
) -> None:
    with pytest.raises(UnitError, match=r"write") as caught:
        parse_quantity(text, dimension)
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
