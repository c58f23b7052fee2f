"""A contour on a machine coupled of components, rigid to finite elements: axes that follow the path,
or a mechanism whose legs bend.

The machine is coupled in poses along the path and reduced to its modes there; the rigid machine
travels as its set points say, and its inertia is a load. Motors follow their set points.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import Axis
from headstock.geometry.machine.machine import Pose
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.pipeline.motion.contour_cut import (
    CutMotion,
    cut_contour,
    travel_frames,
    turned_modes,
)
from headstock.pipeline.motion.contour_run import ContourDrives, ContourRun
from headstock.pipeline.motion.guide_errors import STEPS_PER_WAVE, find_trajectory_errors
from headstock.pipeline.motion.motors import (
    DrivenTrajectory,
    FrictionSpeeds,
    TrajectoryMotors,
    controlled_drives,
    drive_assumptions,
    plan_motors,
)
from headstock.pipeline.motion.observers import (
    drive_bodies,
    join_probes,
    probe_channels,
    probe_kinds,
)
from headstock.pipeline.motion.probe_motions import place_probes, read_probes
from headstock.pipeline.motion.traced_path import Remembered, RememberedPath, plan_request
from headstock.pipeline.motion.trajectory import (
    FORCE,
    RigidTrajectory,
    axes_trajectory,
    find_screws,
    has_coriolis,
    join_screws,
    machine_along,
    mechanism_trajectory,
    model_builder,
    report_gyroscopic_forces,
    shared_rows,
)
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import ForceRecord
from headstock.solvers.milling.path_drives import find_tool_positions
from headstock.solvers.milling.stability import TipDynamics, tip_dynamics
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
from headstock.solvers.motion.set_points import PathMotion
from headstock.solvers.second_order import Channel

POSES_PER_PIECE = 6  # of a trajectory, at the least, and as many again where they do not suffice
SHORTEST = 1e-6  # of the whole trajectory: closer bends are one
STEPS_PER_PERIOD = 20  # of the highest mode that is kept: with fewer its frequency is off
RESIDUAL_REACH = 4.0  # frequency at which what is left out deforms, in highest modes kept
RESIDUAL_DAMPING = 0.3
TURNING_NODES = 101  # at which speeds of turning are looked at
IDEAL = "motors follow their set points; no control loop is closed along a contour"
OF_SCREWS = "motor torques are the forces of the screws times lead over 2 pi"


@dataclass(frozen=True, eq=False)
class ContourTrajectory:
    """What a machine of components is to do along a contour.

    Attributes:
        plan: The contour, laid out in time.
        fit: How a spline went through measured positions; None for the computed path.
        rigid: How the rigid machine follows the path.
        motors: Drives under control; None without control.
    """

    state: RunState
    plan: ContourPlan
    fit: TraceFit | None
    rigid: RigidTrajectory
    motors: TrajectoryMotors | None


@dataclass(frozen=True, eq=False)
class SampledContour(ContourTrajectory):
    """A machine along its trajectory: all that a machine that differs little shares with it."""

    sampled: SampledMotion


@dataclass(frozen=True, eq=False)
class CoupledRun(ContourRun):
    """A contour that has been run on a machine of components."""

    trajectory: SampledContour


def _list_breaks(plan: ContourPlan, rounding: float, end: float) -> list[float]:
    """Times at which pieces of a contour's trajectory meet, each followed by splines of its own [s].

    Averages take so long to round a corner, half of that on either side of its bend. Of more bends
    than poses may be taken there are no pieces: poses are then as dense as corners are.

    Args:
        rounding: Of a corner [s].
        end: Of what is computed [s].
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
    """Where the cut pushes, and where the tool moves."""
    return tuple((request.point or "", direction) for direction in DIRECTIONS)


