"""Static answers, exact for graded matrices and refused for mechanisms."""

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.second_order import SecondOrderSystem


def system_of(stiffness: FloatArray) -> SecondOrderSystem:
    size = len(stiffness)
    return SecondOrderSystem(
        np.zeros((size, size)), None, stiffness, {}, {}, tuple(f"q{i}" for i in range(size))
    )


@pytest.mark.parametrize("columns", [(), (1,), (3,)])
def test_displacements_have_the_shape_of_the_loads_and_balance_them(columns: tuple[int]) -> None:
    generator = np.random.default_rng(1)
    factor = generator.normal(size=(15, 15))
    stiffness = factor @ factor.T + np.eye(15)
    loads = generator.normal(size=(15, *columns))
    result = solve_static(system_of(stiffness), loads)
    assert result.displacements.shape == loads.shape
    np.testing.assert_allclose(stiffness @ result.displacements, loads, atol=1e-10)


def test_a_graded_chain_is_solved_to_the_last_digits() -> None:
    levels = np.logspace(14, 0, 8)
    stretch = np.eye(8) - np.eye(8, k=-1)
    # coordinates are the stretches themselves: the matrix is graded and nothing cancels
    result = solve_static(system_of(np.diag(levels)), stretch.T @ np.ones(8))
    np.testing.assert_allclose(result.displacements, (stretch.T @ np.ones(8)) / levels, rtol=1e-14)


def test_an_unsymmetric_stiffness_is_solved_as_it_is() -> None:
    stiffness = np.array([[3.0, 1.0], [-1.0, 2.0]])
    np.testing.assert_allclose(
        solve_static(system_of(stiffness), np.array([1.0, 0.0])).displacements,
        [2.0 / 7.0, 1.0 / 7.0],
        rtol=1e-14,
    )


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e9])
def test_a_free_chain_is_refused_and_counted(scale: float) -> None:
    stiffness = scale * np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    with pytest.raises(ModelError, match=r"2 rigid motion\(s\) are free.*q2"):
        solve_static(system_of(stiffness), np.ones(3))


def test_loads_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ModelError, match="not finite"):
        solve_static(system_of(np.eye(2)), np.array([np.nan, 1.0]))


def test_no_dofs_at_all_give_an_empty_answer() -> None:
    assert solve_static(system_of(np.zeros((0, 0))), np.zeros((0, 6))).displacements.shape == (0, 6)
