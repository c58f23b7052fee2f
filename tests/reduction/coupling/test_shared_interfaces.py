"""interfaces that share nodes are tied by rows; the result is that of the merged model."""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import Frame, rigid_transfer
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import point_compliance
from headstock.reduction.superelement import InterfaceMap, Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, two_node_body

pytestmark = pytest.mark.hard("H13")

HOME = Pose("home")
SPRING = (2e7, 3e7, 5e7, 1e6, 2e6, 3e6)
SIDE = np.array([0.1, 0.0, 0.5])


def split_head(superelement: Superelement) -> Superelement:
    """The same column with a third node ``side`` that rides rigidly on ``head``: six rows tie it,
    its matrices are shared out.
    """
    ride = np.zeros((18, 12))
    ride[:12] = np.eye(12)
    ride[12:, 6:] = rigid_transfer(np.array([0.0, 0.0, 0.5]), SIDE)
    rows = np.hstack([-ride[12:], np.eye(6)])
    # half of the head's motion is read from the side node
    back = rigid_transfer(SIDE, np.array([0.0, 0.0, 0.5]))
    share = np.zeros((12, 18))
    share[:6, :6] = np.eye(6)
    share[6:, 6:12], share[6:, 12:] = 0.5 * np.eye(6), 0.5 * back
    return dataclasses.replace(
        superelement,
        labels=(*superelement.labels, *(("side", dof) for _, dof in superelement.labels[:6])),
        frames=(*superelement.frames, Frame(SIDE)),
        interface_maps=superelement.interface_maps | {"side": InterfaceMap(2, Frame(SIDE))},
        stiffness=share.T @ superelement.stiffness @ share,
        mass=share.T @ superelement.mass @ share,
        constraints=rows,
    )


def machines() -> tuple[
    tuple[dict[str, Superelement], Machine], tuple[dict[str, Superelement], Machine]
]:
    component, merged = two_node_body("column", 40.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))
    one = dataclasses.replace(
        merged, interface_maps=merged.interface_maps | {"side": InterfaceMap(1, Frame(SIDE))}
    )
    joints = [
        joint_between("foot", "ground", "column.foot", stiffness=SPRING),
        joint_between("brace", "ground", "column.side", stiffness=SPRING),
    ]
    points = {"tcp": ("column.head", "ground")}
    first, second = (
        lumped_machine([(component, part)], joints, points) for part in (one, split_head(merged))
    )
    return first, second


def test_tied_nodes_equal_the_merged_node() -> None:
    merged, split = (couple(*parts, HOME) for parts in machines())
    assert len(split.system.labels) == len(merged.system.labels) == 12
    np.testing.assert_allclose(
        solve_modal(split.system).frequencies_hz,
        solve_modal(merged.system).frequencies_hz,
        rtol=1e-10,
    )
    expected = point_compliance(merged, "tcp")
    np.testing.assert_allclose(
        point_compliance(split, "tcp"), expected, rtol=0.0, atol=1e-10 * np.abs(expected).max()
    )


def test_rows_said_twice_are_counted_and_change_nothing() -> None:
    superelements, machine = machines()[1]
    part = superelements["column"]
    doubled = dataclasses.replace(
        part, constraints=np.vstack([part.constraints, 3.0 * part.constraints])
    )
    coupled = couple({"column": doubled}, machine, HOME)
    assert coupled.redundant_constraints == 6
    expected = solve_modal(couple(superelements, machine, HOME).system).frequencies_hz
    np.testing.assert_allclose(solve_modal(coupled.system).frequencies_hz, expected, rtol=1e-10)


@pytest.mark.parametrize("joined", ["head", "side"])
def test_a_joint_at_either_of_two_tied_interfaces_acts_on_both(joined: str) -> None:
    _, (superelements, machine) = machines()
    brace = joint_between(
        "brace", "ground", f"column.{joined}", stiffness=SPRING, point=(0.0, 0.0, 0.5)
    )
    parts = (superelements, dataclasses.replace(machine, joints=machine.joints | {"brace": brace}))
    (merged, merged_machine), _ = machines()
    other = dataclasses.replace(merged_machine, joints=merged_machine.joints | {"brace": brace})
    expected = point_compliance(couple(merged, other, HOME), "tcp")
    np.testing.assert_allclose(
        point_compliance(couple(*parts, HOME), "tcp"),
        expected,
        rtol=0.0,
        atol=1e-10 * np.abs(expected).max(),
    )
