"""The search for the cheapest settings for a stated accuracy: start cheap, refine the component
with the largest part of the error, reuse the others.

The plan of the first round shows in advance which stages a scene with an accuracy needs, as far as
they are known.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import PointMass, SuperelementFile
from headstock.pipeline.accuracy.interface_choice import ShapeChoice, choose_shapes, give_chosen
from headstock.pipeline.accuracy.model_errors import (
    RefinedBodies,
    compare_models,
    repeat_comparison,
)
from headstock.pipeline.accuracy.models import ModelChoice, choose_models
from headstock.pipeline.accuracy.quantities import (
    MESH_SAFETY,
    Quantity,
    count_safely,
)
from headstock.pipeline.accuracy.rounds import (
    History,
    Verdict,
    describe_settings,
    evaluate_round,
    replace_components,
)
from headstock.pipeline.accuracy.search_records import (
    ModelComparison,
    SearchRecord,
    list_values,
    recall_comparison,
    recall_search,
    remember_comparison,
    remember_search,
)
from headstock.pipeline.accuracy.settings import (
    COARSE_ACCURACY,
    ROUGH_ACCURACY,
    START_ACCURACY,
    are_equal,
    is_chosen,
    mode_margin,
    start_component,
    suits_polynomials,
)
from headstock.pipeline.answers.accuracy import (
    AccuracyAnswer,
    AccuracyRound,
    ResponseAccuracy,
)
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.planning.analyses import EXACT_MARGIN, FRF_MARGIN, list_reaches
from headstock.pipeline.planning.budgets import BudgetError
from headstock.pipeline.planning.plan import Plan, Stage
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import Cost, measure
from headstock.pipeline.stages.run_state import Outcome, ReducedComponent, RunState
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.pipeline.storage.store import Store
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import AccuracyGoal, Analyses, Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root

MOST_ROUNDS = 9
MORE_MODES = 4  # of a part than frequencies are requested: what they lack is estimated
FOUND = "settings that an earlier run of this scene found"


class _RunRound(Protocol):
    """Run a scene's plan without writing files."""

    def __call__(
        self,
        scene: Scene,
        plan: Plan,
        reduced: Mapping[str, ReducedComponent] | None = None,
        *,
        mesh_factors: Mapping[str, float] | None = None,
    ) -> RunState:
        """Return the results of the stages.

        Args:
            reduced: Components of an earlier round to be reused; None where all are made.
            mesh_factors: Component to the safety factor on its mesh estimates.
        """
        ...


Note = Callable[[Stage, str, Cost], None]


class _StageRunner(Protocol):
    """Runs stages, and keeps records of them and of decisions."""

    comm: MPI.Comm
    store: Store
    run: _RunRound
    note: Note

    def run_stage(
        self, state: RunState, stage: Stage, work: Callable[[RunState, Stage], Outcome]
    ) -> None:
        """Announce a stage, do its work and record what it cost."""
        ...


@dataclass(frozen=True, eq=False)
class AccuracySearch:
    """Store the result of a search for settings.

    Attributes:
        state: State of the last round, complete on rank 0.
        answer: Rounds, settings and errors.
        failure: Why the accuracy was not reached, in plain words; empty when it was.
        bodies: Finite elements of the bodies that became rigid or segmented; None without such
            bodies.
        mesh_factors: Component to the safety factor on its mesh estimates.
        comparison: Result of an earlier comparison with those finite elements; None without one.
    """

    scene: Scene
    state: RunState
    answer: AccuracyAnswer
    failure: str = ""
    bodies: RefinedBodies | None = None
    mesh_factors: Mapping[str, float] = field(default_factory=dict)
    comparison: ModelComparison | None = None


def _start_scene(scene: Scene, accuracy: float) -> Scene:
    """Return the scene with the settings of the first round. A single body that causes all of the
    error starts with a finer mesh than several bodies, most of which may remain coarse.
    """
    goal = _goal(scene).to
    parts = (
        _make_selectable_deformable(scene)
        if _goal(scene).models != "none"
        else scene.machine.components
    )
    chosen = [part for part in parts.values() if is_chosen(part)]
    one = all(are_equal(chosen[0], part) for part in chosen)
    components = {
        name: start_component(
            part,
            max(accuracy, START_ACCURACY if one else COARSE_ACCURACY),
            _modes_to(part, scene.analyses, goal),
            modes=_count_modes(part, scene.analyses, goal),
            rough_for=goal if goal >= ROUGH_ACCURACY and not one else None,
        )
        if is_chosen(part)
        else part
        for name, part in parts.items()
    }
    return replace_components(_without_comparisons(scene), components)


