"""Sample points with area weights on the interfaces of a straight bar: sums over them are area
integrals of its surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import (
    PlanarSolid,
    in_plane_axes,
    named_planar_face,
    patch_rects,
    rect_union,
)
from headstock.geometry.parts.solids import Tube

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
            _round_samples(solid, face, breaks, order)
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
        _disk_points(patch, first, second, axis, breaks, order)
        for patch in patches
        if patch.shape == "disk"
    ]
    samples = []
    for a, b, areas in flat:
        points = np.full((len(a), 3), face.position)
        points[:, first], points[:, second] = a, b
        samples.append(PatchSamples(points, areas))
    return samples


def _disk_points(
    patch: Patch,
    first: int,
    second: int,
    axis: int,
    breaks: Sequence[float],
    order: Order | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the in-plane places and areas of a disk, in slices across the bar's axis (or across
    the first direction on its end faces).
    """
    swap = axis == second
    along, across = (
        (patch.center[second], patch.center[first])
        if swap
        else (patch.center[first], patch.center[second])
    )
    radius = 0.5 * patch.size[0]
    places, weights = _gauss_points(
        along - radius,
        along + radius,
        breaks if axis in (first, second) else [],
        2 * (max(order) if order else ALONG_POINTS),
    )
    chords = np.sqrt(np.maximum(0.0, radius**2 - (places - along) ** 2))
    nodes, node_weights = np.polynomial.legendre.leggauss(max(order) if order else ACROSS_POINTS)
    a, b = np.repeat(places, len(nodes)), (across + chords[:, None] * nodes).ravel()
    areas = (weights * chords)[:, None] * node_weights
    return (b, a, areas.ravel()) if swap else (a, b, areas.ravel())


def _round_samples(
    tube: Tube, face: str, breaks: Sequence[float], order: Order | None
) -> list[PatchSamples]:
    """Return the rings of points on a tube; on its end faces one ring with the second moments of
    the whole face where no order is asked for.
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
        heights, weights = _gauss_points(0.0, tube.length, breaks, order and order[0])
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