def run_coupled_contour(
    state: RunState,
    request: ContouringRequest,
    record: ForceRecord | None = None,
    until: float = math.inf,
    beside: SampledContour | None = None,
) -> CoupledRun:
    """Run a contour.

    Args:
        request: Path, tool and cut.
        record: Measured forces in place of computed ones; its time starts with the path.
        until: Stop at this time [s].
        beside: A machine that differs little: what this one differs by is looked at in a few poses.

    Raises:
        PoseError: A mechanism cannot follow the path.
        CsvError: The record does not cover it.
        ModelError: The machine is free to move.
    """
    course = beside or _lay_course(state, request)
    end = min(course.plan.path.span[1], until)
    step = 2.0 * math.pi / request.cut.spindle / request.steps_per_turn
    times: FloatArray = np.asarray(np.arange(0.0, end, step), dtype=float)
    contour = _join_errors(state, request, course, end)
    trajectory, loads = contour.driven.trajectory, contour.driven.trajectory.acting
    sampled = contour.sample(end, beside)
    _check_steps(state, request, sampled, step)
    friction: FrictionSpeeds = "true" if request.model == "nonlinear" else "set"
    machine = contour.driven.move(
        sampled,
        times,
        loads,
        friction=friction,
        node_spacing=NODE_SPACING,
        load_spacing=contour.spacing,
    )
    motion = machine.motion
    cut = cut_contour(request, motion, course.plan, rotation=np.eye(3), record=record)
    gravity_deflection = motion.tool_motion(motion.deflect())

    def acting(part: slice) -> FloatArray:
        given = interpolate_smooth(loads.deviating, times[part], contour.spacing)
        return np.concatenate([cut.carried[part], given], axis=1)

    if machine.servo is None or course.motors is None:
        driven, assumed = contour.drive_screws(sampled, times, cut)
    else:
        driven = controlled_drives(machine.servo, course.motors.drives, cut.history)
        assumed = drive_assumptions(course.motors.drives, friction)
    nodes: FloatArray = np.asarray(np.linspace(0.0, end, TURNING_NODES), dtype=float)
    middle = model_builder(state)(trajectory.pose_at(course.plan.cuts[0].middle))
    turning = report_gyroscopic_forces(
        state, lambda: middle, nodes, course.plan.path.at(nodes), _tool_direction(state)
    )
    placed = place_probes(state.parts, middle.coupled, contour.probes)
    seen = drive_bodies(machine, machine.record(cut.history, acting)).follow_probes(placed)
    return CoupledRun(
        times=times,
        gap=cut.tip + motion.tool_rest(cut.force) - gravity_deflection,
        gravity_deflection=gravity_deflection,
        force=cut.force,
        plan=course.plan,
        fit=course.fit,
        motion=motion,
        history=cut.history,
        drives=driven,
        highest_hz=sampled.highest_hz,
        coriolis=has_coriolis(state),
        assumed=(*assumed, *turning),
        probes=read_probes(placed, times, seen),
        trajectory=SampledContour(
            state, course.plan, course.fit, course.rigid, course.motors, sampled=sampled
        ),
    )


def _lay_course(state: RunState, request: ContouringRequest) -> ContourTrajectory:
    """Lay a contour out in time, with what the rigid machine and its motors do."""
    plan, fit = plan_request(request, *_trace_tool(state, request))
    plan = dataclasses.replace(plan, path=RememberedPath(plan.path))
    rigid = _plan_trajectory(state, request, plan.path)
    motors = plan_motors(
        state,
        plan.path,
        _tool_channels(request),
        amounts=rigid.amounts,
        direction=_tool_direction(state),
    )
    if motors is not None:
        motors = dataclasses.replace(motors, at=Remembered(motors.at))
    return ContourTrajectory(state, plan, fit, rigid, motors)


