"""The path stage: how far a machine leaves a straight line while its axes accelerate, with ideal
motors or drives under control.

The machine is taken in one pose of the path, or as it changes along it. Control loops are judged
before any run in time. Only rank 0 has anything to do.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.machine.machine import Machine, travel_directions
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import FollowedPoses, PathCurves, PathResult, PathRun
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import MODE_MARGIN, PATH_STEPS_PER_TURN, path_band
from headstock.pipeline.stages.control import drive_along, drive_machine
from headstock.pipeline.stages.machine import CoupledPose, damp_system, warn_of_no_damping
from headstock.pipeline.stages.motion_forces import (
    add_to_drives,
    read_joints,
    record_drives,
    watch_drives,
    watch_joints,
)
from headstock.pipeline.stages.probe_motions import (
    place_probes,
    probe_outputs,
    read_probes,
    watch_probes,
)
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.error_travel import offset_loads
from headstock.reduction.coupling.joint_forces import JointForces, joint_outputs
from headstock.reduction.coupling.path_loads import (
    PATH_INPUT,
    add_driven_path_input,
    add_path_input,
    find_rigid_travels,
    stack_driven_modes,
    stack_modes,
)
from headstock.reduction.coupling.probes import PlacedProbe, travel_inertia
from headstock.reduction.estimates.probe_errors import SEEN
from headstock.reduction.motions.path_errors import (
    NODES,
    STEPS_PER_WAVE,
    PathErrors,
    add_deviations,
    find_path_errors,
    respond_to_errors,
)
from headstock.scene.requests import PathCut, PathRequest
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.control.driven_motion import DrivenMotion
from headstock.solvers.control.friction_loop import friction_channels
from headstock.solvers.control.stability import require_stable
from headstock.solvers.errors import ModelError, UnstableControlError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.paths.controlled import (
    ControlledPath,
    solve_controlled_path,
    solve_rubbing_path,
)
from headstock.solvers.paths.disturbed import solve_disturbed_loop
from headstock.solvers.paths.loads import PathLoads, cut_times
from headstock.solvers.paths.response import (
    PathDeviation,
    PathModel,
    filter_deviation,
    measure_cruise,
    measure_zones,
    sample_times,
    slow_modes,
    solve_path,
)
from headstock.solvers.paths.set_points import SetPoint, sample_move
from headstock.solvers.paths.varying_control import (
    LoopTable,
    VaryingLoop,
    loop_channels,
    make_loop_table,
    solve_varying_control,
    solve_varying_rubbing,
)
from headstock.solvers.paths.varying_response import StepTable, make_step_table, solve_varying_path
from headstock.solvers.paths.varying_system import (
    PosedModes,
    VaryingSystem,
    sample_plant,
    sample_system,
)
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Extreme

ENERGY_LIMIT = 1e-6
# modes up to so many times the band looked at are states of the loop, the others act at once; fewer
# where a stiff integrator has them, or where they are interpolated along the path
LINEAR_REACH, FRICTION_REACH, VARYING_REACH = 12.0, 3.0, 3.0


def _pushed_channels(request: PathRequest) -> tuple[Channel, ...]:
    """Where the cut pushes."""
    return () if request.cut is None else tuple((request.cut.at, dof) for dof in DIRECTIONS)


def _close_path(
    state: RunState,
    request: PathRequest,
    posed: CoupledPose,
    low_frequency_limit_hz: float,
    *,
    reach: float | None = None,
) -> ControlledPath:
    """The closed loop of a scene's drives in a pose of the path.

    Args:
        state: Of the run.
        request: The path.
        posed: The machine in the pose.
        low_frequency_limit_hz: Below it poles are rigid-body motion [Hz].
        reach: Modes up to so many times the band are states; None for the usual number.

    Raises:
        UnstableControlError: A pole grows.
    """
    driven = drive_machine(posed, state.warn)
    require_stable(driven.system, driven.trains)
    channels, joints = friction_channels(driven.trains), driven.released.joints
    probes = place_probes(state.parts, driven.released.coupled, tuple(state.scene.machine.probes))
    own = joint_outputs(joints) | probe_outputs(state.parts, probes)
    watched = watch_joints(joints).join(watch_probes(probes))
    cut = request.cut
    pushed = _pushed_channels(request)
    reach = reach or (FRICTION_REACH if channels else LINEAR_REACH)
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    return ControlledPath(
        loop=close_loops(
            dataclasses.replace(driven.system, outputs=driven.system.outputs | own),
            driven.trains,
            inputs=(*pushed, *channels),
            outputs=(*request.outputs, *own),
            up_to_hz=reach * path_band(request),
        ),
        shares=axis_shares(request),
        travel=np.array(
            [
                _travel_of_channel(machine, directions, name=name, dof=dof)
                for name, dof in request.outputs
            ]
        ),
        low_frequency_limit_hz=low_frequency_limit_hz,
        loads=_path_loads(machine, directions, cut),
        watched=watched.join(watch_drives(state.scene.drives.values())),
    )


def _path_loads(
    machine: Machine, directions: Mapping[str, FloatArray], cut: PathCut | None
) -> PathLoads | None:
    if cut is None:
        return None
    step = 2.0 * math.pi / cut.cut.spindle / PATH_STEPS_PER_TURN
    return PathLoads(cutting_loads(cut, _tool_travel(machine, directions, cut.at)), step)


def _drive_path(
    state: RunState, path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation over a move, with friction where the scene names it."""
    if not friction_channels(path.loop.trains):
        return solve_controlled_path(path, move, samples)
    deviation, motion = solve_rubbing_path(path, move, samples)
    _judge_energy(state, motion, move)
    return deviation


