"""The modal stage: undamped modes with names, energy shares, damping and errors; and their spread
by the kind of coupling.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, position_units
from headstock.geometry.parts.components import CouplingKind
from headstock.pipeline.answers.modal import (
    DAMPED_FREQUENCY,
    DAMPING_RATIO,
    FREQUENCY,
    PoseModes,
)
from headstock.pipeline.numbers.estimates import ALL_SOURCES, Estimate
from headstock.pipeline.numbers.numbers import Key, make_key
from headstock.pipeline.planning.interfaces import has_choice, recouple
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.machine import (
    DAMPING,
    CoupledPose,
    damp_system,
    list_dampings,
    warn_of_no_damping,
)
from headstock.pipeline.stages.run_state import (
    Outcome,
    PoseModel,
    PoseMotions,
    RunState,
    Solved,
    pose_model,
)
from headstock.pipeline.stages.sensors import sensor_motions
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.damping_errors import DampingErrors, estimate_damping_errors
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.reduction.motions.body_motions import (
    FreeMotion,
    find_free_motions,
    warn_of_free_motions,
)
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.modal import ModalRequest
from headstock.solvers.linear.damping import (
    DampedModes,
    damping_of_undamped,
    equivalent_viscous,
    solve_damped,
)
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest, solve_modal
from headstock.solvers.pairing.mode_pairing import ModeSet, pair_modes

UNSTABLE = 1e-9
AT_REST = 1e-6  # of the lowest elastic frequency
LARGE_ERROR = 0.5  # of a damping ratio
# structural damping of a mode, from which its pole is 3 % off that of equal loss per cycle:
# sin(arctan(eta) / 2) against eta / 2
LARGE_LOSS = 0.3
NO_DAMPING = 1e-9  # a damping ratio: roundoff
KINDS: tuple[CouplingKind, ...] = ("average", "rigid")  # softer, stiffer
MOST_NAMED = 6
BEYOND = 1.5  # times as many modes: partners may change their order
Span = tuple[float, float]


def run_modal_stage(state: RunState, stage: Stage) -> Outcome:
    """Natural modes with names and energy shares; on rank 0."""
    if not state.is_root:
        return Outcome()
    model, request = pose_model(state), state.scene.analyses.get(ModalRequest)
    if request is None:
        raise ValueError(f"a {stage.kind} stage needs a modal analysis in the scene")
    solved = solve_pose_modes(model, request)
    modes, pose = solved.answer, model.pose.name
    state.motions.setdefault(pose, PoseMotions(model.offsets))
    state.views[pose] = dataclasses.replace(
        state.views[pose], shifts=model.shift_skins(state.skins, modes.shapes)
    )
    count, frequencies = len(modes.frequencies_hz), modes.frequencies_hz
    span = f"{frequencies[0]:.4g} .. {frequencies[-1]:.4g} Hz" if count else "none in the range"
    return Outcome(detail=f"{count} modes, {span}", answers=(modes,), warnings=solved.warnings)


def solve_pose_modes(model: PoseModel, request: ModalRequest) -> Solved[PoseModes]:
    """Undamped modes of a machine in a pose with names, energy shares, damping and errors.

    The damping of a lumped mechanism is that of its response alone: its modes have none.
    """
    # damping may couple every mode with every other
    damped = model.coupled is not None and DAMPING in model.parts.scene.effects
    if damped:
        result = keep_lowest(model.all_modes, count=request.count, up_to_hz=request.up_to_hz)
    else:
        result = solve_modal(model.system, count=request.count, up_to_hz=request.up_to_hz)
    named, errors = model.name_modes(result), model.estimate_mode_errors(result)
    count = len(result.frequencies_hz)
    damping = _Damping((None,) * count, (None,) * count)
    if damped and model.coupled is not None:
        damping = _damp_modes(model, model.coupled, named.names, errors)
    unexpected: tuple[FreeMotion, ...] = ()
    if result.rigid_count and isinstance(model, CoupledPose):
        unexpected = model.undeclared(find_free_motions(model.coupled))
    shapes, sensors = model.expand(result.shapes), model.parts.scene.machine.sensors
    modes = PoseModes(
        pose=model.pose,
        pose_units=position_units(model.parts.scene.machine),
        frequencies_hz=result.frequencies_hz,
        rigid_count=min(result.rigid_count, count),
        errors=_name_errors(model.pose.name, errors, damping),
        damping_ratio=damping.ratios,
        damped_hz=damping.frequencies_hz,
        mode_names=named.names,
        energy_share=named.strain_shares,
        kinetic_share=named.kinetic_shares,
        shapes=shapes,
        sensors=tuple(sensors),
        sensor_shapes=sensor_motions(model, shapes) if sensors else None,
        placements=dict(model.placements),
        damping_from=list_dampings(model.parts.scene) if damped else (),
    )
    warnings = [*damping.warnings, *((warn_of_free_motions(unexpected),) if unexpected else ())]
    if request.stated and request.count is not None and count < request.count:
        warnings.append(_tell_missing(request.count, model, result))
    if request.from_hz:
        below = int(np.searchsorted(result.frequencies_hz, request.from_hz))
        below = max(below, modes.rigid_count)
        if below == count:
            warnings.append(_tell_neighbours(request, model.all_modes, below))
        modes = _leave_out_lower(modes, below)
    return Solved(modes, tuple(warnings))


def _tell_missing(wanted: int, model: PoseModel, found: ModalResult) -> str:
    """Explain why there are fewer modes than are wanted.

    Args:
        wanted: How many the scene asks for.
        model: Whose modes they are.
    """
    size, without = len(model.system.mass), found.infinite_count
    freedom = f"{size} degree{'s' if size != 1 else ''} of freedom"
    words = (
        f"{len(found.frequencies_hz)} modes of the {wanted} of modal.count: the model has {freedom}"
    )
    if without:
        masses = {name: part.mass_kg for name, part in model.parts.superelements.items()}
        lightest = sorted(masses, key=lambda name: masses[name])[: min(without, MOST_NAMED)]
        named = ", ".join(f"{name} ({masses[name]:.3g} kg)" for name in lightest)
        words += f", {without} of them without mass or inertia beside the others, so that their frequencies count as infinite; the lightest: {named}"
    if size < wanted:
        words += (
            "; elastic or segmented bodies, or more of their modes (reduction.modes_to), give more"
        )
    return words


def _leave_out_lower(modes: PoseModes, below: int) -> PoseModes:
    """The modes from a number on, which keep their numbers."""
    return dataclasses.replace(
        modes,
        frequencies_hz=modes.frequencies_hz[below:],
        rigid_count=0,
        damping_ratio=modes.damping_ratio[below:],
        damped_hz=modes.damped_hz[below:],
        mode_names=modes.mode_names[below:],
        energy_share=modes.energy_share[below:],
        kinetic_share=modes.kinetic_share[below:],
        shapes=modes.shapes[:, below:],
        sensor_shapes=None if modes.sensor_shapes is None else modes.sensor_shapes[below:],
        below=below,
    )


def _name_errors(
    pose: str, frequencies: Sequence[Estimate], damping: "_Damping"
) -> dict[Key, Estimate]:
    """Return the ± of frequencies, damping ratios and damped frequencies by key."""
    kinds = {
        FREQUENCY: frequencies,
        DAMPING_RATIO: [Estimate({ALL_SOURCES: ratio}) for ratio, _ in damping.errors],
        DAMPED_FREQUENCY: [Estimate({ALL_SOURCES: hz}) for _, hz in damping.errors],
    }
    return {
        make_key(kind, pose=pose, mode=mode): error
        for kind, errors in kinds.items()
        for mode, error in enumerate(errors, 1)
    }


def _tell_neighbours(request: ModalRequest, every: ModalResult, below: int) -> str:
    """Name the modes next to a window of frequencies without any."""
    near = [
        f"mode {number + 1} is at {0.0 if number < every.rigid_count else every.frequencies_hz[number]:.4g} Hz"
        for number in (below - 1, below)
        if 0 <= number < len(every.frequencies_hz)
    ]
    return (
        f"no mode lies between {request.from_hz:g} and {request.up_to_hz:g} Hz: {', '.join(near)}"
    )


@dataclass(frozen=True)
class _Damping:
    """Damping ratios and damped frequencies [Hz] of the first undamped modes, how far each may be
    off, and what is to be said of them; None without damping.
    """

    ratios: tuple[float | None, ...]
    frequencies_hz: tuple[float | None, ...]
    errors: tuple[tuple[float | None, float | None], ...] = ()
    warnings: tuple[str, ...] = ()


def _damp_modes(
    model: PoseModel,
    coupled: CoupledMachine,
    names: tuple[str, ...],
    undamped: tuple[Estimate, ...],
) -> _Damping:
    """Damping of the first undamped modes.

    Args:
        coupled: The model's superelements.
        names: Of the first of them, whose damping is wanted.
        undamped: How far their frequencies may be off [Hz].
    """
    scene, complete = model.parts.scene, model.all_modes
    count, first = len(names), complete.rigid_count
    viscous = equivalent_viscous(damp_system(scene, coupled.system, complete), complete)
    damped = solve_damped(viscous, complete, lowest=count)
    ratios, frequencies = damping_of_undamped(damped, count)
    ratios = tuple(
        0.0 if ratio is not None and abs(ratio) < NO_DAMPING else ratio for ratio in ratios
    )
    estimates = estimate_damping_errors(coupled, viscous, damped, count)
    hysteretic = coupled.system.hysteretic
    given = bool(scene.modal_damping) and coupled.system.damping is None and hysteretic is None
    totals = [error.total for error in undamped[first:count]]
    exact = [ratio is not None and (given or not ratio) for ratio in ratios[first:]]
    errors = (
        *zip(estimates.ratios[:first], estimates.frequencies_hz[:first], strict=True),
        *map(
            _combine_errors,
            zip(estimates.ratios[first:], estimates.frequencies_hz[first:], strict=True),
            frequencies[first:],
            totals,
            complete.frequencies_hz[first:count],
            exact,
        ),
    )
    rough = _find_rough(first, totals, ratios[first:], errors[first:])
    doubts = [
        *_warn_of_growing(damped, complete),
        *_warn_of_rough(rough, estimates, names),
        *(() if hysteretic is None else _warn_of_large_losses(hysteretic, complete, names)),
        *_warn_of_creeping(range(first, count), estimates, names),
    ]
    pose = f"pose {model.pose.name}: " if len(model.parts.plan.poses) > 1 else ""
    warnings = (
        *warn_of_no_damping(scene, coupled.system),
        *(f"{pose}{message}" for message in doubts),
    )
    return _Damping(ratios, frequencies, errors, warnings)


def _combine_errors(
    errors: tuple[float | None, float | None],
    hz: float | None,
    undamped: float | None,
    undamped_hz: float,
    exact: bool,
) -> tuple[float | None, float | None]:
    """Return how far a damping ratio and a damped frequency may be off; None where nobody knows.

    Args:
        errors: Of both by the damping alone.
        undamped: How far the undamped frequency may be off [Hz]: in proportion the other may be too.
        exact: The damping ratio is given.
    """
    ratio, frequency = errors
    if hz is None or undamped is None:
        return 0.0 if exact else None, None
    if frequency is not None:
        frequency = max(frequency, undamped * hz / float(undamped_hz))
    return 0.0 if exact else ratio, frequency


def _find_rough(
    first: int,
    undamped: Sequence[float | None],
    ratios: Sequence[float | None],
    errors: Sequence[tuple[float | None, float | None]],
) -> list[int]:
    """Find the modes, of those from a number on, whose damping ratio is a rough estimate though their
    undamped frequency has one.
    """
    return [
        mode
        for mode, (total, ratio, (error, _)) in enumerate(
            zip(undamped, ratios, errors, strict=True), first
        )
        if total is not None
        and (ratio is None or error is None or error > LARGE_ERROR * abs(ratio))
    ]


def _warn_of_rough(
    modes: Iterable[int], estimates: DampingErrors, names: Sequence[str]
) -> Iterator[str]:
    for damper, group in _group_by_damper(modes, estimates, names, creeping=False):
        yield (
            f"damping{damper} of mode {group} is not converged: damping ratio and damped frequency are rough "
            "estimates only; write a higher reduction.modes_to or a smaller mesh size. If they keep changing, the damper absorbs the "
            "waves that reach it, and the mode does not exist"
        )


def _warn_of_creeping(
    modes: Iterable[int], estimates: DampingErrors, names: Sequence[str]
) -> Iterator[str]:
    for damper, group in _group_by_damper(modes, estimates, names, creeping=True):
        yield f"mode {group} is overdamped{damper}: it returns without oscillating; check the damping if this is not intended"


def _group_by_damper(
    modes: Iterable[int], estimates: DampingErrors, names: Sequence[str], *, creeping: bool
) -> Iterator[tuple[str, str]]:
    """Yield each damper (`` by NAME``) with numbers and names of its modes that are overdamped, or of the
    others.
    """
    groups: dict[str, list[str]] = {}
    for mode in modes:
        if estimates.creeping[mode] == creeping:
            groups.setdefault(estimates.dampers[mode], []).append(f"{mode + 1} ({names[mode]})")
    return ((f" by {name}" if name else "", ", ".join(group)) for name, group in groups.items())


def _warn_of_growing(damped: DampedModes, undamped: ModalResult) -> Iterator[str]:
    """Warn of modes that dampers feed."""
    # a rigid motion that a damper resists comes to rest anywhere: a pole that is zero but for
    # roundoff
    elastic = undamped.frequencies_hz[undamped.rigid_count :]
    slowest = AT_REST * 2.0 * np.pi * float(elastic[0]) if len(elastic) else 0.0
    for pole, hz in zip(damped.poles, damped.frequencies_hz, strict=True):
        if pole.real > UNSTABLE * abs(pole) and pole.real > slowest:
            yield f"a mode near {hz:.4g} Hz is unstable: its damping is negative; check the signs of the joints' damping"


def _warn_of_large_losses(
    hysteretic: FloatArray, modes: ModalResult, names: tuple[str, ...]
) -> tuple[str, ...]:
    """Where a viscous damping of equal loss per cycle is no good description of structural damping."""
    large = []
    for mode in range(modes.rigid_count, len(names)):
        shape, omega = modes.shapes[:, mode], 2.0 * np.pi * float(modes.frequencies_hz[mode])
        loss = float(shape @ hysteretic @ shape) / omega**2
        if loss > LARGE_LOSS:
            large.append(f"{mode + 1} ({names[mode]}): {loss:.2g}")
    if not large:
        return ()
    return (
        f"large loss factors of modes: {', '.join(large)}. Their damping ratio and damped frequency are those of a viscous damping "
        "with the same loss per cycle at the natural frequency; frequency responses take the loss factor itself",
    )


def run_spread_stage(state: RunState, stage: Stage) -> Outcome:
    """Frequencies with every interface rigid and with every one averaging: the range that the
    choice of coupling leaves open.

    Collective; the modes of both machines are paired by shape.
    """
    extremes = [_reduce_all(state, kind) for kind in KINDS]
    if not state.is_root:
        return Outcome()
    reduced = {name: state.reduced[name].superelement for name in state.plan.components}
    places = {name: choose_places(element) for name, element in reduced.items()}
    largest = 0.0
    for number, modes in enumerate(state.answers):
        if not isinstance(modes, PoseModes):
            continue
        count = modes.below + len(modes.frequencies_hz)
        reference = _solve(state, modes.pose, reduced, count, places)
        sets = [
            _solve(state, modes.pose, elements, int(BEYOND * count) + 1, places)
            for elements in extremes
        ]
        spans = _find_spans(reference, sets)[modes.below :]
        state.answers[number] = dataclasses.replace(modes, spread_hz=spans)
        largest = max(
            [
                largest,
                *(_relative(span, modes, i) for i, span in enumerate(spans) if span is not None),
            ]
        )
    return Outcome(
        detail=f"rigid to averaging interfaces move frequencies by up to {100 * largest:.2g} %"
    )


def _reduce_all(state: RunState, kind: CouplingKind) -> dict[str, Superelement]:
    """Superelements of all components, collective; complete on rank 0 only. Meshes, and what was
    reduced before, are in the store.
    """
    parts = {
        name: recouple(part, kind) if has_choice(part) else part
        for name, part in state.plan.components.items()
    }
    plan = dataclasses.replace(state.plan, components=parts)
    other = dataclasses.replace(state, plan=plan, meshes={}, reduced=dict(state.reduced))
    return make_superelements(
        other, only=[name for name, part in state.plan.components.items() if has_choice(part)]
    )


def _solve(
    state: RunState,
    pose: Pose,
    elements: dict[str, Superelement],
    count: int,
    places: dict[str, BodyPlaces],
) -> ModeSet:
    ordered = {name: elements[name] for name in state.plan.components}
    coupled = couple(ordered, state.scene.machine, pose)
    modes = solve_modal(coupled.system, count=count)
    field = machine_field(coupled, places, modes.shapes)
    return ModeSet(modes.frequencies_hz, field, min(modes.rigid_count, field.shape[1]))


def _find_spans(reference: ModeSet, extremes: list[ModeSet]) -> tuple[Span | None, ...]:
    """Lowest and highest frequency of each mode's partners and its own; None where it has no
    partner on one side.
    """
    partners = [np.full(len(reference.frequencies_hz), np.nan) for _ in extremes]
    for values, other in zip(partners, extremes, strict=True):
        for pair in pair_modes(reference, other):
            values[pair.first] = other.frequencies_hz[pair.second]
    table = np.vstack([*partners, reference.frequencies_hz])
    return tuple(
        None
        if index < reference.rigid_count or np.isnan(column).any()
        else (float(column.min()), float(column.max()))
        for index, column in enumerate(table.T)
    )


def _relative(span: Span, modes: PoseModes, index: int) -> float:
    return (span[1] - span[0]) / float(modes.frequencies_hz[index])
