"""A contour on a machine coupled of components, rigid to finite elements: axes that travel along
the path, or a mechanism whose legs bend.

The machine is coupled in poses along the path and reduced to its modes there. The rigid machine
moves as its set points say, and its inertia is a load. Motors follow their set points exactly, or
are under control.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Pose
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.pipeline.motion.body_trajectory import (
    MechanismTrajectory,
    has_coriolis,
)
from headstock.pipeline.motion.contour_cut import (
    CutMotion,
    cut_contour,
    travel_frames,
    turned_modes,
)
from headstock.pipeline.motion.contour_run import (
    CachedFunction,
    CachedPath,
    ContourDrives,
    ContourRun,
    plan_request,
    request_times,
)
from headstock.pipeline.motion.guide_errors import STEPS_PER_WAVE, find_trajectory_errors
from headstock.pipeline.motion.motors import (
    DrivenTrajectory,
    FrictionSpeeds,
    TrajectoryMotors,
    controlled_drives,
    drive_assumptions,
    plan_motors,
)
from headstock.pipeline.motion.posed_machine import (
    FORCE,
    build_along,
    join_screws,
    model_builder,
    report_gyroscopic_shift,
    shared_rows,
)
from headstock.pipeline.motion.probe_motions import (
    join_probes,
    observe_probes,
    place_probes,
    probe_channels,
    probe_kinds,
    read_probes,
)
from headstock.pipeline.motion.trajectory import (
    AxesTrajectory,
    FollowedTrajectory,
    Trajectory,
    find_ball_screws,
    follow_time,
)
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import ForceRecord
from headstock.solvers.milling.path_drives import find_tool_positions
from headstock.solvers.milling.tip_poles import TipDynamics, tip_dynamics
from headstock.solvers.milling.tool_dynamics import mount_modes
from headstock.solvers.milling.tool_path import (
    AVERAGES,
    ContourPlan,
    PathPoints,
    ToolPath,
    TraceFit,
)
from headstock.solvers.motion.alpha import even_nodes
from headstock.solvers.motion.friction import friction_force
from headstock.solvers.motion.plant import PlantChannels, SampledMotion
from headstock.solvers.motion.plant_motion import (
    LOAD_SPACING,
    NODE_SPACING,
    follow_outputs,
    interpolate_smooth,
)
from headstock.solvers.motion.sampling import MOST_SAMPLES, sample_motion, vary_motion
from headstock.solvers.second_order import Channel

POSES_PER_PIECE = 6  # at least, and doubled where they do not suffice
SHORTEST = 1e-6  # share of the whole trajectory: bends closer than that are one
STEPS_PER_PERIOD = 20  # of the highest mode that is kept: with fewer its frequency is wrong
RESIDUAL_REACH = 4.0  # frequency of the residual modes, over the highest one kept
RESIDUAL_DAMPING = 0.3
TURNING_NODES = 101  # at which rotation rates are evaluated
IDEAL = "motors follow their set points; no control loop is closed along a contour"
OF_SCREWS = "motor torques are the forces of the screws times lead over 2 pi"


@dataclass(frozen=True, eq=False)
class ContourCourse:
    """Store what machines that differ little share on a contour.

    Attributes:
        plan: The contour, laid out in time.
        fit: Quality of the spline through measured positions; None for the computed path.
        followed: Trajectory of the rigid machine, without guide errors.
        motors: Drives under control; None without control.
        sampled: The machine in poses along the trajectory; None before it was sampled.
    """

    state: RunState
    plan: ContourPlan
    fit: TraceFit | None
    followed: FollowedTrajectory
    motors: TrajectoryMotors | None
    sampled: SampledMotion | None = None


@dataclass(frozen=True, eq=False)
class CoupledRun(ContourRun):
    """Store a contour that has been run on a machine of components.

    Attributes:
        sampled: The machine in poses along the trajectory.
    """

    course: ContourCourse
    sampled: SampledMotion


def _list_breaks(plan: ContourPlan, rounding: float, end: float) -> list[float]:
    """Return the times at which pieces of a contour's trajectory meet, each piece with splines of
    its own [s].

    Rounding by moving averages takes this long per corner, half of it on either side of the bend.
    With more bends than poses allowed there are no pieces: poses are then as dense as corners.

    Args:
        rounding: Duration of the rounding of a corner [s].
        end: End of the computed time [s].
    """
    last = plan.path.span[1]
    sides = (-0.5 * rounding, 0.0, 0.5 * rounding)
    inner = [bend for bend in map(float, plan.bends) if rounding < bend < last - rounding]
    bends = [bend + side for bend in inner for side in sides]
    if POSES_PER_PIECE * len(bends) > MOST_SAMPLES:
        bends = inner if POSES_PER_PIECE * len(inner) <= MOST_SAMPLES else []
    breaks = [0.0]
    for bend in sorted((rounding, *bends, last - rounding)):
        if breaks[-1] + SHORTEST * end < bend < (1.0 - SHORTEST) * end:
            breaks.append(bend)
    return [*breaks, end]


def _tool_channels(request: ContouringRequest) -> tuple[Channel, ...]:
    """Return the channels of the cutting force and of the motion of the tool."""
    return tuple((request.point or "", direction) for direction in DIRECTIONS)


def _push_channels(screws: Iterable[str]) -> tuple[Channel, ...]:
    """Return the channels of the forces of screws."""
    return tuple((name, FORCE) for name in screws)


def run_coupled_contour(
    state: RunState,
    request: ContouringRequest,
    record: ForceRecord | None = None,
    until: float = math.inf,
    like: ContourCourse | None = None,
) -> CoupledRun:
    """Run a contour.

    Args:
        request: Path, tool and cut.
        record: Measured forces in place of computed ones; its time starts with the path.
        until: Stop at this time [s].
        like: Course of a machine that differs little: only the differences are sampled, in a few
            poses.

    Raises:
        PoseError: A mechanism cannot follow the path.
        CsvError: The record does not cover it.
        ModelError: The machine is free to move.
    """
    course = like or _lay_course(state, request)
    plan, motors, times = course.plan, course.motors, request_times(request, course.plan, until)
    end, step = min(plan.path.span[1], until), float(times[1] - times[0])
    trajectory, spacing = course.followed.trajectory, LOAD_SPACING
    nodes = even_nodes(np.array([0.0, end]), NODE_SPACING)
    errors = find_trajectory_errors(state, trajectory.pose, nodes)
    if errors is not None:
        spacing = min(spacing, errors.shortest / STEPS_PER_WAVE)
    followed = dataclasses.replace(course.followed, errors=errors)
    driven = DrivenTrajectory(followed, motors, _tool_channels(request))
    sampled = _sample_contour(state, request, course, driven, end)
    _check_steps(state, request, sampled, step)
    friction: FrictionSpeeds = "true" if request.model == "nonlinear" else "set"
    loads = followed.acting
    machine = driven.move(
        sampled,
        times,
        loads,
        friction=friction,
        node_spacing=NODE_SPACING,
        load_spacing=spacing,
    )
    motion = machine.motion
    cut = cut_contour(request, motion, plan, rotation=np.eye(3), record=record)
    gravity_deflection = motion.tool_motion(motion.deflect())

    def acting(part: slice) -> FloatArray:
        given = interpolate_smooth(loads.deviating, times[part], spacing)
        return np.concatenate([cut.carried[part], given], axis=1)

    if machine.servo is None or motors is None:
        drives, assumed = _drive_screws(state, driven, sampled, times, cut)
    else:
        drives = controlled_drives(machine.servo, motors.drives, cut.history)
        assumed = drive_assumptions(motors.drives, friction)
    instants: FloatArray = np.asarray(np.linspace(0.0, end, TURNING_NODES), dtype=float)
    middle = model_builder(state)(trajectory.pose(plan.cuts[0].middle))
    turning = report_gyroscopic_shift(middle, trajectory.turn_rates(followed.law(instants)))
    placed = place_probes(state.parts, middle.coupled, tuple(state.scene.machine.probes))
    history = machine.record(cut.history, acting)
    return CoupledRun(
        times=times,
        gap=cut.tip + motion.tool_rest(cut.force) - gravity_deflection,
        gravity_deflection=gravity_deflection,
        force=cut.force,
        plan=plan,
        fit=course.fit,
        motion=motion,
        history=cut.history,
        drives=drives,
        highest_hz=sampled.highest_hz,
        coriolis=has_coriolis(state),
        assumed=(*assumed, *turning),
        probes=read_probes(placed, times, observe_probes(machine, history, placed)),
        course=dataclasses.replace(course, state=state, sampled=sampled),
        sampled=sampled,
    )


def _lay_course(state: RunState, request: ContouringRequest) -> ContourCourse:
    """Lay a contour out in time, with the motion of the rigid machine and its motors."""
    plan, fit = plan_request(request, *_trace_tool(state, request))
    plan = dataclasses.replace(plan, path=CachedPath(plan.path))
    trajectory = _plan_trajectory(state, request, plan.path)
    followed = FollowedTrajectory(trajectory, follow_time, CachedFunction(trajectory.accelerate))
    motors = plan_motors(trajectory, _tool_channels(request), CachedFunction)
    return ContourCourse(state, plan, fit, followed, motors)


def _sample_contour(
    state: RunState,
    request: ContouringRequest,
    course: ContourCourse,
    driven: DrivenTrajectory,
    end: float,
) -> SampledMotion:
    """Sample the machine in poses up to a time [s]; only the differences where the course was
    sampled already.
    """
    names, screws = tuple(state.scene.machine.probes), find_ball_screws(state.scene.machine)
    trajectory, probes = driven.followed.trajectory, probe_channels(names)
    channels = PlantChannels(
        inputs=driven.inputs,
        outputs=(*driven.tool, *_push_channels(screws), *driven.outputs, *probes),
        up_to_hz=request.modes_to_hz,
        kinds=probe_kinds(probes, names),
    )
    joins = (join_screws(screws), join_probes(state.parts, trajectory), *driven.joins)
    build = build_along(state, driven.followed, request.modes_to_hz, joins)
    breaks = [0.0, end]
    if request.follows_pose:
        breaks = _list_breaks(course.plan, AVERAGES * request.contour.window, end)
    else:
        kept = build(course.plan.cuts[0].middle)
        build = lambda time: kept  # noqa: E731
    if course.sampled is None:
        return sample_motion(build, breaks, channels)
    shared = shared_rows(trajectory, course.state, state)
    return vary_motion(course.sampled, build, channels, shared)


def _drive_screws(
    state: RunState,
    driven: DrivenTrajectory,
    sampled: SampledMotion,
    times: FloatArray,
    cut: CutMotion,
) -> tuple[ContourDrives, tuple[str, ...]]:
    """Return forces and torques of motors that follow their set points exactly, and the assumptions
    behind them.

    Args:
        times: ``(n,)`` steps [s].
    """
    followed, names = driven.followed, tuple(find_ball_screws(state.scene.machine))
    loads, trajectory = followed.acting, followed.trajectory

    def forces(some: NDArray[np.intp]) -> FloatArray:
        given = interpolate_smooth(loads.at, times[some])
        pushed = follow_outputs(
            sampled,
            times[some],
            outputs=_push_channels(names),
            coordinates=cut.history.compliant[some],
            acting=np.concatenate([cut.carried[some], given], axis=1),
            inputs=driven.inputs,
        )
        if not isinstance(trajectory, MechanismTrajectory):
            return pushed
        # a drive at the base of a leg also carries the leg, besides the force at its tip
        carried = interpolate_smooth(
            lambda now: trajectory.leg_forces(followed.law(now)), times[some]
        )
        return carried - pushed

    torques, assumed = _motor_torques(state, names, trajectory, times)
    return ContourDrives(names, forces, torques), (IDEAL, *assumed)


def coupled_face_dynamics(run: CoupledRun, request: ContouringRequest, face: int) -> TipDynamics:
    """Return the dynamics of the machine with its tool in the middle of a face: forces along, away
    and up, chips by motions along and away.

    The modes left out are represented by one mode in each direction, far above those that are kept.

    Args:
        request: Contour, tool and cut.
        face: Number of the straight cut, counted from zero.
    """
    cut = run.plan.cuts[face]
    now, tool = run.sampled.at(np.array([cut.middle])), _tool_channels(request)
    frame: FloatArray = travel_frames(cut.travel[None], cut.part)[0]
    tip = frame @ now.rows_of(tool)[0]
    rest = frame @ now.direct_of(tool, tool)[0] @ frame.T
    # of unit mass and the residual flexibility, whose square root times the frequency is the shape
    omega = RESIDUAL_REACH * 2.0 * np.pi * max(run.highest_hz, request.modes_to_hz)
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
    extra = vectors * np.sqrt(np.maximum(values, 0.0)) * omega
    kept = tip.shape[1]
    stiffness = omega**2 * np.eye(kept + 3)
    damping = 2.0 * RESIDUAL_DAMPING * omega * np.eye(kept + 3)
    stiffness[:kept, :kept], damping[:kept, :kept] = now.stiffness[0], now.damping[0]
    mounted = mount_modes(
        np.eye(kept + 3),
        damping,
        stiffness,
        np.concatenate([tip, extra], axis=1),
        turned_modes(request.tool_modes, frame.T),
    )
    return tip_dynamics(
        mounted.mass, mounted.damping, mounted.stiffness, forced=mounted.tip, seen=mounted.tip[:2]
    )


def _trace_tool(
    state: RunState, request: ContouringRequest
) -> tuple[tuple[str, ...], Callable[[FloatArray, PathPoints], FloatArray]]:
    """Return the measured positions of a machine, and the tool points they lead to."""
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is not None:
        mounted, tool = mechanism.mounted, mechanism.tool
        return LENGTHS, lambda lengths, near: find_tool_positions(mounted, lengths, near, tool)
    travel = find_tool_travel(machine, machine.points[request.point or ""])
    return travel.axes, lambda positions, near: positions @ travel.directions.T


def _plan_trajectory(state: RunState, request: ContouringRequest, path: ToolPath) -> Trajectory:
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is None:
        travel = find_tool_travel(machine, machine.points[request.point or ""])
        return AxesTrajectory(state.parts, travel, path)

    def pose_at(time: float) -> Pose:
        x, y, z = path.at(np.array([time])).position[0].tolist()
        return Pose(f"t = {time:.4g} s", {"X": x, "Y": y, "Z": z})

    return MechanismTrajectory(
        state.parts, mechanism, path, mechanism.tool, pose_at, has_coriolis(state)
    )


def _motor_torques(
    state: RunState, names: tuple[str, ...], trajectory: Trajectory, times: FloatArray
) -> tuple[Callable[[NDArray[np.intp], FloatArray], FloatArray] | None, tuple[str, ...]]:
    """Return the torques of motors: of the screw forces, of the motors' inertia and of friction
    where the scene has drives; and which of these are left out.
    """
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is not None:
        lead = mechanism.screw_lead
        if lead is None:
            return None, ()
        text = f"{OF_SCREWS}: no friction, no inertia of motor and screw"
        return lambda some, forces: forces * (lead / (2.0 * math.pi)), (text,)
    drives: dict[str, Drive] = {drive.axis: drive for drive in state.scene.drives.values()}
    screws = find_ball_screws(machine)
    shafts = {name: machine.joints[screws[name][0]].screw for name in names}
    leads = [
        drives[name].lead if name in drives else (shaft.lead if shaft else 0.0)
        for name, shaft in shafts.items()
    ]
    if not names or not all(leads):
        return None, ()

    def torques(some: NDArray[np.intp], forces: FloatArray) -> FloatArray:
        total = forces * (np.array(leads) / (2.0 * math.pi))
        for number, name in enumerate(names):
            if name in drives and isinstance(trajectory, AxesTrajectory):
                motion = trajectory.axis_motion(name, follow_time(times[some]))
                total[:, number] += drive_torque(drives[name], *motion)
        return total

    return torques, (_describe_torques(drives.values()),)


def _describe_torques(drives: Collection[Drive]) -> str:
    """Describe which contributions motor torques of axes contain, and which not."""
    if not drives:
        return f"{OF_SCREWS}: no inertia of motor and screw, no friction"
    if any(drive.friction is not None for drive in drives):
        return f"{OF_SCREWS}, plus the drives' own inertia and friction"
    return f"{OF_SCREWS}, plus the drives' own inertia: no friction"


def drive_torque(drive: Drive, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Return the torque ``(n,)`` that a motor needs besides that for the force of its screw: for
    its own inertia and that of its screw, and against friction [N m].

    Args:
        speed: ``(n,)`` of the axis [m/s].
        acceleration: ``(n,)`` [m/s^2].
    """
    turn = 2.0 * math.pi / drive.lead
    torque = (drive.motor_inertia + drive.screw_inertia) * turn * acceleration
    if drive.friction is not None:
        torque = torque + friction_force(drive.friction, speed) / turn
    return np.asarray(torque)


def _check_steps(
    state: RunState, request: ContouringRequest, sampled: SampledMotion, step: float
) -> None:
    """Warn of modes that the time steps do not resolve, and of effects that are left out."""
    if sampled.highest_hz * step * STEPS_PER_PERIOD > 1.0:
        needed = math.ceil(
            request.steps_per_turn * sampled.highest_hz * step * STEPS_PER_PERIOD / 24.0
        )
        state.warn(
            f"the highest mode of the contour, {sampled.highest_hz:.0f} Hz, has {1.0 / (sampled.highest_hz * step):.0f} time steps per period;"
            f" write steps_per_turn = {24 * needed} in [analyses.contouring], or a lower modes_to"
        )
