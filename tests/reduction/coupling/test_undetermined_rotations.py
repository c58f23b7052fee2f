"""the rotation of a line-like interface about its line belongs to no motion of
its component.
"""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_motions import find_free_motions
from headstock.reduction.motions.compliance_budget import point_compliance
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H15")

HOME = Pose("home")
SPRING = (2e7, 3e7, 5e7, 1e6, 2e6, 3e6)
HINGED = (1e8, 2e8, 5e8, 0.0, 3e6, 1e6)


def hinged_column(
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> tuple[Component, Superelement]:
    """A column whose head is a line along an axis: it feels no rotation about it, and says so by a
    row.
    """
    component, part = two_node_body("column", 40.0, 0.5, SPRING)
    axis = np.array(axis) / np.linalg.norm(axis)
    unidentifiable = np.eye(12)
    unidentifiable[9:, 9:] -= np.outer(axis, axis)
    row = np.concatenate([np.zeros(9), axis])[None]
    return component, dataclasses.replace(
        part,
        stiffness=unidentifiable @ part.stiffness @ unidentifiable,
        mass=unidentifiable @ part.mass @ unidentifiable,
        constraints=row,
        supported=True,
    )


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (1.0, 2.0, -0.5)])
def test_a_rotation_that_nothing_feels_or_holds_leaves_no_singular_dof(
    axis: tuple[float, float, float],
) -> None:
    joints = [joint_between("foot", "ground", "column.foot", stiffness=SPRING)]
    coupled = couple(
        *lumped_machine([hinged_column(axis)], joints, {"tcp": ("column.head", "ground")}), HOME
    )
    assert len(coupled.system.labels) == 11
    assert find_free_motions(coupled) == ()
    modal = solve_modal(coupled.system)
    assert modal.rigid_count == 0 and np.isfinite(modal.frequencies_hz).all()
    assert np.isfinite(point_compliance(coupled, "tcp")).all()


def test_a_body_joined_rigidly_to_a_line_may_turn_about_it() -> None:
    head = rigid_body(
        "head", 5.0, {"seat": (0, 0, 0.5)}, center=(0, 0, 0.5), inertia=(0.1, 0.1, 0.1)
    )
    joints = [
        joint_between("foot", "ground", "column.foot", stiffness=SPRING),
        joint_between("weld", "column.head", "head.seat", fixed=range(6)),
    ]
    coupled = couple(*lumped_machine([hinged_column(), head], joints), HOME)
    (motion,) = find_free_motions(coupled)
    assert motion.motion == "A rotation" and motion.bodies == ("head",)


def test_a_body_sprung_to_a_line_keeps_only_the_springs_the_line_can_carry() -> None:
    head = rigid_body(
        "head", 5.0, {"seat": (0, 0, 0.5)}, center=(0, 0, 0.5), inertia=(0.1, 0.1, 0.1)
    )
    joints = [
        joint_between("foot", "ground", "column.foot", stiffness=SPRING),
        joint_between("neck", "column.head", "head.seat", stiffness=HINGED),
    ]
    coupled = couple(*lumped_machine([hinged_column(), head], joints), HOME)
    (motion,) = find_free_motions(coupled)
    assert motion.motion == "A rotation" and motion.bodies == ("head",)
