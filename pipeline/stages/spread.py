"""Natural frequencies with every interface rigid and with every one averaging: the range that the choice of coupling leaves open."""

import dataclasses

import numpy as np

from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import CouplingKind
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import has_choice, recouple
from headstock.pipeline.results.modal import PoseModes
from headstock.pipeline.stages.components import make_superelements
from headstock.pipeline.stages.run_state import Outcome, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.mode_pairing import ModeSet, pair_modes

KINDS: tuple[CouplingKind, ...] = ("average", "rigid")  # softer, stiffer
BEYOND = 1.5  # times as many modes: partners may change their order
Span = tuple[float, float]


def run_spread_stage(state: RunState, stage: Stage) -> Outcome:
    """Reduce elastic components with either kind of coupling at all fixed interfaces, and pair the modes of the machines by shape."""
    extremes = [_reduce_all(state, kind) for kind in KINDS]
    if not state.is_root:
        return Outcome()
    own = {name: state.reduced[name].superelement for name in state.plan.components}
    places = {name: choose_places(element) for name, element in own.items()}
    found = 0.0
    for number, modes in enumerate(state.answers):
        if not isinstance(modes, PoseModes):
            continue
        count = len(modes.frequencies_hz)
        reference = _solve(state, modes.pose, own, count, places)
        sets = [_solve(state, modes.pose, elements, int(BEYOND * count) + 1, places) for elements in extremes]
        spans = _find_spans(reference, sets)
        state.answers[number] = dataclasses.replace(modes, spread_hz=spans)
        found = max([found, *(_relative(span, modes, i) for i, span in enumerate(spans) if span is not None)])
    return Outcome(detail=f"rigid to averaging interfaces move frequencies by up to {100 * found:.2g} %")


def _reduce_all(state: RunState, kind: CouplingKind) -> dict[str, Superelement]:
    """Superelements of all components, collective; complete on rank 0 only. Meshes, and what was reduced before, are in the store."""
    parts = {name: recouple(part, kind) if has_choice(part) else part for name, part in state.plan.components.items()}
    plan = dataclasses.replace(state.plan, components=parts)
    other = dataclasses.replace(state, plan=plan, meshes={}, reduced=dict(state.reduced))
    return make_superelements(other, only=[name for name, part in state.plan.components.items() if has_choice(part)])


def _solve(state: RunState, pose: Pose, elements: dict[str, Superelement], count: int, places: dict[str, BodyPlaces]) -> ModeSet:
    ordered = {name: elements[name] for name in state.plan.components}
    coupled = couple(ordered, state.scene.machine, pose)
    modes = solve_modal(coupled.system, count=count)
    field = machine_field(coupled, places, modes.shapes)
    return ModeSet(modes.frequencies_hz, field, min(modes.rigid_count, field.shape[1]))


def _find_spans(reference: ModeSet, extremes: list[ModeSet]) -> tuple[Span | None, ...]:
    """Lowest and highest frequency of each mode's partners and its own; None where it has no partner on one side."""
    known = [np.full(len(reference.frequencies_hz), np.nan) for _ in extremes]
    for values, other in zip(known, extremes, strict=True):
        for pair in pair_modes(reference, other):
            values[pair.first] = other.frequencies_hz[pair.second]
    table = np.vstack([*known, reference.frequencies_hz])
    return tuple(
        None if index < reference.rigid_count or np.isnan(column).any() else (float(column.min()), float(column.max()))
        for index, column in enumerate(table.T)
    )


def _relative(span: Span, modes: PoseModes, index: int) -> float:
    return (span[1] - span[0]) / float(modes.frequencies_hz[index])
