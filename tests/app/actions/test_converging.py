"""The command ``converge``: what it says of a part or a machine, and how it ends."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from common import call
from fixture_machines import machine, write_scene
from headstock.app.command_line import main
from headstock.studies.parameters.records import POINTS_FILE

DATA = Path(__file__).resolve().parents[2] / "data"
SCENE = machine("""
machine = "bar"
names = { bar = "part" }
name = "cantilever"
components.part.mesh = { size = "20 mm" }
analyses.static = { at = "tcp" }
analyses.modal = { count = 5 }
""")

ARM = """
[components.arm]
solid = { box = ["30 mm", "30 mm", "150 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "200 mm"]
mesh = { size = "15 mm", cells = "hex" }
[components.arm.interfaces]
root = { face = "z-" }
tip = { face = "z+", coupling = "average" }
[joints.flange]
between = ["part.tip", "arm.root"]
kind = "spring"
stiffness = { x = "80 N/um", y = "80 N/um", z = "200 N/um", rx = "200 kN m/rad", ry = "200 kN m/rad", rz = "100 kN m/rad" }
[joints.clamp]"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = write_scene(tmp_path, SCENE)
    return path


def converge(path: Path, folder: Path, *options: str) -> dict[str, Any]:
    assert main(["converge", str(path), "-o", str(folder), *options]) == 0
    listing: dict[str, Any] = json.loads((folder / "convergence.json").read_text())
    return listing


def frequencies(path: Path, folder: Path, size: str, *settings: str) -> list[float]:
    words = ["run", str(path), "-o", str(folder), "--set", f"components.part.mesh.size={size}"]
    assert main([*words, *settings]) == 0
    summary = json.loads((folder / "summary.json").read_text())
    return [float(hz) for hz in summary["modal"][0]["frequencies_hz"]]


@pytest.mark.trials
@pytest.mark.slow
def test_limits_cover_a_fine_mesh_of_another_kind_and_the_needed_mesh_is_as_good_as_asked(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = converge(scene_file, tmp_path / "out")
    printed = capsys.readouterr().out
    assert found["text"] in " ".join(printed.split())
    assert "every number is known well enough" in printed
    # hexes of a fifth of the width: a square section, whose bending modes come in pairs
    finest = frequencies(
        scene_file, tmp_path / "fine", "6.67 mm", "--set", "components.part.mesh.cells=hex"
    )
    numbers = {number["name"]: number for number in found["numbers"]}
    for place, hz in enumerate(finest):
        number = numbers[f"f{place + 1}"]
        assert number["limit_error"] is not None
        # the hexes are themselves too stiff by a little
        assert abs(number["limit"] - hz) <= number["limit_error"] + 1e-3 * hz
    need = found["needs"][0]
    assert need["accuracy"] == 0.01
    tried = frequencies(scene_file, tmp_path / "tried", need["sizes"]["part"])
    assert max(abs(a / b - 1.0) for a, b in zip(tried, finest, strict=True)) <= 0.013


@pytest.mark.trials
def test_meshes_of_several_parts_shrink_together_and_limits_cover_a_finer_mesh(
    scene_file: Path, tmp_path: Path
) -> None:
    scene_file.write_text(SCENE.replace("part.tip", "arm.tip").replace("[joints.clamp]", ARM))
    found = converge(scene_file, tmp_path / "out", "--most-dofs", "8000")
    sizes = [mesh["sizes"] for mesh in found["meshes"]]
    assert sizes[0] == {"part": "40 mm", "arm": "30 mm"}
    assert sizes[-1] == {"part": "14.1 mm", "arm": "10.6 mm"}
    assert set(found["needs"][0]["sizes"]) == {"part", "arm"}
    fine = ("--set", "components.arm.mesh.size=7.5 mm")
    finest = frequencies(scene_file, tmp_path / "fine", "10 mm", *fine)
    numbers = {number["name"]: number for number in found["numbers"]}
    for place, hz in enumerate(finest):
        number = numbers[f"f{place + 1}"]
        assert number["limit_error"] is not None
        assert abs(number["limit"] - hz) <= number["limit_error"] + 1e-3 * hz


def test_a_first_mesh_above_the_most_dofs_is_refused_before_anything_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["converge", str(DATA / "support.step"), "-o", str(tmp_path / "out")]
    said = " ".join(call(capsys, [*words, "--most-dofs", "5000"], 2).err.split())
    assert "(part 5.14 mm) would have about 37 000 dofs" in said
    assert "--most-dofs is 5000" in said and "write larger sizes" in said
    assert not (tmp_path / "out" / POINTS_FILE).exists()


@pytest.mark.trials
def test_memory_that_the_next_mesh_has_not_ends_the_series_with_what_was_found(
    scene_file: Path, tmp_path: Path
) -> None:
    limit = ("--set", "limits.memory=200 MB", "--set", "components.part.mesh.size=10 mm")
    found = converge(scene_file, tmp_path / "out", *limit)
    assert found["meshes"]
    assert "the next mesh does not fit: BudgetError" in found["end"]
    assert "limits.memory allows 200 MB" in found["end"]
    assert len(found["numbers"]) == 8


def test_a_second_call_computes_nothing_again_and_files_hold_what_is_printed(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--most-dofs", "3000")
    first = converge(scene_file, tmp_path / "out", *options)
    lines = (tmp_path / "out" / POINTS_FILE).read_text()
    capsys.readouterr()
    again = converge(scene_file, tmp_path / "out", *options, "--json", str(tmp_path / "a.json"))
    printed = capsys.readouterr().out
    assert printed.count("finished before") == len(first["meshes"])
    assert (tmp_path / "out" / POINTS_FILE).read_text() == lines
    assert again["numbers"] == first["numbers"]
    assert "--most-dofs is 3000" in again["end"]
    assert json.loads((tmp_path / "a.json").read_text())["text"] == again["text"]
    pattern = ("--watch", "compliance(*point=tcp,direction=x)")
    chosen = converge(scene_file, tmp_path / "out", *options, *pattern)["numbers"]
    assert chosen == [number for number in first["numbers"] if number["name"] == "tcp x"] != []
    converge(scene_file, tmp_path / "out", *options)
    with (tmp_path / "out" / "convergence.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["dofs"]) for row in rows[:-1]] == [mesh["dofs"] for mesh in first["meshes"]]
    assert float(rows[-1]["f1 [Hz]"]) == first["numbers"][0]["limit"]
    # a looser limit goes on from there
    more = converge(scene_file, tmp_path / "out", "--most-dofs", "6000")
    assert more["meshes"][: len(first["meshes"])] == first["meshes"]
    assert len(more["meshes"]) > len(first["meshes"])


@pytest.mark.trials
def test_a_step_part_is_tried_free_and_without_its_small_features(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = converge(DATA / "support.step", tmp_path / "out", "--free", "--most-dofs", "60000")
    assert "free = true" in (tmp_path / "out" / "support.toml").read_text()
    assert [number["name"] for number in found["numbers"]] == [f"f{n}" for n in range(1, 7)]
    assert {mesh["sizes"]["part"] for mesh in found["meshes"]} >= {"5.14 mm"}
    assert all(trial["dofs"] < trial["dofs_with"] for trial in found["features"])
    printed = capsys.readouterr().out
    assert ("fillets and holes up to" in printed) == bool(found["features"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--set", "components.part.fidelity=rigid"], "part is rigid; try --set components.part"),
        (["--set", "accuracy=1 %"], "take that line out"),
        (["--free"], "go with a STEP file"),
        (["--accuracy", "200%"], "no share"),
    ],
)
def test_what_cannot_be_refined_is_refused_with_a_remedy(
    scene_file: Path,
    tmp_path: Path,
    options: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["converge", str(scene_file), "-o", str(tmp_path / "out"), *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out" / POINTS_FILE).exists()


@pytest.mark.parametrize("name", ["none.step", "part.step"])
def test_a_file_that_is_no_part_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / "part.step").write_text("no part")
    assert main(["converge", str(tmp_path / name), "-o", str(tmp_path / "out")]) == 2
    assert name in capsys.readouterr().err


def test_a_scene_without_anything_to_watch_says_what_to_write(
    scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene_file.write_text(SCENE[: SCENE.index("[analyses.static]")])
    assert "[analyses.modal] with count = 6" in call(capsys, ["converge", str(scene_file)], 2).err