def _judge_energy(state: RunState, motion: DrivenMotion, move: SetPoint) -> None:
    if motion.energy.error > ENERGY_LIMIT:
        state.warn(
            f"path analysis at {6e4 * move.feed:g} mm/min: the energy balance misses {motion.energy.error:.2g} of the work, more than"
            f" {ENERGY_LIMIT:g}; give friction a larger smoothing"
        )
    state.energy_errors[f"{6e4 * move.feed:g} mm/min"] = motion.energy.error


def cutting_loads(
    request: PathCut, travel: FloatArray
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Forces on the tool ``(n, 3)`` in machine axes, at instants and speeds along the path.

    Args:
        request: The cut.
        travel: ``(3,)`` of the tool against the work per travel along the path.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    up = np.array(request.up)
    along = travel - (travel @ up) * up
    size = float(np.linalg.norm(along))
    if size < 1e-9:
        raise ModelError(
            f"the path does not move {request.at} across the tool, so nothing is milled; write another path or `up`"
        )
    along = along / size
    # the part lies on the right of the travel, seen from above
    turn = np.array([along, np.cross(up, along), up])
    return lambda times, speeds: cutting_forces(request.cut, times, size * speeds) @ turn


def _tool_travel(machine: Machine, directions: Mapping[str, FloatArray], point: str) -> FloatArray:
    return np.array(
        [_travel_of_channel(machine, directions, name=point, dof=dof) for dof in DIRECTIONS]
    )


def axis_shares(request: PathRequest) -> dict[str, float]:
    """Travel of each axis per travel along the path."""
    start, end = request.path.start.positions, request.path.end.positions
    return {
        axis: (end.get(axis, 0.0) - start.get(axis, 0.0)) / request.path.length
        for axis in request.path.axes
    }


def _travel_of_channel(
    machine: Machine, directions: Mapping[str, FloatArray], *, name: str, dof: str
) -> float:
    """How the rigid machine moves a point per travel along a path; axes that move do not turn."""
    if dof not in DIRECTIONS:
        return 0.0
    rest = np.zeros(3)
    if name not in machine.points:
        return float(directions.get(name.partition(".")[0], rest)[DOF_NAMES.index(dof)])
    point = machine.points[name]
    tool, work = (directions.get(end.component or "", rest) for end in (point.tool, point.work))
    return float((tool - work)[DOF_NAMES.index(dof)])


@dataclass(frozen=True, eq=False)
class SolvedMoves:
    """Deviations before any filter, one per feed.

    Attributes:
        found: What holds.
        kept: In the pose of the middle.
        forces: One per feed; of joints those in the pose of the middle.
        poses: How the poses of the path were followed; None where they were not.
        disturbed: Errors of guides or torque ripple are among what deviates.
    """

    found: tuple[PathDeviation, ...]
    kept: tuple[PathDeviation, ...]
    forces: tuple[PathForces, ...]
    poses: FollowedPoses | None = None
    disturbed: bool = False


def choose_model(request: PathRequest) -> PathModel:
    """The quasi-static share and the residual vibration: a mode whose period is longer than a ramp does not follow it."""
    return PathModel(
        PATH_INPUT,
        request.outputs,
        1.0 / request.moves[0].ramp.time_constant,
        MODE_MARGIN * path_band(request),
    )


def _build_plant(state: RunState, request: PathRequest, position: float) -> PosedModes:
    """The machine at a position of the path [m]: the damping the scene names, and the acceleration
    along the path as an input.
    """
    parts, pose = state.parts, request.path.pose_at(position)
    coupled = couple(parts.superelements, state.scene.machine, pose)
    modes = solve_modal(coupled.system)
    for message in warn_of_no_damping(state.scene, coupled.system):
        state.warn(message)
    damped = damp_system(state.scene, coupled.system, modes)
    travels = travel_directions(state.scene.machine, request.path)
    return stack_modes(add_path_input(damped, coupled, travels), modes, coupled)


def _solve_moves(state: RunState, request: PathRequest, middle: PosedModes) -> SolvedMoves:
    """Deviation of every move: with the drives of the scene under control, or with motors that
    follow their set point.

    Raises:
        UnstableControlError: A control loop is.
    """
    model = choose_model(request)
    errors = find_path_errors(
        state.parts.superelements,
        state.scene.machine,
        request.path,
        request.outputs,
        nodes=NODES if request.follows_pose else 1,
    )
    drives = state.scene.drives
    solved = (
        _drive_moves(state, request, model)
        if drives
        else _move_freely(state, request, middle, model)
    )
    if errors is None and not any(drive.ripple for drive in drives.values()):
        return solved
    disturbed = [
        _disturb_loop(state, request, errors, move)
        if drives or errors is None
        else respond_to_errors(
            errors,
            middle.system,
            move,
            samples=sample_path(request, move),
            low_frequency_limit_hz=model.low_frequency_limit_hz,
        )
        for move in request.moves
    ]
    posed = [
        own if errors is None else errors.follow_pose(own, move)
        for own, move in zip(disturbed, request.moves, strict=True)
    ]
    forces = tuple(
        own
        if other.watched is None
        else dataclasses.replace(
            own,
            drives=add_to_drives(own.drives, drives.values(), other.times, other.watched),
        )
        for own, other in zip(solved.forces, disturbed, strict=True)
    )
    return dataclasses.replace(
        solved,
        found=tuple(map(add_deviations, solved.found, posed)),
        kept=tuple(map(add_deviations, solved.kept, disturbed)),
        forces=forces,
        disturbed=True,
    )


def _disturb_loop(
    state: RunState, request: PathRequest, errors: PathErrors | None, move: SetPoint
) -> PathDeviation:
    """Deviation by errors of guides and torque ripple over a move under control, in the pose of the
    middle, from that at its beginning.
    """
    driven = drive_machine(_couple_at(state, request, 0.5 * request.path.length), state.warn)
    if friction_channels(driven.trains):
        state.warn(
            "path analysis: errors of guides and torque ripple move the machine as if nothing rubbed; what friction does is added"
        )
    system = driven.system
    channels: tuple[Channel, ...] = ()
    shortest = math.inf
    if errors is not None:
        shortest, channels = errors.shortest, errors.travel.channels
        rows = offset_loads(driven.coupled.joint_springs, errors.travel.directions)
        own = {channel: rows[:, number] for number, channel in enumerate(channels)}
        system = dataclasses.replace(system, inputs={**system.inputs, **own})
    rippling = [drive for drive in state.scene.drives.values() if drive.ripple]
    channels = (*channels, *((drive.name, FORCE) for drive in rippling))

    def loads(times: FloatArray) -> FloatArray:
        way = sample_move(move, times).positions
        parts = [] if errors is None else [errors.offsets(move, times)]
        return np.hstack([*parts, *(_path_ripple(drive, request, way) for drive in rippling)])

    loop = close_loops(
        system,
        driven.trains,
        inputs=channels,
        outputs=request.outputs,
        up_to_hz=LINEAR_REACH * path_band(request),
    )
    return solve_disturbed_loop(
        loop.space,
        len(request.outputs),
        loads,
        channels=channels,
        samples=sample_path(request, move),
        load_step=min(shortest, shortest_ripple(rippling, request)) / move.feed / STEPS_PER_WAVE,
        watch=watch_drives(state.scene.drives.values()),
    )


def _path_ripple(drive: Drive, request: PathRequest, way: FloatArray) -> FloatArray:
    """Force ``(n, 1)`` of a drive along ``(n,)`` places of a path by the ripple of its torque, from
    that at the beginning [N].
    """
    start = request.path.start.positions.get(drive.axis, 0.0)
    share = axis_shares(request).get(drive.axis, 0.0)
    found = ripple_force(drive, start + share * way)
    return (found - ripple_force(drive, np.array([start])))[:, None]


def shortest_ripple(drives: Sequence[Drive], request: PathRequest) -> float:
    """Shortest wave of motor torques along the path [m]; infinite without any."""
    shares = axis_shares(request)
    return min(
        (
            drive.lead / wave.per_turn / abs(shares[drive.axis])
            for drive in drives
            if shares.get(drive.axis)
            for wave in drive.ripple
        ),
        default=math.inf,
    )


def _move_freely(
    state: RunState, request: PathRequest, middle: PosedModes, model: PathModel
) -> SolvedMoves:
    """Deviation of every move by its acceleration and the cut, with motors that follow their set
    point.
    """
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    loads = _path_loads(machine, directions, request.cut)
    model = dataclasses.replace(model, pushed=_pushed_channels(request), loads=loads)
    posed = _couple_at(state, request, 0.5 * request.path.length)
    joints = posed.joints
    probes = place_probes(state.parts, posed.coupled, tuple(machine.probes))
    own = joint_outputs(joints) | probe_outputs(state.parts, probes)
    watched = watch_joints(joints).join(watch_probes(probes))
    whole = dataclasses.replace(model, up_to_hz=None, watched=watched)
    system = dataclasses.replace(middle.system, outputs=middle.system.outputs | own)
    kept = tuple(
        solve_path(system, whole, move, sample_path(request, move)) for move in request.moves
    )
    carried = np.concatenate(
        [
            np.zeros(0),
            *(
                travel_inertia(posed.coupled, machine.probes[name], directions[probe.component])
                if probe.component in directions
                else np.zeros(SEEN)
                for name, probe in probes.items()
            ),
        ]
    )
    forces = tuple(
        PathForces(
            record_drives((), each.times, none, none),
            read_joints(joints, each),
            # the acceleration of the travel is none of the deviation
            _read_probes(
                probes,
                joints,
                each,
                -np.outer(sample_move(move, each.times).accelerations, carried),
            ),
        )
        for move, each in zip(request.moves, kept, strict=True)
        for none in (np.zeros((len(each.times), 0)),)
    )
    if not request.follows_pose:
        return SolvedMoves(kept, kept, forces)
    along = sample_system(
        lambda position: _build_plant(state, request, position), request.path.length, model
    )
    fine, _ = cut_times(sample_path(request, request.moves[0]), loads)
    table = make_step_table(along, float(fine[1] - fine[0]))
    found = tuple(
        solve_varying_path(along, model, move, sample_path(request, move), table)
        for move in request.moves
    )
    move = request.moves[-1]
    short = solve_path(middle.system, model, move, sample_path(request, move))
    return SolvedMoves(
        found,
        kept,
        forces,
        _judge_poses(request, along, table, found=found, kept=kept, short=short, whole=kept[-1]),
    )


def _drive_moves(state: RunState, request: PathRequest, model: PathModel) -> SolvedMoves:
    """The same under control."""
    middle = _couple_at(state, request, 0.5 * request.path.length)
    loop = _close_path(state, request, middle, model.low_frequency_limit_hz)
    kept = tuple(
        _drive_path(state, loop, move, sample_path(request, move)) for move in request.moves
    )
    shares = [loop.shares.get(train.axis, 0.0) for train in loop.loop.trains]
    released = middle.release(state.scene.drives.values()).model
    joints = released.joints
    probes = place_probes(state.parts, released.coupled, tuple(state.scene.machine.probes))
    directions = travel_directions(state.scene.machine, request.path)
    travel = np.concatenate(
        [
            np.zeros(0),
            *(
                np.pad(directions.get(probe.component, np.zeros(3)), (0, SEEN - 3))
                for probe in probes.values()
            ),
        ]
    )
    taken = [
        (
            read_joints(joints, each),
            _read_probes(
                probes, joints, each, -np.outer(sample_move(move, each.times).positions, travel)
            ),
        )
        for move, each in zip(request.moves, kept, strict=True)
    ]
    if not request.follows_pose:
        return SolvedMoves(kept, kept, _read_forces(state, request, kept, shares, taken))
    along = _close_along(state, request, middle, model.low_frequency_limit_hz)
    fine, _ = cut_times(sample_path(request, request.moves[0]), along.loads)
    table = make_loop_table(along, float(fine[1] - fine[0]))
    found = tuple(
        _drive_along(state, along, move, sample_path(request, move), table)
        for move in request.moves
    )
    move = request.moves[-1]
    samples = sample_path(request, move)
    whole, short = (
        solve_controlled_path(
            _close_path(state, request, middle, model.low_frequency_limit_hz, reach=reach),
            move,
            samples,
        )
        for reach in (LINEAR_REACH, VARYING_REACH)
    )
    poses = _judge_poses(
        request, along.plant, table.steps, found=found, kept=kept, short=short, whole=whole
    )
    # what a controller reads is there the deviation from the rigid machine
    shares = [travel.axis - travel.encoder for travel in along.travels]
    return SolvedMoves(found, kept, _read_forces(state, request, found, shares, taken), poses)


def _read_forces(
    state: RunState,
    request: PathRequest,
    found: Sequence[PathDeviation],
    shares: Sequence[float],
    taken: Sequence[tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]],
) -> tuple[PathForces, ...]:
    """What drives did on every move, with what joints took and probes saw.

    Args:
        state: Of the run.
        request: The path.
        found: Watched at last are the forces of all drives, then what they read.
        shares: Of each drive, what it should read per travel along the path.
        taken: By joints, and seen by probes, on every move.
    """
    drives, forces = tuple(state.scene.drives.values()), []
    for move, each, own in zip(request.moves, found, taken, strict=True):
        if each.watched is None:
            raise ValueError("a path under control watches its drives")
        way = sample_move(move, each.times).positions
        pushed, read = np.split(each.watched[:, -2 * len(drives) :], 2, axis=1)
        history = record_drives(drives, each.times, pushed, np.outer(way, shares) - read)
        forces.append(PathForces(history, *own))
    return tuple(forces)


