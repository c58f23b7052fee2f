"""What a block of Lanczos costs."""

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.block_lanczos import ModeTarget, lowest_eigenpairs

SIZE = 240


@pytest.fixture(scope="module")
def matrices() -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(11)
    basis = np.linalg.qr(rng.standard_normal((SIZE, SIZE)))[0]
    mass = basis @ np.diag(rng.uniform(0.5, 2.0, SIZE)) @ basis.T
    shapes = np.linalg.qr(rng.standard_normal((SIZE, SIZE)))[0]
    stiffness = shapes @ np.diag(np.arange(1.0, SIZE + 1.0) ** 4) @ shapes.T
    return 0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T)


class Counter:
    def __init__(self, matrix: FloatArray) -> None:
        self.matrix, self.calls = matrix, 0

    def __call__(self, block: FloatArray) -> FloatArray:
        self.calls += 1
        return self.matrix @ block


def test_a_block_costs_one_solve_and_about_one_mass_product(
    matrices: tuple[FloatArray, FloatArray],
) -> None:
    stiffness, mass = matrices
    inverse, massive = (
        Counter(np.asarray(np.linalg.inv(stiffness), dtype=np.float64)),
        Counter(mass),
    )
    start = np.random.default_rng(5).standard_normal((SIZE, 4))
    lowest_eigenpairs(
        inverse, massive, start, ModeTarget(count=12), comm=MPI.COMM_SELF, dimension=SIZE
    )
    assert massive.calls <= 2 * inverse.calls
