"""The command ``sweep``: what it prints, its files, and its page."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from common import Shell, approx, present, read_json, read_rows, read_units
from headstock.app.charts.sweep import _middle_plane, _way_of
from headstock.app.command_line import main
from headstock.scene.studies import Sweep

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
MACHINES = Path(__file__).parents[3] / "machines"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sweep") / "out"
    words = ["sweep", str(SCENE), "line", "-o", str(out), "--json", str(out.parent / "said.json")]
    assert main(words) == 0
    return out


def test_a_sweep_leaves_results_page_pictures_and_journal(swept: Path) -> None:
    assert {path.name for path in swept.iterdir()} == {
        *(".headstock-files", "sweep.h5", "sweep.json", "sweep.csv", "numbers.h5", "poses"),
        *("provenance.json", "report.html", "modes.png", "stiffness.png"),
    }
    said = read_json(swept.parent / "said.json")
    assert said.pop("provenance") == read_json(swept / "provenance.json")
    assert said == read_json(swept / "sweep.json")


def test_the_table_of_a_sweep_has_a_row_per_pose_with_numbers_and_units_in_its_head(
    swept: Path,
) -> None:
    summary, rows = read_json(swept / "sweep.json"), read_rows(swept / "sweep.csv")
    point = summary["static"]["tcp"]
    numbers = {
        "X [m]": [place[0] for place in summary["positions"]],
        "mode_1 [Hz]": [row[0] for row in summary["frequencies_hz"]],
        "compliance_tcp_z [um/kN]": [each[2][2] for each in point["compliance_um_per_kN"]],
    }
    for heading, column in numbers.items():
        assert [float(row[heading]) for row in rows] == column
    weakest = [names[1] for names in point["weakest"]]
    assert [row["weakest y at tcp"] for row in rows] == weakest
    assert {row["state"] for row in rows} == {"done"}


def test_every_array_of_a_sweep_says_its_unit(swept: Path) -> None:
    units = read_units(swept / "sweep.h5")
    assert None not in units.values()
    assert (units["modal/frequencies_hz"], units["static/tcp/compliance"]) == ("Hz", "m/N")


def test_the_page_is_whole_and_refers_to_nothing_outside(swept: Path) -> None:
    page = (swept / "report.html").read_text()
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    script = r'<script type="application/json" id="data">(.*?)</script>'
    data = json.loads(present(re.search(script, page, re.DOTALL))[1])
    summary = read_json(swept / "sweep.json")
    assert data["positions"] == [[50.0 * number] for number in range(-4, 5)]
    compliances = summary["static"]["tcp"]["compliance_um_per_kN"]
    for shown, found in (
        (data["frequencies"], summary["frequencies_hz"]),
        (data["points"]["tcp"]["matrix"], compliances),
    ):
        np.testing.assert_allclose(np.array(shown, float), np.array(found, float), rtol=1e-5)
    modes = np.shape(summary["frequencies_hz"])[1]
    assert len(data["modes"]) == len(summary["mode_names"]) == modes
    assert all(summary["mode_names"])


def test_what_is_printed_says_where_each_quantity_is_lowest_and_highest(
    swept: Path, shell: Shell
) -> None:
    shutil.copytree(swept, shell.folder / "again")
    said = shell(f"sweep {SCENE} line -o again").out
    compliances = shell.json("again/sweep.json")["static"]["tcp"]["compliance_um_per_kN"]
    assert f"{np.array(compliances)[:, 2, 2].min():.4g}" in said
    assert "9 finished poses collected" in said


def test_a_plane_of_tool_poses_of_a_mechanism_has_its_condition_number_and_blank_poses(
    shell: Shell,
) -> None:
    span = 'sweeps.plane.axes={ X = ["-350 mm", "1500 mm", 6], Y = ["-400 mm", "400 mm", 3], Z = ["200 mm", "200 mm", 1] }'
    shell(f"sweep {MACHINES / 'tripteor.toml'} plane -o out --set", span)
    summary = shell.json("out/sweep.json")
    states = np.array(summary["states"])
    assert set(states) == {"done", "unreachable"}
    condition = np.array(summary["condition_number"], dtype=float)
    assert np.isfinite(condition[states == "done"]).all()
    assert np.isnan(condition[states == "unreachable"]).all()
    places, shape = np.zeros((18, 3)), tuple(summary["shape"])
    plane = Sweep("plane", "grid", ("X", "Y", "Z"), ("m", "m", "m"), places, shape)
    assert _middle_plane(plane, condition, [0, 1]).shape == (6, 3)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"sweep {SCENE} lin -o out", "did you mean 'line'?"),
        ("sweep scene.toml line -o out", "asks for nothing to compute"),
    ],
)
def test_an_unknown_sweep_and_a_scene_that_asks_for_nothing_are_bad_input(
    shell: Shell, line: str, said: str
) -> None:
    shell.write(SCENE.read_text(), ("[analyses.static]\n[analyses.modal]\ncount = 5\n", ""))
    assert said in shell(line, code=2).err


@pytest.mark.parametrize(
    ("positions", "wanted", "title"),
    [
        ([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]], [1.0, 2.0, 3.0], "pose"),
        ([[0.0], [0.1]], [0.0, 100.0], "X [mm]"),
    ],
)
def test_a_way_with_corners_is_counted_in_poses(
    positions: list[list[float]], wanted: list[float], title: str
) -> None:
    axes, units = ("X", "Y")[: len(positions[0])], ("m", "m")[: len(positions[0])]
    sweep = Sweep("way", "path", axes, units, np.array(positions), (len(positions),))
    places, label = _way_of(sweep)
    assert (places.tolist(), label) == (wanted, title)


def test_a_sweep_states_the_errors_of_one_pose_and_which_it_is(block: Shell) -> None:
    block.change(('fidelity = "rigid"', 'mesh = { size = "25 mm", cells = "hex" }'))
    printed = block.prints("sweep scene.toml line -o out")
    block("run scene.toml -o run --no-figures")
    swept, alone = block.json("out/sweep.json"), block.json("run/summary.json")
    (sample,) = swept["sampled_errors"]
    assert swept["positions"][sample["pose"]] == [0.0]  # the reference pose of the run
    errors, point = alone["modal"][0]["error_hz"], alone["static"]["tcp"]["error_um_per_kN"]
    assert list(sample["error_hz"].values()) == approx(errors, rel=1e-6) and min(errors) > 0.0
    assert sample["error_um_per_kN"]["tcp"] == approx(point, rel=1e-6) and min(point.values()) > 0.0
    sentence = "± of modes 1 to 6 and compliances covers 95 % of errors in pose X 0 mm, and was estimated in no other"
    page = block.text("out/report.html")
    assert sentence in printed and sentence in page
    for error in (*sample["error_hz"].values(), *point.values()):
        assert f'<data class="bound" value="{error!r}">' in page
