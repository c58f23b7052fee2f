"""A path of linear axes, with motors that follow their set points or under control, in one pose or as
the pose changes along it, with what errors of guides and torque ripple add. Control loops are checked
for stability before any run in time.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.answers.motion_forces import PathForces, ProbeMotion
from headstock.pipeline.motion.motion_forces import record_drives, watch_drives
from headstock.pipeline.motion.path_model import (
    SolvedMoves,
    add_watched,
    axis_shares,
    choose_model,
    couple_at,
    evaluate_poses,
    observe_path,
    path_loads,
    sample_path,
    travel_of_channel,
)
from headstock.pipeline.motion.probe_motions import probe_values
from headstock.pipeline.stages.control import drive_along, drive_machine
from headstock.pipeline.stages.machine import CoupledPose, damp_system, warn_of_no_damping
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.drives import housing_rows, scale_rows
from headstock.reduction.coupling.error_travel import find_offset_motions
from headstock.reduction.coupling.path_loads import (
    PATH_INPUT,
    add_driven_path_input,
    add_path_input,
    find_rigid_travels,
    housing_loads,
    stack_driven_modes,
    stack_modes,
)
from headstock.reduction.coupling.probes import travel_inertia
from headstock.reduction.estimates.static_errors import SEEN
from headstock.reduction.motions.path_errors import (
    STEPS_PER_WAVE,
    PathErrors,
    add_error_inputs,
    pass_offsets,
    respond_to_errors,
)
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.control.drive_loops import ENCODER, close_loops
from headstock.solvers.control.drive_trains import FORCE, SCALE
from headstock.solvers.control.stability import require_stable
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.state_space import Feedthrough
from headstock.solvers.motion.closed_loop import (
    ControlledPath,
    LoopTable,
    VaryingLoop,
    loop_channels,
    make_loop_table,
    solve_controlled_path,
    solve_path_with_friction,
    solve_varying_control,
    solve_varying_friction,
)
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.driven_motion import DrivenMotion
from headstock.solvers.motion.exact import (
    Disturbance,
    PathModel,
    make_step_table,
    solve_loop_loads,
    solve_path,
    solve_varying_path,
)
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.motion.sampling import sample_plant, sample_system
from headstock.solvers.motion.set_points import SetPoint, cut_times, load_channels, sample_move
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Extreme


def build_plant(state: RunState, request: PathRequest, position: float) -> PosedModes:
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


def move_freely(
    state: RunState,
    request: PathRequest,
    middle: PosedModes,
    model: PathModel,
    disturbed: Sequence[PathDeviation | None],
) -> SolvedMoves:
    """Deviation of every move by its acceleration and the cut, with motors that follow their set
    point.

    Args:
        disturbed: Every move as errors of guides disturb it; None for nothing.
    """
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    loads = path_loads(machine, directions, request.cut)
    model = dataclasses.replace(model, loads=loads)
    posed = couple_at(state, request, 0.5 * request.path.length)
    observers = observe_path(state, posed)
    whole = dataclasses.replace(model, up_to_hz=None, watched=observers.watch)
    system = observers.join(middle.system)
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
                for name, probe in observers.probes.items()
            ),
        ]
    )
    forces = tuple(
        PathForces(
            record_drives((), each.times, none, none),
            *observers.read(each, carried, sample_move(move, each.times).accelerations),
        )
        for move, each in zip(request.moves, map(add_watched, kept, disturbed), strict=True)
        for none in (np.zeros((len(each.times), 0)),)
    )
    if not request.follows_pose:
        return SolvedMoves(kept, kept, forces)
    along = sample_system(
        lambda position: build_plant(state, request, position), request.path.length, model
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
        evaluate_poses(request, along, table, found=found, kept=kept, short=short, whole=kept[-1]),
    )


ENERGY_LIMIT = 1e-6
# modes up to so many times the band looked at are states of the loop, the others act at once; fewer
# with friction, whose steps take all states together, or where they are interpolated along the path
LINEAR_REACH, FRICTION_REACH, VARYING_REACH = 12.0, 3.0, 3.0


def close_path(
    state: RunState,
    request: PathRequest,
    posed: CoupledPose,
    low_frequency_limit_hz: float,
    *,
    reach: float | None = None,
) -> ControlledPath:
    """The closed loop of a scene's drives in a pose of the path.

    Args:
        low_frequency_limit_hz: Below it poles are rigid-body motion [Hz].
        reach: Modes up to so many times the band are states; None for the usual number.

    Raises:
        UnstableControlError: A pole grows.
    """
    driven = drive_machine(posed, state.warn)
    require_stable(driven.system, driven.trains)
    channels, observers = friction_channels(driven.trains), observe_path(state, driven.released)
    reach = reach or (FRICTION_REACH if channels else LINEAR_REACH)
    machine = state.scene.machine
    directions = travel_directions(machine, request.path)
    loads = path_loads(machine, directions, request.cut)
    return ControlledPath(
        loop=close_loops(
            observers.join(driven.system),
            driven.trains,
            inputs=(*load_channels(loads), *channels),
            outputs=(*request.outputs, *observers.outputs),
            up_to_hz=reach * request.band_hz,
        ),
        outputs=request.outputs,
        shares=axis_shares(request),
        travel=np.array(
            [
                travel_of_channel(machine, directions, name=name, dof=dof)
                for name, dof in request.outputs
            ]
        ),
        low_frequency_limit_hz=low_frequency_limit_hz,
        loads=loads,
        watched=observers.watch.join(watch_drives(state.scene.drives.values())),
    )


def drive_path(
    state: RunState, path: ControlledPath, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation over a move, with friction where the scene names it."""
    if not friction_channels(path.loop.trains):
        return solve_controlled_path(path, move, samples)
    deviation, motion = solve_path_with_friction(path, move, samples)
    _check_energy(state, motion, move)
    return deviation


