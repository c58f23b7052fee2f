"""Tetrahedra that reach from one face of a wall to the other: how thick the wall is there, how long they are, how well they lie in it."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.quality import scaled_jacobians
from headstock.meshing.elements.surface import corner_normals, extract_surface

FACING = 0.5  # cosine between the wall's normal and that of a point on its face; of points at its rim it is 0.7


@dataclass(frozen=True, eq=False)
class FlatTets:
    """Tetrahedra that alone fill a wall.

    Attributes:
        cells: ``(n,)`` which cells of the mesh.
        thickness: ``(n,)`` of the wall at each [m].
        lengths: ``(n,)`` longest side of each along the wall [m].
        qualities: ``(n,)`` scaled Jacobian of each once its wall is drawn out as thick as the cell is long: what the flatness of the
            wall takes off is none of the mesh's doing.
    """

    cells: IntArray
    thickness: FloatArray
    lengths: FloatArray
    qualities: FloatArray


def find_flat_tets(points: FloatArray, corners: IntArray) -> FlatTets:
    """Find the tets whose corners all lie on two opposite faces of a wall thinner than they are long.

    Args:
        points: ``(n_points, 3)`` [m].
        corners: ``(n_cells, 4)``.
    """
    surface = extract_surface(corners, "tet4")
    normals = corner_normals(points, surface)
    sides = points[surface.facets]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    facing = np.zeros((len(points), 3))
    for corner in range(3):
        np.add.at(facing, surface.facets[:, corner], areas[:, None] * normals)
    sizes = np.linalg.norm(facing, axis=1, keepdims=True)
    facing /= np.where(sizes > 0.0, sizes, 1.0)
    cells = np.flatnonzero((sizes[corners, 0] > 0.0).all(axis=1))
    own = facing[corners[cells]]
    # the normal that the corners share up to its sign
    across = np.linalg.eigh(np.einsum("cni,cnj->cij", own, own))[1][:, :, 2]
    turned = np.einsum("cni,ci->cn", own, across)
    upper, lower = turned > FACING, turned < -FACING
    places = points[corners[cells]]
    heights = np.einsum("cni,ci->cn", places, across)
    top, bottom = upper.sum(axis=1), lower.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        thickness = (heights * upper).sum(axis=1) / top - (heights * lower).sum(axis=1) / bottom
    flat = places - heights[:, :, None] * across[:, None, :]
    lengths = np.linalg.norm(flat[:, :, None] - flat[:, None, :], axis=3).max(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        wall = (upper | lower).all(axis=1) & (top > 0) & (bottom > 0) & (thickness > 0.0) & (thickness < lengths)
    drawn = places + ((lengths / np.where(wall, thickness, 1.0) - 1.0)[:, None] * heights)[:, :, None] * across[:, None, :]
    drawn = drawn[wall]
    qualities = scaled_jacobians(drawn.reshape(-1, 3), np.arange(4 * len(drawn)).reshape(-1, 4), "tet4")
    return FlatTets(cells[wall], thickness[wall], lengths[wall], qualities)
