"""Deviation of a machine under control from a path, in parts: following error, quasi-static share,
rigid-body response, residual vibration; in one pose, or with matrices that change along the path.

With matrices that change, coordinates are deviations from the rigid machine at its set point,
motors and screws included: small enough to linearise about every pose of the path. A controller
reads ``x_set - x_measured`` from the deviation, and the set speed of a motor less that of the rigid
motion.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import MOTOR_SPEED, SET_ACCELERATION, SET_SPEED
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
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.driven_motion import DrivenMotion, integrate_track, solve_motion
from headstock.solvers.motion.exact import (
    StepTable,
    join_ends,
    observe_along,
    respond_exactly,
    tabulate_steps,
)
from headstock.solvers.motion.friction_loop import (
    FrictionLoop,
    LoopTrack,
    friction_channels,
    make_friction_loop,
    spread_inputs,
)
from headstock.solvers.motion.plant import PlantChannels, SampledPlant, VaryingSystem
from headstock.solvers.motion.set_points import (
    PathLoads,
    SetPoint,
    cut_times,
    list_breaks,
    load_channels,
    longest_step,
    path_inputs,
    sample_move,
    step_move,
)
from headstock.solvers.second_order import Channel, Positions
from headstock.solvers.state_spaces.state_space import StateSpace, modal_state_space
from headstock.solvers.state_spaces.time_response import exact_step
from headstock.solvers.watched_outputs import Watch, WatchedOutputs, WatchedValues

LEAST = 1e-9  # size of a pole [rad/s]: below it a pole counts as zero


@dataclass(frozen=True, eq=False)
class ControlledPath:
    """Describe a closed loop along a straight path in one pose.

    Attributes:
        shares: Travel of each driven axis per travel along the path [-].
        travel: ``(n_outputs,)`` rigid motion at each output per travel along the path.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts [Hz].
        loads: Loads on the machine; None for none.
        watched: Other outputs of the loop, whose total alone is wanted.
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
        """Return the watched outputs as rows of states and inputs."""
        return self.loop.space.watch(self.watched)

    @functools.cached_property
    def rows(self) -> Positions:
        """Return the indices of the outputs wanted."""
        return self.loop.space.rows.of(self.outputs)

    @property
    def given(self) -> dict[Channel, FloatArray]:
        """Input rows: of position, speed and acceleration along the path, then of loads."""
        units = dict(zip(SET_POINTS, np.eye(len(SET_POINTS)), strict=True))
        sets = {
            (axis, kind): self.shares.get(axis, 0.0) * units[kind]
            for axis, kind in set_channels(self.loop.trains)
        }
        return _add_loads(sets, load_channels(self.loads))


def _add_loads(
    sets: Mapping[Channel, FloatArray], loads: Sequence[Channel]
) -> dict[Channel, FloatArray]:
    """Return rows ``(3 + k,)`` of inputs: of position, speed and acceleration along a path, then of
    ``k`` loads.

    Args:
        sets: Rows ``(3,)`` of inputs that loads do not act on.
    """
    units = np.eye(len(SET_POINTS) + len(loads))
    padded = {channel: np.pad(row, (0, len(loads))) for channel, row in sets.items()}
    return padded | dict(zip(loads, units[len(SET_POINTS) :], strict=True))


