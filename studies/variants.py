"""Variants of a scene: which to hold side by side, and each from its file to its modes and
compliances, with the time of each step.
"""

import dataclasses
import importlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Fidelity
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import Cost, measure
from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.results import ComponentFacts
from headstock.pipeline.runner import gather_facts
from headstock.pipeline.stages.components import ELASTIC_MODULE, make_superelements
from headstock.pipeline.stages.estimates import estimate_compliance_errors, estimate_mode_errors
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.motions.compliance_budget import (
    PointBudget,
    WeakLink,
    find_weakest_link,
    point_budget,
)
from headstock.reduction.motions.mode_naming import name_modes
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import Problem, SceneError
from headstock.scene.requests import ModalRequest
from headstock.scene.scene import Scene
from headstock.scene.schema.overrides import AS_WRITTEN
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.ranks import share_from_root

# modes are looked for further up than the scene asks, since a partner may lie beyond its limit
REACH = 1.5
STEPS = ("load", "components", "couple", "modes")


@dataclass(frozen=True)
class VariantChoice:
    """A variant to look at.

    Attributes:
        name: What it is called in tables.
        variant: Variants of the scene, ``A+B`` for several; None for the scene as written.
        overrides: ``key=value`` settings applied after it.
    """

    name: str
    variant: str | None = None
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Effort:
    """What it cost to get from the scene file to the modes.

    Attributes:
        seconds: Wall-clock time of each of ``STEPS`` [s].
        cpu_seconds: Processor time of each, threads and child processes included [s].
        import_seconds: Time to load the finite element library, which is no part of the steps [s].
        reduced: Elastic components there are.
        stored: How many of them came from the store.
    """

    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    import_seconds: float = 0.0
    reduced: int = 0
    stored: int = 0

    @property
    def total(self) -> float:
        """Wall-clock time from scene to modes [s]."""
        return sum(self.seconds.values())

    @property
    def cpu_total(self) -> float:
        """Processor time from scene to modes [s]."""
        return sum(self.cpu_seconds.values())


@dataclass(frozen=True, eq=False)
class VariantSolution:
    """What a variant of a machine does in one pose.

    Attributes:
        choice: Which variant it is.
        components: By name.
        pose: Name of the pose.
        coupled: The machine in it.
        modal: Modes up to ``REACH`` times what the scene asks for; None without a modal analysis.
        mode_names: Of all of them.
        wanted: How many of them the scene asks for.
        points: Compliance and budget by point name; empty without a static analysis.
        weak_links: Point to direction to the part that gives most of the compliance.
        effort: From scene to modes, without error estimates.
        mode_errors: An estimate [Hz] per natural frequency of ``modal``.
        point_errors: Point to direction to an estimate [m/N] of the compliance along it.
        failures: Analyses that were refused, with the reason.
    """

    choice: VariantChoice
    components: dict[str, ComponentFacts]
    pose: str
    coupled: CoupledMachine
    modal: ModalResult | None
    mode_names: tuple[str, ...]
    wanted: int
    points: dict[str, PointBudget]
    weak_links: dict[str, dict[str, WeakLink | None]]
    effort: Effort
    mode_errors: tuple[Estimate, ...]
    point_errors: dict[str, dict[str, Estimate]] = field(default_factory=dict)
    failures: tuple[str, ...] = ()


def solve_variant(
    path: Path, choice: VariantChoice, *, pose: str | None, comm: MPI.Comm, store: Store
) -> VariantSolution | None:
    """Solve one variant of a scene in one pose; collective.

    Args:
        path: Scene file.
        choice: The variant.
        pose: Pose name; None for the first.
        comm: Ranks that reduce elastic components together.
        store: Where meshes and superelements are kept.

    Returns:
        The solution on rank 0, None elsewhere.

    Raises:
        SceneError: The variant of the scene has problems.
        HeadstockError: A computation failed.
    """
    with measure() as loading:
        scene = share_from_root(
            comm,
            load_scene(path, variant=choice.variant, overrides=choice.overrides)
            if comm.rank == 0
            else None,
        )
        state = RunState(scene, plan_scene(scene), comm, store)
    effort, superelements = _make_components(state)
    if not state.is_root:
        return None
    stands = choose_pose(scene, pose)
    with measure() as coupling:
        coupled = couple(superelements, scene.machine, stands, gravity=state.plan.gravity)
    with measure() as solving:
        modal, wanted = _solve_modes(coupled, scene.analyses.modal)
    costs = {"load": loading, "couple": coupling, "modes": solving}
    solution = VariantSolution(
        choice=choice,
        components={
            name: gather_facts(state, name, reduced) for name, reduced in state.reduced.items()
        },
        pose=stands.name,
        coupled=coupled,
        modal=modal,
        mode_names=() if modal is None else name_modes(coupled, modal).names,
        wanted=wanted,
        points={},
        weak_links={},
        effort=_add_steps(effort, costs),
        mode_errors=() if modal is None else estimate_mode_errors(state.parts, coupled, modal),
    )
    return _with_compliances(solution, state)


def choose_pose(scene: Scene, name: str | None) -> Pose:
    """A pose by name, or the first one that the analyses ask for.

    Raises:
        ModelError: There is no such pose.
    """
    if name is None:
        modal, static = scene.analyses.modal, scene.analyses.static
        asked: Sequence[str] = (
            (modal.poses if modal else ()) or (static.poses if static else ()) or tuple(scene.poses)
        )
        return scene.poses[asked[0]]
    if name not in scene.poses:
        raise ModelError(f"there is no pose {name!r}; poses: {', '.join(scene.poses)}")
    return scene.poses[name]


