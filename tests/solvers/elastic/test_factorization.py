"""Factorisations, their orders by METIS, and direct solvers of PETSc."""

import ctypes
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from common import STEEL, make_box, make_component
from headstock.geometry.errors import OutOfMemoryError
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import Component, MeshSettings
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.components.meshing import mesh_component
from headstock.solvers.elastic import factorization
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization, IntArray32, _dissect_nodes
from headstock.solvers.errors import HeadstockError

COMM = MPI.COMM_SELF


@pytest.fixture(scope="module")
def block() -> tuple[ElasticOperators, BoolArray]:
    mesh = make_box((1, 2, 3), (0.1, 0.2, 0.4))
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=False)
    return operators, np.repeat(operators.points[:, 2] < 1e-9, 3)


@pytest.mark.parametrize("count", [1, 7])
def test_solutions_are_those_of_a_dense_solver_and_fixed_dofs_rest(
    block: tuple[ElasticOperators, BoolArray], count: int
) -> None:
    operators, fixed = block
    loads = np.random.default_rng(0).standard_normal((operators.owned_dofs, count))
    with Factorization(operators, fixed) as factorization:
        found = factorization.solve(loads)
    exact = np.linalg.solve(operators.stiffness.toarray()[np.ix_(~fixed, ~fixed)], loads[~fixed])
    assert np.abs(found[~fixed] - exact).max() < 1e-10 * np.abs(exact).max()
    assert not found[fixed].any()


def test_a_factorisation_without_memory_blames_no_element(
    block: tuple[ElasticOperators, BoolArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    factor = SimpleNamespace(getMumpsInfog=lambda _: -13)
    monkeypatch.setattr(factorization, "_has_cholmod", lambda: False)
    preconditioner = SimpleNamespace(getFactorMatrix=lambda: factor)
    solver = SimpleNamespace(getPC=lambda: preconditioner)
    monkeypatch.setattr(factorization, "_factorize_with", lambda *_, **__: solver)
    with pytest.raises(OutOfMemoryError, match=r"factorisation.*\d+ dofs.*memory"):
        Factorization(*block)


def test_loads_on_fixed_dofs_are_ignored(block: tuple[ElasticOperators, BoolArray]) -> None:
    operators, fixed = block
    loads = np.random.default_rng(0).standard_normal((operators.owned_dofs, 1))
    with Factorization(operators, fixed) as factorization:
        found = factorization.solve(loads)
        again = factorization.solve(np.where(fixed[:, None], 1e9, loads))
    np.testing.assert_array_equal(found, again)


def test_a_stiffness_that_is_not_positive_definite_is_refused(
    block: tuple[ElasticOperators, BoolArray],
) -> None:
    operators, fixed = block
    upside_down = dataclasses.replace(operators, stiffness=-operators.stiffness)
    with pytest.raises(HeadstockError, match="not positive definite"):
        Factorization(upside_down, fixed).solve(np.ones((operators.owned_dofs, 1)))


def test_with_every_dof_fixed_nothing_moves(block: tuple[ElasticOperators, BoolArray]) -> None:
    operators, fixed = block
    with Factorization(operators, np.ones_like(fixed)) as factorization:
        assert factorization.free_total == 0
        assert not factorization.solve(np.ones((len(fixed), 2))).any()


def test_no_right_hand_side_gives_no_solution(block: tuple[ElasticOperators, BoolArray]) -> None:
    operators, fixed = block
    with Factorization(operators, fixed) as factorization:
        assert factorization.solve(np.zeros((len(fixed), 0))).shape == (len(fixed), 0)


def test_a_single_element_whose_dofs_all_meet_is_factorised() -> None:
    # the ordering used for large matrices ends the process on such a graph
    mesh = make_box((1, 1, 1), (0.1, 0.1, 0.1))
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=False)
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    with Factorization(operators, fixed) as factorization:
        assert np.isfinite(factorization.solve(np.ones((len(fixed), 1)))).all()


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


@pytest.fixture(scope="module")
def operators() -> ElasticOperators:
    component = Component("block", Box((0.1, 0.05, 0.2)), STEEL, mesh=MeshSettings(size=0.03))
    return assemble_elasticity(
        mesh_component(component), STEEL, comm=MPI.COMM_SELF, with_mass=False
    )


def some_fixed(operators: ElasticOperators) -> BoolArray:
    """A clamped face, and single directions elsewhere, so that nodes are fixed in part."""
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    fixed[7::31] = True
    return fixed


def solve(operators: ElasticOperators, fixed: BoolArray) -> tuple[FloatArray, FloatArray, str]:
    loads = np.random.default_rng(3).standard_normal((operators.owned_dofs, 5))
    with Factorization(operators, fixed) as factors:
        kind = str(factors.factors.getPC().getFactorMatrix().getType())
        return loads, factors.solve(loads), kind


@pytest.mark.skipif(not PETSc.Sys.hasExternalPackage("cholmod"), reason="PETSc without CHOLMOD")
def test_cholmod_with_and_without_metis_and_mumps_agree(
    operators: ElasticOperators, monkeypatch: pytest.MonkeyPatch
) -> None:
    fixed = some_fixed(operators)
    _, ordered, first = solve(operators, fixed)
    monkeypatch.setattr(factorization, "_dissect_nodes", lambda pattern: None)
    _, default, second = solve(operators, fixed)
    monkeypatch.setattr(factorization, "_has_cholmod", lambda: False)
    _, other, third = solve(operators, fixed)
    assert (first, second, third) == ("cholmod", "cholmod", "mumps")
    assert np.abs(ordered - other).max() < 1e-10 * np.abs(other).max()
    assert np.abs(default - other).max() < 1e-10 * np.abs(other).max()
