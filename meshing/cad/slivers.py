"""Faces of a CAD shape so narrow that no element fits them, found before a mesher hangs on them or
leaves unusable elements.
"""

import dataclasses
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.meshing.cad.known_faces import GONE, PlainShape, follow_faces, know_face
from headstock.meshing.errors import MeshError

# an element on a narrower face would have a scaled Jacobian below the floor of the mesh checks
NARROWEST = 1e-3
NAMED_FACES = 5
LARGEST_CHANGE = 5e-4  # of the volume; meshes may be off by twice that


@dataclass(frozen=True)
class _Sliver:
    """A face: what ``face:N`` calls it, and its width and length in the model's unit."""

    number: int
    width: float
    length: float


def _find_slivers(faces: Sequence[int], size: float) -> list[_Sliver]:
    """Find the faces of the open gmsh model that are narrower than a thousandth of the elements
    that must lie along them.
    """
    return [
        sliver
        for sliver in _measure_faces(faces)
        if sliver.width < NARROWEST * min(size, sliver.length)
    ]


def remove_narrow_features(
    shape: PlainShape,
    list_boundary: Callable[[int], list[int]],
    *,
    width: float,
    named: Collection[int],
    unit: float,
) -> PlainShape | None:
    """Take features that consist of faces narrower than a width off a volume, such as steps that a
    tool has left.

    Args:
        shape: With its faces as ``face:N`` counts them.
        list_boundary: Tags of the faces of a volume.
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
    around = {
        face: {abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False)}
        for face in faces
    }
    edges = set().union(*(around[face] for face in narrow))
    feature = narrow | {face for face in faces if around[face] <= edges}
    gone = sorted(numbers[face] for face in feature)
    if len(feature) > len(faces) / 2 or set(gone) & set(named):
        return shape
    faces_before = [know_face(face) for face in faces]
    before = float(gmsh.model.occ.getMass(3, shape.volume))
    try:
        volumes = gmsh.model.occ.defeature([shape.volume], sorted(feature))
    except Exception:  # gmsh raises the bare class
        return None
    gmsh.model.occ.synchronize()
    left = [tag for dim, tag in volumes if dim == 3]
    change = float(gmsh.model.occ.getMass(3, left[0])) / before - 1.0 if len(left) == 1 else np.inf
    if not abs(change) <= LARGEST_CHANGE:
        return None
    now = shape.followed(left[0], follow_faces(faces_before, list_boundary(left[0])))
    if any(now.faces[number - 1] == GONE for number in named if 0 < number <= len(shape.faces)):
        return None
    what = f"{len(gone)} of {len(shape.faces)} faces{list_faces(gone)}, narrower than {width * unit:.2g} m or surrounded by such faces"
    remark = f"{what}, are left out of the mesh; the volume changes by {change:.1e} (mesh.smallest)"
    return dataclasses.replace(now, remarks=[*shape.remarks, remark])


def list_faces(numbers: Sequence[int]) -> str:
    """Return the first few of some faces in brackets, as ``show`` numbers them; nothing for
    none.
    """
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
    narrow = _find_slivers([faces[number - 1] for number in numbers], size)
    slivers = sorted(
        (_Sliver(numbers[each.number - 1], each.width, each.length) for each in narrow),
        key=lambda each: each.width,
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
