"""Dofs and processor time that ``plan`` foresees, beside those of a run with an empty store.

    ./headstock exec python3 benchmarks/plan.py machines/cantilever.toml machines/three_axis.toml@CE
    ... ./headstock exec python3 benchmarks/plan.py --meshes angle housing elbow bolt_plate bed
    part.step ...

A scene may be followed by ``@`` and a variant. A STEP file, or the name of a part of
``step_parts.py``, is clamped at its lower end (the elbow at its other flange) and carries the tool
at its upper one. ``--meshes`` only meshes: dofs, the time of meshing, and what a user is told of
each mesh.
"""

import resource
import shutil
import sys
import tempfile
from pathlib import Path

from mpi4py import MPI
from step_parts import PARTS, write_part

from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene

SCENE = """name = "part"
materials.iron = { E = "110 GPa", nu = 0.28, rho = "7200 kg/m^3" }
points.tcp = { tool = "part.tip", work = "ground" }
analyses = { static = { at = "tcp" }, modal = { count = 6 } }
[components.part]
solid = { step = "part.step" }
material = "iron"
interfaces = { foot = { face = "FOOT" }, tip = { face = "z+", coupling = "average" } }
[joints.clamp]
between = ["ground", "part.foot"]
kind = "rigid"
"""


FEET = {"elbow": "x-"}


def load_argument(argument: str, folder: Path) -> Scene:
    """A scene, one around a STEP file, or one around a part of ``step_parts.py``."""
    path, _, variant = argument.partition("@")
    if argument not in PARTS and not argument.lower().endswith((".step", ".stp")):
        return load_scene(Path(path), variant=variant or None)
    if argument in PARTS:
        write_part(argument, folder / "part.step")
    else:
        shutil.copyfile(argument, folder / "part.step")
    (folder / "part.toml").write_text(SCENE.replace("FOOT", FEET.get(argument, "z-")))
    return load_scene(folder / "part.toml")


def compare_run(argument: str, folder: Path) -> str:
    """One line: planned over real dofs and seconds of a scene."""
    scene = load_argument(argument, folder)
    plan = plan_scene(scene, survey=True)
    results = run_scene(scene, folder / "out", comm=MPI.COMM_WORLD, store=Store(folder / "store"))
    meshed = [stage for stage in plan.stages if stage.kind == "mesh"]
    dofs = sum(results.components[str(stage.component)].full_dofs for stage in meshed)
    seconds = sum(record.cpu_seconds for record in results.stages)
    expected = sum(stage.estimated_seconds or 0.0 for stage in plan.stages)
    return format_line(
        argument, sum(stage.estimated_dofs or 0 for stage in meshed), dofs, expected, seconds
    )


def compare_meshes(argument: str, folder: Path) -> str:
    """One line: planned over real dofs and seconds of meshing, and lines of what is said of each
    mesh.
    """
    scene = load_argument(argument, folder)
    stages = [stage for stage in plan_scene(scene, survey=True).stages if stage.kind == "mesh"]
    before, dofs = children_seconds(), 0
    said: list[str] = []
    for stage in stages:
        component = scene.machine.components[str(stage.component)]
        mesh = mesh_component(component)
        dofs += mesh.points.size
        quality = mesh.quality
        said += [
            *quality.remarks,
            f"worst scaled Jacobian {quality.minimum_scaled_jacobian:.2g} at {quality.worst_face or 'the inside'}",
        ]
        said[-1] += f", poor elements hold {quality.poor_share:.2g} of the volume"
    seconds = children_seconds() - before
    expected = sum(stage.estimated_seconds or 0.0 for stage in stages)
    line = format_line(
        argument, sum(stage.estimated_dofs or 0 for stage in stages), dofs, expected, seconds
    )
    return "\n    ".join([line, *said])


def children_seconds() -> float:
    """Processor time of all children that ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def format_line(argument: str, planned: int, dofs: int, expected: float, seconds: float) -> str:
    """Planned over real."""
    share = planned / dofs if dofs else 1.0
    return f"{argument:44s} dofs {planned:8d} / {dofs:8d} = {share:5.2f}   CPU s {expected:7.2f} / {seconds:7.2f} = {expected / seconds:5.2f}"


if __name__ == "__main__":
    measure = compare_meshes if "--meshes" in sys.argv else compare_run
    for argument in (argument for argument in sys.argv[1:] if argument != "--meshes"):
        with tempfile.TemporaryDirectory() as folder:
            print(measure(argument, Path(folder)), flush=True)