def _make_selectable_deformable(scene: Scene) -> dict[str, Component]:
    """Return all components, with deformable models of the selectable bodies, to evaluate the error
    of cheaper models.
    """
    modal, frf = scene.analyses.get(ModalRequest), scene.analyses.get(FrfRequest)
    highest_hz = max(
        0.0 if modal is None or modal.up_to_hz is None else modal.up_to_hz,
        0.0 if frf is None else frf.to_hz,
    )
    parts = dict(scene.machine.components)
    for name, part in scene.machine.components.items():
        if _is_selectable(scene, name):
            suits = suits_polynomials(part, highest_hz)
            parts[name] = dataclasses.replace(part, fidelity="polynomial" if suits else "elastic")
    return parts


def _is_selectable(scene: Scene, name: str) -> bool:
    """Tell whether the model of a body is selectable; supports, probes and shapes of interfaces
    need a mesh.
    """
    machine, part = scene.machine, scene.machine.components[name]
    seen = {one.component for one in machine.supports.values()} | {
        one.component for one in machine.probes.values()
    }
    if scene.is_lumped or isinstance(part.solid, SuperelementFile | PointMass) or name in seen:
        return False
    if any(item.flexible for item in part.interfaces.values()):
        return False
    return _goal(scene).models == "all" or part.fidelity != "rigid"


@dataclass(frozen=True, eq=False)
class _Refined:
    """Store the result of the rounds of meshes and modes.

    Attributes:
        state: State of the last round, complete on rank 0; its estimates without safety factors.
        quantities: Numbers of the last round, with safety factors on their errors.
        mesh_factors: Component to the safety factor on its mesh estimates, from the rounds.
        failure: Why the accuracy was not reached; empty when it was.
    """

    scene: Scene
    state: RunState
    rounds: tuple[AccuracyRound, ...]
    quantities: Sequence[Quantity]
    mesh_factors: Mapping[str, float]
    failure: str


def run_searched(scene: Scene, runner: _StageRunner) -> RunState:
    """Run as many rounds as the accuracy of a scene needs, and then what is requested beyond the
    analyses whose errors the search estimates; collective.
    """
    search = _search_settings(scene, runner.run, runner.note, comm=runner.comm, store=runner.store)
    state = search.state
    more = search.scene.analyses != state.scene.analyses
    if more or scene.model_errors or scene.interface_errors:
        state = runner.run(search.scene, plan_scene(search.scene), state.reduced)
    if not scene.model_errors:
        _add_model_errors(scene, state, search, runner)
    state.answers.append(search.answer)
    if search.failure:
        state.failures.append(search.failure)
    return state


def _add_model_errors(
    scene: Scene, state: RunState, search: AccuracySearch, runner: _StageRunner
) -> None:
    """Add to ± what the chosen models of bodies leave out, as an earlier run of the scene found it, or
    compared now with finite elements and kept for the next.
    """
    stage = Stage("models", None, "what the models chosen leave out of elastic bodies")
    known, bodies = search.comparison, search.bodies
    if known is not None:
        runner.run_stage(state, stage, lambda state, stage: repeat_comparison(state, known))
    elif bodies is not None:
        parts = dataclasses.replace(bodies.parts, scene=state.scene)
        whole = dataclasses.replace(bodies, parts=parts)

        def compare(state: RunState, stage: Stage) -> Outcome:
            compared = compare_models(state, whole)
            state.warn(remember_comparison(scene, runner.store, compared))
            return repeat_comparison(state, compared)

        runner.run_stage(state, stage, compare)


