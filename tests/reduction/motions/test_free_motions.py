"""motions nothing holds are counted and named; a static answer is refused, modes go on."""

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.machine.machine import Machine, Pose, orient_machine
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.motions.body_motions import find_free_motions
from headstock.reduction.motions.compliance_budget import (
    find_weakest_link,
    point_budget,
    point_compliance,
)
from headstock.reduction.motions.mode_naming import name_modes
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from lumped_machines import joint_between, lumped_machine, rigid_body, two_node_body

pytestmark = pytest.mark.hard("H03")

HOME = Pose("home")
SPRING = np.array([2e7, 3e7, 5e7, 1e6, 2e6, 3e6])
COLUMN = (1e8, 2e8, 5e8, 2e6, 3e6, 1e6)
ODD = Frame(np.array([3.0, -1.0, 2.0]), rotation_about(np.array([1.0, 2.0, 3.0]), 0.9))


def machine_with_free(
    dofs: tuple[int, ...], fixed: tuple[int, ...] = ()
) -> tuple[dict[str, Superelement], Machine]:
    """A bed on springs, a slider with a column on it; some dofs of the slider's guide are free."""
    bed = rigid_body(
        "bed",
        300.0,
        {"foot": (0, 0, -0.4), "rail": (0, 0, 0)},
        center=(0, 0, -0.2),
        inertia=(9, 10, 11),
    )
    slider = rigid_body(
        "slider",
        40.0,
        {"guide": (0, 0, 0), "top": (0, 0, 0.1)},
        center=(0, 0, 0.05),
        inertia=(0.4, 0.5, 0.6),
    )
    column = two_node_body("column", 30.0, 0.5, COLUMN, placement=Frame(np.array([0.0, 0.0, 0.1])))
    spring = np.where(np.isin(range(6), [*dofs, *fixed]), 0.0, SPRING)
    joints = [
        joint_between("mount", "ground", "bed.foot", stiffness=SPRING),
        joint_between("guide", "bed.rail", "slider.guide", stiffness=spring, fixed=fixed),
        joint_between("clamp", "slider.top", "column.foot", fixed=range(6)),
    ]
    return lumped_machine([bed, slider, column], joints, {"tcp": ("column.head", "ground")})


CASES = [(0,), (2,), (5,), (0, 1), (0, 1, 5), (0, 1, 2, 3), (0, 1, 2, 3, 4)]


@pytest.mark.parametrize("frame", [Frame(), ODD], ids=["straight", "turned"])
@pytest.mark.parametrize("dofs", CASES)
def test_free_motions_are_counted_and_the_bed_does_not_move(
    dofs: tuple[int, ...], frame: Frame
) -> None:
    superelements, machine = machine_with_free(dofs)
    coupled = couple(superelements, orient_machine(machine, frame), HOME)
    motions = find_free_motions(coupled)
    assert len(motions) == len(dofs)
    assert all(set(motion.bodies) == {"slider", "column"} for motion in motions)
    assert solve_modal(coupled.system).rigid_count == len(dofs)


def test_rigid_modes_lie_far_below_the_first_elastic_one_and_leave_the_others_alone() -> None:
    free = solve_modal(couple(*machine_with_free((0,)), HOME).system)
    soft_spring = machine_with_free((0,))
    soft_spring[1].joints["guide"].stiffness[0, 0] = 1e-3
    soft = solve_modal(couple(*soft_spring, HOME).system)
    assert free.frequencies_hz[0] < 1e-5 * free.frequencies_hz[1]
    assert soft.rigid_count == 0
    np.testing.assert_allclose(soft.frequencies_hz[1:], free.frequencies_hz[1:], rtol=1e-9)
    assert soft.frequencies_hz[0] == approx(np.sqrt(1e-3 / 70.0) / (2 * np.pi), rel=0.2)


def test_a_load_that_does_work_on_a_free_motion_is_refused_with_the_motions_and_bodies_named() -> (
    None
):
    coupled = couple(*machine_with_free((0, 1, 2, 5)), HOME)
    with pytest.raises(ModelError, match=r"4 rigid motion\(s\) are free") as caught:
        point_compliance(coupled, "tcp")
    assert "X translation of" in str(caught.value) and "C rotation of" in str(caught.value)
    assert (
        "slider" in str(caught.value)
        and "column" in str(caught.value)
        and "bed" not in str(caught.value)
    )


@pytest.mark.parametrize("dofs", [(0,), (5,), (0, 5), (3,), (2, 4)])
def test_loads_that_do_no_work_on_the_free_motions_have_the_answer_of_a_very_soft_spring_in_place_of_none(
    dofs: tuple[int, ...],
) -> None:
    found = point_compliance(couple(*machine_with_free(dofs), HOME), "tcp")
    parts, machine = machine_with_free(dofs)
    machine.joints["guide"].stiffness[list(dofs), list(dofs)] = 1.0
    soft = point_compliance(couple(parts, machine, HOME), "tcp")
    answered = ~np.isnan(found)
    assert (np.abs(np.diag(soft)) > 1e-2).tolist() == (~np.diag(answered)).tolist()
    np.testing.assert_allclose(found[answered], soft[answered], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("frame", [Frame(), ODD], ids=["straight", "turned"])
def test_a_free_turn_about_the_tool_leaves_the_forces_through_it_alone(frame: Frame) -> None:
    superelements, machine = machine_with_free((5,))
    coupled = couple(superelements, orient_machine(machine, frame), HOME)
    budget = point_budget(coupled, "tcp")
    assert not np.isnan(budget.compliance[:3, :3]).any()
    assert np.isnan(np.linalg.norm(budget.compliance[3:, 3:]))
    assert budget.free and sum(budget.shares["x"].values()) == approx(1.0, abs=1e-9)
    assert present(find_weakest_link(coupled, "tcp", "x", budget)).change < 0.0


def test_modes_go_on_and_name_the_free_motion() -> None:
    coupled = couple(*machine_with_free((0,)), HOME)
    names = name_modes(coupled, solve_modal(coupled.system)).names
    assert (
        names[0] == "free X translation of column + slider"
        or names[0] == "free X translation of slider + column"
    )
    assert not any(name.startswith("free") for name in names[1:])


def test_a_free_slide_of_a_fixed_joint_is_found_as_well() -> None:
    coupled = couple(*machine_with_free((1,), fixed=(0, 2, 3, 4, 5)), HOME)
    (motion,) = find_free_motions(coupled)
    assert motion.motion == "Y translation" and set(motion.bodies) == {"slider", "column"}


def test_a_soft_spring_is_not_taken_for_a_free_motion() -> None:
    superelements, machine = machine_with_free((0,))
    machine.joints["guide"].stiffness[0, 0] = 1e-2
    coupled = couple(superelements, machine, HOME)
    assert find_free_motions(coupled) == ()
    assert point_compliance(coupled, "tcp")[0, 0] == approx(100.0, rel=1e-6)
