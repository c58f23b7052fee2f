"""How far the curved faces of a part lie from its mesh: elements cut them short."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CurvedFacets, IntArray, SurfaceGaps
from headstock.meshing.elements.quality import facet_tables
from headstock.meshing.elements.surface import MeshSurface, corner_normals, find_facets

PLACES = 3  # places along each side of a facet: gaps of second-order facets are of the fourth degree
FARTHEST = 0.5  # of a facet's size: what lies farther off is another part of the face
TRUSTED = 0.25  # of the volume that the mesh misses, which the gaps must tell to


def facet_places(points: FloatArray, facets: IntArray) -> FloatArray:
    """Quadrature places ``(n, q, 3)`` of facets."""
    values, _, _ = facet_tables(facets.shape[1], PLACES)
    return np.asarray(np.einsum("qn,fni->fqi", values, points[facets]))


def measure_gaps(points: FloatArray, surface: MeshSurface, curved: CurvedFacets) -> SurfaceGaps:
    """Signed heights of CAD faces over the facets that stand for them.

    Args:
        points: ``(n_points, 3)`` of the mesh as it is used [m], repaired.
        surface: Its boundary.
        curved: Facets on curved faces.
    """
    values, gradients, weights = facet_tables(curved.nodes.shape[1], PLACES)
    nodes = points[curved.nodes]
    first, second = np.einsum("aqn,fni->afqi", gradients, nodes)
    normals = np.cross(first, second)
    areas = np.linalg.norm(normals, axis=2)
    outward = corner_normals(points, surface)[find_facets(surface, curved.nodes)]
    normals *= np.sign(np.einsum("fqi,fi->fq", normals, outward))[:, :, None] / np.where(areas > 0.0, areas, 1.0)[:, :, None]
    heights = np.einsum("fqi,fqi->fq", curved.nearest - np.einsum("qn,fni->fqi", values, nodes), normals)
    far = np.abs(heights) > FARTHEST * np.sqrt((areas * weights).sum(axis=1))[:, None]
    volumes = np.where(far, 0.0, heights) * areas * weights * curved.shares[:, None]
    return SurfaceGaps(curved.nodes, volumes)


def gaps_agree(gaps: SurfaceGaps, volume: float, cad_volume: float) -> bool:
    """Whether the gaps add up to the volume that a mesh misses of its part; roundoff is no disagreement."""
    missing = cad_volume - volume
    return bool(abs(float(gaps.volumes.sum()) - missing) <= TRUSTED * np.abs(gaps.volumes).sum() + 1e-7 * cad_volume)
