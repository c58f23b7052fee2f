"""The path stage: how far a machine leaves a straight line while its axes accelerate. Only rank 0 has anything to do."""

from collections.abc import Callable

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine_paths import travel_directions
from headstock.geometry.machines import Pose
from headstock.pipeline.damped_machines import damp_system
from headstock.pipeline.driven_path import close_path, drive_path
from headstock.pipeline.path_results import PathCurves, PathResult, PathRun
from headstock.pipeline.run_state import Outcome, RunState
from headstock.pipeline.scene import PathRequest
from headstock.pipeline.stages import Stage
from headstock.reduction.coupling import couple
from headstock.reduction.path_loads import PATH_INPUT, add_path_input
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.modal_analysis import solve_modal
from headstock.solvers.path_figures import filter_deviation, measure_zones
from headstock.solvers.path_response import PathDeviation, PathModel, sample_times, slow_modes, solve_path
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.set_points import SetPoint, sample_move


def run_path_stage(state: RunState, stage: Stage) -> Outcome:
    """Deviation at every output along the path, once per feed."""
    request = state.scene.analyses.path
    if not state.is_root:
        return Outcome()
    if request is None:
        raise ValueError("a path stage needs a path analysis in the scene")
    plant = build_plant(state, request, request.path.pose_at(0.5 * request.path.length))
    damped = plant.damping is not None or plant.hysteretic is not None
    if not damped:
        state.warn(
            'path analysis: nothing is damped, so what the ramps set ringing rings on; write [effects] damping = { modal = "2 %" }'
        )
    ramp = request.moves[0].ramp
    # a mode whose period is longer than the ramp does not follow it
    slow_hz = 1.0 / ramp.time_constant
    try:
        solve = _choose_road(state, request, plant, slow_hz)
    except UnstableControlError as error:
        state.failures.append(f"path analysis: {error}")
        return Outcome(detail="refused: see below")
    runs = tuple(run_move(request, move, solve(move, _samples(request, move))) for move in request.moves)
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
        slow_hz=slow_hz,
        slow_count=slow_modes(solve_modal(plant).frequencies_hz, slow_hz),
        runs=runs,
        drives=tuple(state.scene.drives),
        energy_error=dict(state.energy_errors),
    )
    samples = sum(len(run.curves.positions) for run in runs)
    return Outcome(detail=f"{len(runs)} feed{'s' if len(runs) > 1 else ''}, {samples} samples")


def _choose_road(
    state: RunState, request: PathRequest, plant: SecondOrderSystem, slow_hz: float
) -> Callable[[SetPoint, FloatArray], PathDeviation]:
    """Deviation over a move: motors that follow their set point, or the drives of the scene under control."""
    if state.scene.drives:
        pose = request.path.pose_at(0.5 * request.path.length)
        superelements = {name: state.reduced[name].superelement for name in state.plan.components}
        path = close_path(state, request, couple(superelements, state.scene.machine, pose), slow_hz)
        return lambda move, samples: drive_path(state, path, move, samples)
    model = PathModel(PATH_INPUT, request.outputs, slow_hz)
    return lambda move, samples: solve_path(plant, model, move, samples)


def build_plant(state: RunState, request: PathRequest, pose: Pose) -> SecondOrderSystem:
    """The machine in a pose of the path: the damping the scene names, and the acceleration along the path as an input."""
    superelements = {name: state.reduced[name].superelement for name in state.plan.components}
    machine = state.scene.machine
    coupled = couple(superelements, machine, pose)
    return add_path_input(damp_system(state, coupled.system), coupled, travel_directions(machine, request.path))


def run_move(request: PathRequest, move: SetPoint, raw: PathDeviation) -> PathRun:
    """The deviation of one move as filtered, with its figures."""
    found = filter_deviation(raw, request.low_pass)
    motion = sample_move(move, found.times)
    curves = PathCurves(move.feed, move.zones, request.outputs, found, motion.positions, motion.accelerations)
    return PathRun(curves, tuple(measure_zones(found, raw, move, port, request.ring_down) for port in range(len(request.outputs))))


def _samples(request: PathRequest, move: SetPoint) -> FloatArray:
    return sample_times(move, request.sampling_hz, request.ring_down)
