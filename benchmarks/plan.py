"""Dofs and processor time that ``plan`` foresees, beside those of a run with an empty store.

    ./headstock exec python3 benchmarks/plan.py machines/cantilever.toml machines/three_axis.toml@CE ...

A scene may be followed by ``@`` and a variant.
"""

import sys
import tempfile
from pathlib import Path

from mpi4py import MPI

from headstock.pipeline.planner import plan_scene
from headstock.pipeline.runner import run_scene
from headstock.pipeline.scene_loader import load_scene
from headstock.pipeline.store import Store


def compare(argument: str) -> str:
    """One line: planned over real dofs and seconds of a scene."""
    path, _, variant = argument.partition("@")
    scene = load_scene(Path(path), variant=variant or None)
    plan = plan_scene(scene, survey=True)
    with tempfile.TemporaryDirectory() as folder:
        results = run_scene(scene, Path(folder) / "out", comm=MPI.COMM_WORLD, store=Store(Path(folder) / "store"))
    meshed = [stage for stage in plan.stages if stage.kind == "mesh"]
    dofs = sum(results.components[str(stage.component)].full_dofs for stage in meshed)
    planned = sum(stage.estimated_dofs or 0 for stage in meshed)
    seconds = sum(record.cpu_seconds for record in results.stages)
    expected = sum(stage.estimated_seconds or 0.0 for stage in plan.stages)
    share = planned / dofs if dofs else 1.0
    return f"{argument:44s} dofs {planned:8d} / {dofs:8d} = {share:5.2f}   CPU s {expected:7.2f} / {seconds:7.2f} = {expected / seconds:5.2f}"


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        print(compare(argument), flush=True)
