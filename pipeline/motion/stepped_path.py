"""A path of the tool of a mechanism, lumped or of components, and of rotary axes: the deviation
with drives, guide errors, cutting forces and velocity terms, by the time steps of contours.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.mechanisms.exechon import tool_pose
from headstock.pipeline.answers.motion_forces import PathForces, ProbeMotion
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.motion.body_trajectory import (
    BodyTrajectory,
    MechanismTrajectory,
    RotaryTrajectory,
    has_coriolis,
)
from headstock.pipeline.motion.guide_errors import STEPS_PER_WAVE, find_trajectory_errors
from headstock.pipeline.motion.motion_forces import (
    largest_joint_forces,
    record_drives,
    watch_joints,
)
from headstock.pipeline.motion.motors import (
    DrivenTrajectory,
    MovingMachine,
    TrajectoryMotors,
    plan_motors,
)
from headstock.pipeline.motion.path_model import (
    PosedMoves,
    SolvedMove,
    SolveMove,
    choose_model,
    orient_cut,
    sample_path,
)
from headstock.pipeline.motion.posed_machine import (
    build_along,
    model_builder,
    report_gyroscopic_shift,
)
from headstock.pipeline.motion.probe_motions import (
    add_motor_accelerations,
    join_probes,
    observe_probes,
    place_probes,
    probe_channels,
    read_probes,
    smoothing_channels,
)
from headstock.pipeline.motion.trajectory import (
    FollowedTrajectory,
    Law,
    TrajectoryErrors,
    interpolate_motors,
    interpolate_trajectory,
)
from headstock.pipeline.planning.budgets import PATH_STEPS_PER_TURN
from headstock.pipeline.stages.control import drive_along
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.joint_forces import joint_outputs
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.scene.analyses.path import PathRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.milling.tool_path import StraightLine
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
from headstock.solvers.motion.set_points import (
    PathMotion,
    SetPoint,
    average_accelerations,
    sample_move,
)
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Extreme, Watch

STEPS_PER_PERIOD = 24  # of the highest mode that is kept
NODE_TURN = 0.05  # largest rotation of bodies on rotary axes between two nodes [rad]
NODES = 65  # positions of the line between which the rigid motion is interpolated
NODE_SPACING = 5e-3  # of matrices in time: on ramps the position is not linear in time [s]
# rotation of bodies between nodes: a stiff direction interpolated linearly there is mixed with a
# compliant one by an eighth of its square
NODE_ANGLE = 4e-3  # [rad]
TINY = 1e-30
BEFORE = 2  # steps before the move begins: at the first one the machine is at rest
MATTERS = 1e-3  # relative shift of a natural frequency that causes a warning
TWICE = 2.0  # multiple of the frequency range, to evaluate the truncation of modes


@dataclass(frozen=True, eq=False)
class SteppedPath:
    """Solve moves along a line of a mechanism's tool, or along a path of rotary axes.

    Attributes:
        trajectory: Trajectory of the bodies, over positions.
        nodes: ``(k,)`` positions between which the rigid motion is interpolated [m, rad].
        errors: Guide errors along it; None for none.
        feed: Travel ``(n, 3)`` of the tool relative to its workpiece per travel along the path, and
            the direction ``(n, 3)`` of its axis, at positions.
        turning: Largest rotation rate of bodies per speed along the path [1/m, -]; zero where they
            rotate little.
    """

    state: RunState
    request: PathRequest
    trajectory: BodyTrajectory
    nodes: FloatArray
    errors: TrajectoryErrors | None
    feed: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    turning: float = 0.0

    @property
    def length(self) -> float:
        """Length of the path [m, rad]."""
        return self.request.path.length

    @property
    def up_to_hz(self) -> float:
        """Highest frequency of modes that are kept [Hz]."""
        return choose_model(self.request).up_to_hz or 0.0

    @property
    def tool(self) -> tuple[Channel, ...]:
        """Channels of the cutting force; without a cut, of the point of the first output."""
        cut = self.request.cut
        at = self.request.outputs[0][0] if cut is None else cut.at
        return tuple((at, dof) for dof in DIRECTIONS)

    @functools.cached_property
    def _accelerate(self) -> Callable[[PathMotion], FloatArray]:
        return interpolate_trajectory(self.trajectory, self.nodes)

    @functools.cached_property
    def _motors(self) -> TrajectoryMotors | None:
        """Motors under control; None without control."""
        return plan_motors(self.trajectory, (*self.tool, *self.request.outputs))

    @functools.cached_property
    def _interpolated_motors(self) -> TrajectoryMotors | None:
        motors = self._motors
        if motors is None:
            return None
        return dataclasses.replace(motors, at=interpolate_motors(motors.at, self.nodes))

    def _follow(self, law: Law) -> FollowedTrajectory:
        return FollowedTrajectory(self.trajectory, law, self._accelerate, self.errors)

    @functools.cached_property
    def middle(self) -> PoseModel:
        """The machine at the middle of the path."""
        return model_builder(self.state)(self.request.path.pose_at(0.5 * self.length))

    @property
    def frequencies_hz(self) -> FloatArray:
        """Natural frequencies at the middle of the path [Hz]."""
        return self.middle.all_modes.frequencies_hz

    @property
    def damped(self) -> bool:
        """True where anything damps the machine."""
        system = damp_system(self.state.scene, self.middle.system, self.middle.all_modes)
        return system.damping is not None or system.hysteretic is not None

    @property
    def disturbed(self) -> bool:
        """True where guide errors or torque ripple act."""
        return self.errors is not None or any(drive.ripple for drive in self.trajectory.drives)

    @functools.cached_property
    def probes(self) -> dict[str, PlacedProbe]:
        """Probes at the middle of the path."""
        parts = self.state.parts
        return place_probes(parts, self.middle.coupled, tuple(parts.scene.machine.probes))

    @property
    def watched(self) -> tuple[Channel, ...]:
        """Outputs of joints and probes at the middle of the path."""
        probes = (*probe_channels(self.probes), *smoothing_channels(self.probes))
        return (*joint_outputs(self.middle.joints), *probes)

    def warn_of_speeds(self) -> None:
        """Warn of velocity terms that are left out: gyroscopic forces on deformation; of a
        mechanism also Coriolis and centrifugal forces, where these are switched off.
        """
        state, move, trajectory = self.state, self.request.moves[-1], self.trajectory
        middle, none = np.array([0.5 * self.length]), np.zeros(1)
        fastest = max(any_move.feed for any_move in self.request.moves)
        if isinstance(trajectory, MechanismTrajectory):
            fastest = move.feed
            if not trajectory.coriolis:
                reach = move.feed / move.ramp.time_constant
                by_speed, by_ramp = (
                    np.abs(whole.accelerate(motion).reshape(-1, 6)[:, :3]).max()
                    for whole in [dataclasses.replace(trajectory, coriolis=True)]
                    for motion in (
                        PathMotion(middle, np.array([move.feed]), none),
                        PathMotion(middle, none, np.array([reach])),
                    )
                )
                state.warn(
                    f"path analysis: Coriolis and centrifugal forces are left out; at {move.name} speeds accelerate bodies by"
                    f" {100.0 * by_speed / by_ramp:.2g} % of what ramps do; write [effects] coriolis = true"
                )
        turned = trajectory.turn_rates(PathMotion(middle, np.array([fastest]), none))
        for message in report_gyroscopic_shift(self.middle, turned, MATTERS):
            state.warn(f"path analysis: {message}")

    def sample(self, up_to_hz: float, *, follows: bool) -> SampledMotion:
        """Return the machine at positions of the path; or frozen at its middle, with its joints and
        probes among the outputs.
        """
        followed = self._follow(lambda times: sample_move(self.request.moves[0], times))
        driven = DrivenTrajectory(followed, self._motors, self.tool)
        watched = () if follows else self.watched
        channels = PlantChannels(
            inputs=driven.inputs,
            outputs=(*self.tool, *self.request.outputs, *watched, *driven.outputs),
            up_to_hz=up_to_hz,
        )
        if follows:
            build = build_along(self.state, followed, up_to_hz, driven.joins)
            return sample_motion(build, [0.0, self.length], channels)
        joins = (*driven.joins, join_probes(self.state.parts, self.trajectory))
        frozen = build_along(self.state, followed, up_to_hz, joins)(0.5 * self.length)
        return sample_motion(lambda where: frozen, [0.0, self.length], channels)

    def freeze(self) -> SolveMove:
        """Return a function that solves a move in the pose at the middle of the path.

        Raises:
            PoseError: The tool of a mechanism cannot follow the path.
            ModelError: The machine is free to move, or errors contradict each other.
            UnstableControlError: A control loop is unstable at an end or in the middle.
        """
        if self.trajectory.drives:
            model_at = model_builder(self.state)
            for position in (0.0, 0.5 * self.length, self.length):
                model = model_at(self.request.path.pose_at(position))
                drive_along(model, position, self.state.warn)
        frozen = self.sample(self.up_to_hz, follows=False)
        return lambda move: self._solve_move(frozen, move, middle=True)

    def add_errors(self, move: SetPoint, deviation: PathDeviation) -> PathDeviation:
        """Return a deviation as it is: its equations hold guide errors and torque ripple."""
        return deviation

    def follow(self, kept: Sequence[SolvedMove]) -> PosedMoves:
        """Return a function that solves a move as the pose changes; the truncation of modes is
        evaluated at mid-path, with modes up to twice the frequency.
        """
        sampled, moves = self.sample(self.up_to_hz, follows=True), self.request.moves
        short = whole = kept[-1].deviation
        if not sampled.complete:
            finer = self.sample(TWICE * self.up_to_hz, follows=False)
            whole = self._solve_move(finer, moves[-1], middle=True).deviation
        times = [sample_path(self.request, move) for move in moves]
        poses = FollowedPoses(
            sampled_poses=sampled.poses,
            error=sampled.error,
            rotation_error=sampled.rotation_error,
            modes=sampled.modes,
            next_hz=None if sampled.complete else self.up_to_hz,
            steps=max(len(even_nodes(samples, NODE_SPACING)) for samples in times),
            truncation=0.0,
            effect=(),
        )
        return PosedMoves(lambda move: self._solve_move(sampled, move), poses, (short, whole))

    def _count_steps(self, sampled: SampledMotion, move: SetPoint) -> int:
        """Return the number of time steps per sample."""
        rates = [STEPS_PER_PERIOD * sampled.highest_hz]
        if self.errors is not None:
            rates.append(STEPS_PER_WAVE * move.feed / self.errors.shortest)
        if self.request.cut is not None:
            rates.append(PATH_STEPS_PER_TURN * self.request.cut.cut.spindle / (2.0 * math.pi))
        # a leg is at most as fast as the tool
        rates += [
            STEPS_PER_WAVE * move.feed * wave.per_turn / drive.lead
            for drive in self.trajectory.drives
            for wave in drive.ripple
        ]
        return max(1, math.ceil(max(rates) / self.request.sampling_hz))

    def _solve_move(
        self, sampled: SampledMotion, move: SetPoint, *, middle: bool = False
    ) -> SolvedMove:
        """Solve one move, from the equilibrium at its beginning.

        Args:
            middle: The machine is frozen at the middle of the path, with joints and probes among
                its outputs.
        """
        request, samples = self.request, sample_path(self.request, move)
        parts = self._count_steps(sampled, move)
        step = float(samples[1] - samples[0]) / parts
        times = step * np.arange(-BEFORE, parts * (len(samples) - 1) + 1, dtype=np.float64)
        followed = self._follow(lambda now: average_accelerations(move, now, step))
        acting = followed.acting
        given = np.concatenate([acting.at(times[part]) for part in chunk_slices(len(times))])
        loads = dataclasses.replace(acting, at=lambda now: interpolate_nodes(now, times, given))
        machine = DrivenTrajectory(followed, self._interpolated_motors, self.tool).move(
            dataclasses.replace(sampled, along=lambda now: sample_move(move, now).positions),
            times,
            loads,
            friction="true",
            node_spacing=min(NODE_SPACING, NODE_ANGLE / max(self.turning * move.feed, TINY)),
            load_spacing=step,
        )
        motion, servo = machine.motion, machine.servo
        force = self._cut_forces(move, times)
        history = integrate_linear(motion, motion.load + motion.tool_load(force))
        limit_hz = 0.0 if servo else choose_model(request).low_frequency_limit_hz
        rows = machine.rows(request.outputs)
        total, quasi_static, slow = _split_motion(motion, rows, history, limit_hz=limit_hz)
        deviating = loads.deviating(times)
        direct = motion.apply(machine.plant.direct_of(request.outputs, loads.channels), deviating)
        of_force = motion.apply(machine.plant.direct_of(request.outputs, self.tool), force)
        shown = slice(BEFORE, None, parts)
        total, quasi_static, slow = (
            (part - part[0])[shown]
            for part in (total + direct + of_force, quasi_static + direct, slow)
        )
        taken: FloatArray = np.zeros((len(samples), 0))
        read = taken
        if servo is not None:
            taken, read = servo.forces(history)[shown], servo.read(history)[shown]
        deviation = PathDeviation(samples, total, quasi_static, slow, total - quasi_static - slow)
        forces = PathForces(record_drives(self.trajectory.drives, samples, taken, -read), {})
        if middle:
            inputs = np.concatenate([force, deviating], axis=1)
            observed = machine.record(history, lambda part: inputs[part])
            forces = PathForces(forces.drives, *self._observe(machine, observed, samples, shown))
        return SolvedMove(deviation, deviation, forces)

    def _observe(
        self, machine: MovingMachine, known: SampledHistory, samples: FloatArray, shown: slice
    ) -> tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]:
        """Return the largest forces of joints, and the outputs of probes.

        Args:
            samples: ``(n,)`` instants of a move [s].
        """
        observed, smoothed = (
            (values - values[0])[shown]
            for values in (
                observe_probes(machine, known, self.probes),
                add_motor_accelerations(machine, known).observe(
                    Watch(smoothing_channels(self.probes))
                ),
            )
        )
        forces = largest_joint_forces(
            self.middle.joints,
            known.motion.times,
            lambda joint: known.observe(watch_joints([joint])),
        )
        return forces, read_probes(self.probes, samples, observed, smoothed)

    def _cut_forces(self, move: SetPoint, times: FloatArray) -> FloatArray:
        """Return the cutting forces on the tool ``(n, 3)``, machine frame [N]."""
        force, request = np.zeros((len(times), 3)), self.request.cut
        if request is None:
            return force
        cutting = times >= 0.0
        now = sample_move(move, times[cutting])
        frames, sizes = (
            scipy.interpolate.make_interp_spline(self.nodes, values, k=3)(now.positions)
            for values in orient_cut(request, *self.feed(self.nodes))
        )
        along_cut = cutting_forces(request.cut, times[cutting], sizes * now.speeds)
        force[cutting] = (along_cut[:, None] @ frames)[:, 0]
        return force


def lay_tool_line(state: RunState, request: PathRequest, mechanism: SceneMechanism) -> SteppedPath:
    """Return the line that the tool of a mechanism follows."""
    path = request.path
    (start, direction), (end, _) = (
        tool_pose(mechanism, pose.positions) for pose in (path.start, path.end)
    )
    along = np.asarray((end - start) / path.length)
    nodes: FloatArray = np.asarray(np.linspace(0.0, path.length, NODES), dtype=float)
    line = StraightLine(start, along)
    up = direction if request.cut is None else np.array(request.cut.up)
    return SteppedPath(
        state=state,
        request=request,
        trajectory=MechanismTrajectory(
            state.parts, mechanism, line, direction, path.pose_at, has_coriolis(state)
        ),
        nodes=nodes,
        errors=find_trajectory_errors(state, path.pose_at, nodes),
        feed=lambda positions: (
            np.broadcast_to(along, (len(positions), 3)),
            np.broadcast_to(up, (len(positions), 3)),
        ),
    )


def lay_rotary_path(state: RunState, request: PathRequest) -> SteppedPath:
    """Return a path of rotary axes: a straight line of axis positions, with enough nodes that
    bodies rotate little from one to the next.
    """
    path, trajectory = request.path, RotaryTrajectory(state.parts, request.path)
    fastest = max(trajectory.rotation_speeds.values())
    count = math.ceil(path.length * fastest / NODE_TURN) + 1
    nodes: FloatArray = np.asarray(np.linspace(0.0, path.length, max(NODES, count)), dtype=float)

    def feed(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        if request.cut is None:
            raise ValueError("a path without a cut has no feed")
        return trajectory.feed(request.cut.at, np.array(request.cut.up), positions)

    return SteppedPath(
        state=state,
        request=request,
        trajectory=trajectory,
        nodes=nodes,
        errors=find_trajectory_errors(state, path.pose_at, nodes),
        feed=feed,
        turning=fastest,
    )


def _split_motion(
    motion: LinearMotion, rows: FloatArray, history: CompliantHistory, *, limit_hz: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the motion at the outputs ``(n, p)`` by the modes that are kept, less that under
    gravity: all of it, its quasi-static share, and that of modes slower than a ramp.

    Args:
        rows: ``(k, p, c)`` output rows at the nodes.
        limit_hz: Modes below it do not follow a ramp; zero for none, as in closed loops [Hz].
    """
    static_rows = np.swapaxes(
        np.linalg.solve(np.swapaxes(motion.stiffness, 1, 2), np.swapaxes(rows, 1, 2)), 1, 2
    )
    slow = np.zeros_like(rows)
    if limit_hz > 0.0:
        values, vectors = np.linalg.eigh(motion.stiffness)
        below = vectors * (values < (2.0 * np.pi * limit_hz) ** 2)[:, None, :]
        projector = below @ np.swapaxes(below, 1, 2)
        slow = rows @ projector
        static_rows = static_rows - static_rows @ projector
    weight = motion.deflect()
    moved = history.compliant - weight
    return (
        motion.apply(rows, moved),
        motion.apply(static_rows, motion.load) - motion.apply(rows - slow, weight),
        motion.apply(slow, moved),
    )
