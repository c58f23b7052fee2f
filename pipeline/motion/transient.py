"""The transient stage: motion of a machine in a pose under loads over time, with the ± of its
peaks. Only rank 0 has anything to do.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.transient import (
    TRUNCATION,
    TransientAnswer,
    TransientCurves,
    peak_key,
)
from headstock.pipeline.motion.motion_forces import (
    SteppedStates,
    find_roundoff,
    follow_drives,
    largest_joint_forces,
    watch_joints,
)
from headstock.pipeline.motion.prescribed import PrescribedMotion, prescribe_motion
from headstock.pipeline.motion.probe_motions import (
    MovingModel,
    place_probes,
    probe_outputs,
    trace_motion,
)
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.control import check_loops, drive_machine
from headstock.pipeline.stages.machine import DAMPING, damp_system, warn_of_no_damping
from headstock.pipeline.stages.probes import warn_of_singular
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState, Solved, pose_model
from headstock.reduction.coupling.joint_forces import joint_outputs
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.reduction.estimates.mesh_errors import SILENT_SHARE
from headstock.reduction.motions.compliance_budget import strain_energies
from headstock.scene.analyses.transient import TimedLoad, TransientRequest
from headstock.scene.scene import LOAD
from headstock.solvers.control.drive_loops import ClosedLoop, close_loops
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.sampled_loops import sample_loops
from headstock.solvers.errors import ConvergenceError, ModelError, UnstableControlError
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.linear.modal_coordinates import has_symmetric_terms
from headstock.solvers.motion.driven_motion import (
    FrictionTransient,
    sharpen_friction,
    solve_friction_transient,
)
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.second_order import Channel, SecondOrderSystem, name_channel
from headstock.solvers.state_spaces.load_history import (
    LoadHistory,
    SteppedLoads,
    no_load,
    step_loads,
)
from headstock.solvers.state_spaces.state_space import StateSpace, to_state_space
from headstock.solvers.state_spaces.transient import (
    EnergyBalance,
    Sampling,
    StateHistory,
    StiffnessLoss,
    TransientFigures,
    find_energy,
    find_figures,
    read_response,
    rest_positions,
    soften_system,
    solve_transient,
)

START: Channel = ("initial velocity", "momentum")
# number of modes coupled by damping up to which all are solved for; of more, those up to BEYOND
# times the frequency range estimate the contribution of the others
MOST_COUPLED_MODES = 200
BEYOND = 2.0
UNBALANCED_ENERGY = 0.01
UNBALANCED_FRICTION = 1e-6  # with friction, where the integrator has the works as states
SMOOTHING = "smoothing of friction"
SAME_STEP = 1e-9  # of a step of controllers over that of samples: distance from a whole number
# factor on the smoothing: peaks converge with its square root or faster, so that a sharp law
# changes them by REMAINING times as much
SHARPER = 0.1
REMAINING = 1.0 / (1.0 - SHARPER**0.5)
MOST_SOFTENED = 0.5  # largest share of a natural frequency that is subtracted as its error


@dataclass(frozen=True, eq=False)
class _PreparedModel:
    """Hold state spaces of a model with its loads as inputs.

    Attributes:
        watched: With all observed outputs besides the displacements, and friction as inputs where
            there is any.
        friction_loop: Closed loops with friction in their guides; None without friction.
        samples: Of controllers with a step that sample and hold; None where loops are continuous.
    """

    linear: StateSpace
    watched: StateSpace
    friction_loop: ClosedLoop | None = None
    samples: Sampling | None = None


@dataclass(frozen=True, eq=False)
class _RefinedModels[M]:
    """Hold models without one source of error each, or their motions, by source.

    Attributes:
        known: Models without the source, as far as it is estimated.
        doubtful: For sources without an estimate of some modes: these modes as low as any may be.
        left_out: Sources of error that are not estimated.
    """

    known: dict[str, M] = field(default_factory=dict)
    doubtful: dict[str, M] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    def convert[N](self, make: Callable[[M], N]) -> "_RefinedModels[N]":
        """Return the same with a function applied to each model."""
        known, doubtful = (
            {source: make(model) for source, model in models.items()}
            for models in (self.known, self.doubtful)
        )
        return _RefinedModels(known, doubtful, self.left_out)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Store the motion of a model, and its figures.

    Attributes:
        with_friction: Motion with friction; None without friction.
        times: ``(n,)`` of the samples [s].
        displacements: ``(n, n_outputs)`` at the samples [m, rad].
    """

    model: _PreparedModel
    motion: StateHistory
    with_friction: FrictionTransient | None
    figures: tuple[TransientFigures, ...]
    times: FloatArray
    displacements: FloatArray

    @property
    def moving(self) -> MovingModel:
        """The model with its states and inputs: loads, then friction against the motion."""
        loads = self.motion.loads
        values, _ = loads.evaluate()
        acting = np.concatenate([values[:, 0], values[:, 1]])
        after, before = self.motion.right, self.motion.left
        if self.with_friction is not None:
            after, before = self.with_friction.motion.right, self.with_friction.motion.left
            acting = np.hstack([acting, -np.concatenate(self.with_friction.friction)])
        states = np.concatenate([after[:-1], before[1:]])
        return MovingModel(self.model.watched, SteppedStates(loads.times, states, acting))

    @functools.cached_property
    def energy(self) -> EnergyBalance | None:
        """Energy balance; None under control without friction."""
        if self.with_friction is not None:
            return self.with_friction.energy
        return find_energy(self.model.linear, self.motion)


