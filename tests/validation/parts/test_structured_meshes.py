"""Claims about lattice meshes."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.validation.parts.structured_meshes import (
    SIDES,
    lattice_cells,
    lattice_sides,
    refine_lattice,
    write_lattice,
)


def box_lattice(counts: tuple[int, int, int], size: tuple[float, float, float]) -> FloatArray:
    axes = [np.linspace(0.0, length, count + 1) for count, length in zip(counts, size, strict=True)]
    return refine_lattice(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def test_every_mid_node_lies_midway_between_the_corners_that_gmsh_pairs() -> None:
    lattice = box_lattice((2, 3, 1), (2.0, 3.0, 1.0))
    points = lattice.reshape(-1, 3)
    cells = lattice_cells(lattice.shape[:3])
    edges = [
        (0, 1),
        (0, 3),
        (0, 4),
        (1, 2),
        (1, 5),
        (2, 3),
        (2, 6),
        (3, 7),
        (4, 5),
        (4, 7),
        (5, 6),
        (6, 7),
    ]
    assert len(cells) == 6
    for position, (start, end) in enumerate(edges, start=8):
        middle = 0.5 * (points[cells[:, start]] + points[cells[:, end]])
        np.testing.assert_allclose(points[cells[:, position]], middle, atol=1e-15)
    np.testing.assert_allclose(points[cells[:, 26]], points[cells[:, :8]].mean(axis=1), atol=1e-15)


def test_cells_are_right_handed_and_fill_the_box() -> None:
    lattice = box_lattice((2, 3, 2), (0.4, 0.9, 0.5))
    points = lattice.reshape(-1, 3)
    cells = lattice_cells(lattice.shape[:3])
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
    first, second = (
        points[facets[:, 1]] - points[facets[:, 0]],
        points[facets[:, 3]] - points[facets[:, 0]],
    )
    normal = np.cross(first, second).sum(axis=0)
    axis, sign = "uvw".index(side[0]), 1.0 if side[1] == "+" else -1.0
    expected = np.zeros(3)
    expected[axis] = sign * np.prod(size) / size[axis]
    np.testing.assert_allclose(normal, expected, atol=1e-14)
    for k in range(4):
        np.testing.assert_allclose(
            points[facets[:, 4 + k]], 0.5 * (points[facets[:, k]] + points[facets[:, (k + 1) % 4]])
        )
    np.testing.assert_allclose(points[facets[:, 8]], points[facets[:, :4]].mean(axis=1))


def test_the_file_lists_every_node_and_element(tmp_path: Path) -> None:
    lattice = box_lattice((2, 1, 1), (1.0, 1.0, 1.0))
    write_lattice(tmp_path / "box.msh", lattice)
    lines = (tmp_path / "box.msh").read_text().splitlines()
    assert lines[lines.index("$Nodes") + 1] == "45"
    assert lines[lines.index("$Elements") + 1] == str(2 + 10)
