"""Claims about unreduced models."""

import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh
from headstock.validation.parts.component_models import (
    FullModel,
    free_motions,
    full_displacement,
    full_model,
    full_modes,
    rigid_frequencies,
)
from headstock.validation.parts.structured_meshes import lattice_mesh, straight_lattice

STEEL = Material("steel", 210e9, 0.3, 7850.0)


@pytest.fixture
def mesh() -> ComponentMesh:
    return lattice_mesh(straight_lattice((1, 1, 4), (0.04, 0.06, 0.2)), "hex27", straight=True)


def dense_frequencies(model: FullModel) -> FloatArray:
    count = 3 * len(model.mesh.points)
    unit = model.owned(np.eye(count).reshape(-1, 3, count))
    stiffness = model.everywhere(model.operators.apply_stiffness(unit)).reshape(count, count)
    mass = model.everywhere(model.operators.apply_mass(unit)).reshape(count, count)
    free = np.flatnonzero(~model.fixed.ravel())
    blocks = (matrix[np.ix_(free, free)] for matrix in (stiffness, mass))
    values = scipy.linalg.eigh(*blocks, eigvals_only=True)
    return np.asarray(np.sqrt(np.abs(values)) / (2.0 * np.pi))


def test_clamped_modes_equal_dense_algebra(mesh: ComponentMesh) -> None:
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    model = full_model(mesh, STEEL, comm=MPI.COMM_SELF, fixed=fixed)
    found = full_modes(model, 8).frequencies_hz[:8]
    np.testing.assert_allclose(found, dense_frequencies(model)[:8], rtol=1e-9)


def test_free_modes_equal_dense_algebra_without_its_six_rigid_ones(mesh: ComponentMesh) -> None:
    model = full_model(mesh, STEEL, comm=MPI.COMM_SELF)
    found = full_modes(model, 8).frequencies_hz[:8]
    np.testing.assert_allclose(found, dense_frequencies(model)[6:14], rtol=1e-9)
    assert rigid_frequencies(model).max() < 1e-5 * found[0]


def test_a_face_fixed_along_one_axis_leaves_three_rigid_motions(mesh: ComponentMesh) -> None:
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.points[:, 2] < 1e-9, 2] = True
    model = full_model(mesh, STEEL, comm=MPI.COMM_SELF, fixed=fixed)
    assert free_motions(model).shape[1] == 3
    found = full_modes(model, 5).frequencies_hz[:5]
    np.testing.assert_allclose(found, dense_frequencies(model)[3:8], rtol=1e-9)


def test_means_hold_a_body_without_holding_any_node(mesh: ComponentMesh) -> None:
    motions = rigid_map(mesh.points, mesh.points.mean(axis=0))
    model = full_model(mesh, STEEL, comm=MPI.COMM_SELF, means=motions.reshape(-1, 3, 6))
    assert free_motions(model).shape[1] == 0
    displacement = full_displacement(model, (mesh.points[:, :1] - 0.02) * [1.0, 0.0, 0.0])
    largest = np.abs(displacement).max()
    mean = motions.T @ displacement.ravel()
    np.testing.assert_allclose(mean, 0.0, atol=1e-12 * largest * len(motions))
    assert largest > 0.0


def test_modes_of_a_pair_are_both_found_in_a_square_bar() -> None:
    square = lattice_mesh(straight_lattice((1, 1, 4), (0.05, 0.05, 0.3)), "hex27", straight=True)
    fixed = np.repeat(square.points[:, 2:] < 1e-9, 3, axis=1)
    found = full_modes(full_model(square, STEEL, comm=MPI.COMM_SELF, fixed=fixed), 4).frequencies_hz
    assert found[1] / found[0] - 1.0 < 1e-9
    assert found[2] / found[1] > 2.0