def _read_probes(
    probes: Mapping[str, PlacedProbe],
    joints: Sequence[JointForces],
    found: PathDeviation,
    added: FloatArray,
) -> dict[str, ProbeMotion]:
    """What probes saw on a move, which watched them after the joints.

    Args:
        probes: ``p`` of them.
        joints: Before them.
        found: The move.
        added: ``(n, 9 p)`` what is to be added.
    """
    if found.watched is None or not probes:
        return {}
    first = sum(len(joint.directions) for joint in joints)
    seen = found.watched[:, first : first + added.shape[1]]
    return read_probes(probes, found.times, seen + added)


def _couple_at(state: RunState, request: PathRequest, position: float) -> CoupledPose:
    pose = request.path.pose_at(position)
    coupled = couple(state.parts.superelements, state.scene.machine, pose)
    return CoupledPose(state.parts, pose, coupled)


def _close_along(
    state: RunState, request: PathRequest, middle: CoupledPose, low_frequency_limit_hz: float
) -> VaryingLoop:
    """The closed loops of a scene's drives as the pose changes, judged in every pose in which the
    machine is coupled.

    Raises:
        UnstableControlError: A pole grows in one of them.
    """
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    trains = middle.release(state.scene.drives.values()).trains
    travels = find_rigid_travels(middle.coupled, trains, directions, axis_shares(request))
    channels = loop_channels(
        trains,
        path=PATH_INPUT,
        loads=_pushed_channels(request),
        outputs=request.outputs,
        up_to_hz=VARYING_REACH * path_band(request),
    )

    def place(position: float) -> PosedModes:
        driven = drive_along(_couple_at(state, request, position), position, state.warn)
        system = add_driven_path_input(
            driven.system, driven.coupled, driven.trains, directions, travels
        )
        return stack_driven_modes(system, driven.modes, driven.coupled, driven.trains)

    return VaryingLoop(
        plant=sample_plant(place, request.path.length, channels),
        channels=channels,
        trains=trains,
        travels=travels,
        count=len(request.outputs),
        low_frequency_limit_hz=low_frequency_limit_hz,
        loads=_path_loads(machine, directions, request.cut),
        watched=watch_drives(state.scene.drives.values()).channels,
    )


