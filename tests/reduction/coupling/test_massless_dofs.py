"""dofs without mass are condensed statically, which is exact, and counted."""

import numpy as np
import pytest
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.reduction.coupling.coupling import couple
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.solvers.second_order import SecondOrderSystem
from lumped_machines import joint_between, lumped_machine, rigid_body

pytestmark = pytest.mark.hard("H16")

HOME = Pose("home")
SPRING = np.array([2e7, 3e7, 5e7, 1e6, 2e6, 3e6])


def random_system(
    size: int, massless: int, *, seed: int = 0, turned: bool = False
) -> SecondOrderSystem:
    generator = np.random.default_rng(seed)
    factor = generator.normal(size=(size, size))
    stiffness = 1e6 * (factor @ factor.T + np.eye(size))
    inner = generator.normal(size=(size - massless, size - massless))
    mass = scipy.linalg.block_diag(
        np.zeros((massless, massless)), inner @ inner.T + np.eye(size - massless)
    )
    if turned:
        rotation = np.linalg.qr(generator.normal(size=(size, size)))[0]
        stiffness, mass = (rotation @ matrix @ rotation.T for matrix in (stiffness, mass))
        stiffness, mass = (0.5 * (matrix + matrix.T) for matrix in (stiffness, mass))
    return SecondOrderSystem(mass, None, stiffness, {}, {}, tuple(f"q{i}" for i in range(size)))


def guyan(system: SecondOrderSystem, massless: int) -> FloatArray:
    k, m = system.stiffness, system.mass[massless:, massless:]
    condensed = k[massless:, massless:] - k[massless:, :massless] @ np.linalg.solve(
        k[:massless, :massless], k[:massless, massless:]
    )
    return np.asarray(
        np.sqrt(scipy.linalg.eigvalsh(0.5 * (condensed + condensed.T), m)) / (2.0 * np.pi)
    )


@pytest.mark.parametrize("massless", [1, 3, 8])
def test_finite_frequencies_equal_the_guyan_condensed_system_and_infinite_ones_are_counted(
    massless: int,
) -> None:
    system = random_system(12, massless)
    modal = solve_modal(system)
    assert modal.infinite_count == massless
    np.testing.assert_allclose(modal.frequencies_hz, guyan(system, massless), rtol=1e-10)
    np.testing.assert_allclose(
        modal.shapes.T @ system.mass @ modal.shapes, np.eye(12 - massless), atol=1e-9
    )


def test_a_mass_matrix_that_is_singular_in_a_skew_direction_gives_the_same() -> None:
    straight, turned = random_system(10, 3), random_system(10, 3, turned=True)
    modal = solve_modal(turned)
    assert modal.infinite_count == 3
    np.testing.assert_allclose(modal.frequencies_hz, guyan(straight, 3), rtol=1e-10)


def test_a_massless_link_between_two_bodies_is_two_springs_in_series() -> None:
    base = rigid_body("base", 100.0, {"top": (0, 0, 0)})
    link = rigid_body("link", 0.0, {"low": (0, 0, 0), "high": (0, 0, 0)}, inertia=(0, 0, 0))
    head = rigid_body("head", 10.0, {"seat": (0, 0, 0)})
    foot = joint_between("foot", "ground", "base.top", stiffness=SPRING)
    springs = [
        joint_between("a", "base.top", "link.low", stiffness=2 * SPRING),
        joint_between("b", "link.high", "head.seat", stiffness=3 * SPRING),
    ]
    series = joint_between("a", "base.top", "head.seat", stiffness=1.2 * SPRING)
    found = solve_modal(couple(*lumped_machine([base, link, head], [foot, *springs]), HOME).system)
    expected = solve_modal(couple(*lumped_machine([base, head], [foot, series]), HOME).system)
    assert found.infinite_count == 6 and expected.infinite_count == 0
    np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-10)


def test_a_rotation_without_inertia_is_condensed() -> None:
    point = rigid_body("point", 10.0, {"seat": (0, 0, -0.2)}, inertia=(0, 0, 0))
    modal = solve_modal(
        couple(
            *lumped_machine(
                [point], [joint_between("a", "ground", "point.seat", stiffness=SPRING)]
            ),
            HOME,
        ).system
    )
    assert modal.infinite_count == 3
    flexibility = [
        1 / SPRING[0] + 0.04 / SPRING[4],
        1 / SPRING[1] + 0.04 / SPRING[3],
        1 / SPRING[2],
    ]
    np.testing.assert_allclose(
        modal.frequencies_hz,
        np.sort(np.sqrt(0.1 / np.array(flexibility)) / (2 * np.pi)),
        rtol=1e-12,
    )


def test_a_motion_with_neither_mass_nor_stiffness_is_refused() -> None:
    system = random_system(5, 0)
    mass, stiffness = (
        scipy.linalg.block_diag(system.mass, 0.0),
        scipy.linalg.block_diag(system.stiffness, 0.0),
    )
    with pytest.raises(ModelError, match="neither mass nor stiffness"):
        solve_modal(SecondOrderSystem(mass, None, stiffness, {}, {}, ("q",) * 6))


def test_a_system_without_any_mass_is_refused() -> None:
    with pytest.raises(ModelError, match="no mass at all"):
        solve_modal(SecondOrderSystem(np.zeros((3, 3)), None, np.eye(3), {}, {}, ("q",) * 3))


def test_what_levers_leave_of_a_massless_dof_is_no_mass() -> None:
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]]) * 1e6
    right = solve_symmetric_modes(stiffness, np.diag([0.0, 50.0]))
    left_over = solve_symmetric_modes(stiffness, np.diag([50.0 * 1e-20, 50.0]))
    assert left_over.infinite_count == right.infinite_count == 1
    assert list(left_over.eigenvalues) == approx(list(right.eigenvalues), rel=1e-12)
