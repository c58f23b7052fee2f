"""Holes, names and suggestions are read off faces that are written down by hand."""

import dataclasses

import numpy as np
from cad_blocks import SIZE, as_vector, bore, box_faces

from common import approx
from headstock.geometry.frames import rotation_about
from headstock.geometry.parts.cad_faces import (
    CadFace,
    find_holes,
    fit_cylinder,
    name_faces,
    part_extent,
)
from headstock.geometry.parts.interface_suggestions import likely_interfaces


def test_a_hole_of_two_half_walls_is_one_hole() -> None:
    halves = [bore(7, (0.02, 0.02), turn=0.5), bore(8, (0.02, 0.02), turn=0.5)]
    (hole,) = find_holes([*box_faces(), *halves])
    assert hole.faces == (7, 8)
    assert hole.place == approx((0.02, 0.02, 0.01))


def test_inner_fillets_slot_ends_and_bosses_are_no_holes() -> None:
    faces = [bore(7, (0.02, 0.02), turn=0.25), bore(8, (0.05, 0.02), turn=0.5)]
    faces.append(dataclasses.replace(bore(9, (0.08, 0.02)), hollow=False))
    assert find_holes([*box_faces(), *faces]) == []


def test_bores_on_one_axis_with_a_gap_between_them_are_two_holes() -> None:
    upper = dataclasses.replace(bore(8, (0.02, 0.02)), span=(0.3, 0.32))
    assert len(find_holes([*box_faces(), bore(7, (0.02, 0.02)), upper])) == 2


def test_ends_are_named_by_direction_unless_two_faces_share_one() -> None:
    faces = box_faces()
    assert [name_faces(faces)[number] for number in range(1, 7)] == [
        "x-",
        "x+",
        "y-",
        "y+",
        "z-",
        "z+",
    ]
    split = dataclasses.replace(faces[5], number=7)
    names = name_faces([*faces, split])
    assert (names[6], names[7]) == ("face:6", "face:7")


def test_the_extent_is_the_longest_side() -> None:
    assert part_extent(box_faces()) == 0.4


def test_a_cylinder_is_fitted_through_points_on_part_of_its_wall() -> None:
    axis, place, radius = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([0.3, -0.1, 0.2]), 0.07
    first = np.cross(axis, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angles, heights = np.meshgrid(np.linspace(0.0, 1.2, 9), np.linspace(0.0, 0.1, 4))
    normals = np.cos(angles.ravel())[:, None] * first + np.sin(angles.ravel())[:, None] * second
    points = place + radius * normals + heights.ravel()[:, None] * axis
    found_axis, found_place, found_radius = fit_cylinder(points, normals)
    assert abs(found_axis @ axis) == approx(1.0, abs=1e-12)
    assert found_radius == approx(radius, rel=1e-9)
    assert np.linalg.norm(np.cross(found_place - place, axis)) < 1e-9


CORNERS = ((0.02, 0.02), (0.08, 0.02), (0.02, 0.18), (0.08, 0.18))


def roles(faces: list[CadFace]) -> dict[str, tuple[str, ...]]:
    """Faces of the first interface of each role."""
    found: dict[str, tuple[str, ...]] = {}
    for one in likely_interfaces(faces):
        found.setdefault(one.role, one.faces)
    return found


def widen(face: CadFace) -> CadFace:
    """A face along x and y, three times as long both ways."""
    low, high = np.array(face.low), np.array(face.high)
    beyond = (high - low) * (1.0, 1.0, 0.0)
    return dataclasses.replace(
        face, area=9.0 * face.area, low=as_vector(low - beyond), high=as_vector(high + beyond)
    )


def test_a_part_stands_on_its_largest_end_and_is_loaded_at_the_farthest_other_one() -> None:
    found = likely_interfaces(box_faces())
    assert [(one.name, one.role) for one in found[:2]] == [("back", "foot"), ("front", "tip")]
    # ends of one size: it stands on the lower one
    assert roles(box_faces()[::-1])["foot"] == ("x-",)
    assert found[0].reason == "plane, 800 cm^2: 200 × 400 mm at (0, 100, 200) mm"


def test_a_casting_stands_on_the_rim_of_its_open_side_and_not_on_its_closed_top() -> None:
    bottom, top = (widen(face) for face in box_faces()[4:])
    rim = dataclasses.replace(bottom, area=0.15 * bottom.area)
    assert roles([*box_faces()[:4], rim, top])["foot"] == ("z-",)
    # a boss at the bottom is no rim
    boss = dataclasses.replace(box_faces()[4], area=0.15 * bottom.area)
    assert roles([*box_faces()[:4], boss, top])["foot"] == ("z+",)


def test_every_other_large_face_is_named_and_a_small_one_is_not() -> None:
    # a face inside, as large as the ends of y, and a strip
    inside = dataclasses.replace(box_faces()[2], number=7, center=(0.05, 0.1, 0.2))
    strip = dataclasses.replace(inside, number=8, area=0.001)
    found = likely_interfaces([*box_faces(), inside, strip])
    assert [one.name for one in found[2:]] == ["right", "left", "face_7", "bottom", "top"]


def test_feet_in_one_plane_are_one_foot_that_their_end_selects() -> None:
    bottom = widen(box_faces()[4])
    pads = [dataclasses.replace(bottom, number=7 + n, area=0.03) for n in range(4)]
    faces = [face for face in box_faces() if face.number != 5]
    found = likely_interfaces([*faces, *pads])
    assert found[0].faces == ("z-",)
    assert found[0].reason.startswith("4 planes, 1200 cm^2")


def test_a_part_drawn_askew_stands_on_its_largest_plane() -> None:
    turn = rotation_about(np.array([1.0, 2.0, 3.0]), 0.5)
    turned = [
        dataclasses.replace(
            face,
            center=as_vector(turn @ face.center),
            normal=as_vector(turn @ face.normal),
            low=as_vector(turn @ face.center - max(SIZE)),
            high=as_vector(turn @ face.center + max(SIZE)),
        )
        for face in box_faces()
    ]
    found = likely_interfaces(turned)
    assert (found[0].name, found[1].name) == ("face_1", "face_2")
    assert likely_interfaces([turned[0]])[0].role == "face"


def test_equal_holes_that_open_into_the_foot_are_its_screws() -> None:
    plate = [widen(face) for face in box_faces()[4:]]
    faces = [*box_faces()[:4], *plate]
    bolts = [bore(7 + i, place) for i, place in enumerate(CORNERS)]
    found = roles([*faces, *bolts, bore(11, (0.05, 0.1), radius=0.02)])
    assert found["foot"] == ("z-",)
    assert found["screws"] == ("face:7", "face:8", "face:9", "face:10")
    assert found["bore"] == ("face:11",)
    upper = [
        dataclasses.replace(
            bolt, axis_point=as_vector(np.add(bolt.axis_point, (0.0, 0.0, 0.3))), span=(0.3, 0.32)
        )
        for bolt in bolts
    ]
    far = roles([*faces, *upper])
    assert "screws" not in far
    assert far["holes"] == ("face:7", "face:8", "face:9", "face:10")
