"""``headstock identify`` writes what it found beside the scene, never into it, and refuses bad
input with nothing overwritten.
"""

import tomllib

import pytest

from common import Shell, approx
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


IDENTIFY = "identify scene.toml targets.toml -o out"


@pytest.fixture
def fit(shell: Shell) -> Shell:
    shell.write(SCENE)
    shell.write(TARGETS, name="targets")
    return shell


def test_fitted_values_go_into_a_variant_to_paste(fit: Shell) -> None:
    printed = fit(f"{IDENTIFY} --json copy.json --starts 2").out
    assert printed.count("  start  sum of squares") == 2
    assert "held out" in printed
    summary = fit.json("out/identification.json")
    assert fit.json("copy.json") == summary
    assert summary["status"] == "converged"
    assert len(summary["starts"]) == 2
    assert [target["hold_out"] for target in summary["targets"]] == [False] * 4 + [True]
    assert fit.text("scene.toml") == SCENE
    overrides = fit.text("out/calibrated.toml")
    variant = tomllib.loads(overrides)["variants"]["calibrated"]
    fitted = summary["parameters"]
    assert variant["joints.feet.stiffness.x"] == f"{fitted['feet']['value']:.9g} N/um"
    assert variant["joints.guide_2.at[1]"] == f"{-fitted['place']['value']:.9g} mm"
    joints = load_scene(fit.change(add=overrides), variant="stiff+calibrated").machine.joints
    assert joints["feet"].stiffness[1, 1] / joints["feet"].stiffness[0, 0] == approx(110 / 90)
    assert joints["guide_2"].point is not None
    assert joints["guide_2"].point[1] == approx(-1e-3 * fitted["place"]["value"])


BOUNDS = '["50 N/um", "200 N/um"]'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"stiff"', '"stif"', "targets.toml:3: cases.stiff.variant"),
        (BOUNDS, '["200 N/um", "50 N/um"]', "targets.toml:9: parameters.feet.bounds"),
        ("guide_1.at", "gide_1.at", "targets.toml:11: parameters.place.keys[0]"),
        ('variant = "stiff"', "variant = stiff", "not valid TOML"),
    ],
)
def test_bad_input_ends_with_two_and_overwrites_nothing(
    fit: Shell, old: str, new: str, message: str
) -> None:
    fit.write(TARGETS, (old, new), name="targets")
    (fit.folder / "out").mkdir()
    fit.write("# mine\n", name="out/calibrated")
    problem = fit(IDENTIFY, code=2).err
    assert message in problem
    assert "nothing was computed" in problem
    assert fit.files("out") == {"calibrated.toml"}
    assert fit.text("out/calibrated.toml") == "# mine\n"


def test_a_bound_at_which_a_part_cannot_be_built_is_bad_input(fit: Shell) -> None:
    patch = 'foot = { face = "z-", rect = { size = ["30 mm", "50 mm"] } }'
    fit.change(('foot = { face = "z-" }', patch))
    places = '"joints.guide_1.at[1]", { key = "joints.guide_2.at[1]", factor = -1 }'
    box = (places, '"components.column.solid.box[0]"'), ('["30 mm"', '["25 mm"')
    fit.write(TARGETS, *box, name="targets")
    problem = fit(IDENTIFY, code=2).err
    assert "parameters.place.bounds[0]" in problem
    assert "components.column: interfaces.foot" in problem


def test_a_fit_that_cannot_start_is_a_named_failure(fit: Shell) -> None:
    soft = ('rz = "18e6 N m/rad"', 'rz = "0 N m/rad"'), ('normal = "50 N/um"', 'normal = "0 N/um"')
    fit.change(*soft)
    problem = fit(IDENTIFY, code=1).err
    assert "ConvergenceError: none of 1 start(s) could be computed" in problem
    assert "rigid motion(s) are free" in problem
    assert "calibrated.toml" not in fit.files("out")
