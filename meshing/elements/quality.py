"""Jacobians of straight and curved elements: which are inverted, how good the worst is, and
integrals over a mesh.
"""

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.mass_properties import VolumeMoments
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import (
    cell_family,
    cell_order,
    cell_shape_functions,
    corner_count,
    reference_nodes,
    shape_gradients,
)

CHUNK = 20_000
DOUBTFUL_LATTICE = 12
HEX_LATTICE = 5
# along each side of a facet: gaps of second-order facets are of the fourth degree
PLACES = 3


def scaled_jacobians(points: FloatArray, cells: IntArray, kind: CellKind) -> FloatArray:
    """Return the quality of every cell: 1 for the ideal shape, <= 0 where det J vanishes anywhere
    in the cell.

    Straight tets: det J times sqrt(2) over the largest product of three edges meeting at a corner
    (Knupp 2000); times the smallest det J over that of the straight tet where curved. Hexes:
    smallest det J over the product of the lengths of the Jacobian's columns, or over the largest
    det J of the cell if that is less, on a 5 x 5 x 5 lattice that holds the corners.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, nodes per cell)``.

    Returns:
        ``(n_cells,)``.
    """
    if cell_family(kind) == "hex":
        return _by_chunks(_hex_quality, points, cells, kind)
    corners = points[cells[:, :4]]
    quality = _tet_quality(corners)
    if kind == "tet10":
        straight = _straight_determinants(corners)
        smallest = _by_chunks(_smallest_tet_determinant, points, cells, kind)
        with np.errstate(divide="ignore", invalid="ignore"):
            distortion = np.where(straight > 0.0, smallest / straight, -1.0)
        quality = np.where(distortion > 0.0, np.abs(quality), 1.0) * np.minimum(distortion, 1.0)
    return np.asarray(quality)


def integrate_mesh(points: FloatArray, cells: IntArray, kind: CellKind) -> VolumeMoments:
    """Return the volume, centre and inertia for unit density, integrated over the cells.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        cells: Nodes of each cell, ``(n_cells, k)``.
    """
    origin = points.mean(axis=0)  # far-off meshes would cancel otherwise
    nodes, weights = _quadrature(kind, 5)
    values = cell_shape_functions(kind, nodes)
    volume, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for start in range(0, len(cells), CHUNK):
        part = cells[start : start + CHUNK]
        measure = _jacobian_determinants(points, part, kind, nodes) * weights
        places = np.einsum("qn,cni->cqi", values, points[part] - origin)
        volume += float(measure.sum())
        first += np.einsum("cq,cqi->i", measure, places)
        second += np.einsum("cq,cqi,cqj->ij", measure, places, places, optimize=True)
    arm = first / volume
    moments = second - volume * np.outer(arm, arm)
    return VolumeMoments(volume, origin + arm, np.trace(moments) * np.eye(3) - moments)


def mesh_volume(points: FloatArray, cells: IntArray, kind: CellKind) -> float:
    """Return the volume of a mesh [m^3], exact for its (curved) elements.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        cells: Nodes of each cell, ``(n_cells, k)``.
    """
    nodes, weights = _quadrature(kind, 1 if kind == "tet4" else 3)
    return float(
        sum(
            (
                _jacobian_determinants(points, cells[start : start + CHUNK], kind, nodes) @ weights
            ).sum()
            for start in range(0, len(cells), CHUNK)
        )
    )


