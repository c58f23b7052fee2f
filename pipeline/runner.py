"""Run a scene: plan it, run the stages of the plan in turn, gather what they found, write it.

A run in a few lines, as ``docs/architecture.md`` executes it::

    scene = load_scene(path)
    plan = plan_scene(scene)                               # stages, each with its reason and cost
    state = run_stages(scene, MPI.COMM_SELF, plan=plan)    # each stage adds answers to the state
    results = gather_results(state)

Stages of components come first; each later one is a handler that takes the state of the run and
adds an answer to it. With an accuracy in the scene, rounds of stages repeat until it is met.
:func:`run_scene` does the same and writes the files of the results.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.numbers.folders import RESULTS_FILE, SUMMARY_FILE
from headstock.pipeline.planning.analyses import RECORDS, load_named
from headstock.pipeline.planning.budgets import check_elapsed
from headstock.pipeline.planning.plan import Plan, Stage, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import Cost
from headstock.pipeline.preview.doubts import doubt_machine
from headstock.pipeline.results.files import add_results, publish_summary, write_sizes
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.stages.run_state import (
    Announcer,
    Observer,
    Outcome,
    ReducedComponent,
    RunState,
    run_stage,
)
from headstock.pipeline.stages.shared_components import find_ranks, make_superelements, start_run
from headstock.pipeline.stages.warnings import find_warnings
from headstock.pipeline.storage.content_keys import library_versions
from headstock.pipeline.storage.outputs import PendingOutputs, prepare_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.pipeline.volume_files import volume_grid, write_volumes
from headstock.scene.analyses.lobes import require_feed_of_run
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, acting_assumptions
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import SharedFailure, make_on_root
from headstock.solvers.shared_work import all_cores_on_root

LIBRARIES = ("fenics-dolfinx", "petsc4py", "slepc4py", "gmsh", "numpy", "scipy", "h5py", "mpi4py")


def run_scene(
    scene: Scene,
    output: Path,
    *,
    comm: MPI.Comm,
    observer: Observer = lambda record: None,
    store: Store | None = None,
    announce: Announcer = lambda stage: None,
    volume: bool = False,
    provenance: Provenance | None = None,
) -> Results:
    """Run the stages a scene calls for and write ``results.h5``, ``summary.json`` and its exports.

    Rank 0 meshes, couples, reads and writes; all ranks assemble and reduce. What fails on rank 0
    alone is known to all; an error on another rank leaves the others waiting: the caller ends the
    job (``comm.Abort``).

    Args:
        scene: The same on every rank.
        output: Folder for the files, made where it is missing.
        observer: Called with each stage as it ends, on rank 0.
        store: Where meshes and superelements are kept; by default the user's.
        announce: Called with each stage before it begins, on rank 0.
        volume: Write the volume meshes with their motions and stresses, too.
        provenance: Where the results come from, to be written with them.

    Returns:
        Its results; complete on rank 0 only.

    Raises:
        SceneError: Lobes along the feed are asked for in poses that are on no path.
        HeadstockError: A computation or a file failed; earlier files are untouched.
        SharedFailure: It failed on rank 0 of several; on every rank.
    """
    make_on_root(comm, lambda: require_feed_of_run(scene))
    exported = (one.name_file(name).name for name, one in scene.exports.items())
    files = (RESULTS_FILE, SUMMARY_FILE, *exported)
    make_on_root(comm, lambda: prepare_output(output, files))
    runner = _StageRunner(scene, comm, store, observer=observer, announce=announce)
    state = _run_rounds(scene, runner)
    remarks = make_on_root(
        comm, lambda: _write(state, runner, output, volume=volume, provenance=provenance)
    )
    results = gather_results(
        state, tuple(runner.records), provenance=provenance, files=remarks.files
    )
    results = dataclasses.replace(results, warnings=(*results.warnings, *remarks.warnings))
    if failures := _export(state.scene, output, runner, provenance):
        results = dataclasses.replace(results, failures=(*results.failures, *failures))
        make_on_root(comm, lambda: _write_summary(output, results))
    return results


def _export(
    scene: Scene, output: Path, runner: "_StageRunner", provenance: Provenance | None
) -> list[str]:
    """Write the exports of a scene that can be written, and return why others cannot; collective."""
    failures: list[str] = []
    # of several ranks an error that not all know of ends the job
    caught = (HeadstockError, SceneError) if runner.comm.size == 1 else (SharedFailure,)
    for name, wanted in scene.exports.items():
        path = output / wanted.name_file(name)
        try:
            load_named("headstock.pipeline.exports:export")(
                scene, wanted, path, comm=runner.comm, store=runner.store, origin=provenance
            )
        except caught as error:
            failures.append(f"{scene.path.name}: exports.{name}: {error}")
    return failures


def _write_summary(output: Path, results: Results) -> None:
    with PendingOutputs() as pending:
        publish_summary(pending, output, results)


def run_stages(
    scene: Scene,
    comm: MPI.Comm,
    store: Store | None = None,
    *,
    plan: Plan | None = None,
    with_errors: bool = True,
    observer: Observer = lambda record: None,
) -> RunState:
    """Run all stages of a scene but the one that writes; collective.

    Args:
        scene: The same on every rank.
        store: Where meshes and superelements are kept; by default the user's.
        plan: Of the scene, where it is already known.
        with_errors: Choose models for the accuracy of the scene, and compare with other models of
            bodies and joints as it asks; else it is run as it is written.
        observer: Called with each stage as it ends, on rank 0.

    Returns:
        The state with the answers found; complete on rank 0 only.

    Raises:
        HeadstockError: A computation failed; on several ranks the cause of a ``SharedFailure``.
    """
    if not with_errors:
        scene = dataclasses.replace(
            scene, accuracy=None, model_errors=False, interface_errors=False, fit=None
        )
    return _run_rounds(scene, _StageRunner(scene, comm, store, observer=observer), plan)


def _run_rounds(scene: Scene, runner: "_StageRunner", plan: Plan | None = None) -> RunState:
    """Run one round, or as many as an accuracy needs."""
    if scene.accuracy is None:
        ranks = find_ranks(runner.comm)
        return runner.run(
            scene, plan or make_on_root(runner.comm, lambda: plan_scene(scene, held=ranks))
        )
    # most scenes need none of the modules of the search
    searched: RunState = load_named("headstock.pipeline.accuracy.search:run_searched")(
        scene, runner
    )
    return searched


@dataclasses.dataclass(frozen=True)
class _Written:
    """What was written: SHA-256 of files by name, and what to warn of."""

    files: dict[str, str]
    warnings: tuple[str, ...]


def _write(
    state: RunState,
    runner: "_StageRunner",
    output: Path,
    *,
    volume: bool,
    provenance: Provenance | None,
) -> _Written:
    """Write results and summary, the last stage, then volume meshes; on rank 0."""
    # results.h5 and the summary appear together at the end: a disk that is too full for one keeps
    # both old ones
    with PendingOutputs() as pending:
        files: dict[str, str] = {}

        def write(state: RunState, stage: Stage) -> Outcome:
            for message in find_warnings(state):
                state.warn(message)
            results = gather_results(state, tuple(runner.records), provenance=provenance)
            files[RESULTS_FILE] = add_results(pending, output, results)
            return Outcome(detail=str(output))

        runner.run_stage(state, state.plan.stages[-1], write)
        results = gather_results(state, tuple(runner.records), provenance=provenance, files=files)
        publish_summary(pending, output, results)
    # the results are safe by now
    remarks = write_sizes(output, state.scene.machine.components)
    return _Written(files, (*remarks, *write_volumes(state, output, wanted=volume)))


# stages of the machine that no request asks for; those of a component are in `COMPONENT_STAGES` of
# stages/components.py and run first, `write` is in `run_scene`, and `refine` is what accuracy/search.py
# records of a round
_MACHINE_STAGES = {
    "couple": "headstock.pipeline.stages.machine:run_couple_stage",
    "place": "headstock.pipeline.stages.mechanism:run_place_stage",
    "spread": "headstock.pipeline.stages.modal:run_spread_stage",
    "models": "headstock.pipeline.accuracy.model_errors:run_models_stage",
    "joints": "headstock.pipeline.accuracy.interface_errors:run_interfaces_stage",
    "fit": "headstock.pipeline.accuracy.fit_errors:run_fit_stage",
}
# loaded so far, by kind
HANDLERS: dict[str, Callable[[RunState, Stage], Outcome]] = {}
# all ranks work on them
SHARED_STAGES = {"spread", "models", "joints", "fit"} | {
    record.kind for record in RECORDS if record.shared
}


def _find_handler(kind: str) -> Callable[[RunState, Stage], Outcome]:
    """Return what does the work of a stage of the machine."""
    if kind not in HANDLERS:
        named = {record.kind: record.solve for record in RECORDS} | _MACHINE_STAGES
        HANDLERS[kind] = load_named(named[kind])
    return HANDLERS[kind]


class _StageRunner:
    """Runs stages and keeps their records: once, or in as many rounds as an accuracy needs."""

    def __init__(
        self,
        scene: Scene,
        comm: MPI.Comm,
        store: Store | None,
        *,
        observer: Observer,
        announce: Announcer = lambda stage: None,
    ) -> None:
        self.limit_s, self.comm = scene.limits.time_s, comm
        self.store = store or Store(default_store_root())
        self.observer, self.announce = observer, announce
        self.records: list[StageRecord] = []
        self._start = time.perf_counter()

    def run(
        self,
        scene: Scene,
        plan: Plan,
        reduced: Mapping[str, ReducedComponent] | None = None,
        *,
        mesh_factors: Mapping[str, float] | None = None,
    ) -> RunState:
        """Run every stage of a plan but the last, which writes; those of components only where they
        are not reduced yet.

        Args:
            reduced: Components of an earlier round that serve again; None where all are to be made.
            mesh_factors: Component to what its estimates of mesh errors are multiplied by.
        """
        state = start_run(scene, self.comm, self.store, plan=plan, reduced=dict(reduced or {}))
        for message in (*scene.warnings, *plan.warnings, *doubt_machine(scene, read=False)):
            state.warn(message)
        if reduced is None:
            make_superelements(state, announce=self._begin, observer=self._record)
        state.weigh_meshes(mesh_factors or {})
        for stage in plan.stages[:-1]:
            if stage.component is None:
                work = functools.partial(self.run_stage, state, stage, _find_handler(stage.kind))
                if stage.kind in SHARED_STAGES:
                    work()
                else:
                    with all_cores_on_root(self.comm):
                        make_on_root(self.comm, work)
        return state

    def run_stage(
        self, state: RunState, stage: Stage, work: Callable[[RunState, Stage], Outcome]
    ) -> None:
        """Announce a stage of the machine, do its work, and record what it cost.

        Args:
            state: What the stages hand on.
            stage: One of the plan's.
            work: Does it and returns what became of it.
        """
        run_stage(state, stage, work, announce=self._begin, observer=self._record)

    def _begin(self, stage: Stage) -> None:
        if stage.kind != "write":
            check_elapsed(time.perf_counter() - self._start, self.limit_s, stage)
        if self.comm.rank == 0:
            self.announce(stage)

    def note(self, stage: Stage, change: str, cost: Cost) -> None:
        """Record a decision, and what it cost to come to it."""
        record = StageRecord(
            stage,
            cost.seconds,
            cached=False,
            peak_rss_mb=cost.peak_rss_mb,
            detail=change,
            cpu_seconds=cost.cpu_seconds,
        )
        self._record(record)

    def _record(self, record: StageRecord) -> None:
        self.records.append(record)
        self.observer(record)


def gather_results(
    state: RunState,
    records: tuple[StageRecord, ...] = (),
    *,
    provenance: Provenance | None = None,
    files: dict[str, str] | None = None,
) -> Results:
    """Return what a run has found so far.

    Args:
        provenance: Where the results come from.
        files: SHA-256 by name of files that are written.
    """
    superelements = {name: reduced.superelement for name, reduced in state.reduced.items()}
    return Results(
        name=state.scene.name,
        versions=library_versions(LIBRARIES),
        stages=records,
        components={
            name: gather_facts(state, name, reduced) for name, reduced in state.reduced.items()
        },
        answers=tuple(state.answers),
        joint_springs={
            name: joint.stiffness
            for name, joint in state.scene.machine.joints.items()
            if joint.stiffness.any()
        },
        labels=tuple(
            f"{name}.{'.'.join(label)}"
            for name, item in superelements.items()
            for label in item.labels
        ),
        warnings=tuple(state.warnings),
        assumptions=acting_assumptions(state.scene),
        failures=tuple(state.failures),
        files=files or {},
        provenance=provenance,
        volumes=functools.partial(volume_grid, state),
        view=MachineView(
            state.skins,
            {name: axis.direction for name, axis in state.scene.machine.axes.items()},
            state.views,
            {
                name: state.plan.components[name].material
                for name, skin in state.skins.items()
                if skin.source == "mesh"
            },
        ),
    )


def gather_facts(state: RunState, name: str, reduced: ReducedComponent) -> ComponentFacts:
    """Return what became of a component of a run.

    Args:
        reduced: What it was reduced to, with the quality of its mesh.
    """
    superelement, quality = reduced.superelement, reduced.quality
    component = state.plan.components[name]
    mass = superelement.mass_kg
    if mass == 0.0 and quality is not None:
        # a static run assembles no mass
        mass = (
            component.material.density * quality.volume
            if component.mass is None
            else component.mass
        )
    return ComponentFacts(
        fidelity="superelement"
        if isinstance(component.solid, SuperelementFile)
        else component.fidelity,
        full_dofs=superelement.full_dofs,
        reduced_dofs=len(superelement.labels),
        mass_kg=mass,
        cutoff_hz=superelement.cutoff_hz,
        residual=superelement.residual,
        quality=quality,
        corrected=superelement.errors.corrected,
    )
