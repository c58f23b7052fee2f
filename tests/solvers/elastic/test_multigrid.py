"""The multigrid and what iterates on it, against factors."""

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.meshing.component_mesh import CellKind
from headstock.solvers.elastic import multigrid
from headstock.solvers.elastic.constrained_solver import rigid_node_motions
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.factorization import Factorization
from headstock.solvers.elastic.multigrid import IterativeInverse, Multigrid
from headstock.solvers.errors import AccuracyError, ConvergenceError

COMM = MPI.COMM_SELF


def assemble(kind: CellKind, *, with_corners: bool = True) -> ElasticOperators:
    mesh = make_box((3, 4, 12), (0.1, 0.13, 0.5), kind=kind)
    return assemble_elasticity(
        mesh, make_component().material, comm=COMM, with_mass=True, with_corners=with_corners
    )


def foot_of(operators: ElasticOperators) -> BoolArray:
    return np.repeat(operators.points[:, 2] < 1e-9, 3)


def loads_on(operators: ElasticOperators, count: int) -> FloatArray:
    return np.random.default_rng(3).standard_normal((operators.owned_dofs, count))


@pytest.fixture(params=["tet10", "hex27", "tet4"])
def operators(request: pytest.FixtureRequest) -> ElasticOperators:
    return assemble(request.param)


def test_corner_stiffness_is_that_of_all_nodes_on_interpolated_displacements(
    operators: ElasticOperators,
) -> None:
    corners = operators.corners
    assert corners is not None
    shape = np.random.default_rng(5).standard_normal(corners.owned_dofs)
    fine = corners.restrict(operators.stiffness @ corners.prolong(shape))
    assert np.abs(fine - corners.stiffness @ shape).max() < 1e-12 * operators.stiffness_scale
    load = loads_on(operators, 1)[:, 0]
    assert corners.prolong(shape) @ load == approx(shape @ corners.restrict(load), rel=1e-10)


def test_a_cycle_is_symmetric_and_near_the_inverse(operators: ElasticOperators) -> None:
    fixed = foot_of(operators)
    multigrid = Multigrid(operators, fixed, np.zeros((len(fixed), 0)))
    load, other = loads_on(operators, 6)[:, :3], loads_on(operators, 6)[:, 3:]
    one, two = load.T @ multigrid.apply(other), multigrid.apply(load).T @ other
    np.testing.assert_allclose(one, two, atol=1e-12 * np.abs(one).max())
    with Factorization(operators, fixed) as factors:
        energies = np.einsum("ij,ij->j", load, factors.solve(load))
    near = np.einsum("ij,ij->j", load, multigrid.apply(load)) / energies
    # elements of order 1 bend too little, which these loads excite
    assert (near > 0.25).all() and (near < 1.2).all()
    multigrid.close()


def test_solutions_are_those_of_the_factors(operators: ElasticOperators) -> None:
    fixed, loads = foot_of(operators), loads_on(operators, 5)
    inverse = IterativeInverse(operators, fixed, np.zeros((len(fixed), 0)))
    with Factorization(operators, fixed) as factors:
        exact = factors.solve(loads)
    error = inverse.solve(loads) - exact
    energies = np.einsum("ij,ij->j", error, operators.apply_stiffness(error))
    assert np.sqrt(energies / np.einsum("ij,ij->j", loads, exact)).max() < 3e-7
    assert inverse.steps < 40
    inverse.close()


def test_a_free_body_is_solved_for_what_does_not_move_it_rigidly() -> None:
    operators = assemble("tet10")
    fixed, motions = np.zeros(operators.owned_dofs, dtype=bool), rigid_node_motions(operators)
    inverse = IterativeInverse(operators, fixed, motions)
    basis = np.linalg.qr(motions)[0]
    loads = loads_on(operators, 3)
    balanced = loads - basis @ (basis.T @ loads)
    found = inverse.solve(loads)
    assert np.abs(basis.T @ found).max() < 1e-10 * np.abs(found).max()
    rest = operators.apply_stiffness(found) - balanced
    assert np.abs(rest).max() < 1e-4 * np.abs(balanced).max()
    inverse.close()


def test_a_load_of_zero_moves_nothing() -> None:
    operators = assemble("tet10")
    fixed = foot_of(operators)
    inverse = IterativeInverse(operators, fixed, np.zeros((len(fixed), 0)))
    loads = loads_on(operators, 2)
    loads[:, 0] = 0.0
    found = inverse.solve(loads)
    assert not found[:, 0].any() and found[:, 1].any()
    inverse.close()


def test_a_solve_that_stalls_names_what_is_left_and_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(multigrid, "MOST_STEPS", 3)
    operators = assemble("tet10")
    fixed = foot_of(operators)
    inverse = IterativeInverse(operators, fixed, np.zeros((len(fixed), 0)))
    with pytest.raises(ConvergenceError, match=r'left an error of .* after 3 steps.*"direct"'):
        inverse.solve(loads_on(operators, 2))
    inverse.close()


def test_without_its_corner_level_there_is_no_multigrid() -> None:
    operators = assemble("tet10", with_corners=False)
    fixed = foot_of(operators)
    with pytest.raises(AccuracyError, match="corner level"):
        Multigrid(operators, fixed, np.zeros((len(fixed), 0)))
