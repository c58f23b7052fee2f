"""The frequency response stage, with the errors of its lines and of its figures of stability from
meshes and modes left out.

Only rank 0 has anything to do.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.pipeline.answers.frf import (
    DrivePointFigures,
    Height,
    PoseResponse,
    ResponseCurves,
)
from headstock.pipeline.answers.probes import ProbeCurves
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    LEFT_OUT,
    REDUCTION,
    Estimate,
    combine_estimates,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.control import DrivenMachine, drive_machine, list_poles
from headstock.pipeline.stages.estimates import estimate_parts, name_what_is_left_out
from headstock.pipeline.stages.machine import DAMPING, damp_system, warn_of_no_damping
from headstock.pipeline.stages.prescribed import Displacement, place_displacement
from headstock.pipeline.stages.probes import (
    estimated_channels,
    material_factors,
    trace_probes,
    warn_of_singular,
    watched_rows,
)
from headstock.pipeline.stages.run_state import (
    HarmonicMotion,
    MachineParts,
    Outcome,
    PoseModel,
    PoseMotions,
    RunState,
    Solved,
    pose_model,
    pose_name,
)
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.probes import PlacedProbe, component_factors, place_probe
from headstock.reduction.estimates.figure_errors import find_peak_errors
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.estimates.mesh_errors import meshed_parts
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    ResponseErrors,
    ResponseSpace,
    SystemChange,
    bound_response_errors,
    project_response,
    soften_response,
)
from headstock.reduction.estimates.static_errors import SEEN
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.scene import LOAD
from headstock.solvers.control.closed_response import (
    CONTROLLED,
    ClosedResponse,
    control_forces,
    find_rest,
    prepare_closed_frf,
)
from headstock.solvers.control.drive_loops import SET_POINTS, force_channels
from headstock.solvers.control.drive_trains import (
    COMMANDS,
    DRIVE_CHANNELS,
    ROTARY_CHANNELS,
    DriveTrain,
)
from headstock.solvers.control.margins import command_forces
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.linear.frequency_response import (
    UNDAMPED,
    FrequencyResponse,
    FrfModel,
    StabilityFigures,
    evaluate_frf,
    find_links,
    find_peaks,
    find_stability_figures,
    prepare_frf,
    refine_grid,
)
from headstock.solvers.linear.mixed_inputs import InputMix, MixedInput, MixedResponse
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, count_modes, keep_modes
from headstock.solvers.pairing.response_peaks import (
    ResponseLevel,
    ResponsePeak,
    find_levels,
    find_response_peaks,
)
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

NEIGHBOURHOOD = 0.2  # of a peak's frequency: lines that follow it when it moves
NAMED_MARGIN = 1.2
SENSORS_NAMED = 4  # in a line of what ± lacks
EVEN_LINES = 9  # of a response, by which runs are compared


@dataclass(frozen=True, eq=False)
class ResponseEstimate:
    """Errors of a response, and what they were found with.

    Attributes:
        errors: Changes of every line.
        left_out: What is not in them, in plain words.
    """

    errors: ResponseErrors
    space: ResponseSpace
    left_out: tuple[str, ...]

    @property
    def shares(self) -> dict[str, FloatArray]:
        """Source to the size of its part ``(n_freq, n_outputs, n_inputs)``; NaN where there is no
        bound, none without a meshed part.
        """
        if self.errors.mesh_sizes is None:
            return {}
        sizes = {DISCRETISATION: self.errors.mesh_sizes, CURVED_FACES: self.errors.face_sizes}
        return {source: size for source, size in sizes.items() if size is not None} | {
            REDUCTION: self.errors.bounds
        }


def estimate_response_errors(
    parts: MachineParts,
    system: SecondOrderSystem,
    coupled: CoupledMachine,
    modes: ModalResult,
    response: FrequencyResponse,
    trains: Sequence[DriveTrain] | None = None,
    mix: InputMix | None = None,
) -> ResponseEstimate:
    """Change of every line of a response by finer meshes and by the modes left out.

    Args:
        trains: The drives of the system whose loops are closed; None where motors are locked.
        mix: Inputs of the response that act by several loads; None where each is a load.
    """
    loads = response.inputs if mix is None else mix.loads
    channels = (input_columns(system, loads), output_rows(system, response.outputs))
    space = project_response(
        system,
        find_error_sources(parts, coupled),
        modes,
        channels,
        float(response.frequencies_hz.max()),
        None if trains is None else control_forces(system, trains),
    )
    errors = bound_response_errors(space, response.frequencies_hz)
    if mix is not None and mix.mixed:
        errors = errors.mix(mix.weigh(2.0 * np.pi * response.frequencies_hz))
    left_out = name_what_is_left_out(parts).left_out
    return ResponseEstimate(errors, space, (*left_out, *_name_direct_channels(parts, response)))


def find_error_sources(parts: MachineParts, coupled: CoupledMachine) -> ErrorSources:
    """Components with modes left out or with a mesh, and their damping where it acts."""
    truncated, meshed = truncated_parts(coupled), meshed_parts(coupled)
    if DAMPING not in parts.scene.effects:
        return ErrorSources(truncated, meshed)
    names = [n for n in coupled.layout.superelements if n in truncated.keys() | meshed.keys()]
    losses = {name: parts.plan.components[name].material.loss_factor for name in names}
    return ErrorSources(truncated, meshed, losses, coupled.rayleigh)


def _name_direct_channels(parts: MachineParts, response: FrequencyResponse) -> tuple[str, ...]:
    """Name loads that excite modes which a component leaves out, and sensors that are moved by them:
    the bounds know interfaces alone, and sensors whose static response is kept.
    """
    machine, components = parts.scene.machine, parts.plan.components

    def is_reduced(component: str) -> bool:
        return components[component].fidelity not in ("rigid", "segmented")

    inside = [
        name
        for name, dof in response.inputs
        if dof == LOAD and any(map(is_reduced, _list_loaded(machine, name)))
    ]
    moved = [
        name
        for name in dict.fromkeys(name for name, _ in response.outputs)
        if (sensor := machine.sensors.get(name)) is not None
        and not sensor.is_loaded
        and is_reduced(sensor.component)
    ]
    shown = ", ".join(moved[:SENSORS_NAMED]) + ", ..." * (len(moved) > SENSORS_NAMED)
    return (
        *((f"modes left out that {', '.join(inside)} would excite directly",) if inside else ()),
        *(
            (f"modes left out that move {shown} directly; residual_modes = true keeps most",)
            if moved
            else ()
        ),
    )


def _list_loaded(machine: Machine, name: str) -> list[str]:
    """Return the components inside of which a load acts: all of them of a ground that moves."""
    if name in machine.base_motions:
        return list(machine.components)
    if name in machine.displacements:
        joint = machine.joints[machine.displacements[name].joint]
        return [end.component for end in joint.ends if end.component and joint.fixed]
    load = machine.loads[name]
    return [] if load.kind == "force" else [load.component]


def estimate_figures(
    figures: tuple[DrivePointFigures, ...],
    response: FrequencyResponse,
    estimate: ResponseEstimate | None,
) -> dict[Channel, Estimate]:
    """Return the ± of most negative real parts by drive point: a peak that moves keeps its depth.

    Args:
        response: The response they were read from.
        estimate: Errors of its lines; None where there is no estimate.
    """
    if estimate is None or not estimate.shares:
        return {}
    estimates = {}
    for figure in figures:
        row, column = response.outputs.index(figure.channel), response.inputs.index(figure.channel)
        plain = response.receptance[:, row, column]
        low, high = (
            change[:, row, column] for change in (estimate.errors.least, estimate.errors.most)
        )
        bounded = np.isfinite(plain) & np.isfinite(high)
        if (
            figure.most_negative_real is None
            or figure.most_negative_real_hz is None
            or not _reaches(response.frequencies_hz, bounded, figure.most_negative_real_hz)
        ):
            continue
        depths = [
            _deepest(plain[bounded] + change[bounded])
            for change in (np.zeros_like(plain), low, high)
        ]
        shares = {
            REDUCTION: max(abs(depths[1] - depths[0]), abs(depths[2] - depths[0]))
            + abs(depths[2] - depths[1])
        }
        if estimate.errors.mesh is not None:
            softer = _softer_depth(
                response, estimate, figure.most_negative_real_hz, row=row, column=column
            )
            # nothing is known of the mesh near the deepest line: then nothing is known of the depth
            if softer is None:
                continue
            shares = {DISCRETISATION: abs(softer - depths[0])} | shares
        estimates[figure.channel] = Estimate(shares)
    return estimates


def _softer_depth(
    response: FrequencyResponse, estimate: ResponseEstimate, hz: float, *, row: int, column: int
) -> float | None:
    """Most negative real part with finer meshes; lines are dense where peaks are, so those around
    the deepest move along with it.

    None where nothing is known of any line.
    """
    lines, mesh = response.frequencies_hz, estimate.errors.mesh
    softer = response.receptance[:, row, column] + (0.0 if mesh is None else mesh[:, row, column])
    near = lines[np.abs(lines - hz) < NEIGHBOURHOOD * hz]
    moved = soften_response(estimate.space, near * estimate.space.softening(hz))[:, row, column]
    values = np.concatenate([softer[np.isfinite(softer)], moved[np.isfinite(moved)]])
    return _deepest(values) if np.isfinite(softer).any() else None


def _deepest(values: ComplexArray) -> float:
    return float(values.real.min())


def _reaches(frequencies_hz: FloatArray, bounded: BoolArray, hz: float) -> bool:
    return bool(bounded.any()) and float(frequencies_hz[bounded].max()) >= hz


def run_frf_stage(state: RunState, stage: Stage) -> Outcome:
    """Frequency response between the requested channels, from 0 Hz on, with what it says about cutting."""
    if not state.is_root:
        return Outcome()
    try:
        machine = pose_model(state)
        if _frf_request(machine).motors == "free":
            machine = drive_machine(machine, state.warn).released
        solved, harmonic = respond(machine), _find_harmonic_motions(machine)
    except UnstableControlError as error:
        state.failures.append(f"frequency response in pose {pose_name(stage)}: {error}")
        return Outcome(detail="unstable control: see below")
    if harmonic:
        motions = state.motions.get(machine.pose.name, PoseMotions(machine.offsets))
        state.motions[machine.pose.name] = dataclasses.replace(motions, harmonic=harmonic)
    response = solved.answer
    detail = f"{len(response.curves.frequencies_hz)} frequencies, {response.method}"
    return Outcome(detail=detail, answers=(response,), warnings=solved.warnings)


def prepare_response(machine: PoseModel) -> FrfModel:
    """A machine in a pose, with the damping of its scene and under control where that is asked for,
    ready for its response.

    Raises:
        UnstableControlError: A control loop is.
    """
    return _load_machine(machine).prepare(_frf_request(machine).outputs)


@dataclass(frozen=True, eq=False)
class _LoadedMachine:
    """A machine in a pose with its damping and the loads of a request.

    Attributes:
        system: Its equations of motion; with motors let go under control.
        coupled: Of superelements; None of a lumped mechanism.
        mix: Inputs of the request, and the loads by which they act.
        bare: Its equations without modal damping; under control those that it is.
        trains: Its drives, whose loops are closed; None where motors are locked.
        moved: Input to the motion ``(n_all,)`` of the stacked dofs that it makes by itself.
    """

    system: SecondOrderSystem
    coupled: CoupledMachine | None
    modes: ModalResult
    mix: InputMix
    bare: SecondOrderSystem
    trains: tuple[DriveTrain, ...] | None = None
    moved: Mapping[Channel, FloatArray] = field(default_factory=dict)

    def prepare(
        self, outputs: Sequence[Channel], rows: Mapping[Channel, FloatArray] | None = None
    ) -> FrfModel:
        """Ready for its response at outputs, with further rows ``(n,)`` of them.

        Raises:
            UnstableControlError: A control loop is.
        """
        system = dataclasses.replace(self.system, outputs=self.system.outputs | {**(rows or {})})
        loads, mixed = self.mix.loads, bool(self.mix.mixed)
        if self.trains is None:
            model = prepare_frf(system, inputs=loads, outputs=outputs, modes=self.modes)
            linked = find_links(self.bare, model.direct.loads, model.direct.rows)
            model = model if linked.all() else dataclasses.replace(model, linked=linked)
            return self.mix.apply(model, {}) if mixed else model
        model = prepare_closed_frf(
            system, self.trains, inputs=loads, outputs=outputs, modes=self.modes
        )
        commands = [one for one in self.mix.mixed if one[1] in COMMANDS]
        positions = [(axis, SET_POINTS[0]) for axis, _ in commands]
        resting = find_rest(_closed_form(model).loop, outputs, positions).T
        return self.mix.apply(model, dict(zip(commands, resting, strict=True))) if mixed else model


def _closed_form(model: FrfModel) -> ClosedResponse:
    """Return the closed loops of a response under control.

    Raises:
        ValueError: It is none.
    """
    form = model.form.form if isinstance(model.form, MixedResponse) else model.form
    if not isinstance(form, ClosedResponse):
        raise ValueError("the response is not one under control")
    return form


def _load_machine(machine: PoseModel) -> _LoadedMachine:
    request, driven, bare = _frf_request(machine), None, None
    scene = machine.parts.scene
    if request.motors == "controlled":
        driven = drive_machine(machine, lambda message: None)
        machine, modes, system = driven.released, driven.modes, driven.system
    else:
        modes, bare = machine.all_modes, machine.system
        system = damp_system(scene, bare, modes)
    system = _add_inputs(system, machine.loads, request)
    mixed: dict[Channel, MixedInput] = {}
    moved = {}
    for given in request.inputs:
        if given[1] in COMMANDS and driven is not None:
            trains = [train for train in driven.trains if train.axis == given[0]]
            mixed[given] = MixedInput(force_channels(trains), partial(command_forces, trains))
        elif given[1] == LOAD and given[0] in scene.machine.displacements:
            placed = _displace(machine, system, given[0], driven)
            mixed[given], moved[given] = placed.mixed, placed.moved
            system = dataclasses.replace(system, inputs=system.inputs | placed.inputs)
    return _LoadedMachine(
        system,
        machine.coupled,
        modes,
        InputMix(request.inputs, mixed),
        bare or system,
        None if driven is None else driven.trains,
        moved,
    )


def _displace(
    machine: PoseModel, system: SecondOrderSystem, name: str, driven: DrivenMachine | None
) -> Displacement:
    """Return a displacement as an input, seen at points, interfaces and probes."""
    request = _frf_request(machine)
    points = [one for one in request.outputs if one[1] not in DRIVE_CHANNELS]
    probes = {
        probe: [(probe, f"values {number}") for number in range(SEEN)] for probe in request.probes
    }
    return place_displacement(machine, system, name, outputs=points, probes=probes, driven=driven)


def _add_inputs(
    system: SecondOrderSystem, loads: Mapping[str, FloatArray], request: FrfRequest
) -> SecondOrderSystem:
    """Return a system with the loads of a request among its inputs, and channels of rotary drives under
    the names that say their units.
    """
    system = add_load_inputs(system, loads, request.inputs)
    inputs, outputs = dict(system.inputs), dict(system.outputs)
    for name, word in (*request.inputs, *request.outputs):
        for known in (inputs, outputs):
            if (name, ROTARY_CHANNELS.get(word, "")) in known:
                known[name, word] = known[name, ROTARY_CHANNELS[word]]
    return dataclasses.replace(system, inputs=inputs, outputs=outputs)


def _place_probes(
    parts: MachineParts, loaded: _LoadedMachine, names: Sequence[str]
) -> dict[str, PlacedProbe]:
    """Probes of a machine in the coordinates of its response; none of a lumped mechanism."""
    coupled, machine = loaded.coupled, parts.scene.machine
    if coupled is None:
        return {}
    return {
        name: place_probe(coupled, machine, machine.probes[name], parts.plan.gravity)
        for name in names
    }


def _find_harmonic_motions(machine: PoseModel) -> tuple[HarmonicMotion, ...]:
    """Motions of all superelement dofs at the frequencies of a request, under each of its inputs;
    none of a lumped mechanism.

    Raises:
        UnstableControlError: A control loop is.
    """
    request, parts = _frf_request(machine), machine.parts
    loaded = _load_machine(machine)
    if loaded.coupled is None or not request.fields_at:
        return ()
    rows = {
        ("coordinate", str(number)): np.asarray(row)
        for number, row in enumerate(np.eye(len(loaded.system.labels)))
    }
    response = evaluate_frf(loaded.prepare(list(rows), rows), np.array(request.fields_at))
    own, coupled = parts.scene.machine, loaded.coupled
    loads = {name: component_factors(coupled, own, name, None) for name in parts.plan.components}
    motions = []
    for line, hz in enumerate(request.fields_at):
        omega = np.array(2.0 * np.pi * hz)
        lossy = {name: complex(material_factors(parts, name, omega)[0]) for name in loads}
        for column, given in enumerate(request.inputs):
            inside = {
                name: factors[given[0]]
                for name, factors in loads.items()
                if given[1] == LOAD and given[0] in factors
            }
            motion = coupled.basis @ response.receptance[line, :, column]
            motion = motion + loaded.moved.get(given, 0.0)
            motions.append(HarmonicMotion(given, hz, motion, inside, lossy))
    return tuple(motions)


def add_load_inputs(
    system: SecondOrderSystem, loads: Mapping[str, FloatArray], inputs: Sequence[Channel]
) -> SecondOrderSystem:
    """The system with those of its inputs that are loads of the scene.

    Args:
        loads: Generalised load ``(n,)`` of each by name.
    """
    named = {(name, dof): loads[name] for name, dof in inputs if dof == LOAD}
    return dataclasses.replace(system, inputs=system.inputs | named) if named else system


def _frf_request(machine: PoseModel) -> FrfRequest:
    request = machine.parts.scene.analyses.get(FrfRequest)
    if request is None:
        raise ValueError("a frequency response needs an analysis in the scene")
    return request


def respond(
    machine: PoseModel, *, with_errors: bool = True, model: FrfModel | None = None
) -> Solved[PoseResponse]:
    """Frequency response of a machine in a pose with the damping of its scene.

    Args:
        with_errors: Name the modes of least dynamic stiffness, and estimate errors of a machine of
            superelements.
        model: Of ``prepare_response``, where it is already known.
    """
    request, loaded = _frf_request(machine), _load_machine(machine)
    model = model or loaded.prepare(request.outputs)
    poles = find_peaks(model, request.to_hz)
    response = evaluate_frf(model, frequency_grid(request, poles))
    bounded = peaks_have_tops(poles, request.to_hz)
    probes = _place_probes(machine.parts, loaded, request.probes) if with_errors else {}
    estimate = (
        _estimate_lines(machine.parts, loaded, model, response, probes) if with_errors else None
    )
    shares = {} if estimate is None else estimate.shares
    modes_hz, names = _name_peaks(machine, model, with_errors=with_errors)
    figures = find_stability_figures(model, response) if bounded else ()
    ports = _port_figures(request, model, figures, modes_hz=modes_hz, names=names)
    peaks, levels = _find_heights(model, request) if with_errors else ((), ())
    count, linked = len(response.outputs), True if model.linked is None else model.linked
    answer = PoseResponse(
        curves=ResponseCurves(
            machine.pose.name,
            response.inputs,
            response.outputs,
            response.frequencies_hz,
            response.receptance,
            request.motion,
            request.spacing,
            {source: np.where(linked, size[:, :count], 0.0) for source, size in shares.items()},
            _trace_probes(machine.parts, loaded, response, probes, shares),
        ),
        method=response.method,
        damped=_is_damped(model),
        free_body=_name_entries(response, np.asarray(response.free_body.any(axis=0))),
        singular_hz=tuple(
            float(hz) for hz in response.frequencies_hz[response.singular.any(axis=(1, 2))]
        ),
        figures=ports,
        error_left_out=() if estimate is None else estimate.left_out,
        peaks=peaks,
        levels=levels,
    )
    heights = zip(map(answer.key, answer.heights), estimate_heights(machine, answer), strict=True)
    drive_points = estimate_figures(ports, response, estimate).items()
    errors = dict(heights) | {answer.figure_key(channel): error for channel, error in drive_points}
    warnings = (
        *warn_of_no_damping(machine.parts.scene, machine.system),
        *_warn_of_response(model, response, bounded=bounded),
        *(warn_of_singular(name, probe.singular) for name, probe in probes.items()),
    )
    return Solved(dataclasses.replace(answer, errors=errors), warnings)


def _is_damped(model: FrfModel) -> bool:
    system = model.direct.system
    return system.damping is not None or system.hysteretic is not None or model.method == CONTROLLED


def _warn_of_response(
    model: FrfModel, response: FrequencyResponse, *, bounded: bool
) -> Iterator[str]:
    """Warn of peaks without a top, and of entries between bodies that nothing connects."""
    if not bounded:
        yield (
            "frequency response: a mode in the range has no damping, so its peak is unbounded; "
            "write [effects] damping = true and give joints or materials damping, or damping = { modal = 0.02 }"
        )
    if model.linked is not None:
        named = ", ".join(_name_entries(response, ~model.linked))
        yield f"frequency response: {named}: zero, because nothing connects these bodies"


def _estimate_lines(
    parts: MachineParts,
    loaded: _LoadedMachine,
    model: FrfModel,
    response: FrequencyResponse,
    probes: Mapping[str, PlacedProbe],
) -> ResponseEstimate | None:
    """Estimate errors of every line, also at probes; None of a lumped mechanism."""
    if loaded.coupled is None:
        return None
    system = model.direct.system
    return estimate_response_errors(
        parts,
        dataclasses.replace(system, outputs=system.outputs | watched_rows(probes)),
        loaded.coupled,
        loaded.modes,
        dataclasses.replace(response, outputs=(*response.outputs, *estimated_channels(probes))),
        loaded.trains,
        loaded.mix,
    )


def _trace_probes(
    parts: MachineParts,
    loaded: _LoadedMachine,
    response: FrequencyResponse,
    probes: Mapping[str, PlacedProbe],
    shares: Mapping[str, FloatArray],
) -> tuple[ProbeCurves, ...]:
    """Trace probes at the lines of a response.

    Args:
        shares: Errors of its outputs, then of the probes.
    """
    if not probes:
        return ()
    rows, count = watched_rows(probes), len(response.outputs)
    lines = evaluate_frf(loaded.prepare(list(rows), rows), response.frequencies_hz)
    return trace_probes(
        parts, probes, lines, {source: size[:, count:] for source, size in shares.items()}
    )


def _find_heights(
    model: FrfModel, request: FrfRequest
) -> tuple[tuple[ResponsePeak, ...], tuple[ResponseLevel, ...]]:
    """Return peaks and levels; of an entry and its reciprocal one the first stands for both. None under
    control, whose resonances are no natural modes.
    """
    if model.method == CONTROLLED:
        return (), ()

    def place(height: Height) -> tuple[frozenset[Channel], int]:
        ends = frozenset((model.outputs[height.output], model.inputs[height.given]))
        return ends, -1 if isinstance(height, ResponseLevel) else height.mode

    def once[H: Height](heights: Sequence[H]) -> tuple[H, ...]:
        return tuple({place(each): each for each in reversed(heights)}.values())[::-1]

    mixed = model.form.mix.mixed if isinstance(model.form, MixedResponse) else {}
    peaks = find_response_peaks(model, request.from_hz, request.to_hz)
    levels = find_levels(model, request.from_hz)
    return (
        once([peak for peak in peaks if model.inputs[peak.given] not in mixed]),
        once([level for level in levels if model.inputs[level.given] not in mixed]),
    )


def estimate_heights(machine: PoseModel, answer: PoseResponse) -> list[Estimate]:
    """Return the ± of peaks, then levels, of a response of a machine, as far as these are known.

    Args:
        answer: Its response, or that of another model of it with peaks followed.
    """
    request, coupled = _frf_request(machine), machine.coupled
    if coupled is None or not answer.heights:
        return [Estimate()] * len(answer.heights)
    bare = _add_inputs(machine.system, machine.loads, request)
    sources = find_error_sources(machine.parts, coupled)
    channels = (input_columns(bare, request.inputs), output_rows(bare, request.outputs))
    space = project_response(bare, sources, machine.all_modes, channels, request.to_hz)

    def respond(change: SystemChange | None) -> FrfModel:
        # ratios of modes are those of the changed ones
        changed = space.changed_system(request.inputs, request.outputs, change)
        system = damp_system(machine.parts.scene, changed)
        return prepare_frf(system, inputs=request.inputs, outputs=request.outputs)

    changes = find_peak_errors(space, respond, answer.peaks, answer.levels)
    by_source = [
        estimate_parts(source, sizes, len(answer.heights))
        for source, sizes in (
            (DISCRETISATION, changes.finer),
            (CURVED_FACES, changes.faces),
            (LEFT_OUT, changes.left_out),
            (REDUCTION, changes.modes),
        )
    ]
    return [combine_estimates(shares) for shares in zip(*by_source, strict=True)]


def _name_peaks(
    machine: PoseModel, model: FrfModel, *, with_errors: bool
) -> tuple[FloatArray, tuple[str, ...]]:
    """Frequencies of the modes, or of the poles under control, around a response, and their names
    where they are wanted.
    """
    limit = NAMED_MARGIN * _frf_request(machine).to_hz
    if with_errors and model.method == CONTROLLED:
        driven = drive_machine(machine, lambda message: None)
        listed = list_poles(driven, _closed_form(model).found, limit)
        return np.array([pole.frequency_hz for pole in listed]), tuple(pole.name for pole in listed)
    near = keep_lowest(machine.all_modes, up_to_hz=limit)
    if not with_errors:
        return near.frequencies_hz, ()
    # what moves freely has no resonance: which of its motions comes first means nothing
    free = ("",) * near.rigid_count
    return near.frequencies_hz, free + machine.name_modes(near).names[near.rigid_count :]


def peaks_have_tops(poles: ComplexArray, to_hz: float) -> bool:
    """Return whether every mode up to a frequency has damping; a free motion has no peak.

    Args:
        poles: Of the system [rad/s].
    """
    near = poles[(np.abs(poles) > 0.0) & (np.abs(poles) <= 2.0 * np.pi * to_hz)]
    return bool((np.abs(near.real) > UNDAMPED * np.abs(near)).all())


def frequency_grid(request: FrfRequest, poles: ComplexArray) -> FloatArray:
    """The even grid of a request, finer around resonances unless it says otherwise."""
    space = np.geomspace if request.spacing == "log" else np.linspace
    base = np.asarray(space(request.from_hz, request.to_hz, request.points), dtype=float)
    return refine_grid(base, poles) if request.adaptive else base


def _name_entries(response: FrequencyResponse, chosen: BoolArray) -> tuple[str, ...]:
    rows, columns = np.nonzero(chosen)
    return tuple(
        f"{' '.join(response.outputs[row])} / {' '.join(response.inputs[column])}"
        for row, column in zip(rows, columns, strict=True)
    )


def _port_figures(
    request: FrfRequest,
    model: FrfModel,
    stability: tuple[StabilityFigures, ...],
    *,
    modes_hz: FloatArray,
    names: tuple[str, ...],
) -> tuple[DrivePointFigures, ...]:
    by_channel = {figures.channel: figures for figures in stability}
    space = np.geomspace if request.spacing == "log" else np.linspace
    even = np.asarray(space(request.from_hz, request.to_hz, EVEN_LINES), dtype=np.float64)
    lines, ports = evaluate_frf(model, even), []
    for channel in request.inputs:
        if channel not in request.outputs:
            continue
        row, column = request.outputs.index(channel), request.inputs.index(channel)
        static, limits = float(model.at_rest[row, column]), by_channel.get(channel)
        figures = DrivePointFigures(
            channel=channel,
            static=None if np.isnan(static) else static,
            truncation_share=_truncation_share(model.coordinates, row, column, request.to_hz),
            lines_hz=tuple(float(line) for line in lines.frequencies_hz),
            lines=tuple(
                None if np.isnan(value) else float(abs(value))
                for value in lines.receptance[:, row, column]
            ),
        )
        if limits is not None:
            nearest = np.abs(modes_hz - limits.minimum_dynamic_stiffness_hz) if names else None
            figures = dataclasses.replace(
                figures,
                most_negative_real=limits.most_negative_real,
                most_negative_real_hz=limits.most_negative_real_hz,
                chatter_limit=limits.chatter_limit,
                minimum_dynamic_stiffness=limits.minimum_dynamic_stiffness,
                minimum_dynamic_stiffness_hz=limits.minimum_dynamic_stiffness_hz,
                minimum_dynamic_stiffness_mode=""
                if nearest is None
                else names[int(np.argmin(nearest))],
            )
        ports.append(figures)
    return tuple(ports)


def _truncation_share(
    coordinates: ModalCoordinates | None, row: int, column: int, limit_hz: float
) -> float | None:
    """Share of static compliance that elastic modes up to a frequency miss; None without any."""
    if coordinates is None or not coordinates.elastic[row, column]:
        return None
    kept = keep_modes(coordinates, count_modes(coordinates, limit_hz))
    return float(kept.residual[row, column] / coordinates.elastic[row, column])
