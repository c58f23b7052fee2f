"""bodies without a way to ground are counted and named."""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_motions import find_free_motions
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H04")

HOME = Pose("home")
SPRING = (2e7, 3e7, 5e7, 1e6, 2e6, 3e6)


def loose_machine(free: bool = False) -> tuple[dict[str, Superelement], Machine]:
    """A fixed bed, and a pair of bodies sprung together that floats."""
    bed = rigid_body("bed", 300.0, {"foot": (0, 0, -0.4)})
    table = rigid_body("table", 50.0, {"side": (0.5, 0, 0)}, center=(0.5, 0, 0.1))
    column = two_node_body("column", 30.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))
    parts = [
        (dataclasses.replace(component, free=free), element)
        for component, element in (bed, table, column)
    ]
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=SPRING),
        joint_between("link", "table.side", "column.foot", stiffness=SPRING),
    ]
    return lumped_machine(parts, joints, {"tcp": ("column.head", "bed.foot")})


def test_floating_bodies_are_grouped_and_named() -> None:
    coupled = couple(*loose_machine(), HOME)
    assert coupled.floating == (("table", "column"),)
    assert any("table + column float" in text for text in coupled.warnings)


def test_bodies_declared_free_float_without_a_warning() -> None:
    coupled = couple(*loose_machine(free=True), HOME)
    assert coupled.floating == (("table", "column"),)
    assert coupled.warnings == ()


def test_a_floating_pair_has_six_rigid_motions_and_the_bed_none() -> None:
    coupled = couple(*loose_machine(), HOME)
    motions = find_free_motions(coupled)
    assert len(motions) == 6
    assert {body for motion in motions for body in motion.bodies} == {"table", "column"}
    modal = solve_modal(coupled.system)
    assert modal.rigid_count == 6
    assert modal.frequencies_hz[:6].max() < 1e-5 * modal.frequencies_hz[6]


def test_elastic_modes_of_a_free_machine_equal_those_on_vanishing_springs() -> None:
    superelements, machine = loose_machine()
    free = solve_modal(couple(superelements, machine, HOME).system).frequencies_hz
    thread = joint_between("thread", "ground", "table.side", stiffness=np.full(6, 1.0))
    fixed = solve_modal(
        couple(
            superelements,
            dataclasses.replace(machine, joints=machine.joints | {"thread": thread}),
            HOME,
        ).system
    )
    assert fixed.rigid_count == 0
    np.testing.assert_allclose(fixed.frequencies_hz[6:], free[6:], rtol=1e-6)
