"""zero springs are no springs; negative and non-finite numbers never reach a
result.
"""

import numpy as np
import pytest

from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.second_order import SecondOrderSystem
from lumped_machines import joint_between, lumped_machine, rigid_body

pytestmark = pytest.mark.hard("H17")

HOME = Pose("home")
SPRING = np.array([2e7, 3e7, 5e7, 1e6, 2e6, 3e6])


def block(*joints: Joint) -> tuple[dict[str, Superelement], Machine]:
    body = rigid_body("block", 20.0, {"foot": (0, 0, -0.1), "top": (0, 0, 0.2)})
    return lumped_machine(
        [body], [joint_between("foot", "ground", "block.foot", stiffness=SPRING), *joints]
    )


def test_a_spring_of_zero_stiffness_equals_no_spring() -> None:
    without = couple(*block(), HOME)
    with_zero = couple(*block(joint_between("nothing", "ground", "block.top")), HOME)
    np.testing.assert_array_equal(with_zero.system.stiffness, without.system.stiffness)
    assert with_zero.warnings == without.warnings == ()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_joint_stiffness_that_is_not_finite_is_refused_by_name(value: float) -> None:
    stiffness = SPRING.copy()
    stiffness[2] = value
    with pytest.raises(ModelError, match=r"'odd'.*finite"):
        couple(*block(joint_between("odd", "ground", "block.top", stiffness=stiffness)), HOME)


def test_a_negative_spring_within_a_stable_machine_is_subtracted() -> None:
    found = couple(
        *block(joint_between("minus", "ground", "block.foot", stiffness=-0.5 * SPRING)), HOME
    )
    half = couple(
        *block(joint_between("minus", "ground", "block.foot", stiffness=np.zeros(6))), HOME
    )
    np.testing.assert_allclose(
        found.system.stiffness, 0.5 * half.system.stiffness, rtol=1e-13, atol=1e-6
    )


def test_a_machine_made_unstable_by_a_negative_spring_is_refused() -> None:
    coupled = couple(
        *block(joint_between("minus", "ground", "block.foot", stiffness=-2.0 * SPRING)), HOME
    )
    for solve in (solve_modal, lambda system: solve_static(system, np.ones(6))):
        with pytest.raises(ModelError, match="unstable"):
            solve(coupled.system)


@pytest.mark.parametrize("field", ["mass", "stiffness"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_system_with_values_that_are_not_finite_is_refused(field: str, value: float) -> None:
    matrices = {"mass": np.eye(3), "stiffness": np.eye(3)}
    matrices[field] = matrices[field] * 1.0
    matrices[field][1, 1] = value
    system = SecondOrderSystem(
        matrices["mass"], None, matrices["stiffness"], {}, {}, ("a", "b", "c")
    )
    with pytest.raises(ModelError, match="not finite"):
        solve_modal(system)


def test_a_negative_mass_is_refused_not_solved() -> None:
    system = SecondOrderSystem(np.diag([1.0, -1.0]), None, np.diag([1.0, 2.0]), {}, {}, ("a", "b"))
    with pytest.raises(ModelError, match="mass matrix is not positive semidefinite"):
        solve_modal(system)
