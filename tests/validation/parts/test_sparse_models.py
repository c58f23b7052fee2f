"""The second method for the reduction."""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh
from headstock.validation.parts.component_models import (
    all_frequencies,
    fixed_compliance,
    full_model,
    full_modes,
    guyan_matrices,
    lowest_frequencies,
    rigid_face_matrices,
)
from headstock.validation.parts.structured_meshes import (
    lattice_mesh,
    lattice_sides,
    straight_lattice,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
CENTERS = {"w-": np.array([0.02, 0.03, 0.0]), "w+": np.array([0.02, 0.03, 0.3])}


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    lattice = straight_lattice((1, 1, 5), (0.04, 0.06, 0.3))
    mesh = lattice_mesh(lattice, "hex27", straight=True)
    return dataclasses.replace(mesh, patches=lattice_sides(lattice.shape[:3]))


def test_without_rigid_faces_the_elastic_modes_are_those_of_the_distributed_model(
    mesh: ComponentMesh,
) -> None:
    found = full_modes(full_model(mesh, STEEL, comm=MPI.COMM_SELF), 6).frequencies_hz[:6]
    dense = all_frequencies(rigid_face_matrices(mesh, STEEL, {}))[6:12]
    np.testing.assert_allclose(dense, found, rtol=1e-9)


def test_shift_and_invert_finds_what_dense_algebra_finds(mesh: ComponentMesh) -> None:
    matrices = rigid_face_matrices(mesh, STEEL, CENTERS)
    dense = all_frequencies(matrices)[6:12]
    np.testing.assert_allclose(lowest_frequencies(matrices, 12)[6:], dense, rtol=1e-9)


def test_rigid_faces_raise_every_frequency(mesh: ComponentMesh) -> None:
    free = all_frequencies(rigid_face_matrices(mesh, STEEL, {}))[6:14]
    stiffened = all_frequencies(rigid_face_matrices(mesh, STEEL, CENTERS))[6:14]
    assert np.all(stiffened > free)


def test_guyan_mass_holds_the_whole_mass_and_guyan_stiffness_the_static_compliance(
    mesh: ComponentMesh,
) -> None:
    matrices = rigid_face_matrices(mesh, STEEL, CENTERS)
    stiffness, mass = guyan_matrices(matrices)
    along = np.tile([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2)
    assert along @ mass @ along == approx(7850.0 * 0.04 * 0.06 * 0.3, rel=1e-10)
    held = np.linalg.inv(stiffness[6:, 6:])
    np.testing.assert_allclose(held, fixed_compliance(matrices), rtol=1e-7, atol=1e-16)
