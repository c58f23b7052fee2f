"""The faces of a CAD part: ends, holes and names."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.patches import FACE_DIRECTIONS

FaceKind = Literal["plane", "cylinder", "cone", "sphere", "torus", "freeform"]
Vector = tuple[float, float, float]
SAME_PLACE = 1e-4
SAME_DIRECTION = 1e-6
WHOLE_SHARE = (
    0.7  # of a cylinder's area: crossing holes take some off, and half a turn is the end of a slot
)


@dataclass(frozen=True)
class CadFace:
    """One face of a CAD part, in the component frame.

    Attributes:
        number: What ``face:N`` counts, from 1.
        area: [m^2].
        center: Centroid [m].
        normal: Outward unit normal: of a plane everywhere, of a curved face where its largest facet
            lies.
        low: Lower corner of its bounding box [m].
        high: Upper corner of its bounding box [m].
        radius: Of a cylinder or sphere [m]; 0 otherwise.
        axis: Unit direction of a cylinder's axis; zero otherwise.
        axis_point: A point of that axis [m].
        span: Lowest and highest place along the axis, measured from the origin [m].
        hollow: The material lies outside the cylinder: a hole or an inner fillet.
    """

    number: int
    kind: FaceKind
    area: float
    center: Vector
    normal: Vector
    low: Vector
    high: Vector
    radius: float = 0.0
    axis: Vector = (0.0, 0.0, 0.0)
    axis_point: Vector = (0.0, 0.0, 0.0)
    span: tuple[float, float] = (0.0, 0.0)
    hollow: bool = False

    @property
    def size(self) -> Vector:
        """Sides of its bounding box [m]."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z


@dataclass(frozen=True)
class Hole:
    """A full round hole, of one or several faces.

    Attributes:
        radius: [m].
        place: The middle of its axis [m].
        depth: Length along the axis [m].
    """

    faces: tuple[int, ...]
    radius: float
    axis: Vector
    place: Vector
    depth: float


class FittedCylinder(NamedTuple):
    """Unit axis ``(3,)`` of a cylinder, a point on it ``(3,)`` [m] and the radius [m]."""

    axis: FloatArray
    place: FloatArray
    radius: float


def fit_cylinder(points: FloatArray, normals: FloatArray) -> FittedCylinder:
    """Return the cylinder through points ``(n, 3)`` [m] with facet normals ``(m, 3)``."""
    axis = np.linalg.svd(normals)[2][2]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    middle = points.mean(axis=0)
    across = np.linalg.svd(axis[None, :])[2][1:]
    center, radius = fit_circle((points - middle) @ across.T)
    return FittedCylinder(axis, middle + center @ across, radius)


def fit_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Return centre ``(2,)`` and radius of the circle through points ``(n, 2)``, by least squares.

    Source: Kasa (1976): ``|p|^2 = 2 c.p + r^2 - |c|^2``.
    """
    middle = points.mean(axis=0)
    arms = points - middle
    rows = np.column_stack([2 * arms, np.ones(len(arms))])
    solution = np.linalg.lstsq(rows, (arms**2).sum(axis=1), rcond=None)[0]
    center = solution[:2]
    return middle + center, float(np.sqrt(solution[2] + center @ center))


def find_holes(faces: Sequence[CadFace]) -> list[Hole]:
    """Find the full round holes: cylinders that share axis, radius and span, in the order of their
    faces.
    """
    extent = part_extent(faces)
    left = [face for face in faces if face.kind == "cylinder" and face.hollow]
    holes: list[Hole] = []
    while left:
        mates = [face for face in left if _share_cylinder(left[0], face, extent)]
        left = [face for face in left if face not in mates]
        low, high = min(face.span[0] for face in mates), max(face.span[1] for face in mates)
        radius = mates[0].radius
        axis = np.array(mates[0].axis)
        point = np.array(mates[0].axis_point)
        if sum(face.area for face in mates) < WHOLE_SHARE * 2.0 * np.pi * radius * (high - low):
            continue
        x, y, z = point + ((low + high) / 2 - point @ axis) * axis
        holes.append(
            Hole(
                tuple(face.number for face in mates),
                radius,
                mates[0].axis,
                (float(x), float(y), float(z)),
                high - low,
            )
        )
    return holes


def find_ends(faces: Sequence[CadFace]) -> dict[str, tuple[CadFace, ...]]:
    """Find the flat faces in the planes at the ends of a part, by the name that selects them:
    ``z-``.
    """
    extent = part_extent(faces)
    ends: dict[str, tuple[CadFace, ...]] = {}
    for name, (axis, sign) in FACE_DIRECTIONS.items():
        end = max(sign * (face.high if sign > 0.0 else face.low)[axis] for face in faces)
        chosen = tuple(
            face
            for face in faces
            if face.kind == "plane"
            and abs(face.normal[axis]) > 1.0 - SAME_DIRECTION
            and abs(sign * face.center[axis] - end) <= SAME_PLACE * extent
        )
        if chosen:
            ends[name] = chosen
    return ends


def name_faces(faces: Sequence[CadFace]) -> dict[int, str]:
    """Return a name for each face by number: ``z-`` and the like where that selects this face
    alone, else ``face:N``.
    """
    alone = {
        chosen[0].number: name for name, chosen in find_ends(faces).items() if len(chosen) == 1
    }
    return {face.number: alone.get(face.number, f"face:{face.number}") for face in faces}


def part_extent(faces: Sequence[CadFace]) -> float:
    """Return the longest side of the bounding box [m]."""
    return max(
        max(face.high[i] for face in faces) - min(face.low[i] for face in faces) for i in range(3)
    )


def _share_cylinder(first: CadFace, second: CadFace, extent: float) -> bool:
    axis = np.array(first.axis)
    apart = np.array(second.axis_point) - np.array(first.axis_point)
    tolerance = SAME_PLACE * extent
    return (
        abs(first.radius - second.radius) <= tolerance
        and abs(axis @ np.array(second.axis)) > 1.0 - SAME_DIRECTION
        and float(np.linalg.norm(apart - (apart @ axis) * axis)) <= tolerance
        and min(first.span[1], second.span[1]) - max(first.span[0], second.span[0]) > -tolerance
    )
