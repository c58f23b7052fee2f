"""Deviation from a path of a machine under control, in parts: following error, quasi-static share,
rigid-body response, residual vibration.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import (
    SET_POINTS,
    ClosedLoop,
    close_plant,
    force_channels,
    plant_outputs,
    set_channels,
)
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.stability import has_free_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_coordinates import ModalCoordinates
from headstock.solvers.linear.state_space import StateSpace, modal_state_space
from headstock.solvers.linear.time_response import solve_stepped_response
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.driven_motion import DrivenMotion, integrate_motion, solve_motion
from headstock.solvers.motion.exact import StepTable, integrate_steps, observe_along, tabulate_steps
from headstock.solvers.motion.friction_loop import (
    FrictionLoop,
    LoopTrack,
    friction_channels,
    make_friction_loop,
    spread_inputs,
)
from headstock.solvers.motion.loads import (
    PathLoads,
    cut_times,
    load_channels,
    loads_at,
    longest_step,
    step_loads,
)
from headstock.solvers.motion.plant import PlantChannels, SampledPlant, VaryingSystem
from headstock.solvers.motion.set_points import (
    SetPoint,
    list_breaks,
    sample_move,
    step_accelerations,
    step_times,
)
from headstock.solvers.second_order import Channel, Positions
from headstock.solvers.watched_outputs import Watch, WatchedOutputs, WatchedValues

LEAST = 1e-9  # size of a pole [rad/s]: below it one does not move


@dataclass(frozen=True, eq=False)
class ControlledPath:
    """A closed loop along a straight path.

    Attributes:
        shares: Travel of each driven axis per travel along the path [-].
        travel: ``(n_outputs,)`` how the rigid machine moves each output wanted per travel along the
            path.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts [Hz].
        loads: On the machine; None for none.
        watched: Other outputs of the loop that are asked for as a whole.
    """

    loop: ClosedLoop
    outputs: tuple[Channel, ...]
    shares: Mapping[str, float]
    travel: FloatArray
    low_frequency_limit_hz: float
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @functools.cached_property
    def others(self) -> WatchedOutputs:
        """What is watched, of states and inputs."""
        return self.loop.space.watch(self.watched)

    @functools.cached_property
    def rows(self) -> Positions:
        """Where the outputs wanted stand."""
        return self.loop.space.rows.of(self.outputs)

    @property
    def given(self) -> dict[Channel, FloatArray]:
        """Inputs of the loop, of position, speed and acceleration along the path, then of loads."""
        units = dict(zip(SET_POINTS, np.eye(len(SET_POINTS)), strict=True))
        sets = {
            (axis, kind): self.shares.get(axis, 0.0) * units[kind]
            for axis, kind in set_channels(self.loop.trains)
        }
        return add_loads(sets, load_channels(self.loads))


def add_loads(
    sets: Mapping[Channel, FloatArray], loads: Sequence[Channel]
) -> dict[Channel, FloatArray]:
    """Rows ``(3 + k,)`` of inputs of position, speed and acceleration along a path, then of ``k`` loads.

    Args:
        sets: Rows ``(3,)`` of inputs that loads do not enter.
        loads: Where these act.
    """
    units = np.eye(len(SET_POINTS) + len(loads))
    padded = {channel: np.pad(row, (0, len(loads))) for channel, row in sets.items()}
    return padded | dict(zip(loads, units[len(SET_POINTS) :], strict=True))


@dataclass(frozen=True, eq=False)
class _Motion:
    """The states as ``x = X_s s + X_v v + X_a a + xi``: what a path would hold them at, and what
    rings about it.

    Attributes:
        place: X_s ``(n,)``: at rest, per travel.
        speed: X_v: at constant speed.
        pull: X_a: at constant acceleration.
        inputs: ``(n, 3 + k)`` columns of position, speed and acceleration along the path, and loads.
        direct: ``(n_outputs, 3 + k)`` what they do at once to the outputs, through drive forces and
            the flexibility of modes left out.
        beside: ``(w, 3 + k)`` the same to what is watched.
        low_frequency: ``(n, n)`` projector on the low-frequency poles.
    """

    place: FloatArray
    speed: FloatArray
    pull: FloatArray
    inputs: FloatArray
    direct: FloatArray
    beside: FloatArray
    low_frequency: FloatArray


def solve_controlled_path(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation over a move by exact discretisation; position and speed are states, driven by
    the acceleration alone.

    Quasi-static is what constant speed (lag) and constant acceleration hold, without the
    low-frequency poles; low_frequency is the part of those poles; dynamic is the residual vibration
    of the others, and what loads do.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: The machine floats, so that no acceleration can last.

    Source: ``A X_s = -B_s``, ``A X_v = X_s - B_v``, ``A X_a = X_v - B_a``, ``xi' = A xi - X_a a'``.
    """
    motion = _split(path)
    space, count = path.loop.space, len(path.travel)
    rows, size = space.c[path.rows], len(space.a)
    a = np.zeros((size + 2, size + 2))
    a[:size] = np.hstack([space.a, motion.inputs[:, :2]])
    a[size, size + 1] = 1.0
    # of position and speed, which are states, the acceleration is the rate
    acting = motion.inputs[:, 2:]
    b = np.vstack([acting, np.zeros((2, acting.shape[1]))])
    b[-1, 0] = 1.0
    low_frequency = rows @ motion.low_frequency
    direct = np.vstack(
        [motion.direct[:, 2:], np.zeros((count, acting.shape[1])), motion.beside[:, 2:]]
    )
    c = np.vstack(
        [
            np.hstack([rows, motion.direct[:, :2] - np.outer(path.travel, [1.0, 0.0])]),
            np.hstack(
                [
                    low_frequency,
                    -(low_frequency @ motion.place)[:, None],
                    -(low_frequency @ motion.speed)[:, None],
                ]
            ),
            np.hstack([path.others.states, motion.beside[:, :2]]),
        ]
    )
    whole = StateSpace(a, b, c, direct, (), (), ())
    fine, parts = cut_times(samples, path.loads)
    times, places = step_times(move, fine)
    given = np.concatenate(
        [step_accelerations(move, times)[:, :, None], step_loads(path.loads, move, times)], axis=2
    )
    found = solve_stepped_response(whole, times, given).outputs[places[::parts]]
    quasi_static = _follow(path, motion, move, samples)
    total, low_frequency = found[:, :count], found[:, count : 2 * count]
    return PathDeviation(
        samples,
        total,
        quasi_static,
        low_frequency,
        total - quasi_static - low_frequency,
        WatchedValues(path.watched.channels, found[:, 2 * count :]),
    )


