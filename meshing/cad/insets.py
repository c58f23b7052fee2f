"""Holes, recesses and pads that lie within plane faces of a CAD shape, closed before meshing.

A hole through a wall, a counterbore, a pocket, a keyway or a raised pad meets the rest of the shape in
whole inner loops of plane faces. Without those loops the planes close over it: no Boolean operation, all
other faces stay the same, and a feature's volume is that between its faces and the loops.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.cad.features import GONE, PlainShape, quote_faces
from headstock.meshing.cad.shapes import boundary_faces, face_curves, total_area
from headstock.meshing.component_mesh import LeftOut

LONGEST = 2.0  # times the width allowed: how long a loop, and how wide inside, a feature may be
VOLUME_TOLERANCE = 1e-6  # of the whole volume, to which features must make up the change
LARGEST_CHANGE = 0.05  # of the volume: what changes more is no detail


@dataclass(frozen=True, eq=False)
class _Loop:
    """An inner loop of a plane face.

    Attributes:
        low: Lower corner ``(3,)`` of its bounding box.
        high: Upper corner ``(3,)``.
    """

    plane: int
    curves: tuple[int, ...]
    low: FloatArray
    high: FloatArray

    @property
    def sides(self) -> FloatArray:
        """Sides of its bounding box, the shortest, which is 0 for planes along the axes, first."""
        return np.sort(self.high - self.low)

    @property
    def extent(self) -> float:
        """Diagonal of its bounding box."""
        return float(np.linalg.norm(self.high - self.low))


@dataclass(frozen=True, eq=False)
class _Feature:
    """Faces behind loops.

    Attributes:
        loops: Where they meet the rest.
    """

    faces: frozenset[int]
    loops: tuple[_Loop, ...]

    @property
    def width(self) -> float:
        """Of its widest loop."""
        return max(float(loop.sides[1]) for loop in self.loops)

    @property
    def length(self) -> float:
        """Of its longest loop."""
        return max(float(loop.sides[2]) for loop in self.loops)


def close_planes(
    volume: int,
    *,
    width: float,
    named: Collection[int],
    ends: Collection[tuple[int, float]],
    unit: float,
) -> PlainShape | None:
    """Close plane faces over the features within them that are narrower than a width.

    Args:
        width: Widest features that go.
        named: Numbers of faces that something refers to and that must stay.
        ends: Axis and coordinate of planes in which faces must stay.
        unit: Length of the model's unit [m].

    Returns:
        None where the kernel spoiled the volume: it must be built anew.
    """
    faces = boundary_faces(volume)
    features = _choose_features(faces, width, named, ends)
    if not features:
        return PlainShape(volume, faces, [])
    before = float(gmsh.model.occ.getMass(3, volume))
    try:
        solids = [
            _bound([*sorted(one.faces), *(_plane(loop.curves) for loop in one.loops)])
            for one in features
        ]
        closed = _close(faces, features)
        left = _bound(closed.values())
    except Exception:  # gmsh raises the bare class
        return None
    change = float(gmsh.model.occ.getMass(3, left)) - before
    left_out = _describe_features(features, solids)
    consistent = abs(float(left_out.volumes.sum()) + change) <= VOLUME_TOLERANCE * before
    if not consistent or abs(change) > LARGEST_CHANGE * before:
        return None
    now = _replace_volume(volume, solids, left, [closed.get(face, GONE) for face in faces])
    if set(now) - {GONE} != set(boundary_faces(left)):
        return None
    gone = [number for number, tag in enumerate(now, 1) if tag == GONE]
    return PlainShape(
        left,
        now,
        [_remark(features, gone, faces, width=width * unit, unit=unit, change=change / before)],
        left_out,
    )


def _choose_features(
    faces: Sequence[int], width: float, named: Collection[int], ends: Collection[tuple[int, float]]
) -> list[_Feature]:
    """Return the features that are closed; see ``close_planes``."""
    kept = {faces[number - 1] for number in named if 0 < number <= len(faces)}
    kept |= {face for face in faces if _lies_in(face, ends)}
    features = _find_features(faces, width)
    return [one for one in features if not one.faces & kept and _is_small(one, width)]


def _replace_volume(
    volume: int, solids: Sequence[int], left: int, faces: Sequence[int]
) -> list[int]:
    """Remove what a volume was made of but what is left of it; return the tags of faces now, some of
    which get another one when a volume is made of them: their curves stay.
    """
    occ = gmsh.model.occ
    occ.remove([(3, volume), *((3, solid) for solid in solids)], recursive=False)
    occ.synchronize()
    used = set(boundary_faces(left))
    unchanged = set(faces) & used
    changed = {frozenset(face_curves(face)): face for face in used - unchanged}
    now = [
        face
        if face in unchanged or face == GONE
        else changed.get(frozenset(face_curves(face)), GONE)
        for face in faces
    ]
    occ.remove([entry for entry in occ.getEntities(2) if entry[1] not in used], recursive=True)
    occ.synchronize()
    return now


def _find_features(faces: Sequence[int], width: float) -> list[_Feature]:
    """Find the faces that narrow enough loops part from the largest piece of the shape."""
    around = {face: face_curves(face) for face in faces}
    loops = [loop for face in faces for loop in _inner_loops(face, around[face], width)]
    cuts = {curve: loop for loop in loops for curve in loop.curves}
    pieces = _connect(around, cuts)
    body = max(pieces, key=total_area)
    while any(loop.plane not in body for loop in cuts.values()):
        # a bore in the floor of a counterbore goes with it
        cuts = {curve: loop for curve, loop in cuts.items() if loop.plane in body}
        pieces = _connect(around, cuts)
        body = max(pieces, key=total_area)
    features = []
    for piece in (piece for piece in pieces if piece is not body):
        curves = sorted(set().union(*(around[face] for face in piece)) & cuts.keys())
        loops_of = dict.fromkeys(cuts[curve] for curve in curves)
        features.append(_Feature(frozenset(piece), tuple(loops_of)))
    return features


def _connect(around: dict[int, set[int]], cuts: dict[int, _Loop]) -> list[set[int]]:
    """Return the pieces of a shape, whose faces have curves in common that are no cuts."""
    behind: dict[int, list[int]] = {}
    for face, curves in around.items():
        for curve in curves - cuts.keys():
            behind.setdefault(curve, []).append(face)
    pieces: list[set[int]] = []
    free = set(around)
    while free:
        piece, edge = set[int](), [free.pop()]
        while edge:
            face = edge.pop()
            piece.add(face)
            neighbours = {other for curve in around[face] for other in behind.get(curve, ())} & free
            free -= neighbours
            edge += sorted(neighbours)
        pieces.append(piece)
    return pieces


def _inner_loops(face: int, curves: set[int], width: float) -> list[_Loop]:
    if gmsh.model.getType(2, face) != "Plane":
        return []
    _, curve_loops = gmsh.model.occ.getCurveLoops(face)
    if len(curve_loops) < 2:
        return []
    loops = [_measure_loop(face, tuple(abs(int(tag)) for tag in tags)) for tags in curve_loops]
    outer = max(loops, key=lambda loop: loop.extent)
    return [
        loop
        for loop in loops
        if loop is not outer
        and loop.sides[1] <= width
        and loop.sides[2] <= LONGEST * width
        and curves >= set(loop.curves)
    ]


def _measure_loop(face: int, curves: tuple[int, ...]) -> _Loop:
    boxes = np.array([gmsh.model.occ.getBoundingBox(1, curve) for curve in curves])
    return _Loop(face, curves, boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0))


def _is_small(feature: _Feature, width: float) -> bool:
    """Return whether a feature is no wider inside than at its loops: a cavity behind a small
    opening is no detail.
    """
    boxes = np.array([gmsh.model.occ.getBoundingBox(2, face) for face in feature.faces])
    sides = np.sort(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0))
    return float(sides[1]) <= LONGEST * width


def _lies_in(face: int, ends: Collection[tuple[int, float]]) -> bool:
    if not ends or gmsh.model.getType(2, face) != "Plane":
        return False
    box = gmsh.model.occ.getBoundingBox(2, face)
    middle = [(box[axis] + box[axis + 3]) / 2 for axis in range(3)]
    thin = [box[axis + 3] - box[axis] for axis in range(3)]
    flat = 1e-6 * max(thin)
    return any(
        thin[axis] <= flat + 1e-6 and abs(middle[axis] - end) <= flat + 1e-6 for axis, end in ends
    )


def _plane(*loops: Sequence[int]) -> int:
    occ = gmsh.model.occ
    return int(occ.addPlaneSurface([occ.addCurveLoop(list(curves)) for curves in loops]))


def _bound(faces: Collection[int]) -> int:
    occ = gmsh.model.occ
    return int(occ.addVolume([occ.addSurfaceLoop(list(faces))]))


def _close(faces: Sequence[int], features: Sequence[_Feature]) -> dict[int, int]:
    """Return the faces that stay: tag before to tag now, another one for planes that lost loops."""
    gone = frozenset().union(*(feature.faces for feature in features))
    lost: dict[int, set[tuple[int, ...]]] = {}
    for feature in features:
        for loop in feature.loops:
            lost.setdefault(loop.plane, set()).add(loop.curves)
    replaced = {}
    for face in faces:
        if face in gone:
            continue
        replaced[face] = face
        if face in lost:
            _, loops = gmsh.model.occ.getCurveLoops(face)
            curves = [tuple(abs(int(tag)) for tag in tags) for tags in loops]
            left = [tags for tags in curves if tags not in lost[face]]
            # the outer loop comes first
            left.sort(key=lambda tags: -_measure_loop(face, tags).extent)
            replaced[face] = _plane(*left)
    return replaced


def _describe_features(features: Sequence[_Feature], solids: Sequence[int]) -> LeftOut:
    """Return where features lie and what they hold: before the plane of a loop material, behind it
    none.
    """
    contents = np.array([float(gmsh.model.occ.getMass(3, solid)) for solid in solids])
    centers = np.array([gmsh.model.occ.getCenterOfMass(3, solid) for solid in solids])
    places, sides = np.zeros((len(features), 3, 3)), np.zeros(len(features))
    for row, feature in enumerate(features):
        caps = np.array([(loop.low + loop.high) / 2.0 for loop in feature.loops])
        ends = caps[:2] if len(caps) > 1 else np.array([caps[0], 2.0 * centers[row] - caps[0]])
        places[row] = [ends[0], centers[row], ends[1]]
        plane = feature.loops[0].plane
        low, _ = gmsh.model.getParametrizationBounds(2, plane)
        outward = np.array(gmsh.model.getNormal(plane, list(low)))
        sides[row] = np.sign(outward @ (centers[row] - caps[0]))
    signed = contents * sides
    depths = np.linalg.norm(places[:, 2] - places[:, 0], axis=1)
    widths = np.array([feature.width for feature in features])
    lengths = np.array([feature.length for feature in features])
    # An elliptic hole across a stress takes 1 + 2 a / b times the energy that its volume held
    # (Inglis 1913); what is shallow takes its own, and so does what stands up.
    strengths = np.where(
        signed < 0.0, 1.0 + 2.0 * lengths / widths * np.minimum(depths / widths, 1.0), 1.0
    )
    return LeftOut(places, signed, strengths)


def _remark(
    features: Sequence[_Feature],
    gone: Sequence[int],
    faces: Sequence[int],
    *,
    width: float,
    unit: float,
    change: float,
) -> str:
    largest = max(features, key=lambda feature: feature.width)
    numbers = {face: number for number, face in enumerate(faces, 1)}
    first = min(numbers[face] for face in largest.faces)
    what = (
        "1 hole, recess or pad"
        if len(features) == 1
        else f"{len(features)} holes, recesses and pads"
    )
    return (
        f"{what} of {len(gone)} of {len(faces)} faces{quote_faces(gone)}, up to {1e3 * width:.3g} mm wide"
        f" (face:{first}: {1e3 * largest.width * unit:.3g} mm): left out of the mesh; the volume changes by {change:.1e} (mesh.details)"
    )