@dataclass(frozen=True, eq=False)
class _LoadCase:
    """Describe the loads of a request over time.

    Attributes:
        histories: Histories of the loads, then of the momentum before time zero.
        stepped: The same in the steps between samples.
    """

    request: TransientRequest
    histories: tuple[LoadHistory, ...]
    stepped: SteppedLoads

    @property
    def values(self) -> FloatArray:
        """Loads ``(n, k)`` at the samples."""
        values, _ = self.stepped.evaluate()
        at_times = np.concatenate([values[:, 0], values[-1:, 1]])
        return at_times[self.stepped.sampled][:, : len(self.request.loads)]

    def solve(self, model: _PreparedModel) -> _Solution:
        """Solve for the motion of a model."""
        space, request = model.linear, self.request
        start, final, state = rest_positions(space, self.histories, request.duration, model.samples)
        moving = np.zeros(len(self.histories))
        moving[-1] = 1.0
        motion = solve_transient(space, self.stepped, state + space.b @ moving, model.samples)
        with_friction, response = None, read_response(space, motion)
        if model.friction_loop is not None:
            with_friction = solve_friction_transient(
                model.friction_loop,
                self.stepped,
                motion,
                inputs=space.inputs,
                outputs=request.outputs,
            )
            response = with_friction.response
        figures = find_figures(response, start=start, final=final, near=request.settled)
        figures = _leave_out_roundoff(figures, request.outputs)
        return _Solution(model, motion, with_friction, figures, *response.sample())


def run_transient_stage(state: RunState, stage: Stage) -> Outcome:
    """Compute the motion under the loads of the request; one that cannot begin is a failure, and
    the run continues.
    """
    if not state.is_root:
        return Outcome()
    model = pose_model(state)
    try:
        solved = _respond_in_time(model)
    except (ModelError, UnstableControlError, ConvergenceError) as error:
        return Outcome(
            detail="refused: see below",
            failures=(f"transient analysis in pose {model.pose.name}: {error}",),
        )
    answer = solved.answer
    detail = (
        f"{len(answer.curves.times)} samples, {answer.modes} modes up to {answer.up_to_hz:g} Hz"
    )
    return Outcome(detail=detail, answers=(answer,), warnings=solved.warnings)


