"""Jobs for the meshing worker process and their results, as JSON and npz."""

import dataclasses
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import Box, HollowColumn, MeshFile, Plate, StepFile, Tube
from headstock.meshing.component_mesh import CellKind, CurvedFacets, IntArray, LeftOut

JobSolid = Box | Tube | Plate | HollowColumn | StepFile | MeshFile
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


def write_data(file: BinaryIO, data: MeshData) -> None:
    """Write a result as npz without pickle."""
    arrays: dict[str, NDArray[Any]] = {
        "points": data.points,
        "cells": data.cells,
        "owners": data.owners,
    }
    arrays |= {f"facets_{i}": array for i, array in enumerate(data.facets.values())}
    arrays |= {f"nodes_{i}": array for i, array in enumerate(data.node_sets.values())}
    meta: dict[str, Any] = {
        "kind": data.kind,
        "facets": list(data.facets),
        "node_sets": list(data.node_sets),
        "size": data.size,
    }
    meta |= {"estimate": data.estimate, "nodes": data.nodes, "remarks": data.remarks}
    meta["faces"] = [dataclasses.asdict(face) for face in data.faces]
    if data.curved is not None:
        arrays |= {
            "curved_nodes": data.curved.nodes,
            "curved_nearest": data.curved.nearest,
            "curved_shares": data.curved.shares,
        }
    if data.left_out is not None:
        arrays |= {f"left_out_{name}": array for name, array in vars(data.left_out).items()}
    if data.properties is not None:
        properties = dataclasses.asdict(data.properties)
        meta["properties"] = json.loads(
            json.dumps(properties, default=lambda array: array.tolist())
        )
    np.savez(file, meta=np.array(json.dumps(meta)), **arrays)  # type: ignore[arg-type]


def read_data(file: BinaryIO) -> MeshData:
    """Read a result written by ``write_data``."""
    with np.load(file, allow_pickle=False) as store:
        meta = _DECODER.decode(str(store["meta"]))
        return MeshData(
            store["points"],
            store["cells"],
            meta["kind"],
            facets={name: store[f"facets_{i}"] for i, name in enumerate(meta["facets"])},
            node_sets={name: store[f"nodes_{i}"] for i, name in enumerate(meta["node_sets"])},
            properties=_read_properties(meta["properties"]) if "properties" in meta else None,
            size=meta["size"],
            estimate=meta["estimate"],
            nodes=meta["nodes"],
            remarks=list(meta["remarks"]),
            owners=store["owners"],
            faces=[CadFace(**fields) for fields in meta["faces"]],
            curved=CurvedFacets(
                store["curved_nodes"], store["curved_nearest"], store["curved_shares"]
            )
            if "curved_nodes" in store
            else None,
            left_out=LeftOut(
                store["left_out_places"], store["left_out_volumes"], store["left_out_strengths"]
            )
            if "left_out_places" in store
            else None,
        )


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


class _Properties(TypedDict):
    volume: float
    center: tuple[float, ...]
    inertia: tuple[list[float], ...]
    patch_areas: dict[str, float]
    patch_centroids: dict[str, tuple[float, ...]]
    box: list[list[float]]
    patch_boxes: dict[str, list[list[float]]]


def _read_properties(data: _Properties) -> SolidProperties:
    centroids = {
        name: np.array(value, dtype=float) for name, value in data["patch_centroids"].items()
    }
    center, inertia = np.array(data["center"], dtype=float), np.array(data["inertia"], dtype=float)
    boxes = {name: np.array(box, dtype=float) for name, box in data["patch_boxes"].items()}
    return SolidProperties(
        *(data["volume"], center, inertia, data["patch_areas"], centroids),
        box=np.array(data["box"], dtype=float),
        patch_boxes=boxes,
    )
