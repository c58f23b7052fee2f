"""Quality of elements; tets that alone fill a wall are found with thickness, length and shape."""

import numpy as np
import pytest

from common import approx, make_box
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import POOR_QUALITY, CellKind, IntArray
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.elements.quadratic import elevate_tets, is_straight, repair_tets
from headstock.meshing.elements.quality import (
    facet_moments,
    integrate_mesh,
    mesh_volume,
    scaled_jacobians,
)
from headstock.meshing.elements.surface import (
    count_parts,
    extract_surface,
    find_flat_tets,
    match_facets,
)
from headstock.meshing.elements.topology import (
    NODE_COUNTS,
    cell_order,
    cell_shape_functions,
    local_facets,
    reference_nodes,
)
from headstock.pipeline.stages.warnings import _mesh_warnings
from meshed_parts import make_part

KINDS: list[CellKind] = ["tet4", "tet10", "hex8", "hex20", "hex27"]


def one_cell(kind: CellKind) -> tuple[FloatArray, IntArray]:
    return reference_nodes(kind).copy(), np.arange(NODE_COUNTS[kind])[None, :]


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_are_one_at_their_own_node_and_sum_to_one(kind: CellKind) -> None:
    assert np.allclose(
        cell_shape_functions(kind, reference_nodes(kind)), np.eye(NODE_COUNTS[kind]), atol=1e-13
    )
    assert np.allclose(
        cell_shape_functions(kind, np.array([[0.13, 0.21, 0.34]])).sum(), 1.0, rtol=1e-14, atol=0.0
    )


@pytest.mark.parametrize("kind", KINDS)
def test_ideal_cells_have_quality_one_and_their_exact_volume(kind: CellKind) -> None:
    points, cells = one_cell(kind)
    if kind.startswith("tet"):
        regular = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]]).T @ np.vstack(
            [1 - points.sum(axis=1), points.T]
        )
        points = regular.T
    expected = 8.0 if kind.startswith("hex") else 8.0 / 3.0
    assert scaled_jacobians(points, cells, kind)[0] == approx(1.0, rel=1e-12)
    assert mesh_volume(points, cells, kind) == approx(expected, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_mirrored_cells_are_inverted(kind: CellKind) -> None:
    points, cells = one_cell(kind)
    assert scaled_jacobians(points * [1, 1, -1], cells, kind)[0] < 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_facets_of_a_cell_enclose_it(kind: CellKind) -> None:
    points, cells = one_cell(kind)
    surface = extract_surface(cells, kind)
    areas, centers = facet_moments(points, surface.facets)
    corners = points[surface.facets[:, : surface.corners]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(areas @ normals, 0.0, atol=1e-13)
    assert np.einsum("f,fi,fi->", areas, normals, centers) / 3 == approx(
        mesh_volume(points, cells, kind), rel=1e-12
    )
    assert (
        len(local_facets(kind)[0])
        == {"tet4": 3, "tet10": 6, "hex8": 4, "hex20": 8, "hex27": 9}[kind]
    )


@pytest.mark.parametrize("kind", ["tet10", "hex20", "hex27"])
def test_integrals_are_exact_on_curved_cells(kind: CellKind) -> None:
    points, cells = one_cell(kind)
    bent = points.copy()
    bent[:, 2] += 0.1 * points[:, 0] ** 2  # a shear: volume stays, moments follow in closed form
    volume, center, inertia = integrate_mesh(bent + 1e6, cells, kind)
    straight = integrate_mesh(points, cells, kind)
    assert volume == approx(straight[0], rel=1e-9)
    moments = np.trace(straight[2]) / 2 * np.eye(3) - straight[2]
    mean_square = moments[0, 0] / straight[0] + straight[1][0] ** 2
    assert center[2] - 1e6 == approx(straight[1][2] + 0.1 * mean_square, abs=1e-9)
    assert inertia[2, 2] == approx(straight[2][2, 2], rel=1e-6)


def test_inversion_between_sampling_points_is_found() -> None:
    rng = np.random.default_rng(3)
    base, cell = one_cell("tet10")
    fine = (
        np.array([[i, j, k] for i in range(21) for j in range(21 - i) for k in range(21 - i - j)])
        / 20.0
    )
    shapes = []
    for _ in range(500):
        points = base.copy()
        points[4:] += rng.normal(scale=0.13, size=(6, 3))
        shapes.append(points)
    points = np.concatenate(shapes)
    cells = (np.arange(len(shapes))[:, None] * 10 + cell).astype(np.int64)
    quality = scaled_jacobians(points, cells, "tet10")
    step = 1e-6
    gradients = [
        (
            cell_shape_functions("tet10", fine + step * e)
            - cell_shape_functions("tet10", fine - step * e)
        )
        / (2 * step)
        for e in np.eye(3)
    ]
    jacobians = np.einsum("aqn,cni->cqai", np.array(gradients), points[cells])
    truly_inverted = np.linalg.det(jacobians).min(axis=1) < -1e-6
    assert 50 < truly_inverted.sum() < 450
    assert (quality[truly_inverted] <= 0.0).mean() > 0.999
    assert (quality[~truly_inverted] > 0.0).mean() > 0.99


def test_bent_tets_are_repaired_and_good_ones_left_alone() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    points, cells = elevate_tets(corners, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
    assert is_straight(points, cells, "tet10")
    bent = points.copy()
    bent[cells[0, 4]] += [0.0, 0.6, 0.6]  # the edge 0-1 belongs to the first cell only
    bent[cells[1, 9]] += [0.02, 0.0, 0.0]
    assert scaled_jacobians(bent, cells, "tet10")[0] < 0.0
    repaired, which = repair_tets(bent, cells)
    assert which.tolist() == [0]
    assert (scaled_jacobians(repaired, cells, "tet10") > 0.01).all()
    assert np.array_equal(repaired[cells[1, 9]], bent[cells[1, 9]])


def test_inverted_straight_tets_are_not_called_repaired() -> None:
    points, cells = elevate_tets(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1.0]]), np.array([[0, 1, 2, 3]])
    )
    repaired, _ = repair_tets(points, cells)
    assert scaled_jacobians(repaired, cells, "tet10")[0] < 0.0


