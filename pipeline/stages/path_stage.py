"""The path stage: how far a machine leaves a straight line while its axes accelerate. Only rank 0 has anything to do."""

from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.results.path import PathCurves, PathResult, PathRun
from headstock.pipeline.stages.path import build_plant, choose_model, solve_moves
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.scene.requests import PathRequest
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.paths.path_figures import filter_deviation, measure_zones
from headstock.solvers.paths.response import PathDeviation, slow_modes
from headstock.solvers.paths.set_points import SetPoint, sample_move


def run_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Deviation at every output along the path, once per feed: as the pose changes, and as if it stayed that of the middle."""
    request = state.scene.analyses.path
    if not state.is_root:
        return Outcome()
    if request is None:
        raise ValueError("a path stage needs a path analysis in the scene")
    middle = build_plant(state, request, 0.5 * request.path.length)
    damped = middle.system.damping is not None or middle.system.hysteretic is not None
    if not damped:
        state.warn(
            'path analysis: nothing is damped, so what the ramps set ringing rings on; write [effects] damping = { modal = "2 %" }'
        )
    try:
        solved = solve_moves(state, request, middle)
    except UnstableControlError as error:
        state.failures.append(f"path analysis: {error}")
        return Outcome(detail="refused: see below")
    model, ramp = choose_model(request), request.moves[0].ramp
    state.path = PathResult(
        start=dict(request.path.start.positions),
        end=dict(request.path.end.positions),
        length=request.path.length,
        ramp=ramp.kind,
        time_constant=ramp.time_constant,
        sampling_hz=request.sampling_hz,
        lowpass_hz=None if request.low_pass is None else request.low_pass.frequency_hz,
        filter="none" if request.low_pass is None else request.low_pass.kind,
        damped=damped,
        slow_hz=model.slow_hz,
        slow_count=slow_modes(middle.modes.frequencies_hz, model.slow_hz),
        poses=solved.poses,
        runs=tuple(run_move(request, *item) for item in zip(request.moves, solved.found, solved.kept, strict=True)),
        drives=tuple(state.scene.drives),
        energy_error=dict(state.energy_errors),
    )
    samples = sum(len(found.times) for found in solved.found)
    poses = "" if solved.poses is None else f", {solved.poses.stations} poses"
    return Outcome(detail=f"{len(solved.found)} feed{'s' if len(solved.found) > 1 else ''}, {samples} samples{poses}")


def run_move(request: PathRequest, move: SetPoint, raw: PathDeviation, kept: PathDeviation) -> PathRun:
    """The deviation of one move as filtered, with its figures; and as if the pose were kept."""
    found, frozen = (filter_deviation(part, request.low_pass) for part in (raw, kept))
    motion = sample_move(move, found.times)
    curves = PathCurves(move.feed, move.zones, request.outputs, found, frozen.total, motion.positions, motion.accelerations)
    ports = range(len(request.outputs))
    return PathRun(
        curves,
        figures=tuple(measure_zones(found, raw, move, port, request.ring_down) for port in ports),
        frozen_figures=tuple(measure_zones(frozen, kept, move, port, request.ring_down) for port in ports),
    )
