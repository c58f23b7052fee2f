"""Contacts of the solids in an assembly file (runs in the worker process)."""

import dataclasses
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import Vector
from headstock.meshing.assemblies.cylinder_overlaps import CylinderOverlap, find_cylinder_overlaps
from headstock.meshing.assemblies.fitted_surfaces import (
    FittedFace,
    FittedSolid,
    boxes_meet,
    fit_face,
    is_inside,
    label_surfaces,
)
from headstock.meshing.assemblies.plane_overlaps import (
    PlaneOverlap,
    PlanePair,
    cut_overlap,
    measure_overlaps,
    pair_planes,
)
from headstock.meshing.assemblies.solids import open_assembly
from headstock.meshing.cad.meshing import open_kernel
from headstock.meshing.cad.shapes import boundary_faces
from headstock.meshing.length_units import STEP_UNIT
from headstock.meshing.process.worker import Arrays

NOISE = 0.01  # a gap or an overlap that files have without meaning it [mm]
DEPTHS = (0.25, 0.75)  # of a gap or an overlap at which it is looked into
OPPOSITE = 1e-3  # 1 + cosine between walls of a guide that face each other
SAME_RANK = 0.05  # of singular values of normals: directions that count as blocked
SAME_FACE = 1e-2  # distance of the centroids of one face of two copies of a part [mm]

Pair = tuple[int, int]  # indices of two solids


def search_touching(path: str, content: bytes) -> Arrays:
    """Find the contacts of the solids of a STEP file, and report progress on standard error.

    Args:
        content: JSON of ``tolerance`` and ``wide`` [m], and of ``parts``: for each solid of the file
            the number of the first one of its part and the motion from there, ``rotation`` and
            ``shift`` [m].

    Returns:
        ``contacts``: JSON of their fields.
    """
    job = json.loads(content)
    tolerance, wide = job["tolerance"] / STEP_UNIT, job["wide"] / STEP_UNIT
    with open_kernel():
        volumes = open_assembly(Path(path))
        tags = [boundary_faces(volume) for volume in volumes]
        solids, pairs = _fit_solids(volumes, tags, max(tolerance, wide))
        numbers = _FaceNumbers(tags, job["parts"])
        contacts = _search_pairs(solids, pairs, numbers, tolerance, wide)
    contacts.sort(key=lambda contact: (contact.solids, contact.kind, contact.faces))
    fields = [dataclasses.asdict(contact) for contact in contacts]
    return {"contacts": np.array(json.dumps(fields, default=lambda array: array.tolist()))}


def _fit_solids(
    volumes: Sequence[int], tags: Sequence[Sequence[int]], reach: float
) -> tuple[list[FittedSolid], list[Pair]]:
    """Fit the faces of each solid that lie near another one; also return the pairs of solids as
    near as that.
    """
    faces = [
        np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in rim]).reshape(-1, 2, 3)
        for rim in tags
    ]
    boxes = np.array([[one[:, 0].min(axis=0), one[:, 1].max(axis=0)] for one in faces])
    near = boxes_meet(boxes, boxes, reach) & ~np.eye(len(boxes), dtype=bool)
    solids = []
    for i, volume in enumerate(volumes):
        chosen = np.flatnonzero(boxes_meet(faces[i], boxes[near[i]], reach).any(axis=1))
        fits = (fit_face(volume, tags[i][k], int(k) + 1) for k in chosen)
        fitted = tuple(face for face in fits if face is not None)
        solids.append(FittedSolid(volume, boxes[i], fitted, label_surfaces(fitted)))
    return solids, [(int(i), int(j)) for i, j in np.argwhere(np.triu(near))]


def _search_pairs(
    solids: Sequence[FittedSolid],
    pairs: Sequence[Pair],
    numbers: "_FaceNumbers",
    tolerance: float,
    wide: float,
) -> list[Contact]:
    """Find the contacts of pairs of solids.

    Args:
        tolerance: Largest gap [mm].
        wide: Of guides [mm].
    """
    contacts: list[Contact] = []
    cuts: list[tuple[PlanePair, dict[int, set[int]]]] = []
    for done, pair in enumerate(pairs, 1):
        sys.stderr.write(f"{done}/{len(pairs)}\n")
        sys.stderr.flush()
        planes = pair_planes(solids, pair, wide)
        guide = _may_guide(planes, tolerance)
        cuts += [(one, cut_overlap(one)) for one in planes if guide or one.gap <= tolerance]
        contacts += [
            numbers.cylinder_contact(pair, overlap)
            for overlap in find_cylinder_overlaps(solids[pair[0]], solids[pair[1]], tolerance)
            if _is_clear(solids, pair, overlap.gap, overlap.probes)
        ]
    gmsh.model.occ.synchronize()
    overlaps = [
        (pair, overlap)
        for pair, pieces in cuts
        for overlap in measure_overlaps(pair, pieces)
        if _is_clear(
            solids,
            pair.solids,
            pair.gap,
            np.vstack([overlap.probes + share * pair.gap * pair.normal for share in DEPTHS]),
        )
    ]
    for _, group in itertools.groupby(overlaps, key=lambda one: one[0].solids):
        members = list(group)
        guide = _may_guide([pair for pair, _ in members], tolerance)
        contacts += [
            numbers.plane_contact(pair, overlap, wide=pair.gap > tolerance)
            for pair, overlap in members
            if guide or pair.gap <= tolerance
        ]
    return contacts


