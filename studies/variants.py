"""Variants of a scene: which to hold side by side, and each from its file to its modes and
compliances, with the time of each step.
"""

import dataclasses
import importlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer, compliance_key
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key, Number, Numbers, make_key
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.planning.resources import Cost, measure
from headstock.pipeline.results.results import ComponentFacts
from headstock.pipeline.runner import gather_facts, gather_results, run_stages
from headstock.pipeline.stages.components import ELASTIC_MODULE
from headstock.pipeline.stages.estimates import estimate_compliance_errors
from headstock.pipeline.stages.frf import prepare_response, respond
from headstock.pipeline.stages.mechanism import LUMPED, pose_machine
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.stages.static import solve_points
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.compliance_budget import (
    PointBudget,
    WeakLink,
    find_weakest_link,
    point_budget,
)
from headstock.reduction.motions.mode_naming import NamedModes
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.expansion.overrides import AS_WRITTEN
from headstock.scene.reading.findings import Problem, SceneError
from headstock.scene.scene import Scene, deforming_parts
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.frequency_response import FrfModel
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.points import PlannedRun, plan_run

# modes are looked for further up than the scene asks, since a partner may lie beyond its limit
REACH = 1.5
STEPS = ("load", "components", "couple", "modes", "static", "frf", "others")
FIDELITIES: tuple[Fidelity, ...] = ("rigid", "segmented", "elastic")


@dataclass(frozen=True)
class VariantChoice:
    """A variant to look at.

    Attributes:
        name: What it is called in tables.
        variant: Variants of the scene, ``A+B`` for several; None for the scene as written.
        overrides: ``key=value`` settings applied after it.
        fidelity: What every component that deforms is made to be; None for as the variant has it.
        cannot: Why there is no such model, in plain words; empty where there is one.
        unasked: The baseline, added beside the variants that were asked for: where it has no
            answer, they still have.
    """

    name: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()
    fidelity: Fidelity | None = None
    cannot: str = ""
    unasked: bool = False


class FidelityError(ModelError):
    """A machine has no answer at the fidelity it was asked for, though it may at others; or the
    baseline that nobody asked for has none.
    """


