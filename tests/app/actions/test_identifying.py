"""``headstock identify`` writes what it found beside the scene, never into it, and refuses bad
input with nothing overwritten.
"""

import json
import tomllib
from pathlib import Path

import pytest

from common import approx, call
from headstock.scene.building.loader import load_scene
from headstock.validation.machines.identification_cases import SCENE

TARGETS = """
[cases.stiff]
variant = "stiff"
frequencies = ["68 Hz", "70 Hz", "101 Hz", "125 Hz"]
compliances = [{ point = "tcp", motion = "z", force = "z", value = "25 um/kN", hold_out = true }]
[parameters.feet]
keys = ["joints.feet.stiffness.x"]
multiplies = ["joints.feet.stiffness.y"]
bounds = ["50 N/um", "200 N/um"]
[parameters.place]
keys = ["joints.guide_1.at[1]", { key = "joints.guide_2.at[1]", factor = -1 }]
bounds = ["30 mm", "50 mm"]
prior_sigma = 0.05
"""


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str, Path]:
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    scene, targets = tmp_path / "machine.toml", tmp_path / "targets.toml"
    scene.write_text(SCENE)
    targets.write_text(TARGETS)
    return str(scene), str(targets), tmp_path / "out"


def test_fitted_values_go_into_a_variant_to_paste(
    files: tuple[str, str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    scene, targets, output = files
    options = ["-o", str(output), "--json", str(output / "copy.json"), "--starts", "2"]
    printed = call(capsys, ["identify", scene, targets, *options]).out
    assert printed.count("  start  sum of squares") == 2
    assert "held out" in printed
    summary = json.loads((output / "identification.json").read_text())
    assert json.loads((output / "copy.json").read_text()) == summary
    assert summary["status"] == "converged"
    assert len(summary["starts"]) == 2
    assert [target["hold_out"] for target in summary["targets"]] == [False] * 4 + [True]
    assert Path(scene).read_text() == SCENE
    overrides = (output / "calibrated.toml").read_text()
    variant = tomllib.loads(overrides)["variants"]["calibrated"]
    fitted = summary["parameters"]
    assert variant["joints.feet.stiffness.x"] == f"{fitted['feet']['value']:.9g} N/um"
    assert variant["joints.guide_2.at[1]"] == f"{-fitted['place']['value']:.9g} mm"
    Path(scene).write_text(SCENE + overrides)
    joints = load_scene(Path(scene), variant="stiff+calibrated").machine.joints
    assert joints["feet"].stiffness[1, 1] / joints["feet"].stiffness[0, 0] == approx(110 / 90)
    assert joints["guide_2"].point is not None
    assert joints["guide_2"].point[1] == approx(-1e-3 * fitted["place"]["value"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"stiff"', '"stif"', "targets.toml:3: cases.stiff.variant"),
        (
            '["50 N/um", "200 N/um"]',
            '["200 N/um", "50 N/um"]',
            "targets.toml:9: parameters.feet.bounds",
        ),
        (
            '"joints.guide_1.at[1]"',
            '"joints.gide_1.at[1]"',
            "targets.toml:11: parameters.place.keys[0]",
        ),
        ('variant = "stiff"', "variant = stiff", "not valid TOML"),
    ],
)
def test_bad_input_ends_with_two_and_overwrites_nothing(
    files: tuple[str, str, Path],
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    scene, targets, output = files
    output.mkdir()
    (output / "calibrated.toml").write_text("# mine\n")
    Path(targets).write_text(TARGETS.replace(old, new, 1))
    problem = call(capsys, ["identify", scene, targets, "-o", str(output)], 2).err
    assert message in problem
    assert "nothing was computed" in problem
    assert [path.name for path in output.iterdir()] == ["calibrated.toml"]
    assert (output / "calibrated.toml").read_text() == "# mine\n"


def test_a_bound_at_which_a_part_cannot_be_built_is_bad_input(
    files: tuple[str, str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    scene, targets, output = files
    patch = 'foot = { face = "z-", rect = { size = ["30 mm", "50 mm"] } }'
    Path(scene).write_text(SCENE.replace('foot = { face = "z-" }', patch))
    text = TARGETS.replace(
        '"joints.guide_1.at[1]", { key = "joints.guide_2.at[1]", factor = -1 }',
        '"components.column.solid.box[0]"',
    )
    Path(targets).write_text(text.replace('["30 mm", "50 mm"]', '["25 mm", "50 mm"]'))
    problem = call(capsys, ["identify", scene, targets, "-o", str(output)], 2).err
    assert "parameters.place.bounds[0]" in problem
    assert "components.column: interfaces.foot" in problem


def test_a_fit_that_cannot_start_is_a_named_failure(
    files: tuple[str, str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    scene, targets, output = files
    Path(scene).write_text(
        SCENE.replace('rz = "18e6 N m/rad"', 'rz = "0 N m/rad"').replace(
            'normal = "50 N/um"', 'normal = "0 N/um"'
        )
    )
    problem = call(capsys, ["identify", scene, targets, "-o", str(output)], 1).err
    assert "ConvergenceError: none of 1 start(s) could be computed" in problem
    assert "rigid motion(s) are free" in problem
    assert not (output / "calibrated.toml").exists()