def _is_clear(solids: Sequence[FittedSolid], pair: Pair, gap: float, probes: FloatArray) -> bool:
    """Return whether no other solid lies in a gap, or whether both solids lie in an overlap.

    Args:
        probes: Points in it, ``(n, 3)``.
    """
    if abs(gap) <= NOISE or not len(probes):
        return True
    if gap < 0.0:
        counts = [sum(is_inside(solids[i].volume, probe) for probe in probes) for i in pair]
        return 2 * min(counts) > len(probes)
    box = np.array([[probes.min(axis=0), probes.max(axis=0)]])
    near = boxes_meet(box, np.array([solid.box for solid in solids]), 0.0)[0]
    others = [solids[i].volume for i in np.flatnonzero(near) if i not in pair]
    filled = [any(is_inside(volume, probe) for volume in others) for probe in probes]
    return 2 * sum(filled) <= len(probes)


def _may_guide(planes: Sequence[PlanePair], tolerance: float) -> bool:
    """Return whether one solid embraces the other with air between them: two walls face each
    other, not both of them in contact, and all of them leave one direction free.
    """
    gaps = np.array([pair.gap for pair in planes])
    apart = gaps[gaps >= -tolerance] > tolerance
    if not apart.any():
        return False
    normals = np.array([pair.normal for pair in planes])[gaps >= -tolerance]
    sizes = np.linalg.svd(normals, compute_uv=False)
    facing = normals[apart] @ normals.T
    return int((sizes > SAME_RANK * sizes[0]).sum()) == 2 and bool(facing.min() < OPPOSITE - 1.0)


class _FaceNumbers:
    """Numbers of faces as the first solid of each part counts them.

    Copies that the file shares have their faces in one order; those that were found by geometry
    need not.

    Attributes:
        tags: Of the faces of each solid.
        parts: Number of the first solid of its part and the motion from there, of each solid.
    """

    def __init__(self, tags: Sequence[Sequence[int]], parts: Sequence[dict[str, Any]]) -> None:
        self.tags, self.parts = tags, parts
        self._centers: dict[int, FloatArray] = {}

    def plane_contact(self, pair: PlanePair, overlap: PlaneOverlap, *, wide: bool) -> Contact:
        """Return the contact of an overlap of planes, in metres."""
        return Contact(
            kind="plane",
            gap=pair.gap * STEP_UNIT,
            area=overlap.area * STEP_UNIT**2,
            center=_vector(overlap.center * STEP_UNIT),
            axis=_vector(pair.normal),
            outlines=tuple(outline * STEP_UNIT for outline in overlap.outlines),
            wide=wide,
            solid_holes=overlap.solid_holes,
            **self._describe_faces(pair.solids, pair.sides, overlap.areas),
        )

    def cylinder_contact(self, pair: Pair, overlap: CylinderOverlap) -> Contact:
        """Return the contact of a bore and a shaft, in metres."""
        return Contact(
            kind="cylinder",
            gap=overlap.gap * STEP_UNIT,
            area=overlap.area * STEP_UNIT**2,
            center=_vector(overlap.center * STEP_UNIT),
            axis=_vector(overlap.axis),
            radius=overlap.radius * STEP_UNIT,
            length=overlap.length * STEP_UNIT,
            **self._describe_faces(pair, overlap.sides, overlap.areas),
        )

    def _describe_faces(
        self,
        pair: Pair,
        sides: Sequence[Sequence[FittedFace]],
        areas: Sequence[dict[int, float]],
    ) -> dict[str, Any]:
        """Return the fields of a contact that say on which faces it lies."""
        taken = [
            [face for face in side if face.tag in covered]
            for side, covered in zip(sides, areas, strict=True)
        ]
        return {
            "solids": (pair[0] + 1, pair[1] + 1),
            "faces": tuple(
                self._number_faces(i, side) for i, side in zip(pair, taken, strict=True)
            ),
            "covered": tuple(
                tuple(covered[face.tag] / gmsh.model.occ.getMass(2, face.tag) for face in side)
                for side, covered in zip(taken, areas, strict=True)
            ),
        }

    def _number_faces(self, index: int, faces: Sequence[FittedFace]) -> tuple[int, ...]:
        part = self.parts[index]
        first = part["solid"] - 1
        if first == index:
            return tuple(face.number for face in faces)
        shift = np.array(part["shift"]) / STEP_UNIT
        centers = (self._face_centers(index) - shift) @ np.array(part["rotation"])
        originals = self._face_centers(first)
        numbers = []
        for face in faces:
            distances = np.linalg.norm(originals - centers[face.number - 1], axis=1)
            same = distances[face.number - 1] <= SAME_FACE
            numbers.append(face.number if same else int(distances.argmin()) + 1)
        return tuple(numbers)

    def _face_centers(self, index: int) -> FloatArray:
        """Return the centroids of the faces of a solid, ``(n, 3)`` [mm]."""
        if index not in self._centers:
            centers = [gmsh.model.occ.getCenterOfMass(2, tag) for tag in self.tags[index]]
            self._centers[index] = np.array(centers)
        return self._centers[index]


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
