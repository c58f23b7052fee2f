import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.errors import OutOfMemoryError
from headstock.geometry.frames import BoolArray
from headstock.solvers.elastic import factorization
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization
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
