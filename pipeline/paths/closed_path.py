"""A path under control in one pose, and as the pose changes along it. Control loops are judged before any
run in time.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.paths.path_cut import path_loads
from headstock.pipeline.paths.path_model import axis_shares, couple_at, travel_of_channel
from headstock.pipeline.paths.solved_moves import observe_path
from headstock.pipeline.stages.control import drive_along, drive_machine
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.motion_forces import watch_drives
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.path_loads import (
    PATH_INPUT,
    add_driven_path_input,
    find_rigid_travels,
    stack_driven_modes,
)
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.driven_motion import DrivenMotion
from headstock.solvers.control.friction_loop import friction_channels
from headstock.solvers.control.stability import require_stable
from headstock.solvers.paths.controlled import (
    ControlledPath,
    solve_controlled_path,
    solve_path_with_friction,
)
from headstock.solvers.paths.loads import load_channels
from headstock.solvers.paths.response import PathDeviation
from headstock.solvers.paths.set_points import SetPoint
from headstock.solvers.paths.varying_control import (
    LoopTable,
    VaryingLoop,
    loop_channels,
    solve_varying_control,
    solve_varying_friction,
)
from headstock.solvers.paths.varying_system import PosedModes, sample_plant

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
        channels=channels,
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
