"""Skins are closed, point outward and carry the solid's own sharp edges."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.parts.skins import (
    Skin,
    box_skin,
    inertia_skin,
    mark_places,
    prism_skin,
    sharp_edges,
    solid_skin,
    split_skin,
)
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube


def enclosed_volume(skin: Skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def edges_used_once_in_each_direction(skin: Skin) -> bool:
    directed = np.vstack([skin.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    forward = {(int(a), int(b)) for a, b in directed}
    return len(forward) == len(directed) and all((b, a) in forward for a, b in forward)


SIDES = 48
POLYGON = SIDES / 2 * np.sin(2 * np.pi / SIDES)  # area of the polygon in the unit circle
CASES: dict[str, tuple[Solid, float]] = {
    "box": (Box((0.1, 0.2, 0.3)), 0.1 * 0.2 * 0.3),
    "column": (HollowColumn((0.3, 0.4, 1.0), 0.02, 0.02), 0.3 * 0.4 * 1.0),
    "tube": (Tube(0.1, 0.06, 0.5), POLYGON * (0.05**2 - 0.03**2) * 0.5),
    "rod": (Tube(0.1, 0.0, 0.5), POLYGON * 0.05**2 * 0.5),
}


@pytest.mark.parametrize("name", CASES)
def test_a_solid_skin_is_closed_and_encloses_the_outer_volume(name: str) -> None:
    solid, volume = CASES[name]
    skin = solid_skin(solid)
    assert skin is not None
    assert enclosed_volume(skin) == approx(volume, rel=1e-12)
    if name != "rod":  # its end faces are fans round a point that stands for a whole ring
        assert edges_used_once_in_each_direction(skin)


def test_a_box_has_twelve_sharp_edges_and_none_across_its_faces() -> None:
    skin = box_skin(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    lengths = np.linalg.norm(np.diff(skin.points[skin.edges], axis=1)[:, 0], axis=1)
    assert sorted(lengths) == [1.0] * 4 + [2.0] * 4 + [3.0] * 4


def test_a_box_stands_on_its_footprint_with_z_through_the_centre() -> None:
    skin = solid_skin(Box((0.1, 0.2, 0.3)))
    assert skin is not None
    np.testing.assert_allclose(skin.points.min(axis=0), [-0.05, -0.1, 0.0])
    np.testing.assert_allclose(skin.points.max(axis=0), [0.05, 0.1, 0.3])


def test_a_ribbed_plate_reaches_to_the_top_of_its_ribs() -> None:
    skin = solid_skin(
        Plate((0.4, 0.3, 0.02), rib_height=0.05, rib_thickness=0.01, ribs_x=2, ribs_y=1)
    )
    assert skin is not None
    assert skin.points[:, 2].max() == approx(0.07)
    assert len(skin.triangles) == 12 * 4


def test_a_block_of_equal_inertia_is_the_block_itself_when_the_body_is_one() -> None:
    size, mass = np.array([0.2, 0.3, 0.5]), 4.0
    inertia = mass / 12.0 * np.diag(size @ size - size**2)
    skin = inertia_skin(mass, np.array([1.0, 2.0, 3.0]), inertia)
    np.testing.assert_allclose(np.ptp(skin.points, axis=0), size, rtol=1e-12)
    np.testing.assert_allclose(skin.points.mean(axis=0), [1.0, 2.0, 3.0])
    assert enclosed_volume(skin) == approx(size.prod(), rel=1e-12)


def test_a_body_without_mass_is_drawn_as_a_speck() -> None:
    skin = inertia_skin(0.0, np.zeros(3), np.zeros((3, 3)))
    assert 0.0 < float(np.ptp(skin.points, axis=0).max()) < 0.01


def test_splitting_keeps_the_volume_the_edges_and_the_closure() -> None:
    skin = box_skin(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    finer = split_skin(split_skin(skin))
    assert len(finer.triangles) == 16 * len(skin.triangles)
    assert enclosed_volume(finer) == approx(6.0, rel=1e-12)
    assert edges_used_once_in_each_direction(finer)
    recomputed = {(int(a), int(b)) for a, b in sharp_edges(finer.points, finer.triangles)}
    assert {(int(a), int(b)) for a, b in np.sort(finer.edges, axis=1)} == recomputed


@pytest.mark.parametrize(
    ("name", "axis", "low", "length"),
    [("box", 0, -0.05, 0.1), ("box", 2, 0.0, 0.3), ("tube", 2, 0.0, 0.5), ("rod", 2, 0.0, 0.5)],
)
def test_a_bar_cut_across_is_closed_encloses_its_volume_and_has_points_at_every_cut(
    name: str, axis: int, low: float, length: float
) -> None:
    solid, volume = CASES[name]
    places = low + length * np.linspace(0.0, 1.0, 6)
    skin = prism_skin(solid, axis, places)
    assert enclosed_volume(skin) == approx(volume, rel=1e-12)
    assert edges_used_once_in_each_direction(skin)
    np.testing.assert_allclose(np.unique(skin.points[:, axis]), places, atol=1e-15)
    whole = solid_skin(solid)
    assert whole is not None
    np.testing.assert_allclose(
        [skin.points.min(axis=0), skin.points.max(axis=0)],
        [whole.points.min(axis=0), whole.points.max(axis=0)],
    )


def test_places_of_a_body_without_a_shape_are_marked_with_their_axes() -> None:
    skin = box_skin(np.zeros(3), np.array([1.0, 2.0, 2.0]))
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    frames = [Frame(np.array([0.5, 1.0, 0.0])), Frame(np.array([0.5, 1.0, 2.0]), turn)]
    marked = mark_places(skin, frames)
    assert np.array_equal(marked.points[: len(skin.points)], skin.points)
    assert marked.triangles.max() < len(marked.points) and marked.edges.max() < len(marked.points)
    added = marked.points[len(skin.points) :].reshape(2, -1, 3)
    assert added[:, :6].mean(axis=1) == approx(np.array([frame.origin for frame in frames]))
    # the lines of the second one end along its own axes
    ends = marked.points[marked.edges[-3:, 1]] - frames[1].origin
    assert ends == approx(0.3 * turn.T, abs=1e-12)
    many = mark_places(skin, 101 * frames[:1])
    assert len(many.edges) == len(skin.edges)
    assert len(many.triangles) == len(skin.triangles) + 101 * 8
