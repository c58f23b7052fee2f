"""Measures the solids of an assembly file with gmsh (runs in the worker process)."""

import json
import tempfile
import time
from pathlib import Path

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.assemblies.step_tree import read_tree
from headstock.meshing.cad.faces import LENGTH_PRECISION
from headstock.meshing.cad.features import quote_faces
from headstock.meshing.cad.meshing import TRIANGLE, open_kernel, shape_bounds
from headstock.meshing.cad.shapes import boundary_faces, build_shape, import_step, read_step_text
from headstock.meshing.errors import PartFileError
from headstock.meshing.length_units import STEP_UNIT
from headstock.meshing.process.worker import Arrays

MOST_SOLIDS = 1000
TRIAL_ELEMENTS = 8  # along the longest side of a part


def measure_solids(path: str) -> Arrays:
    """Read the tree of a file and measure its solids; lengths in millimetres.

    Returns:
        Of the tree what `Occurrences.arrays` holds; per solid ``paths`` (of gmsh's labels),
        ``volumes``, ``areas``, ``centers``, ``boxes`` ``(n, 6)`` and ``colours`` ``(n, 3)`` (NaN for
        none); of all solids one after the other ``points``, ``dimensions`` and ``sizes``, with
        ``counts`` ``(n,)``.
    """
    file = Path(path)
    tree = read_tree(read_step_text(file), file.name)
    with open_kernel():
        volumes = open_assembly(file)
        occ = gmsh.model.occ
        points = [_label_points(volume) for volume in volumes]
        colours = [_read_colour(volume) for volume in volumes]
        return {
            **tree.arrays(),
            "paths": np.array([gmsh.model.getEntityName(3, volume) for volume in volumes]),
            "volumes": np.array([occ.getMass(3, volume) for volume in volumes]),
            "centers": np.array([occ.getCenterOfMass(3, volume) for volume in volumes]),
            "areas": np.array([one[one[:, 3] == 2.0, 4].sum() for one in points]),
            "boxes": np.array([occ.getBoundingBox(3, volume) for volume in volumes]),
            "colours": np.array(colours),
            "counts": np.array([len(one) for one in points]),
            "points": np.concatenate(points)[:, :3],
            "dimensions": np.concatenate(points)[:, 3].astype(np.int64),
            "sizes": np.concatenate(points)[:, 4],
        }


def open_assembly(path: Path) -> list[int]:
    """Import a STEP file with its labels and colours into the open model and return its volumes in
    the order of their numbers.

    Raises:
        MeshError: It is no STEP file, or holds no solids or too many.
    """
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    volumes = [tag for dim, tag in import_step(path) if dim == 3]
    if len(volumes) > MOST_SOLIDS:
        raise PartFileError(
            f"{path.name} holds {len(volumes)} solids, at most {MOST_SOLIDS} can be read; export a part of the assembly"
        )
    return volumes


def move_solid(path: str, content: bytes) -> Arrays:
    """Move the solid of a STEP file.

    Args:
        content: JSON of ``solid``, its number or name, of ``axis`` and ``angle`` [rad] of a rotation
            about the origin, and of the ``shift`` [m] after it.

    Returns:
        ``step``: bytes of the STEP file that gmsh writes.
    """
    job = json.loads(content)
    with open_kernel(), tempfile.TemporaryDirectory() as folder:
        moved = [(3, build_shape(StepFile(Path(path), job["solid"])))]
        gmsh.model.occ.rotate(moved, 0.0, 0.0, 0.0, *job["axis"], job["angle"])
        gmsh.model.occ.translate(moved, *(value / STEP_UNIT for value in job["shift"]))
        gmsh.model.occ.synchronize()
        written = Path(folder, "moved.step")
        gmsh.write(str(written))
        return {"step": np.frombuffer(written.read_bytes(), dtype=np.uint8)}


def _label_points(volume: int) -> FloatArray:
    """Return the corners and the centroids of edges and faces ``(n, 3)``, without those of seams,
    which copies may have elsewhere, with their dimension and size ``(n, 5)`` altogether.
    """
    occ, rows = gmsh.model.occ, []
    corners: set[int] = set()
    faces = boundary_faces(volume)
    edges: dict[int, int] = {}
    for face in faces:
        rows.append((*occ.getCenterOfMass(2, face), 2.0, occ.getMass(2, face)))
        for _, edge in gmsh.model.getBoundary([(2, face)], oriented=False):
            edges[abs(edge)] = edges.get(abs(edge), 0) + 1
    for edge, uses in edges.items():
        if uses < 2:
            continue
        rows.append((*occ.getCenterOfMass(1, edge), 1.0, occ.getMass(1, edge)))
        ends = [tag for _, tag in gmsh.model.getBoundary([(1, edge)], oriented=False)]
        corners.update(ends if len(set(ends)) > 1 else ())
    rows += [(*gmsh.model.getValue(0, corner, []), 0.0, 0.0) for corner in corners]
    return np.array(rows)


def try_surfaces(path: str, content: bytes) -> Arrays:
    """Mesh the surfaces of solids coarsely, one after the other.

    Args:
        content: Numbers of the solids, and the processor time [s] after which no further is tried.

    Returns:
        ``faults``: why each cannot be meshed, empty where it can; of as many as were tried.
    """
    job = json.loads(content)
    faults: list[str] = []
    with open_kernel():
        volumes = open_assembly(Path(path))
        gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
        gmsh.option.setNumber("Mesh.Smoothing", 0)
        gmsh.option.setNumber("Mesh.LcIntegrationPrecision", LENGTH_PRECISION)
        for number in job["solids"]:
            if time.process_time() > job["seconds"]:
                break
            faults.append(_try_surface(volumes[number - 1]))
    return {"faults": np.array(faults, dtype=np.str_)}


def _try_surface(volume: int) -> str:
    """Return why the surface of a solid cannot be meshed; empty where it can."""
    low, high = shape_bounds(volume)
    gmsh.option.setNumber("Mesh.MeshSizeMax", float((high - low).max()) / TRIAL_ELEMENTS)
    gmsh.model.setVisibility(gmsh.model.getEntities(), 0)
    gmsh.model.setVisibility([(3, volume)], 1, recursive=True)
    reason = ""
    try:
        gmsh.model.mesh.generate(2)
    except Exception as error:  # gmsh raises the bare class
        reason = f": {error}"
    bare = [
        number
        for number, tag in enumerate(boundary_faces(volume), 1)
        if not len(gmsh.model.mesh.getElementsByType(TRIANGLE[1], tag)[0])
    ]
    return f"no triangles on some of its faces{quote_faces(bare)}{reason}" if bare else ""


def _read_colour(volume: int) -> tuple[float, float, float]:
    """Return the colour of a solid, 0 to 1; NaN for none."""
    red, green, blue, alpha = gmsh.model.getColor(3, volume)
    if alpha == 0:
        return np.nan, np.nan, np.nan
    return red / 255.0, green / 255.0, blue / 255.0
