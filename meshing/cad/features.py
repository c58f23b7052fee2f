"""Small features of a CAD shape taken off before meshing: faces so narrow that no element fits them,
and fillets, holes and pins with small radii.

The kernel, changing a shape, gives its faces new tags: they are recognised by what they are like.
"""

import dataclasses
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.cad.shapes import boundary_faces, face_curves
from headstock.meshing.component_mesh import LeftOut
from headstock.meshing.errors import MeshError

GONE = -1
SPOTS = (0.2, 0.5, 0.8)  # shares of both parameter ranges at which curvature is measured
SAME, NEAR = 1e-6, 0.3  # of the size of a face: where and how large one may be to be known again
# an element on a narrower face would have a scaled Jacobian below the floor of the mesh checks
NARROWEST = 1e-3
NAMED_FACES = 5
NARROW_CHANGE = 5e-4  # of the volume; meshes may be off by twice that
LARGEST_CHANGE = 0.1  # of the volume: what takes more off was no detail
LARGEST_SHARE = 0.9  # of the faces, likewise


@dataclass(frozen=True, eq=False)
class PlainShape:
    """A shape without its small features.

    Attributes:
        volume: Tag of what is left.
        faces: Tags of its faces in the order in which ``face:N`` counts those of the whole shape,
            ``GONE`` where one is no more; then those that are new.
        left_out: The features, where the kernel measures their volumes.
    """

    volume: int
    faces: list[int]
    remarks: list[str]
    left_out: LeftOut | None = None

    @property
    def numbers(self) -> dict[int, int]:
        """Return what ``face:N`` counts, by tag, of the faces that are left of the whole shape."""
        return {tag: number for number, tag in enumerate(self.faces, 1) if tag != GONE}

    def followed(self, volume: int, now: Sequence[int]) -> "PlainShape":
        """Return the shape after a further change.

        Args:
            volume: Tag of what is left.
            now: New tags of ``numbers`` in their order, then of faces that are new.
        """
        new = dict(zip(self.numbers, now, strict=False))
        faces = [new.get(tag, GONE) for tag in self.faces]
        return dataclasses.replace(self, volume=volume, faces=faces + list(now[len(new) :]))

    def keeps(self, named: Collection[int], count: int) -> bool:
        """Return whether faces are still there.

        Args:
            named: Numbers that ``face:N`` has for them.
            count: Number of faces that such numbers count.
        """
        return all(self.faces[number - 1] != GONE for number in named if 0 < number <= count)


@dataclass(frozen=True, eq=False)
class _Face:
    """Features by which a face is recognised when its tag has changed."""

    kind: str
    radius: float
    area: float
    center: FloatArray


def face_radius(face: int) -> float:
    """Return the smallest radius of curvature of a face where it is measured; inf for planes."""
    if gmsh.model.getType(2, face) == "Plane":
        return float("inf")
    low, high = gmsh.model.getParametrizationBounds(2, face)
    spots = np.array(
        [
            [low[0] + a * (high[0] - low[0]), low[1] + b * (high[1] - low[1])]
            for a in SPOTS
            for b in SPOTS
        ]
    )
    largest, smallest, _, _ = gmsh.model.getPrincipalCurvatures(face, spots.ravel())
    return radius_of(float(np.nanmax(np.abs([largest, smallest]))))


def radius_of(curvature: float) -> float:
    """Return the radius of a curvature; inf where there is none."""
    return 1.0 / curvature if curvature > 0.0 and np.isfinite(curvature) else float("inf")


def _know_face(face: int) -> _Face:
    """Return what the face with a tag of the open gmsh model is known by."""
    return _Face(
        str(gmsh.model.getType(2, face)),
        face_radius(face),
        float(gmsh.model.occ.getMass(2, face)),
        np.array(gmsh.model.occ.getCenterOfMass(2, face)),
    )


def _follow_faces(before: Sequence[_Face], now: Sequence[int]) -> list[int]:
    """Return the new tags in the old order: faces that stayed as they were, then those that only
    grew or shrank; the rest at the end.
    """
    left = {tag: _know_face(tag) for tag in now}
    matches: dict[int, int] = {}
    for fits in (_is_same, _is_changed):
        for number, face in enumerate(before):
            if number in matches:
                continue
            candidates = [tag for tag, other in left.items() if fits(face, other)]
            if len(candidates) == 1:
                matches[number] = candidates[0]
                del left[candidates[0]]
    return [*(matches.get(number, GONE) for number in range(len(before))), *left]


def _is_same(face: _Face, other: _Face) -> bool:
    size = np.sqrt(face.area)
    return (
        face.kind == other.kind
        and abs(other.area / face.area - 1.0) <= SAME
        and float(np.linalg.norm(face.center - other.center)) <= SAME * size
    )