@dataclass(frozen=True, eq=False)
class _LoadedMachine:
    """Describe a machine in a pose with its damping and the loads of a request.

    Attributes:
        machine: The machine in the pose; under control with its motors free.
        system: Its equations of motion, with the loads and the momentum before time zero as inputs.
        trains: Drives whose loops are closed; None where motors are locked.
        probes: Where displacement and stress are wanted.
        prescribed: Displacements over time.
    """

    machine: PoseModel
    system: SecondOrderSystem
    modes: ModalResult
    request: TransientRequest
    trains: tuple[DriveTrain, ...] | None = None
    probes: Mapping[str, PlacedProbe] = field(default_factory=dict)
    prescribed: PrescribedMotion = field(default_factory=PrescribedMotion)

    @property
    def near(self) -> ModalResult:
        """The modes with dynamics, up to the frequency requested."""
        return keep_lowest(self.modes, up_to_hz=self.request.up_to_hz)

    def prepare(
        self, up_to_hz: float | None, softer: SecondOrderSystem | None = None
    ) -> _PreparedModel:
        """Return the state spaces of the model, with modes up to a frequency; None for all.

        Args:
            softer: A system in place of the machine's own, whose modes are not known yet.
        """
        system = softer or self.system
        inputs = (
            *(_input_of(load) for load in self.request.loads),
            *self.prescribed.histories,
            START,
        )
        parts = self.machine.parts
        watched = (*joint_outputs(self.machine.joints), *probe_outputs(parts, self.probes))
        outputs = (*self.request.outputs, *watched)
        if self.trains is None:
            modes = self.modes if softer is None else None
            space = to_state_space(
                system,
                inputs=inputs,
                outputs=outputs,
                up_to_hz=up_to_hz,
                modes=modes,
                little_mass=True,
            )
            for direct in self.prescribed.direct:
                space = space.pass_on(direct)
            return _PreparedModel(space.select(inputs, self.request.outputs), space)
        if _samples_exactly(self.trains, self.request):
            sampled = sample_loops(
                system, self.trains, inputs=inputs, outputs=outputs, up_to_hz=up_to_hz
            )
            if sampled is not None:
                space = sampled.space
                for direct in self.prescribed.direct:
                    space = space.pass_on(direct)
                kept = space.select(inputs, self.request.outputs)
                return _PreparedModel(kept, space, samples=sampled.samples)
        channels = friction_channels(self.trains)
        loop = close_loops(
            system, self.trains, inputs=(*inputs, *channels), outputs=outputs, up_to_hz=up_to_hz
        )
        for direct in self.prescribed.direct:
            loop = dataclasses.replace(loop, space=loop.space.pass_on(direct))
        return _PreparedModel(
            loop.space.select(inputs, self.request.outputs),
            loop.space.select((*inputs, *channels), loop.space.outputs),
            loop if channels else None,
        )

    def widen(self, model: _PreparedModel) -> _PreparedModel:
        """Return a model with modes beyond the range of another: all, where damping does not couple
        them or they are few, and there is no friction.
        """
        few = len(self.modes.frequencies_hz) <= MOST_COUPLED_MODES and model.friction_loop is None
        every = few or model.linear.pairs is not None
        return self.prepare(None if every else BEYOND * self.request.up_to_hz)

    def _find_loss(self) -> StiffnessLoss | None:
        """Return the damping of the modes that is proportional to the stiffness of components; None
        without the effect damping, and of a lumped mechanism.
        """
        scene, coupled, near = self.machine.parts.scene, self.machine.coupled, self.near
        if coupled is None or DAMPING not in scene.effects:
            return None
        energies = {
            name: energy
            for name, energy in strain_energies(coupled, near.shapes[:, near.rigid_count :]).items()
            if name in coupled.offsets
        }
        count = near.shapes.shape[1] - near.rigid_count
        whole = np.sum([np.zeros(count), *energies.values()], axis=0)
        viscous, structural = np.zeros(count), np.zeros(count)
        for name, energy in energies.items():
            share = energy / np.where(whole > 0.0, whole, 1.0)
            viscous += coupled.rayleigh[name].beta * share
            structural += scene.machine.components[name].material.loss_factor * share
        given = np.array(scene.modal_damping or (0.0,))
        return StiffnessLoss(
            viscous, structural, given[np.minimum(np.arange(count), len(given) - 1)]
        )

    def soften(self) -> _RefinedModels[_PreparedModel]:
        """Return models with natural frequencies as low as each source of error allows: meshes and
        reductions make frequencies too high.
        """
        near, loss = self.near, self._find_loss()
        estimates = self.machine.estimate_mode_errors(near)[near.rigid_count :]
        frequencies = near.frequencies_hz[near.rigid_count :]

        def lower(factors: FloatArray) -> _PreparedModel:
            softer = soften_system(self.system, near, factors, loss)
            return self.prepare(self.request.up_to_hz, softer)

        known: dict[str, _PreparedModel] = {}
        doubtful: dict[str, _PreparedModel] = {}
        for source in dict.fromkeys(source for error in estimates for source in error.shares):
            sizes = [error.shares.get(source, 0.0) for error in estimates]
            unknown = np.array([size is None for size in sizes])
            moved = np.array([size or 0.0 for size in sizes]) / frequencies
            factors = 1.0 - np.minimum(moved, MOST_SOFTENED)
            known[source] = lower(factors)
            if unknown.any():
                doubtful[source] = lower(np.where(unknown, 1.0 - MOST_SOFTENED, factors))
        left_out = dict.fromkeys(words for error in estimates for words in error.left_out)
        return _RefinedModels(known, doubtful, tuple(left_out))


