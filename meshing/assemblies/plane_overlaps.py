"""Exact overlaps of plane faces of two solids, cut out by the CAD kernel (runs in the worker
process).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.assemblies.contact_patches import outline_area
from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.frames import FloatArray
from headstock.meshing.assemblies.fitted_surfaces import (
    PARALLEL,
    FittedSolid,
    Overlap,
    Surface,
    as_vector,
    cover_faces,
    near_surfaces,
    sample_inside,
)
from headstock.meshing.cad.shapes import face_curves, total_area
from headstock.meshing.errors import MeshError

NARROWEST = 0.1  # area over half the rim of an overlap: what is narrower is an edge [mm]
TURN_POINTS = 96  # of an outline along a full turn
COARSE_POINTS = 16  # along a curve to see how far it turns
STRAIGHT = 1e-9  # of an edge's length: what it may differ from its chord
CLOSED = 1e-3  # distance of ends of edges that meet [mm]
HOLE_PROBES = 4  # at which the rim of a hole is looked into
WITHIN = 0.98  # of the radius of a hole
PROBES = 5  # points in an overlap at which the gap is looked into
DEPTHS = (0.25, 0.75)  # of the gap at which this is done


@dataclass(frozen=True, eq=False)
class PlanePair:
    """Faces of two solids on two parallel planes that face each other; lengths in millimetres.

    Attributes:
        solids: Indices of the solids.
        normal: Out of the first solid, ``(3,)``.
        gap: From the first plane to the second along it.
    """

    solids: tuple[int, int]
    sides: tuple[Surface, Surface]
    normal: FloatArray
    gap: float


def pair_planes(
    solids: Sequence[FittedSolid], pair: tuple[int, int], reach: float
) -> list[PlanePair]:
    """Pair the planes of two solids that face each other and lie as near as a distance."""
    pairs = []
    for sides in near_surfaces(solids[pair[0]], solids[pair[1]], reach):
        one, other = sides[0][0], sides[1][0]
        gap = float((other.place - one.place) @ one.direction)
        if (
            max(one.radius, other.radius) == 0.0
            and one.direction @ other.direction < PARALLEL - 1.0
            and abs(gap) <= reach
        ):
            pairs.append(PlanePair(pair, sides, one.direction, gap))
    return pairs


def cut_overlap(pair: PlanePair) -> dict[int, set[int]]:
    """Return the pieces in which the faces of a pair overlap, seen along their normal, and the
    faces that each is a part of.

    Raises:
        MeshError: The CAD kernel cannot intersect them.
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
    try:
        _, parents = occ.intersect(
            [(2, tag) for tag in tags[0]], copies, removeObject=False, removeTool=False
        )
    except Exception as error:  # gmsh raises the bare class
        sides = (
            f"{', '.join(f'face:{face.number}' for face in side)} of solid {index + 1}"
            for index, side in zip(pair.solids, pair.sides, strict=True)
        )
        raise MeshError(
            f"the CAD kernel cannot intersect {' with '.join(sides)}: {error}; export these parts again"
        ) from error
    # the kernel does not list a piece that is one of the faces as a whole, only what it comes from
    sources: dict[int, set[int]] = {}
    for tag, parts in zip(tags[0] + tags[1], parents, strict=True):
        for dim, part in parts:
            if dim == 2:
                sources.setdefault(part, set()).add(tag)
    return {
        part: origin
        for part, origin in sources.items()
        if origin & set(tags[0]) and origin & set(tags[1])
    }


def measure_overlaps(pair: PlanePair, pieces: dict[int, set[int]]) -> list[Overlap]:
    """Measure the connected overlaps that pieces make up, without mere edges."""
    overlaps = []
    for group in _connect(pieces):
        sizes = np.array([total_area([tag]) for tag in group])
        curves = gmsh.model.getBoundary([(2, tag) for tag in group], oriented=False)
        rim = sum(float(gmsh.model.occ.getMass(1, curve)) for _, curve in curves)
        if 2.0 * sizes.sum() < NARROWEST * rim:
            continue
        centers = np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in group])
        outlines = _chain_outlines([abs(tag) for _, tag in curves], pair.normal)
        areas = [
            {
                face.number: float(sizes[[face.tag in pieces[tag] for tag in group]].sum())
                for face in side
            }
            for side in pair.sides
        ]
        contact = Contact(
            solids=(pair.solids[0] + 1, pair.solids[1] + 1),
            kind="plane",
            **cover_faces(pair.sides, areas),
            gap=pair.gap,
            area=float(sizes.sum()),
            center=as_vector(sizes @ centers / sizes.sum()),
            axis=as_vector(pair.normal),
            outlines=outlines,
            solid_holes=_find_solid_holes(pair, outlines),
        )
        probes = np.concatenate([sample_inside(tag, PROBES) for tag in group])
        shifts = [share * pair.gap * pair.normal for share in DEPTHS]
        overlaps.append((contact, np.concatenate([probes + shift for shift in shifts])))
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
    return tuple(sorted(outlines, key=lambda outline: -outline_area(outline, normal)))


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
