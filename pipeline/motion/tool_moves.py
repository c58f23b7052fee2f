"""Straight moves of the tool of a mechanism, lumped or of components, and moves of axes that turn: the deviation with drives,
errors, the cut and the forces of its speeds, by the steps in time of contours.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.mechanisms.exechon import LENGTHS, tool_pose
from headstock.pipeline.answers.motion_forces import PathForces, ProbeMotion
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.motion.guide_errors import (
    STEPS_PER_WAVE,
    TrajectoryErrors,
    find_trajectory_errors,
)
from headstock.pipeline.motion.motion_forces import (
    largest_joint_forces,
    record_drives,
    watch_joints,
)
from headstock.pipeline.motion.motors import (
    DrivenTrajectory,
    MovingMachine,
    TrajectoryMotors,
    interpolate_motors,
    plan_motors,
)
from headstock.pipeline.motion.observers import drive_bodies, join_probes, probe_channels
from headstock.pipeline.motion.path import answer_path, run_path_stage
from headstock.pipeline.motion.path_model import (
    SolvedMoves,
    choose_model,
    compare_moves,
    cutting_loads,
    orient_cut,
    sample_path,
)
from headstock.pipeline.motion.probe_motions import (
    place_probes,
    read_probes,
    smoothing_channels,
)
from headstock.pipeline.motion.rotary_axes import (
    find_feed,
    rotary_path_motors,
    rotary_trajectory,
    rotation_speeds,
)
from headstock.pipeline.motion.trajectory import (
    RigidTrajectory,
    has_coriolis,
    machine_along,
    mechanism_trajectory,
    model_builder,
    move_bodies,
    report_gyroscopic_forces,
    report_gyroscopic_shift,
)
from headstock.pipeline.planning.budgets import PATH_STEPS_PER_TURN
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.control import drive_along
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState
from headstock.reduction.coupling.joint_forces import JointForces, joint_outputs
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.scene.analyses.path import PathRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.milling.straight_path import StraightPath, UnitTravel
from headstock.solvers.milling.tool_path import PathPoints
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    chunk_slices,
    even_nodes,
    integrate_linear,
    interpolate_nodes,
)
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.plant import PlantChannels, SampledMotion
from headstock.solvers.motion.plant_motion import SampledHistory
from headstock.solvers.motion.sampling import sample_motion
from headstock.solvers.motion.set_points import SetPoint, sample_move
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Extreme, Watch

STEPS_PER_PERIOD = 24  # of the highest mode that is kept
NODE_TURN = 0.05  # of bodies on turning axes between two of them [rad]
NODES = 65  # positions of the line between which the rigid motion is interpolated
NODE_SPACING = 5e-3  # of its matrices in time: on ramps the place is no line in time [s]
# what bodies turn between them: a stiff direction that is taken for straight there is mixed with a
# compliant one by an eighth of the square of it
NODE_ANGLE = 4e-3  # [rad]
TINY = 1e-30
BEFORE = 2  # steps before the move begins: the first one is at rest
MATTERS = 1e-3  # of a natural frequency: what moves it less is no warning
TWICE = 2.0  # as high as modes are kept, to judge what is left out


@dataclass(frozen=True, eq=False)
class ToolLine:
    """A line that the tool of a mechanism follows, or a path on which axes turn.

    Attributes:
        start: ``(3,)`` where the tool of a mechanism begins, machine frame [m].
        along: ``(3,)`` direction of its travel.
        nodes: ``(k,)`` positions between which the rigid motion is interpolated [m, rad].
        bodies: How bodies move at a constant speed and acceleration along it, over positions.
        motors: Motors under control at a speed and an acceleration; None for none.
        errors: Along it; None for none.
        turning: How fast bodies turn at most, per speed along it [1/m, -]; zero where they turn little.
        feed: Travel of the tool against the work per travel along it, and the direction of its axis, at
            positions; None where neither turns.
    """

    state: RunState
    request: PathRequest
    start: FloatArray
    along: FloatArray
    nodes: FloatArray
    bodies: Callable[[float, float], RigidTrajectory]
    motors: Callable[[float, float, RigidTrajectory, tuple[Channel, ...]], TrajectoryMotors | None]
    drives: tuple[Drive, ...]
    errors: TrajectoryErrors | None
    turning: float = 0.0
    feed: Callable[[FloatArray], tuple[FloatArray, FloatArray]] | None = None

    @property
    def tool(self) -> tuple[Channel, ...]:
        """Where the cut pushes; without one, where the first output is."""
        cut = self.request.cut
        at = self.request.outputs[0][0] if cut is None else cut.at
        return tuple((at, dof) for dof in DIRECTIONS)

    @functools.cached_property
    def unit_trajectories(self) -> tuple[RigidTrajectory, RigidTrajectory]:
        """Ways of the bodies at unit speed, and at unit acceleration, over positions."""
        return (self._unit_trajectory(1.0, 0.0), self._unit_trajectory(0.0, 1.0))

    def _unit_trajectory(self, speed: float, acceleration: float) -> RigidTrajectory:
        trajectory = self.bodies(speed, acceleration)
        law = scipy.interpolate.make_interp_spline(self.nodes, trajectory.amounts(self.nodes), k=3)
        return dataclasses.replace(trajectory, amounts=lambda positions: np.asarray(law(positions)))

    @functools.cached_property
    def unit_motors(self) -> tuple[TrajectoryMotors, TrajectoryMotors] | None:
        """Motors at unit speed, and at unit acceleration, over positions; None without control."""
        wanted = (*self.tool, *self.request.outputs)
        speeding, pulling = (
            self.motors(speed, acceleration, trajectory, wanted)
            for (speed, acceleration), trajectory in zip(
                ((1.0, 0.0), (0.0, 1.0)), self.unit_trajectories, strict=True
            )
        )
        return None if speeding is None or pulling is None else (speeding, pulling)

    def trajectory(self, path: StraightPath) -> RigidTrajectory:
        """How the bodies follow a move: by its acceleration, and by the square of its speed; with the
        errors along the trajectory.
        """
        speeding, pulling = self.unit_trajectories

        def amounts(times: FloatArray) -> FloatArray:
            now = path.travel(times)
            fast = speeding.amounts(now.positions) * now.speeds[:, None] ** 2
            return np.asarray(fast + pulling.amounts(now.positions) * now.accelerations[:, None])

        trajectory = dataclasses.replace(speeding, amounts=amounts)
        return trajectory if self.errors is None else self.errors.join(trajectory, path.travel)

    @functools.cached_property
    def joints(self) -> tuple[JointForces, ...]:
        """Forces of the joints in the middle of the line."""
        path = self.request.path
        return model_builder(self.state)(path.pose_at(0.5 * path.length)).joints

    @property
    def watched(self) -> tuple[Channel, ...]:
        """Outputs of joints and probes in the middle of the line."""
        probes = (*probe_channels(self.probes), *smoothing_channels(self.probes))
        return (*joint_outputs(self.joints), *probes)

    @functools.cached_property
    def probes(self) -> dict[str, PlacedProbe]:
        """Probes in the middle of the line."""
        path, parts = self.request.path, self.state.parts
        middle = model_builder(self.state)(path.pose_at(0.5 * path.length))
        return place_probes(parts, middle.coupled, tuple(parts.scene.machine.probes))

    def sample(self, up_to_hz: float, *, follows: bool) -> SampledMotion:
        """The machine at positions of the line, or in its middle everywhere; there with its joints
        and probes among the outputs.
        """
        length = self.request.path.length
        first = StraightPath(
            self.start, self.along, self.request.moves[0], 1.0 / self.request.sampling_hz
        )
        trajectory = self.trajectory(first)
        driven = DrivenTrajectory(trajectory, self.unit_motors and self.unit_motors[0], self.tool)
        watched = () if follows else self.watched
        channels = PlantChannels(
            inputs=driven.inputs,
            outputs=(*self.tool, *self.request.outputs, *watched, *driven.outputs),
            up_to_hz=up_to_hz,
        )
        if follows:
            place = machine_along(self.state, trajectory, up_to_hz, driven.joins)
            return sample_motion(place, [0.0, length], channels)
        joins = (*driven.joins, join_probes(self.state.parts, trajectory))
        held = machine_along(self.state, trajectory, up_to_hz, joins)(0.5 * length)
        return sample_motion(lambda where: held, [0.0, length], channels)


def _solve_line_moves(line: ToolLine) -> SolvedMoves:
    """Deviation over every move along a line.

    Raises:
        PoseError: The tool of a mechanism cannot follow it.
        ModelError: The machine is free to move, or errors contradict each other.
        UnstableControlError: A control loop is unstable.
    """
    request = line.request
    if line.drives:
        _require_stable(line)
    up_to_hz = choose_model(request).up_to_hz or 0.0
    frozen = line.sample(up_to_hz, follows=False)
    first = [_solve_move(line, frozen, move, middle=True) for move in request.moves]
    kept = tuple(found for found, _ in first)
    disturbed = line.errors is not None or any(drive.ripple for drive in line.drives)
    if not request.follows_pose:
        return SolvedMoves(kept, kept, tuple(taken for _, taken in first), disturbed=disturbed)
    sampled = line.sample(up_to_hz, follows=True)
    second = [_solve_move(line, sampled, move) for move in request.moves]
    found = tuple(each for each, _ in second)
    forces = tuple(
        PathForces(own.drives, middle.joints, middle.probes)
        for (_, own), (_, middle) in zip(second, first, strict=True)
    )
    return SolvedMoves(
        found,
        kept,
        forces,
        _evaluate_poses(line, sampled, found, kept, up_to_hz),
        disturbed=disturbed,
    )


def run_any_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Deviation at every output along the path: of linear axes, of axes that turn, or of the tool of a
    mechanism.
    """
    request = state.scene.analyses.get(PathRequest)
    if request is None or not state.is_root:
        return run_path_stage(state, stage)
    if state.scene.mechanism is None:
        turns = bool(request.path.turning)
        return _run_turning_path(state, request) if turns else run_path_stage(state, stage)
    _check_speeds(state, state.scene.mechanism, request)
    model = model_builder(state)(request.path.pose_at(0.5 * request.path.length))
    line, feed = _lay_line(state, request), request.moves[-1].feed
    middle = PathPoints(
        (line.start + 0.5 * request.path.length * line.along)[None],
        feed * line.along[None],
        np.zeros((1, 3)),
    )
    direction = tool_pose(state.scene.mechanism, request.path.start.positions)[1]
    for message in report_gyroscopic_forces(
        state, lambda: model, np.zeros(1), middle, direction, least=MATTERS
    ):
        state.warn(f"path analysis: {message}")
    return _answer(state, request, model, _lay_line)


