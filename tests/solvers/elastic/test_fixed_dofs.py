"""fixed dofs are taken out, not kept with a one on the diagonal: they bring no modes of their
own.
"""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from common import make_box, make_component
from headstock.validation.parts.component_models import FullModel, FullModes, full_model, full_modes

pytestmark = pytest.mark.hard("H07")

COMM = MPI.COMM_SELF


@pytest.fixture(
    scope="module",
    params=[2.1e11, 2.1e-2],
    ids=["steel", "a stiffness whose frequencies lie about 1 rad/s"],
)
def block(request: pytest.FixtureRequest) -> tuple[FullModel, FullModes]:
    mesh = make_box((1, 1, 3), (0.1, 0.13, 0.4))
    fixed = np.repeat((mesh.points[:, 2] < 1e-9)[:, None], 3, axis=1)
    material = dataclasses.replace(make_component().material, youngs_modulus=request.param)
    model = full_model(mesh, material, comm=COMM, fixed=fixed)
    return model, full_modes(model, 12)


def test_no_shape_moves_a_fixed_dof(block: tuple[FullModel, FullModes]) -> None:
    model, modes = block
    assert np.abs(modes.shapes[model.owned_fixed]).max() == 0.0


def test_frequencies_are_those_of_the_free_block_alone(block: tuple[FullModel, FullModes]) -> None:
    model, modes = block
    free = ~model.owned_fixed
    stiffness = model.operators.stiffness.toarray()[np.ix_(free, free)]
    assert model.operators.scalar_mass is not None
    mass = np.kron(model.operators.scalar_mass.toarray(), np.eye(3))[np.ix_(free, free)]
    exact = np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)) / (2.0 * np.pi)
    np.testing.assert_allclose(modes.frequencies_hz, exact[: len(modes.frequencies_hz)], rtol=1e-9)
