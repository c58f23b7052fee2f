"""Faces of a CAD shape known again where the kernel, changing the shape, gave them new tags."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import LeftOut

GONE = -1
SPOTS = (0.2, 0.5, 0.8)  # shares of both parameter ranges at which curvature is measured
SAME, NEAR = 1e-6, 0.3  # of the size of a face: where and how large one may be to be known again


@dataclass(frozen=True, eq=False)
class PlainShape:
    """A shape without its small features.

    Attributes:
        volume: Tag of what is left.
        faces: Tags of its faces in the order in which ``face:N`` counts those of the whole shape,
            ``GONE`` where one is no more; then those that are new.
        remarks: Messages for the user.
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


def know_face(face: int) -> _Face:
    """Return what the face with a tag of the open gmsh model is known by."""
    return _Face(
        str(gmsh.model.getType(2, face)),
        face_radius(face),
        float(gmsh.model.occ.getMass(2, face)),
        np.array(gmsh.model.occ.getCenterOfMass(2, face)),
    )


def follow_faces(before: Sequence[_Face], now: Sequence[int]) -> list[int]:
    """Return the new tags in the old order: faces that stayed as they were, then those that only
    grew or shrank; the rest at the end.
    """
    left = {tag: know_face(tag) for tag in now}
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