def _make_components(state: RunState) -> tuple[Effort, dict[str, Superelement]]:
    """Superelements and what they cost; importing the finite elements is measured apart."""
    imports: list[float] = []
    records: list[StageRecord] = []

    def import_elements(stage: Stage) -> None:
        if stage.kind == "reduce" and stage.component in state.meshes:
            with measure() as importing:
                importlib.import_module(ELASTIC_MODULE)
            imports.append(importing.seconds)

    superelements = make_superelements(state, announce=import_elements, observer=records.append)
    stored = [record.cached for record in records if record.stage.kind == "reduce"]
    seconds, cpu_seconds = (
        sum(record.seconds for record in records),
        sum(record.cpu_seconds for record in records),
    )
    return Effort(
        {"components": seconds}, {"components": cpu_seconds}, sum(imports), len(stored), sum(stored)
    ), superelements


def _add_steps(effort: Effort, costs: dict[str, Cost]) -> Effort:
    seconds = effort.seconds | {step: cost.seconds for step, cost in costs.items()}
    cpu_seconds = effort.cpu_seconds | {step: cost.cpu_seconds for step, cost in costs.items()}
    return dataclasses.replace(
        effort,
        seconds={step: seconds[step] for step in STEPS},
        cpu_seconds={step: cpu_seconds[step] for step in STEPS},
    )


def _solve_modes(
    coupled: CoupledMachine, request: ModalRequest | None
) -> tuple[ModalResult | None, int]:
    """Modes somewhat beyond what is asked for, and how many are asked for."""
    if request is None:
        return None, 0
    count = None if request.count is None else int(REACH * request.count) + 1
    limit = None if request.up_to_hz is None else REACH * request.up_to_hz
    modal = solve_modal(coupled.system, count=count, up_to_hz=limit)
    wanted = (
        len(modal.frequencies_hz)
        if request.count is None
        else min(request.count, len(modal.frequencies_hz))
    )
    if request.up_to_hz is not None:
        wanted = min(
            wanted, max(modal.rigid_count, int((modal.frequencies_hz <= request.up_to_hz).sum()))
        )
    return modal, wanted


def _with_compliances(solution: VariantSolution, state: RunState) -> VariantSolution:
    request = state.scene.analyses.static
    if request is None:
        return solution
    try:
        points = {name: point_budget(solution.coupled, name) for name in request.at}
    except ModelError as error:
        return dataclasses.replace(solution, failures=(f"static analysis: {error}",))
    links = {
        name: {
            direction: find_weakest_link(solution.coupled, name, direction, budget)
            for direction in DIRECTIONS
        }
        for name, budget in points.items()
    }
    errors = {
        name: estimate_compliance_errors(state.parts, solution.coupled, budget.displacements)
        for name, budget in points.items()
    }
    return dataclasses.replace(solution, points=points, weak_links=links, point_errors=errors)


def choose_variants(
    path: Path,
    names: Sequence[str] = (),
    *,
    fidelities: Sequence[Fidelity] = (),
    overrides: Sequence[str] = (),
) -> tuple[VariantChoice, ...]:
    """Variants to compare.

    Args:
        path: Scene file.
        names: Variants, ``A+B`` for joined ones, ``as written`` for the scene itself; all of them
            when empty, and the scene as written where none of them is the same.
        fidelities: Each variant once per fidelity, taken by every component that it has elastic or
            segmented.
        overrides: ``key=value`` settings for all of them.

    Raises:
        SceneError: A variant has problems; holds those of all variants.
    """
    base = load_scene(path, overrides=overrides)
    scenes: list[tuple[VariantChoice, Scene]] = []
    problems: list[Problem] = []
    for name in names or (AS_WRITTEN, *base.variants):
        choice = VariantChoice(name, None if name == AS_WRITTEN else name, tuple(overrides))
        try:
            scenes.append((choice, load_scene(path, variant=choice.variant, overrides=overrides)))
        except SceneError as error:
            problems += error.problems
    if not names and any(
        choice.variant is not None and scene.raw == base.raw for choice, scene in scenes
    ):
        scenes = [(choice, scene) for choice, scene in scenes if choice.variant is not None]
    choices = [
        made for choice, scene in scenes for made in _with_fidelities(choice, scene, fidelities)
    ]
    if fidelities:
        problems += [problem for choice in choices for problem in _find_problems(path, choice)]
    if problems:
        raise SceneError(list(dict.fromkeys(problems)))
    return tuple(choices)


def _with_fidelities(
    choice: VariantChoice, scene: Scene, fidelities: Sequence[Fidelity]
) -> list[VariantChoice]:
    deforming = [
        name
        for name, component in scene.machine.components.items()
        if component.fidelity != "rigid" and not isinstance(component.solid, SuperelementFile)
    ]
    if not deforming or not fidelities:
        return [choice]
    return [
        VariantChoice(
            f"{choice.name} {fidelity}",
            choice.variant,
            (*choice.overrides, *(f"components.{name}.fidelity={fidelity}" for name in deforming)),
        )
        for fidelity in fidelities
    ]


def _find_problems(path: Path, choice: VariantChoice) -> list[Problem]:
    try:
        load_scene(path, variant=choice.variant, overrides=choice.overrides)
    except SceneError as error:
        return list(error.problems)
    return []
