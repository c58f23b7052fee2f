"""The skin of a part is its whole outer surface, and stays small and closed however fine the mesh
or the CAD faces are.
"""

import dataclasses
import sys
from pathlib import Path

import gmsh
import numpy as np
import pytest
import pyvista as pv

from built_parts import built_part
from common import STEEL, approx, make_box
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Patch
from headstock.geometry.parts.skins import IntArray, Skin, sharp_edges
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components import reduced_skins, skins
from headstock.meshing.components.meshing import describe_component
from headstock.meshing.components.skins import (
    PIXEL,
    find_areas,
    mesh_skin,
    skin_size,
    thin_skin,
    unmeshed_skin,
)
from headstock.meshing.errors import MeshError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[3]


def area(skin: Skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex27"])
def test_the_skin_of_a_box_has_its_surface_its_edges_and_points_of_the_mesh(kind: CellKind) -> None:
    mesh = make_box((3, 2, 4), (0.3, 0.2, 0.4), kind=kind)
    skin = mesh_skin(mesh)
    assert area(skin) == approx(2 * (0.06 + 0.08 + 0.12), rel=1e-12)
    np.testing.assert_array_equal(carried(skin, mesh.points), skin.points)
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert lengths.sum() == approx(4 * (0.3 + 0.2 + 0.4), rel=1e-12)


def test_second_order_facets_of_a_coarse_mesh_are_split_through_their_mid_nodes() -> None:
    coarse = mesh_skin(make_box((2, 2, 2), (1.0, 1.0, 1.0), kind="tet10"))
    linear = mesh_skin(make_box((2, 2, 2), (1.0, 1.0, 1.0), kind="tet4"))
    assert len(coarse.triangles) == 4 * len(linear.triangles)


def carried(skin: Skin, field: FloatArray) -> FloatArray:
    """A field at the points of a mesh as the points of its skin have it."""
    assert skin.nodes is not None and skin.weights is not None
    return np.asarray(np.einsum("ij,ij...->i...", skin.weights, field[skin.nodes]))


def test_a_very_fine_skin_is_thinned_out_keeps_its_edges_and_points_to_bend_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(skins, "LARGEST_SKIN", 800)
    mesh = make_box((32, 32, 2), (1.0, 1.0, 0.05), kind="hex8")
    skin = mesh_skin(mesh)
    assert (len(skin.triangles), skin.thinned_from) == (800, 4 * 32**2 + 16 * 32)
    np.testing.assert_allclose(np.ptp(skin.points, axis=0), [1.0, 1.0, 0.05], rtol=1e-12)
    assert area(skin) == approx(2.2, rel=1e-5)
    assert edge_length(skin) == approx(8.2, rel=1e-5)
    sides = skin.points[skin.triangles] - skin.points[np.roll(skin.triangles, 1, axis=1)]
    assert np.linalg.norm(sides, axis=2).max() < 0.2 * np.sqrt(2.0)
    # deflection of one over the length: linear between points of the mesh, 1/32 apart
    bent = mesh.points[:, 0] ** 2
    np.testing.assert_allclose(
        carried(skin, bent), skin.points[:, 0] ** 2, rtol=0.0, atol=0.25 / 32**2 + 1e-9
    )


def finned_flange() -> None:
    """A flange with twelve bolt holes around a bore, eight ribs of 2 mm, and rounded outer edges:
    of genus 13.
    """
    occ = gmsh.model.occ
    body, _ = occ.fuse(
        [(3, occ.addCylinder(0, 0, 0, 0, 0, 12, 80))],
        [(3, occ.addCylinder(0, 0, 12, 0, 0, 60, 30))],
    )
    ribs = []
    for k in range(8):
        ribs.append((3, occ.addBox(0, -1, 10, 62, 2, 40)))
        occ.rotate([ribs[-1]], 0, 0, 0, 0, 0, 1, k * np.pi / 4)
    body, _ = occ.fuse(body, ribs)
    angles = 2 * np.pi * (np.arange(12) + 0.5) / 12
    holes = [(3, occ.addCylinder(70 * np.cos(a), 70 * np.sin(a), -1, 0, 0, 20, 4)) for a in angles]
    occ.cut(body, [*holes, (3, occ.addCylinder(0, 0, -1, 0, 0, 100, 22))])


def rounded_frame() -> None:
    """A frame of three windows with rounded edges all over, a thin web across one window, and a
    ball on a neck.
    """
    occ = gmsh.model.occ
    frame = [(3, occ.addBox(0, 0, 0, 120, 60, 30))]
    frame, _ = occ.cut(frame, [(3, occ.addBox(8 + 37 * k, 8, -1, 30, 44, 32)) for k in range(3)])
    occ.synchronize()
    frame = occ.fillet([frame[0][1]], [tag for _, tag in gmsh.model.getEntities(1)], [3.0])
    web = (3, occ.addBox(5, 5, 14, 36, 50, 0.8))
    knob = [(3, occ.addCylinder(119, 30, 15, 12, 0, 0, 4)), (3, occ.addSphere(135, 30, 15, 8))]
    occ.fuse(frame, [web, *knob])


@pytest.fixture(scope="module")
def step_parts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("parts")
    found = {
        "column": ROOT / "machines" / "step_column.step",
        "bracket": ROOT / "tests" / "data" / "support.step",
    }
    for build in (finned_flange, rounded_frame):
        found[build.__name__] = folder / f"{build.__name__}.step"
        with built_part(found[build.__name__]):
            build()
    return found


def torn_edges(skin: Skin) -> int:
    """How many edges do not belong to exactly two triangles of one orientation."""
    directed = skin.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, counts = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    return int((counts != 2).sum()) + len(directed) - len(np.unique(directed, axis=0))


def enclosed_volume(skin: Skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def edge_length(skin: Skin) -> float:
    return float(np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1).sum())


def holes(skin: Skin) -> int:
    """Handles of a closed surface of one piece: its genus, from Euler's formula."""
    edges = len(skin.triangles) * 3 // 2
    return (2 - len(skin.points) + edges - len(skin.triangles)) // 2


def largest_distance(places: FloatArray, skin: Skin) -> float:
    """How far places are from a surface at most [m], as VTK says."""
    surface = pv.PolyData.from_regular_faces(skin.points, skin.triangles)
    found = pv.PolyData(np.asarray(places, dtype=float)).compute_implicit_distance(surface)
    return float(np.abs(found["implicit_distance"]).max())


@pytest.mark.process
@pytest.mark.parametrize(
    "name",
    [
        "bracket",
        *(
            pytest.param(name, marks=pytest.mark.trials)
            for name in ("column", "finned_flange", "rounded_frame")
        ),
    ],
)
def test_a_step_part_that_is_thinned_out_twice_looks_the_same_with_its_holes_and_its_edges(
    name: str, step_parts: dict[str, Path]
) -> None:
    whole = unmeshed_skin(StepFile(step_parts[name]), thinned=False)
    assert whole is not None and torn_edges(whole) == 0
    numbers = np.arange(len(whole.points))[:, None]
    whole = dataclasses.replace(whole, nodes=numbers, weights=np.ones(numbers.shape))
    stored = thin_skin(whole, largest=12_000)
    drawn = thin_skin(stored, largest=3_000)
    assert len(drawn.triangles) < 11_000 and drawn.thinned_from == len(whole.triangles)
    for passes, thin in enumerate((stored, drawn), 1):
        assert torn_edges(thin) == 0
        assert holes(thin) == holes(whole)
        assert enclosed_volume(thin) == approx(enclosed_volume(whole), rel=5e-3)
        assert area(thin) == approx(area(whole), rel=5e-3)
        assert edge_length(thin) == approx(edge_length(whole), rel=0.05)
        pixel = passes * PIXEL * skin_size(whole)
        middles = thin.points[thin.triangles].mean(axis=1)
        # some 200 points each
        near, middle = (every[:: 1 + len(every) // 200] for every in (whole.points, middles))
        assert largest_distance(near, thin) <= pixel
        assert largest_distance(middle, whole) <= pixel
        # a field that is linear in space is known exactly on every facet of the original
        assert thin.weights is not None
        assert thin.weights.min() >= 0.0
        np.testing.assert_allclose(thin.weights.sum(axis=1), 1.0, rtol=1e-12)
        np.testing.assert_allclose(
            carried(thin, whole.points), thin.points, rtol=0.0, atol=1e-12 * skin_size(whole)
        )


def tube(around: int, along: int, *, wall: float, radius: float = 0.5) -> Skin:
    """A closed tube of length one with a thin wall: a torus of rectangular section."""
    angles = 2 * np.pi * np.arange(around) / around
    heights = np.linspace(0.0, 1.0, along + 1)
    section = np.vstack(
        [
            np.column_stack([np.full(along + 1, radius), heights]),
            np.column_stack([np.full(along + 1, radius - wall), heights[::-1]]),
        ]
    )
    across = len(section)
    points = np.stack(
        [
            np.outer(np.cos(angles), section[:, 0]),
            np.outer(np.sin(angles), section[:, 0]),
            np.tile(section[:, 1], (around, 1)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    i, j = (index.ravel() for index in np.indices((around, across)))
    a, b, c, d = (
        ((i + k) % around) * across + (j + m) % across for k, m in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Skin(points, triangles, sharp_edges(points, triangles), "solid")


def windings(skin: Skin, places: FloatArray) -> IntArray:
    """How often a surface goes round places: 1 inside, 0 outside, else where it crosses itself.

    Source: van Oosterom and Strackee (1983), solid angles of triangles.
    """
    found = np.zeros(len(places))
    for index, place in enumerate(places):
        a, b, c = (skin.points[skin.triangles[:, k]] - place for k in range(3))
        x, y, z = (np.linalg.norm(arm, axis=1) for arm in (a, b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a)))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        found[index] = 2.0 * np.arctan2(volume, x * y * z + ab * z + bc * x + ca * y).sum()
    return np.round(found / (4.0 * np.pi)).astype(np.int64)


@pytest.mark.parametrize("wall", [2e-2, 1e-2, pytest.param(5e-3, marks=pytest.mark.trials)])
def test_the_sides_of_a_thin_wall_stay_apart_though_the_tolerance_is_larger(wall: float) -> None:
    whole = tube(120, 12, wall=wall)
    thin = reduced_skins.reduce_skin(whole, largest=300, tolerance=5e-2)
    assert torn_edges(thin) == 0 and holes(thin) == 1
    assert len(thin.triangles) < len(whole.triangles)
    a, b, c = (thin.points[thin.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    below = 1e-3 * wall * normals / lengths[:, None]
    middles = (a + b + c) / 3.0
    np.testing.assert_array_equal(windings(thin, middles - below), 1)
    np.testing.assert_array_equal(windings(thin, middles + below), 0)
    np.testing.assert_allclose(enclosed_volume(thin), enclosed_volume(whole), rtol=0.02)


def test_an_open_surface_keeps_its_rim_and_no_wall_is_taken_for_its_other_side() -> None:
    box = mesh_skin(make_box((16, 16, 16), (1.0, 1.0, 1.0), kind="hex8"))
    lid = box.points[box.triangles].mean(axis=1)[:, 2] > 1.0 - 1e-9
    used, flat = np.unique(box.triangles[~lid], return_inverse=True)
    points, corners = box.points[used], flat.reshape(-1, 3)
    bowl = Skin(points, corners, sharp_edges(points, corners), "solid")
    thin = thin_skin(bowl, largest=400)
    assert len(thin.triangles) == 400 and thin.thinned_from == len(corners)
    assert area(thin) == approx(5.0, rel=PIXEL)
    assert edge_length(thin) == approx(12.0, rel=PIXEL)
    assert (
        torn_edges(thin)
        == (np.abs(thin.points[thin.edges][:, :, 2] - 1.0) < PIXEL).all(axis=1).sum()
    )


def test_a_surface_that_cannot_be_thinned_out_stays_whole_and_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    box = mesh_skin(make_box((8, 8, 8), (1.0, 1.0, 1.0), kind="hex8"))
    inner, twin = box.triangles, len(box.points) + np.arange(len(box.points))
    # a second box along the edge at x = y = 1
    points = np.vstack([box.points, box.points + np.array([1.0, 1.0, 0.0])])
    points, numbers = np.unique(np.round(points, 12), axis=0, return_inverse=True)
    corners = numbers.ravel()[np.vstack([inner, twin[inner]])]
    equals = Skin(points, corners, sharp_edges(points, corners), "mesh")
    with_reasons = {
        "more than two triangles": thin_skin(equals, largest=200),
        "another shape": thin_skin(tube(120, 12, wall=5e-4), largest=300),
    }
    monkeypatch.setitem(sys.modules, skins.REDUCER, None)
    with_reasons["VTK"] = thin_skin(box, largest=200)
    for reason, skin in with_reasons.items():
        assert skin.kept_whole is not None and reason in skin.kept_whole
        assert skin.thinned_from is None
    assert with_reasons["VTK"].triangles is box.triangles


@pytest.mark.trials
def test_limits_are_kept_by_more_triangles_and_not_by_none(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = tube(120, 12, wall=0.2)
    coarse = reduced_skins.reduce_skin(whole, largest=100, tolerance=0.05)
    fine = reduced_skins.reduce_skin(whole, largest=100, tolerance=1e-3)
    assert len(coarse.triangles) < len(fine.triangles) < len(whole.triangles)
    monkeypatch.setattr(reduced_skins, "LARGEST_EDGE_CHANGE", 0.0)
    with pytest.raises(MeshError, match="another shape"):
        reduced_skins.reduce_skin(whole, largest=100, tolerance=1e-3)


@pytest.mark.process
def test_areas_of_interfaces_on_a_step_part_are_those_of_the_cad_kernel() -> None:
    patches = {
        "whole": Patch("z-"),
        "bore": Patch("face:12"),
        "rect": Patch("z+", "rect", (-0.0454, 0.002, 0.0), (0.008, 0.02)),
        "oblique": Patch("face:17", "rect", (-0.0304, 0.0, 0.0137), (0.006, 0.01)),
        "disk": Patch("face:19", "disk", (-0.0416, 0.0, 0.0056), (0.007,)),
        "strip": Patch("face:17", "strip", (-0.0304, 0.0, 0.0137), (0.004,), "y"),
        "beyond": Patch("z+", "rect", (-0.0454, 0.02, 0.0), (0.008, 0.02)),
    }
    interfaces = {name: Interface(name, (patch,)) for name, patch in patches.items()}
    solid = StepFile(ROOT / "tests" / "data" / "support.step")
    part = Component("support", solid, STEEL, interfaces=interfaces)
    exact = describe_component(part).patch_areas
    for name, corners in find_areas(part).items():
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        found = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
        assert found == approx(exact.pop(name), rel=0.01), name
    assert exact == {}
