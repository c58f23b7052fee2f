"""Holes, names and suggestions are read off faces that are written down by hand."""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import (
    CadFace,
    Vector,
    find_holes,
    fit_cylinder,
    name_faces,
    part_extent,
    suggest_interfaces,
)

SIZE = (0.1, 0.2, 0.4)


def as_vector(values: FloatArray) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def box_faces() -> list[CadFace]:
    """The faces of a block from the origin, in the order x- x+ y- y+ z- z+."""
    faces: list[CadFace] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            low, high, normal = np.zeros(3), np.array(SIZE), np.zeros(3)
            low[axis] = high[axis] = SIZE[axis] if sign > 0 else 0.0
            normal[axis] = sign
            area = float(np.prod([SIZE[i] for i in range(3) if i != axis]))
            faces.append(
                CadFace(
                    len(faces) + 1,
                    "plane",
                    area,
                    center=as_vector(0.5 * (low + high)),
                    normal=as_vector(normal),
                    low=as_vector(low),
                    high=as_vector(high),
                )
            )
    return faces


def bore(
    number: int,
    place: tuple[float, float],
    radius: float = 0.005,
    depth: float = 0.02,
    turn: float = 1.0,
) -> CadFace:
    """The wall of a hole along z, or part of its turn."""
    x, y = place
    return CadFace(
        number,
        "cylinder",
        turn * 2 * np.pi * radius * depth,
        (x, y, depth / 2),
        (-1.0, 0.0, 0.0),
        (x - radius, y - radius, 0.0),
        (x + radius, y + radius, depth),
        radius=radius,
        axis=(0.0, 0.0, 1.0),
        axis_point=(x, y, depth / 2),
        span=(0.0, depth),
        hollow=True,
    )


def test_a_hole_of_two_half_walls_is_one_hole() -> None:
    halves = [bore(7, (0.02, 0.02), turn=0.5), bore(8, (0.02, 0.02), turn=0.5)]
    (hole,) = find_holes([*box_faces(), *halves])
    assert hole.faces == (7, 8)
    assert hole.place == pytest.approx((0.02, 0.02, 0.01))


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


def test_suggested_planes_are_the_opposing_ends_with_most_between_them() -> None:
    first, second = suggest_interfaces(box_faces())
    # on a block every pair holds the same volume; the larger faces come first
    assert {first.faces[0], second.faces[0]} in ({"x-", "x+"}, {"y-", "y+"}, {"z-", "z+"})
    inward = [
        dataclasses.replace(face, normal=(-x, -y, -z))
        for face in box_faces()
        for x, y, z in [face.normal]
    ]
    assert suggest_interfaces(inward) == []


def test_equal_holes_are_suggested_as_one_pattern_and_a_single_one_as_a_bore() -> None:
    bolts = [
        bore(7 + i, (x, y))
        for i, (x, y) in enumerate([(0.02, 0.02), (0.08, 0.02), (0.02, 0.18), (0.08, 0.18)])
    ]
    found = {
        item.name: item
        for item in suggest_interfaces([*box_faces(), *bolts, bore(11, (0.05, 0.1), radius=0.02)])
    }
    assert found["holes_1"].faces == ("face:7", "face:8", "face:9", "face:10")
    assert found["holes_1"].reason == "4 holes of 10 mm"
    assert found["bore"].faces == ("face:11",)


def test_a_cylinder_is_fitted_through_points_on_part_of_its_wall() -> None:
    axis, place, radius = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([0.3, -0.1, 0.2]), 0.07
    first = np.cross(axis, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angles, heights = np.meshgrid(np.linspace(0.0, 1.2, 9), np.linspace(0.0, 0.1, 4))
    normals = np.cos(angles.ravel())[:, None] * first + np.sin(angles.ravel())[:, None] * second
    points = place + radius * normals + heights.ravel()[:, None] * axis
    found_axis, found_place, found_radius = fit_cylinder(points, normals)
    assert abs(found_axis @ axis) == pytest.approx(1.0, abs=1e-12)
    assert found_radius == pytest.approx(radius, rel=1e-9)
    assert np.linalg.norm(np.cross(found_place - place, axis)) < 1e-9
