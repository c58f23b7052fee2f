"""repeated modes: none lost, no pair split, the same subspace from every method."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from elastic_pencils import eigen_problem
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.block_lanczos import block_lanczos_pairs
from headstock.solvers.elastic.constrained_modes import lowest_modes
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.validation.parts.component_models import FullModel, FullModes, full_model, full_modes

pytestmark = pytest.mark.hard("H05")

COMM = MPI.COMM_SELF
SIDE, HEIGHT = 0.1, 0.8


@pytest.fixture(scope="module")
def column() -> tuple[FullModel, FullModes]:
    """A square column clamped at its foot: bending comes in pairs."""
    mesh = make_box((2, 2, 6), (SIDE, SIDE, HEIGHT))
    fixed = np.repeat((mesh.points[:, 2] < 1e-9)[:, None], 3, axis=1)
    model = full_model(mesh, make_component().material, comm=COMM, fixed=fixed)
    return model, full_modes(model, 10)


def angle(model: FullModel, one: FloatArray, other: FloatArray) -> float:
    """Sine of the largest angle between two subspaces, in the mass."""
    basis = model.operators.apply_mass(one)
    gram = np.linalg.inv(one.T @ basis) @ (basis.T @ other)
    rest = other - one @ gram
    sizes = np.sqrt(np.linalg.eigvalsh(rest.T @ model.operators.apply_mass(rest)).clip(0.0)[-1])
    return float(
        sizes / np.sqrt(np.linalg.eigvalsh(other.T @ model.operators.apply_mass(other))[0])
    )


def equals(frequencies: FloatArray) -> list[int]:
    return [
        i for i in range(len(frequencies) - 1) if frequencies[i + 1] < frequencies[i] * (1.0 + 1e-4)
    ]


def test_twins_of_a_symmetric_mesh_are_not_split(column: tuple[FullModel, FullModes]) -> None:
    _, modes = column
    pairs = equals(modes.frequencies_hz)
    assert len(pairs) >= 3 and pairs[0] == 0
    split = [modes.frequencies_hz[i + 1] / modes.frequencies_hz[i] - 1.0 for i in pairs]
    assert max(split) < 1e-7


def test_the_multiplicity_of_every_mode_is_that_of_a_sturm_count(
    column: tuple[FullModel, FullModes],
) -> None:
    model, modes = column
    found = modes.frequencies_hz
    gaps = [i for i in range(1, len(found)) if found[i] > found[i - 1] * (1.0 + 1e-4)]
    assert gaps
    for below in gaps:
        middle = 0.5 * (found[below - 1] + found[below])
        assert count_frequencies_below(model.operators, model.owned_fixed, middle) == below


def test_twins_span_the_same_plane_in_another_solver(column: tuple[FullModel, FullModes]) -> None:
    model, modes = column
    free = np.flatnonzero(~model.owned_fixed)
    stiffness = scipy.sparse.csc_matrix(model.operators.stiffness)[free][:, free]
    mass = scipy.sparse.csc_matrix(scipy.sparse.kron(model.operators.scalar_mass, np.eye(3)))[free][
        :, free
    ]
    start = np.random.default_rng(5).standard_normal(len(free))
    _, vectors = scipy.sparse.linalg.eigsh(stiffness, 12, mass, sigma=0.0, v0=start)
    other: FloatArray = np.zeros((model.operators.owned_dofs, 12))
    other[free] = vectors
    order = np.argsort(np.einsum("ij,ij->j", other, model.operators.apply_stiffness(other)))
    other = other[:, order]
    pairs = equals(modes.frequencies_hz)
    assert pairs
    for first in pairs:
        assert angle(model, modes.shapes[:, first : first + 2], other[:, first : first + 2]) < 1e-6


def test_twins_span_the_same_plane_from_any_start(column: tuple[FullModel, FullModes]) -> None:
    model, modes = column
    start = np.random.default_rng(99).standard_normal((model.operators.owned_dofs, 8))
    with ConstrainedSolver(model.operators, model.owned_fixed, np.zeros((len(start), 0))) as solver:
        again = lowest_modes(solver, start, ModeTarget(count=8))
    pairs = [first for first in equals(modes.frequencies_hz) if first + 1 < 8]
    assert pairs
    for first in pairs:
        assert (
            angle(model, modes.shapes[:, first : first + 2], again.vectors[:, first : first + 2])
            < 1e-6
        )


@pytest.mark.parametrize("multiplicity", [5, 7, 13])
def test_a_mode_that_occurs_more_often_than_the_block_is_wide_is_found_completely(
    multiplicity: int,
) -> None:
    # a sphere has 5-fold modes and a cross of beams 7-fold ones; the block has 4 columns
    rng = np.random.default_rng(multiplicity)
    values = np.concatenate([[1.0], np.full(multiplicity, 2.0), np.linspace(3.0, 400.0, 300)])
    size = len(values)
    turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
    inverse = (turn / values) @ turn.T
    start = rng.standard_normal((size, 4))
    problem = eigen_problem(lambda x: inverse @ x, lambda x: x, size)
    found = block_lanczos_pairs(problem, start, ModeTarget(count=3 + multiplicity)).values
    np.testing.assert_allclose(found[: 1 + multiplicity], values[: 1 + multiplicity], rtol=1e-9)
    np.testing.assert_allclose(found, values[: len(found)], rtol=1e-7)
