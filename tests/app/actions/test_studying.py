"""The command ``study``: its table, its files, and how it ends."""

import csv
import json
from pathlib import Path

import pytest

from common import approx
from headstock.app.command_line import main

COLUMN = Path(__file__).resolve().parents[2] / "data" / "segmented_column.toml"
SCENE = (
    COLUMN.read_text()
    + """
[studies.rows]
vary = { "components.column.segments.count" = [2, 4] }
watch = ["modal.frequencies_hz[0:2]", "seconds"]
repeats = 2
[studies.broken]
vary = { "joints.clamp.kind" = ["rigid", "mount"] }
watch = "status"
[studies.cost]
reference_run = { "components.column.segments.count" = 40 }
vary = { "components.column.segments.count" = [2, 4, 8] }
watch = ["modal.frequencies_hz[0:2]"]
store = "cold"
[studies.sizes]
vary = { "components.column.mesh.size" = ["40 mm", "20 mm", "10 mm"] }
watch = "totals.mass_kg"
[analyses.static]
[analyses.modal]
"""
)
REFINEMENT = """
[studies.refinement]
reference = "kono-cantilever"
[studies.refinement.families.static_segmented]
analyses = "static"
set = { "components.column.fidelity" = "segmented" }
vary = { "components.column.segments.count" = [5, 15] }
[studies.refinement.families.modal_segmented]
analyses = "modal"
set = { "components.column.fidelity" = "segmented" }
vary = { "components.column.segments.count" = [10, 35] }
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def run_study(path: Path, name: str, *options: str) -> tuple[int, Path]:
    folder = path.parent / name
    return main(["study", str(path), name, "-o", str(folder), *options]), folder


def test_a_study_prints_its_table_and_writes_it_as_csv_json_and_png(
    scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, folder = run_study(
        scene_file,
        "rows",
        "--json",
        str(scene_file.parent / "rows.json"),
        "--set",
        "components.column.mass=20 kg",
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


def test_a_mesh_size_that_is_varied_gives_orders_of_convergence(
    scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, folder = run_study(scene_file, "sizes")
    assert code == 0
    assert "Order of convergence" in capsys.readouterr().out
    (series,) = json.loads((folder / "study.json").read_text())["orders"]
    # segments have no mesh: a value that ignores the size is said to
    assert series["order"] is None
    assert "does not depend" in series["remark"]
    assert series["sizes_m"] == approx([0.04, 0.02, 0.01])
    with (folder / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["components.column.mesh.size [m]"]) for row in rows] == [0.04, 0.02, 0.01]


def test_a_bad_value_is_refused_before_anything_is_computed(
    scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, folder = run_study(scene_file, "broken")
    assert code == 2
    assert "mount" in capsys.readouterr().err
    assert not (folder / "points.jsonl").exists()


def test_an_unknown_study_is_refused_with_the_names_there_are(
    scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _ = run_study(scene_file, "row")
    assert code == 2
    assert "did you mean 'rows'?" in capsys.readouterr().err


def test_a_refinement_study_draws_the_paper_s_figures_and_lists_its_claims(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cantilever.toml"
    shipped = (Path(__file__).resolve().parents[3] / "machines" / "cantilever.toml").read_text()
    path.write_text(shipped[: shipped.index("# the paper's section")] + REFINEMENT)
    code, folder = run_study(path, "refinement", "--json", str(tmp_path / "refinement.json"))
    assert code == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "every deviation < 10 % from nDOF 30 dy(Fy) +3.06 %" in printed
    drawn = {file.stem for file in folder.glob("*.png")}
    # of the finite elements there are only the paper's own, which have no time
    assert drawn == {
        "figure_06_ndof",
        "figure_06_time",
        "figure_07_ndof",
        "figure_08_ndof",
        "figure_08_time",
        "figure_09_ndof",
        "overview",
    }
    with (folder / "refinement.csv").open() as file:
        rows = list(csv.DictReader(file))
    (row,) = [
        row
        for row in rows
        if (row["model"], row["nDOF"], row["quantity"]) == ("segmented", "30", "dx(Fx)")
    ]
    assert float(row["deviation"]) == approx(435.8276 / 433.91 - 1.0, abs=1e-4)
    claims = json.loads((tmp_path / "refinement.json").read_text())["claims"]
    assert {claim["figure"] for claim in claims} == {6, 7, 8, 9}
    with (folder / "claims.csv").open() as file:
        assert [row["verdict"] for row in csv.DictReader(file)][: len(claims)] == [
            "confirmed" if c["confirmed"] else "not confirmed" for c in claims
        ]


def test_a_study_with_a_truth_shows_what_accuracy_costs(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", str(scene_file), "cost", "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "What accuracy costs" in printed and "of processor time" in printed
    rows = list(csv.DictReader((tmp_path / "out" / "cost.csv").read_text().splitlines()))
    errors = [float(row["error"]) for row in rows]
    assert errors == sorted(errors, reverse=True) and errors[-1] > 0.0
    assert (
        json.loads((tmp_path / "out" / "study.json").read_text())["costs"][0]["settings"]
        == "column.segments.count = 2"
    )
    assert (tmp_path / "out" / "cost.png").stat().st_size > 10_000