def _respond_in_time(machine: PoseModel, *, with_errors: bool = True) -> Solved[TransientAnswer]:
    """Compute the motion of a damped machine in a pose under loads over time.

    Raises:
        ModelError: A load that is suddenly removed acts on an unconstrained motion.
        UnstableControlError: A control loop is unstable.
        ConvergenceError: Motion with friction could not be integrated.
    """
    scene = machine.parts.scene
    request = scene.analyses.get(TransientRequest)
    if request is None:
        raise ValueError("a transient analysis needs one in the scene")
    warnings: list[str] = []
    loaded = _load_machine(machine, request, warnings.append)
    further = loaded.prescribed.histories.values()
    histories = (*(load.history for load in request.loads), *further, no_load())
    case = _LoadCase(
        request, histories, step_loads(histories, request.duration, request.sampling_hz)
    )
    solution = case.solve(loaded.prepare(request.up_to_hz))
    refined = _RefinedModels[_Solution]()
    if with_errors and has_symmetric_terms(loaded.system):
        refined = _list_refined_models(loaded, solution.model).convert(case.solve)
    warnings += [warn_of_singular(name, probe.singular) for name, probe in loaded.probes.items()]
    unbalanced = _explain_imbalance(solution, request.sampling_hz)
    if unbalanced is not None:
        warnings.append(f"transient analysis in pose {machine.pose.name}: {unbalanced}")
    return Solved(_make_answer(loaded, case, solution, refined), tuple(warnings))


