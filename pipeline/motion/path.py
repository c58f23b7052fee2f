"""The path stage: the deviation of a machine from a straight line while its axes accelerate, with
ideal motors or drives under control.

The machine is frozen in one pose of the path, or changes its pose along it. Control loops are
checked for stability before any time integration. Only rank 0 has anything to do.
"""

import dataclasses

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import PathCurves, PathResult, PathRun, list_run_numbers
from headstock.pipeline.motion.axes_path import AxesPath, DrivenAxes, IdealAxes
from headstock.pipeline.motion.path_model import SolvedMoves, choose_model
from headstock.pipeline.motion.stepped_path import SteppedPath, lay_rotary_path, lay_tool_line
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.refined_models import repeat_with_refined, silence
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.estimates.corrected_elements import SEPARATE_REFINEMENTS
from headstock.reduction.motions.path_errors import NODES
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.errors import ModelError, UnstableControlError
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.motion.deviation import (
    PathDeviation,
    filter_deviation,
    measure_cruise,
    measure_zones,
)
from headstock.solvers.motion.exact import slow_modes
from headstock.solvers.motion.set_points import SetPoint, sample_move
from headstock.solvers.watched_outputs import WatchedValues


def run_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Compute the deviation at every output along the path, once per feed: with the pose changing,
    and frozen in the middle.
    """
    if not state.is_root:
        return Outcome()
    request = state.scene.analyses[PathRequest]
    path = _lay_path(state, request)
    if isinstance(path, SteppedPath):
        path.warn_of_speeds()
    if not path.damped:
        state.warn(
            'path analysis: nothing is damped, so residual vibration does not decay; write [effects] damping = { modal = "2 %" }'
        )
    try:
        solved = _solve_moves(path)
    except (UnstableControlError, ModelError) as error:
        return Outcome(detail="refused: see below", failures=(f"path analysis: {error}",))
    model, ramp = choose_model(request), request.moves[0].ramp
    errors, left_out = _estimate_errors(state, request, solved)
    answer = PathResult(
        start=dict(request.path.start.positions),
        end=dict(request.path.end.positions),
        length=request.path.length,
        unit=request.path.unit,
        ramp=ramp.kind,
        time_constant=ramp.time_constant,
        sampling_hz=request.sampling_hz,
        lowpass_hz=None if request.low_pass is None else request.low_pass.frequency_hz,
        filter="none" if request.low_pass is None else request.low_pass.kind,
        damped=path.damped,
        low_frequency_limit_hz=model.low_frequency_limit_hz,
        low_frequency_modes=slow_modes(path.frequencies_hz, model.low_frequency_limit_hz),
        poses=solved.poses,
        runs=_run_moves(request, solved),
        errors=errors,
        left_out=left_out,
        drives=tuple(state.scene.drives),
        energy_error=dict(state.energy_errors),
    )
    samples = sum(len(move.times) for move in solved.moves)
    poses = "" if solved.poses is None else f", {solved.poses.sampled_poses} poses"
    return Outcome(
        detail=f"{len(solved.moves)} feed{'s' if len(solved.moves) > 1 else ''}, {samples} samples{poses}",
        answers=(answer,),
    )


def _lay_path(
    state: RunState, request: PathRequest, *, pose_errors: bool | None = None
) -> AxesPath | SteppedPath:
    """Return the solver of a path: of linear axes, of rotary axes, or of the tool of a mechanism.

    Args:
        pose_errors: Static guide errors depend on the position along the path, else on the pose at
            mid-path only; None for what the request says of the pose.
    """
    mechanism = state.scene.mechanism
    if mechanism is not None:
        return lay_tool_line(state, request, mechanism)
    if request.path.turning:
        return lay_rotary_path(state, request)
    solver = DrivenAxes if state.scene.drives else IdealAxes
    if pose_errors is None:
        pose_errors = request.follows_pose
    return solver(state, request, error_nodes=NODES if pose_errors else 1)


def _solve_moves(path: AxesPath | SteppedPath) -> SolvedMoves:
    """Solve every move of a path: in the pose at mid-path, and with the pose changing where the
    scene asks for it.
    """
    request, frozen = path.request, path.freeze()
    kept = [frozen(move) for move in request.moves]
    still = tuple(move.total for move in kept)
    if not request.follows_pose:
        return SolvedMoves(
            tuple(
                path.add_errors(move, solved.deviation)
                for move, solved in zip(request.moves, kept, strict=True)
            ),
            still,
            tuple(move.forces for move in kept),
            disturbed=path.disturbed,
        )
    posed = path.follow(kept)
    moves = [posed.solve(move) for move in request.moves]

    def show(deviation: PathDeviation) -> FloatArray:
        return filter_deviation(deviation, request.low_pass).total

    def compare(first: PathDeviation, second: PathDeviation) -> float:
        return float(np.abs(show(first) - show(second)).max())

    short, whole = posed.truncation
    most = max(float(np.abs(show(whole)).max()), float(np.finfo(float).tiny))
    pairs = list(zip(moves, kept, strict=True))
    return SolvedMoves(
        tuple(move.total for move in moves),
        still,
        tuple(
            PathForces(move.forces.drives, middle.forces.joints, middle.forces.probes)
            for move, middle in pairs
        ),
        dataclasses.replace(
            posed.poses,
            truncation=compare(short, whole) / most,
            effect=tuple(compare(move.deviation, middle.deviation) for move, middle in pairs),
        ),
        disturbed=path.disturbed,
    )


def _estimate_errors(
    state: RunState,
    request: PathRequest,
    solved: SolvedMoves,
) -> tuple[dict[Key, Estimate], tuple[str, ...]]:
    """Return the ± of every number, and what it leaves out: moves are solved again in the pose at
    mid-path, for the machine without each source of error and with cutting coefficients at the ends
    of their ranges.
    """
    frozen = dataclasses.replace(request, follows_pose=False)

    def solve(machine: RunState, cut: MillingCut | None) -> tuple[Number, ...]:
        milled = request.cut
        if milled is not None and cut is not None:
            milled = dataclasses.replace(milled, cut=cut)
        asked = dataclasses.replace(frozen, cut=milled)
        moves = _solve_moves(_lay_path(machine, asked, pose_errors=request.follows_pose))
        return tuple(list_run_numbers(_run_moves(frozen, moves)))

    cut = None if request.cut is None else request.cut.cut
    repeated = repeat_with_refined(state, SEPARATE_REFINEMENTS, solve, cut, asked=request.estimate)
    again = repeated.sources and request.follows_pose
    base = solve(silence(state), cut) if again else list_run_numbers(_run_moves(frozen, solved))
    return repeated.estimate(tuple(base)), repeated.left_out


def _run_moves(request: PathRequest, solved: SolvedMoves) -> tuple[PathRun, ...]:
    return tuple(
        _run_move(request, move, raw, kept, forces, disturbed=solved.disturbed)
        for move, raw, kept, forces in zip(
            request.moves, solved.moves, solved.kept, solved.forces, strict=True
        )
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
    """Return the filtered deviation of one move with its figures, with the pose changing and
    frozen. Forces are not filtered.
    """
    # the watched outputs are in the forces and probes
    filtered, frozen = (
        dataclasses.replace(filter_deviation(part, request.low_pass), watched=WatchedValues())
        for part in (raw, kept)
    )
    motion = sample_move(move, filtered.times)
    curves = PathCurves(
        move.feed,
        move.zones,
        request.outputs,
        filtered,
        frozen.total,
        motion.positions,
        motion.accelerations,
        drives=tuple(forces.drives.extremes),
        torques=forces.drives.torques,
        position_errors=forces.drives.position_errors,
        probes=tuple(probe.trace for probe in forces.probes.values()),
        unit=move.unit,
    )
    channels = range(len(request.outputs))
    return PathRun(
        curves,
        figures=tuple(
            measure_zones(filtered, raw, move, channel, request.residual_time)
            for channel in channels
        ),
        frozen_figures=tuple(
            measure_zones(frozen, kept, move, channel, request.residual_time)
            for channel in channels
        ),
        cruises=tuple(
            measure_cruise(filtered, move, channel, request.residual_time) for channel in channels
        )
        if disturbed
        else (),
        drives=forces.drives.extremes,
        joints=forces.joints,
        probes=forces.probes,
    )