def _search_settings(
    scene: Scene, run_round: _RunRound, note: Note, *, comm: MPI.Comm, store: Store
) -> AccuracySearch:
    """Refine until every requested number is within the scene's accuracy, then choose the cheapest
    models of bodies; collective.

    Args:
        run_round: Runs a scene's plan without writing files.
        note: Called with each refinement on rank 0.
        store: Store with the results of earlier searches.

    Raises:
        BudgetError: Not even the coarsest settings fit the limits.
    """
    known = make_on_root(comm, lambda: recall_search(scene, store))
    if known is not None:
        if comm.rank == 0:
            note(Stage("refine", None, FOUND), known.answer.rounds[-1].reason, Cost())
        comparison = make_on_root(comm, lambda: recall_comparison(scene, store))
        return _repeat_search(scene, known, comparison, run_round)
    shapes = choose_shapes(
        scene, _plan_start(scene)[0], _goal(scene).to, lambda one: run_round(one, plan_scene(one))
    )
    if comm.rank == 0:
        for own in shapes:
            note(Stage("joints", own.joint.name, own.reason or "the accuracy"), str(own), Cost())
    # where the error by joints alone is too large, finer meshes cannot help
    reachable = not any(own.reason for own in shapes)
    most = MOST_ROUNDS if reachable else 1
    refined = _refine_in_rounds(give_chosen(scene, shapes), run_round, note, most)
    choice = _choose_bodies(scene, refined, note)
    chosen, state, bodies = _run_chosen(refined, choice, run_round, note)
    answer = _conclude(scene, refined, choice, chosen, shapes)
    if state.is_root and answer.met and not state.failures:
        references = {} if bodies is None else bodies.components
        found = SearchRecord(chosen.machine.components, references, refined.mesh_factors, answer)
        state.warn(remember_search(scene, store, found))
    return AccuracySearch(
        _restore_requests(chosen, scene),
        state,
        answer,
        _describe_failure(answer),
        bodies,
        refined.mesh_factors,
    )


def _refine_in_rounds(scene: Scene, run_round: _RunRound, note: Note, most_rounds: int) -> _Refined:
    """Refine meshes and modes in rounds until every number is within the accuracy, or no finer
    settings fit; collective.
    """
    goal, history = _goal(scene), History()
    rounds: list[AccuracyRound] = []
    current, plan = _plan_start(scene)
    state = run_round(current, plan)
    failure = ""
    while True:
        evaluate = functools.partial(evaluate_round, current, state, goal, history)
        verdict, history = make_on_root(state.comm, evaluate)
        rounds.append(verdict.round)
        failure = verdict.failure
        if verdict.ends:
            break
        if len(rounds) == most_rounds:
            failure = f"{most_rounds} rounds were not enough" if most_rounds > 1 else ""
            break
        try:
            plan = plan_scene(verdict.scene)
        except BudgetError as error:
            estimated = verdict.round.error
            confirms = estimated is not None and estimated <= goal.to
            failure = f"no finer mesh confirms it: {error}" if confirms else str(error)
            break
        if state.is_root:
            changes = verdict.round.changes or {}
            next_round = _describe_next(verdict, goal.to, len(rounds), most_rounds, plan)
            note(Stage("refine", None, verdict.round.reason), next_round, Cost())
            for name, change in changes.items():
                note(Stage("refine", name, verdict.round.reason), change, Cost())
        current, state = verdict.scene, run_round(verdict.scene, plan)
    counted = count_safely(history.quantities, history.factors)
    # the ± of meshes has its usual safety factor
    factors = {name: factor / MESH_SAFETY for name, factor in history.factors.items()}
    return _Refined(current, state, tuple(rounds), counted, factors, failure)


def _describe_next(
    verdict: Verdict, accuracy: float, number: int, most_rounds: int, plan: Plan
) -> str:
    """Describe what a round reached, and what the next one refines and is expected to take.

    Args:
        accuracy: Relative error that is asked for.
        number: Of the round that was evaluated.
        plan: Of the next round.
    """
    reached, changes = verdict.round, verdict.round.changes or {}
    seconds = sum(
        stage.estimated_seconds or 0.0
        for stage in plan.stages
        if stage.component is None or stage.component in changes
    )
    aim = "" if verdict.aim is None else f", aims at {show_share(verdict.aim)}"
    return (
        f"round {number} reached {show_share(reached.error)} in {reached.quantity}, {show_share(accuracy)} is asked for;"
        f" round {number + 1} of at most {most_rounds} refines {', '.join(changes)}{aim} and takes about {seconds:.2g} CPU s"
    )


def _choose_bodies(scene: Scene, refined: _Refined, note: Note) -> ModelChoice | None:
    """Choose the cheapest models within the accuracy, None if none are selectable; collective."""
    goal, state = _goal(scene), refined.state
    selectable = [name for name in scene.machine.components if _is_selectable(scene, name)]
    # without numbers the error of a cheaper model cannot be evaluated
    if goal.models == "none" or not (selectable and refined.quantities) or refined.failure:
        return None
    if state.failures:
        return None
    return make_on_root(
        state.comm, functools.partial(_choose_models, refined, selectable, goal.to, note)
    )


