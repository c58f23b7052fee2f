"""The command ``sweep``: what it prints, its files, and its page."""

import csv
import json
import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from common import approx, call, present
from headstock.app.charts.sweep import _middle_plane, _way_of
from headstock.app.command_line import main
from headstock.scene.studies import Sweep

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
MACHINES = Path(__file__).parents[3] / "machines"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sweep") / "out"
    assert (
        main(["sweep", str(SCENE), "line", "-o", str(out), "--json", str(out.parent / "said.json")])
        == 0
    )
    return out


def test_a_sweep_leaves_results_page_pictures_and_journal(swept: Path) -> None:
    assert {path.name for path in swept.iterdir()} == {
        ".headstock-files", "sweep.h5", "sweep.json", "sweep.csv", "numbers.h5", "provenance.json", "report.html", "modes.png", "stiffness.png", "poses"
    }  # fmt: skip
    said = json.loads((swept.parent / "said.json").read_text())
    assert said.pop("provenance") == json.loads((swept / "provenance.json").read_text())
    assert said == json.loads((swept / "sweep.json").read_text())


def test_the_table_of_a_sweep_has_a_row_per_pose_with_numbers_and_units_in_its_head(
    swept: Path,
) -> None:
    summary = json.loads((swept / "sweep.json").read_text())
    with (swept / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["X [m]"]) for row in rows] == [place[0] for place in summary["positions"]]
    assert [float(row["mode_1 [Hz]"]) for row in rows] == [
        row[0] for row in summary["frequencies_hz"]
    ]
    stiff = [matrix[2][2] for matrix in summary["static"]["tcp"]["compliance_um_per_kN"]]
    assert [float(row["compliance_tcp_z [um/kN]"]) for row in rows] == stiff
    assert [row["weakest y at tcp"] for row in rows] == [
        names[1] for names in summary["static"]["tcp"]["weakest"]
    ]
    assert {row["state"] for row in rows} == {"done"}


def test_every_array_of_a_sweep_says_its_unit(swept: Path) -> None:
    with h5py.File(swept / "sweep.h5") as file:
        units: dict[str, str | None] = {}
        file.visititems(
            lambda name, item: (
                units.update({name: item.attrs.get("unit")})
                if isinstance(item, h5py.Dataset)
                else None
            )
        )
    assert None not in units.values()
    assert (units["modal/frequencies_hz"], units["static/tcp/compliance"]) == ("Hz", "m/N")


def test_the_page_is_whole_and_refers_to_nothing_outside(swept: Path) -> None:
    page = (swept / "report.html").read_text()
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    data = json.loads(
        present(
            re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
        )[1]
    )
    summary = json.loads((swept / "sweep.json").read_text())
    assert data["positions"] == [
        [x] for x in (-200.0, -150.0, -100.0, -50.0, 0.0, 50.0, 100.0, 150.0, 200.0)
    ]
    np.testing.assert_allclose(
        np.array(data["frequencies"], dtype=float),
        np.array(summary["frequencies_hz"], dtype=float),
        rtol=1e-5,
    )
    assert (
        len(data["modes"]) == len(summary["mode_names"]) == np.shape(summary["frequencies_hz"])[1]
    )
    assert all(summary["mode_names"])
    matrix = np.array(data["points"]["tcp"]["matrix"])
    np.testing.assert_allclose(
        matrix, np.array(summary["static"]["tcp"]["compliance_um_per_kN"]), rtol=1e-5
    )


def test_what_is_printed_says_where_each_quantity_is_lowest_and_highest(
    swept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = Path(shutil.copytree(swept, tmp_path / "again"))
    said = call(capsys, ["sweep", str(SCENE), "line", "-o", str(again)]).out
    summary = json.loads((again / "sweep.json").read_text())
    stiffest = np.array(summary["static"]["tcp"]["compliance_um_per_kN"])[:, 2, 2].min()
    assert f"{stiffest:.4g}" in said
    assert "9 finished poses collected" in said


def test_a_plane_of_tool_poses_of_a_mechanism_has_its_condition_number_and_blank_poses(
    tmp_path: Path,
) -> None:
    span = 'sweeps.plane.axes={ X = ["-350 mm", "1500 mm", 6], Y = ["-400 mm", "400 mm", 3], Z = ["200 mm", "200 mm", 1] }'
    out = tmp_path / "out"
    assert (
        main(["sweep", str(MACHINES / "tripteor.toml"), "plane", "-o", str(out), "--set", span])
        == 0
    )
    summary = json.loads((out / "sweep.json").read_text())
    states = np.array(summary["states"])
    assert set(states) == {"done", "unreachable"}
    condition = np.array(summary["condition_number"], dtype=float)
    assert np.isfinite(condition[states == "done"]).all()
    assert np.isnan(condition[states == "unreachable"]).all()
    places, shape = np.zeros((18, 3)), tuple(summary["shape"])
    plane = Sweep("plane", "grid", ("X", "Y", "Z"), ("m", "m", "m"), places, shape)
    assert _middle_plane(plane, condition, [0, 1]).shape == (6, 3)


def test_an_unknown_sweep_and_a_scene_that_asks_for_nothing_are_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", str(SCENE), "lin", "-o", str(tmp_path / "out")]) == 2
    assert "did you mean 'line'?" in capsys.readouterr().err
    silent = tmp_path / "silent.toml"
    silent.write_text(
        SCENE.read_text().replace("[analyses.static]\n[analyses.modal]\ncount = 5\n", "")
    )
    assert main(["sweep", str(silent), "line", "-o", str(tmp_path / "out")]) == 2
    assert "asks for nothing to compute" in capsys.readouterr().err


def test_a_way_with_corners_is_counted_in_poses() -> None:
    corner = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]])
    places, label = _way_of(Sweep("way", "path", ("X", "Y"), ("m", "m"), corner, (3,)))
    assert places.tolist() == [1.0, 2.0, 3.0]
    assert label == "pose"
    line = np.array([[0.0], [0.1]])
    places, label = _way_of(Sweep("way", "path", ("X",), ("m",), line, (2,)))
    assert places.tolist() == [0.0, 100.0]
    assert label == "X [mm]"


def test_a_sweep_states_the_errors_of_one_pose_and_which_it_is(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene_file.write_text(
        scene_file.read_text().replace(
            'fidelity = "rigid"', 'mesh = { size = "25 mm", cells = "hex" }'
        )
    )
    out = tmp_path / "out"
    printed = " ".join(call(capsys, ["sweep", str(scene_file), "line", "-o", str(out)]).out.split())
    assert main(["run", str(scene_file), "-o", str(tmp_path / "run"), "--no-figures"]) == 0
    swept, alone = (
        json.loads(path.read_text())
        for path in (out / "sweep.json", tmp_path / "run" / "summary.json")
    )
    (sample,) = swept["sampled_errors"]
    assert swept["positions"][sample["pose"]] == [0.0]  # the reference pose of the run
    errors, point = alone["modal"][0]["error_hz"], alone["static"]["tcp"]["error_um_per_kN"]
    assert list(sample["error_hz"].values()) == approx(errors, rel=1e-6) and min(errors) > 0.0
    assert sample["error_um_per_kN"]["tcp"] == approx(point, rel=1e-6) and min(point.values()) > 0.0
    sentence = "± of modes 1 to 6 and compliances covers 95 % of errors in pose X 0 mm, and was estimated in no other"
    page = (out / "report.html").read_text()
    assert sentence in printed and sentence in page
    for error in (*sample["error_hz"].values(), *point.values()):
        assert f'<data class="bound" value="{error!r}">' in page
