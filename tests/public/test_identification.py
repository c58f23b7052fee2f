"""``headstock identify``: what it says of parameters and targets of a block whose modes are closed
forms.
"""

from typing import Any

import numpy as np
import pytest

from common import Shell, approx
from fixture_machines import stored_scene

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
