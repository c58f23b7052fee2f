"""Faces of planar solids and tubes, and the areas of patches on them, in closed form."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Tube

PlanarSolid = Box | Plate | HollowColumn
Span = tuple[float, float]
# how far a patch may reach over its face, or a carriage over its rail: a share of their length
OVERHANG_TOLERANCE = 1e-9
Rect = tuple[float, float, float, float]
SignedBox = tuple[float, FloatArray, FloatArray]
FACE_DIRECTIONS: dict[str, tuple[int, float]] = {
    "x-": (0, -1.0), "x+": (0, 1.0), "y-": (1, -1.0), "y+": (1, 1.0), "z-": (2, -1.0), "z+": (2, 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class PlanarFace:
    """An axis-parallel face made of rectangles.

    Attributes:
        axis: Normal axis, 0..2.
        position: Place of the plane along that axis [m].
        rects: ``(a_low, a_high, b_low, b_high)`` along the two in-plane axes in the order x y z
            [m]; they may overlap.
    """

    axis: int
    position: float
    rects: tuple[Rect, ...]


@dataclass(frozen=True, eq=False)
class Outline:
    """The area of a patch.

    Attributes:
        half_lengths: ``(2,)`` of the rectangle around it along the two in-plane axes in the order x
            y z [m]; of a disk or a ring its radius, twice.
        hole: Radius of the hole of a ring over its own, 0 for a disk; None for a rectangle.
    """

    half_lengths: FloatArray
    hole: float | None = None

    @property
    def area(self) -> float:
        """Of the patch [m^2]."""
        product = float(np.prod(self.half_lengths))
        return 4.0 * product if self.hole is None else np.pi * (1.0 - self.hole**2) * product

    @property
    def reach(self) -> float:
        """From its middle to its rim at most [m]."""
        half = self.half_lengths
        return float(np.hypot(*half) if self.hole is None else half[0])

    def __str__(self) -> str:
        first, second = 2e3 * self.half_lengths
        if self.hole is None:
            return f"{first:.6g} x {second:.6g} mm"
        if not self.hole:
            return f"a disk of {first:.6g} mm"
        return f"a ring of {first:.6g} and {first * self.hole:.6g} mm"


def in_plane_axes(axis: int) -> tuple[int, int]:
    """Return the other two axes in the order x y z."""
    first, second = (i for i in range(3) if i != axis)
    return first, second


def rib_spans(count: int, thickness: float, low: float, high: float) -> list[Span]:
    """Return the lower and upper side of ``count`` ribs that leave equal clear gaps between ``low``
    and ``high`` [m].

    Args:
        thickness: Of each [m].
        low: Where the first gap begins [m].
        high: Where the last gap ends [m].
    """
    gap = (high - low - count * thickness) / (count + 1)
    starts = [low + gap * (k + 1) + thickness * k for k in range(count)]
    return [(start, start + thickness) for start in starts]


def clear_spans(count: int, thickness: float, low: float, high: float) -> list[Span]:
    """Return the clear gaps that ``rib_spans`` leaves [m].

    Args:
        thickness: Of each [m].
        low: Where the first gap begins [m].
        high: Where the last gap ends [m].
    """
    ribs = rib_spans(count, thickness, low, high)
    edges = [low, *(edge for rib in ribs for edge in rib), high]
    return list(zip(edges[::2], edges[1::2], strict=True))


def column_cells(column: HollowColumn) -> tuple[list[Span], list[Span], list[Span]]:
    """Clear spans of a column's cells along x, y and z [m]."""
    x, y, z = (float(s) for s in column.size)
    return (
        clear_spans(column.ribs_x, column.rib, -x / 2 + column.wall, x / 2 - column.wall),
        clear_spans(column.ribs_y, column.rib, -y / 2 + column.wall, y / 2 - column.wall),
        clear_spans(column.ribs_z, column.rib, column.cap, z - column.cap),
    )


def planar_boxes(solid: PlanarSolid) -> list[SignedBox]:
    """Return the boxes whose signed sum is the solid (core holes left out):
    ``(sign, low (3,), high (3,))`` [m].
    """
    x, y, z = (float(s) for s in solid.size)
    body = (1.0, np.array([-x / 2, -y / 2, 0.0]), np.array([x / 2, y / 2, z]))
    if isinstance(solid, HollowColumn):
        cells = column_cells(solid)
        return [body] + [
            (-1.0, np.array([a[0], b[0], c[0]]), np.array([a[1], b[1], c[1]]))
            for a in cells[0]
            for b in cells[1]
            for c in cells[2]
        ]
    if isinstance(solid, Plate) and solid.rib_height > 0.0:
        top = z + solid.rib_height
        along_x = rib_spans(solid.ribs_x, solid.rib_thickness, -y / 2, y / 2)
        along_y = rib_spans(solid.ribs_y, solid.rib_thickness, -x / 2, x / 2)
        ribs = [
            (1.0, np.array([-x / 2, low, z]), np.array([x / 2, high, top])) for low, high in along_x
        ]
        ribs += [
            (1.0, np.array([low, -y / 2, z]), np.array([high, y / 2, top])) for low, high in along_y
        ]
        shared = [
            (-1.0, np.array([c, a, z]), np.array([d, b, top]))
            for a, b in along_x
            for c, d in along_y
        ]
        return [body, *ribs, *shared]
    return [body]


