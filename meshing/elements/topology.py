"""Local numbering of the five cell kinds, in gmsh's order: edges, outward facets, reference nodes
and shape functions.

Source: gmsh reference manual, section "Node ordering".
"""

from functools import cache
from itertools import product
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray

Family = Literal["tet", "hex"]
EDGES: dict[Family, tuple[tuple[int, int], ...]] = {
    "tet": ((0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3)),
    "hex": (
        (0, 1),
        (0, 3),
        (0, 4),
        (1, 2),
        (1, 5),
        (2, 3),
        (2, 6),
        (3, 7),
        (4, 5),
        (4, 7),
        (5, 6),
        (6, 7),
    ),
}
FACETS: dict[Family, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    "hex": ((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
}
NODE_COUNTS: dict[CellKind, int] = {"tet4": 4, "tet10": 10, "hex8": 8, "hex20": 20, "hex27": 27}
CORNERS: dict[Family, FloatArray] = {
    "tet": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float),
    "hex": np.array(
        [
            [-1, -1, -1],
            [1, -1, -1],
            [1, 1, -1],
            [-1, 1, -1],
            [-1, -1, 1],
            [1, -1, 1],
            [1, 1, 1],
            [-1, 1, 1],
        ],
        dtype=float,
    ),
}


def cell_family(kind: CellKind) -> Family:
    """Return ``tet`` or ``hex``."""
    return "tet" if kind.startswith("tet") else "hex"


def cell_order(kind: CellKind) -> int:
    """Return the polynomial order of a cell kind: 1 or 2."""
    return 1 if kind in ("tet4", "hex8") else 2


def corner_count(kind: CellKind) -> int:
    """Return the number of corner nodes of a cell."""
    return 4 if cell_family(kind) == "tet" else 8


@cache
def local_facets(kind: CellKind) -> IntArray:
    """Return local nodes of each facet, outward, ``(n_facets, nodes per facet)``, gmsh's order."""
    family = cell_family(kind)
    if cell_order(kind) == 1:
        return np.array(FACETS[family])
    first = corner_count(kind)
    middle = {frozenset(edge): first + i for i, edge in enumerate(EDGES[family])}
    rows = []
    for i, facet in enumerate(FACETS[family]):
        mids = [
            middle[frozenset((facet[k], facet[(k + 1) % len(facet)]))] for k in range(len(facet))
        ]
        rows.append([*facet, *mids, *([20 + i] if kind == "hex27" else [])])
    return np.array(rows)


@cache
def reference_nodes(kind: CellKind) -> FloatArray:
    """Return the reference coordinates ``(n_nodes, 3)``: tets in the unit simplex, hexes in [-1,
    1]^3.
    """
    family = cell_family(kind)
    corners = CORNERS[family]
    parts = [corners]
    if cell_order(kind) == 2:
        parts.append(np.array([corners[list(edge)].mean(axis=0) for edge in EDGES[family]]))
    if kind == "hex27":
        parts.append(np.array([corners[list(facet)].mean(axis=0) for facet in FACETS[family]]))
        parts.append(np.zeros((1, 3)))
    return np.vstack(parts)


@cache
def _exponents(kind: CellKind) -> IntArray:
    order = cell_order(kind)
    powers = np.array(list(product(range(order + 1), repeat=3)))
    if cell_family(kind) == "tet":
        return powers[powers.sum(axis=1) <= order]
    if kind == "hex20":  # serendipity: superlinear degree at most 2 (Arnold and Awanou 2011)
        return powers[np.where(powers == 1, 0, powers).sum(axis=1) <= 2]
    return powers


def _monomials(kind: CellKind, points: FloatArray, derivative: int | None = None) -> FloatArray:
    """Return monomials (or a derivative along an axis) at points ``(n_points, n_monomials)``."""
    exponents = _exponents(kind)
    result = np.ones((len(points), len(exponents)))
    for axis in range(3):
        power = exponents[:, axis]
        column = points[:, axis : axis + 1]
        if axis == derivative:
            result *= power * column ** np.maximum(power - 1, 0)
        else:
            result *= column**power
    return result


def cell_shape_functions(kind: CellKind, points: FloatArray) -> FloatArray:
    """Return the shape functions at reference points ``(n, 3)``: ``(n, nodes per cell)``."""
    return np.asarray(
        np.linalg.solve(_monomials(kind, reference_nodes(kind)).T, _monomials(kind, points).T).T,
        dtype=float,
    )


def shape_gradients(kind: CellKind, points: FloatArray) -> FloatArray:
    """Return the reference gradients at reference points ``(n, 3)``: ``(3, n, nodes per cell)``."""
    system = _monomials(kind, reference_nodes(kind)).T
    return np.array(
        [np.linalg.solve(system, _monomials(kind, points, axis).T).T for axis in range(3)]
    )
