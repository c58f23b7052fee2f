"""Frequency responses in the report, as tables and as charts."""

import csv
import io
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from PIL import Image

from common import approx, present
from headstock.app.charts.results import _draw_responses
from headstock.app.command_line import main
from headstock.app.drawings.frf import draw_response
from headstock.app.report.report import render_report
from headstock.app.tables.frf import tabulate_response
from headstock.app.tables.table import encode_csv
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.numbers.folders import read_summary
from headstock.pipeline.results.files import open_results
from headstock.solvers.second_order import ComplexArray

CHANNELS = (("tcp", "x"), ("<b>", "rx"))
SCENE = """
name = "Two bodies"
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
loss_factor = 0.002
[components.base]
solid = { box = ["400 mm", "400 mm", "200 mm"] }
material = "steel"
fidelity = "rigid"
[components.base.interfaces]
low = { face = "z-" }
top = { face = "z+" }
[components.head]
solid = { box = ["100 mm", "100 mm", "150 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "200 mm"]
fidelity = "rigid"
[components.head.interfaces]
seat = { face = "z-" }
tool = { face = "z+" }
[joints.mounts]
between = ["ground", "base.low"]
kind = "mount"
stiffness = { horizontal = "10 N/um", vertical = "20 N/um", tilt = "1 kN m/mrad", torsion = "1 kN m/mrad" }
loss_factor = "4 %"
[joints.guide]
between = ["base.top", "head.seat"]
kind = "spring"
stiffness = { x = "80 N/um", y = "90 N/um", z = "200 N/um", rx = "0.5 kN m/mrad", ry = "0.5 kN m/mrad", rz = "0.5 kN m/mrad" }
damping = { x = "2000 N s/m" }
[points]
tcp = { tool = "head.tool", work = "ground" }
[effects]
damping = true
[analyses.frf]
up_to = "400 Hz"
points = 201
outputs = ["tcp", ["head.seat", "rx"]]
"""


def curves_with_a_gap() -> ResponseCurves:
    frequencies = np.linspace(0.0, 100.0, 11, dtype=np.float64)
    values: ComplexArray = 1e-6 * np.exp(-0.1j * frequencies)[:, None, None] * np.ones((1, 2, 2))
    values[0], values[5] = 1e-6, np.nan
    return ResponseCurves("reference", CHANNELS, CHANNELS, frequencies, values)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frf")
    (folder / "scene.toml").write_text(SCENE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADSTOCK_STORE", str(folder / "store"))
        assert (
            main(["run", str(folder / "scene.toml"), "-o", str(folder / "out"), "--no-figures"])
            == 0
        )
    return folder / "out"


def test_summary_table_and_file_hold_the_same_response(run_folder: Path) -> None:
    summary = read_summary(run_folder)
    curves = open_results(run_folder).frf["reference"].curves
    response = summary["frf"]["reference"]
    assert response["method"] == "poles" and response["damped"]
    assert response["outputs"] == [["tcp", "x"], ["tcp", "y"], ["tcp", "z"], ["head.seat", "rx"]]
    assert (
        [channel["dof"] for channel in response["drive_points"]]
        == response["inputs"]
        == [["tcp", d] for d in "xyz"]
    )
    rows = list(csv.reader(io.StringIO((run_folder / "tables" / "frf_reference.csv").read_text())))
    assert len(rows) == 1 + len(curves.frequencies_hz) == 1 + response["points"]
    np.testing.assert_array_equal(
        np.array(rows[1:], dtype=float)[:, 1], curves.receptance[:, 0, 0].real
    )
    assert 1e9 * curves.receptance[0, 0, 0].real == approx(
        response["drive_points"][0]["static_um_per_kN"], rel=1e-12
    )
    most_compliant = 1e-6 / np.abs(curves.receptance[:, 1, 1]).max()
    assert response["drive_points"][1]["minimum_dynamic_stiffness_N_per_um"] == approx(
        most_compliant, rel=1e-4
    )


def test_the_report_is_written_again_from_the_files_alone(run_folder: Path) -> None:
    html = (run_folder / "report.html").read_text()
    found = open_results(run_folder)
    assert render_report(found) == html
    assert html.count('class="response"') == 1 and "response-data" in html


def test_every_array_of_the_results_says_its_unit(run_folder: Path) -> None:
    with h5py.File(run_folder / "results.h5") as file:
        units: dict[str, str | None] = {}
        file.visititems(
            lambda name, item: (
                units.update({name: item.attrs.get("unit")})
                if isinstance(item, h5py.Dataset)
                else None
            )
        )
    assert len(units) > 10
    assert [name for name, unit in units.items() if unit is None] == []


def test_the_numbers_behind_the_cursor_are_the_curves(run_folder: Path) -> None:
    html = (run_folder / "report.html").read_text()
    data = json.loads(
        present(re.search(r'class="response-data"[^>]*>(.*?)</script>', html, re.DOTALL))[1]
    )
    curves = open_results(run_folder).frf["reference"].curves
    assert len(data["cells"]) == 12
    np.testing.assert_allclose(data["hz"], curves.frequencies_hz, rtol=1e-3)
    np.testing.assert_allclose(
        data["cells"][4]["size"], 1e9 * np.abs(curves.receptance[:, 1, 1]), rtol=1e-3
    )


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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    options = ["--state-space", "150 Hz", "-o", str(tmp_path / "m.mat")]
    assert main(["export", str(tmp_path / "scene.toml"), *options]) == 0
    read = scipy.io.loadmat(tmp_path / "m.mat")
    assert read["A"].shape[0] < 24 and read["D"].shape == (4, 3)
    static = read["D"] - read["C"] @ np.linalg.solve(read["A"], read["B"])
    assert (
        main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out"), "--no-figures"])
        == 0
    )
    (curves,) = (read.curves for read in open_results(tmp_path / "out").frf.values())
    np.testing.assert_allclose(
        static, curves.receptance[0].real, rtol=1e-8, atol=1e-8 * np.abs(static).max()
    )


@pytest.mark.parametrize(
    "arguments", [[], ["base", "--state-space", "5 Hz"], ["--state-space", "5 kg"]]
)
def test_an_export_of_nothing_or_of_two_things_is_refused(
    tmp_path: Path, arguments: list[str]
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["export", str(tmp_path / "scene.toml"), *arguments]) == 2
