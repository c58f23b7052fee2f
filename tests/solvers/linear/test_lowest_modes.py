"""The lowest modes alone are those of the whole solution, and what they cannot do is left to it."""

import numpy as np
import pytest

from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_lowest_modes, solve_modal
from headstock.solvers.second_order import SecondOrderSystem


def make_system(size: int, *, free: bool = False, massless: bool = False) -> SecondOrderSystem:
    """A chain of masses on springs of every size, fixed at one end or free."""
    random = np.random.default_rng(size)
    springs = 10.0 ** random.uniform(4.0, 7.0, size)
    stretch = np.eye(size) - np.eye(size, k=-1)
    stretch = stretch[1:] if free else stretch
    stiffness = stretch.T @ (springs[: len(stretch), None] * stretch)
    masses = random.uniform(1.0, 5.0, size)
    masses[size // 2] = 0.0 if massless else masses[size // 2]
    return SecondOrderSystem(np.diag(masses), None, stiffness, {}, {}, tuple(map(str, range(size))))


@pytest.mark.parametrize("size", [8, 30, 200])
def test_few_modes_are_the_first_of_all(size: int) -> None:
    system = make_system(size)
    few, every = solve_lowest_modes(system, count=4), solve_modal(system)
    np.testing.assert_allclose(few.frequencies_hz, every.frequencies_hz[:4], rtol=1e-10)
    np.testing.assert_allclose(
        few.shapes, every.shapes[:, :4], atol=1e-6 * np.abs(every.shapes).max()
    )
    np.testing.assert_allclose(few.shapes.T @ system.mass @ few.shapes, np.eye(4), atol=1e-10)


def test_modes_up_to_a_frequency_are_all_of_them_and_no_others() -> None:
    system = make_system(60)
    every = solve_modal(system).frequencies_hz
    limit = 0.5 * (every[6] + every[7])
    np.testing.assert_allclose(
        solve_lowest_modes(system, up_to_hz=limit).frequencies_hz, every[:7], rtol=1e-10
    )
    assert len(solve_lowest_modes(system, up_to_hz=0.5 * every[0]).frequencies_hz) == 0
    assert len(solve_lowest_modes(system, up_to_hz=limit, count=3).frequencies_hz) == 3


def test_a_free_body_keeps_its_rigid_mode() -> None:
    system = make_system(20, free=True)
    few, every = solve_lowest_modes(system, count=5), solve_modal(system, count=5)
    assert few.rigid_count == every.rigid_count == 1
    np.testing.assert_allclose(few.frequencies_hz[1:], every.frequencies_hz[1:], rtol=1e-10)


def test_a_dof_without_mass_does_not_disturb_low_modes() -> None:
    system = make_system(20, massless=True)
    np.testing.assert_allclose(
        solve_lowest_modes(system, count=5).frequencies_hz,
        solve_modal(system, count=5).frequencies_hz,
        rtol=1e-9,
    )


def test_an_indefinite_system_is_refused() -> None:
    system = make_system(20)
    system.stiffness[0, 0] = -1e9
    with pytest.raises(ModelError):
        solve_lowest_modes(system, count=3)