def _run_turning_path(state: RunState, request: PathRequest) -> Outcome:
    """Deviation at every output along a path on which axes turn."""
    path, machine = request.path, state.scene.machine
    model = model_builder(state)(path.pose_at(0.5 * path.length))
    speeds = rotation_speeds(machine, path)
    fastest = max(move.feed for move in request.moves)
    turned = {name: fastest * speed for name, speed in speeds.items()}
    for message in report_gyroscopic_shift(model, turned, least=MATTERS):
        state.warn(f"path analysis: {message}")

    def lay_line(state: RunState, request: PathRequest) -> ToolLine:
        # a path of linear and rotary axes is a straight line of positions: so many poses of it that
        # a body turns little from one to the next
        count = math.ceil(path.length * max(speeds.values()) / NODE_TURN) + 1
        nodes: FloatArray = np.asarray(
            np.linspace(0.0, path.length, max(NODES, count)), dtype=float
        )
        return ToolLine(
            state=state,
            request=request,
            start=np.zeros(3),
            along=np.zeros(3),
            nodes=nodes,
            bodies=lambda speed, acceleration: rotary_trajectory(
                machine, state.parts.superelements, path, speed, acceleration
            ),
            motors=lambda speed, acceleration, trajectory, outputs: rotary_path_motors(
                state.parts, path, trajectory, outputs, speed=speed, acceleration=acceleration
            ),
            drives=tuple(state.scene.drives.values()),
            errors=find_trajectory_errors(state, path.pose_at, nodes),
            turning=max(speeds.values()),
            feed=None
            if request.cut is None
            else find_feed(
                machine,
                state.parts.superelements,
                path,
                request.cut.at,
                np.array(request.cut.up),
            ),
        )

    return _answer(state, request, model, lay_line)


