"""Fillets, holes and pins with small radii taken off a CAD shape, as a mesh without them has it."""

import dataclasses
from collections.abc import Callable, Collection, Iterable, Sequence

import gmsh
import numpy as np

from headstock.meshing.cad.known_faces import (
    GONE,
    PlainShape,
    face_radius,
    follow_faces,
    know_face,
)
from headstock.meshing.cad.slivers import list_faces

LARGEST_CHANGE = 0.1  # of the volume: what takes more off was no detail
LARGEST_SHARE = 0.9  # of the faces, likewise


def leave_out_features(
    shape: PlainShape,
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
        shape: With its faces as ``face:N`` counts them.
        rebuild: Builds the same volume anew, after the kernel spoiled it, and returns its tag; those
            of its faces are the same as before.
        list_boundary: Tags of the faces of a volume.
        radius: Largest radius that goes, in the unit of the model.
        named: Numbers of faces that something refers to and that must stay.
        unit: Length of the model's unit [m].
    """
    numbers, volume = shape.numbers, shape.volume
    faces = list(numbers)
    before = [know_face(face) for face in faces]
    whole = float(gmsh.model.occ.getMass(3, volume))
    kept = {shape.faces[number - 1] for number in named if 0 < number <= len(shape.faces)}
    features = [group for group in _find_features(faces, radius) if not group & kept]
    refused = 0
    while features:
        gone = set().union(*features)
        left = _take_off(volume, gone) if len(gone) <= LARGEST_SHARE * len(faces) else None
        if left is not None and _is_sound(left, whole):
            now = shape.followed(left, follow_faces(before, list_boundary(left)))
            if all(
                now.faces[number - 1] != GONE for number in named if 0 < number <= len(shape.faces)
            ):
                change = _volume_share(left, whole) - 1.0
                counted = [numbers[face] for face in gone]
                remark = _describe(counted, len(shape.faces), radius * unit, change, refused)
                return dataclasses.replace(now, remarks=[*shape.remarks, remark])
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
    remark = f"no fillet, hole or pin {what} could be left out (mesh.leave_out)"
    return dataclasses.replace(shape, volume=volume, remarks=[*shape.remarks, remark])


def _find_features(faces: Sequence[int], radius: float) -> list[set[int]]:
    """Find the faces with radii up to a radius, and those that they alone surround, in connected
    groups.
    """
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
    """Return the volume without some of its faces; None where the kernel cannot close it."""
    try:
        volumes = gmsh.model.occ.defeature([volume], sorted(feature))
        gmsh.model.occ.synchronize()
    except Exception:  # gmsh raises the bare class
        return None
    left = [tag for dim, tag in volumes if dim == 3]
    return left[0] if len(left) == 1 else None


def _is_sound(volume: int, whole: float) -> bool:
    return abs(_volume_share(volume, whole) - 1.0) <= LARGEST_CHANGE


def _volume_share(volume: int, whole: float) -> float:
    share = float(gmsh.model.occ.getMass(3, volume)) / whole
    return share if np.isfinite(share) else 0.0


def _describe(gone: Sequence[int], faces: int, radius: float, change: float, refused: int) -> str:
    stay = f"; {refused} more could not be taken off" if refused else ""
    return (
        f"{len(gone)} of {faces} faces{list_faces(gone)}, of fillets, holes and pins with radii up to {1e3 * radius:.4g} mm,"
        f" are left out of the mesh; the volume changes by {change:.1e}{stay} (mesh.leave_out)"
    )
