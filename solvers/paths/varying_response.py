"""Deviation from a path along which the system changes: exact steps in the pose at the middle of
each.

A step of the exponential midpoint rule is the exact step of the system frozen half-way: second
order in how much the system changes per step, which is next to nothing, and free of any error of
integration where it does not change. Source: Hochbruck and Ostermann (2010), Exponential
integrators, section 3.2 (Magnus methods).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError
from headstock.solvers.paths.loads import cut_times, step_loads
from headstock.solvers.paths.response import PathDeviation, PathModel, act_at, step_times
from headstock.solvers.paths.set_points import SetPoint, sample_move, step_accelerations
from headstock.solvers.paths.varying_system import SampledPose, VaryingSystem

STEP_TOLERANCE = 1e-9  # of the interpolated steps, as a share of their largest entry
FIRST_KNOTS, MOST_KNOTS = 33, 2049
SAME_STEP = 1e-9


@dataclass(frozen=True, eq=False)
class StepTable:
    """Exact steps of one size along a path, interpolated.

    Attributes:
        size: [s].
        spline: Position to the matrix of a step: the state after it from the state and what is
            given at its beginning and end.
    """

    size: float
    spline: CubicSpline


def make_step_table(system: VaryingSystem[SampledPose], size: float) -> StepTable:
    """Steps of one size at so many places that those between are known.

    Raises:
        AccuracyError: The greatest number of places does not suffice.
    """
    return tabulate_steps(
        lambda place: exact_step(system.at(place), system.scales, size),
        float(system.positions[-1]),
        size,
    )


def tabulate_steps(step: Callable[[float], FloatArray], length: float, size: float) -> StepTable:
    """The same of any steps.

    Args:
        step: The matrix of a step in the middle of which the system stands at a position [m].
        length: Of the path [m].
        size: Of the steps [s].

    Raises:
        AccuracyError: The greatest number of places does not suffice.
    """
    known: dict[float, FloatArray] = {}
    count = FIRST_KNOTS
    while count <= MOST_KNOTS:
        places = np.linspace(0.0, length, count)
        before = (
            CubicSpline(sorted(known), np.array([known[s] for s in sorted(known)]))
            if known
            else None
        )
        missed = 0.0
        for place in (float(value) for value in places if float(value) not in known):
            known[place] = step(place)
            if before is not None:
                missed = max(
                    missed,
                    float(np.abs(before(place) - known[place]).max() / np.abs(known[place]).max()),
                )
        if before is not None and missed <= STEP_TOLERANCE:
            return StepTable(size, CubicSpline(places, np.array([known[float(s)] for s in places])))
        count = 2 * count - 1
    raise AccuracyError(
        f"{MOST_KNOTS} places along the path leave an error of {missed:.2g} of a step between them; shorten the path, or sample it faster"
    )


def exact_step(sampled_pose: SampledPose, scales: FloatArray, size: float) -> FloatArray:
    """Exact step of the system frozen at one position, as a matrix ``(2m, 2m + 2k)``.

    It gives the state ``(scale q, q')`` after the step from the state before it and what acts at its
    beginning and end, between which it is linear: the acceleration along the path, and loads.

    Args:
        sampled_pose: Modal matrices of ``m`` modes at that position.
        scales: ``(m,)`` [rad/s] that make displacements as large as velocities.
        size: Length of the step [s].

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    count, acting = len(scales), sampled_pose.loads.shape[1]
    states = 2 * count
    big = np.zeros((states + 2 * acting, states + 2 * acting))
    big[:count, count:states] = np.diag(scales)
    big[count:states, :count] = -sampled_pose.stiffness / scales
    big[count:states, count:states] = -sampled_pose.damping
    big[count:states, states : states + acting] = sampled_pose.loads
    # A linear load is an integral of two more states: the load at the start, and its rise per step
    # (hence 1, not size). One exponential then holds the step and both integrals of the load, also
    # where frequencies are zero and no closed form would do
    big *= size
    big[states : states + acting, states + acting :] = np.eye(acting)
    found = scipy.linalg.expm(big)[:states]
    level, rise = found[:, states : states + acting], found[:, states + acting :]
    # level * a0 + rise * (a1 - a0), in terms of what acts at both ends
    return np.hstack([found[:, :states], level - rise, rise])


def solve_varying_path(
    system: VaryingSystem[SampledPose],
    model: PathModel,
    move: SetPoint,
    samples: FloatArray,
    table: StepTable | None = None,
) -> PathDeviation:
    """Deviation over a move along which the system changes.

    Args:
        move: Along the same path.
        samples: ``(n,)`` evenly spaced, from zero [s].
        table: Steps of the size of those of ``cut_times``, where they are already known.
    """
    fine, parts = cut_times(samples, model.loads)
    times, places = step_times(move, fine)
    states = _integrate(
        system, model, move, times, table or make_step_table(system, float(fine[1] - fine[0]))
    )[places[::parts]]
    positions, now = sample_move(move, samples).positions, act_at(model, move, samples)
    displacements = states / system.scales
    quasi_static = now[:, :1] * system.splines["quasi_static"](positions)
    moved, low_frequency = (
        observe_along(system.splines[name], positions, displacements)
        for name in ("rows", "low_frequency")
    )
    total = moved + observe_along(system.splines["rest"], positions, now)
    return PathDeviation(
        samples,
        total,
        np.asarray(quasi_static),
        low_frequency,
        total - quasi_static - low_frequency,
    )


def _integrate(
    system: VaryingSystem[SampledPose],
    model: PathModel,
    move: SetPoint,
    times: FloatArray,
    table: StepTable,
) -> FloatArray:
    """Scaled displacements ``(n, m)`` at all times."""
    accelerations, loads = step_accelerations(move, times), step_loads(model.loads, move, times)
    given = [part for end in range(2) for part in (accelerations[:, end : end + 1], loads[:, end])]
    states = integrate_steps(
        table,
        lambda place, size: exact_step(system.at(place), system.scales, size),
        move,
        times,
        np.hstack(given),
        size=2 * len(system.scales),
    )
    return states[:, : len(system.scales)]


def integrate_steps(
    table: StepTable,
    step: Callable[[float, float], FloatArray],
    move: SetPoint,
    times: FloatArray,
    given: FloatArray,
    *,
    size: int,
) -> FloatArray:
    """States ``(n, size)`` at all times, from rest.

    Args:
        table: Steps of the most frequent size.
        step: The matrix of a step about a position [m], of a size [s]: the others.
        move: Where the system stands.
        times: ``(n,)`` [s].
        given: ``(n - 1, k)`` what the matrix of each step takes beside the state.
    """
    steps = np.diff(times)
    middles = sample_move(move, 0.5 * (times[1:] + times[:-1])).positions
    knots, coefficients = table.spline.x, table.spline.c
    intervals = np.clip(np.searchsorted(knots, middles, side="right") - 1, 0, len(knots) - 2)
    offsets = middles - knots[intervals]
    regular = np.abs(steps - table.size) <= SAME_STEP * table.size
    state, found = np.zeros(size), np.zeros((len(times), size))
    for number in range(len(steps)):
        known = np.concatenate([state, given[number]])
        if regular[number]:
            cubic, square, slope, value = coefficients[:, intervals[number]] @ known
            state = ((cubic * offsets[number] + square) * offsets[number] + slope) * offsets[
                number
            ] + value
        else:
            state = step(float(middles[number]), float(steps[number])) @ known
        found[number + 1] = state
    return found


def observe_along(
    rows: CubicSpline, positions: FloatArray, displacements: FloatArray
) -> FloatArray:
    """Motion at the outputs ``(n, p)``; one output after the other, as rows along the path take
    room.
    """
    outputs = range(rows.c.shape[2])
    single = (
        CubicSpline.construct_fast(rows.c[:, :, output], rows.x, extrapolate=True)
        for output in outputs
    )
    return np.column_stack([np.einsum("nm,nm->n", row(positions), displacements) for row in single])
