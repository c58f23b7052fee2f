"""Which faces of a CAD part are likely interfaces: where it stands, where it is loaded, its screw holes,
a bore and whatever else is large.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import (
    SAME_PLACE,
    CadFace,
    Hole,
    find_ends,
    find_holes,
    name_faces,
    part_extent,
)

Role = Literal["foot", "tip", "screws", "holes", "bore", "face", "set"]
END_NAMES = {
    "z-": "bottom", "z+": "top", "y-": "right", "y+": "left", "x-": "back", "x+": "front",
}  # fmt: skip
MOST_PATTERNS = 4
SMALLEST_PATTERN = 2
PARALLEL = 1.0 - 1e-6
AS_LARGE = 0.95  # of a footprint: the lower one of two such ends is where a part stands
SMALLEST_END = 0.02  # of the area of the largest flat face
LARGE_FACE = 0.1  # of the largest area
MOST_FACES = 12


@dataclass(frozen=True)
class LikelyInterface:
    """An interface to paste into a scene.

    Attributes:
        name: A name that is unique among those of a part.
        faces: What ``face = ...`` takes, one per patch.
        reason: What was found.
        role: ``foot``: where the part stands; ``tip``: far from it; ``screws``: holes that open into
            the foot.
    """

    name: str
    faces: tuple[str, ...]
    reason: str
    role: Role


@dataclass(frozen=True, eq=False)
class _Flat:
    """Flat faces in one plane: what selects them, area [m^2], that of the rectangle around all of
    them [m^2], centroid and normal ``(3,)``.
    """

    face: str
    parts: tuple[CadFace, ...]
    area: float
    footprint: float
    center: FloatArray
    normal: FloatArray

    @property
    def name(self) -> str:
        return END_NAMES.get(self.face, self.face.replace(":", "_"))


def likely_interfaces(faces: Sequence[CadFace]) -> list[LikelyInterface]:
    """Return likely interfaces, the foot and the tip first where there are two flat faces."""
    names, extent = name_faces(faces), part_extent(faces)
    foot, tip = _choose_ends(faces, names)
    patterns = _hole_patterns(find_holes(faces), extent)
    roles: tuple[tuple[Role, _Flat | None], ...] = (("foot", foot), ("tip", tip))
    ends = [(role, flat) for role, flat in roles if flat is not None]
    taken = {part.number for _, flat in ends for part in flat.parts}
    taken |= {face for pattern in patterns for hole in pattern for face in hole.faces}
    return [
        *(
            LikelyInterface(flat.name, (flat.face,), _describe(flat.parts), role)
            for role, flat in ends
        ),
        *_hole_interfaces(patterns, foot, extent, names),
        *_large_faces(faces, names, taken),
    ]


def _hole_interfaces(
    patterns: list[list[Hole]], foot: _Flat | None, extent: float, names: dict[int, str]
) -> Iterator[LikelyInterface]:
    """Yield patterns of holes, those that open into the foot first, and the widest single hole."""
    several = [pattern for pattern in patterns if len(pattern) >= SMALLEST_PATTERN]
    screws = next(
        (one for one in several if foot is not None and _opens_into(foot, one[0], extent)), None
    )
    others = [pattern for pattern in several if pattern is not screws][:MOST_PATTERNS]
    chosen: list[tuple[str, Role, list[Hole]]] = [
        (f"holes_{number}", "holes", pattern) for number, pattern in enumerate(others, 1)
    ]
    if screws is not None:
        chosen.insert(0, ("screws", "screws", screws))
    for name, role, holes in chosen:
        walls = tuple(names[face] for hole in holes for face in hole.faces)
        yield LikelyInterface(
            name, walls, f"{len(holes)} holes of {2e3 * holes[0].radius:.4g} mm", role
        )
    single = [pattern[0] for pattern in patterns if len(pattern) == 1]
    if single:
        bore = max(single, key=lambda hole: hole.radius)
        walls = tuple(names[face] for face in bore.faces)
        reason = f"hole of {2e3 * bore.radius:.4g} mm at {_in_mm(bore.place)} mm"
        yield LikelyInterface("bore", walls, reason, "bore")


def _choose_ends(
    faces: Sequence[CadFace], names: dict[int, str]
) -> tuple[_Flat | None, _Flat | None]:
    """Return where a part stands, the end of the largest footprint, and the flat face that is
    farthest from that plane; None where there are no two. A casting stands on the rim of its open
    side.
    """
    ends = [_join(name, parts) for name, parts in find_ends(faces).items()]
    # a part that is drawn askew has no ends
    flats = (
        ends
        if len(ends) > 1
        else [_join(names[face.number], (face,)) for face in faces if face.kind == "plane"]
    )
    if len(flats) < 2:
        return None, None
    least = SMALLEST_END * max(flat.area for flat in flats)
    large = [flat for flat in flats if flat.area >= least]
    widest = max(flat.footprint for flat in large)
    order = list(END_NAMES)
    foot = min(
        (flat for flat in large if flat.footprint >= AS_LARGE * widest),
        key=lambda flat: order.index(flat.face) if flat.face in order else len(order),
    )
    tip = max(
        (flat for flat in large if flat is not foot),
        key=lambda flat: (round(_height(foot, flat.center), 6), flat.area),
        default=None,
    )
    return (None, None) if tip is None else (foot, tip)


def _join(face: str, parts: tuple[CadFace, ...]) -> _Flat:
    areas = np.array([part.area for part in parts])
    centers = np.array([part.center for part in parts])
    center: FloatArray = areas @ centers / areas.sum()
    normal = np.array(parts[0].normal)
    askew = np.abs(normal).max() < PARALLEL
    footprint = areas.sum() if askew else np.sort(_sides(parts))[1:].prod()
    return _Flat(face, parts, float(areas.sum()), float(footprint), center, normal)


def _sides(parts: Sequence[CadFace]) -> FloatArray:
    """Return the sides of the box around faces ``(3,)`` [m]."""
    high = np.max([part.high for part in parts], axis=0)
    return high - np.min([part.low for part in parts], axis=0)


def _height(foot: _Flat, point: FloatArray) -> float:
    return abs(float((point - foot.center) @ foot.normal))


def _opens_into(foot: _Flat, hole: Hole, extent: float) -> bool:
    """Return whether a hole ends in a face, or in a countersink there."""
    if abs(float(np.array(hole.axis) @ foot.normal)) < PARALLEL:
        return False
    center = np.array(hole.place)
    low = np.min([part.low for part in foot.parts], axis=0) - SAME_PLACE * extent
    high = np.max([part.high for part in foot.parts], axis=0) + SAME_PLACE * extent
    in_face = np.abs(foot.normal) < 0.5  # directions in the face
    inside = ((center >= low) & (center <= high))[in_face].all()
    return bool(inside) and _height(foot, center) <= 0.5 * hole.depth + 2.0 * hole.radius


def _large_faces(
    faces: Sequence[CadFace], names: dict[int, str], taken: set[int]
) -> list[LikelyInterface]:
    """Return the faces of every kind that are not taken, the largest first."""
    least = LARGE_FACE * max((face.area for face in faces), default=0.0)
    left = sorted(
        (face for face in faces if face.number not in taken and face.area >= least),
        key=lambda face: -face.area,
    )
    likely = []
    for face in left[:MOST_FACES]:
        name = names[face.number]
        likely.append(
            LikelyInterface(
                END_NAMES.get(name, name.replace(":", "_")), (name,), _describe((face,)), "face"
            )
        )
    return likely


def _describe(parts: tuple[CadFace, ...]) -> str:
    """Return the kind, area, size and position of faces."""
    whole = _join("", parts)
    kind = parts[0].kind if len(parts) == 1 else f"{len(parts)} {parts[0].kind}s"
    size = _sides(parts)
    sides = " × ".join(f"{1e3 * side:.4g}" for side in size if side > SAME_PLACE * size.max())
    return f"{kind}, {1e4 * whole.area:.4g} cm^2: {sides} mm at {_in_mm(whole.center)} mm"


def _in_mm(point: Sequence[float] | FloatArray) -> str:
    return f"({', '.join(f'{round(1e3 * float(value), 1) + 0.0:g}' for value in point)})"


def _hole_patterns(holes: Sequence[Hole], extent: float) -> list[list[Hole]]:
    """Return the holes of one radius, with parallel axes and at one height along them; patterns of
    many holes first.
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
