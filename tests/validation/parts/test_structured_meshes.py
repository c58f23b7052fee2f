"""Claims about lattice meshes."""

import re
from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind
from headstock.validation.parts.structured_meshes import (
    SIDES,
    _lattice_cells,
    _shape_functions,
    field_error,
    integrate_over_cells,
    lattice_mesh,
    lattice_sides,
    node_places,
    refine_lattice,
    straight_lattice,
    write_lattice,
)


def box_lattice(counts: tuple[int, int, int], size: tuple[float, float, float]) -> FloatArray:
    axes = [np.linspace(0.0, length, count + 1) for count, length in zip(counts, size, strict=True)]
    return refine_lattice(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def test_every_mid_node_lies_midway_between_the_corners_that_gmsh_pairs() -> None:
    lattice = box_lattice((2, 3, 1), (2.0, 3.0, 1.0))
    points = lattice.reshape(-1, 3)
    cells = _lattice_cells(lattice.shape[:3])
    pairs = re.findall(r"\d\d", "01 03 04 12 15 23 26 37 45 47 56 67")
    edges = [map(int, pair) for pair in pairs]
    assert len(cells) == 6
    for position, (start, end) in enumerate(edges, start=8):
        middle = 0.5 * (points[cells[:, start]] + points[cells[:, end]])
        np.testing.assert_allclose(points[cells[:, position]], middle, atol=1e-15)
    np.testing.assert_allclose(points[cells[:, 26]], points[cells[:, :8]].mean(axis=1), atol=1e-15)


def test_cells_are_right_handed_and_fill_the_box() -> None:
    lattice = box_lattice((2, 3, 2), (0.4, 0.9, 0.5))
    points = lattice.reshape(-1, 3)
    cells = _lattice_cells(lattice.shape[:3])
    sides = points[cells[:, [1, 3, 4]]] - points[cells[:, [0]]]
    assert np.linalg.det(sides).sum() == approx(0.4 * 0.9 * 0.5, rel=1e-12)
    assert np.linalg.det(sides).min() > 0.0
    assert np.array_equal(np.unique(cells), np.arange(len(points)))


@pytest.mark.parametrize("side", SIDES)
def test_side_facets_point_outward_and_have_the_area_of_their_side(side: str) -> None:
    size = (0.4, 0.9, 0.5)
    lattice = box_lattice((2, 3, 2), size)
    points = lattice.reshape(-1, 3)
    facets = lattice_sides(lattice.shape[:3])[side]
    first, second = (points[facets[:, corner]] - points[facets[:, 0]] for corner in (1, 3))
    normal = np.cross(first, second).sum(axis=0)
    axis, sign = "uvw".index(side[0]), 1.0 if side[1] == "+" else -1.0
    expected = np.zeros(3)
    expected[axis] = sign * np.prod(size) / size[axis]
    np.testing.assert_allclose(normal, expected, atol=1e-14)
    for k in range(4):
        middle = 0.5 * (points[facets[:, k]] + points[facets[:, (k + 1) % 4]])
        np.testing.assert_allclose(points[facets[:, 4 + k]], middle)
    np.testing.assert_allclose(points[facets[:, 8]], points[facets[:, :4]].mean(axis=1))


def test_the_file_lists_every_node_and_element(tmp_path: Path) -> None:
    lattice = box_lattice((2, 1, 1), (1.0, 1.0, 1.0))
    write_lattice(tmp_path / "box.msh", lattice)
    lines = (tmp_path / "box.msh").read_text().splitlines()
    assert lines[lines.index("$Nodes") + 1] == "45"
    assert lines[lines.index("$Elements") + 1] == str(2 + 10)


KINDS: list[CellKind] = ["tet4", "tet10", "hex8", "hex27"]


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_are_one_at_their_node_and_sum_to_one(kind: CellKind) -> None:
    values, _ = _shape_functions(kind, node_places(kind))
    np.testing.assert_allclose(values, np.eye(int(kind[3:])), atol=1e-13)
    values, gradients = _shape_functions(kind, np.array([[0.2, 0.3, 0.1]]))
    assert values.sum() == approx(1.0, rel=1e-13)
    np.testing.assert_allclose(gradients.sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_equal_finite_differences(kind: CellKind) -> None:
    place, step = np.array([0.2, 0.3, 0.1]), 1e-6
    _, gradients = _shape_functions(kind, place[None, :])
    for axis, shift in enumerate(step * np.eye(3)):
        (high,), (low,) = (
            _shape_functions(kind, each[None])[0] for each in (place + shift, place - shift)
        )
        np.testing.assert_allclose(gradients[0, :, axis], (high - low) / (2 * step), atol=1e-8)


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