@dataclass(frozen=True)
class Effort:
    """What it cost to get from the scene file to the answers.

    Attributes:
        costs: Of each of ``STEPS``, with threads and child processes.
        import_seconds: Time to load the finite element library, which is no part of the steps [s].
        reduced: Elastic components there are.
        stored: How many of them came from the store.
    """

    costs: Mapping[str, Cost]
    import_seconds: float = 0.0
    reduced: int = 0
    stored: int = 0

    def add(self, step: str, cost: Cost) -> "Effort":
        """Return it with another step."""
        return dataclasses.replace(self, costs={**self.costs, step: cost})

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock time of each step [s]."""
        return {step: self.costs.get(step, Cost()).seconds for step in STEPS}

    @property
    def cpu_seconds(self) -> dict[str, float]:
        """Processor time of each step [s]."""
        return {step: self.costs.get(step, Cost()).cpu_seconds for step in STEPS}

    @property
    def peak_rss_mb(self) -> float:
        """Most memory of the process, or of one it started, in any step [MB]."""
        return max(cost.peak_rss_mb for cost in self.costs.values())

    @property
    def total(self) -> float:
        """Wall-clock time from scene to answers [s]."""
        return sum(self.seconds.values())

    @property
    def cpu_total(self) -> float:
        """Processor time from scene to answers [s]."""
        return sum(self.cpu_seconds.values())


@dataclass(frozen=True, eq=False)
class VariantSolution:
    """What a variant of a machine does in one pose.

    Attributes:
        modal: Modes up to ``REACH`` times what the scene asks for; None without a modal analysis.
        named: Names and energy shares of all of them.
        wanted: How many of them the scene asks for.
        points: Compliance and budget by point name; empty without a static analysis.
        weak_links: Point to direction to the part that gives most of the compliance.
        effort: From scene to answers, without error estimates.
        errors: ± of natural frequencies of ``modal`` and of compliances in x, y, z.
        response: Frequency response as a run finds it; None where none is asked for.
        frf: The same machine, ready to be asked at other frequencies.
        others: Numbers of all other analyses of the scene, in all the poses that it asks for.
        failures: Analyses that were refused, with the reason.
    """

    choice: VariantChoice
    components: dict[str, ComponentFacts]
    pose: str
    machine: PoseModel
    modal: ModalResult | None
    named: NamedModes
    wanted: int
    points: dict[str, PointBudget]
    weak_links: dict[str, dict[str, WeakLink | None]]
    effort: Effort
    errors: Mapping[Key, Estimate]
    response: PoseResponse | None = None
    frf: FrfModel | None = None
    others: Numbers = field(default_factory=Numbers.empty)
    failures: tuple[str, ...] = ()

    def mode_error(self, index: int) -> Estimate:
        """Return the ± of a natural frequency of ``modal``, by its index."""
        return self.errors.get(make_key("frequency", pose=self.pose, mode=index + 1), Estimate())

    def point_error(self, point: str, direction: str) -> Estimate:
        """Return the ± of the compliance at a point along x, y or z."""
        return self.errors.get(compliance_key(self.pose, point, direction), Estimate())

    @cached_property
    def numbers(self) -> Numbers:
        """Every number that was asked for with its ±, by name; modes, compliances and responses of the
        pose, other analyses in all of theirs.
        """
        found: list[Number] = []
        frequencies = () if self.modal is None else self.modal.frequencies_hz[: self.wanted]
        for mode, hz in enumerate(frequencies):
            key = make_key("frequency", pose=self.pose, mode=mode + 1)
            found.append(Number(key, float(hz), "Hz", self.errors.get(key)))
        points = {
            name: PointCompliance(budget.compliance, budget.shares)
            for name, budget in self.points.items()
        }
        found += StaticAnswer(self.pose, points, errors=self.errors).list_numbers()
        found += () if self.response is None else self.response.list_numbers()
        return Numbers.collect((*found, *self.others.values()))


def solve_variant(
    path: Path, choice: VariantChoice, *, pose: str | None, comm: MPI.Comm, store: Store
) -> VariantSolution | None:
    """Solve one variant of a scene in one pose; collective.

    Args:
        pose: Pose name; None for the first.
        comm: Ranks that reduce elastic components together.
        store: Where meshes and superelements are kept.

    Returns:
        The solution on rank 0, None elsewhere.

    Raises:
        SceneError: The variant of the scene has problems.
        FidelityError: The machine has no answer at the fidelity of the choice; on rank 0 alone,
            after all that ranks do together.
        HeadstockError: A computation failed.
    """
    with measure() as loading:
        scene = make_on_root(
            comm, lambda: load_scene(path, variant=choice.variant, overrides=choice.overrides)
        )
        state = start_run(scene, comm, store)
    effort = _make_components(state).add("load", loading)
    if not state.is_root:
        return None
    stands = _choose_pose(scene, pose)
    try:
        solution = _answer(state, choice, stands, effort)
    except ModelError as error:
        if choice.fidelity is None and not choice.unasked:
            raise
        raise FidelityError(str(error)) from error
    return _with_others(solution, scene, store)


def plan_variant(path: Path, choice: VariantChoice) -> PlannedRun:
    """Return the run of a variant of a scene with its plan."""
    return plan_run(load_scene(path, variant=choice.variant, overrides=choice.overrides))


def _answer(state: RunState, choice: VariantChoice, pose: Pose, effort: Effort) -> VariantSolution:
    """Return every answer of the machine in a pose that the scene asks for; on rank 0.

    Args:
        effort: What the components cost.

    Raises:
        ModelError: The machine cannot move, or nothing is determined.
    """
    with measure() as coupling:
        machine = pose_machine(state.parts, pose)
    with measure() as solving:
        modal, wanted = _solve_modes(machine, state.scene.analyses.get(ModalRequest))
    solution = VariantSolution(
        choice=choice,
        components={
            name: gather_facts(state, name, reduced) for name, reduced in state.reduced.items()
        },
        pose=pose.name,
        machine=machine,
        modal=modal,
        named=NamedModes((), (), ()) if modal is None else machine.name_modes(modal),
        wanted=wanted,
        points={},
        weak_links={},
        effort=effort.add("couple", coupling).add("modes", solving),
        errors={
            make_key("frequency", pose=pose.name, mode=mode): error
            for mode, error in enumerate(
                () if modal is None else machine.estimate_mode_errors(modal), 1
            )
        },
    )
    return _with_response(_with_compliances(solution, state), state)


def name_uncompared(scene: Scene) -> tuple[str, ...]:
    """Answers that a comparison has none of, each with what would give it."""
    asked, uncompared = scene.analyses, []
    point = next(iter(scene.machine.points), "COMPONENT.INTERFACE")
    if StaticRequest not in asked:
        uncompared.append("no compliances are compared: the scene has no [analyses.static]")
    if ModalRequest not in asked:
        uncompared.append("no modes are compared: the scene has no [analyses.modal]")
    if FrfRequest not in asked:
        uncompared.append(
            "no frequency responses are compared: the scene has no [analyses.frf]; "
            f'add inputs = ["{point}"], up_to = "500 Hz" there, and damping in [effects]'
        )
    return tuple(uncompared)


def _choose_pose(scene: Scene, name: str | None) -> Pose:
    """A pose by name, or the first one that the analyses ask for.

    Raises:
        ModelError: There is no such pose.
    """
    if name is None:
        modal, static = scene.analyses.get(ModalRequest), scene.analyses.get(StaticRequest)
        asked: Sequence[str] = (
            (modal.poses if modal else ()) or (static.poses if static else ()) or tuple(scene.poses)
        )
        return scene.poses[asked[0]]
    if name not in scene.poses:
        raise ModelError(f"there is no pose {name!r}; poses: {', '.join(scene.poses)}")
    return scene.poses[name]


def _make_components(state: RunState) -> Effort:
    """Make the superelements; importing the finite elements is measured apart."""
    imports: list[float] = []
    records: list[StageRecord] = []

    def import_elements(stage: Stage) -> None:
        if stage.kind == "reduce" and stage.component in state.meshes:
            with measure() as importing:
                importlib.import_module(ELASTIC_MODULE)
            imports.append(importing.seconds)

    make_superelements(state, announce=import_elements, observer=records.append)
    stored = [record.cached for record in records if record.stage.kind == "reduce"]
    cost = Cost(
        sum(record.seconds for record in records),
        sum(record.cpu_seconds for record in records),
        max((record.peak_rss_mb for record in records), default=0.0),
    )
    return Effort({"components": cost}, sum(imports), len(stored), sum(stored))


def _solve_modes(
    machine: PoseModel, request: ModalRequest | None
) -> tuple[ModalResult | None, int]:
    """Modes somewhat beyond what is asked for, and how many are asked for."""
    if request is None:
        return None, 0
    count = None if request.count is None else int(REACH * request.count) + 1
    limit = None if request.up_to_hz is None else REACH * request.up_to_hz
    modal = solve_modal(machine.system, count=count, up_to_hz=limit)
    return modal, request.count_wanted(modal.frequencies_hz, modal.rigid_count)


def _with_compliances(solution: VariantSolution, state: RunState) -> VariantSolution:
    request, machine = state.scene.analyses.get(StaticRequest), solution.machine
    if request is None:
        return solution
    errors: dict[Key, Estimate] = {}
    try:
        with measure() as cost:
            points, links = (
                _solve_lumped(machine, request.at)
                if machine.coupled is None
                else _solve_budgets(machine.coupled, request.at)
            )
    except ModelError as error:
        return dataclasses.replace(solution, failures=(f"static analysis: {error}",))
    for name, budget in points.items():
        by_axis = (
            dict.fromkeys(DIRECTIONS, LUMPED)
            if machine.coupled is None
            else estimate_compliance_errors(state.parts, machine.coupled, budget.displacements)
        )
        errors |= {
            compliance_key(solution.pose, name, axis): error for axis, error in by_axis.items()
        }
    return dataclasses.replace(
        solution,
        points=points,
        weak_links=links,
        errors={**solution.errors, **errors},
        effort=solution.effort.add("static", cost),
    )


type _Compliances = tuple[dict[str, PointBudget], dict[str, dict[str, WeakLink | None]]]


def _solve_budgets(coupled: CoupledMachine, at: Sequence[str]) -> _Compliances:
    """Return compliances at points, and what gives most in x, y and z at each."""
    points = {name: point_budget(coupled, name) for name in at}
    return points, {
        name: {axis: find_weakest_link(coupled, name, axis, budget) for axis in DIRECTIONS}
        for name, budget in points.items()
    }


def _solve_lumped(machine: PoseModel, at: Sequence[str]) -> _Compliances:
    """Return the same of a lumped mechanism."""
    solved = solve_points(machine, at).answer.points
    links: dict[str, dict[str, WeakLink | None]] = {}
    for name, point in solved.items():
        links[name] = {}
        for axis, shares in point.budget.items():
            weakest = max(shares, key=lambda part: shares[part])
            # springs in series: twice the stiffness takes half of the share away
            links[name][axis] = WeakLink(weakest, axis, shares[weakest], -0.5 * shares[weakest])
    return {
        name: PointBudget(point.compliance, point.budget, np.zeros((0, 6)))
        for name, point in solved.items()
    }, links


def _with_response(solution: VariantSolution, state: RunState) -> VariantSolution:
    if FrfRequest not in state.scene.analyses:
        return solution
    machine = solution.machine
    try:
        with measure() as cost:
            model = prepare_response(machine)
            respond(machine, with_errors=False, model=model)
    except ModelError as error:
        failures = (*solution.failures, f"frequency response: {error}")
        return dataclasses.replace(solution, failures=failures)
    return dataclasses.replace(
        solution,
        # once more with its error estimate, which is no part of the cost
        response=respond(machine, model=model).answer,
        frf=model,
        effort=solution.effort.add("frf", cost),
    )


def _with_others(solution: VariantSolution, scene: Scene, store: Store) -> VariantSolution:
    """What a run finds beside modes, compliances and responses: paths, contours, lobes, maps, loads
    over time, control, volumetric errors.
    """
    analyses = scene.analyses.drop(("static", "modal", "frf"))
    if not analyses.requests:
        return solution
    alone = dataclasses.replace(scene, analyses=analyses)
    try:
        with measure() as cost:
            state = run_stages(alone, MPI.COMM_SELF, store, with_errors=False)
    except HeadstockError as error:
        return dataclasses.replace(solution, failures=(*solution.failures, str(error)))
    return dataclasses.replace(
        solution,
        others=gather_results(state).numbers,
        failures=(*solution.failures, *state.failures),
        effort=solution.effort.add("others", cost),
    )


def choose_variants(
    path: Path,
    names: Sequence[str] = (),
    *,
    fidelities: Sequence[Fidelity] = (),
    overrides: Sequence[str] = (),
    baseline: bool = True,
) -> tuple[VariantChoice, ...]:
    """Variants to compare.

    Args:
        names: Variants, ``A+B`` for joined ones, ``as written`` for the scene itself; all of them
            when empty.
        fidelities: Each variant once per fidelity, taken by every component that it has elastic or
            segmented; one that a component cannot have says so in ``cannot``.
        overrides: ``key=value`` settings for all of them.
        baseline: Put the scene as written before them, unless it is named, one of them is the same,
            or fidelities are compared; a lumped mechanism is no baseline of others.

    Raises:
        SceneError: A variant has problems, or no two models are left to compare; holds all of them.
    """
    base = load_scene(path, overrides=overrides)
    scenes, problems = _load_variants(path, names or base.variants or (AS_WRITTEN,), overrides)
    same = any(scene.raw == base.raw for _, scene in scenes)
    if baseline and not same and not (names and (fidelities or base.is_lumped)):
        first = VariantChoice(AS_WRITTEN, None, tuple(overrides), unasked=True)
        scenes.insert(0, (first, base))
    choices = [
        made
        for choice, scene in scenes
        for made in _with_fidelities(choice, scene, fidelities, alone=len(scenes) == 1)
    ]
    return _mark_impossible(path, choices, problems)


def _mark_impossible(
    path: Path, choices: Sequence[VariantChoice], problems: list[Problem]
) -> tuple[VariantChoice, ...]:
    """Return the choices, each with why it cannot be.

    Args:
        problems: Of variants that are no choice.

    Raises:
        SceneError: There are such problems, or no two choices can be.
    """
    refused = [_list_problems(path, choice) for choice in choices]
    if refused.count([]) < min(2, len(choices)):
        problems += itertools.chain.from_iterable(refused)
    if problems:
        raise SceneError(list(dict.fromkeys(problems)))
    return tuple(
        dataclasses.replace(
            choice, cannot="; ".join(f"{problem.key}: {problem.message}" for problem in reasons)
        )
        for choice, reasons in zip(choices, refused, strict=True)
    )


def _load_variants(
    path: Path, names: Sequence[str], overrides: Sequence[str]
) -> tuple[list[tuple[VariantChoice, Scene]], list[Problem]]:
    """Return the variants that can be loaded, and the problems of all others."""
    scenes: list[tuple[VariantChoice, Scene]] = []
    problems: list[Problem] = []
    for name in names:
        choice = VariantChoice(name, None if name == AS_WRITTEN else name, tuple(overrides))
        loaded = _try_to_load(path, choice)
        if isinstance(loaded, Scene):
            scenes.append((choice, loaded))
        else:
            problems += loaded
    return scenes, problems


def _with_fidelities(
    choice: VariantChoice, scene: Scene, fidelities: Sequence[Fidelity], *, alone: bool
) -> list[VariantChoice]:
    """The choice once per fidelity.

    Args:
        fidelities: None for the variant as it is.
        alone: It is the only variant: the scene as written needs no name beside the fidelity.
    """
    deforming = deforming_parts(scene)
    if not deforming or not fidelities:
        return [choice]
    before = "" if alone and choice.variant is None else f"{choice.name} "
    return [
        VariantChoice(
            f"{before}{fidelity}",
            choice.variant,
            (*choice.overrides, *(f"components.{name}.fidelity={fidelity}" for name in deforming)),
            fidelity,
        )
        for fidelity in fidelities
    ]


def _list_problems(path: Path, choice: VariantChoice) -> list[Problem]:
    """Return why a variant cannot have its fidelity."""
    loaded = _try_to_load(path, choice) if choice.fidelity else []
    return loaded if isinstance(loaded, list) else []


def _try_to_load(path: Path, choice: VariantChoice) -> Scene | list[Problem]:
    try:
        return load_scene(path, variant=choice.variant, overrides=choice.overrides)
    except SceneError as error:
        return list(error.problems)
