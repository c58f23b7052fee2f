"""Serendipity hexahedra completed to full second-order ones, which is what the displacement field lives on."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.topology import EDGES, FACETS

FACES, PAIRS = FACETS["hex"], EDGES["hex"]


def complete_hexes(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray]:
    """Twenty-node hexahedra as 27-node ones of the same shape.

    The new nodes lie where the 20-node map puts face and body centres, so geometry and boundary stay what they were.

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
    return np.vstack([points, centers, bodies]), np.hstack([cells, on_faces, inside]).astype(np.int64)


def _face_centers(points: FloatArray, cells: IntArray, face: tuple[int, ...]) -> FloatArray:
    edges = [8 + number for number, edge in enumerate(PAIRS) if set(edge) <= set(face)]
    return np.asarray(-0.25 * points[cells[:, list(face)]].sum(axis=1) + 0.5 * points[cells[:, edges]].sum(axis=1))
