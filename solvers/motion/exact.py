"""Deviation from a path while its axes accelerate, in a constant pose, exact; its low-pass, and its
figures in each acceleration zone.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy  # whose filters, a quarter of a second, are loaded where they are used
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    count_modes,
    keep_modes,
    to_modal_coordinates,
)
from headstock.solvers.linear.state_space import Feedthrough, StateSpace, modal_state_space
from headstock.solvers.linear.time_response import add_direct, solve_stepped_response
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.loads import (
    PathLoads,
    cut_times,
    load_channels,
    loads_at,
    refine_times,
    step_loads,
)
from headstock.solvers.motion.plant import SampledPose, VaryingSystem
from headstock.solvers.motion.set_points import (
    SetPoint,
    sample_move,
    step_accelerations,
    step_times,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.watched_outputs import Watch, WatchedValues

STEP_TOLERANCE = 1e-9  # of the interpolated steps, as a share of their largest entry
FIRST_KNOTS, MOST_KNOTS = 33, 2049
SAME_STEP = 1e-9


@dataclass(frozen=True)
class PathModel:
    """What a deviation is computed of.

    Attributes:
        source: Input of the acceleration along the path.
        outputs: Where the deviation is wanted.
        low_frequency_limit_hz: Modes below it do not follow a ramp [Hz].
        up_to_hz: Modes kept; those above follow at once. None keeps all.
        loads: On the machine; None for none.
        watched: Other outputs that are asked for as a whole.
    """

    source: Channel
    outputs: tuple[Channel, ...]
    low_frequency_limit_hz: float
    up_to_hz: float | None = None
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """All of them."""
        return (self.source, *load_channels(self.loads))


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Loads along a path that do not come from its acceleration.

    Attributes:
        channels: Where they act.
        at: Loads ``(n, k)`` at instants ``(n,)``.
        step: Longest time over which a load may be taken for straight [s].
        passed: What outputs have of them at once; None for nothing.
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray], FloatArray]
    step: float
    passed: Feedthrough | None = None

    def act_on(
        self,
        space: StateSpace,
        outputs: Sequence[Channel],
        watch: Watch,
        *,
        slow: NDArray[np.bool_],
        held: FloatArray,
        samples: FloatArray,
    ) -> PathDeviation:
        """Return what they do to a system between their channels and outputs; see
        :func:`respond_exactly`.
        """
        fine, parts = refine_times(samples, self.step)
        given = self.at(fine)
        return _respond_exactly(
            space,
            outputs,
            watch,
            slow=slow,
            held=held,
            times=fine,
            given=np.stack([given[:-1], given[1:]], axis=1),
            some=np.arange(0, len(fine), parts),
            now=given[::parts],
        )


def solve_path(
    system: SecondOrderSystem, model: PathModel, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation of a system over a move; no error but that of the model, whatever the sampling.

    Args:
        system: Symmetric, with the source among its inputs.
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    outputs = (*model.outputs, *model.watched.outputs)
    coordinates = _find_coordinates(system, model.inputs, outputs)
    if model.up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, model.up_to_hz))
    fine, parts = cut_times(samples, model.loads)
    times, places = step_times(move, fine)
    given = np.concatenate(
        [step_accelerations(move, times)[:, :, None], step_loads(model.loads, move, times)], axis=2
    )
    space = modal_state_space(coordinates, model.inputs, outputs)
    held = _static_share(coordinates, space, model.outputs, model.low_frequency_limit_hz)
    # of what loads do nothing counts as quasi-static
    held[:, space.columns.of(load_channels(model.loads))] = 0.0
    return _respond_exactly(
        space,
        model.outputs,
        model.watched,
        slow=coordinates.omega < 2.0 * np.pi * model.low_frequency_limit_hz,
        held=held,
        times=times,
        given=given,
        some=places[::parts],
        now=act_at(model, move, samples),
    )


def _find_coordinates(
    system: SecondOrderSystem, inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> ModalCoordinates:
    """Return the modes of a system in time.

    Raises:
        ModelError: A channel is unknown, a damper acts on a dof without mass, or a matrix is not
            symmetric.
    """
    found = to_modal_coordinates(equivalent_viscous(system), inputs, outputs)
    if found is None:
        raise ModelError(
            "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
        )
    return found


def _respond_exactly(
    space: StateSpace,
    outputs: Sequence[Channel],
    watch: Watch,
    *,
    slow: NDArray[np.bool_],
    held: FloatArray,
    times: FloatArray,
    given: FloatArray,
    some: NDArray[np.intp],
    now: FloatArray,
) -> PathDeviation:
    """Return the motion of a system from rest under loads that are straight between times, without
    any error of integration.

    Args:
        outputs: Where the deviation is wanted.
        slow: ``(m,)`` modes of low frequency: two states each; none of a system without modes.
        held: ``(n_outputs, k)`` what inputs hold statically, without the slow modes.
        times: ``(n,)`` rising, from zero [s].
        given: ``(n - 1, 2, k)`` inputs at the beginning and at the end of each step.
        now: ``(n_samples, k)`` inputs there.
    """
    rows, watched = space.rows.of(outputs), space.watch(watch)
    shown, count = space.c[rows], len(outputs)
    below = np.where(np.repeat(slow, 2), shown, 0.0) if len(slow) else np.zeros_like(shown)
    c = np.vstack([shown, below, watched.states])
    states = dataclasses.replace(
        space, c=c, d=np.zeros((len(c), len(space.inputs))), inputs=(), outputs=()
    )
    moved = solve_stepped_response(states, times, given).outputs[some]
    total, low_frequency = moved[:, :count], moved[:, count : 2 * count]
    total, values = total + now @ space.d[rows].T, moved[:, 2 * count :]
    add_direct(values, now, watched.inputs)
    quasi_static = now @ held.T
    return PathDeviation(
        times[some],
        total,
        quasi_static,
        low_frequency,
        total - quasi_static - low_frequency,
        WatchedValues(watch.channels, values),
    )


def solve_loads(
    system: SecondOrderSystem,
    outputs: Sequence[Channel],
    loads: Disturbance,
    *,
    samples: FloatArray,
    low_frequency_limit_hz: float,
    watch: Watch,
) -> PathDeviation:
    """Deviation of a system at rest under loads along a path that do not come from its acceleration,
    such as errors of guides as they are passed, exact for loads that are straight between fine steps.

    Args:
        system: Symmetric, with the channels of the loads among its inputs.
        outputs: Where the deviation is wanted.
        loads: They begin at zero.
        samples: ``(n,)`` evenly spaced, from zero [s].
        low_frequency_limit_hz: Modes below count as low-frequency response [Hz].
        watch: What else is wanted of it.

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    wanted = (*outputs, *watch.outputs)
    coordinates = _find_coordinates(system, loads.channels, wanted)
    space = modal_state_space(coordinates, loads.channels, wanted).pass_on(loads.passed)
    share = _static_share(coordinates, space, outputs, low_frequency_limit_hz)
    slow = coordinates.omega < 2.0 * np.pi * low_frequency_limit_hz
    return loads.act_on(space, outputs, watch, slow=slow, held=share, samples=samples)


