import math

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Load, Patch
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.components.nodal_loads import assemble_loads
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity

COMM = MPI.COMM_SELF
SIZE = (0.2, 0.3, 0.5)
TOP = (Patch("z+"),)
LOADS = (
    Load("oil", "body", "pressure", TOP, magnitude=2e6),
    Load("wind", "body", "traction", TOP, vector=(1.0, 2.0, 3.0)),
    Load("spin", "body", "body", vector=(0.0, 0.0, 1.0)),
    Load("push", "body", "force", interface="top", vector=(1.0,) * 6),
    Load("elsewhere", "other", "pressure", TOP, magnitude=1.0),
)
Case = tuple[ComponentMesh, ElasticOperators, dict[str, FloatArray]]


@pytest.fixture(scope="module", params=["tet10", "hex27", "tet4", "hex8"])
def case(request: pytest.FixtureRequest) -> Case:
    mesh = make_box(
        (2, 2, 3), SIZE, {"load:oil": "z+", "load:wind": "z+", "top": "z+"}, kind=request.param
    )
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    vectors = assemble_loads(make_component(), mesh, operators, LOADS, gravity=True)
    return mesh, operators, vectors


def resultant(operators: ElasticOperators, vector: FloatArray) -> FloatArray:
    """Force and moment about the origin."""
    return rigid_map(operators.points, np.zeros(3)).T @ vector


def test_a_pressure_pushes_inward_through_the_centroid_with_all_its_area(case: Case) -> None:
    mesh, operators, vectors = case
    force = -2e6 * SIZE[0] * SIZE[1]
    middle = measure_patch(mesh, "top").centroid
    exact = [0.0, 0.0, force, middle[1] * force, -middle[0] * force, 0.0]
    np.testing.assert_allclose(
        resultant(operators, vectors["oil"]), exact, rtol=1e-12, atol=1e-11 * abs(force)
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_traction_comes_as_one_pascal_along_each_axis(case: Case, axis: int) -> None:
    mesh, operators, vectors = case
    area = SIZE[0] * SIZE[1]
    force = area * np.eye(3)[axis]
    exact = [*force, *np.cross(measure_patch(mesh, "top").centroid, force)]
    np.testing.assert_allclose(
        resultant(operators, vectors["wind:" + "xyz"[axis]]), exact, rtol=1e-12, atol=1e-12 * area
    )


@pytest.mark.parametrize("name", ["gravity", "spin"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_unit_acceleration_acts_on_the_whole_mass_at_its_centre(
    case: Case, name: str, axis: int
) -> None:
    _, operators, vectors = case
    mass = 7850.0 * math.prod(SIZE)
    force = mass * np.eye(3)[axis]
    exact = [*force, *np.cross(0.5 * np.array(SIZE), force)]
    np.testing.assert_allclose(
        resultant(operators, vectors[f"{name}:" + "xyz"[axis]]),
        exact,
        rtol=1e-11,
        atol=1e-11 * mass,
    )


def test_forces_at_interfaces_and_loads_on_other_components_bring_no_vectors(case: Case) -> None:
    names = {name.split(":")[0] for name in case[2]}
    assert names == {"oil", "wind", "spin", "gravity"}
