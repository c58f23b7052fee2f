"""Geometric stiffness under a machine's own weight: pendulums and a column in closed form."""

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.drives import place_drives, release_motors
from headstock.reduction.motions.compliance_budget import WEIGHT, find_weakest_link, point_budget
from headstock.reduction.motions.tool_deviation import FORCES, solve_deviation
from headstock.scene.building.loader import load_scene
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.stability import find_loop_poles
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from scene_runs import couple_parts

G = 9.80665
HEAD = stored_scene("gravity_stiffness_head")
PIN = '[joints.pin]\nbetween = ["bar.top", "ground"]\nkind = "revolute"\naxis = "y"\n'
LOWER = stored_scene("gravity_stiffness_lower")
POST = """
[joints.foot]
between = ["ground", "bar.low"]
kind = "spring"
stiffness = { x = "rigid", y = "rigid", z = "rigid", rx = "rigid", ry = "2 kN m/rad", rz = "rigid" }
"""
COLUMN = """
[joints.foot]
between = ["ground", "bar.low"]
kind = "rigid"
"""


def couple_text(folder: Path, text: str) -> CoupledMachine:
    scene = load_scene(write_scene(folder, text))
    return couple_parts(scene.machine, next(iter(scene.poses.values())))


def bar(length: float) -> tuple[float, float]:
    """Mass, and inertia about its centre across the swing."""
    mass = 7850.0 * 0.04 * 0.06 * length
    return mass, mass * (0.04**2 + length**2) / 12.0


def test_a_hanging_bar_swings_as_a_pendulum(tmp_path: Path) -> None:
    found = solve_modal(couple_text(tmp_path, HEAD + PIN).system).frequencies_hz
    mass, inertia = bar(0.5)
    expected = math.sqrt(mass * G * 0.25 / (inertia + mass * 0.25**2)) / (2.0 * math.pi)
    np.testing.assert_allclose(found, [expected], rtol=1e-9)


def test_a_bar_that_stands_on_a_spring_loses_its_weight_times_its_height(tmp_path: Path) -> None:
    found = solve_modal(couple_text(tmp_path, HEAD + POST).system).frequencies_hz
    mass, inertia = bar(0.5)
    left = 2e3 - mass * G * 0.25
    expected = math.sqrt(left / (inertia + mass * 0.25**2)) / (2.0 * math.pi)
    np.testing.assert_allclose(found, [expected], rtol=1e-9)


@pytest.mark.parametrize("ends", ['["second.top", "bar.low"]', '["bar.low", "second.top"]'])
def test_two_bars_swing_as_a_double_pendulum(tmp_path: Path, ends: str) -> None:
    """Lagrange's equations in the two angles; the pins' forces are constraint forces."""
    text = HEAD + PIN + LOWER.replace("ENDS", ends)
    found = solve_modal(couple_text(tmp_path, text).system).frequencies_hz
    (m1, i1), (m2, i2) = bar(0.5), bar(0.3)
    mass = np.array(
        [[i1 + m1 * 0.25**2 + m2 * 0.5**2, m2 * 0.5 * 0.15], [m2 * 0.5 * 0.15, i2 + m2 * 0.15**2]]
    )
    stiffness = G * np.diag([m1 * 0.25 + m2 * 0.5, m2 * 0.15])
    squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    np.testing.assert_allclose(found, np.sqrt(squares) / (2.0 * math.pi), rtol=1e-9)


def column_stiffness(folder: Path, count: int, *, stiffening: bool) -> FloatArray:
    """Of a slender column in segments, clamped at its foot."""
    text = HEAD.replace('"500 mm"]', '"3 m"]') + COLUMN
    text = text.replace('fidelity = "rigid"', f'fidelity = "segmented"\nsegments.count = {count}')
    if not stiffening:
        text = text.replace("gravity_stiffening = true\n", "")
    return couple_text(folder, text).system.stiffness


def test_a_column_buckles_at_greenhills_weight(tmp_path: Path) -> None:
    """q L^3 / (E I) = 7.837 for a column under its own weight, clamped at its foot."""
    misses = []
    for count in (10, 20):
        plain = column_stiffness(tmp_path, count, stiffening=False)
        loaded = column_stiffness(tmp_path, count, stiffening=True)
        # K x = load (K - K_loaded) x, the largest of 1 / load
        inverse = scipy.linalg.eigh(plain - loaded, plain, eigvals_only=True)[-1]
        weight = 7850.0 * 0.04 * 0.06 * G / inverse
        misses.append(weight * 3.0**3 / (210e9 * 0.06 * 0.04**3 / 12.0) / 7.8373 - 1.0)
    # second order in the length of a segment; shear takes 2e-4 off
    assert abs(misses[1]) < 5e-3
    assert abs(misses[0] + 2e-4) == approx(4.0 * abs(misses[1] + 2e-4), rel=0.25)


def test_a_machine_that_falls_has_no_balance(tmp_path: Path) -> None:
    text = HEAD + PIN.replace('"revolute"', '"prismatic"').replace('"y"', '"z"')
    with pytest.raises(ModelError, match="gravity moves what no joint holds"):
        couple_text(tmp_path, text)


DRIVEN = stored_scene("gravity_stiffness_driven")
CART = """
[components.cart]
solid = { box = ["200 mm", "200 mm", "100 mm"] }
material = "steel"
at = ["0 mm", "0 mm", "500 mm"]
fidelity = "rigid"
interfaces = { top = { face = "z+" }, low = { face = "z-" } }
"""
CONTROLLED = HEAD.replace("gravity = true\n", "gravity = true\ndrive_control = true\n")


