"""One component of a scene as a superelement file that other scenes can read."""

from pathlib import Path

from mpi4py import MPI

from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.runner import HANDLERS
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.storage.outputs import OutputError, check_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.pipeline.storage.superelements import write_superelement
from headstock.scene.scene import Scene
from headstock.solvers.errors import ModelError
from headstock.solvers.rank_messages import share_from_root


def export_superelement(
    scene: Scene, component: str, path: Path, *, comm: MPI.Comm, store: Store | None = None, origin: Provenance | None = None
) -> str:
    """Reduce a component as its scene says and write it; read it back with ``solid = { superelement = "x.h5" }``.

    Args:
        scene: The scene; the same on every rank.
        component: Name of one of its components.
        path: File to write, whole or not at all.
        comm: Collective.
        store: Where meshes and superelements are kept; by default the user's.
        origin: Written with it.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        ModelError: The scene has no such component.
        HeadstockError: The reduction or the file failed.
    """
    if not path.absolute().parent.is_dir():
        raise OutputError(f"{path} cannot be written: there is no folder {path.parent}")
    check_output(path)
    plan = plan_scene(scene)
    if component not in plan.components:
        raise ModelError(f"the scene has no component {component!r}; components: {', '.join(plan.components)}")
    state = RunState(scene, plan, comm, store or Store(default_store_root()))
    for stage in plan.stages:
        if stage.component == component:
            HANDLERS[stage.kind](state, stage)
    text = ""
    if state.is_root:
        superelement = state.reduced[component].superelement
        write_superelement(path, superelement, origin)
        text = f"{path}: {component}, {superelement.full_dofs} -> {len(superelement.labels)} dofs"
    return str(share_from_root(comm, text))
