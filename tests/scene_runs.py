"""Scenes written into a folder and run there, with a store of their own."""

from pathlib import Path

from mpi4py import MPI

from fixture_machines import write_scene
from headstock.meshing.components.meshing import describe_component
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.pipeline.stages.shared_components import start_run
from headstock.pipeline.storage.store import Store
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene


def run(scene: Scene, folder: Path, into: str = "out") -> Results:
    return run_scene(scene, folder / into, comm=MPI.COMM_SELF, store=Store(folder / "store"))


def compute(
    folder: Path, text: str, *settings: str, name: str = "scene", into: str = "out"
) -> Results:
    return run(load_scene(write_scene(folder, text, name=name), overrides=settings), folder, into)


def start(scene: Scene, folder: Path) -> RunState:
    """A run whose parts, rigid and segmented ones, are reduced and not coupled yet."""
    plan = plan_scene(scene)
    reduced = {
        name: ReducedComponent(
            (reduce_segmented if part.fidelity == "segmented" else reduce_rigid)(
                part, describe_component(part)
            )
        )
        for name, part in plan.components.items()
    }
    return start_run(scene, MPI.COMM_SELF, Store(folder / "store"), plan=plan, reduced=reduced)
