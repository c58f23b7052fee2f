"""Every move of a path under control, with what its drives did."""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.paths.closed_path import (
    LINEAR_REACH,
    VARYING_REACH,
    close_along,
    close_path,
    drive_path,
    move_along,
)
from headstock.pipeline.paths.path_model import couple_at, sample_path
from headstock.pipeline.paths.solved_moves import (
    SolvedMoves,
    add_watched,
    evaluate_poses,
    observe_path,
)
from headstock.pipeline.stages.motion_forces import record_drives
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.estimates.probe_errors import SEEN
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.control.drive_loops import ENCODER
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.paths.controlled import solve_controlled_path
from headstock.solvers.paths.loads import cut_times
from headstock.solvers.paths.response import PathDeviation, PathModel
from headstock.solvers.paths.set_points import sample_move
from headstock.solvers.paths.varying_control import make_loop_table
from headstock.solvers.watched_outputs import Extreme


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
