"""Straightness, squareness and shares of a volumetric map."""

import numpy as np
import pytest

from common import approx
from headstock.solvers.linear.volumetric import axis_motions, find_squareness, variance_shares

PLACES = np.asarray(np.linspace(-0.2, 0.3, 11), dtype=float)
X, Y, Z = np.eye(3)


def test_straightness_is_about_the_least_squares_line() -> None:
    motions = np.zeros((11, 6))
    motions[:, 1] = 3e-6 + 2e-5 * PLACES
    motions[:, 0] = 4e-5 * PLACES
    motions[:, 5] = 1e-5 * PLACES
    found = axis_motions("X", PLACES, motions, X)
    assert found.deviations == approx([2e-5, 0, 0, 0, 0, 5e-6], abs=1e-18)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["moves the tool", "moves the work"])
@pytest.mark.parametrize("turn", range(3))
def test_a_turned_line_is_a_squareness_of_its_angle(turn: int, sign: float) -> None:
    """Each axis turned about each other one: sign and symbol."""
    angle, names = 2e-5, "XYZ"
    first, second = sorted({0, 1, 2} - {turn})
    about = np.eye(3)[turn]
    straight = axis_motions(names[first], PLACES, np.zeros((11, 6)), np.eye(3)[first])
    travel = sign * np.eye(3)[second]
    motions = np.zeros((11, 6))
    motions[:, :3] = np.outer(PLACES, np.cross(angle * about, travel))
    turned = axis_motions(names[second], PLACES, motions, travel)
    found = find_squareness(turned, straight)
    assert found is not None and found.symbol == f"E{'ABC'[turn]}0{names[second]}"
    assert found.angle == approx(angle, rel=1e-6)


def test_rotary_axes_have_no_squareness() -> None:
    line = axis_motions("X", PLACES, np.zeros((11, 6)), X)
    assert find_squareness(line, axis_motions("C", PLACES, np.zeros((11, 6)), 0.0 * X)) is None


def test_shares_of_the_variation_add_up() -> None:
    rng = np.random.default_rng(5)
    parts = {"a": rng.normal(size=50), "b": 3.0 + 0.1 * rng.normal(size=50), "c": np.full(50, 7.0)}
    parts["a"][4] = np.nan
    shares = variance_shares(parts)
    assert sum(shares.values()) == approx(1.0, rel=1e-12)
    assert shares["c"] == approx(0.0, abs=1e-12) and shares["a"] > 0.9
    assert variance_shares({"a": np.ones(4)}) == {}
