"""Contacts of the solids in an assembly file (runs in the worker process)."""

import dataclasses
import itertools
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.frames import FloatArray
from headstock.meshing.assemblies.cylinder_overlaps import find_cylinder_overlaps
from headstock.meshing.assemblies.fitted_surfaces import (
    FittedSolid,
    Overlap,
    as_vector,
    boxes_meet,
    fit_face,
    group_surfaces,
    is_inside,
)
from headstock.meshing.assemblies.plane_overlaps import (
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
OPPOSITE = 1e-3  # 1 + cosine between walls of a guide that face each other
SAME_RANK = 0.05  # of singular values of normals: directions that count as blocked
SAME_FACE = 1e-2  # distance of the centroids of one face of two copies of a part [mm]


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
    tolerance = job["tolerance"] / STEP_UNIT
    wide = max(tolerance, job["wide"] / STEP_UNIT)
    with open_kernel():
        volumes = open_assembly(Path(path))
        tags = [boundary_faces(volume) for volume in volumes]
        solids, pairs = _fit_solids(volumes, tags, wide)
        contacts = _search_pairs(solids, pairs, tolerance, wide)
        contacts = _number_faces(contacts, tags, job["parts"])
    contacts.sort(key=lambda contact: (contact.solids, contact.kind, contact.faces))
    fields = [dataclasses.asdict(_in_metres(contact)) for contact in contacts]
    return {"contacts": np.array(json.dumps(fields, default=lambda array: array.tolist()))}


def _fit_solids(
    volumes: Sequence[int], tags: Sequence[Sequence[int]], reach: float
) -> tuple[list[FittedSolid], list[tuple[int, int]]]:
    """Fit the faces of each solid that lie near another one; also return the pairs of solids as
    near as that.
    """
    faces = [
        np.array([gmsh.model.occ.getBoundingBox(2, tag) for tag in rim]).reshape(-1, 2, 3)
        for rim in tags
    ]
    boxes = np.array([[one[:, 0].min(axis=0), one[:, 1].max(axis=0)] for one in faces])
    near = boxes_meet(boxes, boxes, reach) & ~np.eye(len(boxes), dtype=bool)
    owners = Counter(itertools.chain.from_iterable(tags))
    solids = []
    for i, volume in enumerate(volumes):
        chosen = np.flatnonzero(boxes_meet(faces[i], boxes[near[i]], reach).any(axis=1))
        fits = (
            fit_face(volume, tags[i][k], int(k) + 1, shared=owners[tags[i][k]] > 1) for k in chosen
        )
        surfaces = group_surfaces([face for face in fits if face is not None])
        solids.append(FittedSolid(volume, boxes[i], surfaces))
    return solids, [(int(i), int(j)) for i, j in np.argwhere(np.triu(near))]


def _search_pairs(
    solids: Sequence[FittedSolid],
    pairs: Sequence[tuple[int, int]],
    tolerance: float,
    wide: float,
) -> list[Contact]:
    """Find the contacts of pairs of solids, in millimetres.

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
        guide = _may_guide([(one.normal, one.gap) for one in planes], tolerance)
        cuts += [(one, cut_overlap(one)) for one in planes if guide or one.gap <= tolerance]
        cylinders = find_cylinder_overlaps(solids, pair, tolerance)
        contacts += [overlap[0] for overlap in cylinders if _is_clear(solids, overlap)]
    gmsh.model.occ.synchronize()
    flat = [
        overlap[0]
        for pair, pieces in cuts
        for overlap in measure_overlaps(pair, pieces)
        if _is_clear(solids, overlap)
    ]
    return contacts + _mark_guides(flat, tolerance)


def _mark_guides(contacts: Sequence[Contact], tolerance: float) -> list[Contact]:
    """Mark the contacts of guides with air, and leave out others that are only near."""
    marked = []
    for _, group in itertools.groupby(contacts, key=lambda contact: contact.solids):
        members = list(group)
        guide = _may_guide([(np.array(one.axis), one.gap) for one in members], tolerance)
        marked += [
            dataclasses.replace(one, wide=one.gap > tolerance)
            for one in members
            if guide or one.gap <= tolerance
        ]
    return marked


def _is_clear(solids: Sequence[FittedSolid], overlap: Overlap) -> bool:
    """Return whether no other solid lies in a gap, or whether both solids lie in an overlap."""
    contact, probes = overlap
    pair = [number - 1 for number in contact.solids]
    if abs(contact.gap) <= NOISE or not len(probes):
        return True
    if contact.gap < 0.0:
        counts = [sum(is_inside(solids[i].volume, probe) for probe in probes) for i in pair]
        return 2 * min(counts) > len(probes)
    box = np.array([[probes.min(axis=0), probes.max(axis=0)]])
    near = boxes_meet(box, np.array([solid.box for solid in solids]), 0.0)[0]
    others = [solids[i].volume for i in np.flatnonzero(near) if i not in pair]
    filled = [any(is_inside(volume, probe) for volume in others) for probe in probes]
    return 2 * sum(filled) <= len(probes)


def _may_guide(planes: Sequence[tuple[FloatArray, float]], tolerance: float) -> bool:
    """Return whether one solid embraces the other with air between them: two walls face each
    other, not both of them in contact, and all of them leave one direction free.

    Args:
        planes: Normal ``(3,)`` and gap [mm] of each.
    """
    gaps = np.array([gap for _, gap in planes])
    apart = gaps[gaps >= -tolerance] > tolerance
    if not apart.any():
        return False
    normals = np.array([normal for normal, _ in planes])[gaps >= -tolerance]
    sizes = np.linalg.svd(normals, compute_uv=False)
    facing = normals[apart] @ normals.T
    return int((sizes > SAME_RANK * sizes[0]).sum()) == 2 and bool(facing.min() < OPPOSITE - 1.0)


def _number_faces(
    contacts: Sequence[Contact], tags: Sequence[Sequence[int]], parts: Sequence[dict[str, Any]]
) -> list[Contact]:
    """Number faces as the first solid of each part counts them.

    Copies that the file shares have their faces in one order; those that were found by geometry
    need not.
    """
    orders: dict[int, list[int]] = {}
    for number in {number for contact in contacts for number in contact.solids}:
        part = parts[number - 1]
        rim, original = tags[number - 1], tags[part["solid"] - 1]
        orders[number] = list(range(1, len(rim) + 1))
        if number == part["solid"]:
            continue
        centers, originals = (
            np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in one])
            for one in (rim, original)
        )
        back = (centers - np.array(part["shift"]) / STEP_UNIT) @ np.array(part["rotation"])
        distances = np.linalg.norm(back[:, None] - originals, axis=2)
        for k in np.flatnonzero(np.diag(distances) > SAME_FACE):
            orders[number][k] = int(distances[k].argmin()) + 1
    numbered = []
    for contact in contacts:
        first, second = (
            tuple(orders[number][face - 1] for face in side)
            for number, side in zip(contact.solids, contact.faces, strict=True)
        )
        numbered.append(dataclasses.replace(contact, faces=(first, second)))
    return numbered


def _in_metres(contact: Contact) -> Contact:
    """Return a contact in metres from one in millimetres."""
    return dataclasses.replace(
        contact,
        gap=contact.gap * STEP_UNIT,
        area=contact.area * STEP_UNIT**2,
        center=as_vector(np.array(contact.center) * STEP_UNIT),
        radius=None if contact.radius is None else contact.radius * STEP_UNIT,
        length=None if contact.length is None else contact.length * STEP_UNIT,
        outlines=tuple(outline * STEP_UNIT for outline in contact.outlines),
    )