def _answer(
    state: RunState,
    request: PathRequest,
    model: PoseModel,
    lay_line: Callable[[RunState, PathRequest], ToolLine],
) -> Outcome:
    """What is said of a path whose middle is a machine in a pose."""
    system = damp_system(state.scene, model.system, model.all_modes)
    return answer_path(
        state,
        request,
        frequencies_hz=model.all_modes.frequencies_hz,
        damped=system.damping is not None or system.hysteretic is not None,
        solve=lambda own, asked: _solve_line_moves(lay_line(own, asked)),
    )


def _lay_line(state: RunState, request: PathRequest) -> ToolLine:
    mechanism = state.scene.mechanism
    if mechanism is None:
        raise ValueError("a line of a tool needs a mechanism")
    ends = [
        tool_pose(mechanism, pose.positions)[0] for pose in (request.path.start, request.path.end)
    ]
    nodes: FloatArray = np.asarray(np.linspace(0.0, request.path.length, NODES), dtype=float)
    start, along = ends[0], np.asarray((ends[1] - ends[0]) / request.path.length)
    direction = tool_pose(mechanism, request.path.start.positions)[1]

    def travel(speed: float, acceleration: float) -> UnitTravel:
        return UnitTravel(start, along, speed, acceleration, (0.0, request.path.length))

    return ToolLine(
        state=state,
        request=request,
        start=start,
        along=along,
        nodes=nodes,
        bodies=lambda speed, acceleration: mechanism_trajectory(
            state,
            mechanism,
            travel(speed, acceleration),
            pose_at=request.path.pose_at,
            direction=direction,
        ),
        motors=lambda speed, acceleration, trajectory, outputs: plan_motors(
            state,
            travel(speed, acceleration),
            outputs,
            amounts=trajectory.amounts,
            direction=direction,
        ),
        drives=tuple(drive for drive in state.scene.drives.values() if drive.axis in LENGTHS),
        errors=find_trajectory_errors(state, request.path.pose_at, nodes),
    )


