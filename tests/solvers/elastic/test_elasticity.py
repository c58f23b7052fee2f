import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.component_mesh import ComponentMesh
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.errors import AccuracyError

COMM = MPI.COMM_SELF
SIZE = (0.2, 0.3, 0.5)
KINDS = ["tet4", "hex8", "tet10", "hex27"]


def slanted(points: FloatArray) -> FloatArray:
    return np.asarray(points @ np.array([[1.0, 0.0, 0.0], [0.3, 1.1, 0.0], [-0.2, 0.4, 0.9]]))


@pytest.fixture(params=KINDS)
def mesh(request: pytest.FixtureRequest) -> ComponentMesh:
    return make_box((1, 2, 2), SIZE, kind=request.param, warp=slanted)


def owned(operators: ElasticOperators, field: FloatArray) -> FloatArray:
    return field[operators.nodes].reshape(-1, 1)


def test_every_rigid_motion_is_free_of_force(mesh: ComponentMesh) -> None:
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=False)
    motions = rigid_map(operators.points, np.zeros(3))
    assert np.abs(operators.apply_stiffness(motions)).max() < 1e-12 * operators.stiffness_scale


def test_a_uniform_strain_holds_the_energy_of_theory(mesh: ComponentMesh) -> None:
    material = make_component().material
    operators = assemble_elasticity(mesh, material, comm=COMM, with_mass=False)
    gradient = np.array([[1.0, 2.0, 0.5], [0.3, -1.0, 0.2], [0.0, 0.7, 3.0]])
    strain = 0.5 * (gradient + gradient.T)
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    energy = 2.0 * shear * (strain * strain).sum() + lame * np.trace(strain) ** 2
    field = owned(operators, mesh.points @ gradient.T)
    assert (field.T @ operators.apply_stiffness(field))[0, 0] == approx(
        energy * mesh.quality.volume, rel=1e-12
    )


def test_the_mass_of_a_rigid_motion_is_mass_and_inertia(mesh: ComponentMesh) -> None:
    material = make_component().material
    operators = assemble_elasticity(mesh, material, comm=COMM, with_mass=True)
    sideways = owned(operators, np.tile([0.0, 1.0, 0.0], (len(mesh.points), 1)))
    assert (sideways.T @ operators.apply_mass(sideways))[0, 0] == approx(
        material.density * mesh.quality.volume, rel=1e-12
    )
    linear = owned(operators, np.column_stack([mesh.points[:, 2], 0 * mesh.points[:, :2]]))
    height = mesh.points[:, 2].max()
    corner = np.ptp(mesh.points[:, 2])
    assert corner == approx(height - mesh.points[:, 2].min())
    # z runs evenly from end to end of a parallelepiped whose faces z = const are parallel
    assert (linear.T @ operators.apply_mass(linear))[0, 0] == approx(
        material.density * mesh.quality.volume * corner**2 / 3.0, rel=1e-12
    )


def test_mass_and_stiffness_are_symmetric(mesh: ComponentMesh) -> None:
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    assert operators.scalar_mass is not None
    for matrix in (operators.stiffness.toarray(), operators.scalar_mass.toarray()):
        assert np.abs(matrix - matrix.T).max() < 1e-14 * np.abs(matrix).max()


def test_without_mass_a_dynamic_quantity_is_refused(mesh: ComponentMesh) -> None:
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=False)
    assert operators.scalar_mass is None
    with pytest.raises(AccuracyError, match="not assembled"):
        operators.apply_mass(np.zeros((operators.owned_dofs, 1)))


def test_a_mesh_whose_stated_volume_is_wrong_is_noticed(mesh: ComponentMesh) -> None:
    wrong = dataclasses.replace(
        mesh, quality=dataclasses.replace(mesh.quality, volume=1.001 * mesh.quality.volume)
    )
    with pytest.raises(AccuracyError, match="assembled mass"):
        assemble_elasticity(wrong, make_component().material, comm=COMM, with_mass=True)


def test_an_empty_block_of_vectors_stays_empty(mesh: ComponentMesh) -> None:
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    nothing = np.zeros((operators.owned_dofs, 0))
    assert (
        operators.apply_stiffness(nothing).shape
        == operators.apply_mass(nothing).shape
        == nothing.shape
    )
