import numpy as np
import pytest

from common import make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.errors import ModelError
from headstock.solvers.stresses import pack_tensor

SIZE = (0.2, 0.3, 0.5)
MATERIAL = make_component().material
GRADIENT = np.array([[1.0, 2.0, 0.5], [0.3, -1.0, 0.2], [0.0, 0.7, 3.0]]) * 1e-4
PLACES = np.array([[0.05, 0.07, 0.11], [0.1, 0.15, 0.25], [0.0, 0.0, 0.0], [0.19, 0.29, 0.49]])


def hooke(material: Material, gradient: FloatArray) -> FloatArray:
    strain = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    return np.asarray(
        2.0 * shear * strain
        + lame * np.trace(strain, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    )


def recover(mesh: ComponentMesh, field: FloatArray, places: FloatArray) -> FloatArray:
    """Displacement and stress ``(n, 9)`` at places."""
    rows = [find_point_rows(mesh, MATERIAL, place) for place in places]
    return np.array([each.apply(field.reshape(-1, 1))[:, 0] for each in rows])


@pytest.mark.parametrize("kind", ["tet4", "hex8", "tet10", "hex27"])
def test_a_linear_displacement_comes_back_with_its_stress_inside_cells_and_at_nodes(
    kind: CellKind,
) -> None:
    mesh = make_box((1, 2, 2), SIZE, kind=kind)
    found = recover(mesh, mesh.points @ GRADIENT.T, PLACES)
    np.testing.assert_allclose(found[:, :3], PLACES @ GRADIENT.T, atol=1e-15)
    exact = np.broadcast_to(pack_tensor(hooke(MATERIAL, GRADIENT)), (len(PLACES), 6))
    np.testing.assert_allclose(found[:, 3:], exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("kind", ["tet10", "hex27"])
def test_second_order_elements_hold_a_linear_stress_exactly(kind: CellKind) -> None:
    mesh = make_box((1, 2, 2), SIZE, kind=kind)
    field = np.column_stack(
        [mesh.points[:, 2] ** 2, mesh.points[:, 0] * mesh.points[:, 1], 0.0 * mesh.points[:, 0]]
    )
    found = recover(mesh, field, PLACES)
    gradients = np.zeros((len(PLACES), 3, 3))
    gradients[:, 0, 2], gradients[:, 1, 0], gradients[:, 1, 1] = (
        2.0 * PLACES[:, 2],
        PLACES[:, 1],
        PLACES[:, 0],
    )
    exact = pack_tensor(hooke(MATERIAL, gradients))
    np.testing.assert_allclose(found[:, 3:], exact, atol=1e-9 * np.abs(exact).max())


def test_a_stress_that_jumps_between_cells_is_averaged() -> None:
    mesh = make_box((1, 1, 2), SIZE, kind="hex8")
    field = np.zeros((len(mesh.points), 3))
    field[:, 2] = np.abs(mesh.points[:, 2] - 0.25) * 1e-4
    between = mesh.points[np.abs(mesh.points[:, 2] - 0.25) < 1e-12][:1]
    assert np.abs(recover(mesh, field, between)[0, 3:]).max() < 1e-6


def test_a_continuous_field_is_read_at_nodes_and_inside_cells() -> None:
    mesh = make_box((1, 2, 2), SIZE, kind="tet10")
    rows = [find_point_rows(mesh, MATERIAL, place) for place in PLACES]
    found = [each.read(mesh.points[each.nodes] ** 2) for each in rows]
    np.testing.assert_allclose(found, PLACES**2, atol=1e-12)


def test_a_point_outside_is_refused() -> None:
    with pytest.raises(ModelError, match="outside"):
        find_point_rows(make_box((1, 2, 2), SIZE), MATERIAL, np.array([0.1, 0.1, 0.51]))
