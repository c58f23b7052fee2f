"""Overlaps of bores and shafts along their common axis (runs in the worker process)."""

from collections.abc import Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.curved_patches import plane_axes
from headstock.meshing.assemblies.fitted_surfaces import (
    PARALLEL,
    FittedFace,
    FittedSolid,
    boxes_meet,
)

TIGHTEST = 0.25  # overlap of a shaft with its bore over the radius: threads without their helix
SHORTEST = 0.1  # of an overlap along the axis [mm]
NARROWEST = 0.1  # of an overlap around the axis [rad]
JOINED = 1e-3  # distance of spans that continue each other [mm]

Span = tuple[float, float]


@dataclass(frozen=True, eq=False)
class CylinderOverlap:
    """An overlap of a bore and a shaft; lengths in millimetres.

    Attributes:
        sides: Faces on the cylinders of each solid.
        areas: What it takes of the faces of each solid, by their tags.
        gap: Radius of the bore minus that of the shaft.
        area: On the first solid's cylinder.
        center: Centroid, ``(3,)``.
        radius: Of the first solid's cylinder.
        probes: Points half-way between both, ``(n, 3)``.
    """

    sides: tuple[Sequence[FittedFace], Sequence[FittedFace]]
    areas: tuple[dict[int, float], dict[int, float]]
    gap: float
    area: float
    center: FloatArray
    axis: FloatArray
    radius: float
    length: float
    probes: FloatArray


@dataclass(frozen=True, eq=False)
class _Sector:
    """A face in cylinder coordinates: angles [rad] and heights it spans, and how much of these it
    fills.
    """

    tag: int
    angles: Span
    heights: Span
    fill: float


@dataclass(frozen=True, eq=False)
class _Strip:
    """What a face of each solid have in common: angles, heights and how much of these is filled."""

    tags: tuple[int, int]
    angles: Span
    heights: Span
    fill: float

    @property
    def size(self) -> float:
        """Area over the radius."""
        return self.fill * (self.angles[1] - self.angles[0]) * (self.heights[1] - self.heights[0])


def find_cylinder_overlaps(
    first: FittedSolid, second: FittedSolid, tolerance: float
) -> list[CylinderOverlap]:
    """Find where shafts lie in bores of the other solid.

    Args:
        tolerance: Largest gap, and largest distance of the axes.
    """
    overlaps = []
    for label in sorted({int(i) for i in first.labels if first.faces[i].radius > 0.0}):
        for other_label in sorted({int(i) for i in second.labels if second.faces[i].radius > 0.0}):
            one, other = first.faces[label], second.faces[other_label]
            gap = (one.radius - other.radius) * (1.0 if one.hollow else -1.0)
            offset = one.place - other.place
            across = offset - float(offset @ one.direction) * one.direction
            if (
                one.hollow != other.hollow
                and -max(tolerance, TIGHTEST * one.radius) <= gap <= tolerance
                and abs(float(one.direction @ other.direction)) > 1.0 - PARALLEL**2 / 2
                and np.linalg.norm(across) <= tolerance
            ):
                sides = (first.select(label), second.select(other_label))
                overlaps += _overlap_sides(sides, gap, tolerance)
    return overlaps


def _overlap_sides(
    sides: tuple[Sequence[FittedFace], Sequence[FittedFace]], gap: float, tolerance: float
) -> list[CylinderOverlap]:
    """Overlap faces on one cylinder with those on another."""
    reference = sides[0][0]
    near = boxes_meet(
        *(np.array([face.box for face in side]) for side in sides), abs(gap) + tolerance
    )
    strips = [
        strip
        for i, j in np.argwhere(near)
        for strip in _common_strips(
            *(_unroll(sides[k][n], reference) for k, n in enumerate((i, j)))
        )
    ]
    axis, radius = reference.direction, reference.radius
    between = 0.5 * (radius + sides[1][0].radius)
    first, second = plane_axes(axis)
    overlaps = []
    for group in _join_spans(strips):
        low = min(strip.heights[0] for strip in group)
        high = max(strip.heights[1] for strip in group)
        total = sum(strip.size for strip in group)
        if high - low < SHORTEST or total < NARROWEST * (high - low):
            continue
        moment = np.zeros(3)
        probes = []
        for strip in group:
            half = 0.5 * (strip.angles[1] - strip.angles[0])
            middle = 0.5 * (strip.angles[0] + strip.angles[1])
            outwards = np.cos(middle) * first + np.sin(middle) * second
            on_axis = reference.place + 0.5 * sum(strip.heights) * axis
            moment += strip.size * (on_axis + radius * np.sinc(half / np.pi) * outwards)
            probes.append(on_axis + between * outwards)
        areas = tuple(
            {
                face.tag: face.radius * covered
                for face in side
                if (covered := sum(strip.size for strip in group if face.tag in strip.tags))
            }
            for side in sides
        )
        overlaps.append(
            CylinderOverlap(
                *(sides, (areas[0], areas[1]), gap, radius * total, moment / total),
                *(axis, radius, high - low, np.array(probes)),
            )
        )
    return overlaps


def _unroll(face: FittedFace, reference: FittedFace) -> _Sector:
    """Return the angles and heights that a face spans about the axis of another."""
    arms = face.points - reference.place
    heights = arms @ reference.direction
    around = arms @ plane_axes(reference.direction).T
    angles = np.arctan2(around[..., 1], around[..., 0])
    # the grid follows the parameters of the face, one of which goes around
    spans = []
    for grid in (angles, angles.T):
        steps = (np.diff(grid, axis=0) + np.pi) % (2.0 * np.pi) - np.pi
        spans.append((float(steps.sum(axis=0)[0]), float(grid[0, 0])))
    span, start = max(spans, key=lambda one: abs(one[0]))
    span, start = abs(span), start if span > 0.0 else start + span
    low, high = float(heights.min()), float(heights.max())
    area = float(gmsh.model.occ.getMass(2, face.tag))
    fill = min(area / (face.radius * span * (high - low)), 1.0)
    return _Sector(face.tag, (start, start + span), (low, high), fill)


def _common_strips(one: _Sector, other: _Sector) -> list[_Strip]:
    """Return what two faces on one cylinder have in common, more than once where both go around
    far.
    """
    low, high = max(one.heights[0], other.heights[0]), min(one.heights[1], other.heights[1])
    strips = []
    for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
        start = max(one.angles[0], other.angles[0] + turn)
        stop = min(one.angles[1], other.angles[1] + turn)
        if stop > start and high > low:
            strips.append(
                _Strip((one.tag, other.tag), (start, stop), (low, high), one.fill * other.fill)
            )
    return strips


def _join_spans(strips: Sequence[_Strip]) -> list[list[_Strip]]:
    """Group strips that continue each other along the axis."""
    groups: list[list[_Strip]] = []
    end = -np.inf
    for strip in sorted(strips, key=lambda strip: strip.heights):
        if strip.heights[0] > end + JOINED:
            groups.append([])
        groups[-1].append(strip)
        end = max(end, strip.heights[1])
    return groups
