"""SLEPc's search on whole models against closed forms and dense algebra."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ConvergenceError
from headstock.validation.parts import sparse_eigenpairs
from headstock.validation.parts.sparse_eigenpairs import lowest_symmetric_pairs, solve_symmetric


def _chain(size: int, *, fixed: bool = True) -> scipy.sparse.csr_matrix:
    """Springs between masses in a row, its ends on ground or free."""
    diagonal = np.full(size, 2.0)
    if not fixed:
        diagonal[[0, -1]] = 1.0
    beside = np.full(size - 1, -1.0)
    return scipy.sparse.diags([beside, diagonal, beside], [-1, 0, 1], format="csr")


def _plate(size: int) -> scipy.sparse.csr_matrix:
    """A square membrane on ``size`` times ``size`` points: nearly all eigenvalues are repeated."""
    row, one = _chain(size), scipy.sparse.eye(size)
    return (scipy.sparse.kron(row, one) + scipy.sparse.kron(one, row)).tocsr()


def _chain_values(size: int) -> FloatArray:
    return np.asarray(4.0 * np.sin(np.arange(1, size + 1) * np.pi / (2.0 * size + 2.0)) ** 2)


def test_a_chain_has_the_frequencies_of_its_closed_form() -> None:
    found, shapes = lowest_symmetric_pairs(_chain(400), scipy.sparse.eye(400), 9, shift=0.0)
    np.testing.assert_allclose(found, _chain_values(400)[:9], rtol=1e-10)
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(9), atol=1e-9)


def test_repeated_eigenvalues_come_as_often_as_they_occur() -> None:
    row = _chain_values(30)
    expected = np.sort((row[:, None] + row).ravel())
    found, _ = lowest_symmetric_pairs(_plate(30), scipy.sparse.eye(900), 12, shift=0.0)
    np.testing.assert_allclose(found, expected[:12], rtol=1e-10)


def test_six_equal_bodies_have_six_equal_eigenvalues_of_each_kind() -> None:
    one = _chain(50)
    whole = scipy.sparse.block_diag([one] * 6, format="csr")
    found, _ = lowest_symmetric_pairs(whole, scipy.sparse.eye(300), 12, shift=0.0)
    np.testing.assert_allclose(found, np.repeat(_chain_values(50)[:2], 6), rtol=1e-9)


def test_a_free_chain_and_a_constrained_one_are_found_from_below_zero() -> None:
    free, size = _chain(200, fixed=False), 200
    mass = scipy.sparse.diags(np.linspace(1.0, 2.0, size), format="csr")
    found, _ = lowest_symmetric_pairs(free, mass, 8, shift=-1e-3)
    dense = scipy.linalg.eigh(free.toarray(), mass.toarray(), eigvals_only=True)
    assert abs(found[0]) < 1e-12
    np.testing.assert_allclose(found[1:], dense[1:8], rtol=1e-9)
    # the first and the last mass move alike
    rows = scipy.sparse.csr_matrix(([1.0, -1.0], ([0, 0], [0, size - 1])), shape=(1, size))
    bordered = scipy.sparse.bmat([[free, rows.T], [rows, None]], format="csr")
    heavy = scipy.sparse.block_diag([mass, scipy.sparse.csr_matrix((1, 1))], format="csr")
    ring, shapes = lowest_symmetric_pairs(bordered, heavy, 8, shift=-1e-3, constraints=1)
    null = scipy.linalg.null_space(rows.toarray())
    stiff, heavy = (null.T @ each.toarray() @ null for each in (free, mass))
    expected = scipy.linalg.eigh(stiff, heavy, eigvals_only=True)
    np.testing.assert_allclose(ring[1:], expected[1:8], rtol=1e-9)
    assert np.abs(shapes[0] - shapes[size - 1]).max() < 1e-9


def test_a_static_solution_of_an_indefinite_matrix_is_that_of_dense_algebra() -> None:
    matrix = _plate(20) - 0.3 * scipy.sparse.eye(400)
    loads = np.random.default_rng(0).normal(size=(400, 5))
    exact = np.linalg.solve(matrix.toarray(), loads)
    np.testing.assert_allclose(solve_symmetric(matrix, loads), exact, rtol=1e-9)


def test_a_singular_matrix_is_refused() -> None:
    with pytest.raises(ConvergenceError):
        solve_symmetric(_chain(60, fixed=False), np.ones((60, 1)))


def test_a_search_that_leaves_an_eigenvalue_out_is_told_by_the_signs_of_pivots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A search around a shift inside the spectrum misses what lies below it."""
    with pytest.raises(AccuracyError, match="were found"):
        lowest_symmetric_pairs(_chain(400), scipy.sparse.eye(400), 5, shift=0.5)
    monkeypatch.setattr(sparse_eigenpairs, "SPARE", 2)
    whole = scipy.sparse.block_diag([_chain(50)] * 6, format="csr")
    with pytest.raises(AccuracyError, match="one cluster"):
        lowest_symmetric_pairs(whole, scipy.sparse.eye(300), 3, shift=0.0)
