"""zero, negative and absurdly high frequencies: statics or "free body", the conjugate, and
inertia.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from common import present
from headstock.geometry.machine.machine import Pose
from headstock.reduction.coupling.coupling import couple
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.second_order import SecondOrderSystem
from lumped_machines import joint_between, lumped_machine, rigid_body

pytestmark = pytest.mark.hard("H28")

FREQUENCIES = np.array([1e-9, 0.3, 40.0, 777.0, 1e5, 1e9])
SPRING = (5e7, 6e7, 8e7, 1e5, 2e5, 1e5)


def two_bodies(*, grounded: bool) -> SecondOrderSystem:
    base = rigid_body(
        "base", 80.0, {"low": (0, 0, 0), "top": (0.1, 0.2, 0.3)}, inertia=(3.0, 4.0, 5.0)
    )
    head = rigid_body(
        "head", 12.0, {"seat": (0, 0, 0), "tool": (0.2, 0.1, -0.1)}, inertia=(0.3, 0.2, 0.1)
    )
    joints = [joint_between("guide", "base.top", "head.seat", stiffness=SPRING)]
    if grounded:
        joints.append(
            joint_between("mounts", "ground", "base.low", stiffness=(1e6, 1e6, 3e6, 2e5, 2e5, 1e5))
        )
    points = {"tcp": ("head.tool", "base.top"), "tool": ("head.tool", "ground")}
    return couple(*lumped_machine([base, head], joints, points), Pose("home")).system


def dampings(system: SecondOrderSystem) -> Iterator[tuple[str, SecondOrderSystem]]:
    lines = np.random.default_rng(1).standard_normal((len(system.mass), 3))
    yield "modal", add_modal_damping(system, [0.02])
    yield "coupled", dataclasses.replace(system, damping=100.0 * lines @ lines.T)
    yield (
        "structural",
        dataclasses.replace(system, hysteretic=0.03 * system.stiffness + 1e4 * lines @ lines.T),
    )


CHANNELS = [(place, dof) for place in ("tcp", "tool") for dof in ("x", "y", "z")]


@pytest.mark.parametrize("name", ["modal", "coupled", "structural"])
def test_negative_frequencies_give_the_conjugate_and_ports_are_reciprocal(name: str) -> None:
    system = dict(dampings(two_bodies(grounded=True)))[name]
    forth = solve_frf(system, FREQUENCIES, inputs=CHANNELS, outputs=CHANNELS).receptance
    back = solve_frf(system, -FREQUENCIES, inputs=CHANNELS, outputs=CHANNELS).receptance
    size = np.abs(forth).max(axis=(1, 2), keepdims=True)
    assert np.isfinite(forth).all()
    assert (np.abs(back - forth.conj()) <= 1e-12 * size).all()
    assert (np.abs(forth - forth.transpose(0, 2, 1)) <= 1e-10 * size).all()


def test_a_conjugate_is_what_the_equations_of_a_negative_frequency_give() -> None:
    system = dict(dampings(two_bodies(grounded=True)))["coupled"]
    omega = -2.0 * np.pi * 40.0
    rows = np.array([system.outputs[channel] for channel in CHANNELS])
    dynamic = system.stiffness - omega**2 * system.mass + 1j * omega * present(system.damping)
    found = solve_frf(system, np.array([-40.0]), inputs=CHANNELS, outputs=CHANNELS).receptance[0]
    np.testing.assert_allclose(
        found, rows @ np.linalg.solve(dynamic, rows.T), rtol=1e-8, atol=1e-12 * np.abs(found).max()
    )


@pytest.mark.parametrize("name", ["modal", "coupled", "structural"])
def test_at_a_gigahertz_only_inertia_is_left(name: str) -> None:
    system = dict(dampings(two_bodies(grounded=True)))[name]
    rows = np.array([system.outputs[channel] for channel in CHANNELS])
    omega = 2.0 * np.pi * 1e9
    inertia = -rows @ np.linalg.solve(system.mass, rows.T) / omega**2
    found = solve_frf(system, np.array([1e9]), inputs=CHANNELS, outputs=CHANNELS).receptance[0]
    np.testing.assert_allclose(found, inertia, rtol=1e-5, atol=1e-5 * np.abs(inertia).max())


def test_a_machine_that_floats_answers_between_tool_and_work_and_is_named_free_elsewhere() -> None:
    system = two_bodies(grounded=False)
    found = solve_frf(system, np.array([0.0, 1e-3]), inputs=CHANNELS, outputs=CHANNELS)
    inner, outer = slice(0, 3), slice(3, 6)
    assert not found.free_body[0, inner, inner].any() and not found.free_body[1].any()
    assert found.free_body[0, outer, outer].any(axis=1).all()
    assert np.isfinite(found.receptance[0, inner, inner]).all()
    # the work carries its share of the inertia, so that the gap does not open as under a static
    # force on a fixed base
    np.testing.assert_allclose(
        found.receptance[0, inner, inner], found.receptance[1, inner, inner], rtol=1e-6
    )
    assert np.isnan(found.receptance[found.free_body]).all()
