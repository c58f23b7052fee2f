"""Fillets, holes and pins with small radii taken off a CAD shape, as a mesh without them has it."""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.cad.sizes import face_radius
from headstock.meshing.cad.slivers import list_faces

LARGEST_CHANGE = 0.1  # of the volume: what takes more off was no detail
LARGEST_SHARE = 0.9  # of the faces, likewise
GONE = -1
SAME, NEAR = 1e-6, 0.3  # of the size of a face: where and how large one may be to be known again


@dataclass(frozen=True, eq=False)
class PlainShape:
    """A shape without its small features.

    Attributes:
        volume: Tag of what is left.
        faces: Tags of its faces in the order in which ``face:N`` counts those of the whole shape,
            ``GONE`` where one is no more; then those that are new.
        remarks: What to tell the user.
    """

    volume: int
    faces: list[int]
    remarks: list[str]


@dataclass(frozen=True, eq=False)
class _Face:
    """What a face is known by when its tag has changed."""

    kind: str
    radius: float
    area: float
    center: FloatArray


def leave_out_features(
    volume: int,
    rebuild: Callable[[], int],
    list_boundary: Callable[[int], list[int]],
    *,
    radius: float,
    named: Collection[int],
    unit: float,
) -> PlainShape:
    """Take off features that consist of faces with small radii and of what those surround.

    A feature that the CAD kernel cannot close is left as it is; so are all where a face that
    something refers to would not be known again.

    Args:
        volume: Tag.
        rebuild: Builds the volume anew, after the kernel spoiled it, and returns its tag.
        list_boundary: Tags of the faces of a volume, in the order in which ``face:N`` counts them.
        radius: Largest radius that goes, in the unit of the model.
        named: Numbers of faces that something refers to and that must stay.
        unit: Length of the model's unit [m].
    """
    faces = list_boundary(volume)
    before = [_know_face(face) for face in faces]
    whole = float(gmsh.model.occ.getMass(3, volume))
    kept = {faces[number - 1] for number in named if 0 < number <= len(faces)}
    features = [group for group in _find_features(faces, radius) if not group & kept]
    refused = 0
    while features:
        gone = set().union(*features)
        left = _take_off(volume, gone) if len(gone) <= LARGEST_SHARE * len(faces) else None
        if left is not None and _is_sound(left, whole):
            now = _follow_faces(before, list_boundary(left))
            if all(now[number - 1] != GONE for number in named if 0 < number <= len(faces)):
                change = _volume_share(left, whole) - 1.0
                remark = _describe(gone, faces, radius * unit, change, refused)
                return PlainShape(left, now, [remark])
            break
        # which of them it is nobody says: each by itself, on a shape built anew
        good: list[set[int]] = []
        for feature in features:
            left = _take_off(rebuild(), feature)
            good += [feature] if left is not None and _is_sound(left, whole) else []
        volume = rebuild()
        if len(good) == len(features):
            break  # they go one by one, not together
        refused += len(features) - len(good)
        features = good
    volume = rebuild()
    what = f"with a radius up to {1e3 * radius * unit:.4g} mm"
    return PlainShape(
        volume,
        list_boundary(volume),
        [f"no fillet, hole or pin {what} could be left out (mesh.leave_out)"],
    )


def _know_face(face: int) -> _Face:
    return _Face(
        str(gmsh.model.getType(2, face)),
        face_radius(face),
        float(gmsh.model.occ.getMass(2, face)),
        np.array(gmsh.model.occ.getCenterOfMass(2, face)),
    )


def _follow_faces(before: Sequence[_Face], now: Sequence[int]) -> list[int]:
    """New tags in the old order: faces that stayed as they were, then those that only grew or
    shrank; the rest at the end.
    """
    left = {tag: _know_face(tag) for tag in now}
    found: dict[int, int] = {}
    for fits in (_is_same, _is_changed):
        for number, face in enumerate(before):
            if number in found:
                continue
            candidates = [tag for tag, other in left.items() if fits(face, other)]
            if len(candidates) == 1:
                found[number] = candidates[0]
                del left[candidates[0]]
    return [*(found.get(number, GONE) for number in range(len(before))), *left]


def _is_same(face: _Face, other: _Face) -> bool:
    size = np.sqrt(face.area)
    return (
        face.kind == other.kind
        and abs(other.area / face.area - 1.0) <= SAME
        and float(np.linalg.norm(face.center - other.center)) <= SAME * size
    )


def _is_changed(face: _Face, other: _Face) -> bool:
    """Of the same kind and radius, and about where it was."""
    size = np.sqrt(face.area)
    radii = face.radius == other.radius or abs(other.radius / face.radius - 1.0) <= SAME
    return (
        face.kind == other.kind
        and radii
        and 0.5 <= other.area / face.area <= 2.0
        and float(np.linalg.norm(face.center - other.center)) <= NEAR * size
    )


def _find_features(faces: Sequence[int], radius: float) -> list[set[int]]:
    """Faces with radii up to a radius, and those that they alone surround, in connected groups."""
    small = {face for face in faces if face_radius(face) <= radius * (1.0 + 1e-6)}
    around = {
        face: {abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False)}
        for face in faces
    }
    edges = set().union(*(around[face] for face in small))
    inside = {face for face in faces if around[face] and around[face] <= edges}
    groups: list[set[int]] = []
    for face in sorted(small | inside):
        touching = [
            group for group in groups if any(around[face] & around[other] for other in group)
        ]
        for group in touching:
            groups.remove(group)
        groups.append({face}.union(*touching))
    return groups


def _take_off(volume: int, feature: Iterable[int]) -> int | None:
    """The volume without some of its faces; None where the kernel cannot close it."""
    try:
        found = gmsh.model.occ.defeature([volume], sorted(feature))
        gmsh.model.occ.synchronize()
    except Exception:  # gmsh raises the bare class
        return None
    left = [tag for dim, tag in found if dim == 3]
    return left[0] if len(left) == 1 else None


def _is_sound(volume: int, whole: float) -> bool:
    return abs(_volume_share(volume, whole) - 1.0) <= LARGEST_CHANGE


def _volume_share(volume: int, whole: float) -> float:
    share = float(gmsh.model.occ.getMass(3, volume)) / whole
    return share if np.isfinite(share) else 0.0


def _describe(
    gone: Collection[int], faces: Sequence[int], radius: float, change: float, refused: int
) -> str:
    numbers = [number for number, face in enumerate(faces, 1) if face in gone]
    stay = f"; {refused} more could not be taken off" if refused else ""
    return (
        f"{len(gone)} of {len(faces)} faces{list_faces(numbers)}, of fillets, holes and pins with radii up to {1e3 * radius:.4g} mm,"
        f" are left out of the mesh; the volume changes by {change:.1e}{stay} (mesh.leave_out)"
    )
