"""The visible surface of a component: of its mesh, or of the CAD or mesh file of one that is not
meshed.
"""

import dataclasses
import functools
import importlib
from typing import cast

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import find_ends
from headstock.geometry.parts.components import Component, Patch
from headstock.geometry.parts.curved_patches import lay_patch
from headstock.geometry.parts.skins import Skin, sharp_edges, solid_skin
from headstock.geometry.parts.solids import MeshFile, Solid, StepFile
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.components.meshing import read_mesh_file
from headstock.meshing.components.survey import CadSurvey, survey_step
from headstock.meshing.elements.surface import extract_surface, surface_triangles
from headstock.meshing.elements.topology import cell_order
from headstock.meshing.errors import MeshError
from headstock.meshing.files.patches import FACET_TOLERANCE, select_facets
from headstock.meshing.process.job import MeshData

SPLIT_BELOW = 800  # facets; curved facets of coarser surfaces are split through their mid-nodes
REDUCER = "headstock.meshing.components.reduced_skins"  # loads VTK
LARGEST_SKIN = 12_000  # triangles; finer surfaces are thinned out
FILES_KEPT = 8  # what was read of parts: their surface first, then their interfaces
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
        survey = _survey_step(solid, _read_time(solid))
        drawn = Skin(
            survey.points, survey.triangles, sharp_edges(survey.points, survey.triangles), "solid"
        )
        return thin_skin(drawn, largest=LARGEST_SKIN) if thinned else drawn
    if isinstance(solid, MeshFile):
        data = _read_mesh(solid, _read_time(solid))
        drawn = _boundary_skin(data.points, data.cells, cast(CellKind, data.kind))
        return dataclasses.replace(drawn, source="solid", nodes=None, weights=None)
    return solid_skin(solid)


def find_areas(component: Component) -> dict[str, FloatArray]:
    """Return the triangles ``(m, 3, 3)`` of each interface of a part from a STEP or mesh file, in the
    component frame [m]; none of other solids, and of an area that cannot be found, which ``check``
    reports.
    """
    solid, areas = component.solid, dict[str, FloatArray]()
    for name, interface in component.interfaces.items():
        try:
            parts = [_find_area(solid, patch) for patch in interface.patches]
        except (MeshError, ValueError):
            continue
        if sum(map(len, parts)):
            areas[name] = np.concatenate(parts)
    return areas


def _find_area(solid: Solid, patch: Patch) -> FloatArray:
    """Return the triangles ``(m, 3, 3)`` of a patch."""
    if isinstance(solid, StepFile):
        return _find_step_area(solid, patch)
    return _find_mesh_area(solid, patch) if isinstance(solid, MeshFile) else np.zeros((0, 3, 3))


def _find_step_area(solid: StepFile, patch: Patch) -> FloatArray:
    """Return the triangles ``(m, 3, 3)`` of a patch on a STEP part, clipped to its outline."""
    survey = _survey_step(solid, _read_time(solid))
    ends = {face.number for face in find_ends(survey.faces).get(patch.face, ())}
    numbers = ends or {int(patch.face.removeprefix("face:"))}
    corners = survey.points[survey.triangles[np.isin(survey.owners, list(numbers))]]
    if patch.shape == "whole" or not len(corners):
        return corners
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: FloatArray = across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    middles: FloatArray = np.asarray(corners.mean(axis=1), dtype=float)
    center = np.array(patch.center)
    nearest = int(np.argmin(np.linalg.norm(middles - center, axis=1)))
    normal = normals[nearest]
    origin = center - ((center - middles[nearest]) @ normal) * normal
    laid = lay_patch(patch, origin, normal, middles, normals, tolerance=FACET_TOLERANCE)
    facing = laid.facing(middles, normals) > 0.0
    return laid.clip(corners if laid.shape is None else corners[facing])


def _find_mesh_area(solid: MeshFile, patch: Patch) -> FloatArray:
    """Return the triangles ``(m, 3, 3)`` of the facets that a patch on a mesh file takes."""
    data = _read_mesh(solid, _read_time(solid))
    surface = extract_surface(data.cells, cast(CellKind, data.kind))
    triangles, facets = surface_triangles(surface)
    return data.points[triangles[np.isin(facets, select_facets(data, surface, patch))]]


def _read_time(solid: StepFile | MeshFile) -> int:
    """Return when the file of a part was changed [ns], so that what was read of it can be kept."""
    return solid.path.stat().st_mtime_ns if solid.path.exists() else 0


@functools.lru_cache(maxsize=FILES_KEPT)
def _survey_step(solid: StepFile, _: int) -> CadSurvey:
    return survey_step(solid)


@functools.lru_cache(maxsize=FILES_KEPT)
def _read_mesh(solid: MeshFile, _: int) -> MeshData:
    return read_mesh_file(solid, solid.path.name)


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