def named_planar_face(solid: PlanarSolid, face: str) -> PlanarFace | None:
    """Return the face(s) ``x- .. z+`` at that end of the bounding box, core holes left out; None
    for any other name.
    """
    if face not in FACE_DIRECTIONS:
        return None
    axis, sign = FACE_DIRECTIONS[face]
    first, second = in_plane_axes(axis)
    solids = [(low, high) for factor, low, high in planar_boxes(solid) if factor > 0.0]
    position = (
        max(high[axis] for _, high in solids) if sign > 0.0 else min(low[axis] for low, _ in solids)
    )
    rects = [
        (low[first], high[first], low[second], high[second])
        for low, high in solids
        if (high if sign > 0.0 else low)[axis] == position
    ]
    return PlanarFace(
        axis,
        float(position),
        tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in rects),
    )


def patch_rects(face: PlanarFace, patch: Patch) -> list[Rect] | None:
    """Return the rectangles of a whole, rect or strip patch, cut to its face (they may overlap);
    None for a disk.
    """
    if patch.shape == "whole":
        return list(face.rects)
    if patch.shape == "disk":
        return None
    window = imprint_window(face.axis, patch)
    cut = [
        (max(r[0], window[0]), min(r[1], window[1]), max(r[2], window[2]), min(r[3], window[3]))
        for r in face.rects
    ]  # fmt: skip
    return [r for r in cut if r[0] < r[1] and r[2] < r[3]]


def patch_outline(solid: object, patch: Patch) -> Outline | None:
    """Return the area of a patch as it is written; None where only a mesh knows the face.

    Args:
        solid: Of the component. The end of a tube is a ring, or a disk.
    """
    if patch.shape == "rect":
        return Outline(0.5 * np.array(patch.size))
    on_end = isinstance(solid, Tube) and patch.face in ("z-", "z+")
    if isinstance(solid, Tube) and on_end and patch.shape == "whole":
        return _circle(solid.outer_diameter, solid.inner_diameter)
    if patch.shape == "disk":
        on_axis = on_end and not np.any(patch.center[:2])
        return _circle(
            patch.size[0], solid.inner_diameter if isinstance(solid, Tube) and on_axis else 0.0
        )
    face = named_planar_face(solid, patch.face) if isinstance(solid, PlanarSolid) else None
    rects = None if face is None else patch_rects(face, patch)
    if not rects:
        return None
    edges = np.array(rects)
    return Outline(0.5 * np.array([np.ptp(edges[:, :2]), np.ptp(edges[:, 2:])]))


def _circle(diameter: float, hole: float) -> Outline:
    return Outline(np.full(2, 0.5 * diameter), hole / diameter)


def imprint_window(axis: int, patch: Patch) -> Rect:
    """Return the in-plane extent of a rect or strip on a face with the given normal axis; a strip
    is endless along its own axis.
    """
    first, second = in_plane_axes(axis)
    a, b = patch.center[first], patch.center[second]
    if patch.shape == "strip":
        half = patch.size[0] / 2
        if patch.along == "xyz"[first]:
            return (-np.inf, np.inf, b - half, b + half)
        return (a - half, a + half, -np.inf, np.inf)
    return (
        a - patch.size[0] / 2,
        a + patch.size[0] / 2,
        b - patch.size[1] / 2,
        b + patch.size[1] / 2,
    )


def rect_union(rects: list[Rect]) -> list[Rect]:
    """Return the disjoint rectangles that cover the same area as ``rects``, by coordinate
    compression.
    """
    a_edges = sorted({edge for r in rects for edge in r[:2]})
    b_edges = sorted({edge for r in rects for edge in r[2:]})
    return [
        (a0, a1, b0, b1)
        for a0, a1 in pairwise(a_edges)
        for b0, b1 in pairwise(b_edges)
        if any(r[0] <= a0 and a1 <= r[1] and r[2] <= b0 and b1 <= r[3] for r in rects)
    ]
