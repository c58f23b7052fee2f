"""The command ``study``: its table, its files, and how it ends."""

import csv
import json
from pathlib import Path

import pytest

from headstock.app.command_line import main

SCENE = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
[components.column]
solid = { box = ["38 mm", "100 mm", "500 mm"] }
material = "steel"
fidelity = "segmented"
[components.column.interfaces]
foot = { face = "z-" }
tip = { face = "z+" }
[joints.clamp]
between = ["ground", "column.foot"]
kind = "rigid"
[points]
tcp = { tool = "column.tip", work = "ground" }
[studies.rows]
vary = { "components.column.segments.count" = [2, 4] }
watch = ["modal.frequencies_hz[0:2]", "seconds"]
repeats = 2
[studies.broken]
vary = { "joints.clamp.kind" = ["rigid", "mount"] }
watch = "status"
[studies.sizes]
vary = { "components.column.mesh.size" = ["40 mm", "20 mm", "10 mm"] }
watch = "totals.mass_kg"
[analyses.static]
[analyses.modal]
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def run_study(path: Path, name: str, *options: str) -> tuple[int, Path]:
    folder = path.parent / name
    return main(["study", str(path), name, "-o", str(folder), *options]), folder


def test_a_study_prints_its_table_and_writes_it_as_csv_json_and_png(scene_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, folder = run_study(
        scene_file, "rows", "--json", str(scene_file.parent / "rows.json"), "--set", "components.column.mass=20 kg"
    )
    printed = " ".join(capsys.readouterr().out.split())
    assert code == 0
    assert "2 of 2 points done" in printed
    assert "median of 2 runs" in printed
    assert "BLAS threads" in printed
    with (folder / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    listing = json.loads((scene_file.parent / "rows.json").read_text())
    assert [float(row["modal.frequencies_hz[1]"]) for row in rows] == [
        row["values"]["modal.frequencies_hz[1]"] for row in listing["rows"]
    ]
    assert [row["components.column.segments.count"] for row in rows] == ["2", "4"]
    assert all(len(row["seconds"]) == 2 for row in listing["rows"])
    assert (folder / "study.png").read_bytes().startswith(b"\x89PNG")


def test_a_mesh_size_that_is_varied_gives_orders_of_convergence(scene_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, folder = run_study(scene_file, "sizes")
    assert code == 0
    assert "Order of convergence" in capsys.readouterr().out
    (series,) = json.loads((folder / "study.json").read_text())["orders"]
    # segments have no mesh: a value that ignores the size is said to
    assert series["order"] is None
    assert "does not depend" in series["remark"]
    assert series["sizes_m"] == pytest.approx([0.04, 0.02, 0.01])


def test_a_bad_value_is_refused_before_anything_is_computed(scene_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, folder = run_study(scene_file, "broken")
    assert code == 2
    assert "mount" in capsys.readouterr().err
    assert not (folder / "points.jsonl").exists()


def test_an_unknown_study_is_refused_with_the_names_there_are(scene_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _ = run_study(scene_file, "row")
    assert code == 2
    assert "did you mean 'rows'?" in capsys.readouterr().err
