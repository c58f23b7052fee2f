"""The faces of a CAD part: ends, holes and names, and which of them are likely interfaces."""

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
DIRECTION_NAMES = {
    (0, 1): "front",
    (0, -1): "back",
    (1, 1): "left",
    (1, -1): "right",
    (2, 1): "top",
    (2, -1): "bottom",
}
CANDIDATES = 24
MOST_PATTERNS = 4
SMALLEST_PATTERN = 2
PARALLEL = 1.0 - 1e-6


@dataclass(frozen=True)
class CadFace:
    """One face of a CAD part, in the component frame.

    Attributes:
        number: What ``face:N`` counts, from 1.
        kind: Kind of surface.
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
        faces: Their numbers.
        radius: [m].
        axis: Unit direction.
        place: The middle of its axis [m].
    """

    faces: tuple[int, ...]
    radius: float
    axis: Vector
    place: Vector


class FittedCylinder(NamedTuple):
    """Unit axis ``(3,)`` of a cylinder, a point on it ``(3,)`` [m] and the radius [m]."""

    axis: FloatArray
    place: FloatArray
    radius: float


def fit_cylinder(points: FloatArray, normals: FloatArray) -> FittedCylinder:
    """The cylinder through points ``(n, 3)`` [m] with facet normals ``(m, 3)``."""
    axis = np.linalg.svd(normals)[2][2]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    middle = points.mean(axis=0)
    across = np.linalg.svd(axis[None, :])[2][1:]
    flat = (points - middle) @ across.T
    # circle through points, by least squares (Kasa 1976): |p|^2 = 2 c.p + r^2 - |c|^2
    solution = np.linalg.lstsq(
        np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None
    )[0]
    center = solution[:2]
    return FittedCylinder(
        axis, middle + center @ across, float(np.sqrt(solution[2] + center @ center))
    )


def find_holes(faces: Sequence[CadFace]) -> list[Hole]:
    """Full round holes: cylinders that share axis, radius and span, in the order of their faces."""
    extent = part_extent(faces)
    left = [face for face in faces if face.kind == "cylinder" and face.hollow]
    holes: list[Hole] = []
    while left:
        mates = [face for face in left if _share_cylinder(left[0], face, extent)]
        left = [face for face in left if face not in mates]
        low, high = min(face.span[0] for face in mates), max(face.span[1] for face in mates)
        radius, axis, point = (
            mates[0].radius,
            np.array(mates[0].axis),
            np.array(mates[0].axis_point),
        )
        if sum(face.area for face in mates) < WHOLE_SHARE * 2.0 * np.pi * radius * (high - low):
            continue
        x, y, z = point + ((low + high) / 2 - point @ axis) * axis
        holes.append(
            Hole(
                tuple(face.number for face in mates),
                radius,
                mates[0].axis,
                (float(x), float(y), float(z)),
            )
        )
    return holes


def name_faces(faces: Sequence[CadFace]) -> dict[int, str]:
    """A name for each face by number: ``z-`` and the like where that selects this face alone, else
    ``face:N``.
    """
    extent = part_extent(faces)
    names = {face.number: f"face:{face.number}" for face in faces}
    for name, (axis, sign) in FACE_DIRECTIONS.items():
        end = max(sign * (face.high if sign > 0.0 else face.low)[axis] for face in faces)
        chosen = [
            face
            for face in faces
            if face.kind == "plane"
            and abs(face.normal[axis]) > 1.0 - SAME_DIRECTION
            and abs(sign * face.center[axis] - end) <= SAME_PLACE * extent
        ]
        if len(chosen) == 1:
            names[chosen[0].number] = name
    return names


def part_extent(faces: Sequence[CadFace]) -> float:
    """Longest side of the bounding box [m]."""
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


@dataclass(frozen=True)
class SuggestedInterface:
    """An interface to paste into a scene.

    Attributes:
        name: A name that is unique among the suggestions.
        faces: What ``face = ...`` takes, one per patch.
        reason: What was found.
    """

    name: str
    faces: tuple[str, ...]
    reason: str


def suggest_interfaces(faces: Sequence[CadFace]) -> list[SuggestedInterface]:
    """Interfaces worth a look; empty where a part has neither opposing planes nor holes."""
    names = name_faces(faces)
    found: dict[str, SuggestedInterface] = {}
    for face in _opposing_planes(faces):
        axis = int(np.argmax(np.abs(face.normal)))
        upright = abs(face.normal[axis]) > PARALLEL
        name = (
            DIRECTION_NAMES[axis, int(np.sign(face.normal[axis]))]
            if upright
            else f"face_{face.number}"
        )
        found[name] = SuggestedInterface(
            name, (names[face.number],), f"plane, {face.area * 1e4:.4g} cm^2"
        )
    patterns = _hole_patterns(find_holes(faces), part_extent(faces))
    for number, holes in enumerate(
        [pattern for pattern in patterns if len(pattern) >= SMALLEST_PATTERN][:MOST_PATTERNS], 1
    ):
        chosen = tuple(names[face] for hole in holes for face in hole.faces)
        reason = f"{len(holes)} holes of {2e3 * holes[0].radius:.4g} mm"
        found[f"holes_{number}"] = SuggestedInterface(f"holes_{number}", chosen, reason)
    single = max(
        (pattern[0] for pattern in patterns if len(pattern) == 1),
        key=lambda hole: hole.radius,
        default=None,
    )
    if single is not None:
        chosen = tuple(names[face] for face in single.faces)
        found["bore"] = SuggestedInterface("bore", chosen, f"hole of {2e3 * single.radius:.4g} mm")
    return list(found.values())


def _opposing_planes(faces: Sequence[CadFace]) -> tuple[CadFace, ...]:
    """The two planes that look away from each other with most between them: smaller area times
    distance.
    """
    planes = sorted((face for face in faces if face.kind == "plane"), key=lambda face: -face.area)[
        :CANDIDATES
    ]
    best: tuple[float, tuple[CadFace, ...]] = (0.0, ())
    for index, first in enumerate(planes):
        for second in planes[index + 1 :]:
            normal = np.array(second.normal)
            apart = float((np.array(second.center) - np.array(first.center)) @ normal)
            if (
                normal @ np.array(first.normal) < -PARALLEL
                and min(first.area, second.area) * apart > best[0]
            ):
                best = (min(first.area, second.area) * apart, (first, second))
    return best[1]


def _hole_patterns(holes: Sequence[Hole], extent: float) -> list[list[Hole]]:
    """Holes of one radius, with parallel axes and at one height along them; patterns of many holes
    first.
    """
    patterns: list[list[Hole]] = []
    for hole in holes:
        for pattern in patterns:
            if _match(pattern[0], hole, SAME_PLACE * extent):
                pattern.append(hole)
                break
        else:
            patterns.append([hole])
    return sorted(patterns, key=len, reverse=True)


def _match(first: Hole, second: Hole, tolerance: float) -> bool:
    axis = np.array(first.axis)
    apart = np.array(second.place) - np.array(first.place)
    return (
        abs(first.radius - second.radius) <= tolerance
        and abs(axis @ np.array(second.axis)) > PARALLEL
        and abs(float(axis @ apart)) <= tolerance
    )