def _require_stable(line: ToolLine) -> None:
    """Refuse loops that are unstable at an end or in the middle of a line.

    Raises:
        UnstableControlError: A pole grows.
    """
    model_at, path = model_builder(line.state), line.request.path
    for share in (0.0, 0.5, 1.0):
        position = share * path.length
        drive_along(model_at(path.pose_at(position)), position, line.state.warn)


def _count_steps(line: ToolLine, sampled: SampledMotion, move: SetPoint) -> int:
    """Steps in time per sample."""
    rates = [STEPS_PER_PERIOD * sampled.highest_hz]
    if line.errors is not None:
        rates.append(STEPS_PER_WAVE * move.feed / line.errors.shortest)
    if line.request.cut is not None:
        rates.append(PATH_STEPS_PER_TURN * line.request.cut.cut.spindle / (2.0 * math.pi))
    # a leg is at most as fast as the tool
    rates += [
        STEPS_PER_WAVE * move.feed * wave.per_turn / drive.lead
        for drive in line.drives
        for wave in drive.ripple
    ]
    return max(1, math.ceil(max(rates) / line.request.sampling_hz))


def _solve_move(
    line: ToolLine, sampled: SampledMotion, move: SetPoint, *, middle: bool = False
) -> tuple[PathDeviation, PathForces]:
    """Deviation over one move, from the equilibrium at its beginning, and what drives take; in the
    middle everywhere what joints take and probes see, too, which are outputs after those wanted.
    """
    samples = sample_path(line.request, move)
    parts = _count_steps(line, sampled, move)
    step = float(samples[1] - samples[0]) / parts
    times = step * np.arange(-BEFORE, parts * (len(samples) - 1) + 1, dtype=np.float64)
    path = StraightPath(line.start, line.along, move, step)
    trajectory = line.trajectory(path)
    given = np.concatenate([trajectory.acting.at(times[part]) for part in chunk_slices(len(times))])
    sampled = dataclasses.replace(sampled, along=lambda now: sample_move(move, now).positions)
    loads = dataclasses.replace(
        trajectory.acting, at=lambda now: interpolate_nodes(now, times, given)
    )
    motors = line.unit_motors and interpolate_motors(*line.unit_motors, line.nodes, path.travel)
    machine = DrivenTrajectory(trajectory, motors, line.tool).move(
        sampled,
        times,
        loads,
        friction="true",
        node_spacing=min(NODE_SPACING, NODE_ANGLE / max(line.turning * move.feed, TINY)),
        load_spacing=step,
    )
    motion, servo, outputs = machine.motion, machine.servo, line.request.outputs
    force = _cut_forces(line, move, times)
    history = integrate_linear(motion, motion.load + motion.tool_load(force))
    limit_hz = choose_model(line.request).low_frequency_limit_hz
    rows, plant = machine.rows(outputs), machine.plant
    split = _split_motion(motion, rows, history, limit_hz=0.0 if motors else limit_hz)
    deviating = loads.deviating(times)
    pulled = motion.apply(plant.direct_of(outputs, loads.channels), deviating)
    total = split.total + pulled + motion.apply(plant.direct_of(outputs, line.tool), force)
    at_once = split.quasi_static + pulled
    total, at_once, slow = (
        (part - part[0])[BEFORE::parts] for part in (total, at_once, split.low_frequency)
    )
    shown = slice(BEFORE, None, parts)
    none = np.zeros((len(samples), 0))
    drives = (
        record_drives((), samples, none, none)
        if servo is None
        else record_drives(
            line.drives, samples, servo.forces(history)[shown], -servo.read(history)[shown]
        )
    )
    deviation = PathDeviation(samples, total, at_once, slow, total - at_once - slow)
    if not middle:
        return deviation, PathForces(drives, {})
    acting = np.concatenate([force, deviating], axis=1)
    known = machine.record(history, lambda part: acting[part])
    return deviation, PathForces(drives, *_observe_middle(line, machine, known, samples, shown))