def _drive_along(
    state: RunState, loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: LoopTable
) -> PathDeviation:
    """Deviation over a move as the pose changes, with friction where the scene names it."""
    if not friction_channels(loop.trains):
        return solve_varying_control(loop, move, samples, table)
    deviation, motion = solve_varying_rubbing(loop, move, samples, table)
    _judge_energy(state, motion, move)
    return deviation


def sample_path(request: PathRequest, move: SetPoint) -> FloatArray:
    """Instants of a move [s]."""
    return sample_times(move, request.sampling_hz, request.residual_time)


def _judge_poses(
    request: PathRequest,
    system: VaryingSystem[Any],
    table: StepTable,
    *,
    found: tuple[PathDeviation, ...],
    kept: tuple[PathDeviation, ...],
    short: PathDeviation,
    whole: PathDeviation,
) -> FollowedPoses:
    """What following the poses took, and what it is worth: that modes are kept only up to a
    frequency is judged in the middle, with some and with all.
    """

    def show(deviation: PathDeviation) -> FloatArray:
        return filter_deviation(deviation, request.low_pass).total

    full = show(whole)
    return FollowedPoses(
        sampled_poses=len(system.positions),
        error=system.error,
        rotation_error=system.rotation_error,
        modes=len(system.scales),
        next_hz=None if np.isinf(system.next_hz) else system.next_hz,
        steps=len(table.spline.x),
        truncation=float(
            np.abs(show(short) - full).max() / max(np.abs(full).max(), np.finfo(float).tiny)
        ),
        effect=tuple(
            float(np.abs(show(ours) - show(theirs)).max())
            for ours, theirs in zip(found, kept, strict=True)
        ),
    )


