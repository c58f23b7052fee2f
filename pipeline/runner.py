"""Running exactly the stages of a plan, on one or many ranks."""

import time
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

from headstock.geometry.solids import SuperelementFile
from headstock.pipeline.atomic_files import PendingFiles
from headstock.pipeline.budgets import check_elapsed
from headstock.pipeline.component_stages import (
    run_load_stage,
    run_mesh_stage,
    run_reduce_stage,
    run_rigid_stage,
    run_segment_stage,
)
from headstock.pipeline.content_keys import library_versions
from headstock.pipeline.contouring_stage import run_contour_stage
from headstock.pipeline.control_stage import run_control_stage
from headstock.pipeline.frf_stages import run_frf_stage
from headstock.pipeline.machine_stages import run_couple_stage, run_modal_stage, run_static_stage
from headstock.pipeline.machine_views import MachineView
from headstock.pipeline.map_stage import run_map_stage
from headstock.pipeline.mechanism_stages import (
    run_lumped_frf_stage,
    run_lumped_modal_stage,
    run_lumped_static_stage,
    run_place_stage,
)
from headstock.pipeline.path_stage import run_path_stage
from headstock.pipeline.planner import plan_scene
from headstock.pipeline.probe_stages import run_recover_stage
from headstock.pipeline.rank_messages import share_from_root
from headstock.pipeline.resources import measure
from headstock.pipeline.result_files import RESULTS_FILE, add_results, prepare_output, publish_summary
from headstock.pipeline.result_warnings import find_warnings
from headstock.pipeline.results import ComponentFacts, Results
from headstock.pipeline.run_state import Outcome, ReducedComponent, RunState
from headstock.pipeline.scene import Scene
from headstock.pipeline.stages import Stage, StageRecord
from headstock.pipeline.store import Store, default_store_root

Observer = Callable[[StageRecord], None]
Announcer = Callable[[Stage], None]
LIBRARIES = ("fenics-dolfinx", "petsc4py", "slepc4py", "gmsh", "numpy", "scipy", "h5py", "mpi4py")
HANDLERS: dict[str, Callable[[RunState, Stage], Outcome]] = {
    "mesh": run_mesh_stage,
    "reduce": run_reduce_stage,
    "rigid": run_rigid_stage,
    "segment": run_segment_stage,
    "load": run_load_stage,
    "couple": run_couple_stage,
    "static": run_static_stage,
    "recover": run_recover_stage,
    "modal": run_modal_stage,
    "place": run_place_stage,
    "map": run_map_stage,
    "contour": run_contour_stage,
    "frf": run_frf_stage,
    "path": run_path_stage,
    "control": run_control_stage,
}
# what differs once a lumped mechanism has been placed
LUMPED_HANDLERS = HANDLERS | {"static": run_lumped_static_stage, "modal": run_lumped_modal_stage, "frf": run_lumped_frf_stage}


def run_scene(
    scene: Scene,
    output: Path,
    *,
    comm: MPI.Comm,
    observer: Observer = lambda record: None,
    store: Store | None = None,
    announce: Announcer = lambda stage: None,
) -> Results:
    """Run the stages a scene calls for and write ``results.h5`` and ``summary.json``.

    Rank 0 meshes, couples, reads and writes; all ranks assemble and reduce. An error on one rank leaves the others waiting: the
    caller ends the job (``comm.Abort``).

    Args:
        scene: The same on every rank.
        output: Folder for the files, made where it is missing.
        comm: Collective.
        observer: Told of each stage as it ends, on rank 0.
        store: Where meshes and superelements are kept; by default the user's.
        announce: Told of each stage before it begins, on rank 0.

    Returns:
        What was found; complete on rank 0 only.

    Raises:
        HeadstockError: A computation or a file failed; earlier files are untouched.
    """
    plan = plan_scene(scene)
    state = RunState(scene, plan, comm, store or Store(default_store_root()))
    for message in (*scene.warnings, *plan.warnings):
        state.warn(message)
    if state.is_root:
        prepare_output(output)
    records: list[StageRecord] = []
    # results.h5 and the summary appear together at the end: a disk that is too full for one keeps both old ones
    with PendingFiles() as pending:
        start = time.perf_counter()
        for stage in plan.stages:
            check_elapsed(time.perf_counter() - start, scene.limits.time_s, stage)
            if state.is_root:
                announce(stage)
            with measure() as cost:
                outcome = _run_stage(state, stage, output, pending)
            if state.is_root:
                records.append(StageRecord(stage, cost.seconds, outcome.cached, cost.peak_rss_mb, outcome.detail))
                observer(records[-1])
        results = gather_results(state, tuple(records))
        if state.is_root:
            publish_summary(pending, output, results)
    return results


def gather_results(state: RunState, records: tuple[StageRecord, ...] = ()) -> Results:
    """What a run has found so far."""
    superelements = {name: reduced.superelement for name, reduced in state.reduced.items()}
    return Results(
        name=state.scene.name,
        versions=library_versions(LIBRARIES),
        stages=records,
        components={name: gather_facts(state, name, reduced) for name, reduced in state.reduced.items()},
        static=state.static,
        probes=state.probes,
        modal=tuple(state.modal),
        mechanism=state.mechanism,
        map=state.map,
        contouring=state.contouring,
        path=state.path,
        control=dict(state.control),
        responses=tuple(state.responses),
        joint_springs={name: joint.stiffness for name, joint in state.scene.machine.joints.items() if joint.stiffness.any()},
        labels=tuple(f"{name}.{'.'.join(label)}" for name, item in superelements.items() for label in item.labels),
        warnings=tuple(state.warnings),
        failures=tuple(state.failures),
        files=dict(state.files),
        view=MachineView(state.skins, {name: axis.direction for name, axis in state.scene.machine.axes.items()}, state.views),
    )


def _run_stage(state: RunState, stage: Stage, output: Path, pending: PendingFiles) -> Outcome:
    if stage.kind != "write":
        handlers = HANDLERS if state.placed is None else LUMPED_HANDLERS
        return handlers[stage.kind](state, stage)
    if state.is_root:
        for message in find_warnings(state):
            state.warn(message)
        state.files[RESULTS_FILE] = add_results(pending, output, gather_results(state))
    # the others wait here, so that all ranks end together
    return Outcome(detail=share_from_root(state.comm, str(output)))


def gather_facts(state: RunState, name: str, reduced: ReducedComponent) -> ComponentFacts:
    """What became of a component of a run."""
    superelement, quality = reduced.superelement, reduced.quality
    component = state.plan.components[name]
    mass = superelement.mass_kg
    if mass == 0.0 and quality is not None:
        # a static run assembles no mass
        mass = component.material.density * quality.volume if component.mass is None else component.mass
    return ComponentFacts(
        fidelity="superelement" if isinstance(component.solid, SuperelementFile) else component.fidelity,
        full_dofs=superelement.full_dofs,
        reduced_dofs=len(superelement.labels),
        mass_kg=mass,
        cutoff_hz=superelement.cutoff_hz,
        residual=superelement.residual,
        quality=quality,
    )
