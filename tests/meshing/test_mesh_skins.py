"""The skin of a mesh is its whole outer surface, and stays small however fine the mesh is."""

import numpy as np
import pytest

from headstock.meshing import mesh_skins
from headstock.meshing.mesh_skins import mesh_skin


def area(skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex27"])
def test_the_skin_of_a_box_has_its_surface_its_edges_and_points_of_the_mesh(kind, make_box) -> None:
    mesh = make_box((3, 2, 4), (0.3, 0.2, 0.4), kind=kind)
    skin = mesh_skin(mesh)
    assert area(skin) == pytest.approx(2 * (0.06 + 0.08 + 0.12), rel=1e-12)
    np.testing.assert_array_equal(mesh.points[skin.nodes], skin.points)
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(4 * (0.3 + 0.2 + 0.4), rel=1e-12)


def test_second_order_facets_of_a_coarse_mesh_are_split_through_their_mid_nodes(make_box) -> None:
    coarse, linear = (mesh_skin(make_box((2, 2, 2), (1.0, 1.0, 1.0), kind=kind)) for kind in ("tet10", "tet4"))
    assert len(coarse.triangles) == 4 * len(linear.triangles)


def test_a_very_fine_skin_is_merged_until_it_is_small_and_keeps_its_corners_and_edges(make_box, monkeypatch) -> None:
    monkeypatch.setattr(mesh_skins, "LARGEST_SKIN", 400)
    mesh = make_box((16, 16, 16), (1.0, 1.0, 1.0), kind="hex8")
    skin = mesh_skin(mesh)
    assert 50 < len(skin.triangles) <= 400
    np.testing.assert_array_equal(mesh.points[skin.nodes], skin.points)
    np.testing.assert_array_equal(np.ptp(skin.points, axis=0), 1.0)
    assert area(skin) == pytest.approx(6.0, rel=1e-2)
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(12.0, rel=1e-12)