def _is_changed(face: _Face, other: _Face) -> bool:
    """Return whether a face is of the same kind and radius, and about where it was."""
    size = np.sqrt(face.area)
    radii = face.radius == other.radius or abs(other.radius / face.radius - 1.0) <= SAME
    return (
        face.kind == other.kind
        and radii
        and 0.5 <= other.area / face.area <= 2.0
        and float(np.linalg.norm(face.center - other.center)) <= NEAR * size
    )


@dataclass(frozen=True)
class _Sliver:
    """A face: what ``face:N`` calls it, and its width and length in the model's unit."""

    number: int
    width: float
    length: float


def remove_narrow_features(
    shape: PlainShape,
    *,
    width: float,
    named: Collection[int],
    unit: float,
) -> PlainShape | None:
    """Take features that consist of faces narrower than a width off a volume, such as steps that a
    tool has left.

    Args:
        shape: With its faces as ``face:N`` counts them.
        width: Narrower faces go, and those that they alone surround.
        named: Numbers of faces that something refers to and that must stay.
        unit: Length of the model's unit [m].

    Returns:
        None where the CAD kernel spoiled the volume, or a named face was not known again: the
        volume must be built anew.
    """
    numbers = shape.numbers
    faces = list(numbers)
    narrow = {faces[face.number - 1] for face in _measure_faces(faces) if face.width < width}
    if not narrow:
        return shape
    feature = _surround(faces, narrow)
    gone = sorted(numbers[face] for face in feature)
    if len(feature) > len(faces) / 2 or set(gone) & set(named):
        return shape
    faces_before = [_know_face(face) for face in faces]
    before = float(gmsh.model.occ.getMass(3, shape.volume))
    left = _take_off(shape.volume, feature)
    change = np.inf if left is None else float(gmsh.model.occ.getMass(3, left)) / before - 1.0
    if left is None or not abs(change) <= NARROW_CHANGE:
        return None
    now = shape.followed(left, _follow_faces(faces_before, boundary_faces(left)))
    if not now.keeps(named, len(shape.faces)):
        return None
    what = f"{len(gone)} of {len(shape.faces)} faces{quote_faces(gone)}, narrower than {width * unit:.2g} m or surrounded by such faces"
    remark = f"{what}, are left out of the mesh; the volume changes by {change:.1e} (mesh.smallest)"
    return dataclasses.replace(now, remarks=[*shape.remarks, remark])


def quote_faces(numbers: Sequence[int]) -> str:
    """Return the first few faces in brackets, as ``show`` numbers them; nothing for none."""
    if not numbers:
        return ""
    named = ", ".join(f"face:{number}" for number in sorted(numbers)[:NAMED_FACES])
    return f" ({named}{', …' if len(numbers) > NAMED_FACES else ''})"


def refuse_slivers(
    faces: Sequence[int], *, left: Collection[int], size: float, unit: float
) -> None:
    """Refuse a shape with slivers.

    Args:
        left: Tags of those that the shape to be meshed still has.
        size: Of elements, in the unit of the model.
        unit: Of the model's lengths [m].

    Raises:
        MeshError: Names the faces, their width and their length.
    """
    numbers = [number for number, face in enumerate(faces, 1) if face in left]
    measured = _measure_faces([faces[number - 1] for number in numbers])
    slivers = sorted(
        (
            dataclasses.replace(one, number=numbers[one.number - 1])
            for one in measured
            if one.width < NARROWEST * min(size, one.length)
        ),
        key=lambda one: one.width,
    )
    if not slivers:
        return
    named = ", ".join(
        f"face:{sliver.number} ({1e3 * sliver.width * unit:.4g} mm wide, {1e3 * sliver.length * unit:.4g} mm long)"
        for sliver in slivers[:NAMED_FACES]
    )
    raise MeshError(
        f"too narrow for elements of {1e3 * size * unit:.4g} mm, {len(slivers)} of {len(faces)} faces: {named}; remove them in the CAD"
        " system (gaps, overlaps and leftovers of chamfers show up so), or write a much smaller mesh size"
    )


def _measure_faces(faces: Sequence[int]) -> list[_Sliver]:
    """Return the width and length of each face."""
    slivers = []
    for number, face in enumerate(faces, 1):
        # seams count on both sides
        curves = gmsh.model.getBoundary([(2, face)], combined=False, oriented=False)
        perimeter = sum(float(gmsh.model.occ.getMass(1, abs(curve))) for _, curve in curves)
        box = np.array(gmsh.model.occ.getBoundingBox(2, face))
        length = float(np.linalg.norm(box[3:] - box[:3]))
        width = (
            2.0 * float(gmsh.model.occ.getMass(2, face)) / perimeter if perimeter > 0.0 else length
        )
        slivers.append(_Sliver(number, width, length))
    return slivers