def solve_loop_loads(
    loop: StateSpace,
    outputs: Sequence[Channel],
    loads: Disturbance,
    *,
    samples: FloatArray,
    watch: Watch,
) -> PathDeviation:
    """The same of a stable closed loop that holds its set points; its quasi-static part is what it
    holds under constant loads.
    """
    columns, rows = loop.columns.of(loads.channels), loop.rows.of(outputs)
    b, d = loop.b[:, columns], loop.d[:, columns]
    space = dataclasses.replace(loop, b=b, d=d, inputs=loads.channels).pass_on(loads.passed)
    held = space.d[rows] - loop.c[rows] @ np.linalg.solve(loop.a, b)
    none = np.zeros(0, dtype=np.bool_)
    return loads.act_on(space, outputs, watch, slow=none, held=held, samples=samples)


def act_at(model: PathModel, move: SetPoint, times: FloatArray) -> FloatArray:
    """Acceleration along the path, and loads ``(n, 1 + n_loads)`` at instants."""
    motion = sample_move(move, times)
    return np.column_stack([motion.accelerations, loads_at(model.loads, times, motion.speeds)])


def _static_share(
    coordinates: ModalCoordinates,
    space: StateSpace,
    outputs: Sequence[Channel],
    low_frequency_limit_hz: float,
) -> FloatArray:
    """Deviation per unit of each input ``(n_outputs, k)`` if all but the low-frequency modes respond
    quasi-statically, and what outputs have at once.
    """
    rows = space.rows.of(outputs)
    fast = coordinates.omega >= 2.0 * np.pi * low_frequency_limit_hz
    moved = coordinates.outputs[rows][:, fast] / coordinates.eigenvalues[fast]
    return np.asarray(moved @ coordinates.inputs[fast] + space.d[rows])


def slow_modes(frequencies_hz: Sequence[float] | FloatArray, low_frequency_limit_hz: float) -> int:
    """How many modes lie below the limit."""
    return int(np.count_nonzero(np.asarray(frequencies_hz) < low_frequency_limit_hz))


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
