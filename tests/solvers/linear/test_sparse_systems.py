"""Coupled systems of many bodies: their lowest modes and static answers are those of the full
solves.
"""

import numpy as np
import pytest
import scipy.sparse.linalg
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear import sparse_systems
from headstock.solvers.linear.sparse_systems import (
    factorise_sparse,
    find_sparse,
    lowest_sparse_modes,
)
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.solvers.second_order import SecondOrderSystem

SIZE = 240


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sparse_systems, "SMALLEST", 100)


def chains(count: int = 1, *, fixed: bool = True) -> tuple[FloatArray, FloatArray]:
    """Stiffness and mass of equal rows of masses on springs: every eigenvalue as often as there are
    rows.
    """
    size = SIZE // count
    stiffness = 2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
    stiffness[-1, -1] = 1.0
    stiffness[0, 0] = 2.0 if fixed else 1.0
    mass = (4.0 * np.eye(size) + np.eye(size, k=1) + np.eye(size, k=-1)) / 6.0
    return np.asarray(np.kron(np.eye(count), stiffness), dtype=np.float64), np.asarray(
        np.kron(np.eye(count), mass), dtype=np.float64
    )


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_lowest_modes_are_those_of_the_full_solve_repeated_ones_included(count: int) -> None:
    stiffness, mass = chains(count)
    found = lowest_sparse_modes(stiffness, mass, 6)
    assert found is not None
    eigenvalues, shapes = found
    np.testing.assert_allclose(
        eigenvalues, eigh(stiffness, mass, eigvals_only=True)[:6], rtol=1e-11
    )
    np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(6), atol=1e-10)
    assert np.abs(stiffness @ shapes - mass @ shapes * eigenvalues).max() < 1e-12


def test_a_count_that_misses_a_mode_is_seen_and_nothing_is_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stiffness, mass = chains()

    def forgetful(
        matrix: object, count: int, *args: object, **options: object
    ) -> tuple[FloatArray, FloatArray]:
        eigenvalues, shapes = eigsh(matrix, count + 1, *args, **options)
        order = np.argsort(eigenvalues)
        return np.delete(eigenvalues[order], 2), np.delete(shapes[:, order], 2, axis=1)

    monkeypatch.setattr(scipy.sparse.linalg, "eigsh", forgetful)
    assert lowest_sparse_modes(stiffness, mass, 6) is None
    np.testing.assert_allclose(
        solve_symmetric_modes(stiffness, mass, wanted=6).eigenvalues[:6],
        eigh(stiffness, mass, eigvals_only=True)[:6],
        rtol=1e-9,
    )


@pytest.mark.parametrize("number", [0, 1, 7, 30])
def test_pivots_count_eigenvalues_below_a_shift(number: int) -> None:
    stiffness, mass = chains()
    eigenvalues = eigh(stiffness, mass, eigvals_only=True)
    shift = (
        eigenvalues[0] / 2.0
        if number == 0
        else 0.5 * (eigenvalues[number - 1] + eigenvalues[number])
    )
    factor = factorise_sparse(find_sparse(stiffness - shift * mass))
    assert factor is not None and factor.negative == number


def test_what_is_free_or_without_mass_is_left_to_the_full_solve() -> None:
    stiffness, mass = chains(fixed=False)
    assert solve_symmetric_modes(stiffness, mass, wanted=6).rigid_count == 1
    stiffness, mass = chains()
    mass[7, :] = mass[:, 7] = 0.0
    assert lowest_sparse_modes(stiffness, mass, 6) is None
    assert solve_symmetric_modes(stiffness, mass, wanted=6).infinite_count == 1


def test_static_answers_are_those_of_a_full_solve() -> None:
    stiffness, mass = chains(2)
    loads = np.random.default_rng(0).normal(size=(SIZE, 3))
    system = SecondOrderSystem(
        mass, None, stiffness, {}, {}, tuple(f"dof {i}" for i in range(SIZE))
    )
    np.testing.assert_allclose(
        solve_static(system, loads).displacements, np.linalg.solve(stiffness, loads), rtol=1e-9
    )
