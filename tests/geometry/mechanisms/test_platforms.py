import numpy as np
import pytest

from headstock.geometry.mechanisms.closures import closure_residual
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
    assert np.abs(closure_residual(planar_3rpr(BASE, PLATFORM), state)).max() == pytest.approx(
        0.0, abs=1e-15
    )
