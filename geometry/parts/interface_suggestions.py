"""Which faces of a CAD part are likely interfaces: its largest opposing planes, patterns of holes, its widest bore."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.parts.cad_faces import SAME_PLACE, CadFace, Hole, find_holes, name_faces, part_extent

DIRECTION_NAMES = {(0, 1): "front", (0, -1): "back", (1, 1): "left", (1, -1): "right", (2, 1): "top", (2, -1): "bottom"}
CANDIDATES = 24
MOST_PATTERNS = 4
SMALLEST_PATTERN = 2
PARALLEL = 1.0 - 1e-6


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
        name = DIRECTION_NAMES[axis, int(np.sign(face.normal[axis]))] if upright else f"face_{face.number}"
        found[name] = SuggestedInterface(name, (names[face.number],), f"plane, {face.area * 1e4:.4g} cm^2")
    patterns = _hole_patterns(find_holes(faces), part_extent(faces))
    for number, holes in enumerate([pattern for pattern in patterns if len(pattern) >= SMALLEST_PATTERN][:MOST_PATTERNS], 1):
        chosen = tuple(names[face] for hole in holes for face in hole.faces)
        reason = f"{len(holes)} holes of {2e3 * holes[0].radius:.4g} mm"
        found[f"holes_{number}"] = SuggestedInterface(f"holes_{number}", chosen, reason)
    single = max((pattern[0] for pattern in patterns if len(pattern) == 1), key=lambda hole: hole.radius, default=None)
    if single is not None:
        chosen = tuple(names[face] for face in single.faces)
        found["bore"] = SuggestedInterface("bore", chosen, f"hole of {2e3 * single.radius:.4g} mm")
    return list(found.values())


def _opposing_planes(faces: Sequence[CadFace]) -> tuple[CadFace, ...]:
    """The two planes that look away from each other with most between them: smaller area times distance."""
    planes = sorted((face for face in faces if face.kind == "plane"), key=lambda face: -face.area)[:CANDIDATES]
    best: tuple[float, tuple[CadFace, ...]] = (0.0, ())
    for index, first in enumerate(planes):
        for second in planes[index + 1 :]:
            normal = np.array(second.normal)
            apart = float((np.array(second.center) - np.array(first.center)) @ normal)
            if normal @ np.array(first.normal) < -PARALLEL and min(first.area, second.area) * apart > best[0]:
                best = (min(first.area, second.area) * apart, (first, second))
    return best[1]


def _hole_patterns(holes: Sequence[Hole], extent: float) -> list[list[Hole]]:
    """Holes of one radius, with parallel axes and at one height along them; patterns of many holes first."""
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