def solve_controlled_path(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Compute the deviation over a move by exact discretisation; position and speed are states,
    driven by the acceleration alone.

    Quasi-static is the steady state at constant speed (lag) and constant acceleration, without the
    low-frequency poles; low_frequency is the part of those poles; dynamic is the residual vibration
    of the others, and the response to loads.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: The machine is unconstrained, so that it has no steady state under acceleration.
    """
    _require_mounted(path.loop)
    space, others = path.loop.space, path.others
    spread = spread_inputs(space.inputs, path.given)
    # summed in the order of the axes, as large terms cancel at constant speed
    b, direct, added = (
        (part[:, :, None] * spread).sum(axis=1)
        for part in (space.b, space.d[path.rows], others.inputs)
    )
    rows = space.c[path.rows]
    limit = 2.0 * np.pi * path.low_frequency_limit_hz
    low_frequency, slow, steady = _split_poles(space.a, b, rows, direct, limit)
    steps, now = step_move(path.loads, move, samples), sample_move(move, samples)
    moved = direct[:, :2] - np.outer(path.travel, [1.0, 0.0])
    a, b = _drive_by_acceleration(space.a, b)
    return respond_exactly(
        StateSpace(a, b, np.zeros((0, len(a))), np.zeros((0, b.shape[1])), (), (), ()),
        steps,
        wanted=WatchedOutputs(np.hstack([rows, moved]), direct[:, 2:]),
        below=np.hstack([low_frequency, -slow]),
        quasi_static=np.column_stack([now.speeds, now.accelerations]) @ steady[:, 1:].T,
        watched=WatchedOutputs(np.hstack([others.states, added[:, :2]]), added[:, 2:]),
        channels=path.watched.channels,
    )


def solve_path_with_friction(
    path: ControlledPath, move: SetPoint, samples: FloatArray
) -> tuple[PathDeviation, DrivenMotion]:
    """Compute the same with friction in the guides; its effect counts as dynamic.

    Args:
        path: Path whose loop is closed with its loads and ``friction_channels``.
        samples: ``(n,)`` from zero [s].

    Raises:
        ConvergenceError: Newton's method for friction does not converge.
    """
    linear, space = solve_controlled_path(path, move, samples), path.loop.space
    given = functools.partial(path_inputs, path.loads, move)
    motion = solve_motion(
        path.loop,
        given,
        samples,
        spread=path.given,
        breaks=list_breaks(move),
        longest=longest_step(path.loads),
    )
    now = given(samples)
    total = motion.outputs[:, path.rows] - np.outer(now[:, 0], path.travel)
    acting = now @ spread_inputs(space.inputs, path.given).T
    acting[:, space.columns.of(friction_channels(path.loop.trains))] = -motion.friction
    values = path.others.evaluate(motion.right, acting)
    return linear.with_total(total, WatchedValues(path.watched.channels, values)), motion


def _require_mounted(loop: ClosedLoop) -> None:
    """Refuse an unconstrained machine."""
    if has_free_motions(loop):
        raise ModelError(
            "the machine floats, so nothing holds it against accelerating axes; join it to ground by a mount"
        )


def _drive_by_acceleration(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a system ``(n + 2, n + 2)`` whose last states are position and speed along the path,
    and its inputs ``(n + 2, 1 + k)``, acceleration and loads.

    Args:
        a: ``(n, n)``.
        b: ``(n, 3 + k)`` of position, speed, acceleration and loads.
    """
    size, acting = len(a), b[:, 2:]
    whole = np.zeros((size + 2, size + 2))
    whole[:size] = np.hstack([a, b[:, :2]])
    whole[size, size + 1] = 1.0
    inputs = np.vstack([acting, np.zeros((2, acting.shape[1]))])
    inputs[-1, 0] = 1.0
    return whole, inputs


def _split_poles(
    a: FloatArray, b: FloatArray, rows: FloatArray, direct: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Split states into ``x = X_s s + X_v v + X_a a + xi``: their steady state on the path, and the
    vibration ``xi`` about it.

    Args:
        a: ``(n, n)``.
        b: ``(n, 3 + k)`` of position, speed and acceleration along the path, and loads.
        rows: ``(p, n)`` outputs.
        direct: ``(p, 3 + k)`` direct feedthrough to them.
        limit: Size below which poles are low-frequency ones [rad/s].

    Returns:
        Outputs of the low-frequency poles ``(p, n)``, their steady state per travel and speed
        ``(p, 2)``, and that per position, speed and acceleration without them ``(p, 3)``.

    Source: ``A X_s = -B_s``, ``A X_v = X_s - B_v``, ``A X_a = X_v - B_a``, ``xi' = A xi - X_a a'``.
    """
    factors = scipy.linalg.lu_factor(a)
    at_rest = scipy.linalg.lu_solve(factors, -b[:, 0])
    at_speed = scipy.linalg.lu_solve(factors, at_rest - b[:, 1])
    accelerated = scipy.linalg.lu_solve(factors, at_speed - b[:, 2])
    low_frequency = rows @ _project_slow(a, limit)
    steady = rows @ np.column_stack([at_rest, at_speed, accelerated]) + direct[:, :3]
    steady[:, 2] -= low_frequency @ accelerated
    return low_frequency, low_frequency @ np.column_stack([at_rest, at_speed]), steady


def _project_slow(a: FloatArray, limit: float) -> FloatArray:
    """Return the projector ``(n, n)`` on the invariant subspace of the poles below a size.

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
    return basis[:, first] @ np.hstack([np.eye(count), -parting]) @ basis.T


@dataclass(frozen=True)
class RigidTravel:
    """Store the travel of a drive per travel along the path while the machine is rigid [-].

    Attributes:
        encoder: Travel of the reading of its position controller.
        slide: Motion across its guide.
    """

    axis: float
    encoder: float
    motor: float
    slide: float


@dataclass(frozen=True, eq=False)
class VaryingLoop:
    """Describe a machine under control along a straight path on which it changes.

    Attributes:
        plant: The machine with free motors, along the path, between :func:`loop_channels`.
        path: Input of the acceleration along the path.
        low_frequency_limit_hz: Poles below this frequency are rigid-body motion on the drives and
            mounts; the same number along the whole path [Hz].
        loads: Loads on the machine; None for none.
        watched: Other outputs of the closed loop, as deviations.
    """

    plant: VaryingSystem
    path: Channel
    outputs: tuple[Channel, ...]
    trains: tuple[DriveTrain, ...]
    travels: tuple[RigidTravel, ...]
    low_frequency_limit_hz: float
    loads: PathLoads | None = None
    watched: tuple[Channel, ...] = ()

    def rows(self, space: StateSpace) -> Positions:
        """Return the indices of the outputs wanted, then of those watched."""
        return space.rows.of((*self.outputs, *self.watched))

    @property
    def given(self) -> dict[Channel, FloatArray]:
        """Rows of the closed loop's inputs: of position, speed and acceleration along the path,
        then of loads; controllers make deviations of them.
        """
        rows = {self.path: np.array([0.0, 0.0, 1.0])}
        for train in self.trains:
            kinds = ((train.name, kind) for kind in SET_POINTS)
            rows |= dict(zip(kinds, np.eye(len(SET_POINTS)), strict=True))
        return _add_loads(rows, load_channels(self.loads))


@dataclass(frozen=True, eq=False)
class _LoopTable:
    """Tabulate steps and outputs of a loop along a path at one step size.

    Attributes:
        steps: From the states, position and speed, then the acceleration and the loads at the
            beginning and at the end of a step.
        rows: Position to ``(p, n)`` outputs of the states.
        direct: Position to ``(p, 3 + k)`` outputs of position, speed, acceleration and loads.
        low_frequency: Position to ``(p, n)`` outputs of the low-frequency poles.
        slow: Position to ``(p, 2)`` the steady state of these poles per travel and speed.
        quasi_static: Position to ``(p, 3)`` the steady state per position, speed and acceleration,
            without the low-frequency poles.
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
    """Return the channels of a plant whose loops are closed along a path.

    Args:
        path: Input of the acceleration along the path.
        up_to_hz: Modes kept [Hz].
    """
    trains = tuple(trains)
    return PlantChannels(
        inputs=(*force_channels(trains), *loads, path, *friction_channels(trains)),
        outputs=(*outputs, *plant_outputs(trains)),
        up_to_hz=up_to_hz,
    )


def _close_loops_along(loop: VaryingLoop, position: float) -> ClosedLoop:
    """Return the closed loop of deviations at a position [m]: each drive has its own set points."""
    sample = loop.plant.at(position)
    plant = _plant_at(sample, loop.plant.scales)
    inputs = (*load_channels(loop.loads), loop.path, *friction_channels(loop.trains))
    trains = [_deviate(*pair) for pair in zip(loop.trains, loop.travels, strict=True)]
    return close_plant(plant, trains, inputs, loop.outputs)


def _deviate(train: DriveTrain, travel: RigidTravel) -> DriveTrain:
    """Return a drive whose controller gets the motion along the path, by the drive's name, and what is
    measured less the rigid motion.
    """
    control, errors = train.control, train.control.errors.copy()
    errors[:, 0] *= travel.axis - travel.encoder
    errors[:, SET_SPEED] *= travel.axis
    errors[:, SET_SPEED] += travel.motor * errors[:, MOTOR_SPEED]
    errors[:, SET_ACCELERATION] *= travel.axis
    forward = control.acceleration_feed_forward * travel.axis
    return dataclasses.replace(
        train,
        axis=train.name,
        control=dataclasses.replace(control, errors=errors, acceleration_feed_forward=forward),
    )


def make_loop_table(loop: VaryingLoop, size: float) -> _LoopTable:
    """Tabulate exact steps of one size [s] of the closed loop along the path, and its outputs.

    Raises:
        AccuracyError: The largest number of positions does not suffice.
        ModelError: The machine is unconstrained, so that it has no steady state under acceleration.
    """
    _require_mounted(_close_loops_along(loop, 0.5 * float(loop.plant.positions[-1])))
    steps = tabulate_steps(
        functools.partial(_exact_step, loop), float(loop.plant.positions[-1]), size
    )
    inputs = [_drive_inputs(loop, float(position)) for position in steps.spline.x]
    parting = _part_poles([space.a for space, _, _ in inputs], loop.low_frequency_limit_hz)
    views = []
    for (space, b, direct), limit in zip(inputs, parting, strict=True):
        rows = space.c[loop.rows(space)]
        views.append((rows, direct, *_split_poles(space.a, b, rows, direct, float(limit))))
    return _LoopTable(
        steps,
        *(
            CubicSpline(steps.spline.x, np.array([view[part] for view in views]))
            for part in range(len(views[0]))
        ),
    )


def solve_varying_control(
    loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: _LoopTable | None = None
) -> PathDeviation:
    """Compute the deviation over a move, in the parts of ``solve_controlled_path``: by exact steps
    in the pose at the middle of each.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].
        table: Steps of the size of ``cut_times``, where they are already known.
    """
    steps = step_move(loop.loads, move, samples)
    table = table or make_loop_table(loop, float(cut_times(samples, loop.loads)[0][1]))
    motion = path_inputs(loop.loads, move, steps.times)[:-1, :2]
    given = np.hstack([motion, steps.ends.reshape(len(motion), -1)])
    states = table.steps.integrate(move, steps.times, given)[steps.wanted]
    now = path_inputs(loop.loads, move, samples)
    positions, count = now[:, 0], len(loop.outputs)
    total = observe_along(table.rows, positions, states)
    total += observe_along(table.direct, positions, now)
    low_frequency = observe_along(table.low_frequency, positions, states)
    low_frequency -= observe_along(table.slow, positions, now[:, :2])
    quasi_static = observe_along(table.quasi_static, positions, now[:, :3])
    others = WatchedValues(loop.watched, total[:, count:])
    total, quasi_static, low_frequency = (
        part[:, :count] for part in (total, quasi_static, low_frequency)
    )
    dynamic = total - quasi_static - low_frequency
    return PathDeviation(samples, total, quasi_static, low_frequency, dynamic, others)


def solve_varying_friction(
    loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: _LoopTable | None = None
) -> tuple[PathDeviation, DrivenMotion]:
    """Compute the same with friction in the guides; its effect counts as dynamic.

    Raises:
        ConvergenceError: Newton's method for friction does not converge.
    """
    table = table or make_loop_table(loop, float(cut_times(samples, loop.loads)[0][1]))
    track = LoopTrack(
        table.steps.spline.x,
        functools.partial(_friction_at, loop),
        lambda times: sample_move(move, times).positions,
        loop.rows(_close_loops_along(loop, 0.0).space),
    )
    motion = integrate_track(
        track,
        functools.partial(path_inputs, loop.loads, move),
        samples,
        breaks=list_breaks(move),
        longest=longest_step(loop.loads),
    )
    total, watched = np.split(motion.outputs, [len(loop.outputs)], axis=1)
    linear = solve_varying_control(loop, move, samples, table)
    return linear.with_total(total, WatchedValues(loop.watched, watched)), motion


def _friction_at(loop: VaryingLoop, position: float) -> FrictionLoop:
    """Return the loop with its friction at a position, with position, speed and acceleration along
    the path, and the loads, as inputs.
    """
    slides = [
        travel.slide
        for train, travel in zip(loop.trains, loop.travels, strict=True)
        if train.friction is not None
    ]
    given = loop.given
    guides = np.zeros((len(slides), len(given[loop.path])))
    guides[:, SET_POINTS.index("velocity")] = slides
    return make_friction_loop(_close_loops_along(loop, position), given, guides)


def _plant_at(sample: SampledPlant, scales: FloatArray) -> StateSpace:
    """Return the state space of modes coupled by stiffness, scaled as at mid-path."""
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
        sample.channels.inputs,
        sample.channels.outputs,
    )
    first, second = np.arange(0, len(space.a), 2), np.arange(1, len(space.a), 2)
    a = space.a.copy()
    a[np.ix_(second, first)] = -sample.stiffness / scales
    return dataclasses.replace(space, a=a, pairs=None, modal=False)


def _drive_inputs(loop: VaryingLoop, position: float) -> tuple[StateSpace, FloatArray, FloatArray]:
    """Return the closed loop at a position, and its columns ``(n, 3 + k)`` and direct feedthrough
    ``(p, 3 + k)`` of position, speed, acceleration along the path, and loads.
    """
    space = _close_loops_along(loop, position).space
    spread = spread_inputs(space.inputs, loop.given)
    return space, space.b @ spread, space.d[loop.rows(space)] @ spread


def _exact_step(loop: VaryingLoop, position: float, size: float) -> FloatArray:
    """Return the exact step of the loop frozen at a position: ``(n, n + 2 + 2 (1 + k))``, of
    states, position and speed, then of the inputs, linear between the ends of the step.
    """
    space, b, _ = _drive_inputs(loop, position)
    a, acting = _drive_by_acceleration(space.a, b)
    return join_ends(*exact_step(a, acting, size))[: len(space.a)]


def _part_poles(states: Sequence[FloatArray], limit_hz: float) -> FloatArray:
    """Return the size that separates low-frequency poles from the others in each pose ``(k,)``
    [rad/s]: with the same number everywhere, though a pole may cross the limit; of possible numbers
    the one with the widest gap.

    Args:
        states: ``(n, n)`` of the loop in each pose.
        limit_hz: Below it poles are low-frequency ones [Hz].
    """
    sizes = np.sort([np.abs(np.linalg.eigvals(a)) for a in states], axis=1)
    below = (sizes < 2.0 * np.pi * limit_hz).sum(axis=1)
    # at least one pole below, and one above everywhere
    ends = np.column_stack([np.full(len(sizes), LEAST), sizes, np.full(len(sizes), np.inf)])
    ends = np.maximum(ends, LEAST)
    count = max(
        range(below.min(), below.max() + 1),
        key=lambda number: float((ends[:, number + 1] / ends[:, number]).min()),
    )
    return np.sqrt(ends[:, count] * ends[:, count + 1])
