"""a machine turned and moved as a whole has the same frequencies, and its compliance turns as
a tensor.
"""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import Frame, rotate_dofs, rotation_about
from headstock.geometry.machine.machine import Machine, Pose, orient_machine
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.compliance_budget import point_budget, point_compliance
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H20")

HOME = Pose("home")


def skew_machine() -> tuple[dict[str, Superelement], Machine]:
    """Bodies placed askew, springs, fixed dofs and a ball screw's single stiffness in turned joint
    frames.
    """
    askew = Frame(np.array([0.1, -0.2, 0.3]), rotation_about(np.array([0.3, -1.0, 0.4]), 0.6))
    bed = rigid_body(
        "bed",
        300.0,
        {"foot": (0, 0, -0.4), "rail": (0.1, 0, 0)},
        center=(0, 0.1, -0.2),
        inertia=(9, 10, 11),
    )
    column = two_node_body("column", 30.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6), placement=askew)
    head = rigid_body(
        "head",
        12.0,
        {"seat": (0, 0, 0), "tool": (0.2, 0, 0.1)},
        center=(0.1, 0.05, 0.1),
        placement=askew,
    )
    turn = rotation_about(np.array([1.0, 1.0, 0.2]), 1.1)
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=(1e5, 1e5, 2e5, 1e4, 1e4, 1e4)),
        joint_between(
            "guide",
            "bed.rail",
            "column.foot",
            stiffness=(0, 0, 5e8, 0, 2e6, 0),
            fixed=(1, 3),
            rotation=turn,
        ),
        joint_between(
            "screw", "bed.rail", "column.foot", stiffness=(2e8, 0, 0, 0, 0, 1e6), rotation=turn
        ),
        joint_between("neck", "column.head", "head.seat", fixed=range(6)),
    ]
    return lumped_machine([bed, column, head], joints, {"tcp": ("head.tool", "bed.rail")})


@pytest.mark.parametrize("seed", range(12))
def test_frequencies_and_compliance_follow_a_random_set_up(seed: int) -> None:
    generator = np.random.default_rng(seed)
    frame = Frame(
        generator.normal(size=3) * 10.0,
        rotation_about(generator.normal(size=3), generator.uniform(0.0, np.pi)),
    )
    superelements, machine = skew_machine()
    home, turned = (
        couple(superelements, machine, HOME),
        couple(superelements, orient_machine(machine, frame), HOME),
    )
    np.testing.assert_allclose(
        solve_modal(turned.system).frequencies_hz,
        solve_modal(home.system).frequencies_hz,
        rtol=1e-10,
    )
    axes = rotate_dofs(frame.rotation)
    expected = axes @ point_compliance(home, "tcp") @ axes.T
    np.testing.assert_allclose(
        point_compliance(turned, "tcp"), expected, rtol=0.0, atol=1e-10 * np.abs(expected).max()
    )


def test_shares_of_a_quarter_turn_swap_directions() -> None:
    quarter = Frame(np.zeros(3), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    superelements, machine = skew_machine()
    home = point_budget(couple(superelements, machine, HOME), "tcp").shares
    turned = point_budget(
        couple(superelements, orient_machine(machine, quarter), HOME), "tcp"
    ).shares
    assert turned["y"] == approx(home["x"], rel=1e-8, abs=1e-12)
    assert turned["x"] == approx(home["y"], rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_a_shifted_origin_changes_nothing(distance: float) -> None:
    superelements, machine = skew_machine()
    moved = orient_machine(machine, Frame(np.array([distance, -distance, 0.5 * distance])))
    found = solve_modal(couple(superelements, moved, HOME).system).frequencies_hz
    np.testing.assert_allclose(
        found, solve_modal(couple(superelements, machine, HOME).system).frequencies_hz, rtol=1e-9
    )


def test_a_frame_that_is_not_orthonormal_is_refused() -> None:
    with pytest.raises(ValueError, match="orthonormal"):
        Frame(np.zeros(3), np.diag([1.0, 1.0, 1.001]))
