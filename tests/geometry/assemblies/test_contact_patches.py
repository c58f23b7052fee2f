"""Patches of a contact: the shape that fits, in the coordinates of the part, with the contact's area."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common import approx
from headstock.geometry.assemblies.contact_patches import outline_area, write_contact_patches
from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.parts import Assembly, Part, PlacedSolid, Placement, TreeNode
from headstock.geometry.frames import FloatArray, rotation_about

Z = np.array([0.0, 0.0, 1.0])
ROTATION = rotation_about(np.array([1.0, 2.0, 3.0]), 0.7)
SHIFT = np.array([0.1, -0.2, 0.3])


def assembly_at(rotation: FloatArray, shift: FloatArray) -> Assembly:
    """Solid 2 is a copy of solid 1, moved."""
    zero = (0.0, 0.0, 0.0)
    solids = tuple(PlacedSolid(i, (), "", 1.0, 1.0, zero, zero, zero, None) for i in (1, 2))
    still: Any = np.eye(3)
    rows: Any = rotation
    x, y, z = map(float, shift)
    places = (Placement(1, still, (0.0, 0.0, 0.0), 0.0), Placement(2, rows, (x, y, z), 0.0))
    return Assembly(
        Path("a.step"), "mm", solids, (Part("part", places),), TreeNode("a", "", (1, 2))
    )


def touch_plane(*outlines: FloatArray, solid_holes: tuple[int, ...] = ()) -> Contact:
    """Overlap on the x-y plane of solids 1 and 2, whose outlines are given on the moved solid."""
    moved = tuple(outline @ ROTATION.T + SHIFT for outline in outlines)
    area = outline_area(outlines[0], Z) - sum(outline_area(one, Z) for one in outlines[1:])
    x, y, z = map(float, ROTATION @ Z)
    return Contact(
        (1, 2),
        "plane",
        ((4,), (7,)),
        0.0,
        area,
        (0.0, 0.0, 0.0),
        (x, y, z),
        outlines=moved,
        covered=((1.0,), (0.3,)),
        solid_holes=((), solid_holes),
    )


def circle(
    radius: float, count: int = 96, start: float = 0.0, stop: float = 2.0 * np.pi
) -> FloatArray:
    angles = start + (stop - start) * np.arange(count) / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])


def rectangle(angle: float) -> FloatArray:
    corners = np.array([[-1, -1], [1, -1], [1, 0.3], [1, 1], [-1, 1]]) * [0.03, 0.01]
    turned = corners @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.column_stack([turned + np.array([0.05, 0.02]), np.zeros(5)])


def read_patch(contact: Contact, side: int = 1) -> dict[str, Any]:
    (text,) = write_contact_patches(assembly_at(ROTATION, SHIFT), contact, side)
    patch: dict[str, Any] = tomllib.loads(f"patch = {text}")["patch"]
    return patch


def millimetres(values: list[str]) -> list[float]:
    return [float(value.removesuffix(" mm")) for value in values]


def test_a_face_that_is_taken_whole_is_named() -> None:
    assert read_patch(touch_plane(rectangle(0.0)), 0) == {"face": "face:4"}


@pytest.mark.parametrize(("degrees", "angle"), [(0, None), (30, "30 deg"), (60, "-30 deg")])
def test_four_right_corners_are_a_rectangle_at_its_angle(degrees: float, angle: str | None) -> None:
    rect = read_patch(touch_plane(rectangle(np.radians(degrees))))["rect"]
    assert rect.get("angle") == angle
    size = [20.0, 60.0] if degrees == 60 else [60.0, 20.0]
    assert millimetres(rect["size"]) == approx(size)
    assert millimetres(rect["center"]) == approx([50.0, 20.0, 0.0])


@pytest.mark.parametrize(
    ("solid_holes", "shape", "inner"), [((), "disk", None), ((1,), "ring", "9 mm")]
)
def test_a_round_outline_is_a_disk_and_a_ring_where_the_part_has_no_hole_itself(
    solid_holes: tuple[int, ...], shape: str, inner: str | None
) -> None:
    patch = read_patch(touch_plane(circle(0.01), circle(0.0045), solid_holes=solid_holes))
    assert patch["face"] == "face:7"
    assert patch[shape]["diameter"] == "20 mm"
    assert patch[shape].get("inner") == inner


def test_other_outlines_have_few_corners_and_the_area_within_1_percent() -> None:
    slot = np.vstack([circle(0.01, 48, 0.0, np.pi), circle(0.01, 48, np.pi) - [0.0, 0.05, 0.0]])
    contact = touch_plane(slot)
    corners = np.array([millimetres(row) for row in read_patch(contact)["outline"]["corners"]])
    assert 6 <= len(corners) <= 32
    assert 1e-6 * outline_area(corners, Z) == approx(contact.area, rel=0.01)


def test_a_hole_of_the_other_part_alone_is_left_out_by_outlines_around_it() -> None:
    square = 10.0 * rectangle(0.0)
    holes = [circle(0.03) + np.array([x, 0.2, 0.0]) for x in (0.35, 0.6)]
    contact = touch_plane(square, *holes, solid_holes=(1, 2))
    patches = write_contact_patches(assembly_at(ROTATION, SHIFT), contact, 1)
    assert len(patches) >= 3
    area = 0.0
    for text in patches:
        patch = tomllib.loads(f"patch = {text}")["patch"]
        corners = np.array([millimetres(row) for row in patch["outline"]["corners"]])
        area += 1e-6 * outline_area(corners, Z)
    assert area == approx(contact.area, rel=0.01)


def test_a_cylinder_is_a_band_about_its_middle() -> None:
    x, y, z = map(float, ROTATION @ np.array([0.0, 0.0, 0.05]) + SHIFT)
    contact = dataclasses.replace(
        touch_plane(circle(0.01)),
        kind="cylinder",
        center=(x, y, z),
        radius=0.01,
        length=0.03,
        outlines=(),
    )
    band = read_patch(contact)["band"]
    assert band == {"center": ["0 mm", "0 mm", "50 mm"], "width": "30 mm"}
