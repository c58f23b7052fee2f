"""``headstock identify``: what it says of parameters and targets of a block whose modes are closed
forms.
"""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from built_uff import points_15, text_58, units
from common import Shell, approx
from fixture_machines import stored_scene

MACHINES = Path(__file__).resolve().parents[2] / "machines"
SCENE = stored_scene("identified_block")
# sqrt(k / m) / (2 pi) of 4, 9 and 16 N/um under 1000 kg
SHIFTS = np.sqrt([4e3, 9e3, 16e3]) / (2.0 * np.pi)
IDENTIFY = "identify scene.toml targets.toml -o out"


def parameter(direction: str, bounds: str = '["1 N/um", "50 N/um"]') -> str:
    return f'[parameters.{direction}]\nkeys = ["joints.feet.stiffness.{direction}"]\nbounds = {bounds}\n'


def mode(hz: float, along: str, more: str = "") -> str:
    moves = f'[{{ bodies = ["block"], translation = "{along}" }}]'
    return f'{{ frequency = "{hz:.12g} Hz", moves = {moves}{more} }}'


@pytest.fixture
def block(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def identify(block: Shell, cases: str, *parameters: str) -> Any:
    block.write(cases + "".join(parameters), name="targets")
    block(IDENTIFY)
    return block.json("out/identification.json")


def shapes(first: str = "x", more: str = "") -> str:
    along = [mode(1.01 * SHIFTS[0], first, more), mode(0.99 * SHIFTS[1], "y"), mode(SHIFTS[2], "z")]
    return f'[fit]\nnoise = "residuals"\n[cases.a]\nmodes = [{", ".join(along)}]\n'


def test_a_shape_counts_as_one_measurement(block: Shell) -> None:
    found = identify(block, shapes(), *map(parameter, "x"))
    assert found["degrees_of_freedom"] == approx(5.0, abs=1e-6)
    kinds = found["noise_by_kind"]
    # one parameter, which one of three frequencies determines; shapes are met
    assert kinds["frequency"]["degrees_of_freedom"] == approx(2.0, abs=1e-6)
    assert kinds["frequency"]["over_tolerance"] == approx(
        np.log(0.99) / -0.01 / np.sqrt(2), rel=1e-6
    )
    assert kinds["shape"] == approx({"degrees_of_freedom": 3.0, "over_tolerance": 0.0}, abs=1e-6)


def test_a_shape_in_words_that_no_mode_has_is_named_and_left_out(block: Shell) -> None:
    rotation = '[{ bodies = ["block"], rotation = "x" }]'
    text = shapes().replace('[{ bodies = ["block"], translation = "y" }]', rotation)
    # the block on one spring is asked to rotate at a frequency at which nothing else is near
    stiff = ('rx = "4 MN m/rad"', 'rx = "400 MN m/rad"')
    block.change(stiff)
    found = identify(block, text, parameter("y"))
    assert found["left_out_shapes"] == [f"a {0.99 * SHIFTS[1]:.6g} Hz"]
    assert found["targets"][1]["mac"] is None
    assert found["parameters"]["y"]["value"] == approx(9.0 * 0.99**2, rel=1e-5)
    insisted = text.replace(f"moves = {rotation}", f"moves = {rotation}, insist = true")
    kept = identify(block, insisted, parameter("y"))
    assert kept["left_out_shapes"] == []
    assert kept["targets"][1]["mac"] == approx(0.0, abs=1e-6)


def test_a_parameter_at_its_bound_has_no_interval(block: Shell) -> None:
    both = [
        mode(hz, way, ", shape_tolerance = 0.001") for hz, way in zip(SHIFTS, "xy", strict=False)
    ]
    text = f"[cases.a]\nmodes = [{', '.join(both)}]\n"
    found = identify(
        block, text, parameter("x", '["5 N/um", "50 N/um"]') + 'start = "8 N/um"\n', parameter("y")
    )
    x, y = found["parameters"]["x"], found["parameters"]["y"]
    assert (x["at_bound"], x["low_95"], x["high_95"]) == ("lower", None, None)
    # 1 % of a frequency is 2 % of a stiffness
    assert np.log(y["high_95"] / y["low_95"]) == approx(2 * 1.959964 * 0.02, rel=1e-5)
    assert np.array(found["covariance"]) == approx(np.diag([0.0, 0.02**2]), abs=1e-9)
    assert "at its lower bound, no interval" in block.text("out/calibrated.toml")


def test_a_held_out_target_is_predicted_with_an_interval_and_the_scatter_of_a_measurement(
    block: Shell,
) -> None:
    compliance = '{ point = "tcp", motion = "z", force = "z", value = "1 um/kN", tolerance = "3 %", hold_out = true }'
    text = f"[cases.a]\nmodes = [{mode(SHIFTS[2], 'z')}]\ncompliances = [{compliance}]\n"
    found = identify(block, text, parameter("z"))
    predicted = found["targets"][1]
    assert predicted["model"] == approx(1e3 / 16.0, rel=1e-5)
    assert predicted["relative_spread_95"] == approx(1.959964 * 0.02, rel=1e-5)
    assert predicted["relative_scatter_95"] == approx(1.959964 * 0.03, rel=1e-5)


def with_damping(block: Shell) -> None:
    """Dampers along x, and structural damping."""
    block.change(
        ("[joints.feet]", '[joints.feet]\ndamping = { x = "1 N s/mm" }\nloss_factor = 0.001'),
        ('name = "Block"', 'name = "Block"\neffects = ["damping"]'),
    )


DAMPINGS = """
[parameters.viscous]
keys = ["joints.feet.damping.x"]
bounds = ["0.1 N s/mm", "100 N s/mm"]
[parameters.structural]
keys = ["joints.feet.loss_factor"]
bounds = [0.0001, 0.3]
"""


def test_damping_ratios_give_viscous_and_structural_damping(block: Shell) -> None:
    with_damping(block)
    x, y = (mode(hz, way) for hz, way in zip(SHIFTS, "xy", strict=False))
    # c / (2 sqrt(k m)) + eta / 2; the loss of a complex stiffness alone is sin(atan(eta) / 2)
    damped = (
        x.replace("moves", 'damping = "8 %", moves'),
        y.replace("moves", 'damping = "2 %", damping_tolerance = "5 %", moves'),
    )
    found = identify(block, f"[cases.a]\nmodes = [{', '.join(damped)}]\n", DAMPINGS)
    values = {name: item["value"] for name, item in found["parameters"].items()}
    assert values["structural"] == approx(np.tan(2.0 * np.arcsin(0.02)), rel=1e-5)
    assert values["viscous"] == approx(0.06 * 2.0 * np.sqrt(4e6 * 1e3) / 1e3, rel=2e-3)
    rows = [target for target in found["targets"] if target["kind"] == "damping"]
    assert [row["model"] for row in rows] == approx([8.0, 2.0], rel=1e-5)
    structural = found["parameters"]["structural"]
    reach = np.log(structural["high_95"] / structural["low_95"])
    assert reach == approx(2 * 1.959964 * 0.05, rel=2e-3)


def test_a_measured_response_gives_stiffness_and_damping(block: Shell) -> None:
    with_damping(block)
    block.change(('ry = "6 MN m/rad"', 'ry = "6e6 MN m/rad"'))
    omega = 2.0 * np.pi * np.array([6.0, 9.5, 10.5, 14.0])
    values = 1e9 / (4.4e6 * (1.0 + 0.02j) - 1000.0 * omega**2 + 1j * omega * 3e3)
    lines = [
        f'["{hz:.15g} Hz", "{value.real:.15g} um/kN", "{value.imag:.15g} um/kN"]'
        for hz, value in zip(omega / 2.0 / np.pi, values, strict=True)
    ]
    response = f'{{ point = "tcp", motion = "x", force = "x", lines = [{", ".join(lines)}] }}'
    found = identify(block, f"[cases.a]\nresponses = [{response}]\n", DAMPINGS, parameter("x"))
    fitted = {name: item["value"] for name, item in found["parameters"].items()}
    assert fitted == approx({"x": 4.4, "viscous": 3.0, "structural": 0.02}, rel=1e-4)
    assert found["noise_by_kind"]["response"]["degrees_of_freedom"] == approx(5.0, abs=1e-6)


def test_responses_with_their_noise_come_last_and_modes_lead_to_them(block: Shell) -> None:
    with_damping(block)
    block.change(('ry = "6 MN m/rad"', 'ry = "6e6 MN m/rad"'))
    hz, random = np.linspace(6.0, 15.0, 300), np.random.default_rng(2)
    omega = 2.0 * np.pi * hz
    clean = 1.0 / (4.4e6 * (1.0 + 0.02j) - 1000.0 * omega**2 + 1j * omega * 3e3)
    parts = np.stack([clean.real, clean.imag], axis=1)
    parts += 0.02 * np.abs(clean).max() * random.standard_normal(parts.shape)
    head = ",".join(["frequency", *(f"tcp:+x/tcp:+x {part} [m/N]" for part in ("re", "im"))])
    rows = (",".join(f"{value:.9g}" for value in row) for row in np.column_stack([hz, parts]))
    (block.folder / "test.csv").write_text("\n".join([head, *rows, ""]))
    measured = '{ file = "test.csv", noise = true, count = 300 }'
    text = f"[cases.a]\nmodes = [{mode(1.1 * SHIFTS[0], 'x')}]\nresponses = [{measured}]\n"
    found = identify(block, text, DAMPINGS, parameter("x"))
    # the measured mode is 5 % too high, and responses know better
    (frequency, response) = found["targets"]
    assert (frequency["hold_out"], response["hold_out"]) == (True, False)
    assert frequency["deviation"] == approx(np.sqrt(1.1) / 1.1 - 1.0, abs=2e-3)
    for name, true in (("x", 4.4), ("viscous", 3.0)):
        item = found["parameters"][name]
        assert item["low_95"] < true < item["high_95"]
    assert found["parameters"]["x"]["value"] == approx(4.4, rel=2e-3)
    assert found["noise_by_kind"]["response"]["over_tolerance"] == approx(1.0, abs=0.15)
    block.write(text.replace("noise", 'tolerance = "5 %", noise') + DAMPINGS, name="targets")
    assert "keep one of them" in block.refuses(IDENTIFY)


def test_damping_is_not_fitted_without_the_effect(block: Shell) -> None:
    block.write(
        '[cases.a]\nmodes = [{ frequency = "10 Hz", damping = "1 %" }]\n' + parameter("x"),
        name="targets",
    )
    assert "name it in the scene's effects" in block.refuses(IDENTIFY)


def test_another_modulus_and_density_need_no_reduction(block: Shell) -> None:
    elastic = 'mesh = { size = "500 mm", cells = "hex" }\nreduction = { modes_to = "2 kHz" }'
    block.change(
        ('fidelity = "rigid"', elastic),
        ('work = "ground"', 'work = "ground"\n[analyses.modal]\ncount = 12'),
    )
    run = "run scene.toml --no-figures -o"
    block(f"{run} first")
    other = ("--set", "materials.iron.E=100 GPa", "--set", "materials.iron.rho=1300 kg/m^3")
    printed = block(f"{run} scaled", *other).out
    assert re.search(r"reduce +block .* cached", printed)
    shutil.rmtree(block.folder / "store")
    block(f"{run} anew", *other)
    found, anew = (block.json(f"{name}/summary.json")["modal"][0] for name in ("scaled", "anew"))
    assert found["frequencies_hz"] == approx(anew["frequencies_hz"], rel=1e-9)


GLUED = """[joints.glue]
between = ["ground", "block.foot"]
kind = "bolted"
axis = "z"
stiffness_per_area = { normal = "20 N/um/m^2", shear = "10 N/um/m^2", covers = 1.0 }
"""
AREA = """
[parameters.size]
keys = ["joints.glue.stiffness_per_area.covers"]
bounds = [0.3, 1.0]
[parameters.normal]
keys = ["joints.glue.stiffness_per_area.normal"]
bounds = ["5 N/um/m^2", "100 N/um/m^2"]
"""


def test_the_size_of_a_contact_area_is_fitted_without_another_mesh(block: Shell) -> None:
    """What is measured is the machine itself with a stiffer layer over 70 % of its face."""
    feet = SCENE[SCENE.index("[joints.feet]") : SCENE.index("[points.tcp]")]
    block.change(
        (feet, GLUED),
        ('fidelity = "rigid"', 'mesh = { size = "500 mm", cells = "hex" }'),
        ('face = "z-" }', 'face = "z-", coupling = { flexible = 12 } }'),
        ('work = "ground"', 'work = "ground"\n[analyses.modal]\ncount = 6'),
    )
    true = "joints.glue.stiffness_per_area={normal='40 N/um/m^2', shear='10 N/um/m^2', covers=0.7}"
    block("run scene.toml --no-figures -o true", "--set", true)
    (modes,) = block.json("true/summary.json")["modal"]
    wanted = ", ".join(f'"{hz:.12g} Hz"' for hz in modes["frequencies_hz"])
    block.write(f"[cases.a]\nfrequencies = [{wanted}]\n{AREA}", name="targets")
    assert "meshed and reduced anew" not in block.prints(IDENTIFY)
    found = block.json("out/identification.json")["parameters"]
    assert found["size"]["value"] == approx(0.7, rel=1e-5)
    assert found["normal"]["value"] == approx(40.0, rel=1e-5)
    block.change(("covers = 1.0", "covers = 0"))
    assert "nothing carries" in block.refuses("check scene.toml")


MODIFIED = """
[cases.a]
modes = [{{ frequency = "{0[0]:.9g} Hz", name = "x" }}, {{ frequency = "{0[1]:.9g} Hz", name = "y" }}, {{ frequency = "{0[2]:.9g} Hz", name = "z" }}]
[cases.b]
like = "a"
variant = "soft"
modes = [{{ frequency = "{1[1]:.9g} Hz", name = "y" }}, {{ frequency = "{1[0]:.9g} Hz", name = "x" }}]
[cases.c]
scene = "other.toml"
frequencies = ["{2:.9g} Hz"]
"""


def test_a_modified_machine_pairs_by_the_shapes_of_the_unmodified_one(block: Shell) -> None:
    """The variant puts the mode along z below both others, where no measurement is."""
    block.change(add='[variants.soft]\n"joints.feet.stiffness.z" = "6 N/um"\n')
    block.write(SCENE, ('x = "4 N/um"', 'x = "1 N/um"'), name="other")
    heavy = SHIFTS[:2] * np.sqrt(1.1)
    text = MODIFIED.format(SHIFTS * np.sqrt(1.1), heavy, np.sqrt(1e3 * 1.1) / 2.0 / np.pi)
    free = (
        '[parameters.mass]\nkeys = ["materials.iron.rho"]\nbounds = ["500 kg/m^3", "2000 kg/m^3"]\n'
    )
    found = identify(block, text, free)
    assert found["parameters"]["mass"]["value"] == approx(1000.0 / 1.1, rel=1e-4)
    assert [target["mode"] for target in found["targets"]] == [1, 2, 3, 1, 3, 1]
    assert set(found["keys"]) == {"", "soft", "other.toml"}
    block.write(text.replace('Hz", name = "x" }]', 'Hz", name = "w" }]') + free, name="targets")
    assert "has no partner in a" in block.refuses(IDENTIFY)


EXCHANGED = """
[cases.base]
modes = [{{ frequency = "{0[0]:.6g} Hz", name = "x" }}, {{ frequency = "{0[1]:.6g} Hz", name = "y" }}]
[cases.stiff]
like = "base"
variant = "stiff"
modes = [{{ frequency = "{0[1]:.6g} Hz", name = "y" }}, {{ frequency = "{0[2]:.6g} Hz", name = "x" }}]
"""


def test_modes_that_the_model_has_in_the_other_order_are_named(block: Shell) -> None:
    """The variant is measured above the mode along y, and the model has it below."""
    block.change(add='[variants.stiff]\n"joints.feet.stiffness.x" = "8.5 N/um"\n')
    text = EXCHANGED.format(np.sqrt([4e3, 9e3, 9.5e3]) / 2.0 / np.pi) + parameter("y")
    block.write(text, name="targets")
    said = "stiff 15.0988 Hz y and stiff 15.5125 Hz x: the model has these modes in the other order"
    assert said in block.prints(IDENTIFY)
    found = block.json("out/identification.json")
    assert found["exchanges"] == [["stiff 15.0988 Hz y", "stiff 15.5125 Hz x"]]
    assert found["parameters"]["y"]["value"] == approx(9.0, rel=1e-4)
    block.write(text.replace('like = "base"', ""), name="targets")
    assert "other order" not in block.prints(IDENTIFY)  # by nearness the exchange is hidden
    assert block.json("out/identification.json")["parameters"]["y"]["value"] > 9.2


def test_a_number_of_which_a_variant_has_its_own_value_is_not_set_to_one(block: Shell) -> None:
    block.change(add='[variants.stiff]\n"joints.feet.stiffness.x" = "8.5 N/um"\n')
    text = EXCHANGED.format(np.sqrt([4e3, 9e3, 9.5e3]) / 2.0 / np.pi) + parameter("x")
    block.write(text, name="targets")
    said = " ".join(block.refuses(IDENTIFY).split())
    assert "4 N/um in the scene as written and 8.5 N/um in variant stiff" in said
    assert 'write multiplies = ["joints.feet.stiffness.x"]' in said
    text = text.replace("keys =", "multiplies =").replace('["1 N/um", "50 N/um"]', "[0.2, 5.0]")
    block.write(text, name="targets")
    block(IDENTIFY)


def test_a_fit_is_written_beside_the_scene_and_later_runs_carry_its_uncertainty(
    block: Shell,
) -> None:
    """1 % of a frequency, in ± of every frequency that the fitted stiffness determines."""
    block.change(('name = "Block"', 'name = "Block"\ninclude = []'))
    block.change(add="[analyses.modal]\ncount = 6\n[analyses.static]\nat = ['tcp']\n")
    text = f"[cases.a]\nmodes = [{mode(1.05 * SHIFTS[1], 'y')}]\n"
    block.write(text + parameter("y"), name="targets")
    printed = block.prints(f"{IDENTIFY} --write fitted")
    assert 'write include = ["scene.fitted.toml"]' in printed
    block.change(("include = []", 'include = ["scene.fitted.toml"]'))
    assert "write include" not in block.prints(f"{IDENTIFY} --write fitted")
    printed = block.prints("run scene.toml --variant fitted -o run --no-figures")
    assert "a measurement scatters apart from that by frequency 2 %" in printed
    (modes,) = block.json("run/summary.json")["modal"]
    hz = 1.05 * SHIFTS[1]
    nearest = int(np.argmin(np.abs(np.array(modes["frequencies_hz"]) - hz)))
    assert modes["frequencies_hz"][nearest] == approx(hz, rel=1e-6)
    spreads = [shares["fit"] for shares in modes["error_share"]]
    assert spreads[nearest] == approx(1.959964 * 0.01 * hz, rel=0.02)
    assert max(spreads[:nearest] + spreads[nearest + 1 :]) < 0.01
    block("run scene.toml -o plain --no-figures")
    assert "fit" not in str(block.json("plain/summary.json")["modal"])
    block.change(add='[variants.mine]\n"joints.feet.stiffness.z" = "6 N/um"\n')
    assert "choose another" in block.refuses(f"{IDENTIFY} --write mine")
    block.write(block.text("scene.fitted.toml") + "# changed by hand\n", name="scene.fitted")
    assert "changed since" in block.refuses(f"{IDENTIFY} --write fitted -o late")
    assert "late" not in block.files()  # nothing was fitted in vain
    (block.folder / ".headstock-files").unlink()  # as in a clone
    assert "variant fitted is in" in block.prints(f"{IDENTIFY} --write fitted -o late")
    assert "changed by hand" not in block.text("scene.fitted.toml")


RESPONSES = """
[analyses.modal]
count = 6
[analyses.static]
at = ["tcp"]
[analyses.frf]
inputs = [["tcp", "y"]]
outputs = [["tcp", "y"]]
up_to = "40 Hz"
points = 20
[analyses.lobes]
speeds = ["600 rpm", "1200 rpm", 3]
mill = { diameter = "10 mm", teeth = 2 }
radial_depth = "5 mm"
material = "al7075-t6"
directions = ["x"]
up_to = "40 Hz"
"""


def test_stiffness_and_responses_of_a_fit_have_its_uncertainty_and_lobes_say_that_they_have_not(
    block: Shell,
) -> None:
    """1 % of a frequency is 2 % of a stiffness; a resonance moves by 1 %."""
    with_damping(block)
    block.change(('name = "Block"', 'name = "Block"\ninclude = []'), add=RESPONSES)
    text = f"[cases.a]\nmodes = [{mode(1.05 * SHIFTS[1], 'y')}]\n"
    block.write(text + parameter("y"), name="targets")
    block(f"{IDENTIFY} --write fitted")
    block.change(("include = []", 'include = ["scene.fitted.toml"]'))
    printed = block.prints("run scene.toml --variant fitted -o run --no-figures")
    assert "± of lobes is without it" in printed
    summary = block.json("run/summary.json")
    point = summary["static"]["tcp"]
    # the head also tilts, which the fit does not move
    moved = point["error_share"]["y"]["fit"] / (1e3 / (9.0 * 1.05**2))
    assert moved == approx(2 * 1.959964 * 0.01, rel=0.03)
    assert point["error_share"]["x"]["fit"] == approx(0.0, abs=1e-6)
    shares = re.findall(r'"fit": ([-+.e\d]+)', json.dumps(summary["frf"]))
    # the response at rest is the compliance
    assert float(shares[-1]) == approx(point["error_share"]["y"]["fit"], rel=1e-6)


def test_held_out_targets_are_hidden_until_they_are_opened(block: Shell) -> None:
    held = mode(1.01 * SHIFTS[2], "z", ', name = "top", hold_out = true')
    text = f"[cases.a]\nmodes = [{mode(SHIFTS[1], 'y')}, {held}]\n"
    block.write(text + parameter("y"), name="targets")
    printed = block.prints(f"{IDENTIFY} --hide-held-out")
    (fitted, hidden) = block.json("out/identification.json")["targets"]
    assert fitted["measured"] == approx(SHIFTS[1])
    assert (hidden["name"], hidden["measured"], hidden["deviation"]) == ("a top", None, None)
    assert hidden["model"] == approx(SHIFTS[2])
    shown = f"{1.01 * SHIFTS[2]:.4g}"
    assert "hidden" in printed and shown not in printed
    opened = block.prints("identify --open out --json open.json")
    (row,) = block.json("open.json")["targets"]
    assert row["measured"] == approx(1.01 * SHIFTS[2])
    assert shown in opened and "-0.99 %" in opened
    assert "1 of 1 within ± and scatter; deviations 0.99 % rms" in opened
    assert "there are no hidden targets" in block.refuses("identify --open scene.toml")


def test_each_mode_is_predicted_by_a_fit_to_the_others(block: Shell) -> None:
    logs = np.log([1.03, 0.99, 1.0])
    along = [mode(hz, way) for hz, way in zip(SHIFTS * np.exp(logs), "xyz", strict=True)]
    free = f"{parameter('x')}multiplies = ['joints.feet.stiffness.y', 'joints.feet.stiffness.z']\n"
    block.write(f"[cases.a]\nmodes = [{', '.join(along)}]\n{free}", name="targets")
    printed = block.prints(f"{IDENTIFY} --leave-out-each")
    rows = block.json("out/identification.json")["left_out_each"]
    deviations = np.expm1((logs.sum() - logs) / 2.0 - logs)
    assert [row["deviation"] for row in rows] == approx(deviations, rel=1e-4)
    half = 1.959964 * 0.01 / np.sqrt(2.0)
    assert [row["relative_spread_95"] for row in rows] == approx([half] * 3, rel=1e-4)
    rms = 100.0 * np.sqrt(np.mean(deviations**2))
    assert re.search(r"fit 1 of 3 without a \d.*Hz: .* left", printed)
    assert re.search(r"fit 3 of 3 without a \d.*Hz: ", printed)
    assert "Each mode by a fit to the others" in printed
    assert f"1 of 3 within ± and scatter; deviations {rms:.2f} % rms" in printed


RIVALS = """
[rivals.one_spring]
without = ["y"]
[rivals.one_spring.parameters.x]
keys = ["joints.feet.stiffness.x", "joints.feet.stiffness.y"]
bounds = ["1 N/um", "50 N/um"]
[rivals.heavy]
set = { "materials.iron.rho" = "4000 kg/m^3" }
without = ["x", "y"]
parameters = { z = { keys = ["joints.feet.stiffness.z"], bounds = ["1 N/um", "50 N/um"] } }
"""


def test_other_models_are_ranked_by_evidence(block: Shell) -> None:
    along = [mode(SHIFTS[0], "x"), mode(1.02 * SHIFTS[1], "y"), mode(SHIFTS[2], "z")]
    text = f"[cases.a]\nmodes = [{', '.join(along)}]\n"
    block.write(text + parameter("x") + parameter("y") + RIVALS, name="targets")
    printed = block.prints(IDENTIFY)
    models = block.json("out/identification.json")["models"]
    assert list(models) == ["as written", "one_spring", "heavy"]
    written = models["as written"]
    assert (written["parameters"], written["data"]) == (2, 6)
    assert written["misfit"] == approx(0.0, abs=1e-6)
    # two bell curves of 2 % within bounds of a factor of 50
    assert written["log_evidence"] == approx(
        np.log(2.0 * np.pi * 0.02**2) - 2 * np.log(np.log(50.0))
    )
    # one stiffness for two frequencies that differ by a factor of 1.53; their shapes are then anyhow
    assert models["one_spring"]["misfit"] > 0.5 * np.log(1.53) ** 2 / 0.01**2
    assert 50.0 < models["heavy"]["misfit"] < models["one_spring"]["misfit"]
    order = [printed.rindex(f" {name} ") for name in ("as written", "heavy", "one_spring")]
    assert order == sorted(order)
    block.write(
        text + parameter("x") + parameter("y") + RIVALS.replace("rho", "row"), name="targets"
    )
    refused = block(IDENTIFY, code=2)
    assert "targets.toml: rivals.heavy.set: materials.iron.row" in " ".join(refused.err.split())
    assert "sum of squares" not in refused.out  # before anything is fitted


def test_measurements_are_suggested_for_what_the_data_leave_open(block: Shell) -> None:
    """Two springs along z of which the frequency shows the sum: what presses on one alone tells."""
    block.change(
        ("[joints.feet]", BOLTED),
        ('z = "16 N/um"', 'z = "8 N/um"'),
    )
    free = (
        parameter("z")
        + '[parameters.pad]\nkeys = ["joints.pad.stiffness.z"]\nbounds = ["1 N/um", "50 N/um"]\n'
    )
    block.write(
        f"[cases.a]\nmodes = [{mode(SHIFTS[2], 'z')}]\nnumbers = {{ 'compliance(point=tcp,direction=z)' = '62.5 um/kN' }}\n"
        + free,
        name="targets",
    )
    printed = block.prints(IDENTIFY)
    suggested = block.json("out/identification.json")["suggested"]
    assert suggested[0]["name"].startswith("a: ")
    assert suggested[0]["spread"] < 0.5 and suggested[0]["bits"] > 1.0
    assert "Suggested measurements" in printed


def test_a_machine_that_moves_freely_gets_suggestions_too(block: Shell) -> None:
    """It has no compliance; two masses in a row on one spring leave one of the stiffnesses open."""
    feet = SCENE[SCENE.index("[joints.feet]") : SCENE.index("[points.tcp]")]
    second = SCENE[SCENE.index("[components.block]") : SCENE.index("[joints.feet]")]
    block.change(
        (feet, second.replace("block", "other") + feet.replace("ground", "other.head")),
        ('name = "Block"', 'name = "Block"\nfree = true'),
    )
    hz = SHIFTS[0] * np.sqrt(2.0)
    text = f'[cases.a]\nmodes_above = "1 Hz"\nfrequencies = ["{hz:.9g} Hz"]\n'
    block.write(
        text
        + parameter("x")
        + "prior_sigma = 0.5\n"
        + parameter("ry").replace("N/um", "MN m/rad")
        + "prior_sigma = 0.5\n",
        name="targets",
    )
    block(IDENTIFY)
    suggested = block.json("out/identification.json")["suggested"]
    assert suggested and not any("compliance" in one["name"] for one in suggested)


SWAY_OR_TILT = """
[rivals.tilt]
set = { "joints.feet.stiffness" = { x = "4 N/nm", y = "4 N/nm", z = "4 N/nm", rx = "4 GN m/rad", ry = "0.8 MN m/rad", rz = "4 GN m/rad" } }
without = ["x"]
parameters = { ry = { keys = ["joints.feet.stiffness.ry"], bounds = ["0.2 MN m/rad", "4 MN m/rad"] } }
"""


def test_the_sensor_that_decides_between_two_models_comes_first(block: Shell) -> None:
    """At the head sway and tilt about the centre look alike, at the foot one has the other sign."""
    block.change(
        add='[sensors.low]\ncomponent = "block"\nat = ["500 mm", "0 mm", "0 mm"]\ndirections = ["x"]\n'
    )
    block.write(
        '[cases.a]\nfrequencies = ["10.5 Hz"]\n' + parameter("x") + SWAY_OR_TILT, name="targets"
    )
    printed = block.prints(IDENTIFY)
    found = block.json("out/identification.json")
    sensors = {row["name"]: row for row in found["sensors"]}
    # orthogonal shapes: 1 / (2 0.1^2), which no stiffness changes
    evidence = [
        next(iter(sensors[name]["log_evidence"].values()))
        for name in ("low x", "block.foot x", "tcp")
    ]
    assert evidence == approx([50.0, 50.0, 0.0], abs=1e-6)
    assert found["sensors"][0]["name"] in ("low x", "block.foot x")
    assert found["combinations"][0]["direction"] == {"x": 1.0}
    assert re.search(r"low x +50\.0 +0\.0 bit", printed) and "tcp alone" in printed


# beside the feet, half a metre off the middle: it resists rotation too
BOLTED = """[joints.pad]
between = ["ground", "block.foot"]
kind = "spring"
at = ["0 mm", "400 mm", "500 mm"]
stiffness = { z = "8 N/um" }
[joints.feet]"""


def test_a_record_of_forces_and_displacements_is_a_compliance_with_its_hysteresis(
    block: Shell,
) -> None:
    """Up and down along lines of 50 um/kN that lie 1 um apart: a parallelogram."""
    up = [(force, 50.0 * force / 1e3) for force in (0.0, 100.0, 200.0, 300.0, 400.0)]
    down = [(force, motion + 1.0) for force, motion in reversed(up)]
    record = ", ".join(f'["{force} N", "{motion} um"]' for force, motion in (*up, *down))
    target = f'{{ point = "tcp", motion = "z", force = "z", record = [{record}] }}'
    text = f"[cases.a]\ncompliances = [{target}]\n" + parameter("z")
    block.write(text, name="targets")
    printed = block.prints(IDENTIFY)
    found = block.json("out/identification.json")
    assert found["parameters"]["z"]["value"] == approx(20.0, rel=1e-6)
    line = found["records"]["a tcp dz/Fz"]
    assert line["residual"] == approx(0.5e-6)
    assert line["hysteresis"] == approx(400.0 * 1.0 / (400.0 * 21.0))
    # ten points half a micrometre off the line
    error = np.sqrt(10 * 0.5**2 / 8 / (2 * 1e5)) / 0.05
    assert line["error"] == approx(error)
    assert "a tcp dz/Fz: line of 50 um/kN" in printed
    reach = np.log(found["parameters"]["z"]["high_95"] / found["parameters"]["z"]["low_95"])
    assert reach == approx(2 * 1.959964 * error, rel=1e-4)
    block.write(text.replace("record =", 'value = "50 um/kN", record ='), name="targets")
    assert "needs either value" in block.refuses(IDENTIFY)


def test_a_record_of_a_file_repeats_its_cycles_in_its_own_units(block: Shell) -> None:
    """The same parallelogram three times over."""
    up = [(force / 1e3, 50.0 * force / 1e6) for force in (0.0, 100.0, 200.0, 300.0, 400.0)]
    pairs = [*up, *((force, motion + 0.001) for force, motion in reversed(up))] * 3
    rows = [f"{motion:.9f},{force:.9f}" for force, motion in pairs]
    file = block.folder / "push.csv"
    file.write_text("\n".join(["displacement [mm],force [kN]", *rows]))
    target = '{ point = "tcp", motion = "z", force = "z", record = "push.csv" }'
    found = identify(block, f"[cases.a]\ncompliances = [{target}]\n", parameter("z"))
    line = found["records"]["a tcp dz/Fz"]
    assert line["compliance"] == approx(50e-9) and line["residual"] == approx(0.5e-6)
    assert line["hysteresis"] == approx(400.0 * 1.0 / (400.0 * 21.0), rel=1e-6)
    file.write_text("force,displacement [mm]\n0,0\n1,1\n2,2\n")
    assert "column force has no unit" in block.refuses(IDENTIFY)
    file.write_text("force [N],displacement [mm]\n0,0\n1,1\n")
    assert "it holds 2 pairs" in block.refuses(IDENTIFY)


def test_the_published_push_is_fitted_by_the_drive(shell: Shell) -> None:
    """Its slope and the scatter about it are what the paper prints."""
    files = (MACHINES / "three_axis.toml", MACHINES / "three_axis_push_targets.toml")
    printed = shell.prints("identify -o out", *files)
    assert "line of 151 um/kN" in printed and "residual 0.2 um" in printed
    fitted, *held = shell.json("out/identification.json")["targets"]
    assert fitted["model"] == approx(151.0, rel=1e-4)
    assert [row["measured"] for row in held] == [9.3, 11.5]


def test_responses_come_from_a_file_of_test_data(block: Shell) -> None:
    """Driven and measured at point 7, which looks along -x: both signs cancel."""
    with_damping(block)
    block.change(('ry = "6 MN m/rad"', 'ry = "6e6 MN m/rad"'))
    block.change(add='[sensors.test]\nfile = "points.csv"\ncomponent = "block"\n')
    (block.folder / "points.csv").write_text("point,x [mm],y [mm],z [mm]\n7,500,0,500\n")
    hz = np.linspace(5.0, 20.0, 31, dtype=np.float64)
    omega = 2.0 * np.pi * hz
    values = 1.0 / (4.4e6 * (1.0 + 0.02j) - 1000.0 * omega**2 + 1j * omega * 3e3)
    along = (7, -1)
    text = points_15([7, 0, 0, 11, 0.5, 0.0, 0.5])
    text += text_58(values, hz=hz, kinds=(8, 13), motion=along, force=along)
    (block.folder / "test.uff").write_bytes(units(1, 1.0, 1.0) + text)
    entry = '{ file = "test.uff", sensors = "test", band = ["6 Hz", "16 Hz"], count = 9 }'
    found = identify(block, f"[cases.a]\nresponses = [{entry}]\n", DAMPINGS, parameter("x"))
    fitted = {name: item["value"] for name, item in found["parameters"].items()}
    assert fitted == approx({"x": 4.4, "viscous": 3.0, "structural": 0.02}, rel=1e-4)
    assert found["noise_by_kind"]["response"]["degrees_of_freedom"] == approx(15.0, abs=1e-6)
    block.write(
        f"[cases.a]\nresponses = [{entry.replace('6 Hz', '50 Hz', 1)}]\n" + DAMPINGS, name="targets"
    )
    assert "no line between 50 and 16 Hz" in block.refuses(IDENTIFY)
