"""Patches on the surface of a finished mesh: named sets, facets at the ends of the bounding box, and
faces by their number.
"""

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.curved_patches import STEEPEST, lay_patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS, imprint_window, in_plane_axes
from headstock.geometry.parts.plane_shapes import flatten_patch, strip_direction
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
from headstock.meshing.scipy_library import scipy

PLANE_TOLERANCE = 1e-5
NORMAL_TOLERANCE = 1e-3
FACET_TOLERANCE = 0.1  # of the normals of facets, which are not those of the face they stand for


def select_facets(data: MeshData, surface: MeshSurface, patch: Patch) -> IntArray:
    """Return the indices of the surface facets of a patch; an imprint takes the facets whose middle
    lies inside it.

    Args:
        data: The mesh; its unit is that of the patch.

    Raises:
        MeshError: The patch names nothing that exists, or wraps around its face.
        ValueError: A strip runs along no axis in its face.
    """
    if patch.face.startswith("set:"):
        return _imprinted(
            data, surface, _named_facets(data, surface, patch.face.removeprefix("set:")), patch
        )
    if patch.face in FACE_DIRECTIONS:
        return _imprinted(data, surface, _end_facets(data.points, surface, patch.face), patch)
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
    """Return the nodes of a named node set, empty for any other patch."""
    return data.node_sets.get(
        _find(data.node_sets, patch.face.removeprefix("set:")) or "", np.zeros(0, dtype=np.int64)
    )


def _end_facets(points: FloatArray, surface: MeshSurface, face: str) -> IntArray:
    """Return the facets that lie in the plane at one end of the bounding box and face outward.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        face: ``x-`` to ``z+``.
    """
    axis, sign = FACE_DIRECTIONS[face]
    corners = surface.facets[:, : surface.corners]
    heights = sign * points[corners][:, :, axis]
    limit = heights.max() - PLANE_TOLERANCE * float(np.ptp(points, axis=0).max())
    outward = sign * corner_normals(points, surface)[:, axis] > 1.0 - NORMAL_TOLERANCE
    return np.flatnonzero((heights >= limit).all(axis=1) & outward)


def available_names(data: MeshData, surface: MeshSurface) -> str:
    """Return the names a patch of this mesh may use."""
    names = [face for face in FACE_DIRECTIONS if len(_end_facets(data.points, surface, face))]
    return (
        ", ".join([*names, *(f"set:{name}" for name in [*data.facets, *data.node_sets])]) or "none"
    )


def _named_facets(data: MeshData, surface: MeshSurface, name: str) -> IntArray:
    named = _find(data.facets, name)
    if named is not None:
        facets = data.facets[named]
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
    named = _find(data.node_sets, name)
    if named is not None:
        return facets_within(surface, data.node_sets[named])
    raise MeshError(f"there is no set {name!r}; available: {available_names(data, surface)}")


def _find(names: dict[str, IntArray], wanted: str) -> str | None:
    """Return a name as written, or else one that differs only in case (Abaqus ignores case)."""
    if wanted in names:
        return wanted
    return next((name for name in names if name.upper() == wanted.upper()), None)


def _imprinted(data: MeshData, surface: MeshSurface, facets: IntArray, patch: Patch) -> IntArray:
    """Return the facets whose middle lies inside an imprint.

    Raises:
        MeshError: The patch wraps around the face.
        ValueError: A strip runs along no axis in the face, a band goes around none.
    """
    if patch.shape == "whole" or not len(facets):
        return facets
    middles = data.points[surface.facets[facets][:, : surface.corners]].mean(axis=1)
    normals = corner_normals(data.points, surface)[facets]
    mean = normals.mean(axis=0)
    if float((normals @ mean).min()) < (1.0 - NORMAL_TOLERANCE) * float(mean @ mean):
        corners = surface.facets[facets][:, : surface.corners]
        return facets[_on_curved_face(corners, middles, normals, patch)]
    axis = int(np.argmax(np.abs(mean)))
    first, second = in_plane_axes(axis)
    plane = np.eye(3)[[first, second]]
    if patch.shape == "strip":
        strip_direction(patch, plane)
    if not patch.is_grid_aligned:
        offsets = (middles - np.array(patch.center)) @ plane.T
        return facets[flatten_patch(patch, plane).depths(offsets) >= 0.0]
    window = imprint_window(axis, patch)
    inside = (window[0] <= middles[:, first]) & (middles[:, first] <= window[1])
    return facets[inside & (window[2] <= middles[:, second]) & (middles[:, second] <= window[3])]


def _on_curved_face(
    corners: IntArray, middles: FloatArray, normals: FloatArray, patch: Patch
) -> IntArray:
    """Return which facets of a curved face an imprint takes: those under its outline that face the
    same way as its middle; of a strip or band also what is joined to that, however far it goes around.

    Args:
        corners: Nodes of the facets, ``(n, 3 or 4)``.
        middles: Of the facets, ``(n, 3)``.
        normals: Of the facets, ``(n, 3)``.
        patch: A part of the face.
    """
    center = np.array(patch.center)
    nearest = int(np.argmin(np.linalg.norm(middles - center, axis=1)))
    normal = normals[nearest]
    origin = center - ((center - middles[nearest]) @ normal) * normal
    laid = lay_patch(patch, origin, normal, middles, normals, tolerance=FACET_TOLERANCE)
    inside = laid.depths(middles) >= 0.0
    facing = laid.facing(middles, normals) > 0.0
    inside &= facing | (_joined(corners, inside, nearest) if laid.shape is None else False)
    if float(laid.gentleness(middles[inside], normals[inside]).min(initial=1.0)) < STEEPEST:
        raise MeshError(
            f"the {patch.shape} on face {patch.face!r} wraps around it; make it smaller, or name the whole face"
        )
    return np.flatnonzero(inside)


def _joined(corners: IntArray, chosen: NDArray[np.bool_], start: int) -> NDArray[np.bool_]:
    """Return which of chosen facets are joined to one of them by facets that are chosen."""
    nodes, places = np.unique(corners, return_inverse=True)
    places = places.reshape(corners.shape)
    rows = np.repeat(np.flatnonzero(chosen), corners.shape[1])
    graph = scipy.sparse.coo_array(
        (np.ones(len(rows)), (rows, len(corners) + places[chosen].ravel())),
        shape=(len(corners) + len(nodes),) * 2,
    )
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return chosen & (labels[: len(corners)] == labels[start])
