"""The path stage: how far a machine leaves a straight line while its axes accelerate, with ideal
motors or drives under control.

The machine is taken in one pose of the path, or as it changes along it. Control loops are judged
before any run in time. Only rank 0 has anything to do.
"""

import dataclasses
import operator
from collections.abc import Callable

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import PathCurves, PathResult, PathRun, list_run_numbers
from headstock.pipeline.motion.axes_path import (
    build_plant,
    disturb_freely,
    disturb_loop,
    drive_moves,
    move_freely,
)
from headstock.pipeline.motion.path_model import SolvedMoves, choose_model
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.refined_models import repeat_at_ends, repeat_with_refined, silence
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.estimates.corrected_elements import SEPARATE_REFINEMENTS
from headstock.reduction.motions.path_errors import NODES, find_path_errors
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.errors import ModelError, UnstableControlError
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.motion.deviation import (
    PathDeviation,
    filter_deviation,
    measure_cruise,
    measure_zones,
)
from headstock.solvers.motion.exact import slow_modes
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.motion.set_points import SetPoint, sample_move
from headstock.solvers.watched_outputs import WatchedValues


def run_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Deviation at every output along the path of axes, once per feed: as the pose changes, and as if
    it stayed that of the middle.
    """
    request = state.scene.analyses.get(PathRequest)
    if not state.is_root:
        return Outcome()
    if request is None:
        raise ValueError("a path stage needs a path analysis in the scene")
    middle = build_plant(state, request, 0.5 * request.path.length)
    return answer_path(
        state,
        request,
        frequencies_hz=middle.modes.frequencies_hz,
        damped=middle.system.damping is not None or middle.system.hysteretic is not None,
        solve=lambda own, asked: _solve_moves(
            own,
            asked,
            middle if own is state else build_plant(own, asked, 0.5 * asked.path.length),
            nodes=NODES if request.follows_pose else 1,
        ),
    )


def _solve_moves(
    state: RunState, request: PathRequest, middle: PosedModes, *, nodes: int
) -> SolvedMoves:
    """Deviation of every move: with the drives of the scene under control, or with motors that
    follow their set point.

    Args:
        nodes: Poses between which what errors of guides do at rest is interpolated.

    Raises:
        UnstableControlError: A control loop is.
    """
    model = choose_model(request)
    errors = find_path_errors(
        state.parts.superelements,
        state.scene.machine,
        request.path,
        request.outputs,
        nodes=nodes,
    )
    drives = state.scene.drives
    nothing = [None] * len(request.moves)
    if errors is None and not any(drive.ripple for drive in drives.values()):
        if drives:
            return drive_moves(state, request, model, nothing)
        return move_freely(state, request, middle, model, nothing)
    disturbed = [
        disturb_loop(state, request, errors, move)
        if drives or errors is None
        else disturb_freely(state, request, errors, move, middle)
        for move in request.moves
    ]
    solved = (
        drive_moves(state, request, model, disturbed)
        if drives
        else move_freely(state, request, middle, model, disturbed)
    )
    posed = [
        own if errors is None else errors.follow_pose(own, move)
        for own, move in zip(disturbed, request.moves, strict=True)
    ]
    return dataclasses.replace(
        solved,
        found=tuple(map(operator.add, solved.found, posed)),
        kept=tuple(map(operator.add, solved.kept, disturbed)),
        disturbed=True,
    )


def answer_path(
    state: RunState,
    request: PathRequest,
    *,
    frequencies_hz: FloatArray,
    damped: bool,
    solve: Callable[[RunState, PathRequest], SolvedMoves],
) -> Outcome:
    """What is said of a path.

    Args:
        frequencies_hz: Of the machine in its middle [Hz].
        solve: Its moves, of a run and of what is asked.
    """
    if not damped:
        state.warn(
            'path analysis: nothing is damped, so residual vibration does not decay; write [effects] damping = { modal = "2 %" }'
        )
    try:
        solved = solve(state, request)
    except (UnstableControlError, ModelError) as error:
        return Outcome(detail="refused: see below", failures=(f"path analysis: {error}",))
    model, ramp = choose_model(request), request.moves[0].ramp
    errors, left_out = _estimate_errors(state, request, solved, solve)
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
        damped=damped,
        low_frequency_limit_hz=model.low_frequency_limit_hz,
        low_frequency_modes=slow_modes(frequencies_hz, model.low_frequency_limit_hz),
        poses=solved.poses,
        runs=_run_moves(request, solved),
        errors=errors,
        left_out=left_out,
        drives=tuple(state.scene.drives),
        energy_error=dict(state.energy_errors),
    )
    samples = sum(len(found.times) for found in solved.found)
    poses = "" if solved.poses is None else f", {solved.poses.sampled_poses} poses"
    return Outcome(
        detail=f"{len(solved.found)} feed{'s' if len(solved.found) > 1 else ''}, {samples} samples{poses}",
        answers=(answer,),
    )


def _estimate_errors(
    state: RunState,
    request: PathRequest,
    solved: SolvedMoves,
    solve: Callable[[RunState, PathRequest], SolvedMoves],
) -> tuple[dict[Key, Estimate], tuple[str, ...]]:
    """Return the ± of every number, and what is not in them: the moves once more, in the pose of the
    middle, of the machine without each source of error, and with cutting coefficients at the ends of
    their ranges.
    """
    frozen = dataclasses.replace(request, follows_pose=False)

    def list_numbers(moves: SolvedMoves) -> tuple[Number, ...]:
        return tuple(list_run_numbers(_run_moves(frozen, moves)))

    found = repeat_with_refined(
        state,
        SEPARATE_REFINEMENTS,
        lambda machine: list_numbers(solve(machine, frozen)),
        asked=request.estimate,
    )
    if request.cut is not None and request.estimate:
        found = repeat_at_ends(
            request.cut.cut.coefficients,
            lambda own: list_numbers(solve(silence(state), _with_coefficients(frozen, own))),
            found,
        )
    if found.sources and request.follows_pose:
        solved = solve(silence(state), frozen)
    return found.estimate(list_numbers(solved)), found.left_out


def _with_coefficients(request: PathRequest, coefficients: CuttingCoefficients) -> PathRequest:
    if request.cut is None:
        return request
    cut = dataclasses.replace(request.cut.cut, coefficients=coefficients)
    return dataclasses.replace(request, cut=dataclasses.replace(request.cut, cut=cut))


def _run_moves(request: PathRequest, solved: SolvedMoves) -> tuple[PathRun, ...]:
    return tuple(
        _run_move(request, move, raw, kept, forces, disturbed=solved.disturbed)
        for move, raw, kept, forces in zip(
            request.moves, solved.found, solved.kept, solved.forces, strict=True
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
    """The deviation of one move as filtered, with its figures; and as if the pose were kept. Forces
    are not filtered.
    """
    # what was watched is in the forces and probes
    found, frozen = (
        dataclasses.replace(filter_deviation(part, request.low_pass), watched=WatchedValues())
        for part in (raw, kept)
    )
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
        unit=move.unit,
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
