"""Area integrals over a patch of a mesh: nodes, weights, centroid, rigid motions."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.scipy_library import scipy

DEPENDENCE_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class MeshPatch:
    """A patch as the mesh sees it.

    Attributes:
        nodes: ``(n,)`` sorted mesh points of the patch.
        points: ``(n, 3)`` [m].
        weights: ``(n, n)`` consistent surface mass ``integral N_i N_j dA`` [m^2].
        normals: ``(n, 3)`` ``integral N_i n dA``, outward [m^2].
        area: [m^2]; zero for a forced point or line, whose nodes then weigh one each.
        centroid: ``(3,)`` [m].
    """

    name: str
    nodes: IntArray
    points: FloatArray
    weights: "scipy.sparse.csr_matrix"
    normals: FloatArray
    area: float
    centroid: FloatArray
    facet_count: int

    def rigid_displacements(self) -> FloatArray:
        """Return the displacements ``(3 n, 6)`` of the nodes under rigid motions about the
        centroid.
        """
        return rigid_map(self.points, self.centroid)

    def average_operator(self) -> FloatArray:
        """Return the matrix C ``(3 n, 6)`` whose ``C^T u`` is the weighted least-squares rigid
        motion of the patch about its centroid.

        Source: Kaufmann, Buxbaum and Lichtblau (2019) on RBE3; weights are areas, so ``C q`` is a
        linear traction.
        """
        rigid = self.rigid_displacements()
        weighted = np.zeros_like(rigid)
        for axis in range(3):
            weighted[axis::3] = self.weights @ rigid[axis::3]
        radius = np.sqrt(max(self._mean_square_radius(), np.finfo(float).tiny))
        scale = np.array([1.0] * 3 + [1.0 / radius] * 3)
        gram = scale[:, None] * (rigid.T @ weighted) * scale
        total = float(self.weights.sum())
        inverse = np.linalg.pinv(gram / total, rcond=DEPENDENCE_TOLERANCE, hermitian=True) / total
        return weighted @ (scale[:, None] * inverse * scale)

    def undetermined_rotations(self) -> FloatArray:
        """Return the rotation axes ``(k, 3)`` about which the patch's own nodes do not move: none
        for an area, one for a line, three for a point.
        """
        arms = self.points - self.centroid
        moments = arms.T @ arms
        inertia = np.trace(moments) * np.eye(3) - moments
        values, vectors = np.linalg.eigh(inertia)
        extent = max(float(values[-1]), np.finfo(float).tiny)
        return vectors[:, values <= DEPENDENCE_TOLERANCE * extent].T

    def _mean_square_radius(self) -> float:
        arms = self.points - self.centroid
        return float((self.weights @ arms * arms).sum() / self.weights.sum())


def measure_patch(mesh: ComponentMesh, name: str) -> MeshPatch:
    """Integrate over the facets of a patch group of a mesh.

    Raises:
        ValueError: The mesh has no such group or the group has no facets.
    """
    facets = mesh.patches.get(name)
    if facets is None or len(facets) == 0:
        raise ValueError(f"patch group {name!r} has no facets; groups: {sorted(mesh.patches)}")
    nodes, local = np.unique(facets, return_inverse=True)
    local = local.reshape(facets.shape)
    points = mesh.points[nodes]
    values, gradients, quadrature = _facet_rule(facets.shape[1])
    tangents = np.einsum("qkd,fkx->fqdx", gradients, points[local])
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    measure = np.linalg.norm(normal, axis=2) * quadrature
    element = np.einsum("qi,qj,fq->fij", values, values, measure)
    size = facets.shape[1]
    rows, columns = np.repeat(local, size, axis=1).ravel(), np.tile(local, (1, size)).ravel()
    weights = scipy.sparse.csr_matrix(
        (element.ravel(), (rows, columns)), shape=(len(nodes), len(nodes))
    )
    normals = np.zeros((len(nodes), 3))
    np.add.at(normals, local, np.einsum("qi,fqx,q->fix", values, normal, quadrature))
    area = float(measure.sum())
    if area <= (DEPENDENCE_TOLERANCE * float(np.ptp(mesh.points, axis=0).max())) ** 2:
        # a forced point or line: every node weighs the same
        return MeshPatch(
            name,
            nodes,
            points,
            scipy.sparse.identity(len(nodes), format="csr"),
            0.0 * points,
            0.0,
            points.mean(axis=0),
            0,
        )
    centroid = np.einsum("qk,fkx,fq->x", values, points[local], measure) / area
    return MeshPatch(name, nodes, points, weights, normals, area, centroid, len(facets))


def nodal_normals(mesh: ComponentMesh, name: str) -> tuple[IntArray, FloatArray]:
    """Return the sorted mesh points ``(n,)`` of a patch group and its outward unit normals
    ``(n, 3)`` at them, those of facets that meet averaged.
    """
    facets = mesh.patches[name]
    nodes, local = np.unique(facets, return_inverse=True)
    local = local.reshape(facets.shape)
    places, shapes = _FACET_NODES[facets.shape[1]]
    tangents = np.einsum("qkd,fkx->fqdx", shapes(np.array(places))[1], mesh.points[nodes][local])
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    normals = np.zeros((len(nodes), 3))
    np.add.at(normals, local, normal / np.linalg.norm(normal, axis=2, keepdims=True))
    return nodes, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _facet_rule(size: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the shape functions ``(q, n)``, their gradients ``(q, n, 2)`` and weights ``(q,)`` for
    a facet in gmsh node order.
    """
    weights: FloatArray
    if size in (3, 6):
        points, weights = _triangle_rule()
        values, gradients = (_tri3, _tri6)[size == 6](points)
    elif size in (4, 9):
        line, line_weights = np.polynomial.legendre.leggauss(4)
        points = np.array([[x, y] for x in line for y in line])
        weights = np.asarray(np.outer(line_weights, line_weights).ravel(), dtype=float)
        values, gradients = (_quad4, _quad9)[size == 9](points)
    else:
        raise ValueError(
            f"facets with {size} nodes are not supported; use tri3, tri6, quad4 or quad9"
        )
    return values, gradients, weights


