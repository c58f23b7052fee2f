"""Holes, names and suggestions are read off faces that are written down by hand."""

import dataclasses

import numpy as np
from cad_blocks import bore, box_faces

from common import approx
from headstock.geometry.parts.cad_faces import find_holes, fit_cylinder, name_faces, part_extent


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