def _observe_middle(
    line: ToolLine,
    machine: MovingMachine,
    known: SampledHistory,
    samples: FloatArray,
    shown: slice,
) -> tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]:
    """Return what joints took at most, and what probes saw.

    Args:
        samples: ``(n,)`` instants of a move [s].
    """
    driven = drive_bodies(machine, known)
    seen, smoothed = (
        (values - values[0])[shown]
        for values in (
            driven.follow_probes(line.probes),
            driven.seen.observe(Watch(smoothing_channels(line.probes))),
        )
    )
    forces = largest_joint_forces(
        line.joints, known.motion.times, lambda joint: known.observe(watch_joints([joint]))
    )
    return forces, read_probes(line.probes, samples, seen, smoothed)


def _cut_forces(line: ToolLine, move: SetPoint, times: FloatArray) -> FloatArray:
    """Forces on the tool ``(n, 3)``, machine frame [N]."""
    force, request = np.zeros((len(times), 3)), line.request.cut
    if request is None:
        return force
    cutting = times >= 0.0
    now = sample_move(move, times[cutting])
    if line.feed is None:
        force[cutting] = cutting_loads(request, line.along)(times[cutting], now.speeds)
        return force
    fields = orient_cut(request, *line.feed(line.nodes))
    frames, sizes = (
        scipy.interpolate.make_interp_spline(line.nodes, values, k=3)(now.positions)
        for values in fields
    )
    own = cutting_forces(request.cut, times[cutting], sizes * now.speeds)
    force[cutting] = (own[:, None] @ frames)[:, 0]
    return force


