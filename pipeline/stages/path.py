"""What a path is computed with: the machine in a pose of the path, or along it."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine_paths import travel_directions
from headstock.pipeline.planning.planner import MODE_MARGIN, path_band
from headstock.pipeline.results.path import FollowedPoses
from headstock.pipeline.stages.damped_machines import damp_system
from headstock.pipeline.stages.driven_path import close_path, drive_path
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.path_loads import PATH_INPUT, add_path_input, stack_modes
from headstock.scene.requests import PathRequest
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.paths.path_figures import filter_deviation
from headstock.solvers.paths.response import PathDeviation, PathModel, sample_times, solve_path
from headstock.solvers.paths.set_points import SetPoint
from headstock.solvers.paths.varying_response import StepTable, make_step_table, solve_varying_path
from headstock.solvers.paths.varying_system import PosedModes, VaryingSystem, sample_system


@dataclass(frozen=True, eq=False)
class SolvedMoves:
    """Deviations before any filter, one per feed.

    Attributes:
        found: What holds.
        kept: In the pose of the middle.
        poses: How the poses of the path were followed; None where they were not.
    """

    found: tuple[PathDeviation, ...]
    kept: tuple[PathDeviation, ...]
    poses: FollowedPoses | None = None


def choose_model(request: PathRequest) -> PathModel:
    """What follows and what rings: a mode whose period is longer than a ramp does not follow it."""
    return PathModel(PATH_INPUT, request.outputs, 1.0 / request.moves[0].ramp.time_constant, MODE_MARGIN * path_band(request))


def build_plant(state: RunState, request: PathRequest, position: float) -> PosedModes:
    """The machine at a position of the path [m]: the damping the scene names, and the acceleration along the path as an input."""
    superelements = {name: state.reduced[name].superelement for name in state.plan.components}
    machine = state.scene.machine
    coupled = couple(superelements, machine, request.path.pose_at(position))
    modes = solve_modal(coupled.system)
    damped = damp_system(state, coupled.system, modes)
    return stack_modes(add_path_input(damped, coupled, travel_directions(machine, request.path)), modes, coupled)


def solve_moves(state: RunState, request: PathRequest, middle: PosedModes) -> SolvedMoves:
    """Deviation of every move: with the drives of the scene under control, or with motors that follow their set point.

    Raises:
        UnstableControlError: A control loop is.
    """
    model = choose_model(request)
    if state.scene.drives:
        superelements = {name: state.reduced[name].superelement for name in state.plan.components}
        coupled = couple(superelements, state.scene.machine, request.path.pose_at(0.5 * request.path.length))
        loop = close_path(state, request, coupled, model.slow_hz)
        driven = tuple(drive_path(state, loop, move, sample_path(request, move)) for move in request.moves)
        return SolvedMoves(driven, driven)
    whole = dataclasses.replace(model, up_to_hz=None)
    kept = tuple(solve_path(middle.system, whole, move, sample_path(request, move)) for move in request.moves)
    if not request.follows_pose:
        return SolvedMoves(kept, kept)
    along = sample_system(lambda position: build_plant(state, request, position), request.path.length, model)
    table = make_step_table(along, 1.0 / request.sampling_hz)
    found = tuple(solve_varying_path(along, move, sample_path(request, move), table) for move in request.moves)
    # that modes are kept only up to a frequency is judged in the middle, where all are known
    move = request.moves[-1]
    short = solve_path(middle.system, model, move, sample_path(request, move))
    return SolvedMoves(found, kept, _judge_poses(request, (along, table), (found, kept), short))


def sample_path(request: PathRequest, move: SetPoint) -> FloatArray:
    """Instants of a move [s]."""
    return sample_times(move, request.sampling_hz, request.ring_down)


def _judge_poses(
    request: PathRequest,
    along: tuple[VaryingSystem, StepTable],
    solved: tuple[tuple[PathDeviation, ...], tuple[PathDeviation, ...]],
    short: PathDeviation,
) -> FollowedPoses:
    """What following the poses took, and what it is worth."""
    system, table = along

    def show(deviation: PathDeviation) -> FloatArray:
        return filter_deviation(deviation, request.low_pass).total

    whole = show(solved[1][-1])
    return FollowedPoses(
        stations=len(system.positions),
        error=system.error,
        turn_error=system.turn_error,
        modes=len(system.scales),
        next_hz=None if np.isinf(system.next_hz) else system.next_hz,
        steps=len(table.spline.x),
        truncation=float(np.abs(show(short) - whole).max() / max(np.abs(whole).max(), np.finfo(float).tiny)),
        effect=tuple(float(np.abs(show(found) - show(kept)).max()) for found, kept in zip(*solved, strict=True)),
    )
