"""Exact overlaps of plane faces of two solids, cut out by the CAD kernel (runs in the worker
process).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.assemblies.contact_patches import outline_area
from headstock.geometry.frames import FloatArray
from headstock.meshing.assemblies.fitted_surfaces import (
    PARALLEL,
    FittedFace,
    FittedSolid,
    boxes_meet,
    sample_inside,
)
from headstock.meshing.cad.shapes import face_curves, total_area

NARROWEST = 0.1  # area over half the rim of an overlap: what is narrower is an edge [mm]
TURN_POINTS = 96  # of an outline along a full turn
COARSE_POINTS = 16  # along a curve to see how far it turns
STRAIGHT = 1e-9  # of an edge's length: what it may differ from its chord
CLOSED = 1e-3  # distance of ends of edges that meet [mm]
HOLE_PROBES = 4  # at which the rim of a hole is looked into
WITHIN = 0.98  # of the radius of a hole
PROBES = 5  # points in an overlap at which the gap is looked into


@dataclass(frozen=True, eq=False)
class PlanePair:
    """Faces of two solids on two parallel planes that face each other; lengths in millimetres.

    Attributes:
        solids: Indices of the solids.
        sides: Faces of each, on one plane each.
        normal: Out of the first solid, ``(3,)``.
        gap: From the first plane to the second along it.
    """

    solids: tuple[int, int]
    sides: tuple[tuple[FittedFace, ...], tuple[FittedFace, ...]]
    normal: FloatArray
    gap: float


@dataclass(frozen=True, eq=False)
class PlaneOverlap:
    """A connected overlap on the first plane of a pair; lengths in millimetres.

    Attributes:
        areas: What it takes of the faces of each solid, by their tags.
        center: Centroid, ``(3,)``.
        outlines: Closed, ``(n, 3)`` each, the outermost first.
        probes: Points in it, ``(n, 3)``.
        solid_holes: Indices of the outlines of holes where the first solid, or the second, has none.
    """

    areas: tuple[dict[int, float], dict[int, float]]
    area: float
    center: FloatArray
    outlines: tuple[FloatArray, ...]
    probes: FloatArray
    solid_holes: tuple[tuple[int, ...], tuple[int, ...]]


def pair_planes(
    solids: Sequence[FittedSolid], indices: tuple[int, int], reach: float
) -> list[PlanePair]:
    """Pair the plane faces of two solids that face each other and lie as near as a distance."""
    first, second = (solids[i] for i in indices)
    planes = [
        [i for i, face in enumerate(one.faces) if face.radius == 0.0] for one in (first, second)
    ]
    if not all(planes):
        return []
    (normals, places, boxes), (others, other_places, other_boxes) = (
        (
            np.array([one.faces[i].direction for i in rows]),
            np.array([one.faces[i].place for i in rows]),
            np.array([one.faces[i].box for i in rows]),
        )
        for one, rows in zip((first, second), planes, strict=True)
    )
    gaps = np.einsum("nmi,ni->nm", other_places[None] - places[:, None], normals)
    near = (normals @ others.T < PARALLEL**2 / 2 - 1.0) & (np.abs(gaps) <= reach)
    near &= boxes_meet(boxes, other_boxes, reach)
    groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for a, b in np.argwhere(near):
        i, j = planes[0][a], planes[1][b]
        groups.setdefault((int(first.labels[i]), int(second.labels[j])), []).append((i, j))
    pairs = []
    for (label, other_label), members in groups.items():
        a, b = first.faces[label], second.faces[other_label]
        gap = float((b.place - a.place) @ a.direction)
        sides = (
            first.select(label, {i for i, _ in members}),
            second.select(other_label, {j for _, j in members}),
        )
        pairs.append(PlanePair(indices, sides, a.direction, gap))
    return pairs


def cut_overlap(pair: PlanePair) -> dict[int, set[int]]:
    """Return the pieces in which the faces of a pair overlap, seen along their normal, and the
    faces that each is a part of.
    """
    occ = gmsh.model.occ
    tags = [[face.tag for face in side] for side in pair.sides]
    copies = occ.copy([(2, tag) for tag in tags[1]])
    plane = pair.sides[1][0]
    axis = np.cross(pair.normal, plane.direction)
    sine = float(np.linalg.norm(axis))
    # faces overlap for the kernel only where they lie in one plane to 1e-7 of its unit
    if sine > 1e-12:
        occ.rotate(copies, *plane.place, *(axis / sine), np.arcsin(sine))
    occ.translate(copies, *(-pair.gap * pair.normal))
    pieces, parents = occ.intersect(
        [(2, tag) for tag in tags[0]], copies, removeObject=False, removeTool=True
    )
    found: dict[int, set[int]] = {tag: set() for dim, tag in pieces if dim == 2}
    for source, parts in zip(tags[0] + tags[1], parents, strict=True):
        for dim, part in parts:
            if dim == 2 and part in found:
                found[part].add(source)
    return found


def measure_overlaps(pair: PlanePair, pieces: dict[int, set[int]]) -> list[PlaneOverlap]:
    """Measure the connected overlaps that pieces make up, without mere edges."""
    overlaps = []
    for group in _connect(pieces):
        areas = {tag: total_area([tag]) for tag in group}
        area = sum(areas.values())
        curves = gmsh.model.getBoundary([(2, tag) for tag in group], oriented=False)
        rim = sum(float(gmsh.model.occ.getMass(1, curve)) for _, curve in curves)
        if 2.0 * area < NARROWEST * rim:
            continue
        centers = [np.array(gmsh.model.occ.getCenterOfMass(2, tag)) for tag in group]
        center = sum(share * middle for share, middle in zip(areas.values(), centers, strict=True))
        sides = tuple(
            {
                face.tag: covered
                for face in side
                if (covered := sum(areas[tag] for tag in group if face.tag in pieces[tag]))
            }
            for side in pair.sides
        )
        outlines = _chain_outlines([abs(tag) for _, tag in curves], pair.normal)
        overlaps.append(
            PlaneOverlap(
                (sides[0], sides[1]),
                area,
                np.asarray(center / area),
                outlines,
                np.concatenate([sample_inside(tag, PROBES) for tag in group]),
                _find_solid_holes(pair, outlines),
            )
        )
    return overlaps


def _connect(pieces: Collection[int]) -> list[list[int]]:
    """Group faces that share edges."""
    groups: list[tuple[list[int], set[int]]] = []
    for tag in pieces:
        members, rim = [tag], face_curves(tag)
        for group in [group for group in groups if group[1] & rim]:
            groups.remove(group)
            members, rim = group[0] + members, group[1] | rim
        groups.append((members, rim))
    return [members for members, _ in groups]


def _chain_outlines(curves: list[int], normal: FloatArray) -> tuple[FloatArray, ...]:
    """Return the closed outlines ``(n, 3)`` that edges make, the one around most area first."""
    left = [_sample_curve(curve) for curve in curves]
    outlines: list[FloatArray] = []
    while left:
        outline = left.pop()
        while left and np.linalg.norm(outline[-1] - outline[0]) > CLOSED:
            ends = np.array([[line[0], line[-1]] for line in left])
            distances = np.linalg.norm(ends - outline[-1], axis=2)
            k, end = np.unravel_index(int(distances.argmin()), distances.shape)
            following = left.pop(int(k))
            outline = np.vstack([outline, (following if end == 0 else following[::-1])[1:]])
        outlines.append(outline[:-1])
    return tuple(sorted(outlines, key=lambda outline: -abs(outline_area(outline, normal))))


def _find_solid_holes(
    pair: PlanePair, outlines: Sequence[FloatArray]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return which holes of an overlap the faces of each side fill, at least along the rim."""
    sides: list[tuple[int, ...]] = []
    for side, shift in zip(pair.sides, (0.0, pair.gap), strict=True):
        filled = []
        for i, outline in enumerate(outlines[1:], 1):
            spread = outline[:: max(len(outline) // HOLE_PROBES, 1)]
            probes = outline.mean(axis=0) + WITHIN * (spread - outline.mean(axis=0))
            probes += shift * pair.normal
            if any(
                gmsh.model.isInside(2, face.tag, list(probe)) for face in side for probe in probes
            ):
                filled.append(i)
        sides.append(tuple(filled))
    return sides[0], sides[1]


def _sample_curve(curve: int) -> FloatArray:
    """Return points along an edge ``(n, 3)``, both ends included: two of a straight one."""
    (low,), (high,) = gmsh.model.getParametrizationBounds(1, curve)
    points = np.array(gmsh.model.getValue(1, curve, np.linspace(low, high, COARSE_POINTS + 1)))
    points = points.reshape(-1, 3)
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if lengths.sum() - np.linalg.norm(points[-1] - points[0]) <= STRAIGHT * lengths.sum():
        return points[[0, -1]]
    cosines = np.einsum("ni,ni->n", steps[1:], steps[:-1]) / (lengths[1:] * lengths[:-1])
    turn = float(np.arccos(np.clip(cosines, -1.0, 1.0)).sum())
    count = int(np.ceil(TURN_POINTS * turn / (2.0 * np.pi))) + 1
    along = np.linspace(low, high, count + 1)
    return np.array(gmsh.model.getValue(1, curve, along)).reshape(-1, 3)
