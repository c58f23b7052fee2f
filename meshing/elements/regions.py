"""The faces of a mesh's surface: planes, and what is smooth between sharp edges."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import (
    CadFace,
    FaceKind,
    FittedCylinder,
    Vector,
    fit_cylinder,
)
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.quality import facet_moments
from headstock.meshing.elements.surface import MeshSurface, corner_normals
from headstock.meshing.scipy_library import scipy

FLAT_COSINE = float(np.cos(np.radians(0.2)))
SHARP_COSINE = float(np.cos(np.radians(40.0)))
# of a cylinder's radius: how far its nodes may be off
ROUND_TOLERANCE = 1e-3
# nodes of a face that a cylinder is fitted to, which has five unknowns; and trials of the fit
FEWEST_ROUND, MOST_EVALUATIONS = 8, 60


def are_whole_faces(points: FloatArray, surface: MeshSurface, chosen: IntArray) -> bool:
    """Return whether facets fill faces of a surface: such areas end at edges of the part, however
    few facets there are.

    Args:
        points: Nodes ``(n_points, 3)``, in any unit.
    """
    owners = split_surface(points, surface)
    return len(np.unique(chosen)) == int(np.isin(owners, owners[chosen]).sum())


def split_surface(points: FloatArray, surface: MeshSurface) -> IntArray:
    """Return the number of the face that each facet belongs to, ``(n,)``, from 1 in the order of
    the facets.

    Facets in one plane make a face where at least one of them has no neighbour that is bent a
    little against it; of the others those make one that meet at less than 40 degrees. A fillet is
    thus apart from the planes that it joins, and a hole is one face.

    Args:
        points: Nodes ``(n_points, 3)``, in any unit.
    """
    corners = surface.facets[:, : surface.corners]
    left, right, cosine = _find_edges(points, surface)
    flat = cosine > FLAT_COSINE
    bent = ~flat & (cosine > SHARP_COSINE)
    curved = np.zeros(len(corners), dtype=bool)
    curved[left[bent]] = curved[right[bent]] = True
    areas = _connect(len(corners), left[flat], right[flat])
    is_plane = np.zeros(len(corners), dtype=bool)
    is_plane[areas[~curved]] = True
    on_plane = is_plane[areas]
    joined = flat | (bent & ~on_plane[left] & ~on_plane[right])
    groups = _connect(len(corners), left[joined], right[joined])
    _, starts, places = np.unique(groups, return_index=True, return_inverse=True)
    numbers = np.empty(len(starts), dtype=np.int64)
    numbers[np.argsort(starts)] = np.arange(1, len(starts) + 1)
    return numbers[places.ravel()]


def are_planes(points: FloatArray, surface: MeshSurface) -> bool:
    """Return whether facets between sharp edges lie in one plane: then the part has no curved
    faces.

    Args:
        points: Nodes ``(n_points, 3)``, in any unit; those between corners are taken as half-way.
    """
    _, _, cosine = _find_edges(points, surface)
    return bool(((cosine > FLAT_COSINE) | (cosine <= SHARP_COSINE)).all())


def _find_edges(points: FloatArray, surface: MeshSurface) -> tuple[IntArray, IntArray, FloatArray]:
    """Find the facets on either side of each edge of a surface, and the cosine of their angle."""
    corners = surface.facets[:, : surface.corners]
    normals = corner_normals(points, surface)
    sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    _, inverse, counts = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(inverse.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])[counts == 2]
    left, right = order[first] // surface.corners, order[first + 1] // surface.corners
    cosine = np.einsum("ij,ij->i", normals[left], normals[right])
    return left, right, cosine


def describe_faces(points: FloatArray, surface: MeshSurface, owners: IntArray) -> list[CadFace]:
    """Return what each face of a surface is, in the order of their numbers.

    Args:
        points: Nodes ``(n_points, 3)`` [m].
        owners: Number of the face of each facet, as ``split_surface`` gives them.
    """
    normals = corner_normals(points, surface)
    areas, centers = facet_moments(points, surface.facets)
    order = np.argsort(owners, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(owners)[1:])[:-1])
    return [
        _describe(
            number,
            points[np.unique(surface.facets[facets_of][:, : surface.corners])],
            normals[facets_of],
            areas[facets_of],
            centers[facets_of],
        )
        for number, facets_of in enumerate(members, 1)
    ]


def _describe(
    number: int, places: FloatArray, normals: FloatArray, areas: FloatArray, centers: FloatArray
) -> CadFace:
    """Return a face from its nodes ``(n, 3)`` and from normal, area and centre of its facets."""
    total = areas @ normals
    mean: FloatArray = np.asarray(total / (np.linalg.norm(total) or 1.0))
    kind: FaceKind = "freeform"
    axis: FloatArray = np.zeros(3)
    middle: FloatArray = np.zeros(3)
    radius, span, hollow = 0.0, (0.0, 0.0), False
    if (normals @ mean > FLAT_COSINE).all():
        kind = "plane"
    elif len(places) >= FEWEST_ROUND:
        cylinder = _refine_cylinder(places, fit_cylinder(places, normals))
        away = np.abs(_distances(places, cylinder) - cylinder.radius).max()
        if away < ROUND_TOLERANCE * cylinder.radius:
            kind, radius, axis, middle = "cylinder", cylinder.radius, cylinder.axis, cylinder.place
            heights = places @ axis
            span = (float(heights.min()), float(heights.max()))
            hollow = bool(areas @ np.einsum("ij,ij->i", normals, centers - middle) < 0.0)
    normal = mean if kind == "plane" else normals[int(np.argmax(areas))]
    return CadFace(
        number,
        kind,
        float(areas.sum()),
        _vector(areas @ centers / areas.sum()),
        _vector(normal),
        _vector(places.min(axis=0)),
        _vector(places.max(axis=0)),
        radius,
        _vector(axis),
        _vector(middle),
        span,
        hollow,
    )


def _distances(places: FloatArray, cylinder: FittedCylinder) -> FloatArray:
    """Return the distance ``(n,)`` of points from a cylinder's axis."""
    away = places - cylinder.place
    return np.asarray(np.linalg.norm(away - np.outer(away @ cylinder.axis, cylinder.axis), axis=1))


def _refine_cylinder(places: FloatArray, start: FittedCylinder) -> FittedCylinder:
    """Return the cylinder that lies best in points ``(n, 3)``: triangles on a cylinder look a
    little along its axis, so their normals give it roughly only.
    """
    across = np.linalg.svd(start.axis[None, :])[2][1:]

    def cylinder(values: FloatArray) -> FittedCylinder:
        axis = start.axis + values[:2] @ across
        on_axis = start.place + start.radius * (values[2:4] @ across)
        return FittedCylinder(axis / np.linalg.norm(axis), on_axis, start.radius * float(values[4]))

    def misses(values: FloatArray) -> FloatArray:
        fitted = cylinder(values)
        return np.asarray((_distances(places, fitted) - fitted.radius) / start.radius)

    first = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    return cylinder(scipy.optimize.least_squares(misses, first, max_nfev=MOST_EVALUATIONS).x)


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _connect(count: int, left: IntArray, right: IntArray) -> IntArray:
    graph = scipy.sparse.coo_array(
        (np.ones(len(left), dtype=np.int8), (left, right)), shape=(count, count)
    )
    return np.asarray(
        scipy.sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.int64
    )