def _run_chosen(
    refined: _Refined, choice: ModelChoice | None, run_round: _RunRound, note: Note
) -> tuple[Scene, RunState, RefinedBodies | None]:
    """Run the machine of the chosen models, with the safety factors of the rounds in every ±; and
    return the bodies that those models replace, None where there are none. Collective.
    """
    current, state, factors = refined.scene, refined.state, refined.mesh_factors
    if choice is None or not _list_changed(refined, choice):
        if factors and not state.failures:
            state = run_round(current, plan_scene(current), state.reduced, mesh_factors=factors)
        return current, state, None
    bodies = None
    if state.is_root:
        for name, change in _list_changed(refined, choice).items():
            note(Stage("models", name, _describe_error(choice)), change, Cost())
        weighed = dataclasses.replace(state, reduced=dict(state.reduced))
        weighed.weigh_meshes(factors)
        parts = state.plan.components
        bodies = RefinedBodies(
            weighed.parts,
            {
                name: parts[name]
                for name, part in choice.components.items()
                if part.fidelity != parts[name].fidelity
            },
            {},
        )
    current = replace_components(current, choice.components)
    return current, run_round(current, plan_scene(current), mesh_factors=factors), bodies


def _list_changed(refined: _Refined, choice: ModelChoice) -> dict[str, str]:
    """List the bodies that get another model, and why, in plain words."""
    parts = refined.scene.machine.components
    return {
        name: f"{before} → {body.model}: {body.why}"
        for name, body in choice.bodies.items()
        if body.model != (before := describe_settings(parts[name]))
    }


def _describe_error(choice: ModelChoice) -> str:
    return f"{choice.worst} may be off by {show_share(choice.error)} with the models chosen"


def _conclude(
    scene: Scene,
    refined: _Refined,
    choice: ModelChoice | None,
    chosen: Scene,
    shapes: Sequence[ShapeChoice],
) -> AccuracyAnswer:
    """Build the report of a search."""
    rounds, bodies = refined.rounds, choice.bodies if choice else {}
    if choice is not None and (changed := _list_changed(refined, choice)):
        last = AccuracyRound(choice.worst, choice.error, _describe_error(choice), changes=changed)
        rounds = (*rounds, last)
    settings = {
        name: describe_settings(part)
        for name, part in chosen.machine.components.items()
        if is_chosen(part) or name in bodies
    }
    values = list_values({name: chosen.machine.components[name] for name in settings})
    settings |= {own.joint.name: str(own) for own in shapes}
    failure = refined.failure or "; ".join(
        f"joint {own.joint.name}: {own.reason}" for own in shapes if own.reason
    )
    responses = _evaluate_responses(refined.quantities, choice, _goal(scene).to)
    return AccuracyAnswer(_goal(scene).to, rounds, settings, values, failure, bodies, responses)


def _evaluate_responses(
    quantities: Sequence[Quantity], choice: ModelChoice | None, accuracy: float
) -> ResponseAccuracy | None:
    """Return the response peak or level with the largest error with the chosen models."""
    errors = {
        each.name: each.error if choice is None else choice.errors[each.key]
        for each in quantities
        if each.response
    }
    if not errors:
        return None
    worst = max(errors, key=lambda name: errors[name])
    size = errors[worst]
    return ResponseAccuracy(worst, size if np.isfinite(size) else None, size <= accuracy)


def _describe_failure(answer: AccuracyAnswer) -> str:
    if answer.met:
        return ""
    last = answer.rounds[-1]
    return (
        f"the accuracy of {100.0 * answer.requested:g} % is not reached; best: {last.quantity} within"
        f" {show_share(last.error)}: {answer.reason}"
    )


def _restore_requests(current: Scene, scene: Scene) -> Scene:
    """Return the settings of one scene with all requests of another."""
    return dataclasses.replace(
        current,
        analyses=scene.analyses,
        model_errors=scene.model_errors,
        interface_errors=scene.interface_errors,
    )


def _repeat_search(
    scene: Scene, known: SearchRecord, comparison: ModelComparison | None, run_round: _RunRound
) -> AccuracySearch:
    """Run the last round of an earlier search; collective."""
    start = _without_comparisons(scene)
    current = replace_components(start, known.chosen)
    factors = known.mesh_factors
    state = run_round(current, plan_scene(current), mesh_factors=factors)
    bodies = None
    if known.references and comparison is None:
        scene_before = replace_components(start, {**known.chosen, **known.references})
        plan = plan_scene(scene_before)
        other = dataclasses.replace(
            state, scene=scene_before, plan=plan, meshes={}, reduced=dict(state.reduced)
        )
        make_superelements(other, only=list(known.references))
        other.weigh_meshes({name: factors[name] for name in known.references if name in factors})
        parts = {name: plan.components[name] for name in known.references}
        bodies = RefinedBodies(other.parts, parts, {})
    return AccuracySearch(
        _restore_requests(current, scene),
        state,
        known.answer,
        bodies=bodies,
        mesh_factors=factors,
        comparison=comparison,
    )


