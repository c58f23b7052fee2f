"""Faces of planar solids and tubes, the areas of patches on them in closed form, and sample points with
area weights on the interfaces of a straight bar: sums over them are area integrals of its surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.plane_shapes import flatten_patch
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


def _rib_spans(count: int, thickness: float, low: float, high: float) -> list[Span]:
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


def _clear_spans(count: int, thickness: float, low: float, high: float) -> list[Span]:
    """Return the clear gaps that ``_rib_spans`` leaves [m].

    Args:
        thickness: Of each [m].
        low: Where the first gap begins [m].
        high: Where the last gap ends [m].
    """
    ribs = _rib_spans(count, thickness, low, high)
    edges = [low, *(edge for rib in ribs for edge in rib), high]
    return list(zip(edges[::2], edges[1::2], strict=True))


def column_cells(column: HollowColumn) -> tuple[list[Span], list[Span], list[Span]]:
    """Clear spans of a column's cells along x, y and z [m]."""
    x, y, z = (float(s) for s in column.size)
    return (
        _clear_spans(column.ribs_x, column.rib, -x / 2 + column.wall, x / 2 - column.wall),
        _clear_spans(column.ribs_y, column.rib, -y / 2 + column.wall, y / 2 - column.wall),
        _clear_spans(column.ribs_z, column.rib, column.cap, z - column.cap),
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
        along_x = _rib_spans(solid.ribs_x, solid.rib_thickness, -y / 2, y / 2)
        along_y = _rib_spans(solid.ribs_y, solid.rib_thickness, -x / 2, x / 2)
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
    None for other shapes.
    """
    if patch.shape == "whole":
        return list(face.rects)
    if not patch.is_grid_aligned:
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
    if patch.shape == "rect" and not patch.angle:
        return Outline(0.5 * np.array(patch.size))
    on_end = isinstance(solid, Tube) and patch.face in ("z-", "z+")
    if isinstance(solid, Tube) and on_end and patch.shape == "whole":
        return _circle(solid.outer_diameter, solid.inner_diameter)
    if patch.shape in ("disk", "ring"):
        on_axis = on_end and not np.any(patch.center[:2])
        bore = solid.inner_diameter if isinstance(solid, Tube) and on_axis else 0.0
        return _circle(patch.size[0], max(bore, *patch.size[1:], 0.0))
    face = named_planar_face(solid, patch.face) if isinstance(solid, PlanarSolid) else None
    rects = None if face is None else patch_rects(face, patch)
    if not rects:
        return None
    edges = np.array(rects)
    return Outline(0.5 * np.array([np.ptp(edges[:, :2]), np.ptp(edges[:, 2:])]))


def _circle(diameter: float, hole: float) -> Outline:
    return Outline(np.full(2, 0.5 * diameter), hole / diameter)


def imprint_window(axis: int, patch: Patch) -> Rect:
    """Return the in-plane extent of a patch on a face with the given normal axis; a strip is endless
    along its own axis.

    Raises:
        ValueError: It has no shape in a plane, see ``flatten_patch``.
    """
    axes = list(in_plane_axes(axis))
    low, high = flatten_patch(patch, np.eye(3)[axes]).bounds + np.array(patch.center)[axes]
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def band_span(patch: Patch, low: float, high: float) -> Span:
    """Return where a patch on the round face of a tube begins and ends along its axis [m].

    Args:
        low: Where the face begins [m].
        high: Where it ends [m].
    """
    if patch.shape != "band":
        return low, high
    middle, half = patch.center[2], 0.5 * patch.size[0]
    return max(middle - half, low), min(middle + half, high)


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


# the motion of a bar between two of its nodes is a cubic along it and linear across it: products
# with linear weights are exact
ALONG_POINTS, ACROSS_POINTS, RING_POINTS = 4, 2, 8


Order = tuple[int, int]  # Gauss points along the bar and across it


@dataclass(frozen=True, eq=False)
class PatchSamples:
    """Points ``(n, 3)`` on patches [m] and the area ``(n,)`` each stands for [m^2]."""

    points: FloatArray
    areas: FloatArray


def sample_patches(
    solid: PlanarSolid | Tube,
    patches: Sequence[Patch],
    axis: int,
    breaks: Sequence[float],
    *,
    order: Order | None = None,
) -> PatchSamples:
    """Return the points on patches of a solid that is a bar along an axis.

    Args:
        solid: A solid of one section along the axis.
        patches: On named faces; rectangles that overlap count once.
        axis: Direction of the bar, 0..2.
        breaks: Ascending places along the axis [m] where its motion is not smooth.
        order: Gauss points along the bar from break to break, and across it; None takes as many as
            the motion of a bar of plane sections needs.

    Raises:
        ValueError: A face has no name by which its place is known.
    """
    parts: list[PatchSamples] = []
    for face in dict.fromkeys(patch.face for patch in patches):
        mine = [patch for patch in patches if patch.face == face]
        parts += (
            _round_samples(solid, face, mine, breaks, order)
            if isinstance(solid, Tube)
            else _planar_samples(solid, face, mine, axis, breaks, order)
        )
    return PatchSamples(
        np.vstack([part.points for part in parts]), np.concatenate([part.areas for part in parts])
    )


def _planar_samples(
    solid: PlanarSolid,
    name: str,
    patches: Sequence[Patch],
    axis: int,
    breaks: Sequence[float],
    order: Order | None,
) -> list[PatchSamples]:
    face = named_planar_face(solid, name)
    if face is None:
        raise ValueError(f"the place of face {name!r} is not known")
    first, second = in_plane_axes(face.axis)
    splits = [list(breaks) if direction == axis else [] for direction in (first, second)]
    counts = [order and order[direction != axis] for direction in (first, second)]
    flat: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    rects = [rect for patch in patches for rect in patch_rects(face, patch) or []]
    for a_low, a_high, b_low, b_high in rect_union(rects) if rects else []:
        a, a_weights = _gauss_points(a_low, a_high, splits[0], counts[0])
        b, b_weights = _gauss_points(b_low, b_high, splits[1], counts[1])
        flat.append(
            (
                np.repeat(a, len(b)),
                np.tile(b, len(a)),
                np.asarray(np.outer(a_weights, b_weights).ravel(), dtype=float),
            )
        )
    flat += [
        _slice_patch(patch, face.axis, axis, breaks, order)
        for patch in patches
        if not patch.is_grid_aligned
    ]
    samples = []
    for a, b, areas in flat:
        points = np.full((len(a), 3), face.position)
        points[:, first], points[:, second] = a, b
        samples.append(PatchSamples(points, areas))
    return samples


def _slice_patch(
    patch: Patch, normal: int, axis: int, breaks: Sequence[float], order: Order | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the in-plane places and areas of a patch, in slices across the bar's axis (or across
    the first direction on its end faces).
    """
    axes = list(in_plane_axes(normal))
    shape, center = flatten_patch(patch, np.eye(3)[axes]), np.array(patch.center)[axes]
    sliced = 1 if axis == axes[1] else 0
    low, high = shape.bounds[:, sliced] + center[sliced]
    cuts = [cut + center[sliced] for cut in shape.kinks(sliced)]
    places, weights = _gauss_points(
        low,
        high,
        sorted([*(breaks if axis in axes else []), *cuts]),
        2 * (max(order) if order else ALONG_POINTS),
    )
    middles, halves = shape.chords(sliced, places - center[sliced])
    nodes, node_weights = np.polynomial.legendre.leggauss(max(order) if order else ACROSS_POINTS)
    across = center[1 - sliced] + middles[..., None] + halves[..., None] * nodes
    along = np.broadcast_to(places[:, None, None], across.shape)
    areas = (weights[:, None] * halves)[..., None] * node_weights
    flat = (along.ravel(), across.ravel(), areas.ravel())
    return (flat[1], flat[0], flat[2]) if sliced else flat


def _round_samples(
    tube: Tube, face: str, patches: Sequence[Patch], breaks: Sequence[float], order: Order | None
) -> list[PatchSamples]:
    """Return the rings of points on a tube; on its end faces one ring with the second moments of
    the whole face where no order is asked for.

    Args:
        patches: Whole faces or bands on that face.
    """
    outer, inner = 0.5 * tube.outer_diameter, 0.5 * tube.inner_diameter
    count = RING_POINTS if order is None else 2 * order[1] + 1
    angles = 2.0 * math.pi * np.arange(count) / count
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    heights: FloatArray
    radii: FloatArray
    areas: FloatArray
    ends = {"z-": 0.0, "z+": tube.length}
    if face in ends:
        if order is None:
            radii = np.array([math.hypot(outer, inner) / math.sqrt(2.0)])
            areas = np.array([math.pi * (outer**2 - inner**2)])
        else:
            radii, weights = _gauss_points(inner, outer, [], order[1])
            areas = 2.0 * math.pi * radii * weights
        heights = np.full(len(radii), ends[face])
    elif face in ("outer", "inner"):
        radius = outer if face == "outer" else inner
        spans = rect_union([(*band_span(patch, 0.0, tube.length), 0.0, 1.0) for patch in patches])
        parts = [_gauss_points(*span[:2], breaks, order and order[0]) for span in spans]
        heights, weights = (np.concatenate(values) for values in zip(*parts, strict=True))
        areas, radii = weights * 2.0 * math.pi * radius, np.full(len(heights), radius)
    else:
        raise ValueError(f"the place of face {face!r} is not known")
    rings = (radii[:, None, None] * circle).reshape(-1, 2)
    points = np.column_stack([rings, np.repeat(heights, count)])
    return [PatchSamples(points, np.repeat(areas / count, count))]


def _gauss_points(
    low: float, high: float, breaks: Sequence[float], count: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss points and weights on an interval; on each of its parts where there are
    breaks.
    """
    inside = [cut for cut in breaks if low < cut < high]
    nodes, weights = np.polynomial.legendre.leggauss(
        count or (ALONG_POINTS if len(breaks) else ACROSS_POINTS)
    )
    edges = [low, *inside, high]
    places = np.concatenate([0.5 * (a + b) + 0.5 * (b - a) * nodes for a, b in pairwise(edges)])
    return places, np.concatenate([0.5 * (b - a) * weights for a, b in pairwise(edges)])
