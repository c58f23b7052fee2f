"""Paths and contours at values far from the usual: a right result, or an error that names the key
before anything is computed.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

import headstock as hs
from common import read_json

THREE_AXIS = Path(__file__).resolve().parents[2] / "machines" / "three_axis.toml"
CONTOUR = {
    "side": 0.02,
    "at": [0.0, 0.0, 0.0],
    "feed": "3 m/min",
    "spindle": "7500 rpm",
    "mill": {"diameter": 0.012, "teeth": 4},
    "axial_depth": 0.0005,
    "radial_depth": 0.001,
    "material": "al7075-t6",
    "pose_model": "frozen",
    "estimate": False,
}


def load(keys: Mapping[str, object]) -> hs.Machine:
    return hs.load(THREE_AXIS, variant="R", set=keys)


def contour(**keys: object) -> Mapping[str, object]:
    return {"analyses.contouring": CONTOUR | keys, "effects.cutting_force": True}


def path(**keys: object) -> Mapping[str, object]:
    return {f"analyses.path.{name}": value for name, value in keys.items()}


@pytest.mark.parametrize("pose_model", ["pose_dependent", "frozen"])
def test_a_path_below_every_mode_keeps_one_and_ends(tmp_path: Path, pose_model: str) -> None:
    keys = path(lowpass="0.1 Hz", feeds=["3000 mm/min"], pose_model=pose_model)
    hs.run(load(keys), analyses=["path"], output=tmp_path)
    outputs = read_json(tmp_path / "summary.json")["path"]["feeds"][0]["outputs"]
    # below its lowest mode the machine hardly leaves the line
    (peak,) = (output["accelerating"]["peak_um"] for output in outputs)
    assert abs(peak) < 1e-2


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        (contour(feed="1e5 m/s"), "contouring.feed"),
        (contour(spindle="1e-3 rpm"), "contouring.feed"),
        (contour(feed="1e-12 m/s"), "contouring.feed"),
        (contour(averaging="10 s"), "contouring.averaging"),
        (path(sampling="1 Hz", lowpass="0.1 Hz"), "path.sampling"),
        (path(time_constant="1e-15 s"), "path.sampling"),
    ],
)
def test_a_motion_that_cannot_be_is_refused_by_its_key(
    keys: Mapping[str, object], named: str
) -> None:
    with pytest.raises(hs.SceneError, match=re.escape(f"analyses.{named}")):
        hs.check(load(keys))


@pytest.mark.parametrize(
    ("analysis", "settings", "remedy"),
    [
        ("contouring", contour(spindle="1e9 rpm"), "slower spindle"),
        ("contouring", contour(steps_per_turn=2000, feed="1e-5 m/s"), "faster feed"),
        ("path", path(lowpass="1e-6 Hz"), "higher lowpass"),
        ("path", path(residual_time="1e7 s"), "shorter residual_time"),
    ],
)
def test_the_plan_refuses_what_no_machine_can_hold_or_wait_for(
    analysis: str, settings: Mapping[str, object], remedy: str
) -> None:
    with pytest.raises(hs.HeadstockError, match=remedy):
        hs.run(load(settings), analyses=[analysis])


def test_a_polyline_on_rigid_bodies_is_followed_in_few_poses(tmp_path: Path) -> None:
    keys = {key: value for key, value in CONTOUR.items() if key not in ("side", "at", "pose_model")}
    line = {"polyline": [[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0], [0.02, 0.04, 0.0]]}
    keys |= line | {"feed": "6 m/min", "modes_to": "1000 Hz"}
    machine = load({"analyses.contouring": keys, "effects.cutting_force": True})
    hs.run(machine, analyses=["contouring"], output=tmp_path)
    found = read_json(tmp_path / "summary.json")["contouring"]
    assert len(found["face_times_s"]) == 3
    assert min(found["force_peak_n"][:2]) > 0.0


def test_a_cut_off_below_the_samples_leaves_faces_without_profile() -> None:
    machine = load(contour(cut_off="1e-9 m", averaging="2 ms", steps_per_turn=24))
    results = hs.run(machine, analyses=["contouring"])
    assert any("cut_off" in warning for warning in results.warnings)