def release_text(folder: Path, text: str) -> tuple[CoupledMachine, tuple[DriveTrain, ...]]:
    coupled = couple_text(folder, text)
    scene = load_scene(folder / "scene.toml")
    trains = place_drives(coupled, scene.machine, scene.drives.values())
    return release_motors(coupled, trains), trains


def test_a_pendulum_on_a_controlled_axis_has_the_poles_of_its_equations_of_motion(
    tmp_path: Path,
) -> None:
    way = DRIVEN.replace("CARRIED", '["cart.top", "ground"]').replace("WAY", '"prismatic"')
    pin = PIN.replace('"ground"', '"cart.low"')
    released, trains = release_text(tmp_path, CONTROLLED + CART + pin + way)
    found = find_loop_poles(close_loops(released.system, trains)).poles
    (mass, inertia), cart = bar(0.5), 7850.0 * 0.2 * 0.2 * 0.1
    motor, k, kp, kv = 2e-4 / (0.01 / (2.0 * math.pi)) ** 2, 2e6, 500.0, 20.0
    # motor, cart, angle; a P-P cascade is a damper and a spring at the motor
    lever = mass * 0.25
    m = np.array([[motor, 0, 0], [0, cart + mass, lever], [0, lever, inertia + lever * 0.25]])
    c = np.diag([kp, 0.0, 0.0])
    stiffness = np.array([[k + kp * kv, -k, 0], [-k, k, 0], [0, 0, lever * G]])
    inverse = np.linalg.inv(m)
    first_order = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ c]])
    expected = np.linalg.eigvals(first_order)
    assert len(found) >= 3
    for pole in found:
        assert np.abs(expected - pole).min() < 1e-8 * abs(pole)


@pytest.mark.parametrize("first", ["cart", "bar"])
def test_the_weight_of_a_free_axis_travels_over_a_base_that_tilts(
    tmp_path: Path, first: str
) -> None:
    """Second order of ``V = g (M h cos t + m (H cos t - d sin t + c cos p))``: ``t`` of the base,
    ``p`` of the cart, ``d`` of the travel along the line that lies in the end named second.
    """
    ends = '["cart.low", "bar.top"]' if first == "cart" else '["bar.top", "cart.low"]'
    springs = (
        'stiffness = { lateral = "200 N/um", normal = "300 N/um", roll = "1e6 N m/rad",'
        ' pitch = "1e6 N m/rad", yaw = "1e6 N m/rad" }'
    )
    way = DRIVEN.replace("CARRIED", ends).replace("WAY", f'"linear_guide"\n{springs}', 1)
    geometric = []
    for switch in ("true", "false"):
        text = CONTROLLED.replace("stiffening = true", f"stiffening = {switch}") + CART + POST + way
        released, _ = release_text(tmp_path, text)
        geometric.append(released)
    plain = geometric[1].system
    change = geometric[0].system.stiffness - plain.stiffness
    rows = [("cart.low", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")] + [("bar.top", "ry")]
    seen = np.array([*(plain.outputs[row] for row in rows), plain.outputs["X", "motor"]])
    motions = np.linalg.inv(seen)
    # travel, tilt of the base, tilt of the cart: the joint's point goes along H t + d
    picked = motions[:, [0, 6, 4]] @ np.array([[1.0, 0.5, 0.0], [0, 1, 0], [0, 0, 1]])
    (mass, _), cart = bar(0.5), 7850.0 * 0.2 * 0.2 * 0.1
    line = 1 if first == "cart" else 2
    expected = np.diag([0.0, -mass * G * 0.25 - cart * G * 0.5, -cart * G * 0.05])
    expected[0, line] = expected[line, 0] = -cart * G
    found = picked.T @ change @ picked
    # the guide sags by 1 um under the weight, which the sketch leaves out
    np.testing.assert_allclose(found, expected, atol=1e-5 * cart * G)


TIP = """
[points]
tip = { tool = "bar.top", work = "ground" }
[loads]
push = { at = "bar.top", force = ["10 N", "0 N", "0 N"] }
"""


def test_budgets_have_the_part_of_the_weight(tmp_path: Path) -> None:
    """A bar on a turning spring: what the weight takes of its stiffness is a part of the compliance at
    its tip, and of the way of the tip under a force, with the spring's more than all of them.
    """
    coupled = couple_text(tmp_path, HEAD + POST + TIP)
    taken = bar(0.5)[0] * G * 0.25
    left = 2e3 - taken
    budget = point_budget(coupled, "tip")
    assert budget.compliance[0, 0] == approx(0.5**2 / left, rel=1e-9)
    shares = budget.shares["x"]
    assert shares["foot"] == approx(2e3 / left, rel=1e-9)
    assert shares[WEIGHT] == approx(-taken / left, rel=1e-9)
    assert find_weakest_link(coupled, "tip", "x", budget) is None  # a part alone
    machine = load_scene(tmp_path / "scene.toml").machine
    found = solve_deviation(coupled, machine, "tip")
    parts = found.parts[FORCES]
    assert found.sources[FORCES][0] == approx(10.0 * 0.5**2 / left, rel=1e-9)
    assert parts["foot"][0] + parts[WEIGHT][0] == approx(found.sources[FORCES][0], rel=1e-9)
    assert parts[WEIGHT][0] == approx(-10.0 * 0.5**2 * taken / left**2, rel=1e-9)
