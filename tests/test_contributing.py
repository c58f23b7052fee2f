"""CONTRIBUTING.md names the files of an extension: those of a patch that adds an analysis, and
those that name what there is already.
"""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import h5py
import pytest

from common import approx, read_json, run_in, run_process

ROOT = Path(__file__).resolve().parent.parent
PATCH = ROOT / "tests" / "data" / "adding_an_analysis.patch"
LAYERS = sorted(
    link.name for link in (ROOT / ".typing" / "headstock").iterdir() if (ROOT / link.name).is_dir()
)


def files_in(title: str) -> set[str]:
    """Files that a section of CONTRIBUTING.md names; a name without folders lies in the folder of
    the one before it.
    """
    text = (ROOT / "CONTRIBUTING.md").read_text()
    section = text.partition(f"## Adding {title}\n")[2].partition("\n## ")[0]
    found, folder = set(), ""
    for name in re.findall(r"`((?:\w+/)*\w+\.(?:py|html))`", section):
        folder = name.rpartition("/")[0] or folder
        found.add(name if "/" in name else f"{folder}/{name}")
    return found


def files_with(*patterns: str) -> set[str]:
    """Modules that hold all of some patterns; validation uses what there is and is not extended
    with it.
    """
    layers = [ROOT / layer for layer in LAYERS if layer != "validation"]
    texts = {path: path.read_text() for layer in layers for path in layer.rglob("*.py")}
    return {
        path.relative_to(ROOT).as_posix()
        for path, text in texts.items()
        if all(re.search(pattern, text) for pattern in patterns)
    }


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree with the patch."""
    copy = tmp_path_factory.mktemp("extended")
    for name in (".typing", "machines", "tests", "api", *LAYERS):
        shutil.copytree(ROOT / name, copy / name, symlinks=True)
    shutil.copy(ROOT / "pyproject.toml", copy)
    # a repository around the copy would take the paths for its own
    variables = os.environ | {"GIT_CEILING_DIRECTORIES": str(copy.parent)}
    done = run_process(["git", "apply", "--unidiff-zero", str(PATCH)], cwd=copy, env=variables)
    assert done.returncode == 0, f"tests/data/README.md says how to mend the patch:\n{done.stderr}"
    return copy


def run_copy(copy: Path, command: str) -> str:
    words = [sys.executable, "-P", "-m", *shlex.split(command)]
    return run_in(copy, *words, PYTHONPATH=str(copy / ".typing"))


def test_the_list_of_files_of_a_new_analysis_is_that_of_a_patch_that_adds_one() -> None:
    changed = set(re.findall(r"^\+\+\+ b/(.+)$", PATCH.read_text(), re.MULTILINE))
    assert changed == {
        name.replace("NAME", "mass").replace("ROOM", "linear") for name in files_in("an analysis")
    }


def test_a_shipped_scene_runs_with_the_analysis_of_the_patch(extended: Path) -> None:
    line = "run machines/three_axis.toml --variant segmented -o out --no-figures"
    shown = run_copy(extended, f"headstock.app.command_line {line} --set analyses={{mass={{}}}}")
    summary = read_json(extended / "out" / "summary.json")
    found = summary["mass"]["reference"]
    assert found["mass_kg"] == approx(summary["totals"]["mass_kg"], rel=1e-12)
    assert found["mass_kg"] > 100.0
    with h5py.File(extended / "out" / "results.h5") as file:
        assert file["mass/reference/center"][:].tolist() == found["center_m"]
        assert file["mass/reference/center"].attrs["unit"] == "m"
    assert "Mass and centre of gravity" in shown and f"{found['mass_kg']:.6g}" in shown
    number = repr(found["mass_kg"])
    assert number in (extended / "out" / "tables" / "mass.csv").read_text()
    page = (extended / "out" / "report.html").read_text()
    assert f'value="{number}"' in page.partition('id="mass-table"')[2]


def test_the_patched_tree_keeps_its_layers_and_passes_the_tests_of_the_patch(
    extended: Path,
) -> None:
    tests = "tests/solvers/linear/test_mass.py tests/pipeline/stages/test_mass.py"
    plain = "-q -p no:cacheprovider -p no:xdist -k 'mass or imports_or_names or glance'"
    assert " passed" in run_copy(extended, f"pytest {plain} {tests} tests/test_layering.py")


@pytest.mark.parametrize(("title", "patterns"), [
    ("a joint kind", ('"prismatic"',)),
    ("a solid", (r"\bPlate\b", r"\bTube\b", r"\bHollowColumn\b")),
    ("an effect", ('"screw_inertia"',)),
])  # fmt: skip
def test_the_list_of_an_extension_has_every_file_that_names_what_there_is(
    title: str, patterns: tuple[str, ...]
) -> None:
    names = files_with(*patterns)
    assert names and names - files_in(title) == set()
