"""Scenes written into a folder and run there, with a store of their own."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fixture_machines import write_scene
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component
from headstock.meshing.components.meshing import describe_component
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.pipeline.stages.shared_components import start_run
from headstock.pipeline.storage.store import Store
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene


def run(scene: Scene, folder: Path, into: str = "out") -> Results:
    return run_scene(scene, folder / into, comm=MPI.COMM_SELF, store=Store(folder / "store"))


def compute(
    folder: Path, text: str, *settings: str, name: str = "scene", into: str = "out"
) -> Results:
    return run(load_scene(write_scene(folder, text, name=name), overrides=settings), folder, into)


def reduce_parts(components: Mapping[str, Component]) -> dict[str, Superelement]:
    """Components that are rigid or of segments."""
    return {
        name: (reduce_segmented if part.fidelity == "segmented" else reduce_rigid)(
            part, describe_component(part)
        )
        for name, part in components.items()
    }


def couple_parts(machine: Machine, pose: Pose, **options: Any) -> CoupledMachine:
    return couple(reduce_parts(machine.components), machine, pose, **options)


def start(scene: Scene, folder: Path) -> RunState:
    """A run whose parts, rigid and segmented ones, are reduced and not coupled yet."""
    plan = plan_scene(scene)
    parts = reduce_parts(plan.components)
    reduced = {name: ReducedComponent(part) for name, part in parts.items()}
    return start_run(scene, MPI.COMM_SELF, Store(folder / "store"), plan=plan, reduced=reduced)
