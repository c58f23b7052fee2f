"""Meshes, interfaces and poses that may be dropped are written as a variant that runs and moves what
was said; those that matter stay.
"""

import json
import tomllib
from pathlib import Path

import pytest

from common import approx
from fixture_machines import machine
from headstock.app.command_line import main
from headstock.pipeline.numbers.folders import read_run_numbers
from headstock.studies.kind_changes import compare_kinds

pytestmark = pytest.mark.fem

DATA = Path(__file__).resolve().parents[1] / "data"
# a stiff block on soft springs, whose mesh matters little, and a column of few linear elements,
# whose mesh matters much
COLUMN = machine("""
machine = "column"
components.block.mesh = { size = "50 mm", cells = "hex" }
components.block.interfaces = { bottom = { face = "z-", coupling = "average" }, top = { face = "z+", coupling = "average" } }
components.column.fidelity = "elastic"
components.column.mesh = { size = "50 mm", cells = "hex", order = 1 }
analyses.modal = { count = 8 }
""")
# the seam of two halves is as flexible as the plate; a block on soft springs needs no shapes at its
# foot
PLATE = machine("""
machine = "column"
names = { column = "left", bolts = "weld" }
name = "A plate of two halves on a block"
components.block.solid = { box = ["200 mm", "200 mm", "150 mm"] }
components.block.at = ["-100 mm", "0 mm", "0 mm"]
components.block.mesh = { size = "33 mm", cells = "hex" }
components.block.interfaces = { foot = { face = "x-", coupling = { flexible = 60 } }, front = { face = "x+", rect = { size = ["200 mm", "20 mm"] } } }
components.left.solid = { box = ["200 mm", "200 mm", "20 mm"] }
components.left.at = ["100 mm", "0 mm", "65 mm"]
components.left.fidelity = "elastic"
components.left.mesh = { size = "50 mm", cells = "hex" }
components.left.interfaces = { seam = { face = "x+", coupling = { flexible = 12 } }, end = { face = "x-" } }
joints.feet.between = ["block.foot", "ground"]
joints.weld.between = ["left.end", "block.front"]
joints.glue = { between = ["left.seam", "right.seam"], kind = "rigid" }
points.tcp.tool = "right.end"
analyses.modal = { count = 8 }
[components.right]
solid = { box = ["200 mm", "200 mm", "20 mm"] }
material = "steel"
at = ["300 mm", "0 mm", "65 mm"]
fidelity = "elastic"
mesh = { size = "50 mm", cells = "hex" }
interfaces = { seam = { face = "x-", coupling = { flexible = 12 } }, end = { face = "x+" } }
""")
PATH = """
[effects]
damping = { modal = "2 %" }
[analyses.path]
from = { X = "FROM" }
to = { X = "TO" }
feeds = ["FEED"]
time_constant = "100 ms"
lowpass = "300 Hz"
"""


def slide(start: str, end: str, feed: str) -> str:
    move = PATH.replace("FROM", start).replace("TO", end).replace("FEED", feed)
    return (DATA / "slide.toml").read_text() + move


SLOW, FAST = slide("0 mm", "0.1 mm", "10 mm/min"), slide("-100 mm", "150 mm", "12 m/min")


@pytest.mark.parametrize(
    ("text", "kind", "dropped", "kept"),
    [
        (SLOW, "pose", {"analyses.path.pose_model": "frozen"}, {}),
        pytest.param(
            COLUMN,
            "mesh",
            {"components.block.mesh.size": "71.4 mm"},
            {"column": "keep"},
            marks=pytest.mark.trials,
        ),
        pytest.param(
            PLATE,
            "interfaces",
            {"components.block.interfaces.foot.coupling": "rigid"},
            {"left": "keep", "right": "keep"},
            marks=pytest.mark.trials,
        ),
    ],
    ids=["pose", "mesh", "interfaces"],
)
def test_what_is_written_checks_runs_and_moves_what_was_said(
    text: str,
    kind: str,
    dropped: dict[str, str],
    kept: dict[str, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path, told = tmp_path / "scene.toml", tmp_path / "effects.json"
    path.write_text(text)
    assert main(["effects", str(path), "--only", kind, "--write", "--json", str(told)]) == 0
    capsys.readouterr()
    target = tmp_path / "scene_good_enough.toml"
    assert tomllib.loads(target.read_text())["variants"]["good_enough"] == dropped
    findings = json.loads(told.read_text())["models"]
    simpler = {
        each["bodies"][0]: each["action"]
        for each in findings
        if each["bodies"] and each["action"] in ("keep", "drop")
    }
    assert kept.items() <= simpler.items()
    (said,) = [
        each
        for each in findings
        if each["settings"] == [f"{key}={json.dumps(value)}" for key, value in dropped.items()]
    ]
    assert said["action"] == "drop" and said["worth"] > 0.0
    variant = ["--variant", "good_enough"]
    assert main(["check", str(target), *variant]) == 0
    runs = []
    for number, chosen in enumerate((variant, [])):
        folder = tmp_path / str(number)
        assert main(["run", str(target), *chosen, "-o", str(folder), "--no-figures"]) == 0
        runs.append(read_run_numbers(folder).values())
    moved = max(change.share for change in compare_kinds(*runs))
    assert moved == approx(said["worth"], rel=1e-3, abs=1e-9)


def test_a_pose_that_matters_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    path = tmp_path / "scene.toml"
    path.write_text(FAST)
    assert main(["effects", str(path), "--only", "pose", "--write"]) == 0
    told = capsys.readouterr().out
    assert "keep pose_dependent" in told and "no file is written" in told
    assert not (tmp_path / "scene_good_enough.toml").exists()
