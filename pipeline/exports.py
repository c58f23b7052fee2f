"""Files for other programs and scenes: a component as matrices or as a mesh, and a machine as a state
space or with the modes and responses of a test.
"""

import dataclasses
from functools import partial
from pathlib import Path

from headstock.geometry.loading import load_library
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import PointMass, SuperelementFile
from headstock.meshing.formats import find_format
from headstock.pipeline.exchange.files import encode_body
from headstock.pipeline.exchange.matrices import eliminate_constraints
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.state_space_export import export_state_space
from headstock.pipeline.storage.outputs import (
    OutputError,
    PendingOutputs,
    check_output,
    naming_output,
)
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store
from headstock.pipeline.test_data_export import export_test_data
from headstock.scene.exports import Export
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.scene import Scene, require_name
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root

# loaded only where a mesh is written: it takes meshio and netCDF4 with it
WRITING_MODULE = "headstock.meshing.files.writing"


def export(
    scene: Scene,
    wanted: Export,
    path: Path,
    *,
    comm: MPI.Comm,
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Write what is asked for; collective.

    Args:
        scene: The same on every rank.
        path: File to write, whole or not at all; of several files what their names begin with.
        store: Where meshes and superelements are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: There is no such component or pose.
        HeadstockError: A computation or a file failed.
    """
    of = wanted.kind.of
    if of == "mesh":
        return export_mesh(scene, wanted.component, path, comm=comm, store=store)
    if of == "test":
        return export_test_data(scene, path, pose=wanted.pose, comm=comm, store=store)
    if of == "body":
        return export_superelement(
            scene,
            wanted.component or "",
            path,
            comm=comm,
            form=wanted.format,
            store=store,
            origin=origin,
        )
    return export_state_space(scene, wanted, path, comm=comm, store=store, origin=origin)


def export_superelement(
    scene: Scene,
    component: str,
    path: Path,
    *,
    comm: MPI.Comm,
    form: str = "h5",
    store: Store | None = None,
    origin: Provenance | None = None,
) -> str:
    """Reduce a component as its scene says and write it; read it back with ``solid = { superelement
    = "x.h5" }``.

    Args:
        scene: The scene; the same on every rank.
        path: File to write, whole or not at all; of several files what their names begin with.
        form: One of those of bodies.
        store: Where meshes and superelements are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: The scene has no such component.
        HeadstockError: The reduction or the file failed.
    """
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    check_output(path)
    # the masses of sensors belong to the test, not to the part
    bare = dataclasses.replace(scene.machine, probes={}, sensors={})
    scene = dataclasses.replace(scene, machine=bare)
    plan = plan_scene(scene)
    require_name(scene, "components", component, plan.components)
    state = start_run(scene, comm, store, plan=plan)
    made = make_superelements(state, only=[component])

    def write() -> str:
        reduced = made[component]
        superelement = reduced if form == "h5" else eliminate_constraints(reduced)
        files = encode_body(superelement, form, origin)
        # a single file is called what it was asked to be
        single = len(files) == 1
        names = [path.name] if single else [path.stem + ending for ending in files]
        with naming_output(path), PendingOutputs() as pending:
            for name, content in zip(names, files.values(), strict=True):
                pending.add(path.with_name(name), content)
            pending.publish()
        written = ", ".join(str(path.with_name(name)) for name in names)
        return (
            f"{written}: {component}, {superelement.full_dofs} -> {len(superelement.labels)} dofs"
        )

    return make_on_root(comm, write)


def export_mesh(
    scene: Scene,
    component: str | None,
    path: Path,
    *,
    comm: MPI.Comm,
    store: Store | None = None,
) -> str:
    """Write the mesh of a component with its patches as named sets, in metres.

    Args:
        scene: The scene; the same on every rank.
        component: Name of one of its components; None for the only one that has a shape.
        path: File to write, whole or not at all; its ending chooses the format.
        comm: Collective; rank 0 meshes and writes.
        store: Where meshes are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: The scene has no such component, or it has no shape.
        MeshError: It cannot be meshed, or the format cannot hold the mesh.
        OutputError: The file cannot be written.
    """
    find_format(path, written=True)
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    check_output(path)
    plan = plan_scene(scene)
    shaped = [
        name
        for name, part in plan.components.items()
        if not isinstance(part.solid, SuperelementFile | PointMass)
    ]
    if component is None and len(shaped) == 1:
        (component,) = shaped
    if component is None:
        findings = Findings(str(scene.path))
        listed = ", ".join(shaped) or "none"
        findings.add(("components",), f"name the one to mesh; those with a shape: {listed}")
        raise SceneError(problem for _, problem in findings.problems)
    require_name(scene, "components", component, shaped)
    state = start_run(scene, comm, store, plan=plan)
    return make_on_root(comm, partial(_write_mesh, state, plan.components[component], path))


def _write_mesh(state: RunState, component: Component, path: Path) -> str:
    writing = load_library(WRITING_MODULE)
    mesh, _ = load_or_make_mesh(state, component)
    with naming_output(path), PendingOutputs() as pending:
        for name, content in writing.encode_mesh(mesh, path).items():
            pending.add(path.with_name(name), content)
        pending.publish()
    sets = ", ".join(mesh.patches) or "none"
    size = f"{len(mesh.cells)} {mesh.kind}, {len(mesh.points)} nodes in metres"
    return f"{path}: {component.name}, {size}, sets: {sets}"
