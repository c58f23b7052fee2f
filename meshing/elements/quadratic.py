"""Second-order tets raised from straight ones and repaired where inverted; serendipity hexes
completed to full ones.
"""

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.quality import scaled_jacobians
from headstock.meshing.elements.topology import EDGES, FACETS, cell_family, cell_order, corner_count

HALVINGS = 3
REPAIR_ROUNDS = 40
REPAIR_FLOOR = 0.01
FACES, PAIRS = FACETS["hex"], EDGES["hex"]


def elevate_tets(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the 10-node tets with exactly centred mid-nodes from 4-node tets; new points follow
    the old ones.
    """
    edges = cells[:, np.array(EDGES["tet"])]
    low, high = edges.min(axis=2), edges.max(axis=2)
    keys, inverse = np.unique(low.astype(np.int64) * len(points) + high, return_inverse=True)
    mids = (points[keys // len(points)] + points[keys % len(points)]) / 2
    return np.vstack([points, mids]), np.hstack([cells, len(points) + inverse.reshape(low.shape)])


def repair_tets(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the points ``(n, 3)`` in which curved 10-node tets below the repair floor have been
    straightened, and which cells were.

    The mid-nodes of a bad tet move half-way to the middle of their edges, up to three times, then
    all the way; neighbours that turn bad by it are treated in the next round. Straight tets that
    are bad stay as they are.
    """
    points = points.copy()
    edges = np.array(EDGES["tet"])
    hits = np.zeros(len(points), dtype=np.int64)
    repaired = np.zeros(len(cells), dtype=bool)
    active = np.arange(len(cells))
    order = np.argsort(cells.ravel(), kind="stable")
    starts = np.searchsorted(cells.ravel()[order], np.arange(len(points) + 1))
    owners = order // cells.shape[1]
    for _ in range(REPAIR_ROUNDS):
        bad = active[scaled_jacobians(points, cells[active], "tet10") < REPAIR_FLOOR]
        nodes, first = np.unique(cells[bad, 4:], return_index=True)
        ends = cells[bad][:, edges].reshape(-1, 2)[first]
        middles = points[ends].mean(axis=1)
        movable = hits[nodes] <= HALVINGS
        if not movable.any():
            break
        repaired[bad[np.isin(cells[bad, 4:], nodes[movable]).any(axis=1)]] = True
        nodes, middles = nodes[movable], middles[movable]
        share = np.where(hits[nodes] < HALVINGS, 0.5, 1.0)[:, None]
        points[nodes] += share * (middles - points[nodes])
        hits[nodes] += 1
        active = np.unique(
            np.concatenate([owners[starts[node] : starts[node + 1]] for node in nodes])
        )
    return points, np.flatnonzero(repaired)


def is_straight(
    points: FloatArray, cells: IntArray, kind: CellKind, tolerance: float = 1e-12
) -> bool:
    """Return whether every cell of a mesh is straight, see ``straight_cells``.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        cells: Nodes of each cell, ``(n_cells, k)``.
        tolerance: Share of the size of the mesh.
    """
    return bool(straight_cells(points, cells, kind, tolerance).all())


def straight_cells(
    points: FloatArray, cells: IntArray, kind: CellKind, tolerance: float = 1e-12
) -> NDArray[np.bool_]:
    """Return the cells ``(n_cells,)`` whose every mid-node sits at the mean of its corners, to
    ``tolerance`` times the size of the mesh.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        cells: Nodes of each cell, ``(n_cells, k)``.
        tolerance: Share of the size of the mesh.
    """
    away = np.zeros(len(cells))
    if cell_order(kind) > 1:
        family, first = cell_family(kind), corner_count(kind)
        groups: list[tuple[int, ...]] = list(EDGES[family])
        if kind == "hex27":
            groups += [*FACETS[family], tuple(range(8))]
        for i, group in enumerate(groups):
            middle = points[cells[:, list(group)]].mean(axis=1)
            away = np.maximum(away, np.abs(points[cells[:, first + i]] - middle).max(axis=1))
    return away <= tolerance * float(np.ptp(points, axis=0).max())


def complete_hexes(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the twenty-node hexahedra as 27-node ones of the same shape.

    The new nodes lie where the 20-node map puts face and body centres, so geometry and boundary
    stay what they were.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, 20)`` in gmsh's order.

    Returns:
        Points with face and body centres appended, and cells ``(n_cells, 27)`` in gmsh's order.

    Source: Zienkiewicz and Taylor (2000), vol. 1, ch. 8, shape functions of the 20-node brick.
    """
    faces = np.concatenate([np.sort(cells[:, face], axis=1) for face in FACES])
    _, first, number = np.unique(faces, axis=0, return_index=True, return_inverse=True)
    centers = np.concatenate([_face_centers(points, cells, face) for face in FACES])[first]
    bodies = -0.25 * points[cells[:, :8]].sum(axis=1) + 0.25 * points[cells[:, 8:20]].sum(axis=1)
    on_faces = len(points) + number.reshape(len(FACES), len(cells)).T
    inside = len(points) + len(centers) + np.arange(len(cells))[:, None]
    return np.vstack([points, centers, bodies]), np.hstack([cells, on_faces, inside]).astype(
        np.int64
    )


def _face_centers(points: FloatArray, cells: IntArray, face: tuple[int, ...]) -> FloatArray:
    edges = [8 + number for number, edge in enumerate(PAIRS) if set(edge) <= set(face)]
    return -0.25 * points[cells[:, list(face)]].sum(axis=1) + 0.5 * points[cells[:, edges]].sum(
        axis=1
    )
