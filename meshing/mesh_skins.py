"""The visible surface of a component's mesh, fine enough for pictures and small enough to mail."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.skins import Skin, sharp_edges
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.element_topology import cell_order
from headstock.meshing.mesh_surface import MeshSurface, extract_surface

SPLIT_BELOW = 800  # facets; curved facets of coarser surfaces are split through their mid-nodes
LARGEST_SKIN = 16_000  # triangles
# a facet's nodes in gmsh order: corners, mid-nodes of the edges (0 1) (1 2) (2 0) or (0 1) (1 2) (2 3) (3 0)
WHOLE = {3: ((0, 1, 2),), 4: ((0, 1, 2), (0, 2, 3))}
SPLIT = {
    3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    4: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}


def mesh_skin(mesh: ComponentMesh) -> Skin:
    """Boundary triangles of a mesh; those of very fine meshes are merged on a grid."""
    surface = extract_surface(mesh.cells, mesh.kind)
    triangles = _triangles(surface, split=cell_order(mesh.kind) == 2 and len(surface.facets) <= SPLIT_BELOW)
    if len(triangles) > LARGEST_SKIN:
        triangles = _merge_points(mesh.points, triangles)
    nodes, flat = np.unique(triangles, return_inverse=True)
    points, triangles = mesh.points[nodes], flat.reshape(-1, 3)
    return Skin(points, triangles, sharp_edges(points, triangles), "mesh", nodes)


def _triangles(surface: MeshSurface, *, split: bool) -> IntArray:
    local = np.array((SPLIT if split else WHOLE)[surface.corners])
    return np.asarray(surface.facets[:, local].reshape(-1, 3))


def _merge_points(points: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles between one mesh point per cell of a grid (Rossignac and Borrel 1993), the finest that is small enough."""
    used = np.unique(triangles)
    low, extent = points[used].min(axis=0), float(np.ptp(points[used], axis=0).max())
    kept = triangles
    cells = 256.0
    while len(kept) > LARGEST_SKIN:
        grid = np.floor((points[used] - low) * (cells / extent)).astype(np.int64)
        _, first, inverse = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        place = np.zeros(len(points), dtype=np.int64)
        place[used] = used[first][inverse.ravel()]
        merged = place[triangles]
        whole = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
        _, unique = np.unique(np.sort(merged[whole], axis=1), axis=0, return_index=True)
        kept = merged[whole][np.sort(unique)]
        cells *= 0.8
    return kept