@dataclass(frozen=True, eq=False)
class _SplitMotion:
    """Motion at the outputs ``(n, p)`` beside that by weight alone, of the modes that are kept: all
    of it, what is held statically, and that of modes slower than a ramp.
    """

    total: FloatArray
    quasi_static: FloatArray
    low_frequency: FloatArray


def _split_motion(
    motion: LinearMotion, rows: FloatArray, history: CompliantHistory, *, limit_hz: float
) -> _SplitMotion:
    """Take the motion at the outputs apart.

    Args:
        rows: ``(k, p, c)`` motion at the outputs at its nodes.
        limit_hz: Modes below do not follow a ramp; zero for none, as of closed loops [Hz].
    """
    held = np.swapaxes(
        np.linalg.solve(np.swapaxes(motion.stiffness, 1, 2), np.swapaxes(rows, 1, 2)), 1, 2
    )
    slow = np.zeros_like(rows)
    if limit_hz > 0.0:
        values, vectors = np.linalg.eigh(motion.stiffness)
        below = vectors * (values < (2.0 * np.pi * limit_hz) ** 2)[:, None, :]
        projector = below @ np.swapaxes(below, 1, 2)
        slow = rows @ projector
        held = held - held @ projector
    weight = motion.deflect()
    moved = history.compliant - weight
    return _SplitMotion(
        motion.apply(rows, moved),
        motion.apply(held, motion.load) - motion.apply(rows - slow, weight),
        motion.apply(slow, moved),
    )


def _evaluate_poses(
    line: ToolLine,
    sampled: SampledMotion,
    found: tuple[PathDeviation, ...],
    kept: tuple[PathDeviation, ...],
    up_to_hz: float,
) -> FollowedPoses:
    """What following the poses took, and what it changes: that modes are kept only up to a frequency
    is evaluated in the middle, with twice as many.
    """
    whole = kept[-1]
    if not sampled.complete:
        finer = line.sample(TWICE * up_to_hz, follows=False)
        whole, _ = _solve_move(line, finer, line.request.moves[-1], middle=True)
    truncation, effect = compare_moves(line.request, found, kept, short=kept[-1], whole=whole)
    return FollowedPoses(
        sampled_poses=sampled.poses,
        error=sampled.error,
        rotation_error=sampled.rotation_error,
        modes=sampled.modes,
        next_hz=None if sampled.complete else up_to_hz,
        steps=max(len(even_nodes(each.times, NODE_SPACING)) for each in found),
        truncation=truncation,
        effect=effect,
    )


def _check_speeds(state: RunState, mechanism: SceneMechanism, request: PathRequest) -> None:
    """Say what Coriolis and centrifugal forces would do, where they are left out."""
    if has_coriolis(state):
        return
    line, move = _lay_line(state, request), request.moves[-1]
    point = line.start + 0.5 * request.path.length * line.along
    reach = move.feed / move.ramp.time_constant
    sizes = []
    for speed, acceleration in ((move.feed, 0.0), (0.0, reach)):
        moved = move_bodies(
            mechanism,
            state.parts,
            np.zeros(1),
            PathPoints(point[None], speed * line.along[None], acceleration * line.along[None]),
            tool_pose(mechanism, request.path.start.positions)[1],
            velocity_terms=speed > 0.0,
        )
        sizes.append(max(float(np.abs(motion[0, :3]).max()) for motion in moved.values()))
    state.warn(
        f"path analysis: Coriolis and centrifugal forces are left out; at {move.name} speeds accelerate bodies by"
        f" {100.0 * sizes[0] / sizes[1]:.2g} % of what ramps do; write [effects] coriolis = true"
    )
