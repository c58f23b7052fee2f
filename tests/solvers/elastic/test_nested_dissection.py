"""Orders by METIS."""

import ctypes

import numpy as np
import pytest
import scipy.sparse

from headstock.meshing.component_mesh import IntArray
from headstock.solvers.elastic.factorization import IntArray32, _dissect_nodes


def grid(side: int) -> scipy.sparse.csr_matrix:
    line = scipy.sparse.diags([1.0, 2.0, 1.0], [-1, 0, 1], shape=(side, side))
    eye = scipy.sparse.identity(side)
    planes = scipy.sparse.kron(scipy.sparse.kron(line, eye), eye) + scipy.sparse.kron(
        scipy.sparse.kron(eye, line), eye
    )
    return scipy.sparse.csr_matrix(planes + scipy.sparse.kron(scipy.sparse.kron(eye, eye), line))


def fill(pattern: scipy.sparse.csr_matrix, order: IntArray32 | IntArray) -> int:
    """Entries of the Cholesky factor of a pattern under an order."""
    dense = pattern[order][:, order].toarray() != 0.0
    for row in range(len(dense)):
        below = row + 1 + np.flatnonzero(dense[row + 1 :, row])
        dense[np.ix_(below, below)] = True
    return int(np.tril(dense).sum())


def test_an_order_holds_every_node_once_and_halves_the_fill_of_a_grid() -> None:
    pattern = grid(8)
    order = _dissect_nodes(pattern)
    assert order is not None
    assert np.array_equal(np.sort(order), np.arange(512))
    assert fill(pattern, order) < 0.6 * float(fill(pattern, np.arange(512, dtype=np.int64)))


def test_nodes_without_neighbours_are_ordered_too() -> None:
    order = _dissect_nodes(scipy.sparse.csr_matrix(np.eye(5)))
    assert order is not None
    assert np.array_equal(np.sort(order), np.arange(5))


def test_without_metis_there_is_no_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    assert _dissect_nodes(grid(3)) is None
