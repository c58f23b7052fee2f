"""Tets that alone fill a wall are found with thickness, length and shape; others are not."""

from collections.abc import Callable

import numpy as np
import pytest

from common import approx, make_box
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import POOR_QUALITY
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.quality import scaled_jacobians
from headstock.meshing.elements.surface import find_flat_tets
from headstock.pipeline.stages.warnings import _mesh_warnings


def test_single_layers_are_found_with_thickness_and_length() -> None:
    mesh = make_box((10, 10, 1), (1.0, 1.0, 0.01), {}, kind="tet10")
    flat = find_flat_tets(mesh.points, mesh.cells[:, :4])
    assert len(flat.cells) == len(mesh.cells)
    assert np.median(flat.thickness) == approx(0.01, rel=0.05)
    assert np.median(flat.lengths) == approx(0.1 * np.sqrt(2.0), rel=0.05)


@pytest.mark.parametrize("layers", [(10, 10, 3), (4, 4, 4)], ids=["three layers", "a block"])
def test_walls_with_several_layers_and_blocks_have_none(layers: tuple[int, int, int]) -> None:
    mesh = make_box(layers, (1.0, 1.0, 0.01 if layers[2] == 3 else 1.0), {}, kind="tet10")
    assert len(find_flat_tets(mesh.points, mesh.cells[:, :4]).cells) == 0


def test_flatness_of_the_wall_is_no_fault_of_a_tet_and_a_sliver_in_it_is() -> None:
    mesh = make_box((10, 10, 1), (1.0, 1.0, 0.01), {}, kind="tet10")
    corners, points = mesh.cells[:, :4], mesh.points.copy()
    before = find_flat_tets(points, corners)
    assert scaled_jacobians(points, corners, "tet4").max() < 0.1
    assert before.qualities.min() > POOR_QUALITY
    # one column of nodes next to its neighbour: the cells between are slivers in the plane too
    moved = np.isclose(points[:, 0], 0.0, atol=1e-9) & np.isclose(points[:, 1], 0.0, atol=1e-9)
    if not moved.any():
        column = points[
            np.argmin(np.linalg.norm(points[:, :2] - points[:, :2].mean(axis=0), axis=1)), :2
        ]
        moved = np.linalg.norm(points[:, :2] - column, axis=1) < 1e-9
    points[moved, 0] += 0.0995
    assert find_flat_tets(points, corners).qualities.min() < POOR_QUALITY


@pytest.mark.process
def test_a_thin_sheet_is_not_said_to_have_poor_elements(
    make_component: Callable[..., Component],
) -> None:
    sheet = make_component(Box((0.4, 0.3, 0.002)), size=0.05, cells="tet")
    mesh = mesh_component(sheet)
    assert scaled_jacobians(mesh.points, mesh.cells[:, :4], "tet4").min() < POOR_QUALITY
    assert mesh.quality.poor_share == 0.0
    assert _mesh_warnings(mesh.quality, 3 * len(mesh.points)) == []
    assert mesh.quality.flat_thickness == approx(0.002, rel=0.1)