@dataclass(frozen=True, eq=False)
class _CoupledContour:
    """A contour that a machine of components is to run.

    Attributes:
        request: Path, tool and cut.
        plan: The contour, laid out in time.
        driven: The rigid machine with its errors, and its motors.
        spacing: Time between which loads are linear [s].
    """

    state: RunState
    request: ContouringRequest
    plan: ContourPlan
    driven: DrivenTrajectory
    spacing: float

    @functools.cached_property
    def screws(self) -> dict[str, tuple[str, Axis | None]]:
        """Ball screws that drive the machine."""
        return find_screws(self.state.scene.machine)

    @property
    def pushes(self) -> tuple[Channel, ...]:
        """Forces of the screws."""
        return tuple((name, FORCE) for name in self.screws)

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of probes."""
        return tuple(self.state.scene.machine.probes)

    def sample(self, end: float, beside: SampledContour | None) -> SampledMotion:
        """Return the machine in poses up to a time [s].

        Args:
            beside: A machine that differs little; None for none.
        """
        driven, request, seen = self.driven, self.request, probe_channels(self.probes)
        channels = PlantChannels(
            inputs=driven.inputs,
            outputs=(*driven.tool, *self.pushes, *driven.outputs, *seen),
            up_to_hz=request.modes_to_hz,
            kinds=probe_kinds(seen, self.probes),
        )
        joins = (
            join_screws(self.screws),
            join_probes(self.state.parts, driven.trajectory),
            *driven.joins,
        )
        place = machine_along(self.state, driven.trajectory, request.modes_to_hz, joins)
        breaks = [0.0, end]
        if request.follows_pose:
            breaks = _list_breaks(self.plan, AVERAGES * request.contour.window, end)
        else:
            kept = place(self.plan.cuts[0].middle)
            place = lambda time: kept  # noqa: E731
        if beside is None:
            return sample_motion(place, breaks, channels)
        shared = shared_rows(driven.trajectory, beside.state, self.state)
        return vary_motion(beside.sampled, place, channels, shared)

    def drive_screws(
        self, sampled: SampledMotion, times: FloatArray, cut: CutMotion
    ) -> tuple[ContourDrives, tuple[str, ...]]:
        """Return what motors do that follow their set points, and what is assumed of them.

        Args:
            times: ``(n,)`` steps [s].
        """
        trajectory, loads, names = (
            self.driven.trajectory,
            self.driven.trajectory.acting,
            tuple(self.screws),
        )

        def forces(some: NDArray[np.intp]) -> FloatArray:
            given = interpolate_smooth(loads.at, times[some])
            pushed = follow_outputs(
                sampled,
                times[some],
                outputs=self.pushes,
                coordinates=cut.history.compliant[some],
                acting=np.concatenate([cut.carried[some], given], axis=1),
                inputs=self.driven.inputs,
            )
            if trajectory.leg_forces is None:
                return pushed
            # a drive at the base of a leg also carries the leg, and pushes against what its tip feels
            return interpolate_smooth(trajectory.leg_forces, times[some]) - pushed

        torques, assumed = _motor_torques(self.state, names, trajectory, times)
        return ContourDrives(names, forces, torques), (IDEAL, *assumed)


def _join_errors(
    state: RunState, request: ContouringRequest, course: ContourTrajectory, end: float
) -> _CoupledContour:
    """Add the errors of a machine up to a time [s] to its contour."""
    trajectory, spacing = course.rigid, LOAD_SPACING
    errors = find_trajectory_errors(
        state, trajectory.pose_at, even_nodes(np.array([0.0, end]), NODE_SPACING)
    )
    if errors is not None:
        trajectory = errors.join(
            trajectory, lambda now: PathMotion(now, np.ones(len(now)), np.zeros(len(now)))
        )
        spacing = min(spacing, errors.shortest / STEPS_PER_WAVE)
    driven = DrivenTrajectory(trajectory, course.motors, _tool_channels(request))
    return _CoupledContour(state, request, course.plan, driven, spacing)


def coupled_face_dynamics(run: CoupledRun, request: ContouringRequest, face: int) -> TipDynamics:
    """The machine with its tool in the middle of a face: forces along, away and up, chips by
    motions along and away.

    What is left out deforms by a mode of its own in each direction, far above those that are
    kept.

    Args:
        request: Contour, tool and cut.
        face: Number of the straight cut, counted from zero.
    """
    cut = run.plan.cuts[face]
    now, tool = run.trajectory.sampled.at(np.array([cut.middle])), _tool_channels(request)
    frame: FloatArray = travel_frames(cut.travel[None], cut.part)[0]
    tip = frame @ now.rows_of(tool)[0]
    rest = frame @ now.direct_of(tool, tool)[0] @ frame.T
    # of unit mass, flexible as what is left out: shapes are its square root times the frequency
    omega = RESIDUAL_REACH * 2.0 * np.pi * max(run.highest_hz, request.modes_to_hz)
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
    extra = vectors * np.sqrt(np.maximum(values, 0.0)) * omega
    kept = tip.shape[1]
    stiffness, damping = (
        omega**2 * np.eye(kept + 3),
        2.0 * RESIDUAL_DAMPING * omega * np.eye(kept + 3),
    )
    stiffness[:kept, :kept], damping[:kept, :kept] = now.stiffness[0], now.damping[0]
    found = mount_modes(
        np.eye(kept + 3),
        damping,
        stiffness,
        np.concatenate([tip, extra], axis=1),
        turned_modes(request.tool_modes, frame.T),
    )
    return tip_dynamics(
        found.mass, found.damping, found.stiffness, forced=found.tip, seen=found.tip[:2]
    )


def _trace_tool(
    state: RunState, request: ContouringRequest
) -> tuple[tuple[str, ...], Callable[[FloatArray, PathPoints], FloatArray]]:
    """What is measured of a machine's motion, and where it leads the tool."""
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is not None:
        mounted, tool = mechanism.mounted, mechanism.tool
        return LENGTHS, lambda lengths, near: find_tool_positions(mounted, lengths, near, tool)
    travel = find_tool_travel(machine, machine.points[request.point or ""])
    return travel.axes, lambda positions, near: positions @ travel.directions.T