def facet_moments(points: FloatArray, facets: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the area and centroid of facets, integrated along curved ones.

    Args:
        points: ``(n_points, 3)`` [m].
        facets: ``(n, nodes per facet)`` in gmsh order.

    Returns:
        Scalar areas ``(n,)`` [m^2] and centroids ``(n, 3)`` [m].
    """
    values, gradients, weights = facet_tables(facets.shape[1])
    nodes = points[facets]
    tangents = np.matmul(gradients[:, None], nodes)
    measure = np.linalg.norm(np.cross(tangents[0], tangents[1]), axis=2) * weights
    areas = measure.sum(axis=1)
    spread = nodes - nodes.mean(axis=1, keepdims=True)
    places = np.matmul((measure @ values)[:, None], spread)[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        offsets = np.where(areas[:, None] > 0.0, places / areas[:, None], 0.0)
    return areas, nodes.mean(axis=1) + offsets


def _jacobian_determinants(
    points: FloatArray, cells: IntArray, kind: CellKind, samples: FloatArray
) -> FloatArray:
    """Return the Jacobian determinant of every cell ``(n_cells, n_samples)`` at reference points
    ``(n_samples, 3)``.

    Args:
        points: Nodes, ``(n, 3)`` [m].
        cells: Nodes of each cell, ``(n_cells, k)``.
        samples: Reference points, ``(n_samples, 3)``.
    """
    return _determinants(_jacobians(points, cells, kind, samples))


def _jacobians(
    points: FloatArray, cells: IntArray, kind: CellKind, samples: FloatArray
) -> FloatArray:
    nodes = points[cells]
    nodes = nodes - nodes[:, :1]
    gradients = shape_gradients(kind, samples)
    flat = gradients.reshape(-1, gradients.shape[2])
    columns = np.einsum("gn,cni->cgi", flat, nodes, optimize=True)
    return columns.reshape(len(cells), 3, len(samples), 3)


def _determinants(jacobians: FloatArray) -> FloatArray:
    a, b, c = jacobians[:, 0], jacobians[:, 1], jacobians[:, 2]
    return np.einsum("...i,...i->...", a, np.cross(b, c))


def _by_chunks(
    function: Callable[[FloatArray, IntArray, CellKind], FloatArray],
    points: FloatArray,
    cells: IntArray,
    kind: CellKind,
) -> FloatArray:
    parts = [
        function(points, cells[start : start + CHUNK], kind)
        for start in range(0, len(cells), CHUNK)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _straight_determinants(corners: FloatArray) -> FloatArray:
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    return np.einsum("ci,ci->c", a, np.cross(b, c))


def _tet_quality(corners: FloatArray) -> FloatArray:
    products = np.ones((len(corners), 4))
    for corner in range(4):
        for other in range(4):
            if other != corner:
                products[:, corner] *= np.linalg.norm(
                    corners[:, other] - corners[:, corner], axis=1
                )
    largest = products.max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(
            largest > 0.0, np.sqrt(2.0) * _straight_determinants(corners) / largest, 0.0
        )


def _smallest_tet_determinant(points: FloatArray, cells: IntArray, kind: CellKind) -> FloatArray:
    """Return the smallest det J of 10-node tets: a cubic, bounded below by its Bernstein
    coefficients (Johnen, Remacle, Geuzaine 2013).

    Where the bound is positive the smallest sampled value is returned; the doubtful rest is sampled
    on a fine lattice.
    """
    samples = _jacobian_determinants(points, cells, kind, _tet_lattice(3))
    smallest = samples.min(axis=1)
    doubtful = ((samples @ _bernstein_transform().T).min(axis=1) <= 0.0) & (smallest > 0.0)
    if doubtful.any():
        fine = _jacobian_determinants(points, cells[doubtful], kind, _tet_lattice(DOUBTFUL_LATTICE))
        smallest[doubtful] = np.minimum(smallest[doubtful], fine.min(axis=1))
    return np.asarray(smallest)


def _hex_quality(points: FloatArray, cells: IntArray, kind: CellKind) -> FloatArray:
    axis = np.linspace(-1.0, 1.0, HEX_LATTICE)
    samples = np.vstack(
        [np.array(list(product(axis, repeat=3))), reference_nodes(kind)[corner_count(kind) :]]
    )
    jacobians = _jacobians(points, cells, kind, samples)
    lengths = np.linalg.norm(jacobians, axis=3).prod(axis=1)
    determinants = _determinants(jacobians)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(lengths > 0.0, determinants / lengths, 0.0).min(axis=1)
        ratio = determinants.min(axis=1) / np.abs(determinants).max(axis=1)
    return np.fmin(scaled, ratio)


@cache
def _tet_lattice(order: int) -> FloatArray:
    return (
        np.array([p for p in product(range(order + 1), repeat=3) if sum(p) <= order], dtype=float)
        / order
    )


@cache
def _bernstein_transform() -> FloatArray:
    """Return the matrix ``(20, 20)`` from values on the cubic lattice to Bernstein coefficients."""
    lattice = _tet_lattice(3)
    factorial = np.array([1.0, 1.0, 2.0, 6.0])
    barycentric = np.column_stack([1.0 - lattice.sum(axis=1), lattice])
    powers = np.rint(3 * barycentric).astype(int)
    factors = 6.0 / factorial[powers].prod(axis=1)
    return np.linalg.inv(factors * np.prod(barycentric[:, None, :] ** powers[None, :, :], axis=2))


@cache
def _quadrature(kind: CellKind, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss rule with ``count`` points per direction on the tet (Stroud 1971)."""
    nodes, weights = np.polynomial.legendre.leggauss(
        count + (2 if cell_family(kind) == "hex" and cell_order(kind) == 2 else 1)
    )
    grid = np.array(list(product(nodes, repeat=3)))
    weight = np.array(list(product(weights, repeat=3))).prod(axis=1)
    if cell_family(kind) == "hex":
        return grid, weight
    u, v, w = ((grid + 1.0) / 2.0).T
    places = np.column_stack([u, v * (1.0 - u), w * (1.0 - u) * (1.0 - v)])
    return places, weight / 8.0 * (1.0 - u) ** 2 * (1.0 - v)


@cache
def facet_tables(node_count: int, places: int = 6) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the shape functions ``(q, n)``, gradients ``(2, q, n)`` and weights ``(q,)`` of tri3,
    tri6, quad4, quad8 and quad9 facets.

    Args:
        places: Gauss points along each side.
    """
    nodes, weights = np.polynomial.legendre.leggauss(places)
    grid = np.array(list(product(nodes, repeat=2)))
    weight = np.array(list(product(weights, repeat=2))).prod(axis=1)
    triangle = node_count in (3, 6)
    exponents = _facet_exponents(node_count)
    if triangle:
        u, v = ((grid + 1.0) / 2.0).T
        grid, weight = np.column_stack([u, v * (1.0 - u)]), weight / 4.0 * (1.0 - u)
        reference = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])[:node_count]
    else:
        corners = [[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0], [0, 0]]
        reference = np.array(corners, dtype=float)[:node_count]

    def monomials(points: FloatArray, derivative: int | None = None) -> FloatArray:
        result = np.ones((len(points), len(exponents)))
        for axis in range(2):
            power, column = exponents[:, axis], points[:, axis : axis + 1]
            result *= (
                power * column ** np.maximum(power - 1, 0) if axis == derivative else column**power
            )
        return result

    inverse = np.linalg.inv(monomials(reference))
    gradients = np.array([monomials(grid, axis) @ inverse for axis in range(2)])
    return monomials(grid) @ inverse, gradients, weight


def facet_places(points: FloatArray, facets: IntArray) -> FloatArray:
    """Return the quadrature places ``(n, q, 3)`` of facets."""
    values, _, _ = facet_tables(facets.shape[1], PLACES)
    return np.einsum("qn,fni->fqi", values, points[facets])


def _facet_exponents(node_count: int) -> IntArray:
    powers = np.array(list(product(range(3), repeat=2)))
    total, highest = powers.sum(axis=1), powers.max(axis=1)
    keep = {
        3: total <= 1,
        6: total <= 2,
        4: highest <= 1,
        8: np.where(powers == 1, 0, powers).sum(axis=1) <= 2,
        9: highest <= 2,
    }
    return powers[keep[node_count]]
