"""A path under control as the pose changes along it."""

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.paths.closed_path import check_energy
from headstock.pipeline.paths.path_cut import path_loads
from headstock.pipeline.paths.path_model import couple_at
from headstock.pipeline.paths.travels import axis_shares
from headstock.pipeline.stages.control import drive_along
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
from headstock.solvers.control.friction_loop import friction_channels
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

VARYING_REACH = 3.0  # as those of ``closed_path``: these modes are interpolated along the path


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
    check_energy(state, motion, move)
    return deviation
