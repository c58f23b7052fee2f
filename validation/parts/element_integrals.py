"""Shape functions and integrals over second-order elements in plain numpy: a second road beside dolfinx."""

import functools
import itertools
from collections.abc import Callable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray

# gmsh's pairs of corners behind the middle nodes
HEX_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
HEX_EDGES = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7))
HEX_FACES = ((0, 1, 2, 3), (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))
TET_CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3))
_GAUSS_POINTS = 5


@functools.cache
def node_places(kind: CellKind) -> FloatArray:
    """Nodes ``(n, 3)`` of a reference element in gmsh's order; hexahedra on the unit cube, tetrahedra on the unit simplex."""
    hexahedral = kind.startswith("hex")
    corners = np.array(HEX_CORNERS if hexahedral else TET_CORNERS, dtype=float)
    groups = [*HEX_EDGES, *HEX_FACES, tuple(range(8))] if hexahedral else list(TET_EDGES)
    middles = [corners[list(group)].mean(axis=0) for group in groups]
    return np.vstack([corners, *middles])[: int(kind[3:])]


def shape_functions(kind: CellKind, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lagrange shape functions of a reference element and their gradients.

    Args:
        kind: Any cell kind but hex20.
        places: ``(m, 3)`` reference coordinates.

    Returns:
        ``(m, n)`` values and ``(m, n, 3)`` gradients.
    """
    inverse = np.linalg.inv(_monomials(kind, node_places(kind))[0])
    values, gradients = _monomials(kind, places)
    return values @ inverse, np.einsum("mkd,kn->mnd", gradients, inverse)


def integrate_over_cells(
    points: FloatArray, cells: IntArray, kind: CellKind, integrand: Callable[[FloatArray], FloatArray]
) -> float:
    """Integral of a function of position over isoparametric elements.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, n)``.
        kind: Cell kind.
        integrand: From ``(m, 3)`` positions to ``(m,)`` values.
    """
    places, weights = _gauss_rule(kind)
    values, gradients = shape_functions(kind, places)
    corners = points[cells]
    positions = np.einsum("qn,cnd->cqd", values, corners)
    jacobians = np.linalg.det(np.einsum("qnr,cnd->cqdr", gradients, corners))
    found = integrand(positions.reshape(-1, 3)).reshape(positions.shape[:2])
    return float(np.einsum("q,cq,cq->", weights, jacobians, found))


def field_error(
    points: FloatArray, cells: IntArray, kind: CellKind, field: FloatArray, exact: Callable[[FloatArray], FloatArray]
) -> float:
    """Relative L2 error of a nodal vector field against an exact one.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, n)``.
        kind: Cell kind.
        field: ``(n_points, 3)`` nodal values.
        exact: From ``(m, 3)`` positions to ``(m, 3)`` values.
    """
    places, weights = _gauss_rule(kind)
    values, gradients = shape_functions(kind, places)
    corners = points[cells]
    measure = weights * np.linalg.det(np.einsum("qnr,cnd->cqdr", gradients, corners))
    truth = exact(np.einsum("qn,cnd->cqd", values, corners).reshape(-1, 3)).reshape(len(cells), len(places), 3)
    difference = np.einsum("qn,cnd->cqd", values, field[cells]) - truth
    return float(np.sqrt(np.einsum("cq,cqd->", measure, difference**2) / np.einsum("cq,cqd->", measure, truth**2)))


def _monomials(kind: CellKind, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    order = 1 if kind in ("tet4", "hex8") else 2
    powers = np.array([
        power
        for power in itertools.product(range(order + 1), repeat=3)
        if kind.startswith("hex") or sum(power) <= order
    ])  # fmt: skip
    factors = places[:, None, :] ** powers[None, :, :]
    slopes = powers * places[:, None, :] ** np.maximum(powers - 1, 0)
    gradients = np.stack([np.prod(np.where(np.arange(3) == axis, slopes, factors), axis=-1) for axis in range(3)], axis=-1)
    return np.prod(factors, axis=-1), gradients


def _gauss_rule(kind: CellKind) -> tuple[FloatArray, FloatArray]:
    """Points ``(m, 3)`` and weights ``(m,)``; on the simplex by collapsing a cube (Duffy (1982))."""
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    line, weight = 0.5 * (nodes + 1.0), 0.5 * weights
    a, b, c = (grid.ravel() for grid in np.meshgrid(line, line, line, indexing="ij"))
    product = np.einsum("i,j,k->ijk", weight, weight, weight).ravel()
    if kind.startswith("hex"):
        return np.column_stack([a, b, c]), product
    places = np.column_stack([a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)])
    return places, product * (1.0 - a) ** 2 * (1.0 - b)
