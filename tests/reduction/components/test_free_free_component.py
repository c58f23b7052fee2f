"""a component that nothing holds: six rigid modes, and elastic ones that do not depend on any
shift.
"""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.reduction.components.elastic import reduce_elastic
from headstock.solvers.elastic.sturm_count import count_frequencies_below
from headstock.validation.parts.component_models import (
    FullModel,
    full_model,
    full_modes,
)

pytestmark = pytest.mark.hard("H02")

COMM = MPI.COMM_SELF
SIZE = (0.038, 0.1, 0.5)
# of the first elastic eigenvalue; below them the shifted matrix of the other method is singular to
# working accuracy
SHIFTS = (1e-6, 1e-4, 1e-1, 1e2, 1e4)


@pytest.fixture(scope="module")
def block() -> tuple[FullModel, FloatArray]:
    mesh = make_box((1, 2, 6), SIZE, kind="tet10")
    model = full_model(mesh, make_component().material, comm=COMM)
    return model, full_modes(model, 6).frequencies_hz


def test_there_are_six_rigid_modes_and_no_more_below_the_first_elastic_one(
    block: tuple[FullModel, FloatArray],
) -> None:
    model, elastic = block
    fixed = np.zeros(model.operators.owned_dofs, dtype=bool)
    assert count_frequencies_below(model.operators, fixed, 0.999 * elastic[0]) == 6
    assert count_frequencies_below(model.operators, fixed, 1.001 * elastic[5]) == 12


@pytest.mark.parametrize("share", SHIFTS)
def test_elastic_frequencies_equal_those_of_a_shifted_solve_over_ten_decades(
    block: tuple[FullModel, FloatArray], share: float
) -> None:
    model, elastic = block
    stiffness = scipy.sparse.csc_matrix(model.operators.stiffness)
    mass = scipy.sparse.csc_matrix(scipy.sparse.kron(model.operators.scalar_mass, np.eye(3)))
    shift = -share * (2.0 * np.pi * elastic[0]) ** 2
    start = np.random.default_rng(1).standard_normal(stiffness.shape[0])
    _, shapes = scipy.sparse.linalg.eigsh(stiffness, 12, mass, sigma=shift, v0=start, ncv=80)
    # what a nearly singular factorisation blurs, Rayleigh and Ritz restore from K and M themselves
    values = scipy.linalg.eigvalsh(shapes.T @ stiffness @ shapes, shapes.T @ mass @ shapes)
    shifted = np.sqrt(np.abs(values)) / (2.0 * np.pi)
    assert shifted[:6].max() < 1e-3 * elastic[0]
    np.testing.assert_allclose(shifted[6:], elastic, rtol=1e-6)


def test_a_loose_component_reduces_to_its_rigid_motions_and_free_free_modes(
    block: tuple[FullModel, FloatArray],
) -> None:
    model, elastic = block
    element = reduce_elastic(make_component(modes=6, size=SIZE), model.mesh, comm=COMM)
    np.testing.assert_allclose(element.modal_frequencies_hz[:6], elastic, rtol=1e-9)
    assert np.abs(element.stiffness[:6, :6]).max() < 1e-9 * model.operators.stiffness_scale
    assert np.abs(element.mass[:6, 6:]).max() < 1e-9 * np.sqrt(element.mass_kg)
