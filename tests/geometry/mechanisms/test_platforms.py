import numpy as np
import pytest

from common import approx
from headstock.geometry.errors import ClosureError
from headstock.geometry.mechanisms.closures import close_loops, closure_residual, find_mobility
from headstock.geometry.mechanisms.platforms import (
    planar_3rpr,
    planar_3rpr_assemblies,
    planar_3rpr_state,
)

BASE, PLATFORM = (
    np.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]),
    np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]),
)


@pytest.mark.parametrize("seed", range(40))
def test_the_pose_that_gave_the_lengths_is_among_the_assemblies(seed: int) -> None:
    x, y, angle = np.random.default_rng(seed).uniform([-0.5, -0.5, -3.0], [1.5, 1.5, 3.0])
    state = planar_3rpr_state(BASE, PLATFORM, (x, y), angle)
    lengths = state[:3]
    found = planar_3rpr_assemblies(BASE, PLATFORM, lengths)
    assert 2 <= len(found) <= 6 and len(found) % 2 == 0
    for px, py, turned in found:
        other = planar_3rpr_state(BASE, PLATFORM, (px, py), turned)
        assert np.allclose(other[:3], lengths, atol=1e-6)
    assert min(np.hypot(px - x, py - y) + abs(turned - angle) for px, py, turned in found) < 1e-5


def test_six_assemblies_exist() -> None:
    base, platform = (
        np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.9]]),
        np.array([[0.0, 0.0], [1.1, 0.0], [0.3, 0.8]]),
    )
    counts = {
        len(planar_3rpr_assemblies(base, platform, np.array([q, 0.9, 1.1])))
        for q in np.linspace(0.6, 1.4, 41)
    }
    assert 6 in counts and max(counts) == 6


def test_lengths_that_meet_nowhere_give_no_assembly() -> None:
    assert planar_3rpr_assemblies(BASE, PLATFORM, np.array([0.05, 0.05, 0.05])) == []


def test_state_of_a_turned_platform_is_closed() -> None:
    state = planar_3rpr_state(BASE, PLATFORM, (0.2, 0.3), 2.9)
    assert np.abs(closure_residual(planar_3rpr(BASE, PLATFORM), state)).max() == approx(
        0.0, abs=1e-15
    )


@pytest.mark.parametrize("size", [1e-2, 1.0, 30.0])
@pytest.mark.parametrize("turn", [0.0, 0.3, -1.1])
def test_a_closed_singular_pose_stays_as_it_is_and_is_named(size: float, turn: float) -> None:
    # similar triangles: when they are turned alike, all legs point to their common centre
    angles = np.radians([90.0, 210.0, 330.0]) + turn
    base = size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    mechanism = planar_3rpr(base, 0.3 * base)
    state = planar_3rpr_state(base, 0.3 * base, (0.0, 0.0), 0.0)
    np.testing.assert_allclose(close_loops(mechanism, state), state, atol=1e-9)
    both = np.array([state, planar_3rpr_state(base, 0.3 * base, (0.1 * size, 0.0), 0.4)])
    np.testing.assert_allclose(close_loops(mechanism, both), both, atol=1e-9)
    assert find_mobility(mechanism, state).passive_condition > 1e10


def test_a_singular_pose_with_open_loops_is_out_of_reach() -> None:
    angles = np.radians([90.0, 210.0, 330.0])
    base = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    state = planar_3rpr_state(base, 0.3 * base, (0.0, 0.0), 0.0)
    state[:3] *= 0.5
    with pytest.raises(ClosureError):
        close_loops(planar_3rpr(base, 0.3 * base), state)