def _without_comparisons(scene: Scene) -> Scene:
    """Return a scene with only the analyses that have error estimates."""
    return dataclasses.replace(
        scene,
        analyses=_round_analyses(scene.analyses),
        model_errors=False,
        interface_errors=False,
    )


def _choose_models(
    refined: _Refined, selectable: Sequence[str], accuracy: float, note: Note
) -> ModelChoice:
    """Choose the cheapest models within an accuracy, on rank 0."""
    with measure() as cost:
        found = choose_models(refined.state, selectable, refined.quantities, accuracy)
    note(
        Stage("models", None, "the cheapest models within the accuracy"),
        f"{found.worst} within {show_share(found.error)}",
        cost,
    )
    return found


def _plan_start(scene: Scene) -> tuple[Scene, Plan]:
    """Return the scene of the first round, and its stages up to analyses with estimates.

    Raises:
        BudgetError: Not even the coarsest settings fit the limits.
    """
    current = _start_scene(scene, _goal(scene).to)
    try:
        return current, plan_scene(current)
    except BudgetError:
        current = _start_scene(scene, COARSE_ACCURACY)
        return current, plan_scene(current)


def _round_analyses(analyses: Analyses) -> Analyses:
    """Return the analyses that determine the accuracy: statics, modes as far up as any analysis
    needs, and peaks of frequency responses.
    """
    modal, frf = analyses.get(ModalRequest), analyses.get(FrfRequest)
    if modal is None and frf is not None:
        modal = ModalRequest(up_to_hz=frf.to_hz, poses=frf.poses)
    # peaks and levels are found without the lines of a grid; under control there are none
    lines = (
        None
        if frf is None or frf.motors != "locked"
        else dataclasses.replace(frf, points=2, adaptive=False, probes=(), fields_at=())
    )
    return Analyses(analyses.get(StaticRequest), modal, lines)


def _modes_to(part: Component, analyses: Analyses, accuracy: float) -> float | None:
    """Return the frequency up to which modes of a part are kept at first; None where a number of
    frequencies is requested, so that their range is not known yet.
    """
    modal, frf = analyses.get(ModalRequest), analyses.get(FrfRequest)
    reaches = []
    if modal is not None and modal.up_to_hz is not None:
        reaches.append(mode_margin(part, accuracy) * modal.up_to_hz)
    if frf is not None:
        reaches.append((FRF_MARGIN if part.interfaces else EXACT_MARGIN) * frf.to_hz)
    return max(reaches, default=None)


def _count_modes(part: Component, analyses: Analyses, accuracy: float) -> int | None:
    """Return how many modes of a part are kept at first where a number of frequencies is requested;
    None where an analysis names a range, or the planner chooses the number.

    So many reach beyond these: the k-th frequency of a machine is no higher than the k-th of its
    parts with all interfaces fixed.

    Source: Courant and Hilbert (1924), on frequencies under constraints.
    """
    modal = analyses.get(ModalRequest)
    if modal is None or modal.count is None or accuracy < ROUGH_ACCURACY:
        return None
    if list_reaches(analyses) or not part.interfaces:
        return None
    return modal.count + MORE_MODES


def _goal(scene: Scene) -> AccuracyGoal:
    if scene.accuracy is None:
        raise ValueError("the scene asks for no accuracy")
    return scene.accuracy


def plan_first_round(scene: Scene) -> Plan:
    """Plan the stages of a scene with an accuracy, with the settings of the first round.

    Raises:
        BudgetError: A mesh or a stage would be larger than allowed.
    """
    if scene.accuracy is None:
        raise ValueError("the scene asks for no accuracy")
    current = dataclasses.replace(_plan_start(scene)[0], analyses=scene.analyses)
    plan = plan_scene(current, survey=True)
    note = (
        f"accuracy = {100.0 * scene.accuracy.to:g} %: these are the settings of the first round. In up to {MOST_ROUNDS} rounds the"
        f" component with the largest error is refined. Meshes and modes written in the scene are not used"
    )
    return dataclasses.replace(plan, warnings=(*plan.warnings, note))
