"""Structured second-order meshes from a lattice of points, their files, and integrals over them in
plain numpy.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray, MeshQuality
from headstock.meshing.elements.topology import EDGES

# gmsh's pairs of corners behind the middle nodes
HEX_CORNERS = (
    (0, 0, 0),
    (1, 0, 0),
    (1, 1, 0),
    (0, 1, 0),
    (0, 0, 1),
    (1, 0, 1),
    (1, 1, 1),
    (0, 1, 1),
)
HEX_FACES = ((0, 1, 2, 3), (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))
TET_CORNERS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
_GAUSS_POINTS = 5
# gmsh's corners of the six sides of a hexahedron
_SIDE_CORNERS = {
    "u-": (0, 4, 7, 3), "u+": (1, 2, 6, 5), "v-": (0, 1, 5, 4), "v+": (2, 3, 7, 6), "w-": (0, 3, 2, 1), "w+": (4, 5, 6, 7),
}  # fmt: skip
SIDES = tuple(_SIDE_CORNERS)
GMSH_HEX27, GMSH_QUAD9 = 12, 10


@functools.cache
def node_places(kind: CellKind) -> FloatArray:
    """Nodes ``(n, 3)`` of a reference element in gmsh's order; hexahedra on the unit cube,
    tetrahedra on the unit simplex.
    """
    hexahedral = kind.startswith("hex")
    corners = np.array(HEX_CORNERS if hexahedral else TET_CORNERS, dtype=float)
    groups = [*EDGES["hex"], *HEX_FACES, tuple(range(8))] if hexahedral else [*EDGES["tet"]]
    middles = [corners[list(group)].mean(axis=0) for group in groups]
    return np.vstack([corners, *middles])[: int(kind[3:])]


def _shape_functions(kind: CellKind, places: FloatArray) -> tuple[FloatArray, FloatArray]:
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
    points: FloatArray,
    cells: IntArray,
    kind: CellKind,
    integrand: Callable[[FloatArray], FloatArray],
) -> float:
    """Integral of a function of position over isoparametric elements.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, n)``.
        integrand: From ``(m, 3)`` positions to ``(m,)`` values.
    """
    places, weights = _gauss_rule(kind)
    values, gradients = _shape_functions(kind, places)
    corners = points[cells]
    positions = np.einsum("qn,cnd->cqd", values, corners)
    jacobians = np.linalg.det(np.einsum("qnr,cnd->cqdr", gradients, corners))
    found = integrand(positions.reshape(-1, 3)).reshape(positions.shape[:2])
    return float(np.einsum("q,cq,cq->", weights, jacobians, found))


def field_error(
    points: FloatArray,
    cells: IntArray,
    kind: CellKind,
    field: FloatArray,
    exact: Callable[[FloatArray], FloatArray],
) -> float:
    """Relative L2 error of a nodal vector field against an exact one.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, n)``.
        field: ``(n_points, 3)`` nodal values.
        exact: From ``(m, 3)`` positions to ``(m, 3)`` values.
    """
    places, weights = _gauss_rule(kind)
    values, gradients = _shape_functions(kind, places)
    corners = points[cells]
    measure = weights * np.linalg.det(np.einsum("qnr,cnd->cqdr", gradients, corners))
    truth = exact(np.einsum("qn,cnd->cqd", values, corners).reshape(-1, 3)).reshape(
        len(cells), len(places), 3
    )
    difference = np.einsum("qn,cnd->cqd", values, field[cells]) - truth
    return float(
        np.sqrt(
            np.einsum("cq,cqd->", measure, difference**2) / np.einsum("cq,cqd->", measure, truth**2)
        )
    )


def _monomials(kind: CellKind, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    order = 1 if kind in ("tet4", "hex8") else 2
    powers = np.array([
        power
        for power in itertools.product(range(order + 1), repeat=3)
        if kind.startswith("hex") or sum(power) <= order
    ])  # fmt: skip
    factors = places[:, None, :] ** powers[None, :, :]
    slopes = powers * places[:, None, :] ** np.maximum(powers - 1, 0)
    gradients = np.stack(
        [np.prod(np.where(np.arange(3) == axis, slopes, factors), axis=-1) for axis in range(3)],
        axis=-1,
    )
    return np.prod(factors, axis=-1), gradients


def _gauss_rule(kind: CellKind) -> tuple[FloatArray, FloatArray]:
    """Points ``(m, 3)``, weights ``(m,)``; a simplex is a collapsed cube (Duffy (1982))."""
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    line, weight = 0.5 * (nodes + 1.0), 0.5 * weights
    a, b, c = (grid.ravel() for grid in np.meshgrid(line, line, line, indexing="ij"))
    product = np.einsum("i,j,k->ijk", weight, weight, weight).ravel()
    if kind.startswith("hex"):
        return np.column_stack([a, b, c]), product
    places = np.column_stack([a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)])
    return places, product * (1.0 - a) ** 2 * (1.0 - b)


def refine_lattice(corners: FloatArray) -> FloatArray:
    """Put a point midway between neighbouring element corners, so that every element edge is
    straight.

    Args:
        corners: ``(n_u + 1, n_v + 1, n_w + 1, 3)`` element corners [m].

    Returns:
        ``(2 n_u + 1, 2 n_v + 1, 2 n_w + 1, 3)`` lattice of element nodes [m].
    """
    lattice = corners
    for axis in range(3):
        low = np.take(lattice, range(lattice.shape[axis] - 1), axis=axis)
        high = np.take(lattice, range(1, lattice.shape[axis]), axis=axis)
        shape = list(lattice.shape)
        shape[axis] = 2 * shape[axis] - 1
        refined = np.empty(shape)
        even, odd = [slice(None)] * 4, [slice(None)] * 4
        even[axis], odd[axis] = slice(0, None, 2), slice(1, None, 2)
        refined[tuple(even)], refined[tuple(odd)] = lattice, 0.5 * (low + high)
        lattice = refined
    return lattice


def straight_lattice(counts: Sequence[int], size: Sequence[float]) -> FloatArray:
    """Lattice of a box from the origin with the given numbers of equal elements and edge lengths
    [m].
    """
    axes = [np.linspace(0.0, length, count + 1) for count, length in zip(counts, size, strict=True)]
    return refine_lattice(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))


def _tetrahedral_cells(shape: Sequence[int]) -> IntArray:
    """Cells ``(6 n, 10)`` in gmsh's order of 10-node tetrahedra, six in each hexahedron of a
    lattice.

    Source: Kuhn (1960): one simplex for every order in which the three directions are walked.
    """
    numbers = np.arange(int(np.prod(shape))).reshape(shape)
    starts = [range(0, count - 1, 2) for count in shape]
    grid = np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    cells = []
    for walk in itertools.permutations(range(3)):
        corners: IntArray = np.zeros((4, 3), dtype=np.int64)
        for number, axis in enumerate(walk):
            corners[number + 1 :, axis] += 2
        if np.linalg.det(corners[1:]) < 0.0:
            corners = corners[[0, 2, 1, 3]]
        middles = [(corners[a] + corners[b]) // 2 for a, b in EDGES["tet"]]
        steps = grid + np.vstack([corners, middles])[None, :, :]
        cells.append(numbers[steps[..., 0], steps[..., 1], steps[..., 2]])
    return np.asarray(np.concatenate(cells), dtype=np.int64)


def lattice_mesh(lattice: FloatArray, kind: CellKind, *, straight: bool) -> ComponentMesh:
    """Return the mesh of a lattice, without patches; first-order kinds use its even points only.

    Args:
        lattice: ``(2 n_u + 1, 2 n_v + 1, 2 n_w + 1, 3)`` element nodes [m].
        kind: ``tet4``, ``tet10``, ``hex8`` or ``hex27``.
    """
    shape = lattice.shape[:3]
    cells = _tetrahedral_cells(shape) if kind.startswith("tet") else _lattice_cells(shape)
    used, numbers = np.unique(cells[:, : int(kind[3:])], return_inverse=True)
    cells = numbers.reshape(len(cells), -1).astype(np.int64)
    points = lattice.reshape(-1, 3)[used]
    volume = float(integrate_over_cells(points, cells, kind, lambda x: np.ones(len(x))))
    return ComponentMesh(
        points, cells, kind, straight, {}, MeshQuality(math.nan, 0, volume, math.nan)
    )


def _lattice_cells(shape: Sequence[int]) -> IntArray:
    """Cells ``(n_cells, 27)`` in gmsh's node order of a lattice with the given number of points
    along u, v and w (all odd).
    """
    numbers = np.arange(int(np.prod(shape))).reshape(shape)
    starts = [range(0, count - 1, 2) for count in shape]
    grid = np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    steps = grid + np.rint(2.0 * node_places("hex27")).astype(np.int64)[None, :, :]
    return np.asarray(numbers[steps[..., 0], steps[..., 1], steps[..., 2]], dtype=np.int64)


def lattice_sides(shape: Sequence[int]) -> dict[str, IntArray]:
    """Facets ``(n, 9)`` in gmsh's node order, normals outward, of the six sides ``u- u+ v- v+ w-
    w+`` of a lattice.
    """
    cells = _lattice_cells(shape)
    counts = [(count - 1) // 2 for count in shape]
    places = np.stack(np.unravel_index(np.arange(len(cells)), counts), axis=-1)
    sides = {}
    for name, corners in _SIDE_CORNERS.items():
        axis = "uvw".index(name[0])
        outermost = places[:, axis] == (0 if name[1] == "-" else counts[axis] - 1)
        sides[name] = cells[outermost][:, _facet_nodes(corners)]
    return sides


def write_lattice(path: Path, lattice: FloatArray) -> None:
    """Write a lattice as a gmsh 2.2 file of 27-node hexahedra with a physical surface for each
    side.

    Args:
        path: File ending in ``.msh``.
        lattice: ``(2 n_u + 1, 2 n_v + 1, 2 n_w + 1, 3)`` element nodes.

    Source: gmsh reference manual, legacy MSH file format version 2.
    """
    shape = lattice.shape[:3]
    points, cells, sides = lattice.reshape(-1, 3), _lattice_cells(shape), lattice_sides(shape)
    names = [f'2 {number} "{name}"' for number, name in enumerate(sides, start=1)] + ['3 7 "body"']
    elements = [
        f"{GMSH_QUAD9} 2 {number} {number} " + " ".join(map(str, facet + 1))
        for number, facets in enumerate(sides.values(), start=1)
        for facet in facets
    ]
    elements += [f"{GMSH_HEX27} 2 7 7 " + " ".join(map(str, cell + 1)) for cell in cells]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    lines += ["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(points))]
    lines += [
        f"{number} {x!r} {y!r} {z!r}" for number, (x, y, z) in enumerate(points.tolist(), start=1)
    ]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    lines += [f"{number} {element}" for number, element in enumerate(elements, start=1)]
    path.write_text("\n".join([*lines, "$EndElements", ""]), encoding="ascii")


def _facet_nodes(corners: tuple[int, int, int, int]) -> list[int]:
    """Positions within a cell of the nine nodes of a side: corners, edges in a ring, centre."""
    ring = [tuple(sorted((corners[k], corners[(k + 1) % 4]))) for k in range(4)]
    edges = [8 + [tuple(sorted(edge)) for edge in EDGES["hex"]].index(pair) for pair in ring]
    center = 20 + [tuple(sorted(face)) for face in HEX_FACES].index(tuple(sorted(corners)))
    return [*corners, *edges, center]
