"""Claims about shape functions and integrals in numpy."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind
from headstock.validation.parts.structured_meshes import (
    field_error,
    integrate_over_cells,
    lattice_mesh,
    node_places,
    shape_functions,
    straight_lattice,
)

KINDS: list[CellKind] = ["tet4", "tet10", "hex8", "hex27"]


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_are_one_at_their_node_and_sum_to_one(kind: CellKind) -> None:
    values, _ = shape_functions(kind, node_places(kind))
    np.testing.assert_allclose(values, np.eye(int(kind[3:])), atol=1e-13)
    values, gradients = shape_functions(kind, np.array([[0.2, 0.3, 0.1]]))
    assert values.sum() == approx(1.0, rel=1e-13)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_equal_finite_differences(kind: CellKind) -> None:
    place, step = np.array([0.2, 0.3, 0.1]), 1e-6
    _, gradients = shape_functions(kind, place[None, :])
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        high, low = (
            shape_functions(kind, (place + sign * shift)[None, :])[0] for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(gradients[0, :, axis], (high - low)[0] / (2 * step), atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_integrals_over_a_box_are_exact_for_polynomials(kind: CellKind) -> None:
    mesh = lattice_mesh(straight_lattice((2, 1, 3), (2.0, 0.5, 1.5)), kind, straight=True)
    found = integrate_over_cells(
        mesh.points, mesh.cells, kind, lambda x: x[:, 0] ** 2 * x[:, 1] * x[:, 2]
    )
    assert found == approx(8.0 / 3.0 * 0.125 * 1.125, rel=1e-12)
    assert mesh.quality.volume == approx(1.5, rel=1e-13)


@pytest.mark.parametrize("kind", ["tet10", "hex27"])
def test_a_quadratic_field_has_no_error_and_a_cubic_one_has(kind: CellKind) -> None:
    mesh = lattice_mesh(straight_lattice((2, 2, 2), (1.0, 1.0, 1.0)), kind, straight=True)

    def quadratic(x: FloatArray) -> FloatArray:
        return np.column_stack([x[:, 0] ** 2, x[:, 1] * x[:, 2], 1.0 + x[:, 2]])

    assert field_error(mesh.points, mesh.cells, kind, quadratic(mesh.points), quadratic) < 1e-14
    assert field_error(mesh.points, mesh.cells, kind, mesh.points**3, lambda x: x**3) > 1e-3
