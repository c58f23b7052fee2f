"""Modes keep their identity over poses: through crossings, through poses where two frequencies
coincide, around corners.
"""

import numpy as np
import pytest
from scipy.linalg import eigh

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_tracking import (
    SweptModes,
    TrackedModes,
    track_modes,
    tracked_frequencies,
)

MASS = np.diag([1.0, 2.0, 0.5, 1.5])
ROOT = np.sqrt(MASS)


def sweep_modes(stiffnesses: list[FloatArray]) -> SweptModes:
    """Modes of mass-spring systems, every coincident pair of them turned by some angle as a solver
    may.
    """
    frequencies, fields = [], []
    for stiffness in stiffnesses:
        eigenvalues, shapes = eigh(stiffness, MASS)
        for one in np.flatnonzero(np.diff(eigenvalues) < 1e-9 * eigenvalues[1:]):
            angle = 0.7
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            shapes[:, one : one + 2] = shapes[:, one : one + 2] @ turn
        frequencies.append(np.sqrt(eigenvalues) / (2.0 * np.pi))
        fields.append(ROOT @ shapes)
    count = len(MASS)
    whole, none = np.full(len(stiffnesses), count), np.zeros(len(stiffnesses), dtype=np.int64)
    return SweptModes(np.array(frequencies), np.array(fields).astype(np.float32), whole, none)


def independent(levels: list[float]) -> FloatArray:
    return np.diag(np.array(levels) * MASS.diagonal())


def chain(count: int) -> list[tuple[int, int]]:
    return [(number, number + 1) for number in range(count - 1)]


def follow(
    stiffnesses: list[FloatArray], edges: list[tuple[int, int]]
) -> tuple[FloatArray, TrackedModes]:
    modes = sweep_modes(stiffnesses)
    tracked = track_modes(modes, edges)
    return tracked_frequencies(modes.frequencies_hz, tracked.index), tracked


@pytest.mark.parametrize("count", [10, 11, 41])
def test_two_oscillators_that_pass_each_other_keep_their_curves(count: int) -> None:
    """With 11 and 41 poses one of them stands where both frequencies are equal, and the solver's
    shapes are any mixture.
    """
    places = np.linspace(-1.0, 1.0, count)
    found, tracked = follow(
        [independent([100.0 + 40.0 * x, 100.0 - 40.0 * x, 400.0, 900.0]) for x in places],
        chain(count),
    )
    wanted = np.sqrt(np.column_stack([100.0 + 40.0 * places, 100.0 - 40.0 * places])) / (
        2.0 * np.pi
    )
    for curve in wanted.T:
        assert np.abs(found[:, :2] - curve[:, None]).max(axis=0).min() < 1e-9
    assert (0, 1) in tracked.crossings
    assert (2, 3) not in tracked.crossings


def test_three_oscillators_that_meet_in_one_point_keep_their_curves() -> None:
    places = np.linspace(-1.0, 1.0, 21)
    levels = [[200.0 + 90.0 * x, 200.0, 200.0 - 90.0 * x, 900.0] for x in places]
    stiffnesses = [independent(level) for level in levels]
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    modes = sweep_modes(stiffnesses)
    modes.fields[10, :, :3] = modes.fields[10, :, :3] @ turn
    found = tracked_frequencies(modes.frequencies_hz, track_modes(modes, chain(21)).index)
    curves = np.sqrt(np.array(levels)[:, :3]) / (2.0 * np.pi)
    missed = np.abs(found[:, :3, None] - curves[:, None]).max(axis=0)
    assert missed.min(axis=0).max() < 1e-9


def test_modes_that_veer_in_small_steps_exchange_their_shapes_and_do_not_cross() -> None:
    coupling = 6.0
    stiffnesses = []
    for x in np.linspace(-1.0, 1.0, 81):
        stiffness = independent([100.0 + 40.0 * x, 100.0 - 40.0 * x, 400.0, 900.0])
        stiffness[0, 1] = stiffness[1, 0] = coupling * np.sqrt(MASS[0, 0] * MASS[1, 1])
        stiffnesses.append(stiffness)
    found, tracked = follow(stiffnesses, chain(81))
    assert (found[:, 0] < found[:, 1]).all()
    assert tracked.crossings == {}
    assert np.nanmin(tracked.correlation) > 0.9


def test_a_grid_is_followed_around_the_line_on_which_modes_cross() -> None:
    """On a grid the crossing line is met from both sides; every mode is one smooth surface."""
    xs, ys = np.linspace(-1.0, 1.0, 9), np.linspace(-1.0, 1.0, 7)
    levels = np.array(
        [
            [150.0 + 60.0 * (x + y), 150.0 - 60.0 * (x + y), 400.0 + 30.0 * x, 900.0]
            for x in xs
            for y in ys
        ]
    )
    numbers = np.arange(63).reshape(9, 7)
    edges = [*zip(numbers[:-1].ravel(), numbers[1:].ravel(), strict=True)]
    edges += zip(numbers[:, :-1].ravel(), numbers[:, 1:].ravel(), strict=True)
    found, tracked = follow(
        [independent(list(level)) for level in levels], [(int(a), int(b)) for a, b in edges]
    )
    assert found.shape[1] == 4
    assert np.isfinite(found).all()
    assert tracked.tracking_breaks == 0
    for column in range(4):
        curve = np.sqrt(levels[:, column]) / (2.0 * np.pi)
        assert np.abs(found - curve[:, None]).max(axis=0).min() < 1e-9


def test_a_mode_that_leaves_the_range_and_comes_back_elsewhere_is_not_taken_for_another() -> None:
    places = np.linspace(-1.0, 1.0, 21)
    modes = sweep_modes([independent([100.0, 150.0 + 500.0 * x * x, 400.0, 900.0]) for x in places])
    # only three modes are solved for in each pose
    cut = SweptModes(
        modes.frequencies_hz[:, :2], modes.fields[:, :, :2], modes.wanted - 2, modes.rigid
    )
    tracked = track_modes(cut, chain(21))
    found = tracked_frequencies(cut.frequencies_hz, tracked.index)
    steady = np.isfinite(found).all(axis=0)
    assert steady.any()
    assert np.ptp(found[:, steady], axis=0) == approx(0.0, abs=1e-9)
    for column in np.flatnonzero(~steady):
        values = found[:, column][np.isfinite(found[:, column])]
        assert np.abs(np.diff(values)).max() < 0.6


def test_poses_without_modes_are_left_out() -> None:
    modes = sweep_modes([independent([100.0 + x, 200.0, 400.0, 900.0]) for x in range(5)])
    modes.frequencies_hz[2] = np.nan
    modes.fields[2] = 0.0
    modes.wanted[2] = 0
    tracked = track_modes(modes, chain(5))
    assert (tracked.index[2] == -1).all()
    assert (tracked.index[[0, 1]] >= 0).all(axis=0).any()
