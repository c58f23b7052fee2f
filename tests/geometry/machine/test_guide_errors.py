"""Profiles of rails: values and integrals, and the line a carriage fits through them."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.machine.guide_errors import (
    AxisErrors,
    ErrorProfile,
    ProfileError,
    RailErrors,
    Wave,
    average_profile,
)

PROFILE = ErrorProfile(
    positions=np.array([-0.5, -0.1, 0.02, 0.3, 0.6]),
    values=np.array([0.0, 3e-6, -1e-6, 2e-6, 2.5e-6]),
    coefficients=np.array([1e-6, -2e-6, 4e-6, 1e-6]),
    scale=0.3,
    waves=(Wave(0.4, 1e-6, 0.7), Wave(0.002, 5e-8)),
)


def test_profiles_add_points_polynomials_and_waves() -> None:
    at = np.array([-0.3, 0.02, 0.45])
    expected = (
        np.interp(at, PROFILE.positions, PROFILE.values)
        + 1e-6
        - 2e-6 * (at / 0.3)
        + 4e-6 * (at / 0.3) ** 2
        + 1e-6 * (at / 0.3) ** 3
        + 1e-6 * np.sin(2 * np.pi * at / 0.4 + 0.7)
        + 5e-8 * np.sin(2 * np.pi * at / 0.002)
    )
    assert PROFILE.sample(at) == approx(expected, rel=1e-12)


def test_antiderivatives_differentiate_back() -> None:
    at, step = np.array([-0.31, 0.011, 0.25, 0.44]), 1e-6
    after, before = PROFILE.integrate(at + step), PROFILE.integrate(at - step)
    now = PROFILE.integrate(at)
    assert (after.first - before.first) / (2 * step) == approx(now.values, abs=2e-12)
    assert (after.second - before.second) / (2 * step) == approx(now.first, abs=2e-12)


@pytest.mark.parametrize("length", [0.03, 0.0777, 0.2])
def test_a_carriage_fits_its_rail_by_least_squares(length: float) -> None:
    # Ekinci and Mayer (2007): against a polynomial fit of the profile sampled densely
    places = np.array([-0.32, 0.0, 0.21, 0.48])
    found = average_profile(PROFILE, places, length)
    cells = 400_000
    arms = length * ((np.arange(cells) + 0.5) / cells - 0.5)
    values = PROFILE.sample(places[:, None] + arms)
    assert found.mean == approx(values.mean(axis=1), abs=1e-15)
    assert found.slope == approx(values @ arms / (arms @ arms), abs=1e-13)


def test_straightness_tilts_a_carriage_by_its_slope() -> None:
    rising = ErrorProfile(coefficients=np.array([0.0, 2e-6]), scale=0.1)
    errors = RailErrors({1: rising, 2: rising}, length=0.1)
    # joint axes: a rail that rises along x turns its carriage by -slope about y
    assert errors.offset(np.array([0.3]))[0] == approx([0, 6e-6, 6e-6, 0, -2e-5, 2e-5])


def test_waves_of_passing_balls_are_not_averaged() -> None:
    wave = ErrorProfile(waves=(Wave(0.002, 1e-7),))
    place = np.array([0.0005])
    assert RailErrors({2: wave}, length=0.1).offset(place)[0, 2] == approx(0.0, abs=1e-15)
    assert RailErrors({}, length=0.1, passing={2: wave}).offset(place)[0, 2] == approx(1e-7)


def test_a_place_outside_the_table_is_refused() -> None:
    with pytest.raises(ProfileError, match="outside its table"):
        average_profile(PROFILE, np.array([0.58]), 0.1)


def test_squareness_turns_the_line_and_not_the_body() -> None:
    errors = AxisErrors({}, squareness=np.array([0.0, 0.0, 1e-5]))
    moved = errors.sample(np.array([0.2]), np.array([0.0, 1.0, 0.0]))[0]
    assert moved == approx([-2e-6, 0, 0, 0, 0, 0])