def run_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Deviation at every output along the path of axes, once per feed: as the pose changes, and as if
    it stayed that of the middle.
    """
    request = state.scene.analyses.path
    if not state.is_root:
        return Outcome()
    if request is None:
        raise ValueError("a path stage needs a path analysis in the scene")
    middle = _build_plant(state, request, 0.5 * request.path.length)
    return answer_path(
        state,
        request,
        frequencies_hz=middle.modes.frequencies_hz,
        damped=middle.system.damping is not None or middle.system.hysteretic is not None,
        solve=lambda: _solve_moves(state, request, middle),
    )


def answer_path(
    state: RunState,
    request: PathRequest,
    *,
    frequencies_hz: FloatArray,
    damped: bool,
    solve: Callable[[], SolvedMoves],
) -> Outcome:
    """What is said of a path.

    Args:
        state: Of the run.
        request: The path.
        frequencies_hz: Of the machine in its middle [Hz].
        damped: Any damping is on.
        solve: Its moves.
    """
    if not damped:
        state.warn(
            'path analysis: nothing is damped, so residual vibration does not decay; write [effects] damping = { modal = "2 %" }'
        )
    try:
        solved = solve()
    except (UnstableControlError, ModelError) as error:
        return Outcome(detail="refused: see below", failures=(f"path analysis: {error}",))
    model, ramp = choose_model(request), request.moves[0].ramp
    answer = PathResult(
        start=dict(request.path.start.positions),
        end=dict(request.path.end.positions),
        length=request.path.length,
        ramp=ramp.kind,
        time_constant=ramp.time_constant,
        sampling_hz=request.sampling_hz,
        lowpass_hz=None if request.low_pass is None else request.low_pass.frequency_hz,
        filter="none" if request.low_pass is None else request.low_pass.kind,
        damped=damped,
        low_frequency_limit_hz=model.low_frequency_limit_hz,
        low_frequency_modes=slow_modes(frequencies_hz, model.low_frequency_limit_hz),
        poses=solved.poses,
        runs=tuple(
            _run_move(request, move, raw, kept, forces, disturbed=solved.disturbed)
            for move, raw, kept, forces in zip(
                request.moves, solved.found, solved.kept, solved.forces, strict=True
            )
        ),
        drives=tuple(state.scene.drives),
        energy_error=dict(state.energy_errors),
    )
    samples = sum(len(found.times) for found in solved.found)
    poses = "" if solved.poses is None else f", {solved.poses.sampled_poses} poses"
    return Outcome(
        detail=f"{len(solved.found)} feed{'s' if len(solved.found) > 1 else ''}, {samples} samples{poses}",
        answers=(answer,),
    )


def _run_move(
    request: PathRequest,
    move: SetPoint,
    raw: PathDeviation,
    kept: PathDeviation,
    forces: PathForces,
    *,
    disturbed: bool,
) -> PathRun:
    """The deviation of one move as filtered, with its figures; and as if the pose were kept. Forces
    are not filtered.
    """
    found, frozen = (filter_deviation(part, request.low_pass) for part in (raw, kept))
    motion = sample_move(move, found.times)
    curves = PathCurves(
        move.feed,
        move.zones,
        request.outputs,
        found,
        frozen.total,
        motion.positions,
        motion.accelerations,
        drives=tuple(forces.drives.extremes),
        torques=forces.drives.torques,
        position_errors=forces.drives.position_errors,
        probes=tuple(probe.trace for probe in forces.probes.values()),
    )
    channels = range(len(request.outputs))
    return PathRun(
        curves,
        figures=tuple(
            measure_zones(found, raw, move, channel, request.residual_time) for channel in channels
        ),
        frozen_figures=tuple(
            measure_zones(frozen, kept, move, channel, request.residual_time)
            for channel in channels
        ),
        cruises=tuple(
            measure_cruise(found, move, channel, request.residual_time) for channel in channels
        )
        if disturbed
        else (),
        drives=forces.drives.extremes,
        joints=forces.joints,
        probes=forces.probes,
    )