def test_parts_that_share_no_node_are_counted() -> None:
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [5, 6, 7, 8]])
    parts, labels = count_parts(cells, "tet4", 9)
    assert parts == 2
    assert labels.tolist() == [0, 0, 1]


def test_facets_inside_the_mesh_have_no_match_on_its_surface() -> None:
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    surface = extract_surface(cells, "tet4")
    assert len(surface.facets) == 6
    found, missing = match_facets(surface, np.array([[3, 2, 1], [2, 1, 0]]))
    assert len(found) == 1 and missing == 1


@pytest.mark.parametrize("kind", KINDS)
def test_order_of_a_kind_is_that_of_its_shape_functions(kind: CellKind) -> None:
    nodes, inside = reference_nodes(kind), np.array([[0.2, 0.1, 0.3]])
    square = cell_shape_functions(kind, inside) @ (nodes[:, 0] * nodes[:, 0])
    assert (abs(square[0] - 0.04) < 1e-12) == (cell_order(kind) == 2)


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
def test_a_thin_sheet_is_not_said_to_have_poor_elements() -> None:
    sheet = make_part(Box((0.4, 0.3, 0.002)), size=0.05, cells="tet")
    mesh = mesh_component(sheet)
    assert scaled_jacobians(mesh.points, mesh.cells[:, :4], "tet4").min() < POOR_QUALITY
    assert mesh.quality.poor_share == 0.0
    assert _mesh_warnings(mesh.quality, 3 * len(mesh.points)) == []
    assert mesh.quality.flat_thickness == approx(0.002, rel=0.1)
