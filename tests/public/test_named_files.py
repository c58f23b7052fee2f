"""What a command says it wrote is there, and a file of the wrong kind is called that."""

import re
from pathlib import Path

import pytest

from common import run_alone
from fixture_machines import machine

CANTILEVER = machine("""
machine = "bar"
names = { bar = "part" }
components.part.solid = { box = ["40 mm", "40 mm", "100 mm"] }
components.part.mesh = { size = "40 mm", cells = "hex" }
analyses.static = { at = "tcp" }
""")
UFF = "    -1\n   151\nmodal test\n    -1\n"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(CANTILEVER)
    (tmp_path / "measured.uff").write_text(UFF)
    (tmp_path / "targets.toml").write_text(
        '[cases.a]\ntolerance = "1 %"\nfrequencies = ["60 Hz"]\n[parameters.E]\nkeys = ["materials.steel.E"]\n'
        'bounds = ["100 GPa", "300 GPa"]\n'
    )
    return tmp_path / "scene.toml"


def test_every_file_that_converge_names_is_there(scene: Path) -> None:
    """With few meshes no number has a limit, and nothing is drawn."""
    out = scene.parent / "out"
    words = ["converge", str(scene), "--most-dofs", "1000", "-o", str(out)]
    done = run_alone(scene.parent, *words)
    named = re.search(r"results in .* \((.*)\)", done.stdout.replace("\n", " "))
    assert done.returncode == 0 and named is not None, done.stdout + done.stderr
    names = named[1].split(", ")
    assert "convergence.csv" in names
    assert [name for name in names if not (out / name).is_file()] == []
    assert not (out / "convergence.png").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify", "scene.toml", "measured.uff"], "targets are read from a .toml file"),
        (["identify", "scene.toml", "measured.uff"], "of a UFF file into [cases.NAME]"),
        (["identify", "scene.toml", "scene.toml"], "is a scene, not a target file"),
        (["identify", "targets.toml", "scene.toml"], "headstock identify SCENE TARGETS"),
        (["run", "targets.toml"], "is a target file, not a scene"),
        (["check", "part.step"], "`headstock new FOLDER --part FILE` writes one"),
        (["run", "part.med"], "`headstock new FOLDER --part FILE` writes one"),
        (["report", "scene.toml"], "is a file; name the folder that a run has written"),
    ],
)
def test_a_file_of_the_wrong_kind_is_called_that(scene: Path, words: list[str], said: str) -> None:
    command, *files = words
    done = run_alone(scene.parent, command, *(str(scene.parent / file) for file in files))
    assert done.returncode == 2
    assert said in " ".join((done.stdout + done.stderr).split())
