"""The transient stage: motion of a machine in a pose under loads over time, with what its peaks are
worth. Only rank 0 has anything to do.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.estimates import Estimate
from headstock.pipeline.answers.transient import TRUNCATION, TransientAnswer, TransientCurves
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.machine import damp_system, warn_of_no_damping
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState, Solved, pose_model
from headstock.scene.requests import LOAD, TimedLoad, TransientRequest
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.load_history import LoadHistory, SteppedLoads, step_loads
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.linear.transient import (
    Motion,
    TransientFigures,
    TransientModel,
    find_energy,
    find_figures,
    prepare_transient,
    read_response,
    rest_positions,
    scale_frequencies,
    solve_transient,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem, name_channel

START: Channel = ("initial velocity", "momentum")
# modes whose damping couples them are all solved for up to here; of more, those in BEYOND times the
# range tell what the others add
MOST_COUPLED_MODES = 200
BEYOND = 2.0
UNBALANCED_ENERGY = 0.01
ROUNDOFF = 1e-10  # of the largest displacement of its kind


@dataclass(frozen=True, eq=False)
class _Solution:
    """Motion of a model, and what it says."""

    motion: Motion
    figures: tuple[TransientFigures, ...]
    times: FloatArray
    displacements: FloatArray


def run_transient_stage(state: RunState, stage: Stage) -> Outcome:
    """Motion under the loads of the request; one that cannot begin is a failure, and the run goes
    on.
    """
    if not state.is_root:
        return Outcome()
    model = pose_model(state)
    try:
        solved = respond_in_time(model)
    except ModelError as error:
        return Outcome(
            detail="refused: see below",
            failures=(f"transient analysis in pose {model.pose.name}: {error}",),
        )
    answer = solved.answer
    detail = (
        f"{len(answer.curves.times)} samples, {answer.modes} modes up to {answer.up_to_hz:g} Hz"
    )
    return Outcome(detail=detail, answers=(answer,), warnings=solved.warnings)


def respond_in_time(machine: PoseModel, *, judged: bool = True) -> Solved[TransientAnswer]:
    """Motion of a machine in a pose under loads over time, with the damping of its scene.

    Args:
        machine: In the pose.
        judged: Estimate what peaks are worth.

    Raises:
        ModelError: What is released acts on a motion that nothing holds.
    """
    scene = machine.parts.scene
    request = scene.analyses.transient
    if request is None:
        raise ValueError("a transient analysis needs one in the scene")
    bare = _add_inputs(machine, request)
    system = damp_system(scene, bare, machine.all_modes)
    inputs = [_input_of(load) for load in request.loads] + [START]

    def prepare(up_to_hz: float | None) -> TransientModel:
        return prepare_transient(
            system, inputs, request.outputs, up_to_hz=up_to_hz, modes=machine.all_modes
        )

    histories = [load.history for load in request.loads]
    none = np.zeros(0)
    histories.append(LoadHistory(none, none, none, none, none, none))
    stepped = step_loads(histories, request.duration, request.sampling_hz)
    model = prepare(request.up_to_hz)
    solution = _solve(model, request, histories, stepped)
    energy = find_energy(model, solution.motion)
    errors: tuple[Estimate, ...] = (Estimate(),) * len(request.outputs)
    if judged and model.coordinates is not None:
        wider = prepare(None if _has_few_modes(model) else BEYOND * request.up_to_hz)
        others = [(TRUNCATION, _solve(wider, request, histories, stepped))]
        softer, left_out = _soften(machine, model)
        others += [
            (source, _solve(other, request, histories, stepped)) for source, other in softer.items()
        ]
        errors = _compare_peaks(solution, others, left_out)
    values, _ = stepped.evaluate()
    sampled = stepped.sampled
    loads = np.concatenate([values[:, 0], values[-1:, 1]])[sampled][:, : len(request.loads)]
    warnings = [*warn_of_no_damping(scene, bare)]
    if energy is not None and energy.error > UNBALANCED_ENERGY:
        warnings.append(
            f"transient analysis in pose {machine.pose.name}: {100.0 * energy.error:.2g} % of the energy are missing between samples at"
            f" {request.sampling_hz:g} Hz: the loads set off modes that are too fast for them; raise sampling or lower up_to"
        )
    answer = TransientAnswer(
        curves=TransientCurves(
            pose=machine.pose.name,
            outputs=request.outputs,
            times=solution.times,
            displacements=solution.displacements,
            loads=tuple(load.name for load in request.loads),
            units=tuple(_unit_of(load) for load in request.loads),
            load_values=loads,
        ),
        figures=solution.figures,
        errors=errors,
        acts_on=tuple(_target_of(load) for load in request.loads),
        shapes=tuple(load.shape for load in request.loads),
        sizes=tuple(_largest(load, loads[:, number]) for number, load in enumerate(request.loads)),
        duration=request.duration,
        sampling_hz=request.sampling_hz,
        up_to_hz=request.up_to_hz,
        modes=len(model.space.a) // 2,
        settled=request.settled,
        damped=system.damping is not None or system.hysteretic is not None,
        energy=energy,
    )
    return Solved(answer, tuple(warnings))


def _add_inputs(machine: PoseModel, request: TransientRequest) -> SecondOrderSystem:
    """The system with the static loads that are named, and the momentum before the time zero, as
    inputs.
    """
    named = {
        _input_of(load): machine.loads[load.target]
        for load in request.loads
        if isinstance(load.target, str)
    }
    velocities = {name: np.array(speeds) for name, speeds in request.velocities.items()}
    inputs = machine.system.inputs | named | {START: machine.momentum(velocities)}
    return dataclasses.replace(machine.system, inputs=inputs)


def _input_of(load: TimedLoad) -> Channel:
    return (load.target, LOAD) if isinstance(load.target, str) else load.target


def _solve(
    model: TransientModel,
    request: TransientRequest,
    histories: Sequence[LoadHistory],
    stepped: SteppedLoads,
) -> _Solution:
    start, final, state = rest_positions(model.space, histories, request.duration)
    moving = np.zeros(len(histories))
    moving[-1] = 1.0
    motion = solve_transient(model.space, stepped, state + model.space.b @ moving)
    response = read_response(model.space, motion)
    figures = find_figures(response, start=start, final=final, near=request.settled)
    figures = _leave_out_roundoff(figures, request.outputs)
    times, displacements = response.sample()
    return _Solution(motion, figures, times, displacements)


def _leave_out_roundoff(
    figures: tuple[TransientFigures, ...], outputs: Sequence[Channel]
) -> tuple[TransientFigures, ...]:
    """Outputs that symmetry keeps at rest neither overshoot nor settle."""
    found = []
    for channel, own in zip(outputs, figures, strict=True):
        like = [
            abs(other.peak)
            for name, other in zip(outputs, figures, strict=True)
            if name[1].startswith("r") == channel[1].startswith("r")
        ]
        still = abs(own.peak) <= ROUNDOFF * max(like)
        found.append(
            TransientFigures(0.0, 0.0, 0.0, None if own.final is None else 0.0, None, None)
            if still
            else own
        )
    return tuple(found)


def _has_few_modes(model: TransientModel) -> bool:
    """Whether all modes together are no effort: nothing couples them, or they are few."""
    every = model.every
    return model.space.pairs is not None or (
        every is not None and len(every.eigenvalues) <= MOST_COUPLED_MODES
    )


def _soften(
    machine: PoseModel, model: TransientModel
) -> tuple[dict[str, TransientModel], tuple[str, ...]]:
    """Source of error to the model with natural frequencies as low as this source leaves possible,
    and what is not looked at. Meshes and reductions make frequencies too high.
    """
    own = model.coordinates
    count = 0 if own is None else len(own.eigenvalues) - own.rigid_count
    if own is None or not count:
        return {}, ()
    near = keep_lowest(machine.all_modes, count=len(own.eigenvalues))
    estimates = machine.estimate_mode_errors(near)[own.rigid_count :]
    frequencies = near.frequencies_hz[own.rigid_count :]
    found: dict[str, TransientModel] = {}
    for source in dict.fromkeys(source for error in estimates for source in error.shares):
        sizes = np.zeros(count)
        for mode, error in enumerate(estimates[:count]):
            sizes[mode] = error.shares.get(source) or 0.0
        factors = 1.0 - np.minimum(sizes[: len(frequencies)] / frequencies[:count], 0.5)
        padded = np.ones(count)
        padded[: len(factors)] = factors
        found[source] = scale_frequencies(model, padded)
    left_out = dict.fromkeys(words for error in estimates for words in error.left_out)
    return found, tuple(left_out)


def _compare_peaks(
    solution: _Solution, others: Sequence[tuple[str, _Solution]], left_out: tuple[str, ...]
) -> tuple[Estimate, ...]:
    """What each peak changes by in other models."""
    return tuple(
        Estimate(
            {
                source: abs(abs(other.figures[number].peak) - abs(own.peak))
                for source, other in others
            },
            left_out,
        )
        for number, own in enumerate(solution.figures)
    )


def _target_of(load: TimedLoad) -> str:
    return load.target if isinstance(load.target, str) else name_channel(load.target)


def _unit_of(load: TimedLoad) -> str:
    if isinstance(load.target, str):
        return "1"
    unit = "N m" if load.target[1].startswith("r") else "N"
    return f"{unit} s" if load.shape == "impulse" else unit


def _largest(load: TimedLoad, values: FloatArray) -> float:
    struck = [abs(size) for _, size in load.history.impulses]
    return float(max([*struck, np.abs(values).max(initial=0.0), abs(load.history.before)]))
