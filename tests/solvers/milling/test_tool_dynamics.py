"""Spindle and tool on a machine: coupling by receptances is the same as one system of all dofs."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.milling.tool_dynamics import (
    MeasuredAssembly,
    ToolMode,
    attach_tool_modes,
    couple_assembly,
    split_tip_motion,
)
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

TURN = 2.0 * np.pi
CHANNELS = [("tcp", axis) for axis in "xyz"]
LATERAL = np.eye(3)[:, :2]


@pytest.fixture(scope="module")
def machine() -> SecondOrderSystem:
    """Eight dofs, all of which move the point in all directions."""
    draw = np.random.default_rng(3)
    rows = draw.standard_normal((3, 8))
    square = draw.standard_normal((8, 8))
    mass = 40.0 * np.eye(8) + square @ square.T
    turned = np.linalg.qr(draw.standard_normal((8, 8)))[0]
    stiffness = turned @ np.diag(40.0 * (TURN * np.linspace(60.0, 700.0, 8)) ** 2) @ turned.T
    channels = {channel: rows[axis] for axis, channel in enumerate(CHANNELS)}
    return SecondOrderSystem(
        mass, 2e-5 * stiffness, stiffness, channels, dict(channels), tuple("abcdefgh")
    )


MODES = (
    ToolMode("spindle", 640.0, 0.03, 4e7, LATERAL),
    ToolMode("holder", 1500.0, 0.02, 3e7, np.array([[0.6], [0.0], [0.8]])),
    ToolMode("tool", 2300.0, 0.01, 1.5e7, LATERAL),
)


def receptance(system: SecondOrderSystem, omega: FloatArray) -> ComplexArray:
    return solve_frf(
        system, np.asarray(omega / TURN, dtype=float), inputs=CHANNELS, outputs=CHANNELS
    ).receptance


def test_modes_coupled_by_receptances_are_one_system(machine: SecondOrderSystem) -> None:
    omega = TURN * np.linspace(5.0, 4000.0, 300)
    expected = receptance(attach_tool_modes(machine, "tcp", MODES), omega)
    found = couple_assembly(receptance(machine, omega), omega, MODES)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


def test_a_mode_on_a_rigid_machine_has_its_own_frequency() -> None:
    rigid: ComplexArray = np.asarray(1e-20 * np.eye(3)[None], dtype=complex)
    (mode,) = MODES[:1]
    omega = np.array([TURN * mode.hz])
    found = couple_assembly(rigid, omega, [mode])[0, 0, 0]
    # at the natural frequency the inertia cancels the spring: what is left is the damper
    assert found == approx(1.0 / (2j * mode.damping * mode.stiffness))
    assert mode.stiffness / mode.mass == approx((TURN * mode.hz) ** 2)


def test_parts_of_the_motion_add_up(machine: SecondOrderSystem) -> None:
    omega = TURN * np.array([90.0, 640.0, 2300.0])
    own = receptance(machine, omega)
    force = np.array([[1.0, 0.5j, 0.2]] * 3)
    split = split_tip_motion(own, omega, MODES, force)
    below = (own @ split.base_force[:, :, None])[:, :, 0]
    whole = (couple_assembly(own, omega, MODES) @ force[:, :, None])[:, :, 0]
    np.testing.assert_allclose(split.parts.sum(axis=0) + below, whole, rtol=1e-9)


def test_a_measured_assembly_couples_like_its_masses_and_springs(
    machine: SecondOrderSystem,
) -> None:
    """Two masses on a spring, free: their receptances in closed form, and the same two on the
    machine as one system.
    """
    base_mass, mode = 6.0, ToolMode("tool", 900.0, 0.02, 3e7, LATERAL)
    lines = np.linspace(50.0, 3000.0, 200, dtype=np.float64)
    omega = TURN * lines
    spring = mode.stiffness + 1j * omega * mode.damper
    first, second = spring - omega**2 * base_mass, spring - omega**2 * mode.mass
    both = first * second - spring**2
    measured = MeasuredAssembly(lines, first / both, spring / both, second / both, LATERAL)
    rows = np.array([machine.outputs[channel] for channel in CHANNELS])
    heavier = SecondOrderSystem(
        machine.mass + base_mass * rows[:2].T @ rows[:2],
        machine.damping,
        machine.stiffness,
        machine.inputs,
        machine.outputs,
        machine.labels,
    )
    expected = receptance(attach_tool_modes(heavier, "tcp", [mode]), omega)
    found = couple_assembly(receptance(machine, omega), omega, measured)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())
    force = np.ones((len(omega), 3)) + 0j
    split = split_tip_motion(receptance(machine, omega), omega, measured, force)
    whole = (expected @ force[:, :, None])[:, :, 0]
    below = (receptance(machine, omega) @ split.base_force[:, :, None])[:, :, 0]
    np.testing.assert_allclose(
        split.parts[0] + below, whole, rtol=1e-6, atol=1e-9 * np.abs(whole).max()
    )


def test_attached_modes_keep_the_machine_at_rest(machine: SecondOrderSystem) -> None:
    whole = attach_tool_modes(machine, "tcp", MODES)
    assert len(whole.mass) == len(machine.mass) + 5
    assert solve_modal(whole).rigid_count == 0
    np.testing.assert_allclose(whole.mass, whole.mass.T)
