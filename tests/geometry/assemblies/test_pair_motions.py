"""Motions that contacts leave free, and the joint that a pair may be."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx
from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.pair_motions import PairMotion, find_pair_motions, free_motions
from headstock.geometry.assemblies.parts import Assembly, Part, PlacedSolid, Placement, TreeNode
from headstock.geometry.frames import FloatArray, rotation_about

Triple = tuple[float, float, float]
STILL: Any = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def vector(values: FloatArray | Sequence[float]) -> Triple:
    x, y, z = map(float, values)
    return x, y, z


def plane(
    solids: tuple[int, int],
    center: Triple,
    normal: Triple,
    *,
    wide: bool = False,
    length: float = 0.04,
) -> Contact:
    """A square, or a strip along y, of a width of 40 mm."""
    axis = np.array(normal)
    along = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.5 else np.array([1.0, 0.0, 0.0])
    sides = 0.5 * length * along, 0.02 * np.cross(axis, along)
    corners = [
        np.array(center) + a * sides[0] + b * sides[1]
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    gap = 0.003 if wide else 0.0
    return Contact(
        *(solids, "plane", ((1,), (1,)), gap, 0.04 * length, center, normal),
        outlines=(np.array(corners),),
        wide=wide,
    )


def cylinder(
    solids: tuple[int, int], center: Triple, radius: float = 0.01, length: float = 0.03
) -> Contact:
    """Along z."""
    area = 2.0 * np.pi * radius * length
    return Contact(
        *(solids, "cylinder", ((1,), (1,)), 0.0, area, center, (0.0, 0.0, 1.0)),
        radius=radius,
        length=length,
    )


def saddle(
    rail: int, carriage: int, y: float = 0.0, *, wide: bool = False, length: float = 0.04
) -> list[Contact]:
    """A carriage around a rail along y."""
    sides = [
        ((0.0, y, 0.02), (0.0, 0.0, 1.0)),
        ((0.02, y, 0.0), (1.0, 0.0, 0.0)),
        ((-0.02, y, 0.0), (-1.0, 0.0, 0.0)),
    ]
    return [
        plane((rail, carriage), center, normal, wide=wide, length=length)
        for center, normal in sides
    ]


def assemble(
    contacts: Sequence[Contact],
    names: Sequence[str],
    long: Sequence[int] = (),
    parts: Sequence[str] = (),
) -> dict[tuple[int, int], PairMotion]:
    """Motions of an assembly of cubes of 0.1 m, some of them 1 m long along y; small ones are called
    screw.
    """
    solids = []
    for number, name in enumerate(names, 1):
        size = np.array([0.1, 1.0 if number in long else 0.1, 0.1])
        volume = 1e-7 if name == "screw" else float(size.prod())
        solids.append(
            PlacedSolid(
                number,
                (),
                name,
                volume,
                1.0,
                (0.0, 0.0, 0.0),
                vector(-size / 2),
                vector(size / 2),
                None,
            )
        )
    kinds: dict[str, list[int]] = {}
    for number, part in enumerate(parts or [str(i) for i in range(len(names))], 1):
        kinds.setdefault(part, []).append(number)
    all_parts = tuple(
        Part(name, tuple(Placement(n, STILL, (0.0, 0.0, 0.0), 0.0) for n in numbers))
        for name, numbers in kinds.items()
    )
    tree = TreeNode("a", "", tuple(range(1, len(names) + 1)))
    assembly = Assembly(Path("a.step"), "mm", tuple(solids), all_parts, tree)
    return {one.solids: one for one in find_pair_motions(assembly, contacts)}


@pytest.mark.parametrize(
    ("contacts", "slides", "turns"),
    [
        ([plane((1, 2), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))], 2, 1),
        ([cylinder((1, 2), (0.0, 0.0, 0.0))], 1, 1),
        (
            [cylinder((1, 2), (0.0, 0.0, 0.0)), plane((1, 2), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0))],
            0,
            1,
        ),
        ([cylinder((1, 2), (0.0, 0.0, 0.0)), cylinder((1, 2), (0.1, 0.0, 0.0))], 1, 0),
        (saddle(1, 2), 1, 0),
        ([*saddle(1, 2), plane((1, 2), (0.0, 0.02, 0.0), (0.0, 1.0, 0.0))], 0, 0),
    ],
)
def test_contacts_leave_the_motions_of_textbooks(
    contacts: list[Contact], slides: int, turns: int
) -> None:
    free, axes = free_motions(contacts)
    assert (len(free), len(axes)) == (slides, turns)


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
    st.floats(0.0, 3.0),
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
)
def test_free_motions_follow_a_rotated_and_moved_pair(
    axis: Triple, angle: float, shift: Triple
) -> None:
    rotation = rotation_about(np.array(axis), angle)
    pins = [cylinder((1, 2), (0.02, 0.03, 0.05)), plane((1, 2), (0.02, 0.03, 0.0), (0.0, 0.0, 1.0))]
    for contacts in (pins, saddle(1, 2)):
        moved = [
            dataclasses.replace(
                one,
                center=vector(rotation @ one.center + shift),
                axis=vector(rotation @ one.axis),
                outlines=tuple(outline @ rotation.T + shift for outline in one.outlines),
            )
            for one in contacts
        ]
        (slides, turns), (others, axes) = free_motions(contacts), free_motions(moved)
        assert (len(slides), len(turns)) == (len(others), len(axes))
        for slide, other in zip(slides, others, strict=True):
            assert abs(float(rotation @ slide @ other)) == approx(1.0)
        for (point, direction), (at, along) in zip(turns, axes, strict=True):
            assert abs(float(rotation @ direction @ along)) == approx(1.0)
            arm = rotation @ point + shift - at
            assert np.linalg.norm(np.cross(arm, along)) < 1e-6


def test_carriages_with_air_guide_and_tight_ones_where_they_repeat() -> None:
    wide = assemble(saddle(1, 2, wide=True), ["", ""], long=[1])[1, 2]
    assert wide.likely == "guide"
    assert wide.reason == "faces on 3 sides leave y free with 3 mm of air"
    alone = assemble(saddle(1, 2), ["", ""], long=[1])[1, 2]
    assert (alone.likely, alone.slides) == ("bonded", ((0.0, 1.0, 0.0),))
    assert "only one such pair" in alone.reason
    named = assemble(saddle(1, 2), ["Rail 25", ""], long=[1])[1, 2]
    assert named.likely == "guide"
    several = assemble([*saddle(1, 2), *saddle(1, 3, 0.2)], [""] * 3, long=[1], parts="abb")
    assert {one.likely for one in several.values()} == {"guide"}
    assert several[1, 3].reason.endswith("; 2 equal pairs")


def test_what_only_looks_prismatic_stays_bonded_and_says_so() -> None:
    shoulder = assemble(saddle(1, 2)[:2], ["", ""], long=[1, 2])[1, 2]
    assert (shoulder.likely, len(shoulder.slides)) == ("bonded", 1)
    assert "rail on a shoulder" in shoulder.reason
    # the long solid is the one around the short one
    grooves = [*saddle(1, 2, length=0.1), *saddle(1, 3, 0.2, length=0.1)]
    key = assemble(grooves, [""] * 3, long=[2, 3], parts="abb")
    assert {one.likely for one in key.values()} == {"bonded"}
    assert "key in its groove" in key[1, 2].reason
    through = [cylinder((1, 3), (0.0, 0.1, 0.0)), cylinder((2, 3), (0.0, 0.1, 0.0))]
    screwed = assemble([*saddle(1, 2, wide=True), *through], ["", "", "screw"], long=[1])[1, 2]
    assert (screwed.likely, screwed.reason) == ("bonded", "a screw or pin holds on to both")


def test_a_bearing_turns_where_its_name_says_so_and_only_at_its_shaft() -> None:
    ring = [cylinder((1, 2), (0.0, 0.0, 0.0), 0.02), cylinder((2, 3), (0.0, 0.0, 0.0), 0.03)]
    named = assemble(ring, ["spindle", "Spindellager", "housing"])
    assert (named[1, 2].likely, named[2, 3].likely) == ("bearing", "fit")
    assert "outer ring" in named[2, 3].reason
    unnamed = assemble(ring, ["", "", ""])
    assert {one.likely for one in unnamed.values()} == {"fit"}
    assert "a bearing, a bushing or a spacer" in unnamed[1, 2].reason


@pytest.mark.parametrize(
    ("name", "likely"),
    [("", "fit"), ("dowel 8x20", "fit"), ("Lagerbock", "bearing"), ("ball screw nut", "screw")],
)
def test_one_cylinder_fits_unless_a_name_says_more(name: str, likely: str) -> None:
    pair = assemble([cylinder((1, 2), (0.0, 0.0, 0.0))], ["block", name])[1, 2]
    assert pair.likely == likely
    assert pair.reason.startswith("a cylinder leaves them free to turn and slide about z")
