"""Patches on the surface of a finished mesh: named sets, facets at the ends of the bounding box, and
faces by their number.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS, imprint_window, in_plane_axes
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.regions import split_surface
from headstock.meshing.elements.surface import (
    MeshSurface,
    corner_normals,
    facets_within,
    match_facets,
)
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshData

PLANE_TOLERANCE = 1e-5
NORMAL_TOLERANCE = 1e-3


def select_facets(data: MeshData, surface: MeshSurface, patch: Patch) -> IntArray:
    """Indices of the surface facets of a patch; an imprint takes the facets whose middle lies
    inside it.

    Args:
        data: The mesh; its unit is that of the patch.
        surface: Its boundary facets.
        patch: What to select.

    Raises:
        MeshError: The patch names nothing that exists.
    """
    if patch.face.startswith("set:"):
        return _imprinted(
            data, surface, _named_facets(data, surface, patch.face.removeprefix("set:")), patch
        )
    if patch.face in FACE_DIRECTIONS:
        return _imprinted(data, surface, end_facets(data.points, surface, patch.face), patch)
    if patch.face.startswith("face:"):
        owners = split_surface(data.points, surface)
        chosen = np.flatnonzero(owners == int(patch.face.removeprefix("face:")))
        if len(chosen):
            return _imprinted(data, surface, chosen, patch)
        raise MeshError(
            f"there is no face {patch.face!r}: the surface has {owners.max()}, which headstock show numbers; "
            f"available: {available_names(data, surface)}"
        )
    raise MeshError(
        f"face {patch.face!r} selects nothing on a mesh file; available: {available_names(data, surface)}"
    )


def set_nodes(data: MeshData, patch: Patch) -> IntArray:
    """Nodes of a named node set, empty for any other patch."""
    return data.node_sets.get(
        _find(data.node_sets, patch.face.removeprefix("set:")) or "", np.zeros(0, dtype=np.int64)
    )


def end_facets(points: FloatArray, surface: MeshSurface, face: str) -> IntArray:
    """Facets that lie in the plane at one end of the bounding box and face outward.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        surface: Of the mesh.
        face: ``x-`` to ``z+``.
    """
    axis, sign = FACE_DIRECTIONS[face]
    corners = surface.facets[:, : surface.corners]
    heights = sign * points[corners][:, :, axis]
    limit = heights.max() - PLANE_TOLERANCE * float(np.ptp(points, axis=0).max())
    outward = sign * corner_normals(points, surface)[:, axis] > 1.0 - NORMAL_TOLERANCE
    return np.flatnonzero((heights >= limit).all(axis=1) & outward)


def available_names(data: MeshData, surface: MeshSurface) -> str:
    """The names a patch of this mesh may use."""
    names = [face for face in FACE_DIRECTIONS if len(end_facets(data.points, surface, face))]
    return (
        ", ".join([*names, *(f"set:{name}" for name in [*data.facets, *data.node_sets])]) or "none"
    )


def _named_facets(data: MeshData, surface: MeshSurface, name: str) -> IntArray:
    found = _find(data.facets, name)
    if found is not None:
        facets = data.facets[found]
        if facets.shape[1] != surface.corners or (facets < 0).any():
            raise MeshError(
                f"set {name!r} holds surface elements that are not faces of the solid cells"
            )
        matched, missing = match_facets(surface, facets)
        if missing:
            raise MeshError(
                f"{missing} of {len(facets)} facets of set {name!r} are not on the surface of the mesh"
            )
        return matched
    found = _find(data.node_sets, name)
    if found is not None:
        return facets_within(surface, data.node_sets[found])
    raise MeshError(f"there is no set {name!r}; available: {available_names(data, surface)}")


def _find(names: dict[str, IntArray], wanted: str) -> str | None:
    """A name as written, or else one that differs only in case (Abaqus ignores case)."""
    if wanted in names:
        return wanted
    return next((name for name in names if name.upper() == wanted.upper()), None)


def _imprinted(data: MeshData, surface: MeshSurface, facets: IntArray, patch: Patch) -> IntArray:
    if patch.shape == "whole" or not len(facets):
        return facets
    middles = data.points[surface.facets[facets][:, : surface.corners]].mean(axis=1)
    normal = np.abs(corner_normals(data.points, surface)[facets].mean(axis=0))
    axis = int(np.argmax(normal))
    first, second = in_plane_axes(axis)
    if patch.shape == "disk":
        radius = np.hypot(
            middles[:, first] - patch.center[first], middles[:, second] - patch.center[second]
        )
        return np.asarray(facets[radius <= patch.size[0] / 2])
    window = imprint_window(axis, patch)
    inside = (window[0] <= middles[:, first]) & (middles[:, first] <= window[1])
    return np.asarray(
        facets[inside & (window[2] <= middles[:, second]) & (middles[:, second] <= window[3])]
    )
