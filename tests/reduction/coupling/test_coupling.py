"""Coupling at joints against matrices written out by hand."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg

from cases import cases
from common import approx, present
from headstock.geometry.frames import (
    DOF_NAMES,
    FloatArray,
    Frame,
    rigid_transfer,
    rotate_dofs,
    rotation_about,
)
from headstock.geometry.machine.joints import Axis
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Load
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import point_budget, point_compliance
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.validation.parts.closed_form_cases import _block_frequencies, _SprungBlock
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

HOME = Pose("home")
SPRING = (2.0e7, 3.0e7, 5.0e7, 1.0e6, 2.0e6, 3.0e6)
BLOCK = _SprungBlock((1.0, 0.8, 0.3), 230.0, (1.2e4, 1.2e4, 1.8e4))


def corner_block() -> tuple[dict[str, Superelement], Machine]:
    a, b, h = BLOCK.size
    inertia = [BLOCK.mass * (p**2 + q**2) / 12.0 for p, q in ((b, h), (a, h), (a, b))]
    corners = {
        f"c{i}": (x * a / 2, y * b / 2, 0.0)
        for i, (x, y) in enumerate([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    }
    body = rigid_body("block", BLOCK.mass, corners, inertia=inertia, center=(0.0, 0.0, h / 2))
    joints = [
        joint_between(f"air{i}", "ground", f"block.c{i}", stiffness=(*BLOCK.spring, 0, 0, 0))
        for i in range(4)
    ]
    return lumped_machine([body], joints, {"tcp": ("block.c0", "ground")})


def chain(
    fixed: tuple[int, ...] = (),
    stiffness: FloatArray | list[float] | tuple[float, float, float, float, float, float] = SPRING,
    rotation: FloatArray | None = None,
) -> tuple[dict[str, Superelement], Machine]:
    """A sprung column on a spring to ground, a rigid head on top of it."""
    column = two_node_body("column", 40.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))
    head = rigid_body(
        "head",
        12.0,
        {"seat": (0.0, 0.0, 0.5), "tool": (0.2, 0.0, 0.6)},
        center=(0.1, 0.05, 0.6),
        inertia=(0.2, 0.3, 0.4),
    )
    joints = [
        joint_between("foot", "ground", "column.foot", stiffness=SPRING),
        joint_between(
            "neck", "column.head", "head.seat", stiffness=stiffness, fixed=fixed, rotation=rotation
        ),
    ]
    return lumped_machine([column, head], joints, {"tcp": ("head.tool", "ground")})


def test_four_springs_under_a_block_give_the_closed_form_of_der_block() -> None:
    reference = [2.17143797, 2.21507305, 2.81593394, 3.98233196, 4.83549625, 4.84907185]
    found = solve_modal(couple(*corner_block(), HOME).system).frequencies_hz
    np.testing.assert_allclose(found, reference, rtol=1e-8)
    np.testing.assert_allclose(found, _block_frequencies(BLOCK), rtol=1e-12)


def test_a_spring_joint_adds_its_matrix_between_both_ends_in_its_own_axes() -> None:
    turn = rotation_about(np.array([1.0, -2.0, 0.5]), 0.8)
    superelements, machine = chain(rotation=turn)
    coupled = couple(superelements, machine, HOME)
    head_arm = rigid_transfer(np.array([0.1, 0.05, 0.6]), np.array([0.0, 0.0, 0.5]))
    difference = np.hstack([np.zeros((6, 6)), -np.eye(6), head_arm])
    axes = rotate_dofs(turn)
    expected = scipy.linalg.block_diag(superelements["column"].stiffness, np.zeros((6, 6)))
    expected[:6, :6] += np.diag(SPRING)
    expected += difference.T @ axes @ np.diag(SPRING) @ axes.T @ difference
    expected = coupled.basis.T @ expected @ coupled.basis
    np.testing.assert_allclose(
        coupled.system.stiffness, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max()
    )


def test_rigidly_joined_bodies_equal_the_one_body_they_make() -> None:
    a = rigid_body(
        "a", 30.0, {"foot": (0, 0, 0), "top": (0, 0, 0.4)}, inertia=(1, 2, 3), center=(0, 0, 0.2)
    )
    b = rigid_body(
        "b",
        20.0,
        {"seat": (0, 0, 0.4), "tip": (0.3, 0, 0.5)},
        inertia=(2, 1, 0.5),
        center=(0.2, 0.1, 0.5),
    )
    joints = [joint_between("foot", "ground", "a.foot", stiffness=SPRING)]
    weld = joint_between("weld", "a.top", "b.seat", fixed=range(6))
    found = couple(*lumped_machine([a, b], [*joints, weld], {"tcp": ("b.tip", "ground")}), HOME)
    middles: list[FloatArray] = [np.array([0.0, 0.0, 0.2]), np.array([0.2, 0.1, 0.5])]
    center = np.average(middles, axis=0, weights=[30.0, 20.0])
    levers = [rigid_transfer(center, place) for place in middles]
    mass = levers[0].T @ a[1].mass @ levers[0] + levers[1].T @ b[1].mass @ levers[1]
    stiffness = (
        rigid_transfer(center, np.zeros(3)).T
        @ np.diag(SPRING)
        @ rigid_transfer(center, np.zeros(3))
    )
    expected = np.sqrt(scipy.linalg.eigvalsh(mass, stiffness)[::-1] ** -1.0) / (2.0 * np.pi)
    np.testing.assert_allclose(solve_modal(found.system).frequencies_hz, expected, rtol=1e-12)
    tip = rigid_transfer(center, np.array([0.3, 0.0, 0.5]))
    compliance = tip @ np.linalg.solve(stiffness, tip.T)
    np.testing.assert_allclose(
        point_compliance(found, "tcp"), compliance, rtol=0.0, atol=1e-12 * np.abs(compliance).max()
    )


@pytest.mark.parametrize("fixed", [(0,), (0, 1, 2), (0, 1, 2, 3, 4), tuple(range(6))])
def test_fixed_dofs_equal_lagrange_multipliers(fixed: tuple[int, ...]) -> None:
    free = [0.0 if dof in fixed else SPRING[dof] for dof in range(6)]
    superelements, machine = chain(fixed, free)
    coupled = couple(superelements, machine, HOME)
    head_arm = rigid_transfer(np.array([0.1, 0.05, 0.6]), np.array([0.0, 0.0, 0.5]))
    difference = np.hstack([np.zeros((6, 6)), -np.eye(6), head_arm])
    stiffness = scipy.linalg.block_diag(superelements["column"].stiffness, np.zeros((6, 6)))
    stiffness[:6, :6] += np.diag(SPRING)
    stiffness += difference.T @ np.diag(free) @ difference
    rows = 1e8 * difference[list(fixed)]
    saddle = np.block([[stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    tool = np.hstack(
        [np.zeros((6, 12)), rigid_transfer(np.array([0.1, 0.05, 0.6]), np.array([0.2, 0.0, 0.6]))]
    )
    load = np.vstack([tool.T, np.zeros((len(rows), 6))])
    expected = tool @ np.linalg.solve(saddle, load)[:18]
    np.testing.assert_allclose(
        point_compliance(coupled, "tcp"), expected, rtol=0.0, atol=1e-10 * np.abs(expected).max()
    )
    assert len(coupled.system.labels) == 18 - len(fixed)


def test_motions_fixed_twice_are_counted_and_change_nothing() -> None:
    superelements, machine = chain(tuple(range(6)), (0.0,) * 6)
    twin = dataclasses.replace(machine.joints["neck"], name="twin")
    double = dataclasses.replace(machine, joints=machine.joints | {"twin": twin})
    found, single = couple(superelements, double, HOME), couple(superelements, machine, HOME)
    assert single.redundant_constraints == 0
    assert found.redundant_constraints == 6
    assert any("fixed more than once" in text and "twin" in text for text in found.warnings)
    expected = solve_modal(single.system).frequencies_hz
    np.testing.assert_allclose(solve_modal(found.system).frequencies_hz, expected, rtol=1e-11)


def test_compliance_at_a_point_is_tool_relative_to_work_at_the_tool() -> None:
    superelements, machine = chain()
    between = lumped_machine([], [], {"pair": ("head.tool", "column.foot")})[1].points
    coupled = couple(
        superelements, dataclasses.replace(machine, points=machine.points | between), HOME
    )
    tool, foot = (
        np.vstack([coupled.system.outputs[end, dof] for dof in DOF_NAMES])
        for end in ("head.tool", "column.foot")
    )
    relative = tool - rigid_transfer(np.zeros(3), np.array([0.2, 0.0, 0.6])) @ foot
    found = np.vstack([coupled.system.outputs["pair", dof] for dof in DOF_NAMES])
    np.testing.assert_allclose(found, relative, rtol=0.0, atol=1e-14)
    # the ground spring does not matter between foot and head
    soft = dataclasses.replace(machine.joints["foot"], stiffness=0.1 * np.diag(SPRING))
    changed = dataclasses.replace(
        machine, joints=machine.joints | {"foot": soft}, points=machine.points | between
    )
    expected = point_compliance(coupled, "pair")
    np.testing.assert_allclose(
        point_compliance(couple(superelements, changed, HOME), "pair"),
        expected,
        rtol=0.0,
        atol=1e-11 * np.abs(expected).max(),
    )


def test_an_axis_moves_its_bodies_and_the_joint_moves_with_its_first_end() -> None:
    slider = rigid_body(
        "slider",
        10.0,
        {"bed": (0, 0, 0), "tool": (0, 0, 0.1)},
        center=(0, 0, 0.05),
        inertia=(0.1, 0.1, 0.1),
    )
    bed = rigid_body(
        "bed",
        100.0,
        {"rail": (0, 0, 0), "foot": (0, 0, -0.2)},
        center=(0, 0, -0.1),
        inertia=(5, 5, 5),
    )
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=SPRING),
        joint_between("guide", "slider.bed", "bed.rail", stiffness=SPRING),
    ]
    superelements, machine = lumped_machine(
        [bed, slider], joints, {"tcp": ("slider.tool", "ground")}
    )
    axis = Axis("X", ("guide",), ("slider",), np.array([1.0, 0.0, 0.0]))
    moved = couple(
        superelements, dataclasses.replace(machine, axes={"X": axis}), Pose("out", {"X": 0.3})
    )
    np.testing.assert_allclose(moved.joint_springs[1].frame.origin, [0.3, 0.0, 0.0])
    placed = rigid_body(
        "slider", 10.0, {"bed": (0, 0, 0), "tool": (0, 0, 0.1)}, center=(0, 0, 0.05), inertia=(0.1, 0.1, 0.1),
        placement=Frame(np.array([0.3, 0.0, 0.0])),
    )  # fmt: skip
    there = couple(*lumped_machine([bed, placed], joints, {"tcp": ("slider.tool", "ground")}), HOME)
    np.testing.assert_allclose(moved.system.stiffness, there.system.stiffness, rtol=1e-14)
    assert not np.allclose(
        point_compliance(moved, "tcp"),
        point_compliance(couple(superelements, machine, HOME), "tcp"),
        atol=0.0,
    )


def test_gravity_sags_a_block_by_weight_over_stiffness_and_a_force_load_acts_in_machine_axes() -> (
    None
):
    superelements, machine = corner_block()
    push = Load("push", "block", "force", interface="c0", vector=(100.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    coupled = couple(
        superelements,
        dataclasses.replace(machine, loads={"push": push}),
        HOME,
        gravity=np.array([0.0, 0.0, -9.81]),
    )
    row = coupled.system.outputs["block.c0", "z"]
    gravity_deflection = row @ solve_static(coupled.system, coupled.loads["gravity"]).displacements
    assert gravity_deflection == approx(-230.0 * 9.81 / (4 * 1.8e4), rel=1e-12)
    np.testing.assert_allclose(
        coupled.loads["push"], 100.0 * coupled.system.inputs["block.c0", "x"], rtol=1e-14
    )


def test_a_turning_axis_keeps_gravity_upright() -> None:
    superelements, machine = corner_block()
    axis = Axis("B", (), ("block",), np.array([0.0, 1.0, 0.0]), kind="rotary")
    coupled = couple(
        superelements,
        dataclasses.replace(machine, axes={"B": axis}),
        Pose("tilted", {"B": 0.5}),
        gravity=np.array([0, 0, -9.81]),
    )
    np.testing.assert_allclose(
        coupled.loads["gravity"], [0.0, 0.0, -230.0 * 9.81, 0.0, 0.0, 0.0], atol=1e-10
    )


def test_damping_of_joints_is_coupled_like_their_stiffness() -> None:
    superelements, machine = chain()
    damped = {
        name: dataclasses.replace(joint, damping=1e-4 * joint.stiffness)
        for name, joint in machine.joints.items()
    }
    system = couple(superelements, dataclasses.replace(machine, joints=damped), HOME).system
    rigid = {
        name: dataclasses.replace(part, stiffness=0.0 * part.stiffness)
        for name, part in superelements.items()
    }
    only_joints = couple(rigid, machine, HOME).system.stiffness
    np.testing.assert_allclose(present(system.damping), 1e-4 * only_joints, rtol=1e-13, atol=1e-9)
    assert couple(superelements, machine, HOME).system.damping is None


def test_a_component_that_is_fixed_but_not_marked_so_is_refused() -> None:
    superelements, machine = chain()
    grounded = dataclasses.replace(
        superelements["column"], stiffness=superelements["column"].stiffness + 1e6 * np.eye(12)
    )
    with pytest.raises(AccuracyError, match=r"'column'.*supported"):
        couple(superelements | {"column": grounded}, machine, HOME)


@cases
def test_a_joint_to_what_does_not_exist_is_named(end: str, text: str) -> None:
    superelements, machine = chain()
    with pytest.raises(ModelError, match=text):
        couple(
            superelements,
            dataclasses.replace(machine, joints={"lost": joint_between("lost", "ground", end)}),
            HOME,
        )


@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 30.0], ids=["1 mN/m", "1 N/m", "30 N/m"])
def test_a_body_on_springs_far_softer_than_itself_keeps_their_digits(stiffness: float) -> None:
    turn = rotation_about(np.array([1.0, -2.0, 0.5]), 0.8)
    body = two_node_body("column", 40.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))
    joint = joint_between(
        "mount", "ground", "column.foot", stiffness=(stiffness,) * 6, rotation=turn
    )
    coupled = couple(*lumped_machine([body], [joint], {"tcp": ("column.head", "ground")}), HOME)
    compliance = point_budget(coupled, "tcp").compliance
    arm = rigid_transfer(np.zeros(3), np.array([0.0, 0.0, 0.5]))
    np.testing.assert_allclose(
        compliance, arm @ arm.T / stiffness, rtol=2e-6 * max(stiffness, 1.0), atol=1e-9 / stiffness
    )
    element = body[1]
    motions = rigid_motions(element, element.frames[element.interface_maps["foot"].node].origin)
    mass = motions.T @ element.mass @ motions
    rigid = np.sqrt(stiffness * scipy.linalg.eigvalsh(np.eye(6), mass)) / (2.0 * np.pi)
    np.testing.assert_allclose(
        solve_modal(coupled.system, count=6).frequencies_hz, rigid, rtol=2e-6 * max(stiffness, 1.0)
    )
