"""Planes and cylinders fitted to the faces of CAD solids from sampled normals, whatever surface the
file stores (runs in the worker process).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.cad_faces import fit_cylinder
from headstock.meshing.component_mesh import IntArray

SAMPLES = 7  # along each parameter of a face, its bounds included
SAME_NORMAL = 1e-4  # of a plane's normals
FLATNESS = 1e-5  # of a plane, over its extent
ACROSS = 1e-3  # cosine between a cylinder's normals and its axis
ROUNDNESS = 1e-3  # of a cylinder, over its radius
WIDEST_RADIUS = 1e3  # of a cylinder, over the extent of the face: beyond, it is no more than bent
PROBE = 0.02  # how far from a face the outside is looked for [mm]
SAME_SURFACE = 1e-3  # distance of faces of one plane or cylinder of a solid [mm]
PARALLEL = 1e-3  # angle between normals, or axes, that count as parallel


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
    points: FloatArray
    direction: FloatArray
    place: FloatArray
    box: FloatArray
    radius: float = 0.0
    hollow: bool = False


@dataclass(frozen=True, eq=False)
class FittedSolid:
    """The faces of a solid on planes and cylinders; lengths in millimetres.

    Attributes:
        box: Lower and upper corner of its bounding box, ``(2, 3)``.
        labels: Of each face the index of the first one on the same plane or cylinder, ``(n,)``.
    """

    volume: int
    box: FloatArray
    faces: tuple[FittedFace, ...]
    labels: IntArray

    def select(self, label: int, chosen: Collection[int] | None = None) -> tuple[FittedFace, ...]:
        """Return the faces that have a label, of chosen indices or of all."""
        indices = range(len(self.faces)) if chosen is None else sorted(chosen)
        return tuple(self.faces[i] for i in indices if self.labels[i] == label)


def fit_face(volume: int, tag: int, number: int) -> FittedFace | None:
    """Fit a plane or a cylinder to a face of a volume; None where it is neither."""
    low, high = gmsh.model.getParametrizationBounds(2, tag)
    u, v = (np.linspace(start, stop, SAMPLES) for start, stop in zip(low, high, strict=True))
    pairs = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    points = np.array(gmsh.model.getValue(2, tag, pairs.ravel())).reshape(-1, 3)
    normals = np.array(gmsh.model.getNormal(tag, pairs.ravel())).reshape(-1, 3)
    if not np.allclose(np.linalg.norm(normals, axis=1), 1.0):
        return None  # a pole
    inner = sample_inside(tag, 1)
    outwards = 1.0
    if len(inner):
        at = gmsh.model.getParametrization(2, tag, inner[0])
        normal = np.array(gmsh.model.getNormal(tag, at))
        # of a face that two solids share the kernel's normal is that of one of them
        outwards = -1.0 if is_inside(volume, inner[0] + PROBE * normal) else 1.0
    grid = points.reshape(SAMPLES, SAMPLES, 3)
    box = np.array(gmsh.model.occ.getBoundingBox(2, tag)).reshape(2, 3)
    extent = float(np.ptp(points, axis=0).max())
    mean = normals.mean(axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-300)
    middle = points.mean(axis=0)
    if np.abs(normals - mean).max() <= SAME_NORMAL:
        if np.abs((points - middle) @ mean).max() > FLATNESS * extent:
            return None
        return FittedFace(tag, number, grid, outwards * mean, middle, box)
    axis, place, radius = fit_cylinder(points, normals)
    radial = points - place
    radial -= (radial @ axis)[:, None] * axis
    lengths = np.linalg.norm(radial, axis=1)
    round_enough = np.abs(lengths - radius).max() <= ROUNDNESS * radius
    if np.abs(normals @ axis).max() > ACROSS or not round_enough or radius > WIDEST_RADIUS * extent:
        return None
    hollow = outwards * float(np.einsum("ni,ni->", normals, radial)) < 0.0
    return FittedFace(tag, number, grid, axis, place, box, radius, hollow)


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


def label_surfaces(faces: Sequence[FittedFace]) -> IntArray:
    """Return for each face of a solid the index of the first face on the same plane or cylinder."""
    labels = np.arange(len(faces))
    for i, face in enumerate(faces):
        same = (j for j in range(i) if labels[j] == j and _share_surface(face, faces[j]))
        labels[i] = next(same, i)
    return labels


def _share_surface(face: FittedFace, other: FittedFace) -> bool:
    if abs(face.radius - other.radius) > SAME_SURFACE or face.hollow != other.hollow:
        return False
    cosine = float(face.direction @ other.direction)
    offset = face.place - other.place
    if face.radius == 0.0:
        return cosine > 1.0 - PARALLEL**2 / 2 and abs(float(offset @ other.direction)) <= (
            SAME_SURFACE
        )
    across = offset - float(offset @ other.direction) * other.direction
    near = float(np.linalg.norm(across)) <= SAME_SURFACE
    return near and abs(cosine) > 1.0 - PARALLEL**2 / 2


def boxes_meet(boxes: FloatArray, others: FloatArray, reach: float) -> BoolArray:
    """Return which boxes ``(n, 2, 3)`` come as near to which others ``(m, 2, 3)`` as a distance:
    ``(n, m)``.
    """
    low, high = boxes[:, None, 0] - reach, boxes[:, None, 1] + reach
    return np.asarray(
        (low <= others[None, :, 1]).all(axis=2) & (others[None, :, 0] <= high).all(axis=2)
    )