def _make_answer(
    loaded: _LoadedMachine, case: _LoadCase, solution: _Solution, refined: _RefinedModels[_Solution]
) -> TransientAnswer:
    """Build the answer from the motions of a model and of those without a source of error."""
    request, machine, sampled = case.request, loaded.machine, case.stepped.sampled
    controlled, values, moved = loaded.trains is not None, case.values, solution.moving
    changed = refined.convert(lambda other: other.moving)
    probes = trace_motion(
        loaded.probes,
        moved,
        changed.known,
        doubtful=changed.doubtful,
        loads=[load.target if isinstance(load.target, str) else "" for load in request.loads],
        sampled=sampled,
        up_to_hz=request.up_to_hz,
        left_out=refined.left_out,
    )
    closed = tuple(machine.parts.scene.drives.values()) if controlled else ()
    drives = follow_drives(closed, moved.space, moved.motion)
    errors = _compare_peaks(solution, refined)
    return TransientAnswer(
        curves=TransientCurves(
            pose=machine.pose.name,
            outputs=request.outputs,
            times=solution.times,
            displacements=solution.displacements,
            loads=tuple(load.name for load in request.loads),
            units=tuple(_unit_of(load) for load in request.loads),
            load_values=values,
            drives=tuple(drives.extremes),
            torques=drives.torques[sampled],
            position_errors=drives.position_errors[sampled],
            probes=tuple(probe.trace for probe in probes.values()),
        ),
        figures=solution.figures,
        errors={
            peak_key(machine.pose.name, channel): error
            for channel, error in zip(request.outputs, errors, strict=True)
        },
        acts_on=tuple(
            (load.target if isinstance(load.target, str) else name_channel(load.target))
            for load in request.loads
        ),
        shapes=tuple(load.shape for load in request.loads),
        sizes=tuple(_largest(load, values[:, number]) for number, load in enumerate(request.loads)),
        duration=request.duration,
        sampling_hz=request.sampling_hz,
        up_to_hz=request.up_to_hz,
        modes=len(loaded.near.frequencies_hz) if controlled else len(solution.model.linear.a) // 2,
        settled=request.settled,
        damped=controlled
        or loaded.system.damping is not None
        or loaded.system.hysteretic is not None,
        energy=solution.energy,
        motors=request.motors,
        drives=drives.extremes,
        joints=largest_joint_forces(
            machine.joints,
            moved.motion.instants,
            lambda joint: moved.motion.observe(moved.space.watch(watch_joints([joint]))),
        ),
        probes=probes,
    )


def _list_refined_models(
    loaded: _LoadedMachine, model: _PreparedModel
) -> _RefinedModels[_PreparedModel]:
    """List models without one source of error each."""
    softer = loaded.soften()
    known = {TRUNCATION: loaded.widen(model)} | softer.known
    if model.friction_loop is not None:
        sharper = sharpen_friction(model.friction_loop, SHARPER)
        known[SMOOTHING] = dataclasses.replace(model, friction_loop=sharper)
    return dataclasses.replace(softer, known=known)


def _explain_imbalance(solution: _Solution, sampling_hz: float) -> str | None:
    """Explain an energy imbalance, with its remedy; None where energy balances."""
    if solution.with_friction is not None:
        error = solution.with_friction.motion.energy.error
        if error > UNBALANCED_FRICTION:
            return f"the energy balance misses {error:.2g} of the work, more than {UNBALANCED_FRICTION:g}; give friction a larger smoothing"
        return None
    energy = solution.energy
    if energy is not None and energy.error > UNBALANCED_ENERGY:
        return (
            f"{100.0 * energy.error:.2g} % of the energy are missing between samples at {sampling_hz:g} Hz:"
            " the loads set off modes that are too fast for them; raise sampling or lower up_to"
        )
    return None


