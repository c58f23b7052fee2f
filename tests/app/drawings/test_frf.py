"""Frequency responses in the report, as tables and as charts."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from PIL import Image

from common import Shell, approx, present, read_units, run_once
from fixture_machines import stored_scene
from headstock.app.charts.results import _draw_responses
from headstock.app.drawings.frf import draw_response
from headstock.app.report.report import render_report
from headstock.app.tables.frf import tabulate_response
from headstock.app.tables.table import encode_csv
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import open_results
from headstock.solvers.second_order import ComplexArray

CHANNELS = (("tcp", "x"), ("<b>", "rx"))
SCENE = stored_scene("frf")


def curves_with_a_gap() -> ResponseCurves:
    frequencies = np.linspace(0.0, 100.0, 11, dtype=np.float64)
    values: ComplexArray = 1e-6 * np.exp(-0.1j * frequencies)[:, None, None] * np.ones((1, 2, 2))
    values[0], values[5] = 1e-6, np.nan
    return ResponseCurves("reference", CHANNELS, CHANNELS, frequencies, values)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_once(tmp_path_factory.mktemp("frf"), SCENE)


def test_summary_table_and_file_hold_the_same_response(run_folder: Path) -> None:
    summary = read_summary(run_folder)
    curves = open_results(run_folder).frf["reference"].curves
    response = summary["frf"]["reference"]
    assert response["method"] == "poles" and response["damped"]
    assert response["outputs"] == [["tcp", "x"], ["tcp", "y"], ["tcp", "z"], ["head.seat", "rx"]]
    points = response["drive_points"]
    assert [point["dof"] for point in points] == response["inputs"] == [["tcp", d] for d in "xyz"]
    with (run_folder / "tables" / "frf_reference.csv").open(newline="") as file:
        _, *rows = csv.reader(file)
    assert len(rows) == len(curves.frequencies_hz) == response["points"]
    direct = curves.receptance[:, [0, 1], [0, 1]]
    np.testing.assert_array_equal(np.array(rows, dtype=float)[:, 1], direct[:, 0].real)
    assert 1e9 * direct[0, 0].real == approx(points[0]["static_um_per_kN"], rel=1e-12)
    softest = 1e-6 / np.abs(direct[:, 1]).max()
    assert points[1]["minimum_dynamic_stiffness_N_per_um"] == approx(softest, rel=1e-4)


def test_the_report_is_written_again_from_the_files_alone(run_folder: Path) -> None:
    html = (run_folder / "report.html").read_text()
    found = open_results(run_folder)
    # the mark of a run is not in its results
    assert render_report(found) == re.sub(r'content="[0-9a-f]{64}"', 'content=""', html)
    assert html.count('class="response"') == 1 and "response-data" in html


def test_every_array_of_the_results_says_its_unit(run_folder: Path) -> None:
    units = read_units(run_folder / "results.h5")
    assert len(units) > 10
    assert [name for name, unit in units.items() if unit is None] == []


def test_the_numbers_behind_the_cursor_are_the_curves(run_folder: Path) -> None:
    html = (run_folder / "report.html").read_text()
    script = re.search(r'class="response-data"[^>]*>(.*?)</script>', html, re.DOTALL)
    data = json.loads(present(script)[1])
    curves = open_results(run_folder).frf["reference"].curves
    assert len(data["cells"]) == 12
    np.testing.assert_allclose(data["hz"], curves.frequencies_hz, rtol=1e-3)
    sizes = 1e9 * np.abs(curves.receptance[:, 1, 1])
    np.testing.assert_allclose(data["cells"][4]["size"], sizes, rtol=1e-3)


def test_a_gap_is_a_gap_in_curve_table_and_data() -> None:
    curves = curves_with_a_gap()
    drawn = str(draw_response(curves, "frf"))
    paths = re.findall(r'<path d="([^"]*)"', drawn)
    assert paths[0].count("M") == 2
    data = json.loads(present(re.search(r">(\{.*\})</script>", drawn))[1])
    assert data["cells"][0]["size"][5] is None
    rows = list(csv.reader(io.StringIO(encode_csv(tabulate_response(curves)).decode())))
    assert rows[6][1:] == [""] * 8
    assert "<b>" not in drawn and "&lt;b&gt;" in drawn


def test_every_pose_has_a_chart_with_something_in_it() -> None:
    (image,) = _draw_responses([curves_with_a_gap()]).values()
    pixels = np.asarray(Image.open(io.BytesIO(image)))
    assert pixels.shape[2] == 4 and len(np.unique(pixels.reshape(-1, 4), axis=0)) > 20


def test_a_machine_goes_into_a_mat_file_and_modes_above_stay_in_it_statically(
    shell: Shell, run_folder: Path
) -> None:
    shell.write(SCENE)
    shell("export scene.toml --state-space '150 Hz' -o m.mat")
    read = scipy.io.loadmat("m.mat")
    assert read["A"].shape[0] < 24 and read["D"].shape == (4, 3)
    static = read["D"] - read["C"] @ np.linalg.solve(read["A"], read["B"])
    (curves,) = (read.curves for read in open_results(run_folder).frf.values())
    rounding = 1e-8 * np.abs(static).max()
    np.testing.assert_allclose(static, curves.receptance[0].real, rtol=1e-8, atol=rounding)


@pytest.mark.parametrize("words", ["", "base --state-space '5 Hz'", "--state-space '5 kg'"])
def test_an_export_of_nothing_or_of_two_things_is_refused(shell: Shell, words: str) -> None:
    shell.write(SCENE)
    assert shell(f"export scene.toml {words}", code=2).err