def solve_path_with_friction(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> tuple[PathDeviation, DrivenMotion]:
    """The same with friction in the guides; what friction does counts as dynamic.

    Args:
        path: Its loop is closed with its loads and ``friction_channels``.
        samples: ``(n,)`` from zero [s].

    Raises:
        ConvergenceError: Friction does not settle.
    """
    linear, space = solve_controlled_path(path, move, samples), path.loop.space

    def given(times: FloatArray) -> FloatArray:
        now = sample_move(move, times)
        own = [now.positions, now.speeds, now.accelerations]
        return np.column_stack([*own, loads_at(path.loads, times, now.speeds)])

    found = solve_motion(
        path.loop,
        given,
        samples,
        spread=path.given,
        breaks=list_breaks(move),
        longest=longest_step(path.loads),
    )
    positions = sample_move(move, samples).positions
    total = found.outputs[:, path.rows] - np.outer(positions, path.travel)
    acting = given(samples) @ spread_inputs(space.inputs, path.given).T
    acting[:, space.columns.of(friction_channels(path.loop.trains))] = -found.friction
    return PathDeviation(
        samples,
        total,
        linear.quasi_static,
        linear.low_frequency,
        total - linear.quasi_static - linear.low_frequency,
        WatchedValues(path.watched.channels, path.others.evaluate(found.right, acting)),
    ), found


def _split(path: ControlledPath) -> _Motion:
    space = path.loop.space
    if has_free_motions(path.loop):
        raise ModelError(
            "the machine floats, so nothing holds it against accelerating axes; join it to ground by a mount"
        )
    spread = spread_inputs(space.inputs, path.given)
    # sums in the order of the axes: of what constant speed holds little is left
    given, direct, beside = (
        (part[:, :, None] * spread).sum(axis=1)
        for part in (space.b, space.d[path.rows], path.others.inputs)
    )
    factors = scipy.linalg.lu_factor(space.a)
    place = scipy.linalg.lu_solve(factors, -given[:, 0])
    speed = scipy.linalg.lu_solve(factors, place - given[:, 1])
    pull = scipy.linalg.lu_solve(factors, speed - given[:, 2])
    return _Motion(
        place,
        speed,
        pull,
        given,
        direct,
        beside,
        project_slow(space.a, 2.0 * np.pi * path.low_frequency_limit_hz),
    )


def _follow(
    path: ControlledPath, motion: _Motion, move: SetPoint, samples: FloatArray
) -> FloatArray:
    """What speed and acceleration hold ``(n, n_outputs)``."""
    rows, now = path.loop.space.c[path.rows], sample_move(move, samples)
    speed = rows @ motion.speed + motion.direct[:, 1]
    pull = rows @ (motion.pull - motion.low_frequency @ motion.pull) + motion.direct[:, 2]
    return np.asarray(np.outer(now.speeds, speed) + np.outer(now.accelerations, pull))


def project_slow(a: FloatArray, limit: float) -> FloatArray:
    """Projector ``(n, n)`` on the invariant subspace of the poles below a size.

    Source: Golub and Van Loan (2013), section 7.6.3: ordered Schur form, its blocks parted by a
    Sylvester equation.
    """
    triangular, basis, count = scipy.linalg.schur(
        a, output="real", sort=lambda re, im: bool(np.hypot(re, im) < limit)
    )
    first, rest = slice(0, count), slice(count, None)
    if count in (0, len(a)):
        return np.eye(len(a)) if count else np.zeros_like(a)
    parting = scipy.linalg.solve_sylvester(
        triangular[first, first], -triangular[rest, rest], -triangular[first, rest]
    )
    return np.asarray(basis[:, first] @ np.hstack([np.eye(count), -parting]) @ basis.T)


@dataclass(frozen=True)
class RigidTravel:
    """What a drive does per travel along the path while the machine stays rigid [-].

    Attributes:
        encoder: What its position controller reads.
        slide: Motion across its guide.
    """

    axis: float
    encoder: float
    motor: float
    slide: float


@dataclass(frozen=True, eq=False)
class VaryingLoop:
    """A machine under control along a straight path.

    Attributes:
        plant: With free motors, along the path.
        channels: Its channels: those of :func:`loop_channels`.
        path: The one of the acceleration along the path.
        outputs: Where the deviation is wanted.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts; as many along the whole path [Hz].
        loads: On the machine; None for none.
        watched: Other outputs of the closed loop that are wanted after these, as deviations.
    """

    plant: VaryingSystem[SampledPlant]
    channels: PlantChannels
    path: Channel
    outputs: tuple[Channel, ...]
    trains: tuple[DriveTrain, ...]
    travels: tuple[RigidTravel, ...]
    low_frequency_limit_hz: float
    loads: PathLoads | None = None
    watched: tuple[Channel, ...] = ()

    def rows(self, space: StateSpace) -> Positions:
        """Where the outputs wanted, then those watched, stand in the closed loop."""
        return space.rows.of((*self.outputs, *self.watched))

    @property
    def given(self) -> dict[Channel, FloatArray]:
        """Inputs of the closed loop, of position, speed and acceleration along the path, then of
        loads: a controller is given what deviates.
        """
        found = {self.path: np.array([0.0, 0.0, 1.0])}
        for train, travel in zip(self.trains, self.travels, strict=True):
            control = train.control
            deviating = (
                travel.axis - travel.encoder,
                control.velocity_feed_forward * travel.axis - travel.motor,
                control.acceleration_feed_forward * travel.axis,
            )
            kinds = ((train.name, kind) for kind in SET_POINTS)
            found |= dict(zip(kinds, np.diag(deviating), strict=True))
        return add_loads(found, load_channels(self.loads))


@dataclass(frozen=True, eq=False)
class LoopTable:
    """What a loop does along a path at steps of one size.

    Attributes:
        steps: From the states, position and speed, then the acceleration and the loads at the
            beginning and at the end of a step.
        rows: Position to ``(p, n)`` outputs of the states.
        direct: Position to ``(p, 3 + k)`` outputs of position, speed, acceleration and loads.
        low_frequency: Position to ``(p, n)`` outputs of the low-frequency poles.
        slow: Position to ``(p, 2)`` what they would be held at per travel and speed.
        quasi_static: Position to ``(p, 3)`` what position, speed and acceleration hold, without
            the low-frequency poles.
    """

    steps: StepTable
    rows: CubicSpline
    direct: CubicSpline
    low_frequency: CubicSpline
    slow: CubicSpline
    quasi_static: CubicSpline


def loop_channels(
    trains: Sequence[DriveTrain],
    *,
    path: Channel,
    loads: Sequence[Channel],
    outputs: Sequence[Channel],
    up_to_hz: float,
) -> PlantChannels:
    """Channels of a plant whose loops are closed along a path.

    Args:
        path: Input of the acceleration along the path.
        outputs: Where the deviation is wanted.
        up_to_hz: Modes kept [Hz].
    """
    trains = tuple(trains)
    return PlantChannels(
        inputs=(*force_channels(trains), *loads, path, *friction_channels(trains)),
        outputs=(*outputs, *plant_outputs(trains)),
        up_to_hz=up_to_hz,
    )


def close_along(loop: VaryingLoop, position: float) -> ClosedLoop:
    """The closed loop of deviations at a position [m]: its set points are those of each drive."""
    sample = loop.plant.at(position)
    plant = _plant_at(sample, loop.plant.scales, loop.channels)
    inputs = (*load_channels(loop.loads), loop.path, *friction_channels(loop.trains))
    return close_plant(plant, _deviation_trains(loop.trains), inputs, loop.outputs)


def _deviation_trains(trains: Sequence[DriveTrain]) -> tuple[DriveTrain, ...]:
    """Drives whose controllers see deviations: each has set points of its own, by its name, and
    takes them as they are.
    """
    return tuple(
        dataclasses.replace(
            train,
            axis=train.name,
            control=dataclasses.replace(
                train.control, velocity_feed_forward=1.0, acceleration_feed_forward=1.0
            ),
        )
        for train in trains
    )


def make_loop_table(loop: VaryingLoop, size: float) -> LoopTable:
    """Exact steps of one size [s] of the closed loop along the path, and its outputs.

    Raises:
        AccuracyError: The greatest number of places does not suffice.
        ModelError: The machine floats, so that no acceleration can last.
    """
    if has_free_motions(close_along(loop, 0.5 * float(loop.plant.positions[-1]))):
        raise ModelError(
            "the machine floats, so nothing holds it against accelerating axes; join it to ground by a mount"
        )
    steps = tabulate_steps(
        lambda place: _exact_step(loop, place, size), float(loop.plant.positions[-1]), size
    )
    inputs = [_drive_inputs(loop, float(place)) for place in steps.spline.x]
    parting = _part_poles([own.space.a for own in inputs], loop.low_frequency_limit_hz)
    views = [_observe_loop(loop, *each) for each in zip(inputs, parting, strict=True)]
    return LoopTable(
        steps,
        *(
            CubicSpline(steps.spline.x, np.array([view[part] for view in views]))
            for part in range(len(views[0]))
        ),
    )


def solve_varying_control(
    loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: LoopTable | None = None
) -> PathDeviation:
    """Deviation over a move, in the parts of ``solve_controlled_path``: exact steps in the pose at
    the middle of each.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].
        table: Of steps of the size of ``cut_times``, where it is known.
    """
    fine, parts = cut_times(samples, loop.loads)
    times, places = step_times(move, fine)
    table = table or make_loop_table(loop, float(fine[1] - fine[0]))
    at = sample_move(move, times)
    accelerations = step_accelerations(move, times)
    loads = loads_at(loop.loads, times, at.speeds)
    given = np.hstack(
        [
            at.positions[:-1, None],
            at.speeds[:-1, None],
            accelerations[:, :1],
            loads[:-1],
            accelerations[:, 1:],
            loads[1:],
        ]
    )
    size = table.rows.c.shape[3]
    states = integrate_steps(
        table.steps,
        lambda place, step: _exact_step(loop, place, step),
        move,
        times,
        given,
        size=size,
    )[places[::parts]]
    now = sample_move(move, samples)
    motion = np.column_stack([now.positions, now.speeds, now.accelerations])
    acting = np.hstack([motion, loads_at(loop.loads, samples, now.speeds)])
    total = observe_along(table.rows, now.positions, states) + observe_along(
        table.direct, now.positions, acting
    )
    low_frequency = observe_along(table.low_frequency, now.positions, states) - observe_along(
        table.slow, now.positions, motion[:, :2]
    )
    quasi_static = observe_along(table.quasi_static, now.positions, motion)
    count = len(loop.outputs)
    others = WatchedValues(loop.watched, total[:, count:])
    total, quasi_static, low_frequency = (
        part[:, :count] for part in (total, quasi_static, low_frequency)
    )
    dynamic = total - quasi_static - low_frequency
    return PathDeviation(samples, total, quasi_static, low_frequency, dynamic, others)


def solve_varying_friction(
    loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: LoopTable | None = None
) -> tuple[PathDeviation, DrivenMotion]:
    """The same with friction in the guides; what friction does counts as dynamic.

    Raises:
        ConvergenceError: Friction does not settle.
    """
    table = table or make_loop_table(loop, float(cut_times(samples, loop.loads)[0][1]))
    linear = solve_varying_control(loop, move, samples, table)

    def given(times: FloatArray) -> FloatArray:
        now = sample_move(move, times)
        own = [now.positions, now.speeds, now.accelerations]
        return np.column_stack([*own, loads_at(loop.loads, times, now.speeds)])

    track = LoopTrack(
        table.steps.spline.x,
        functools.partial(_friction_at, loop),
        lambda times: sample_move(move, times).positions,
        loop.rows(close_along(loop, 0.0).space),
    )
    found = integrate_motion(
        track, given, samples, breaks=list_breaks(move), longest=longest_step(loop.loads)
    )
    shown, watched = np.split(found.outputs, [len(loop.outputs)], axis=1)
    return dataclasses.replace(
        linear,
        total=shown,
        dynamic=shown - linear.quasi_static - linear.low_frequency,
        watched=WatchedValues(loop.watched, watched),
    ), found


def _friction_at(loop: VaryingLoop, position: float) -> FrictionLoop:
    """The loop with its friction at a position: position, speed and acceleration along the path, and
    the loads, are given.
    """
    slides = [
        travel.slide
        for train, travel in zip(loop.trains, loop.travels, strict=True)
        if train.friction is not None
    ]
    given = loop.given
    guides = np.zeros((len(slides), len(given[loop.path])))
    guides[:, SET_POINTS.index("velocity")] = slides
    return make_friction_loop(close_along(loop, position), given, guides)


def _plant_at(sample: SampledPlant, scales: FloatArray, channels: PlantChannels) -> StateSpace:
    """State space of modes that stiffness couples, scaled as in the middle of the path."""
    space = modal_state_space(
        ModalCoordinates(
            eigenvalues=scales**2,
            rigid_count=0,
            inputs=sample.loads,
            outputs=sample.rows,
            viscous=sample.damping,
            hysteretic=None,
            elastic=sample.direct,
            residual=sample.direct,
            complete=False,
            shapes=np.zeros((0, len(scales))),
        ),
        channels.inputs,
        channels.outputs,
    )
    first, second = np.arange(0, len(space.a), 2), np.arange(1, len(space.a), 2)
    a = space.a.copy()
    a[np.ix_(second, first)] = -sample.stiffness / scales
    return dataclasses.replace(space, a=a, pairs=None)


@dataclass(frozen=True, eq=False)
class _Inputs:
    """A closed loop between the path and its outputs.

    Attributes:
        b: ``(n, 3 + k)`` columns of position, speed, acceleration along the path, and loads.
        d: ``(p, 3 + k)`` likewise, of the outputs wanted.
    """

    space: StateSpace
    b: FloatArray
    d: FloatArray


def _drive_inputs(loop: VaryingLoop, position: float) -> _Inputs:
    space = close_along(loop, position).space
    spread = spread_inputs(space.inputs, loop.given)
    return _Inputs(space, space.b @ spread, space.d[loop.rows(space)] @ spread)


def _exact_step(loop: VaryingLoop, position: float, size: float) -> FloatArray:
    """Exact step of the loop frozen at a position: ``(n, n + 2 + 2 (1 + k))``.

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    inputs = _drive_inputs(loop, position)
    n, acting = len(inputs.space.a), inputs.b.shape[1] - 2
    # states, position and speed; then what acts, linear between the ends of the step
    ends = n + 2
    big = np.zeros((ends + 2 * acting, ends + 2 * acting))
    big[:n, :n], big[:n, n:ends], big[:n, ends : ends + acting] = (
        inputs.space.a,
        inputs.b[:, :2],
        inputs.b[:, 2:],
    )
    big[n, n + 1] = big[n + 1, ends] = 1.0
    big *= size
    big[ends : ends + acting, ends + acting :] = np.eye(acting)
    found = scipy.linalg.expm(big)[:n]
    level, rise = found[:, ends : ends + acting], found[:, ends + acting :]
    return np.hstack([found[:, :ends], level - rise, rise])


def _part_poles(states: Sequence[FloatArray], limit_hz: float) -> FloatArray:
    """Size that parts low-frequency poles from the others in each pose ``(k,)`` [rad/s]: as many
    everywhere, though a pole may pass the limit; of possible numbers that with the widest gap.

    Args:
        states: ``(n, n)`` of the loop in each pose.
        limit_hz: Below it poles are low-frequency ones [Hz].
    """
    sizes = np.sort([np.abs(np.linalg.eigvals(a)) for a in states], axis=1)
    below = (sizes < 2.0 * np.pi * limit_hz).sum(axis=1)
    # with a pole at least below and one above all
    ends = np.column_stack([np.full(len(sizes), LEAST), sizes, np.full(len(sizes), np.inf)])
    ends = np.maximum(ends, LEAST)
    count = max(
        range(below.min(), below.max() + 1),
        key=lambda number: float((ends[:, number + 1] / ends[:, number]).min()),
    )
    return np.asarray(np.sqrt(ends[:, count] * ends[:, count + 1]))


def _observe_loop(loop: VaryingLoop, inputs: _Inputs, parting: float) -> tuple[FloatArray, ...]:
    """Rows, direct, low-frequency, slow and quasi-static matrices of a table in a pose.

    Args:
        parting: Size below which poles are low-frequency ones [rad/s].

    Source: ``A X_s = -B_s``, ``A X_v = X_s - B_v``, ``A X_a = X_v - B_a``.
    """
    rows = inputs.space.c[loop.rows(inputs.space)]
    factors = scipy.linalg.lu_factor(inputs.space.a)
    place = scipy.linalg.lu_solve(factors, -inputs.b[:, 0])
    speed = scipy.linalg.lu_solve(factors, place - inputs.b[:, 1])
    pull = scipy.linalg.lu_solve(factors, speed - inputs.b[:, 2])
    low_frequency = rows @ project_slow(inputs.space.a, parting)
    held = rows @ np.column_stack([place, speed, pull]) + inputs.d[:, :3]
    held[:, 2] -= low_frequency @ pull
    return rows, inputs.d, low_frequency, low_frequency @ np.column_stack([place, speed]), held
