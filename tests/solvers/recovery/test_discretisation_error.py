from collections.abc import Callable

import numpy as np
import pytest

from common import approx, make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.meshing.elements.topology import cell_shape_functions, shape_gradients
from headstock.solvers.recovery.discretisation_error import (
    estimate_cell_errors,
    estimate_mesh_errors,
)
from headstock.solvers.recovery.patch_recovery import gauss_places

SIZE = (0.2, 0.3, 0.5)
ORDERS = {"tet4": 1, "hex8": 1, "tet10": 2, "hex27": 2}


def true_missing_energy(
    mesh: ComponentMesh,
    material: Material,
    gradient: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
) -> float:
    """Squared energy norm of what nodal values of a field leave out, by an interpolation of their
    own and many places per cell.
    """
    places, weights = gauss_places(mesh.kind, 8)
    nodes = mesh.points[mesh.cells]
    slopes = shape_gradients(mesh.kind, places)
    jacobians = np.einsum("rqn,cnd->cqrd", slopes, nodes)
    values = gradient(mesh.points)[0][mesh.cells]
    found = np.einsum("cqdr,rqn,cni->cqid", np.linalg.inv(jacobians), slopes, values)
    where = np.einsum("qn,cnd->cqd", cell_shape_functions(mesh.kind, places), nodes)
    difference = found - gradient(where)[1]
    strain = 0.5 * (difference + np.swapaxes(difference, -1, -2))
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    density = (
        2.0 * shear * (strain**2).sum(axis=(-2, -1))
        + lame * np.trace(strain, axis1=-2, axis2=-1) ** 2
    )
    return float((density * np.abs(np.linalg.det(jacobians)) * weights).sum())


def wave(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A smooth displacement that no element holds, and its gradient."""
    phase = points @ np.array([6.0, 3.0, 5.0])
    direction = np.array([1.0, -0.5, 0.7])
    return np.sin(phase)[..., None] * direction, np.cos(phase)[..., None, None] * np.multiply.outer(
        direction, np.array([6.0, 3.0, 5.0])
    )


@pytest.mark.parametrize("kind", ORDERS)
def test_a_stress_that_the_elements_hold_misses_no_energy(kind: CellKind) -> None:
    mesh, material = make_box((2, 2, 3), SIZE, kind=kind), make_component().material
    turn = np.array([[1.0, 2.0, 0.5], [0.3, -1.0, 0.2], [0.0, 0.7, 3.0]])
    moved = (
        mesh.points @ turn.T if ORDERS[kind] == 1 else (mesh.points @ turn.T) * mesh.points[:, ::-1]
    )
    energy = estimate_mesh_errors(mesh, material, moved.reshape(-1, 1)).missing_energy
    assert energy[0, 0] < 1e-10 * material.youngs_modulus * np.prod(SIZE)


@pytest.mark.parametrize("kind", ORDERS)
def test_what_interpolation_loses_of_a_wave_is_found_within_a_factor_of_two_and_falls_with_twice_the_order(
    kind: CellKind,
) -> None:
    material = make_component().material
    ratios, sizes = [], []
    for count in (4, 8):
        mesh = make_box((count // 2, count, count), SIZE, kind=kind)
        found = float(
            estimate_mesh_errors(
                mesh, material, wave(mesh.points)[0].reshape(-1, 1)
            ).missing_energy[0, 0]
        )
        ratios.append(found / true_missing_energy(mesh, material, wave))
        sizes.append(found)
    assert 0.5 < min(ratios) <= max(ratios) < 2.0
    assert np.log2(sizes[0] / sizes[1]) == approx(2 * ORDERS[kind], abs=0.6)


def test_products_are_those_of_the_sum_of_fields() -> None:
    mesh, material = make_box((2, 2, 3), SIZE, kind="tet10"), make_component().material
    fields = np.column_stack([wave(mesh.points)[0].ravel(), np.cos(9.0 * mesh.points).ravel()])
    both = estimate_mesh_errors(mesh, material, fields).missing_energy
    together = estimate_mesh_errors(
        mesh, material, fields @ np.array([[1.0], [-2.0]])
    ).missing_energy
    assert together[0, 0] == approx(both[0, 0] - 4.0 * both[0, 1] + 4.0 * both[1, 1], rel=1e-4)
    np.testing.assert_array_equal(both, both.T)


def test_one_cell_alone_is_no_obstacle() -> None:
    mesh, material = make_box((1, 1, 1), SIZE, kind="hex27"), make_component().material
    assert np.isfinite(
        estimate_mesh_errors(mesh, material, wave(mesh.points)[0].reshape(-1, 1)).missing_energy
    ).all()


def test_curved_cells_are_measured_where_they_are() -> None:
    material = make_component().material

    def bend(points: FloatArray) -> FloatArray:
        return points + 0.02 * np.sin(8.0 * points[:, ::-1])

    mesh = make_box((3, 4, 5), SIZE, kind="tet10", warp=bend, straight=False)
    found = float(
        estimate_mesh_errors(mesh, material, wave(mesh.points)[0].reshape(-1, 1)).missing_energy[
            0, 0
        ]
    )
    assert 0.4 < found / true_missing_energy(mesh, material, wave) < 2.5


@pytest.mark.parametrize("kind", ORDERS)
def test_errors_of_cells_add_up_to_those_of_the_mesh(kind: CellKind) -> None:
    mesh, material = make_box((2, 2, 3), SIZE, kind=kind), make_component().material
    value = wave(mesh.points)[0].reshape(-1, 1)
    fields = np.hstack([value, value**2])
    weights = np.asarray(np.linspace(1.0, 2.0, len(mesh.cells)), dtype=np.float64)
    whole = estimate_mesh_errors(mesh, material, fields, weights).missing_energy
    cells = estimate_cell_errors(mesh, material, fields, weights)
    assert cells.shape == (len(mesh.cells), 2)
    assert cells.sum(axis=0) == approx(np.diag(whole), rel=1e-5)
