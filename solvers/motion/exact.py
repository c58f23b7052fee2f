"""Deviation from a path while its axes accelerate, by exact steps: in a constant pose, and in that at
the middle of each step.

A step of the exponential midpoint rule is the exact step of the system frozen half-way: second
order in how much the system changes per step, which is next to nothing, and free of any error of
integration where it does not change. Source: Hochbruck and Ostermann (2010), Exponential
integrators, section 3.2 (Magnus methods).
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
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
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.plant import SampledPlant, VaryingSystem
from headstock.solvers.motion.set_points import (
    PathLoads,
    SetPoint,
    SteppedInputs,
    cut_times,
    load_channels,
    refine_times,
    sample_move,
    step_move,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import Feedthrough, StateSpace, modal_state_space
from headstock.solvers.state_spaces.time_response import (
    add_direct,
    exact_step,
    solve_stepped_response,
)
from headstock.solvers.watched_outputs import Watch, WatchedOutputs, WatchedValues

STEP_TOLERANCE = 1e-9  # of the interpolated steps, as a share of their largest entry
FIRST_KNOTS, MOST_KNOTS = 33, 2049
SAME_STEP = 1e-9


@dataclass(frozen=True)
class PathModel:
    """Define which deviation is computed.

    Attributes:
        source: Input of the acceleration along the path.
        low_frequency_limit_hz: Modes below it do not follow a ramp [Hz].
        up_to_hz: Modes kept; those above respond statically. None keeps all.
        loads: Loads on the machine; None for none.
        watched: Other outputs whose total alone is wanted.
    """

    source: Channel
    outputs: tuple[Channel, ...]
    low_frequency_limit_hz: float
    up_to_hz: float | None = None
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Channels of the acceleration along the path and of the loads."""
        return (self.source, *load_channels(self.loads))


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Describe loads along a path that are independent of its acceleration.

    Attributes:
        at: Returns loads ``(n, k)`` at instants ``(n,)``.
        step: Longest time over which a load may be approximated as linear [s].
        feedthrough: Direct feedthrough of the loads to outputs; None for none.
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray], FloatArray]
    step: float
    feedthrough: Feedthrough | None = None

    def act_on(
        self,
        space: StateSpace,
        outputs: Sequence[Channel],
        watch: Watch,
        *,
        below: FloatArray,
        static: FloatArray,
        samples: FloatArray,
    ) -> PathDeviation:
        """Return the deviation of a system by these loads.

        Args:
            below: ``(p, n)`` outputs of the low-frequency states.
            static: ``(p, k)`` static response to inputs, without the low-frequency states.
            samples: ``(n,)`` evenly spaced, from zero [s].
        """
        fine, parts = refine_times(samples, self.step)
        given = self.at(fine)
        steps = SteppedInputs(
            fine,
            np.arange(0, len(fine), parts),
            np.stack([given[:-1], given[1:]], axis=1),
            given[::parts],
        )
        return respond_exactly(
            space,
            steps,
            wanted=space.watch(Watch(tuple(outputs))),
            below=below,
            quasi_static=steps.now @ static.T,
            watched=space.watch(watch),
            channels=watch.channels,
        )


def solve_path(
    system: SecondOrderSystem, model: PathModel, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Compute the deviation of a system over a move, exact for any sampling.

    Args:
        system: Symmetric system, with the source among its inputs.
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    outputs = (*model.outputs, *model.watched.outputs)
    coordinates = _find_coordinates(system, model.inputs, outputs)
    if model.up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, model.up_to_hz))
    space = modal_state_space(coordinates, model.inputs, outputs)
    below, static = _split_modes(coordinates, space, model.outputs, model.low_frequency_limit_hz)
    # the whole response to loads counts as dynamic
    static[:, space.columns.of(load_channels(model.loads))] = 0.0
    steps = step_move(model.loads, move, samples)
    return respond_exactly(
        space,
        steps,
        wanted=space.watch(Watch(model.outputs)),
        below=below,
        quasi_static=steps.now @ static.T,
        watched=space.watch(model.watched),
        channels=model.watched.channels,
    )


