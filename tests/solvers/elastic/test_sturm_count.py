import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import ComponentMesh
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.solvers.errors import AccuracyError

COMM = MPI.COMM_SELF
SIZE = (0.1, 0.13, 0.4)


@pytest.fixture(scope="module")
def block() -> tuple[ComponentMesh, ElasticOperators]:
    mesh = make_box((1, 1, 3), SIZE)
    return mesh, assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)


def dense_pencil(operators: ElasticOperators) -> tuple[FloatArray, FloatArray]:
    order = np.argsort(operators.nodes)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    assert operators.scalar_mass is not None
    mass = np.kron(operators.scalar_mass.toarray(), np.eye(3))
    return operators.stiffness.toarray()[np.ix_(dofs, dofs)], mass[np.ix_(dofs, dofs)]


def frequencies(stiffness: FloatArray, mass: FloatArray) -> FloatArray:
    factor = np.linalg.inv(np.linalg.cholesky(mass))
    return np.asarray(
        np.sqrt(np.abs(np.linalg.eigvalsh(factor @ stiffness @ factor.T))) / (2.0 * np.pi)
    )


def between(values: FloatArray, count: int) -> float:
    return float(0.5 * (values[count - 1] + values[count]))


def test_the_count_of_a_clamped_block_is_that_of_all_its_eigenvalues(
    block: tuple[ComponentMesh, ElasticOperators],
) -> None:
    mesh, operators = block
    foot = mesh.points[:, 2] < 1e-9
    free = np.repeat(~foot, 3)
    stiffness, mass = dense_pencil(operators)
    found = frequencies(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)])
    fixed = np.repeat(foot[operators.nodes], 3)
    counts = [1, 2, 5, 40, len(found) - 1]
    below = [between(found, count) for count in counts]
    assert [count_frequencies_below(operators, fixed, hz) for hz in below] == counts


def test_rigid_motions_of_a_free_block_are_counted(
    block: tuple[ComponentMesh, ElasticOperators],
) -> None:
    _, operators = block
    found = frequencies(*dense_pencil(operators))
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    assert count_frequencies_below(operators, fixed, 0.5 * found[6]) == 6


def test_means_fixed_at_zero_take_their_modes_out_of_the_count(
    block: tuple[ComponentMesh, ElasticOperators],
) -> None:
    mesh, operators = block
    everywhere = np.random.default_rng(3).standard_normal((len(mesh.points), 3, 7))
    constraints = everywhere[operators.nodes].reshape(-1, 7)
    stiffness, mass = dense_pencil(operators)
    basis = np.linalg.qr(everywhere.reshape(-1, 7), mode="complete")[0][:, 7:]
    found = frequencies(basis.T @ stiffness @ basis, basis.T @ mass @ basis)
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    below = [between(found, count) for count in (1, 4, 30)]
    assert [
        count_frequencies_below(operators, fixed, hz, constraints=constraints) for hz in below
    ] == [1, 4, 30]


def test_a_component_without_free_dofs_has_no_frequencies(
    block: tuple[ComponentMesh, ElasticOperators],
) -> None:
    _, operators = block
    assert count_frequencies_below(operators, np.ones(operators.owned_dofs, dtype=bool), 1e9) == 0


def test_a_count_without_mass_is_refused(block: tuple[ComponentMesh, ElasticOperators]) -> None:
    _, operators = block
    with pytest.raises(AccuracyError, match="mass"):
        count_frequencies_below(
            dataclasses.replace(operators, scalar_mass=None),
            np.zeros(operators.owned_dofs, dtype=bool),
            1.0,
        )
