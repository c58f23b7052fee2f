"""The skin of a part is its whole outer surface, and stays small and closed however fine the mesh
or the CAD faces are.
"""

from collections.abc import Callable
from pathlib import Path

import gmsh
import numpy as np
import pytest

from common import make_box
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.skin_decimation import decimate_skin
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components import skins
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.skins import mesh_skin, unmeshed_skin

ROOT = Path(__file__).resolve().parents[3]


def area(skin: Skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex27"])
def test_the_skin_of_a_box_has_its_surface_its_edges_and_points_of_the_mesh(kind: CellKind) -> None:
    mesh = make_box((3, 2, 4), (0.3, 0.2, 0.4), kind=kind)
    skin = mesh_skin(mesh)
    assert area(skin) == pytest.approx(2 * (0.06 + 0.08 + 0.12), rel=1e-12)
    np.testing.assert_array_equal(mesh.points[skin.nodes], skin.points)
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(4 * (0.3 + 0.2 + 0.4), rel=1e-12)


def test_second_order_facets_of_a_coarse_mesh_are_split_through_their_mid_nodes() -> None:
    coarse = mesh_skin(make_box((2, 2, 2), (1.0, 1.0, 1.0), kind="tet10"))
    linear = mesh_skin(make_box((2, 2, 2), (1.0, 1.0, 1.0), kind="tet4"))
    assert len(coarse.triangles) == 4 * len(linear.triangles)


def test_a_very_fine_skin_is_thinned_out_and_keeps_its_corners_and_edges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(skins, "LARGEST_SKIN", 400)
    mesh = make_box((16, 16, 16), (1.0, 1.0, 1.0), kind="hex8")
    skin = mesh_skin(mesh)
    assert (len(skin.triangles), skin.thinned_from) == (400, 12 * 16**2)
    np.testing.assert_array_equal(mesh.points[skin.nodes], skin.points)
    np.testing.assert_array_equal(np.ptp(skin.points, axis=0), 1.0)
    assert area(skin) == pytest.approx(6.0, rel=1e-12)
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(12.0, rel=1e-12)
    # flat walls keep points with which they can bend
    assert (
        np.linalg.norm(
            np.diff(skin.points[skin.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)], axis=1),
            axis=2,
        ).max()
        < 0.5
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
        gmsh.initialize(interruptible=False, readConfigFiles=False)
        gmsh.option.setNumber("General.Terminal", 0)
        build()
        gmsh.model.occ.synchronize()
        found[build.__name__] = folder / f"{build.__name__}.step"
        gmsh.write(str(found[build.__name__]))
        gmsh.finalize()
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


@pytest.mark.process
@pytest.mark.parametrize("name", ["column", "bracket", "finned_flange", "rounded_frame"])
def test_a_step_part_that_is_thinned_out_twice_is_drawn_closed_with_its_holes_and_its_edges(
    name: str, step_parts: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(skins, "LARGEST_SKIN", 10**9)
    whole = unmeshed_skin(StepFile(step_parts[name]))
    assert whole is not None and torn_edges(whole) == 0
    stored, _ = decimate_skin(whole, largest=12_000)
    drawn, kept = decimate_skin(stored, largest=3_000)
    assert len(drawn.triangles) <= 3_000 and drawn.thinned_from == len(whole.triangles)
    np.testing.assert_array_equal(drawn.points, stored.points[kept])
    for thin in (stored, drawn):
        assert torn_edges(thin) == 0
        assert holes(thin) == holes(whole)
        assert enclosed_volume(thin) == pytest.approx(enclosed_volume(whole), rel=2e-2)
        assert area(thin) == pytest.approx(area(whole), rel=5e-3)
        assert edge_length(thin) == pytest.approx(edge_length(whole), rel=2e-2)


@pytest.mark.process
def test_the_surface_of_a_meshed_step_part_is_thinned_out_closed_and_at_points_of_the_mesh(
    step_parts: dict[str, Path],
    make_component: Callable[..., Component],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = mesh_component(make_component(StepFile(step_parts["bracket"]), size=0.006))
    whole = mesh_skin(mesh)
    assert whole.thinned_from is None
    monkeypatch.setattr(skins, "LARGEST_SKIN", 1000)
    thin = mesh_skin(mesh)
    assert len(thin.triangles) <= 1000 < len(whole.triangles) == thin.thinned_from
    assert torn_edges(whole) == torn_edges(thin) == 0
    np.testing.assert_array_equal(mesh.points[thin.nodes], thin.points)
    assert area(thin) == pytest.approx(area(whole), rel=1e-2)
