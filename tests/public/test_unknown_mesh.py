"""A source of error that nobody knows leaves what is known of ±, marked as incomplete everywhere."""

import csv
import html
import json
from pathlib import Path

import pytest

import headstock as hs
from common import approx, call
from fixture_machines import machine, write_scene
from headstock.app.command_line import main

BAR = machine("""
machine = "bar"
names = { tcp = "tip" }
materials.steel.E = "200 GPa"
materials.steel.rho = "8000 kg/m^3"
components.bar.solid = { box = ["400 mm", "20 mm", "20 mm"] }
components.bar.mesh = { size = "20 mm", cells = "hex" }
components.bar.interfaces = { foot = { face = "x-" }, tip = { face = "x+" } }
joints.clamp.between = ["bar.foot", "ground"]
analyses.modal = { count = 2 }
[studies.modes]
vary = { "components.bar.reduction.modes" = [0, 1, 2, 3] }
watch = ["modal.frequencies_hz[0]", "modal.error_hz[0]"]
""")
COLUMN = "modal.error_hz[0]"


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = write_scene(tmp_path, BAR, name="bar")
    return path


def test_a_study_shows_the_known_part_of_every_error_and_what_it_lacks(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    printed = " ".join(call(capsys, ["study", str(scene), "modes", "-o", str(out)]).out.split())
    with (out / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    known = [float(row[f"{COLUMN} without unknown sources"]) for row in rows]
    assert len(known) == 4 and min(known) > 0.0
    # the more modes are kept the less the reduction leaves out, and no bound is claimed
    assert known[0] > known[1] >= known[2] > known[3]
    assert [row[COLUMN] for row in rows] == [""] * 4
    found = [float(row["modal.frequencies_hz[0]"]) for row in rows]
    # what is known is the reduction's: it covers the distance to the most modes
    for hz, error in zip(found, known, strict=True):
        assert 0.0 <= hz - found[-1] <= error
    assert printed.count(" + ?") >= 4 and "+ ? : not in error_hz: discretisation" in printed
    assert "the mesh of bar" in printed
    listed = json.loads((out / "study.json").read_text())
    assert [row["known"][COLUMN] for row in listed["rows"]] == known


def test_a_study_in_python_has_the_known_part_in_a_column_of_its_own(scene: Path) -> None:
    table = hs.study(scene, vary={"components.bar.reduction.modes": [0, 1]}, watch=[COLUMN])
    assert all(row.values[COLUMN] is None and row.known[COLUMN] > 0.0 for row in table.rows)
    assert all("discretisation" in " ".join(row.unknown) for row in table.rows)


def test_a_run_marks_an_error_with_an_unknown_source_wherever_it_shows_it(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(scene), "--no-figures", "-o", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert " + ? bar bends" in printed and "± .. + ? : parts take part" in printed
    # nothing covers 95 % of errors here
    assert "covers 95 %" not in printed and "known of ±, not all: reduction up to" in printed
    page = html.unescape((out / "report.html").read_text())
    assert " + ?</span>" in page and "known of ±, not all: reduction up to" in page
    modes = json.loads((out / "summary.json").read_text())["modal"][0]
    assert modes["error_hz"] == [None, None]
    assert all(share["discretisation"] is None for share in modes["error_share"])
    with next((out / "tables").glob("modes_*.csv")).open() as file:
        row = next(csv.DictReader(file))
    assert row["± [Hz]"] == "" and float(row["± known, unknown sources apart [Hz]"]) > 0.0
    results = hs.open(out)
    assert " + ?" in results._repr_html_()
    known = results.modal[0].list_errors()[0].known
    assert known == approx(modes["error_share"][0]["reduction"])


def test_an_error_of_known_sources_is_shown_as_before(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(BAR.replace('20 mm", cells', '10 mm", cells'))
    out = tmp_path / "out"
    printed = call(capsys, ["run", str(scene), "--no-figures", "-o", str(out)]).out
    assert "+ ?" not in printed and "± covers 95 % of errors" in printed
    with next((out / "tables").glob("modes_*.csv")).open() as file:
        assert "± known, unknown sources apart [Hz]" not in next(csv.reader(file))


def test_a_comparison_marks_the_variant_whose_mesh_is_unknown(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(BAR + '[variants.fine]\n"components.bar.mesh.size" = "10 mm"\n')
    out = tmp_path / "out"
    printed = " ".join(call(capsys, ["compare", str(scene), "-o", str(out)]).out.split())
    assert printed.count(" + ?") >= 2
    assert "as written: known of ±, not all: reduction" in printed
    assert "fine: ± covers 95 % of errors, from" in printed
    assert " + ?" in html.unescape((out / "compare.html").read_text())