def _find_coordinates(
    system: SecondOrderSystem, inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> ModalCoordinates:
    """Return the modal coordinates of a system for time integration.

    Raises:
        ModelError: A channel is unknown, a damper acts on a dof without mass, or a matrix is not
            symmetric.
    """
    coordinates = to_modal_coordinates(equivalent_viscous(system), inputs, outputs)
    if coordinates is None:
        raise ModelError(
            "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
        )
    return coordinates


def respond_exactly(
    space: StateSpace,
    steps: SteppedInputs,
    *,
    wanted: WatchedOutputs,
    below: FloatArray,
    quasi_static: FloatArray,
    watched: WatchedOutputs,
    channels: tuple[Channel, ...],
) -> PathDeviation:
    """Return the motion of a system from rest under inputs that are linear in each step, without any
    error of integration.

    Args:
        space: State space with ``n`` states and ``k`` inputs; its own outputs are not used.
        wanted: ``p`` outputs that deviate.
        below: ``(p, n)`` these outputs of the low-frequency states alone.
        quasi_static: ``(n_samples, p)`` static response to inputs, without these states.
        channels: Names of the watched outputs.
    """
    count, c = len(below), np.vstack([wanted.states, below, watched.states])
    states = dataclasses.replace(
        space, c=c, d=np.zeros((len(c), space.b.shape[1])), inputs=(), outputs=()
    )
    moved = solve_stepped_response(states, steps.times, steps.ends).outputs[steps.wanted]
    total, low_frequency = moved[:, :count], moved[:, count : 2 * count]
    total, values = total + steps.now @ wanted.inputs.T, moved[:, 2 * count :]
    add_direct(values, steps.now, watched.inputs)
    return PathDeviation(
        steps.times[steps.wanted],
        total,
        quasi_static,
        low_frequency,
        total - quasi_static - low_frequency,
        WatchedValues(channels, values),
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
    """Compute the deviation of a system at rest under loads along a path that are independent of
    its acceleration, such as guide errors; exact for loads that are linear between fine steps.

    Args:
        system: Symmetric system, with the channels of the loads among its inputs.
        samples: ``(n,)`` evenly spaced, from zero [s].
        low_frequency_limit_hz: Modes below count as low-frequency response [Hz].
        watch: Other outputs that are wanted.

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    wanted = (*outputs, *watch.outputs)
    coordinates = _find_coordinates(system, loads.channels, wanted)
    space = modal_state_space(coordinates, loads.channels, wanted).pass_on(loads.feedthrough)
    below, static = _split_modes(coordinates, space, outputs, low_frequency_limit_hz)
    return loads.act_on(space, outputs, watch, below=below, static=static, samples=samples)


def solve_loop_loads(
    loop: StateSpace,
    outputs: Sequence[Channel],
    loads: Disturbance,
    *,
    samples: FloatArray,
    watch: Watch,
) -> PathDeviation:
    """Compute the same of a stable closed loop at constant set points; its quasi-static part is its
    static response.
    """
    columns, rows = loop.columns.of(loads.channels), loop.rows.of(outputs)
    b, d = loop.b[:, columns], loop.d[:, columns]
    space = dataclasses.replace(loop, b=b, d=d, inputs=loads.channels).pass_on(loads.feedthrough)
    static = space.d[rows] - loop.c[rows] @ np.linalg.solve(loop.a, b)
    none = np.zeros((len(outputs), len(space.a)))
    return loads.act_on(space, outputs, watch, below=none, static=static, samples=samples)


def _split_modes(
    coordinates: ModalCoordinates,
    space: StateSpace,
    outputs: Sequence[Channel],
    low_frequency_limit_hz: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the outputs of the low-frequency modes ``(p, n)``, and the deviation per unit of each
    input ``(p, k)`` if all other modes respond quasi-statically, with the direct feedthrough.
    """
    rows = space.rows.of(outputs)
    slow = coordinates.omega < 2.0 * np.pi * low_frequency_limit_hz
    moved = coordinates.outputs[rows][:, ~slow] / coordinates.eigenvalues[~slow]
    static = moved @ coordinates.inputs[~slow] + space.d[rows]
    return np.where(np.repeat(slow, 2), space.c[rows], 0.0), static


def slow_modes(frequencies_hz: Sequence[float] | FloatArray, low_frequency_limit_hz: float) -> int:
    """Count the modes below the limit."""
    return int(np.count_nonzero(np.asarray(frequencies_hz) < low_frequency_limit_hz))


@dataclass(frozen=True, eq=False)
class StepTable:
    """Interpolate exact steps of one size along a path.

    Attributes:
        step: Position [m] and size [s] to the matrix of a step: the state after it from the state
            before and the inputs at its beginning and end.
        size: The most frequent one [s].
        spline: Position to the matrix of a step of this size.
    """

    step: Callable[[float, float], FloatArray]
    size: float
    spline: CubicSpline

    def integrate(self, move: SetPoint, times: FloatArray, given: FloatArray) -> FloatArray:
        """Return the states at all times ``(n, size)``, from rest.

        Args:
            move: Move that gives the position of the system.
            times: ``(n,)`` [s].
            given: ``(n - 1, k)`` inputs of each step besides the state.
        """
        steps = np.diff(times)
        middles = sample_move(move, 0.5 * (times[1:] + times[:-1])).positions
        knots, coefficients = self.spline.x, self.spline.c
        intervals = np.clip(np.searchsorted(knots, middles, side="right") - 1, 0, len(knots) - 2)
        offsets = middles - knots[intervals]
        regular = np.abs(steps - self.size) <= SAME_STEP * self.size
        states = np.zeros((len(times), coefficients.shape[2]))
        for number, offset in enumerate(offsets):
            acting = np.concatenate([states[number], given[number]])
            if regular[number]:
                cubic, square, slope, value = coefficients[:, intervals[number]] @ acting
                states[number + 1] = ((cubic * offset + square) * offset + slope) * offset + value
            else:
                step = self.step(float(middles[number]), float(steps[number]))
                states[number + 1] = step @ acting
        return states


def make_step_table(system: VaryingSystem, size: float) -> StepTable:
    """Tabulate steps of one size at enough positions to interpolate between them.

    Raises:
        AccuracyError: The largest number of positions does not suffice.
    """

    def step(position: float, size: float) -> FloatArray:
        return _step_pose(system.at(position), system.scales, size)

    return tabulate_steps(step, float(system.positions[-1]), size)


def tabulate_steps(
    step: Callable[[float, float], FloatArray], length: float, size: float
) -> StepTable:
    """Tabulate any steps of one size at enough positions to interpolate between them.

    Args:
        step: The matrix of a step in the middle of which the system is at a position [m], by its
            size [s].
        length: Of the path [m].
        size: The most frequent one [s].

    Raises:
        AccuracyError: The largest number of positions does not suffice.
    """
    exact: dict[float, FloatArray] = {}
    count = FIRST_KNOTS
    while count <= MOST_KNOTS:
        places = np.linspace(0.0, length, count)
        before = (
            CubicSpline(sorted(exact), np.array([exact[s] for s in sorted(exact)]))
            if exact
            else None
        )
        missed = 0.0
        for at in (float(value) for value in places if float(value) not in exact):
            exact[at] = step(at, size)
            if before is not None:
                missed = max(
                    missed,
                    float(np.abs(before(at) - exact[at]).max() / np.abs(exact[at]).max()),
                )
        if before is not None and missed <= STEP_TOLERANCE:
            spline = CubicSpline(places, np.array([exact[float(s)] for s in places]))
            return StepTable(step, size, spline)
        count = 2 * count - 1
    raise AccuracyError(
        f"{MOST_KNOTS} places along the path leave an error of {missed:.2g} of a step between them; shorten the path, or sample it faster"
    )


def _step_pose(pose: SampledPlant, scales: FloatArray, size: float) -> FloatArray:
    """Return the exact step of the system frozen at one position, as a matrix ``(2m, 2m + 2k)``.

    It gives the state ``(scale q, q')`` after the step from the state before it and the inputs at
    its beginning and end, between which these are linear: the acceleration along the path, and
    loads.

    Args:
        pose: Modal matrices of ``m`` modes at that position.
        scales: ``(m,)`` [rad/s] that make displacements as large as velocities.
        size: Length of the step [s].
    """
    zero = np.zeros_like(pose.stiffness)
    a = np.block([[zero, np.diag(scales)], [-pose.stiffness / scales, -pose.damping]])
    return join_ends(*exact_step(a, np.vstack([np.zeros_like(pose.loads), pose.loads]), size))


def join_ends(transition: FloatArray, level: FloatArray, rise: FloatArray) -> FloatArray:
    """Return an exact step in terms of the state before it and what acts at its begin and its end."""
    return np.hstack([transition, level - rise, rise])


def solve_varying_path(
    system: VaryingSystem,
    model: PathModel,
    move: SetPoint,
    samples: FloatArray,
    table: StepTable | None = None,
) -> PathDeviation:
    """Compute the deviation over a move along which the system changes.

    Args:
        move: Along the same path.
        samples: ``(n,)`` evenly spaced, from zero [s].
        table: Steps of the size of those of ``cut_times``, where they are already known.
    """
    steps = step_move(model.loads, move, samples)
    table = table or make_step_table(system, float(cut_times(samples, model.loads)[0][1]))
    given = steps.ends.reshape(len(steps.ends), -1)
    states = table.integrate(move, steps.times, given)[steps.wanted]
    positions, now = sample_move(move, samples).positions, steps.now
    displacements = states[:, : len(system.scales)] / system.scales
    quasi_static = now[:, :1] * system.splines["quasi_static"](positions)
    moved, low_frequency = (
        observe_along(system.splines[name], positions, displacements)
        for name in ("rows", "low_frequency")
    )
    total = moved + observe_along(system.splines["direct"], positions, now)
    return PathDeviation(
        samples, total, quasi_static, low_frequency, total - quasi_static - low_frequency
    )


def observe_along(
    rows: CubicSpline, positions: FloatArray, displacements: FloatArray
) -> FloatArray:
    """Return the motion at the outputs ``(n, p)``, one after the other to save memory."""
    outputs = range(rows.c.shape[2])
    single = (
        CubicSpline.construct_fast(rows.c[:, :, output], rows.x, extrapolate=True)
        for output in outputs
    )
    return np.column_stack([np.einsum("nm,nm->n", row(positions), displacements) for row in single])