def leave_out_features(
    shape: PlainShape,
    rebuild: Callable[[], int],
    *,
    radius: float,
    named: Collection[int],
    unit: float,
) -> PlainShape:
    """Take off features that consist of faces with small radii and of what those surround.

    A feature that the CAD kernel cannot close is left as it is; so are all where a face that
    something refers to would not be known again.

    Args:
        shape: With its faces as ``face:N`` counts them.
        rebuild: Builds the same volume anew, after the kernel spoiled it, and returns its tag; those
            of its faces are the same as before.
        radius: Largest radius that goes, in the unit of the model.
        named: Numbers of faces that something refers to and that must stay.
        unit: Length of the model's unit [m].
    """
    numbers, volume = shape.numbers, shape.volume
    faces = list(numbers)
    before = [_know_face(face) for face in faces]
    whole = float(gmsh.model.occ.getMass(3, volume))
    kept = {shape.faces[number - 1] for number in named if 0 < number <= len(shape.faces)}
    features = [group for group in _find_features(faces, radius) if not group & kept]
    refused = 0
    while features:
        gone = set().union(*features)
        left = _take_off(volume, gone) if len(gone) <= LARGEST_SHARE * len(faces) else None
        if _is_sound(left, whole):
            now = shape.followed(left, _follow_faces(before, boundary_faces(left)))
            if now.keeps(named, len(shape.faces)):
                change = _volume_share(left, whole) - 1.0
                counted = [numbers[face] for face in gone]
                remark = _describe(counted, len(shape.faces), radius * unit, change, refused)
                return dataclasses.replace(now, remarks=[*shape.remarks, remark])
            break
        # which of them it is nobody says: each by itself, on a shape built anew
        good = [one for one in features if _is_sound(_take_off(rebuild(), one), whole)]
        volume = rebuild()
        if len(good) == len(features):
            break  # they go one by one, not together
        refused += len(features) - len(good)
        features = good
    volume = rebuild()
    what = f"with a radius up to {1e3 * radius * unit:.4g} mm"
    remark = f"no fillet, hole or pin {what} could be left out (mesh.leave_out)"
    return dataclasses.replace(shape, volume=volume, remarks=[*shape.remarks, remark])


def _find_features(faces: Sequence[int], radius: float) -> list[set[int]]:
    """Find the faces with radii up to a radius, and those that they alone surround, in connected
    groups.
    """
    small = {face for face in faces if face_radius(face) <= radius * (1.0 + 1e-6)}
    around = {face: face_curves(face) for face in faces}
    groups: list[set[int]] = []
    for face in sorted(_surround(faces, small)):
        touching = [
            group for group in groups if any(around[face] & around[other] for other in group)
        ]
        for group in touching:
            groups.remove(group)
        groups.append({face}.union(*touching))
    return groups


def _surround(faces: Sequence[int], small: Collection[int]) -> set[int]:
    """Return small faces and those that they alone surround."""
    edges = set().union(*(face_curves(face) for face in small))
    return {
        face
        for face in faces
        if face in small or ((curves := face_curves(face)) and curves <= edges)
    }


def _take_off(volume: int, feature: Iterable[int]) -> int | None:
    """Return the volume without some of its faces; None where the kernel cannot close it."""
    try:
        volumes = gmsh.model.occ.defeature([volume], sorted(feature))
        gmsh.model.occ.synchronize()
    except Exception:  # gmsh raises the bare class
        return None
    left = [tag for dim, tag in volumes if dim == 3]
    return left[0] if len(left) == 1 else None


def _is_sound(volume: int | None, whole: float) -> TypeGuard[int]:
    return volume is not None and abs(_volume_share(volume, whole) - 1.0) <= LARGEST_CHANGE


def _volume_share(volume: int, whole: float) -> float:
    share = float(gmsh.model.occ.getMass(3, volume)) / whole
    return share if np.isfinite(share) else 0.0


def _describe(gone: Sequence[int], faces: int, radius: float, change: float, refused: int) -> str:
    stay = f"; {refused} more could not be taken off" if refused else ""
    return (
        f"{len(gone)} of {faces} faces{quote_faces(gone)}, of fillets, holes and pins with radii up to {1e3 * radius:.4g} mm,"
        f" are left out of the mesh; the volume changes by {change:.1e}{stay} (mesh.leave_out)"
    )