def _triangle_rule() -> tuple[FloatArray, FloatArray]:
    """Return the conical product of Gauss rules on the unit triangle: degree 6 (Stroud 1971)."""
    line, weights = np.polynomial.legendre.leggauss(5)
    u, w = 0.5 * (line + 1.0), 0.5 * weights
    points = np.array([[a, (1.0 - a) * b] for a in u for b in u])
    return points, np.array([wa * wb * (1.0 - a) for a, wa in zip(u, w, strict=True) for wb in w])


def _tri3(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = points.T
    values = np.stack([1 - x - y, x, y], axis=1)
    return values, np.tile(np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]), (len(points), 1, 1))


def _tri6(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    corner, slope = _tri3(points)
    pairs = ((0, 1), (1, 2), (2, 0))
    values = [c * (2 * c - 1) for c in corner.T] + [
        4 * corner[:, i] * corner[:, j] for i, j in pairs
    ]
    gradients = [(4 * corner[:, i] - 1)[:, None] * slope[:, i] for i in range(3)]
    gradients += [
        4 * (corner[:, i, None] * slope[:, j] + corner[:, j, None] * slope[:, i]) for i, j in pairs
    ]
    return np.stack(values, axis=1), np.stack(gradients, axis=1)


def _quad4(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    x, y = points[:, :1] * signs[:, 0], points[:, 1:] * signs[:, 1]
    gradients = np.stack([signs[:, 0] * (1 + y), signs[:, 1] * (1 + x)], axis=2) / 4
    return (1 + x) * (1 + y) / 4, gradients


def _quad9(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    places = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)]

    def line(t: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
        if place == 0:
            return 1 - t * t, -2 * t
        return t * (t + place) / 2, t + place / 2

    values, gradients = [], []
    for px, py in places:
        (vx, dx), (vy, dy) = line(points[:, 0], px), line(points[:, 1], py)
        values.append(vx * vy)
        gradients.append(np.stack([dx * vy, vx * dy], axis=1))
    return np.stack(values, axis=1), np.stack(gradients, axis=1)


_CORNERS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
# by number of nodes: where they are, and the shape functions
_FACET_NODES = {
    3: (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), _tri3),
    6: (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)), _tri6),
    4: (_CORNERS, _quad4),
    9: ((*_CORNERS, (0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, 0.0)), _quad9),
}
