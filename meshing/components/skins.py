"""The visible surface of a component: of its mesh, or of the CAD or mesh file of one that is not
meshed.
"""

import dataclasses
import importlib
from typing import cast

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import Skin, sharp_edges, solid_skin
from headstock.geometry.parts.solids import MeshFile, Solid, StepFile
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.components.meshing import read_mesh_file
from headstock.meshing.components.survey import survey_step
from headstock.meshing.elements.surface import extract_surface, surface_triangles
from headstock.meshing.elements.topology import cell_order
from headstock.meshing.errors import MeshError

SPLIT_BELOW = 800  # facets; curved facets of coarser surfaces are split through their mid-nodes
REDUCER = "headstock.meshing.components.reduced_skins"  # loads VTK
LARGEST_SKIN = 12_000  # triangles; finer surfaces are thinned out
PIXEL = 1e-3  # of what fills a picture of 1000 pixels: what is off by less is not visible


def mesh_skin(mesh: ComponentMesh) -> Skin:
    """Return the boundary triangles of a mesh; of very fine ones only some."""
    return _boundary_skin(mesh.points, mesh.cells, mesh.kind)


def unmeshed_skin(solid: Solid, *, thinned: bool = True) -> Skin | None:
    """Return the visible surface of a solid that is not meshed: closed forms, the faces of a STEP
    file, the boundary of a mesh file.

    Args:
        thinned: Take triangles out of the fine surface of a STEP file, which takes seconds.

    Returns:
        None for an imported superelement, which has no shape.

    Raises:
        MeshError: The file cannot be read.
    """
    if isinstance(solid, StepFile):
        survey = survey_step(solid)
        drawn = Skin(
            survey.points, survey.triangles, sharp_edges(survey.points, survey.triangles), "solid"
        )
        return thin_skin(drawn, largest=LARGEST_SKIN) if thinned else drawn
    if isinstance(solid, MeshFile):
        data = read_mesh_file(solid, solid.path.name)
        drawn = _boundary_skin(data.points, data.cells, cast(CellKind, data.kind))
        return dataclasses.replace(drawn, source="solid", nodes=None, weights=None)
    return solid_skin(solid)


def mesh_surface(mesh: ComponentMesh) -> Skin:
    """Return all boundary triangles of a mesh, curved facets split through their mid-nodes."""
    return _whole_skin(mesh.points, mesh.cells, mesh.kind, split=cell_order(mesh.kind) == 2)


def _boundary_skin(all_points: FloatArray, cells: IntArray, kind: CellKind) -> Skin:
    few = len(extract_surface(cells, kind).facets) <= SPLIT_BELOW
    skin = _whole_skin(all_points, cells, kind, split=cell_order(kind) == 2 and few)
    return thin_skin(skin, largest=LARGEST_SKIN)


def _whole_skin(all_points: FloatArray, cells: IntArray, kind: CellKind, *, split: bool) -> Skin:
    triangles, _ = surface_triangles(extract_surface(cells, kind), split=split)
    nodes, flat = np.unique(triangles, return_inverse=True)
    points, triangles = all_points[nodes], flat.reshape(-1, 3)
    return Skin(
        points,
        triangles,
        sharp_edges(points, triangles),
        "mesh",
        nodes[:, None],
        np.ones((len(nodes), 1)),
    )


def thin_skin(skin: Skin, *, largest: int, pixel: float | None = None) -> Skin:
    """Return a surface with fewer triangles that looks the same; the surface itself, which then
    says why, where VTK is missing or there is none.

    Args:
        largest: How many triangles there may be if it then looks the same.
        pixel: Largest invisible deviation [m]; default: a pixel of a picture of this surface.
    """
    if len(skin.triangles) <= largest:
        return skin
    tolerance = pixel or PIXEL * skin_size(skin)
    try:
        reducer = importlib.import_module(REDUCER)
        thinned: Skin = reducer.reduce_skin(skin, largest=largest, tolerance=tolerance)
    except ImportError as error:
        missing = f"VTK, which thins out, is missing ({error}; ./headstock doctor)"
        return dataclasses.replace(skin, kept_whole=missing)
    except MeshError as error:
        return dataclasses.replace(skin, kept_whole=str(error))
    return thinned


def skin_size(skin: Skin) -> float:
    """Return the diagonal of the box around a surface [m]."""
    return float(np.linalg.norm(np.ptp(skin.points, axis=0)))
