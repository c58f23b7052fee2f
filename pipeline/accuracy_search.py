"""The cheapest settings for a stated accuracy: start cheap, refine what owns the largest error, take the rest from the store."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.components import Component, MeshSettings
from headstock.geometry.solids import MeshFile
from headstock.pipeline.accuracy_levels import weigh_estimates
from headstock.pipeline.accuracy_quantities import (
    RIGID_MODEL,
    Factors,
    Owner,
    Quantity,
    count_safely,
    elastic_shares,
    list_quantities,
    mesh_safety,
    worst_quantity,
)
from headstock.pipeline.accuracy_settings import (
    START_ACCURACY,
    Trial,
    are_twins,
    is_chosen,
    mode_margin,
    refine_mesh,
    refine_modes,
    start_component,
)
from headstock.pipeline.analysis_requests import Analyses, ModalRequest
from headstock.pipeline.budgets import BudgetError
from headstock.pipeline.error_estimates import DISCRETISATION
from headstock.pipeline.json_texts import Json
from headstock.pipeline.planner import FRF_MARGIN, plan_scene
from headstock.pipeline.rank_messages import share_from_root
from headstock.pipeline.run_state import RunState
from headstock.pipeline.scene import AccuracyGoal, Scene
from headstock.pipeline.stages import Plan, Stage

MOST_ROUNDS = 9
AIM = 0.9  # share of the accuracy that the next round aims at
RIGID_SHARE = 0.2  # of the accuracy, that all bodies taken as rigid may cost together

RunRound = Callable[[Scene, Plan], RunState]
Note = Callable[[Stage, str], None]


@dataclass(frozen=True, eq=False)
class AccuracySearch:
    """How a search for settings ended.

    Attributes:
        scene: With the settings chosen.
        state: Of the last round, complete on rank 0.
        summary: Rounds, settings and errors, as in ``summary.json``.
        failure: Why the accuracy was not reached, in plain words; empty when it was.
    """

    scene: Scene
    state: RunState
    summary: Json
    failure: str = ""


@dataclass(frozen=True, eq=False)
class _History:
    """What the rounds so far have taught.

    Attributes:
        trials: Of each component, its meshes so far and the largest error they owned.
        rigid: Components that were taken as rigid, and the share of any number that this may cost.
        quantities: Numbers of the last round, with errors as estimated.
        sizes: Mesh sizes of the last round [m].
        factors: By how much estimates are to be multiplied.
    """

    trials: Mapping[str, tuple[Trial, ...]] = field(default_factory=dict)
    rigid: Mapping[str, float] = field(default_factory=dict)
    quantities: Sequence[Quantity] = ()
    sizes: Mapping[str, float] = field(default_factory=dict)
    factors: Factors = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Verdict:
    """What rank 0 makes of a round: whether the search ends, else the next scene; and what is told of it."""

    ends: bool
    scene: Scene
    round: Json
    changes: Mapping[str, str] = field(default_factory=dict)
    failure: str = ""


def start_scene(scene: Scene) -> Scene:
    """A scene with the settings that a search for its accuracy begins with, and the analyses that errors are estimated of."""
    return _start_scene(scene, _goal(scene).to)


def _start_scene(scene: Scene, accuracy: float) -> Scene:
    """Where one body makes all of the error, its mesh begins as fine as the accuracy asks; among several most need it coarse."""
    analyses, modes_to = _round_analyses(scene.analyses), _modes_to(scene.analyses, _goal(scene).to)
    chosen = [part for part in scene.machine.components.values() if is_chosen(part)]
    one = all(are_twins(chosen[0], part) for part in chosen)
    components = {
        name: start_component(part, accuracy if one else START_ACCURACY, modes_to) if is_chosen(part) else part
        for name, part in scene.machine.components.items()
    }
    return _with_components(dataclasses.replace(scene, analyses=analyses), components)


def search_settings(scene: Scene, run_round: RunRound, note: Note) -> AccuracySearch:
    """Refine until every requested number is right to the scene's accuracy; collective.

    Args:
        scene: With an accuracy.
        run_round: Runs a scene's plan without writing anything.
        note: Told of each refinement on rank 0.

    Raises:
        BudgetError: Not even the coarsest settings fit the limits.
    """
    goal, rounds = _goal(scene), []
    history = _History()
    current, plan = _plan_start(scene)
    state = run_round(current, plan)
    failure = ""
    for number in range(MOST_ROUNDS):
        judged = _judge(current, state, goal, history) if state.is_root else None
        verdict, history = share_from_root(state.comm, judged)
        rounds.append(verdict.round)
        failure = verdict.failure
        if verdict.ends:
            break
        if number == MOST_ROUNDS - 1:
            failure = f"{MOST_ROUNDS} rounds were not enough"
            break
        try:
            plan = plan_scene(verdict.scene)
        except BudgetError as error:
            failure = str(error)
            break
        if state.is_root:
            for name, change in verdict.changes.items():
                note(Stage("refine", name, verdict.round["because"]), change)
        current, state = verdict.scene, run_round(verdict.scene, plan)
    last = rounds[-1] if rounds else {}
    summary = {
        "asked": goal.to,
        "estimated": last.get("error"),
        "met": not failure,
        "reason": failure,
        "rounds": rounds,
        "settings": {
            name: _describe(part) for name, part in current.machine.components.items() if is_chosen(part) or name in history.rigid
        },
    }
    if failure:
        failure = f"the accuracy of {100.0 * goal.to:g} % is not reached; best: {last['quantity']} within {_percent(last['error'])}: {failure}"
    return AccuracySearch(dataclasses.replace(current, analyses=scene.analyses), state, summary, failure)


def _plan_start(scene: Scene) -> tuple[Scene, Plan]:
    current = start_scene(scene)
    try:
        return current, plan_scene(current)
    except BudgetError:
        current = _start_scene(scene, START_ACCURACY)
        return current, plan_scene(current)


def _judge(scene: Scene, state: RunState, goal: AccuracyGoal, history: _History) -> tuple[_Verdict, _History]:
    """Whether a round is good enough, and else what is refined; and what it adds to the history."""
    parts = scene.machine.components
    estimated = list_quantities(state, history.rigid)
    sizes = {name: part.mesh.size for name, part in parts.items() if part.mesh.size is not None and is_chosen(part)}
    steps = {name: size / history.sizes[name] for name, size in sizes.items() if size < history.sizes.get(name, 0.0)}
    safety = {name: mesh_safety(part) for name, part in parts.items()}
    factors = weigh_estimates(history.quantities, estimated, steps, history.factors, safety)
    quantities = count_safely(estimated, factors, safety)
    worst = worst_quantity(quantities)
    if worst is None:
        return _Verdict(True, scene, {"quantity": "every number", "error": 0.0, "because": "no component is meshed"}), history
    component, source = worst.owner
    because = (
        f"{worst.name} may be off by {_percent(worst.error)}; {_percent(worst.parts[worst.owner])} is the {source} of {component}"
    )
    found: Json = {"quantity": worst.name, "error": _finite(worst.error), "owner": component, "source": source, "because": because}
    if worst.error <= goal.to or state.failures:
        return _Verdict(True, scene, found), history
    may_be_rigid = goal.fidelity and not history.trials
    rigid = {**history.rigid, **(_rigid_candidates(state, parts, goal.to) if may_be_rigid else {})}
    parts = {**parts, **{name: dataclasses.replace(parts[name], fidelity="rigid") for name in rigid}}
    learnt = _History(_remember(history.trials, parts, estimated, quantities), rigid, estimated, sizes, factors)
    wanted = _share_with_twins(_wanted_ratios(quantities, goal.to, rigid), parts)
    return _refine(scene, state, parts, wanted, learnt.trials, found), learnt


def _refine(
    scene: Scene,
    state: RunState,
    parts: Mapping[str, Component],
    wanted: Mapping[Owner, float],
    trials: Mapping[str, tuple[Trial, ...]],
    found: Json,
) -> _Verdict:
    """The next scene, in which the errors of some owners should be so many times what they are."""
    finer = dict(parts)
    for (name, kind), ratio in wanted.items():
        if kind == RIGID_MODEL or (isinstance(parts[name].solid, MeshFile) and kind == DISCRETISATION):
            return _Verdict(True, scene, found, failure=f"the {kind} of {name} is not ours to refine")
        if kind == DISCRETISATION:
            finer[name] = refine_mesh(finer[name], ratio=ratio, trials=trials.get(name, ()))
        else:
            cutoff, highest = state.reduced[name].superelement.cutoff_hz, _highest_found(state)
            finer[name] = refine_modes(finer[name], ratio=ratio, cutoff_hz=cutoff, highest_hz=highest)
    changes = {
        name: f"{_describe(scene.machine.components[name])} → {_describe(part)}: {found['because']}"
        for name, part in finer.items()
        if _describe(part) != _describe(scene.machine.components[name])
    }
    return _Verdict(False, _with_components(scene, finer), found | {"changes": changes}, changes)


def _wanted_ratios(quantities: list[Quantity], accuracy: float, rigid: Mapping[str, float]) -> dict[Owner, float]:
    """For each number that is too far off, by what factor the parts that own most of it must fall."""
    wanted: dict[Owner, float] = {}
    for quantity in quantities:
        if quantity.error <= accuracy:
            continue
        largest = quantity.parts[quantity.owner]
        for owner, part in quantity.parts.items():
            if part < 0.5 * largest or owner[0] in rigid:
                continue
            rest = quantity.error - part
            ratio = AIM * accuracy / quantity.error if not rest < 0.5 * AIM * accuracy else (AIM * accuracy - rest) / part
            wanted[owner] = min(wanted.get(owner, 1.0), ratio if np.isfinite(part) else 0.0)
    return wanted


def _share_with_twins(wanted: Mapping[Owner, float], parts: Mapping[str, Component]) -> dict[Owner, float]:
    """The same with equal components refined alike, so that one superelement serves them all."""
    return {
        (other, kind): min(ratio for (name, same), ratio in wanted.items() if same == kind and are_twins(parts[name], parts[other]))
        for owner, kind in wanted
        for other in parts
        if is_chosen(parts[other]) and are_twins(parts[owner], parts[other])
    }


def _remember(
    trials: Mapping[str, tuple[Trial, ...]],
    parts: Mapping[str, Component],
    estimated: Sequence[Quantity],
    counted: Sequence[Quantity],
) -> dict[str, tuple[Trial, ...]]:
    """The trials with those of this round."""
    longer = dict(trials)
    for name, part in parts.items():
        twins = [other for other in parts if are_twins(part, parts[other])]
        largest, largest_counted = (
            max((quantity.parts.get((other, DISCRETISATION), 0.0) for quantity in quantities for other in twins), default=0.0)
            for quantities in (estimated, counted)
        )
        known = trials.get(name, ())
        if part.mesh.size is not None and largest > 0.0 and (not known or known[-1].size != part.mesh.size):
            longer[name] = (*known, Trial(part.mesh.size, largest, largest_counted))
    return longer


def _rigid_candidates(state: RunState, parts: Mapping[str, Component], accuracy: float) -> dict[str, float]:
    """Components so stiff beside the rest that taking them as rigid costs a small part of the accuracy."""
    shares = elastic_shares(state)
    chosen = sorted((shares.get(name, 0.0), name) for name, part in parts.items() if is_chosen(part))
    found: dict[str, float] = {}
    for share, name in chosen:
        cost = share / (1.0 - share) if share < 1.0 else np.inf
        if sum(found.values()) + cost <= RIGID_SHARE * accuracy:
            found[name] = float(cost)
    return found


def _round_analyses(analyses: Analyses) -> Analyses:
    """The analyses that say how far off a machine is: statics, and modes as far up as any analysis looks."""
    modal, frf = analyses.modal, analyses.frf
    if modal is None and frf is not None:
        modal = ModalRequest(up_to_hz=frf.to_hz, poses=frf.poses)
    return Analyses(static=analyses.static, modal=modal)


def _modes_to(analyses: Analyses, accuracy: float) -> float | None:
    """Up to where modes are kept at first; None where frequencies are counted, so that nothing is known of their height yet."""
    modal, frf = analyses.modal, analyses.frf
    reaches = [] if modal is None or modal.up_to_hz is None else [mode_margin(accuracy) * modal.up_to_hz]
    reaches += [] if frf is None else [FRF_MARGIN * frf.to_hz]
    return max(reaches, default=None)


def _highest_found(state: RunState) -> float:
    return max((float(modes.frequencies_hz[-1]) for modes in state.modal if len(modes.frequencies_hz)), default=0.0)


def _with_components(scene: Scene, components: Mapping[str, Component]) -> Scene:
    return dataclasses.replace(scene, machine=dataclasses.replace(scene.machine, components=dict(components)))


def _describe(component: Component) -> str:
    if component.fidelity == "rigid":
        return "rigid"
    mesh, settings = component.mesh, component.reduction
    if isinstance(component.solid, MeshFile):
        size = "mesh of the file"
    else:
        patches = "" if mesh.across_patches == MeshSettings().across_patches else f", {mesh.across_patches} across patches"
        rims = "" if mesh.rim_size is None else f", {1e3 * mesh.rim_size:.3g} mm at rims"
        growth = "" if mesh.growth is None else f", growth {mesh.growth:g}"
        size = f"{mesh.cells} {1e3 * (mesh.size or 0.0):.3g} mm{patches}{rims}{growth}"
    return size if settings.modes_to_hz is None else f"{size}, modes to {settings.modes_to_hz:.3g} Hz"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if np.isfinite(share) else "an unknown amount"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _goal(scene: Scene) -> AccuracyGoal:
    if scene.accuracy is None:
        raise ValueError("the scene asks for no accuracy")
    return scene.accuracy
