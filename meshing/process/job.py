"""Jobs for the meshing worker process and their results, as JSON and npz."""

import dataclasses
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import (
    Box,
    HollowColumn,
    MeshFile,
    ParametricSolid,
    Plate,
    StepFile,
    Tube,
)
from headstock.meshing.component_mesh import CellKind, CurvedFacets, IntArray, LeftOut
from headstock.meshing.process.worker import Arrays

JobSolid = ParametricSolid | StepFile | MeshFile
SOLIDS: dict[str, type[JobSolid]] = {
    kind.__name__: kind for kind in (Box, Tube, Plate, HollowColumn, StepFile, MeshFile)
}
_DECODER = json.JSONDecoder(
    object_hook=lambda fields: {
        name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()
    }
)


@dataclass(frozen=True)
class MeshJob:
    """Job of the worker process; lengths in the job's own unit.

    Attributes:
        task: ``mesh`` (mesh a CAD shape), ``describe`` (only its properties), ``estimate`` (also
            mesh its surface to count cells), ``faces`` (list and triangulate its faces) or ``file``
            (read a finished mesh).
        solid: What is meshed or read.
        unit: Length of the job's unit [m], for messages.
        size: Element size, None for the default rule (STEP files only).
        growth: Element size per distance from the rim of an imprint, on top of the size there; None
            for gmsh's own grading.
        rims: Groups around which stresses are singular.
        smallest: What curvature and short edges do not go below; None for the default share of the
            element size.
        leave_out: Largest radius of the fillets, holes and pins that are taken off before meshing;
            None for none.
        details: Width up to which holes, recesses and pads in plane faces are left out; None for a
            share of the element size.
        refinement: How many times finer than usual imprints and curved faces are meshed.
        order: 1 or 2.
        straight: Leave second-order edges straight: the parent elevates the mesh.
        sizes: Element sizes from place to place, which take the place of grading; None for none.
    """

    task: Literal["mesh", "describe", "estimate", "faces", "file"]
    solid: JobSolid
    groups: dict[str, list[Patch]] = field(default_factory=dict)
    unit: float = 1.0
    size: float | None = None
    refinement: float = 1.0
    across_patches: int = 4
    growth: float | None = None
    rims: tuple[str, ...] = ()
    rim_size: float | None = None
    smallest: float | None = None
    leave_out: float | None = None
    details: float | None = None
    order: int = 2
    straight: bool = False
    sizes: SizeField | None = None


@dataclass(frozen=True, eq=False)
class MeshData:
    """Result of the worker process; lengths in the job's own unit.

    Attributes:
        points: ``(n, 3)``; empty when only described.
        cells: ``(n, nodes per cell)`` in gmsh order.
        kind: Cell kind, or None when only described.
        facets: Facet corners ``(n, 3 or 4)`` of each group or named surface set.
        properties: Of the CAD shape with its patch groups, or None for a mesh file.
        size: Element size that was used.
        estimate: Number of cells that were expected.
        nodes: Number of nodes that were expected, 0 where only cells were.
        owners: ``(n,)`` number of a face that each point lies on, as ``face:N`` counts them; 0
            inside, empty where not known.
        remarks: What the user should know of how the shape was meshed.
        faces: Of the CAD shape, where they were requested.
        curved: Facets on curved faces; None where none was looked for.
        left_out: Small features that the mesh lacks; None for none.
    """

    points: FloatArray
    cells: IntArray
    kind: CellKind | None
    facets: dict[str, IntArray] = field(default_factory=dict)
    node_sets: dict[str, IntArray] = field(default_factory=dict)
    properties: SolidProperties | None = None
    size: float = 0.0
    estimate: int = 0
    nodes: int = 0
    remarks: list[str] = field(default_factory=list)
    owners: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    faces: list[CadFace] = field(default_factory=list)
    curved: CurvedFacets | None = None
    left_out: LeftOut | None = None


# how the fields of a result are packed: arrays, arrays by name, types of arrays, and values
_ARRAYS = ("points", "cells", "owners")
_NAMED_ARRAYS = ("facets", "node_sets")
_RECORDS: dict[str, type[CurvedFacets | LeftOut]] = {"curved": CurvedFacets, "left_out": LeftOut}
_VALUES = ("kind", "size", "estimate", "nodes", "remarks")


