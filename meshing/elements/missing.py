"""In which cells of a mesh the small features lie that it lacks."""

import numpy as np
from scipy.spatial import KDTree

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray, LeftOut, MissingVolumes
from headstock.meshing.elements.topology import shape_functions

CANDIDATES = 60  # cells with the nearest middles, of which one holds a point or is closest to it
# weights along the depth: through a wall in bending the density of energy is a parabola
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0


def place_features(
    points: FloatArray, cells: IntArray, kind: CellKind, left_out: LeftOut
) -> MissingVolumes:
    """Return the features shared out among the cells that hold their ends and middles.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, nodes per cell)`` tetrahedra.
        left_out: The features [m].
    """
    places = left_out.places.reshape(-1, 3)
    corners = points[cells[:, :4]]
    candidates = np.atleast_2d(
        KDTree(corners.mean(axis=1)).query(places, k=min(CANDIDATES, len(cells)))[1]
    ).reshape(len(places), -1)
    edges = (corners[:, 1:] - corners[:, :1])[candidates]
    inside = np.linalg.solve(
        edges.swapaxes(2, 3), (places[:, None] - corners[candidates, 0])[..., None]
    )[..., 0]
    shares = np.concatenate([1.0 - inside.sum(axis=2, keepdims=True), inside], axis=2)
    best = shares.min(axis=2).argmax(axis=1)
    rows = np.arange(len(places))
    # pads and what curved faces leave outside count at the nearest place inside
    nearest = np.maximum(shares[rows, best], 0.0)
    nearest /= nearest.sum(axis=1, keepdims=True)
    volumes = (left_out.volumes[:, None] * SIMPSON).ravel()
    return MissingVolumes(
        candidates[rows, best],
        shape_functions(kind, nearest[:, 1:]),
        volumes,
        np.repeat(left_out.strengths, len(SIMPSON)),
    )
