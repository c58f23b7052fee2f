"""The examples that a user copies run as they are, on coarse or rigid variants of their machines."""

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import pyvista

import headstock as hs
from common import place_launcher, run_in

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
# in place of ParaView: reads what the example opens, and refuses arrays that are not there
PARAVIEW = """
import pathlib, re, xml.etree.ElementTree as tree
import pyvista

class Anything:
    def __getattr__(self, name):
        return lambda *given, **named: None

def OpenDataFile(path):
    files = [part.get("file") for part in tree.parse(path).iter("DataSet")]
    source = Anything()
    source.mesh = pyvista.read(pathlib.Path(path).parent / files[0])
    return source

def WarpByVector(Input, Vectors, ScaleFactor):
    Anything.moved = Input.mesh.warp_by_vector(Vectors[1], factor=ScaleFactor)
    return Anything()

def SaveScreenshot(path, view):
    Anything.moved.save(pathlib.Path(path).with_suffix(".vtu"))

def __getattr__(name):
    return getattr(Anything(), name)
"""
Run = Callable[..., str]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Run a program in a folder that has the launcher, machines and copies of the examples."""
    (tmp_path / "machines").symlink_to(ROOT / "machines")
    (tmp_path / "examples").mkdir()
    for file in EXAMPLES.iterdir():
        (tmp_path / "examples" / file.name).write_text(file.read_text())
    return functools.partial(run_in, place_launcher(tmp_path))


def test_every_example_is_on_the_page_of_examples_and_there_are_six() -> None:
    page = (ROOT / "docs" / "examples.md").read_text()
    names = sorted(path.name for path in EXAMPLES.iterdir())
    assert len(names) == 6
    assert [name for name in names if f'--8<-- "examples/{name}"' not in page] == []


def test_a_part_of_your_own(run: Run) -> None:
    printed = run(sys.executable, "-P", "examples/own_part.py")
    assert "N/um" in printed and "bracket" in printed


def test_a_machine_in_sixty_lines_and_a_study_of_it_with_a_plot(run: Run, tmp_path: Path) -> None:
    scene = tmp_path / "examples" / "own_machine.toml"
    assert len(scene.read_text().splitlines()) <= 60
    assert ": ok: Table on a bed" in run("./headstock", "check", "examples/own_machine.toml")
    scene.write_text(scene.read_text().replace('size = "35 mm"', 'size = "90 mm"'))
    run(sys.executable, "-P", "examples/study_plot.py")
    assert (tmp_path / "walls.png").stat().st_size > 5000


def test_lobes_of_the_mill(run: Run) -> None:
    printed = run(sys.executable, "-P", "examples/mill_lobes.py", "rigid")
    assert printed.startswith("lowest limit")
    assert printed.count(" rpm  ") == 13


def test_a_task_of_a_batch(run: Run, tmp_path: Path) -> None:
    run("sh", "examples/batch.sh", SLURM_ARRAY_TASK_ID="3")
    assert (tmp_path / "results" / "mill_rigid" / "summary.json").is_file()


def test_results_in_paraview(run: Run, tmp_path: Path) -> None:
    (tmp_path / "paraview").mkdir()
    (tmp_path / "paraview" / "__init__.py").touch()
    (tmp_path / "paraview" / "simple.py").write_text(PARAVIEW)
    run("./headstock", "run", "machines/cantilever.toml", "-o", "results/c", "--no-figures",
        "--set", "components.column.fidelity=segmented")  # fmt: skip
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    run(sys.executable, "-P", "examples/in_paraview.py", "results/c", PYTHONPATH=paths)
    assert pyvista.read(tmp_path / "results" / "c" / "mode_01.vtu").n_points > 0


@pytest.mark.parametrize(
    ("left_out", "told"),
    [('length = "80 mm"\n', 'write length = "80 mm"'), ('normal = "z"\n', 'normal = "z"')],
)
def test_a_carriage_that_lacks_a_key_is_told_so_and_its_rail_is_not_blamed(
    left_out: str, told: str, tmp_path: Path
) -> None:
    scene = tmp_path / "machine.toml"
    scene.write_text((EXAMPLES / "own_machine.toml").read_text().replace(left_out, ""))
    with pytest.raises(hs.SceneError) as refused:
        hs.load(scene)
    problems = refused.value.problems
    assert told in problems[0].message
    assert not [problem for problem in problems if "control_points" in problem.message]