def _load_machine(
    machine: PoseModel, request: TransientRequest, warn: Callable[[str], None]
) -> _LoadedMachine:
    """Return a machine with the loads of a request.

    Raises:
        UnstableControlError: A control loop is unstable.
    """
    scene, trains, driven = machine.parts.scene, None, None
    if request.motors == "controlled":
        driven = drive_machine(machine, warn)
        machine, system, trains = driven.released, driven.system, driven.trains
        exact = _samples_exactly(trains, request)
        modes, poles = driven.modes, check_loops(driven, warn, continuous=not exact)
        if poles.limit_hz < request.up_to_hz:
            warn(
                f"transient analysis in pose {machine.pose.name}: dead times of the drives are right up to {poles.limit_hz:.4g} Hz only, and modes"
                f" up to {request.up_to_hz:.4g} Hz vibrate; lower up_to"
            )
    else:
        for message in warn_of_no_damping(scene, machine.system):
            warn(message)
        modes = machine.all_modes
        system = damp_system(scene, machine.system, modes)
    probes = place_probes(machine.parts, machine.coupled, request.probes)
    prescribed = prescribe_motion(machine, system, request, list(probes), driven)
    system = _add_channels(system, machine, request, probes)
    system = dataclasses.replace(system, inputs=system.inputs | dict(prescribed.inputs))
    return _LoadedMachine(machine, system, modes, request, trains, probes, prescribed)


def _samples_exactly(trains: Sequence[DriveTrain], request: TransientRequest) -> bool:
    """Return whether all controllers sample at one step, which the samples of the motion divide, and no
    friction acts in between.
    """
    steps = {train.control.law.step_s for train in trains}
    if len(steps) != 1 or friction_channels(tuple(trains)):
        return False
    count = steps.pop() * request.sampling_hz
    return count > 0.5 and abs(count - round(count)) < SAME_STEP


def _add_channels(
    system: SecondOrderSystem,
    machine: PoseModel,
    request: TransientRequest,
    probes: Mapping[str, PlacedProbe],
) -> SecondOrderSystem:
    """Return the system of a machine with named static loads and the momentum before time zero as
    inputs, and joint forces and probes as outputs.
    """
    named = {
        _input_of(load): machine.loads[load.target]
        for load in request.loads
        if isinstance(load.target, str)
    }
    velocities = {name: np.array(speeds) for name, speeds in request.velocities.items()}
    inputs = system.inputs | named | {START: machine.momentum(velocities)}
    observed = joint_outputs(machine.joints) | probe_outputs(machine.parts, probes)
    return dataclasses.replace(system, inputs=inputs, outputs=system.outputs | observed)


def _input_of(load: TimedLoad) -> Channel:
    return (load.target, LOAD) if isinstance(load.target, str) else load.target


def _leave_out_roundoff(
    figures: tuple[TransientFigures, ...], outputs: Sequence[Channel]
) -> tuple[TransientFigures, ...]:
    """Remove overshoot and settling time of outputs that symmetry keeps at rest."""
    still = find_roundoff([dof for _, dof in outputs], np.abs([own.peak for own in figures]))
    return tuple(
        TransientFigures(0.0, 0.0, 0.0, None if own.final is None else 0.0, None, None)
        if rests
        else own
        for own, rests in zip(figures, still, strict=True)
    )


def _compare_peaks(solution: _Solution, refined: _RefinedModels[_Solution]) -> tuple[Estimate, ...]:
    """Compare each peak with those of other models; unknown where modes without estimate matter."""

    def change(other: _Solution, number: int) -> float:
        return abs(abs(other.figures[number].peak) - abs(solution.figures[number].peak))

    estimates = []
    for number, figure in enumerate(solution.figures):
        shares: dict[str, float | None] = {
            source: (REMAINING if source == SMOOTHING else 1.0) * change(other, number)
            for source, other in refined.known.items()
        }
        for source, other in refined.doubtful.items():
            size = change(other, number)
            shares[source] = size if size <= SILENT_SHARE * abs(figure.peak) else None
        estimates.append(Estimate(shares, refined.left_out))
    return tuple(estimates)


def _unit_of(load: TimedLoad) -> str:
    if isinstance(load.target, str):
        return "1"
    unit = "N m" if load.target[1].startswith("r") else "N"
    return f"{unit} s" if load.shape == "impulse" else unit


def _largest(load: TimedLoad, values: FloatArray) -> float:
    struck = [abs(size) for _, size in load.history.impulses]
    return float(max([*struck, np.abs(values).max(initial=0.0), abs(load.history.before)]))
