"""The surface of a mesh: outward boundary facets, connected parts, distance to curved faces, and
tets that alone fill a wall.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, CurvedFacets, IntArray, SurfaceGaps
from headstock.meshing.elements.quality import PLACES, facet_tables, scaled_jacobians
from headstock.meshing.elements.topology import FACETS, cell_family, corner_count, local_facets
from headstock.meshing.scipy_library import scipy

FARTHEST = 0.5  # of a facet's size: what lies farther off is another part of the face
TRUSTED = 0.25  # of the volume that the mesh misses, which the gaps must explain
# cosine between the wall's normal and that of a point on its face; of points at its rim it is 0.7
FACING = 0.5
# a facet's nodes in gmsh order: corners, mid-nodes of the edges (0 1) (1 2) (2 0) or (0 1) (1 2) (2
# 3) (3 0)
WHOLE = {3: ((0, 1, 2),), 4: ((0, 1, 2), (0, 2, 3))}
SPLIT = {
    3: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    4: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}


@dataclass(frozen=True, eq=False)
class MeshSurface:
    """Boundary facets of a mesh.

    Attributes:
        facets: ``(n, nodes per facet)`` outward, gmsh order.
        corners: Number of corner nodes per facet, 3 or 4.
    """

    facets: IntArray
    corners: int


def extract_surface(cells: IntArray, kind: CellKind) -> MeshSurface:
    """Return the facets that belong to one cell only, in the order of the cells."""
    local = local_facets(kind)
    corners = len(FACETS[cell_family(kind)][0])
    every = cells[:, local].reshape(-1, local.shape[1])
    keys = np.sort(every[:, :corners], axis=1)
    order = np.lexsort(keys.T)
    new = np.concatenate([[True], np.diff(keys[order], axis=0).any(axis=1), [True]])
    return MeshSurface(every[np.sort(order[new[:-1] & new[1:]])], corners)


def match_facets(surface: MeshSurface, facets: IntArray) -> tuple[IntArray, int]:
    """Return the surface facets with the same corners as ``facets``, and how many of ``facets`` are
    not on the surface.

    Args:
        facets: ``(n, >= corners)``, corners first, in any orientation.

    Returns:
        Sorted indices into ``surface.facets`` without repetition, and the number of facets without
        a partner.
    """
    table = _pack(np.sort(surface.facets[:, : surface.corners], axis=1))
    wanted = np.unique(_pack(np.sort(facets[:, : surface.corners], axis=1)))
    on_surface = np.isin(table, wanted)
    return np.flatnonzero(on_surface), len(wanted) - int(on_surface.sum())


def find_facets(surface: MeshSurface, facets: IntArray) -> IntArray:
    """Find the index of the surface facet with the same corners for each of ``facets``, which all
    lie on the surface.
    """
    table = _pack(np.sort(surface.facets[:, : surface.corners], axis=1))
    order = np.argsort(table)
    wanted = _pack(np.sort(facets[:, : surface.corners], axis=1))
    return order[np.searchsorted(table, wanted, sorter=order)]


def facets_within(surface: MeshSurface, nodes: IntArray) -> IntArray:
    """Return the indices of the surface facets all of whose corners are among ``nodes``."""
    return np.flatnonzero(np.isin(surface.facets[:, : surface.corners], nodes).all(axis=1))


def corner_normals(points: FloatArray, surface: MeshSurface) -> FloatArray:
    """Return the unit outward normals ``(n, 3)`` of facets from their corners."""
    corners = points[surface.facets[:, : surface.corners]]
    if surface.corners == 3:
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0.0, lengths, 1.0)


def count_parts(cells: IntArray, kind: CellKind, n_points: int) -> tuple[int, IntArray]:
    """Return the number of parts of a mesh that share no node, and the part of each cell
    ``(n_cells,)``.

    Args:
        cells: Nodes of each cell, ``(n_cells, k)``.
    """
    corners = cells[:, : corner_count(kind)]
    rows = np.repeat(corners[:, 0], corners.shape[1] - 1)
    graph = scipy.sparse.coo_array(
        (np.ones(len(rows), dtype=np.int8), (rows, corners[:, 1:].ravel())),
        shape=(n_points, n_points),
    )
    _, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    parts, cell_parts = np.unique(labels[corners[:, 0]], return_inverse=True)
    return len(parts), cell_parts


def _pack(keys: IntArray) -> IntArray:
    """Return each row of sorted node numbers as one sortable value."""
    rows = np.ascontiguousarray(keys.astype(np.int64))
    return rows.view([("", np.int64)] * rows.shape[1]).ravel()


def measure_gaps(points: FloatArray, surface: MeshSurface, curved: CurvedFacets) -> SurfaceGaps:
    """Return the signed heights of CAD faces over the facets that stand for them.

    Args:
        points: ``(n_points, 3)`` of the mesh as it is used [m], repaired.
    """
    values, gradients, weights = facet_tables(curved.nodes.shape[1], PLACES)
    nodes = points[curved.nodes]
    first, second = np.einsum("aqn,fni->afqi", gradients, nodes)
    normals = np.cross(first, second)
    areas = np.linalg.norm(normals, axis=2)
    outward = corner_normals(points, surface)[find_facets(surface, curved.nodes)]
    normals *= (
        np.sign(np.einsum("fqi,fi->fq", normals, outward))[:, :, None]
        / np.where(areas > 0.0, areas, 1.0)[:, :, None]
    )
    heights = np.einsum(
        "fqi,fqi->fq", curved.nearest - np.einsum("qn,fni->fqi", values, nodes), normals
    )
    far = np.abs(heights) > FARTHEST * np.sqrt((areas * weights).sum(axis=1))[:, None]
    volumes = np.where(far, 0.0, heights) * areas * weights * curved.shares[:, None]
    return SurfaceGaps(curved.nodes, volumes)


def gaps_agree(gaps: SurfaceGaps, volume: float, cad_volume: float) -> bool:
    """Return whether the gaps add up to the volume that a mesh misses of its part; roundoff is no
    disagreement.

    Args:
        gaps: Between the mesh and the faces of its part.
        volume: Of the mesh [m^3].
        cad_volume: Of the part [m^3].
    """
    missing = cad_volume - volume
    return bool(
        abs(float(gaps.volumes.sum()) - missing)
        <= TRUSTED * np.abs(gaps.volumes).sum() + 1e-7 * cad_volume
    )


@dataclass(frozen=True, eq=False)
class FlatTets:
    """Tetrahedra that alone fill a wall.

    Attributes:
        cells: ``(n,)`` which cells of the mesh.
        thickness: ``(n,)`` of the wall at each [m].
        lengths: ``(n,)`` longest side of each along the wall [m].
        qualities: ``(n,)`` scaled Jacobian of each once its wall is drawn out as thick as the cell
            is long: what the flatness of the wall takes off is none of the mesh's doing.
    """

    cells: IntArray
    thickness: FloatArray
    lengths: FloatArray
    qualities: FloatArray


def find_flat_tets(points: FloatArray, corners: IntArray) -> FlatTets:
    """Find the tets whose corners all lie on two opposite faces of a wall thinner than they are
    long.

    Args:
        points: ``(n_points, 3)`` [m].
        corners: ``(n_cells, 4)``.
    """
    surface = extract_surface(corners, "tet4")
    normals = corner_normals(points, surface)
    sides = points[surface.facets]
    areas = 0.5 * np.linalg.norm(
        np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1
    )
    facing = np.zeros((len(points), 3))
    for corner in range(3):
        np.add.at(facing, surface.facets[:, corner], areas[:, None] * normals)
    sizes = np.linalg.norm(facing, axis=1, keepdims=True)
    facing /= np.where(sizes > 0.0, sizes, 1.0)
    cells = np.flatnonzero((sizes[corners, 0] > 0.0).all(axis=1))
    cell_sides = facing[corners[cells]]
    # the normal that the corners share up to its sign
    across = np.linalg.eigh(np.einsum("cni,cnj->cij", cell_sides, cell_sides))[1][:, :, 2]
    turned = np.einsum("cni,ci->cn", cell_sides, across)
    upper, lower = turned > FACING, turned < -FACING
    places = points[corners[cells]]
    heights = np.einsum("cni,ci->cn", places, across)
    top, bottom = upper.sum(axis=1), lower.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        thickness = (heights * upper).sum(axis=1) / top - (heights * lower).sum(axis=1) / bottom
    flat = places - heights[:, :, None] * across[:, None, :]
    lengths = np.linalg.norm(flat[:, :, None] - flat[:, None, :], axis=3).max(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        wall = (
            (upper | lower).all(axis=1)
            & (top > 0)
            & (bottom > 0)
            & (thickness > 0.0)
            & (thickness < lengths)
        )
    drawn = (
        places
        + ((lengths / np.where(wall, thickness, 1.0) - 1.0)[:, None] * heights)[:, :, None]
        * across[:, None, :]
    )
    drawn = drawn[wall]
    qualities = scaled_jacobians(
        drawn.reshape(-1, 3), np.arange(4 * len(drawn)).reshape(-1, 4), "tet4"
    )
    return FlatTets(cells[wall], thickness[wall], lengths[wall], qualities)


def surface_triangles(surface: MeshSurface, *, split: bool = False) -> tuple[IntArray, IntArray]:
    """Return the triangles ``(m, 3)`` of a surface, and the facet of each.

    Args:
        split: Facets through their mid-nodes, too; else between their corners.
    """
    local = np.array((SPLIT if split else WHOLE)[surface.corners])
    facets = np.repeat(np.arange(len(surface.facets)), len(local))
    return np.asarray(surface.facets[:, local].reshape(-1, 3)), facets
