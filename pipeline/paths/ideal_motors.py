"""A path with motors that follow their set point."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.paths.path_cut import path_loads
from headstock.pipeline.paths.path_model import couple_at, sample_path
from headstock.pipeline.paths.solved_moves import (
    SolvedMoves,
    add_watched,
    evaluate_poses,
    observe_path,
)
from headstock.pipeline.stages.machine import damp_system, warn_of_no_damping
from headstock.pipeline.stages.motion_forces import record_drives
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.path_loads import add_path_input, stack_modes
from headstock.reduction.coupling.probes import travel_inertia
from headstock.reduction.estimates.probe_errors import SEEN
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.paths.loads import cut_times
from headstock.solvers.paths.response import PathDeviation, PathModel, solve_path
from headstock.solvers.paths.set_points import sample_move
from headstock.solvers.paths.varying_response import make_step_table, solve_varying_path
from headstock.solvers.paths.varying_system import PosedModes, sample_system


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