def _check_energy(state: RunState, motion: DrivenMotion, move: SetPoint) -> None:
    """Warns where the energy balance of a move with friction misses too much."""
    if motion.energy.error > ENERGY_LIMIT:
        state.warn(
            f"path analysis at {move.name}: the energy balance misses {motion.energy.error:.2g} of the work, more than"
            f" {ENERGY_LIMIT:g}; give friction a larger smoothing"
        )
    state.energy_errors[move.name] = motion.energy.error


def close_along(
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
    loads = path_loads(machine, directions, request.cut)
    channels = loop_channels(
        trains,
        path=PATH_INPUT,
        loads=load_channels(loads),
        outputs=request.outputs,
        up_to_hz=VARYING_REACH * request.band_hz,
    )

    def place(position: float) -> PosedModes:
        driven = drive_along(couple_at(state, request, position), position, state.warn)
        system = add_driven_path_input(
            driven.system, driven.coupled, driven.trains, directions, travels
        )
        return stack_driven_modes(system, driven.modes, driven.coupled, driven.trains)

    return VaryingLoop(
        plant=sample_plant(place, request.path.length, channels),
        path=PATH_INPUT,
        outputs=request.outputs,
        trains=trains,
        travels=travels,
        low_frequency_limit_hz=low_frequency_limit_hz,
        loads=loads,
        watched=watch_drives(state.scene.drives.values()).channels,
    )


def move_along(
    state: RunState, loop: VaryingLoop, move: SetPoint, samples: FloatArray, table: LoopTable
) -> PathDeviation:
    """Deviation over a move as the pose changes, with friction where the scene names it."""
    if not friction_channels(loop.trains):
        return solve_varying_control(loop, move, samples, table)
    deviation, motion = solve_varying_friction(loop, move, samples, table)
    _check_energy(state, motion, move)
    return deviation


def disturb_loop(
    state: RunState, request: PathRequest, errors: PathErrors | None, move: SetPoint
) -> PathDeviation:
    """Deviation by errors of guides and torque ripple over a move under control, in the pose of the
    middle, from that at its beginning.
    """
    driven = drive_machine(couple_at(state, request, 0.5 * request.path.length), state.warn)
    if friction_channels(driven.trains):
        state.warn(
            "path analysis: errors of guides and torque ripple move the machine as if there were no friction; what friction does is added"
        )
    observers, machine = observe_path(state, driven.released), state.scene.machine
    system = observers.join(driven.system)
    channels: tuple[Channel, ...] = ()
    shortest = math.inf
    passed: Feedthrough | None = None
    if errors is not None:
        shortest = errors.shortest
        drives = tuple(state.scene.drives.values())
        read = [drive for drive in drives if drive.control.encoder == SCALE]
        motions = find_offset_motions(
            driven.coupled,
            errors.travel,
            system,
            unmoved=scale_rows(driven.coupled, machine, read),
        )
        turned = housing_rows(driven.coupled, machine, drives) @ motions.moved
        spun = housing_loads(driven.trains, turned, len(system.mass))
        motions = dataclasses.replace(motions, accelerations=motions.accelerations + spun)
        system, channels = add_error_inputs(system, errors.travel, motions)
        passed = pass_offsets(
            driven.coupled,
            errors.travel,
            motions,
            request.outputs,
            observers.joints,
            probe_values(observers.probes),
        )
    rippling = [drive for drive in state.scene.drives.values() if drive.ripple]
    channels = (*channels, *((drive.name, FORCE) for drive in rippling))

    def loads(times: FloatArray) -> FloatArray:
        positions = sample_move(move, times).positions
        parts = [] if errors is None else [errors.amounts(move, times)]
        return np.hstack([*parts, *(_path_ripple(drive, request, positions) for drive in rippling)])

    loop = close_loops(
        system,
        driven.trains,
        inputs=channels,
        outputs=(*request.outputs, *observers.outputs),
        up_to_hz=LINEAR_REACH * request.band_hz,
    )
    step = min(shortest, _shortest_ripple(rippling, request)) / move.feed / STEPS_PER_WAVE
    return solve_loop_loads(
        loop.space,
        request.outputs,
        Disturbance(channels, loads, step, passed),
        samples=sample_path(request, move),
        watch=observers.watch.join(watch_drives(state.scene.drives.values())),
    )


def disturb_freely(
    state: RunState,
    request: PathRequest,
    errors: PathErrors,
    move: SetPoint,
    middle: PosedModes,
) -> PathDeviation:
    """The same with motors that follow their set point."""
    posed = couple_at(state, request, 0.5 * request.path.length)
    observers = observe_path(state, posed)
    return respond_to_errors(
        errors,
        observers.join(middle.system),
        move,
        samples=sample_path(request, move),
        low_frequency_limit_hz=choose_model(request).low_frequency_limit_hz,
        joints=observers.joints,
        probes=probe_values(observers.probes),
        watch=observers.watch,
    )


def _path_ripple(drive: Drive, request: PathRequest, positions: FloatArray) -> FloatArray:
    """Force ``(n, 1)`` of a drive along ``(n,)`` places of a path by the ripple of its torque, from
    that at the beginning [N].
    """
    start = request.path.start.positions.get(drive.axis, 0.0)
    share = axis_shares(request).get(drive.axis, 0.0)
    found = ripple_force(drive, start + share * positions)
    return (found - ripple_force(drive, np.array([start])))[:, None]


def _shortest_ripple(drives: Sequence[Drive], request: PathRequest) -> float:
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


def drive_moves(
    state: RunState,
    request: PathRequest,
    model: PathModel,
    disturbed: Sequence[PathDeviation | None],
) -> SolvedMoves:
    """Deviation of every move with the drives of the scene under control.

    Args:
        disturbed: Every move as errors of guides and torque ripple disturb it; None for nothing.
    """
    middle = couple_at(state, request, 0.5 * request.path.length)
    loop = close_path(state, request, middle, model.low_frequency_limit_hz)
    kept = tuple(
        drive_path(state, loop, move, sample_path(request, move)) for move in request.moves
    )
    shares = [loop.shares.get(train.axis, 0.0) for train in loop.loop.trains]
    observers = observe_path(state, middle.release(state.scene.drives.values()).model)
    directions = travel_directions(state.scene.machine, request.path)
    travel = np.concatenate(
        [
            np.zeros(0),
            *(
                np.pad(directions.get(probe.component, np.zeros(3)), (0, SEEN - 3))
                for probe in observers.probes.values()
            ),
        ]
    )
    taken = [
        observers.read(each, travel, sample_move(move, each.times).positions)
        for move, each in zip(request.moves, map(add_watched, kept, disturbed), strict=True)
    ]
    if not request.follows_pose:
        whole = [*map(add_watched, kept, disturbed)]
        return SolvedMoves(kept, kept, _read_forces(state, request, whole, shares, taken))
    along = close_along(state, request, middle, model.low_frequency_limit_hz)
    fine, _ = cut_times(sample_path(request, request.moves[0]), along.loads)
    table = make_loop_table(along, float(fine[1] - fine[0]))
    found = tuple(
        move_along(state, along, move, sample_path(request, move), table) for move in request.moves
    )
    move = request.moves[-1]
    samples = sample_path(request, move)
    full, short = (
        solve_controlled_path(
            close_path(state, request, middle, model.low_frequency_limit_hz, reach=reach),
            move,
            samples,
        )
        for reach in (LINEAR_REACH, VARYING_REACH)
    )
    poses = evaluate_poses(
        request, along.plant, table.steps, found=found, kept=kept, short=short, whole=full
    )
    # what a controller reads is there the deviation from the rigid machine
    shares = [travel.axis - travel.encoder for travel in along.travels]
    whole = [*map(add_watched, found, disturbed)]
    return SolvedMoves(found, kept, _read_forces(state, request, whole, shares, taken), poses)


def _read_forces(
    state: RunState,
    request: PathRequest,
    found: Sequence[PathDeviation],
    shares: Sequence[float],
    taken: Sequence[tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]],
) -> tuple[PathForces, ...]:
    """What drives did on every move, with what joints took and probes saw.

    Args:
        found: The moves, which watched the drives.
        shares: Of each drive, what it should read per travel along the path.
        taken: By joints, and seen by probes, on every move.
    """
    drives, forces = tuple(state.scene.drives.values()), []
    for move, each, own in zip(request.moves, found, taken, strict=True):
        positions = sample_move(move, each.times).positions
        pushed, read = (
            each.watched.of((drive.name, what) for drive in drives) for what in (FORCE, ENCODER)
        )
        history = record_drives(drives, each.times, pushed, np.outer(positions, shares) - read)
        forces.append(PathForces(history, *own))
    return tuple(forces)
