"""Planes and cylinders fitted to the faces of CAD solids from sampled normals, whatever surface the
file stores (runs in the worker process).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.cad_faces import Vector, fit_cylinder

SAMPLES = 7  # along each parameter of a face, its bounds included
SAME_NORMAL = 1e-4  # of a plane's normals
FLATNESS = 1e-5  # of a plane, over its extent
ACROSS = 1e-3  # cosine between a cylinder's normals and its axis
ROUNDNESS = 1e-3  # of a cylinder, over its radius
WIDEST_RADIUS = 1e3  # of a cylinder, over the extent of the face: beyond, it is no more than bent
PROBE = 0.02  # how far from a face the outside is looked for [mm]
SAME_SURFACE = 1e-3  # distance of faces of one plane or cylinder of a solid [mm]
PARALLEL = 5e-7  # 1 - cosine between directions that count as parallel: 1 mm in a metre


@dataclass(frozen=True, eq=False)
class FittedFace:
    """A face on a plane or a cylinder; lengths in millimetres.

    Attributes:
        tag: Of the face in the open model.
        number: As ``face:N`` counts the faces of its solid.
        points: Of its surface, over its range of parameters, ``(SAMPLES, SAMPLES, 3)``.
        direction: Unit outward normal of a plane, axis of a cylinder, ``(3,)``.
        place: Middle of a plane's points, a point of a cylinder's axis, ``(3,)``.
        box: Lower and upper corner of its bounding box, ``(2, 3)``.
        radius: Of a cylinder; 0 for a plane.
        hollow: The material lies outside the cylinder.
    """

    tag: int
    number: int
    area: float
    points: FloatArray
    direction: FloatArray
    place: FloatArray
    box: FloatArray
    radius: float = 0.0
    hollow: bool = False


# faces of one solid on one plane or cylinder
type Surface = tuple[FittedFace, ...]
# a contact in millimetres, faces as its solids count them, and points in its gap ``(n, 3)``
type Overlap = tuple[Contact, FloatArray]


@dataclass(frozen=True, eq=False)
class FittedSolid:
    """The planes and cylinders of a solid.

    Attributes:
        box: Lower and upper corner of its bounding box, ``(2, 3)`` [mm].
    """

    volume: int
    box: FloatArray
    surfaces: tuple[Surface, ...]


def fit_face(volume: int, tag: int, number: int, *, shared: bool) -> FittedFace | None:
    """Fit a plane or a cylinder to a face of a volume; None where it is neither.

    Args:
        shared: Another volume has the same face, so the kernel's normal may point out of that one.
    """
    low, high = gmsh.model.getParametrizationBounds(2, tag)
    u, v = (np.linspace(start, stop, SAMPLES) for start, stop in zip(low, high, strict=True))
    pairs = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    points = np.array(gmsh.model.getValue(2, tag, pairs.ravel())).reshape(-1, 3)
    normals = np.array(gmsh.model.getNormal(tag, pairs.ravel())).reshape(-1, 3)
    if not np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6):
        return None  # a pole
    for inner in sample_inside(tag, 1) if shared else ():
        normal = np.array(gmsh.model.getNormal(tag, gmsh.model.getParametrization(2, tag, inner)))
        if is_inside(volume, inner + PROBE * normal):
            normals = -normals
    extent = float(np.ptp(points, axis=0).max())
    area = float(gmsh.model.occ.getMass(2, tag))
    grid = points.reshape(SAMPLES, SAMPLES, 3)
    box = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3)
    middle, mean = points.mean(axis=0), normals.mean(axis=0)
    if np.abs(normals - mean).max() <= SAME_NORMAL:
        flat = np.abs((points - middle) @ mean).max() <= FLATNESS * extent
        mean /= np.linalg.norm(mean)
        return FittedFace(tag, number, area, grid, mean, middle, box) if flat else None
    axis, place, radius = fit_cylinder(points, normals)
    radial = points - place
    radial -= (radial @ axis)[:, None] * axis
    unevenness = np.abs(np.linalg.norm(radial, axis=1) - radius).max()
    if (
        np.abs(normals @ axis).max() > ACROSS
        or unevenness > ROUNDNESS * radius
        or radius > WIDEST_RADIUS * extent
    ):
        return None
    hollow = float(np.einsum("ni,ni->", normals, radial)) < 0.0
    return FittedFace(tag, number, area, grid, axis, place, box, radius, hollow)


def sample_inside(tag: int, most: int) -> FloatArray:
    """Return some points within the rim of a face, ``(n, 3)``."""
    low, high = (np.array(bound) for bound in gmsh.model.getParametrizationBounds(2, tag))
    shares = (np.arange(SAMPLES) + 0.5) / SAMPLES
    grid = np.stack(np.meshgrid(shares, shares, indexing="ij"), axis=-1).reshape(-1, 2)
    # from the middle outwards: rims are at the bounds
    order = np.argsort(np.abs(grid - 0.5).max(axis=1), kind="stable")
    inside: list[FloatArray] = []
    for pair in low + grid[order] * (high - low):
        if len(inside) < most and gmsh.model.isInside(2, tag, list(pair), True):
            inside.append(np.array(gmsh.model.getValue(2, tag, list(pair))))
    return np.array(inside).reshape(-1, 3)


def is_inside(volume: int, point: FloatArray) -> bool:
    """Return whether a point ``(3,)`` lies in a volume."""
    return bool(gmsh.model.isInside(3, volume, list(point)))


def group_surfaces(faces: Sequence[FittedFace]) -> tuple[Surface, ...]:
    """Group the faces of a solid that lie on one plane or cylinder."""
    groups: list[list[FittedFace]] = []
    for face in faces:
        same = next((group for group in groups if _share_surface(face, group[0])), None)
        if same is None:
            groups.append([face])
        else:
            same.append(face)
    return tuple(map(tuple, groups))


def _share_surface(face: FittedFace, other: FittedFace) -> bool:
    if abs(face.radius - other.radius) > SAME_SURFACE or face.hollow != other.hollow:
        return False
    along = float((face.place - other.place) @ other.direction)
    if face.radius == 0.0:
        cosine = float(face.direction @ other.direction)
        return abs(along) <= SAME_SURFACE and cosine > 1.0 - PARALLEL
    return axis_distance(face, other) <= SAME_SURFACE


def axis_distance(one: FittedFace, other: FittedFace) -> float:
    """Return the distance of the axes of two cylinders; infinite where they are not parallel."""
    if abs(float(one.direction @ other.direction)) < 1.0 - PARALLEL:
        return np.inf
    offset = one.place - other.place
    return float(np.linalg.norm(offset - (offset @ other.direction) * other.direction))


def near_surfaces(
    first: FittedSolid, second: FittedSolid, reach: float
) -> Iterator[tuple[Surface, Surface]]:
    """Yield the surfaces of two solids whose faces come as near as a distance, with these faces."""
    boxes, others = (
        np.array([_bound(surface) for surface in one.surfaces]).reshape(-1, 2, 3)
        for one in (first, second)
    )
    for i, j in np.argwhere(boxes_meet(boxes, others, reach)):
        one, other = first.surfaces[i], second.surfaces[j]
        rows = [np.array([face.box for face in surface]) for surface in (one, other)]
        near = boxes_meet(rows[0], rows[1], reach)
        if near.any():
            yield (
                tuple(one[k] for k in np.flatnonzero(near.any(axis=1))),
                tuple(other[k] for k in np.flatnonzero(near.any(axis=0))),
            )


def cover_faces(sides: Sequence[Surface], areas: Sequence[Mapping[int, float]]) -> dict[str, Any]:
    """Return the faces of an overlap and the share that it takes of each, as fields of a contact.

    Args:
        areas: What it takes of the faces of each side, by their numbers.
    """
    shares = [
        {face.number: taken[face.number] / face.area for face in side if taken.get(face.number)}
        for side, taken in zip(sides, areas, strict=True)
    ]
    return {
        "faces": (tuple(shares[0]), tuple(shares[1])),
        "covered": (tuple(shares[0].values()), tuple(shares[1].values())),
    }


def as_vector(values: FloatArray) -> Vector:
    """Return three numbers as a field of a contact."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def _bound(surface: Surface) -> FloatArray:
    """Return the bounding box ``(2, 3)`` of a surface."""
    boxes = np.array([face.box for face in surface])
    return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def boxes_meet(boxes: FloatArray, others: FloatArray, reach: float) -> BoolArray:
    """Return which boxes ``(n, 2, 3)`` come as near to which others ``(m, 2, 3)`` as a distance:
    ``(n, m)``.
    """
    low, high = boxes[:, None, 0] - reach, boxes[:, None, 1] + reach
    meets = (low <= others[None, :, 1]) & (others[None, :, 0] <= high)
    return np.asarray(meets.all(axis=2))
