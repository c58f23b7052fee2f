"""Set points: positions, speeds and accelerations belong together, and a move that is too short is
refused.
"""

import numpy as np
import pytest

from common import approx
from headstock.solvers.motion.set_points import (
    Ramp,
    SetPoint,
    _step_accelerations,
    find_move_fault,
    list_breaks,
    sample_move,
)

RAMPS = [
    Ramp("linear", 0.1),
    Ramp("s_curve", 0.1, 0.03),
    Ramp("s_curve", 0.1, 0.1),
    Ramp("exponential", 0.1),
]


@pytest.mark.parametrize("ramp", RAMPS, ids=lambda ramp: f"{ramp.kind}-{ramp.jerk_time:g}")
def test_speed_and_acceleration_are_the_derivatives_of_the_position(ramp: Ramp) -> None:
    move = SetPoint(0.08, 0.05, ramp)
    times = np.linspace(-0.1, move.duration + 1.0, 40_001, dtype=np.float64)
    motion = sample_move(move, times)
    assert motion.positions[0] == 0.0
    rest = np.exp(-(times[-1] - move.braking) / 0.1) if ramp.kind == "exponential" else 1e-14
    assert motion.positions[-1] == approx(0.08, rel=2.0 * rest)
    step = times[1] - times[0]
    np.testing.assert_allclose(
        np.gradient(motion.positions, times), motion.speeds, atol=0.6 * 0.5 * step
    )
    smooth = np.min(np.abs(times[:, None] - list_breaks(move)), axis=1) > 2.0 * step
    found = np.gradient(motion.speeds, times)
    np.testing.assert_allclose(
        found[smooth], motion.accelerations[smooth], atol=20.0 * step**2 * 0.5 / 0.1**2
    )


def test_linear_ramps_are_those_of_the_seed() -> None:
    """100 ms are 0.1 m/s^2 at 600 and 0.5 m/s^2 at 3000 mm/min; braking takes place from 1.6 to 1.7
    s.
    """
    low_frequency, fast = (
        SetPoint(0.08, feed / 6e4, Ramp("linear", 0.1)) for feed in (600.0, 3000.0)
    )
    found = [
        sample_move(move, np.array([0.05, move.braking + 0.05])).accelerations
        for move in (low_frequency, fast)
    ]
    np.testing.assert_allclose(found, [[0.1, -0.1], [0.5, -0.5]], rtol=1e-14)
    np.testing.assert_allclose(fast.zones, [[0.0, 0.1], [1.6, 1.7]], rtol=1e-14)


def test_the_jerk_of_an_s_curve_is_limited() -> None:
    move = SetPoint(0.08, 0.05, Ramp("s_curve", 0.1, 0.03))
    times = np.linspace(0.0, move.duration, 5001, dtype=np.float64)
    jerk = np.gradient(sample_move(move, times).accelerations, times)
    assert np.abs(jerk).max() == approx(0.5 / 0.03, rel=1e-9)


@pytest.mark.parametrize("ramp", RAMPS[:3], ids=lambda ramp: f"{ramp.kind}-{ramp.jerk_time:g}")
def test_steps_see_the_acceleration_on_their_side_of_a_jump(ramp: Ramp) -> None:
    move = SetPoint(0.0723, 0.05, ramp)
    breaks = list_breaks(move)
    times = np.sort(np.concatenate([np.linspace(0.0, move.duration, 173), breaks[1:-1]]))
    loads = _step_accelerations(move, times)
    motion = sample_move(move, times)
    # the mean over each step is what the speed gains
    np.testing.assert_allclose(
        loads.mean(axis=1) * np.diff(times), np.diff(motion.speeds), atol=1e-14
    )


@pytest.mark.parametrize("ramp", RAMPS, ids=lambda ramp: f"{ramp.kind}-{ramp.jerk_time:g}")
def test_a_move_that_never_reaches_its_feed_is_refused_with_what_would_do(ramp: Ramp) -> None:
    least = 0.05 * ramp.duration
    assert not find_move_fault(SetPoint(least * (1.0 + 1e-9), 0.05, ramp))
    fault = find_move_fault(SetPoint(0.99 * least, 0.05, ramp))
    assert "never reaches 3000 mm/min" in fault
    assert f"at least {1e3 * least:g} mm long" in fault
