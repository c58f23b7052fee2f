"""A point with an offset moves as the tip of a rigid extension of its tool."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import headstock as hs
from common import approx, read_json
from fixture_machines import machine, write_scene

ROOT = Path(__file__).resolve().parents[2]
OFFSET = np.array([0.03, -0.02, -0.1])
BODY = machine("""
machine = "block"
names = { block = "arm", mount = "foot", tcp = "tip" }
without = ["analyses.modal", "analyses.static.at"]
components.arm.solid = { box = ["40 mm", "50 mm", "200 mm"] }
components.arm.rotate = { axis = "y", angle = "90 deg" }
components.arm.fidelity = "FIDELITY"
components.arm.mesh = { size = "50 mm" }
joints.foot.between = ["arm.foot", "ground"]
joints.foot.stiffness = { x = "100 N/um", y = "50 N/um", z = "200 N/um", rx = "10 kN m/rad", ry = "20 kN m/rad", rz = "30 kN m/rad" }
points.longer = { tool = "arm.tip", work = "ground", offset = ["30 mm", "-20 mm", "-100 mm"] }
points.ground_tool = { tool = "ground", work = "arm.tip", offset = ["30 mm", "-20 mm", "-100 mm"] }
""")


def carried(arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """``u + theta x r`` of the tip as a matrix ``(6, 6)``."""
    x, y, z = arm
    found = np.eye(6)
    found[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return found


@pytest.mark.parametrize("fidelity", ["rigid", "segmented", "polynomial", "elastic"])
def test_the_tip_of_an_offset_moves_by_the_rotation_too(tmp_path: Path, fidelity: str) -> None:
    scene = write_scene(tmp_path, BODY.replace("FIDELITY", fidelity), name="arm")
    result = hs.run(scene)
    # a turn of 90 degrees about y leads z of the component to x of the machine
    moved = carried(np.array([OFFSET[2], OFFSET[1], -OFFSET[0]]))
    expected = moved @ result.compliance["tip"] @ moved.T
    assert result.compliance["longer"] == approx(expected, rel=1e-8, abs=1e-16)
    assert result.compliance["ground_tool"] == approx(expected, rel=1e-8, abs=1e-16)


LOBES = {
    "speeds": ["3000 rpm", "6000 rpm", 2],
    "mill": {"diameter": "20 mm", "teeth": 4},
    "material": "al7075-t6",
    "radial_depth": "5 mm",
    "directions": ["x"],
}
EVERY: dict[str, object] = {
    "components.ram.interfaces.side": {"face": "x+"},
    "analyses.static": {},
    "analyses.frf": {"from": "20 Hz", "up_to": "300 Hz", "points": 5, "adaptive": False},
    "analyses.path.from": {"X": "-40 mm"},
    "analyses.path.to": {"X": "40 mm"},
    "analyses.path.feeds": ["3000 mm/min"],
    "analyses.path.time_constant": "50 ms",
    "analyses.lobes": LOBES,
    "analyses.contouring.side": "20 mm",
    "analyses.contouring.feed": "20 m/min",
    "analyses.contouring.steps_per_turn": 24,
}


def test_every_analysis_takes_the_offset_as_an_interface_there(tmp_path: Path) -> None:
    ways: dict[str, dict[str, object]] = {
        "interface": {"points.tcp.tool": "ram.side"},
        "offset": {"points.tcp.offset": [0.075, 0.0, -0.25]},
    }
    found = {}
    for name, way in ways.items():
        machine = hs.load(ROOT / "tests" / "data" / "mill.toml", set=EVERY | way)
        hs.run(machine, output=tmp_path / name)
        summary = read_json(tmp_path / name / "summary.json")
        answers = ("static", "frf", "path", "lobes", "contouring")
        found[name] = {key: json.dumps(_rounded(summary[key])) for key in answers}
    assert found["interface"] == found["offset"]


def _rounded(value: object) -> object:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


def test_a_lumped_mechanism_takes_it_in_runs_and_sweeps() -> None:
    poses, offset = ["config_1", "config_2"], [0.0, 0.01, -0.1]
    keys: dict[str, object] = {"sweeps.two": {"poses": poses}, "analyses": {"static": {}}}
    keys["points.longer"] = {"tool": "spindle.tip", "work": "ground", "offset": offset}
    machine = hs.load(ROOT / "machines" / "tripteor.toml", set=keys)
    result, swept = hs.run(machine), hs.sweep(machine, "two")
    pose = result.view.poses["config_1"]
    moved = carried(pose.points["longer"].tool_place - pose.points["tcp"].tool_place)
    assert np.linalg.norm(moved[:3, 3:]) == approx(np.sqrt(2.0) * np.hypot(0.01, 0.1))
    expected = moved @ result.static["config_1"]["tcp"].compliance @ moved.T
    assert result.static["config_1"]["longer"].compliance == approx(expected, rel=1e-8, abs=1e-16)
    expected = np.array([result.static[name]["longer"].compliance[:3, :3] for name in poses])
    assert swept.points["longer"].compliance == approx(expected, rel=1e-8, abs=1e-16)


def test_one_entry_of_an_offset_can_be_varied(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, BODY.replace("FIDELITY", "rigid"), name="arm")
    watch = ["static.longer.compliance_um_per_kN[1][1]"]
    table = hs.study(scene, vary={"points.longer.offset[2]": [0.0, -0.1]}, watch=watch)
    far, near = (next(iter(row.values.values())) for row in table.rows)
    assert isinstance(far, float) and isinstance(near, float) and near < 0.5 * far


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ({"points.tip.offset": ["0 mm", "0 mm", "-12 m"]}, "12 m long"),
        ({"points.tip.offset": ["0 mm", "-100 mm"]}, "entries"),
        ({"points.tip.offset": ["0 mm", "0 mm", "100"]}, "plain number"),
        ({"points.tip.offset[2]": "-100 mm"}, "points.tip.offset=["),
    ],
)
def test_an_offset_that_means_nothing_is_refused(
    tmp_path: Path, setting: dict[str, object], words: str
) -> None:
    scene = write_scene(tmp_path, BODY.replace("FIDELITY", "rigid"), name="arm")
    with pytest.raises(hs.SceneError) as caught:
        hs.load(scene, set=setting)
    assert words in str(caught.value)
    assert caught.value.problems[0].key.startswith("points.tip.offset")