def perform_job(perform: Callable[[MeshJob], MeshData], text: bytes) -> Arrays:
    """Perform a job in the worker process."""
    return pack_data(perform(parse_job(text.decode())))


def format_job(job: MeshJob) -> str:
    """Return a job as JSON."""
    solid = {"kind": type(job.solid).__name__, **dataclasses.asdict(job.solid)}
    sizes = None
    if job.sizes is not None:
        sizes = {name: array.tolist() for name, array in vars(job.sizes).items()}
    fields = dataclasses.asdict(dataclasses.replace(job, sizes=None))
    return json.dumps(fields | {"solid": solid, "sizes": sizes}, default=os.fspath)


def parse_job(text: str) -> MeshJob:
    """Return a job from JSON."""
    job = _DECODER.decode(text)
    fields = job.pop("solid")
    if "path" in fields:
        fields["path"] = Path(fields["path"])
    if "beside" in fields:
        fields["beside"] = tuple(Path(path) for path in fields["beside"])
    groups = {
        name: [Patch(**patch) for patch in patches] for name, patches in job.pop("groups").items()
    }
    sizes = job.pop("sizes")
    if sizes is not None:
        sizes = SizeField(**{name: np.array(values) for name, values in sizes.items()})
    return MeshJob(solid=SOLIDS[fields.pop("kind")](**fields), groups=groups, sizes=sizes, **job)


def pack_data(data: MeshData) -> Arrays:
    """Return a result as arrays of numbers and one of text."""
    arrays = {name: getattr(data, name) for name in _ARRAYS}
    for name in _NAMED_ARRAYS:
        arrays |= {f"{name}_{i}": array for i, array in enumerate(getattr(data, name).values())}
    for name in _RECORDS:
        if getattr(data, name) is not None:
            arrays |= {f"{name}_{key}": array for key, array in vars(getattr(data, name)).items()}
    meta: dict[str, Any] = {name: list(getattr(data, name)) for name in _NAMED_ARRAYS}
    meta |= {name: getattr(data, name) for name in _VALUES}
    meta["faces"] = [dataclasses.asdict(face) for face in data.faces]
    if data.properties is not None:
        meta["properties"] = dataclasses.asdict(data.properties)
    text = json.dumps(meta, default=lambda array: array.tolist())
    return {**arrays, "meta": np.array(text)}


def unpack_data(arrays: Arrays) -> MeshData:
    """Return a result of ``pack_data``."""
    meta = _DECODER.decode(str(arrays["meta"]))
    fields: dict[str, Any] = {name: arrays[name] for name in _ARRAYS}
    for name in _NAMED_ARRAYS:
        fields[name] = {key: arrays[f"{name}_{i}"] for i, key in enumerate(meta[name])}
    for name, kind in _RECORDS.items():
        names = [field.name for field in dataclasses.fields(kind)]
        if f"{name}_{names[0]}" in arrays:
            fields[name] = kind(*(arrays[f"{name}_{key}"] for key in names))
    fields |= {name: meta[name] for name in _VALUES}
    fields["remarks"] = list(meta["remarks"])
    fields["faces"] = [CadFace(**face) for face in meta["faces"]]
    if "properties" in meta:
        fields["properties"] = _read_properties(meta["properties"])
    return MeshData(**fields)


def scale_properties(properties: SolidProperties, scale: float) -> SolidProperties:
    """Return the properties in metres from properties in a unit of ``scale`` metres."""
    return SolidProperties(
        properties.volume * scale**3,
        properties.center * scale,
        properties.inertia * scale**5,
        {name: area * scale**2 for name, area in properties.patch_areas.items()},
        {name: centroid * scale for name, centroid in properties.patch_centroids.items()},
        properties.box * scale,
        {name: box * scale for name, box in properties.patch_boxes.items()},
    )


def _read_properties(data: dict[str, Any]) -> SolidProperties:
    def convert(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: convert(entry) for name, entry in value.items()}
        return np.array(value, dtype=float) if isinstance(value, tuple | list) else value

    return SolidProperties(**convert({key: data[key] for key in data if key != "remarks"}))
