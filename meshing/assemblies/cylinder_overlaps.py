"""Overlaps of bores and shafts along their common axis; lengths in millimetres."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.plane_shapes import plane_axes
from headstock.meshing.assemblies.fitted_surfaces import (
    FittedFace,
    FittedSolid,
    Overlap,
    Surface,
    as_vector,
    axis_distance,
    cover_faces,
    near_surfaces,
)

TIGHTEST = 0.25  # overlap of a shaft with its bore over the radius: threads without their helix
SHORTEST = 0.1  # of an overlap along the axis [mm]
NARROWEST = 0.1  # of an overlap around the axis [rad]
JOINED = 1e-3  # distance of spans that continue each other [mm]


@dataclass(frozen=True, eq=False)
class _Sector:
    """Angles [rad] and heights about an axis, how much of them faces fill, and their numbers."""

    faces: tuple[int, ...]
    angles: tuple[float, float]
    heights: tuple[float, float]
    fill: float

    @property
    def size(self) -> float:
        """Area over the radius."""
        return self.fill * (self.angles[1] - self.angles[0]) * (self.heights[1] - self.heights[0])

    def intersect(self, other: "_Sector") -> Iterator["_Sector"]:
        """Yield what two sectors have in common: more than one where both go around far."""
        low, high = max(self.heights[0], other.heights[0]), min(self.heights[1], other.heights[1])
        for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
            start = max(self.angles[0], other.angles[0] + turn)
            stop = min(self.angles[1], other.angles[1] + turn)
            if stop > start and high > low:
                faces = self.faces + other.faces
                yield _Sector(faces, (start, stop), (low, high), self.fill * other.fill)


def find_cylinder_overlaps(
    solids: Sequence[FittedSolid], pair: tuple[int, int], tolerance: float
) -> list[Overlap]:
    """Find where shafts lie in bores of the other solid.

    Args:
        pair: Indices of the two.
        tolerance: Largest gap, and largest distance of the axes.
    """
    overlaps = []
    for sides in near_surfaces(solids[pair[0]], solids[pair[1]], tolerance):
        one, other = sides[0][0], sides[1][0]
        gap = (one.radius - other.radius) * (1.0 if one.hollow else -1.0)
        if (
            min(one.radius, other.radius) > 0.0
            and one.hollow != other.hollow
            and -max(tolerance, TIGHTEST * one.radius) <= gap <= tolerance
            and axis_distance(one, other) <= tolerance
        ):
            overlaps += _overlap_sides(pair, sides, gap)
    return overlaps


def _overlap_sides(
    pair: tuple[int, int], sides: tuple[Surface, Surface], gap: float
) -> list[Overlap]:
    """Overlap faces on one cylinder with those on another."""
    reference = sides[0][0]
    axis, radius = reference.direction, reference.radius
    axes = plane_axes(axis)
    sectors, others = ([_unroll(face, reference, axes) for face in side] for side in sides)
    pieces = [piece for one in sectors for other in others for piece in one.intersect(other)]
    overlaps = []
    for group in _join_spans(pieces):
        sizes = np.array([piece.size for piece in group])
        heights = np.array([piece.heights for piece in group])
        length = float(heights.max() - heights.min())
        if length < SHORTEST or sizes.sum() < NARROWEST * length:
            continue
        low, high = np.array([piece.angles for piece in group]).T
        outwards = np.column_stack([np.cos((low + high) / 2), np.sin((low + high) / 2)]) @ axes
        on_axis = reference.place + heights.mean(axis=1)[:, None] * axis
        # centroid of an arc: the chord's half over the arc's half, of its radius
        centers = on_axis + radius * np.sinc((high - low) / (2.0 * np.pi))[:, None] * outwards
        areas: list[dict[int, float]] = [{}, {}]
        for piece in group:
            for covered, number, side in zip(areas, piece.faces, sides, strict=True):
                covered[number] = covered.get(number, 0.0) + side[0].radius * piece.size
        contact = Contact(
            solids=(pair[0] + 1, pair[1] + 1),
            kind="cylinder",
            **cover_faces(sides, areas),
            gap=gap,
            area=float(radius * sizes.sum()),
            center=as_vector(sizes @ centers / sizes.sum()),
            axis=as_vector(axis),
            radius=radius,
            length=length,
        )
        between = 0.5 * (radius + sides[1][0].radius)
        overlaps.append((contact, on_axis + between * outwards))
    return overlaps


def _unroll(face: FittedFace, reference: FittedFace, axes: FloatArray) -> _Sector:
    """Return the angles and heights that a face spans about the axis of another.

    Args:
        axes: Directions ``(2, 3)`` across the axis, from the first of which angles count.
    """
    arms = face.points - reference.place
    heights = arms @ reference.direction
    angles = np.arctan2(arms @ axes[1], arms @ axes[0])
    # the grid follows the parameters of the face, one of which goes around
    spans = []
    for grid in (angles, angles.T):
        steps = (np.diff(grid, axis=0) + np.pi) % (2.0 * np.pi) - np.pi
        spans.append((float(steps.sum(axis=0)[0]), float(grid[0, 0])))
    span, start = max(spans, key=lambda one: abs(one[0]))
    start = min(start, start + span)
    low, high = float(heights.min()), float(heights.max())
    fill = min(face.area / (face.radius * abs(span) * (high - low)), 1.0)
    return _Sector((face.number,), (start, start + abs(span)), (low, high), fill)


def _join_spans(pieces: Sequence[_Sector]) -> list[list[_Sector]]:
    """Group sectors that continue each other along the axis."""
    groups: list[list[_Sector]] = []
    end = -np.inf
    for piece in sorted(pieces, key=lambda piece: piece.heights):
        if piece.heights[0] > end + JOINED:
            groups.append([])
        groups[-1].append(piece)
        end = max(end, piece.heights[1])
    return groups
