"""two joints on one interface, joints within one body, joints without length: equal to
stiffness put together by hand.
"""

import functools

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray, rigid_transfer
from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_motions import find_free_motions
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H14")

HOME = Pose("home")
SPRING = np.array([2e7, 3e7, 5e7, 1e6, 2e6, 3e6])
CENTER = np.array([0.1, 0.2, 0.3])
BODY = rigid_body(
    "body",
    20.0,
    {"foot": (0, 0, 0), "twin": (0, 0, 0), "top": (0, 0, 0.5)},
    center=CENTER,
    inertia=(1, 2, 3),
)


def coupled_stiffness(*joints: Joint, body: tuple[Component, Superelement] = BODY) -> FloatArray:
    """In dofs of the body, of which the coordinates of the machine are multiples."""
    coupled = couple(*lumped_machine([body], list(joints)), HOME)
    scale = np.linalg.inv(coupled.basis)
    return np.asarray(scale.T @ coupled.system.stiffness @ scale)


def by_hand(
    stiffness: FloatArray, place: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> FloatArray:
    arm = rigid_transfer(CENTER, np.array(place))
    return arm.T @ np.diag(stiffness) @ arm


joint = functools.partial(joint_between, stiffness=SPRING)
FOOT, LEVER = (0.0, 0.0, 0.0), (0.7, -0.4, 0.1)


@pytest.mark.parametrize(
    ("joints", "stiffness", "place"),
    [
        ([joint("a", "ground", "body.foot")], SPRING, FOOT),
        ([joint("a", "body.foot", "ground")], SPRING, FOOT),
        ([joint("a", "ground", "body.top", point=(0, 0, 0.5))], SPRING, (0.0, 0.0, 0.5)),
        ([joint("a", "ground", "body.top", point=LEVER)], SPRING, LEVER),
        (
            [joint("a", "ground", "body.foot"), joint("b", "body.twin", "ground")],
            2 * SPRING,
            FOOT,
        ),
        (
            [
                joint("a", "ground", "body.foot"),
                joint("b", "ground", "body.foot", stiffness=2 * SPRING),
            ],
            3 * SPRING,
            FOOT,
        ),
    ],
    ids=["alone", "other order", "without length", "with a lever", "in one place", "on one"],
)
def test_joints_to_ground_add_wherever_they_are(
    joints: list[Joint], stiffness: FloatArray, place: tuple[float, float, float]
) -> None:
    found = coupled_stiffness(*joints)
    exact = by_hand(stiffness, place)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-12 * np.abs(found).max())


def test_a_spring_between_two_interfaces_of_one_rigid_body_does_nothing() -> None:
    foot = joint_between("a", "ground", "body.foot", stiffness=SPRING)
    loop = joint_between("loop", "body.foot", "body.top", stiffness=1e3 * SPRING)
    np.testing.assert_array_equal(coupled_stiffness(foot, loop), coupled_stiffness(foot))


def test_a_rigid_joint_within_one_rigid_body_is_redundant() -> None:
    joints = [
        joint_between("a", "ground", "body.foot", stiffness=SPRING),
        joint_between("loop", "body.foot", "body.top", fixed=range(6)),
    ]
    coupled = couple(*lumped_machine([BODY], joints), HOME)
    assert coupled.redundant_constraints == 6
    alone = couple(*lumped_machine([BODY], joints[:1]), HOME)
    np.testing.assert_array_equal(coupled.system.stiffness, alone.system.stiffness)


def test_a_spring_between_two_interfaces_of_one_elastic_body_stiffens_it_as_by_hand() -> None:
    column = two_node_body("column", 30.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))
    loop = joint_between("loop", "column.foot", "column.head", stiffness=SPRING)
    found = couple(*lumped_machine([column], [loop]), HOME)
    difference = np.hstack([-np.eye(6), rigid_transfer(np.array([0, 0, 0.5]), np.zeros(3))])
    expected = column[1].stiffness + difference.T @ np.diag(SPRING) @ difference
    expected = found.basis.T @ expected @ found.basis
    np.testing.assert_allclose(
        found.system.stiffness, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
    )
    assert len(find_free_motions(found)) == 6


def test_a_body_fixed_twice_and_sprung_nowhere_has_no_motion_left() -> None:
    joints = [
        joint_between(name, "ground", f"body.{name}", fixed=range(6)) for name in ("foot", "top")
    ]
    coupled = couple(*lumped_machine([BODY], joints), HOME)
    assert coupled.system.labels == ()
    assert coupled.redundant_constraints == 6
    with pytest.raises(Exception, match="no dof is left"):
        solve_modal(coupled.system)