def _tool_direction(state: RunState) -> FloatArray | None:
    """Direction ``(3,)`` of a mechanism's tool; None of axes."""
    return None if state.scene.mechanism is None else state.scene.mechanism.tool


def _plan_trajectory(
    state: RunState, request: ContouringRequest, path: ToolPath
) -> RigidTrajectory:
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is None:
        travel = find_tool_travel(machine, machine.points[request.point or ""])
        trajectory = axes_trajectory(machine, travel, path)
        return dataclasses.replace(trajectory, amounts=Remembered(trajectory.amounts))

    def pose_at(time: float) -> Pose:
        x, y, z = path.at(np.array([time])).position[0].tolist()
        return Pose(f"t = {time:.4g} s", {"X": x, "Y": y, "Z": z})

    trajectory = mechanism_trajectory(
        state, mechanism, path, pose_at=pose_at, direction=mechanism.tool
    )
    forces = None if trajectory.leg_forces is None else Remembered(trajectory.leg_forces)
    return dataclasses.replace(
        trajectory, amounts=Remembered(trajectory.amounts), leg_forces=forces
    )


def _motor_torques(
    state: RunState, names: tuple[str, ...], trajectory: RigidTrajectory, times: FloatArray
) -> tuple[Callable[[NDArray[np.intp], FloatArray], FloatArray] | None, tuple[str, ...]]:
    """Torques of the motors: those of the screws, of the motors' inertia and of friction where the
    scene has drives; and what they leave out.
    """
    mechanism, machine = state.scene.mechanism, state.scene.machine
    if mechanism is not None:
        lead = mechanism.screw_lead
        if lead is None:
            return None, ()
        text = f"{OF_SCREWS}: no friction, no inertia of motor and screw"
        return lambda some, forces: forces * (lead / (2.0 * math.pi)), (text,)
    drives: dict[str, Drive] = {drive.axis: drive for drive in state.scene.drives.values()}
    screws = find_screws(machine)
    shafts = {name: machine.joints[screws[name][0]].screw for name in names}
    leads = {
        name: drives[name].lead if name in drives else (shaft.lead if shaft else 0.0)
        for name, shaft in shafts.items()
    }
    if not names or not all(leads.values()):
        return None, ()

    def torques(some: NDArray[np.intp], forces: FloatArray) -> FloatArray:
        found = forces * (np.array([leads[name] for name in names]) / (2.0 * math.pi))
        for number, name in enumerate(names):
            drive = drives.get(name)
            if drive is None or trajectory.axis_motion is None:
                continue
            found[:, number] += drive_torque(drive, *_axis_motion(trajectory, name, times[some]))
        return found

    left_out = [
        what
        for what, known in (
            ("inertia of motor and screw", bool(drives)),
            ("friction", any(drive.friction is not None for drive in drives.values())),
        )
        if not known
    ]
    text = f", plus the drives' own inertia{' and friction' if 'friction' not in left_out else ''}"
    return torques, (
        OF_SCREWS
        + (text if drives else "")
        + (f": no {', no '.join(left_out)}" if left_out else ""),
    )


def drive_torque(drive: Drive, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Torque ``(n,)`` that a motor needs beside the force of its screw: for its own inertia and
    that of its screw, and against friction [N m].

    Args:
        speed: ``(n,)`` of the axis [m/s].
        acceleration: ``(n,)`` [m/s^2].
    """
    turn = 2.0 * math.pi / drive.lead
    torque = (drive.motor_inertia + drive.screw_inertia) * turn * acceleration
    if drive.friction is not None:
        torque = torque + friction_force(drive.friction, speed) / turn
    return np.asarray(torque)


def _axis_motion(
    trajectory: RigidTrajectory, name: str, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    if trajectory.axis_motion is None or (name, "acceleration") not in trajectory.bodies:
        return np.zeros(len(times)), np.zeros(len(times))
    return trajectory.axis_motion(name, times)


def _check_steps(
    state: RunState, request: ContouringRequest, sampled: SampledMotion, step: float
) -> None:
    """Warn of modes that the steps do not resolve, and of effects that do not act."""
    if sampled.highest_hz * step * STEPS_PER_PERIOD > 1.0:
        needed = math.ceil(
            request.steps_per_turn * sampled.highest_hz * step * STEPS_PER_PERIOD / 24.0
        )
        state.warn(
            f"the highest mode of the contour, {sampled.highest_hz:.0f} Hz, has {1.0 / (sampled.highest_hz * step):.0f} time steps per period;"
            f" write steps_per_turn = {24 * needed} in [analyses.contouring], or a lower modes_to"
        )
