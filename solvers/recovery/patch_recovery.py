"""Stresses of the elements, and continuous ones recovered from them by superconvergent patch
recovery (Zienkiewicz and Zhu 1992).

Stresses are those of many displacement fields at once, scaled so that half their square is the
density of strain energy.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.topology import (
    cell_family,
    cell_order,
    cell_shape_functions,
    corner_count,
    reference_nodes,
    shape_gradients,
)
from headstock.solvers.recovery.free_sides import (
    SAMPLES_BESIDE_SIDES,
    FreeSides,
    prepare_fit,
    raise_powers,
)
from headstock.solvers.recovery.libraries import basix
from headstock.solvers.stresses import SHEAR_PAIRS

# single precision: errors of stresses are wanted, and they are far larger than its rounding
StressArray = NDArray[np.float32]
COMPONENTS = 6
# A fit to hardly more samples than coefficients swings between them: a column of single tetrahedra
# came out fifteen times too bad with half as many again, and right with three times as many.
SAMPLES_PER_COEFFICIENT = {
    "tet": 3.0,
    "hex": 1.1,
}  # brick patches lie in rows: four cells of a face determine products
LARGEST_RINGS = 3
DEPENDENT = 1e-9  # share of a monomial's square that must be new to the samples of a patch
BLOCK_VALUES = 2_000_000  # of samples that are at work at a time
BLOCK_PATCHES = 500


@dataclass(frozen=True, eq=False)
class _StressOperators:
    """Operators from displacements at the nodes of some cells to stresses.

    Attributes:
        table: ``(n_cells, 6 n_places, 3 n_nodes)``; all x of a cell's nodes first, then y, then z.
        measures: ``(n_cells, n_places)`` volume per reference volume.
    """

    table: StressArray
    measures: FloatArray


def gauss_places(kind: CellKind, degree: int) -> tuple[FloatArray, FloatArray]:
    """Return reference places ``(n, 3)`` and weights ``(n,)`` of a rule exact to a degree."""
    simplex = cell_family(kind) == "tet"
    places, weights = basix.make_quadrature(
        basix.CellType.tetrahedron if simplex else basix.CellType.hexahedron, degree
    )
    # gmsh's reference hexahedron reaches from -1 to 1
    return (places, weights) if simplex else (2.0 * places - 1.0, 8.0 * weights)


def stress_operators(
    mesh: ComponentMesh, material: Material, places: FloatArray, cells: IntArray
) -> _StressOperators:
    """Return the operators to stresses at reference places of cells, in coordinates in which the
    strain energy is half the sum of squares.

    With deviator s and pressure p of a stress the components are s / sqrt(2 G) and p / sqrt(K)
    spread evenly over the diagonal, so that any two fields have the energy product ``sum(values_a *
    values_b)`` per volume.

    Args:
        places: ``(n_places, 3)`` in the reference cell.
    """
    nodes = mesh.cells[cells]
    gradients = shape_gradients(mesh.kind, places)
    spots, width = len(places), nodes.shape[1]
    jacobians = np.matmul(
        gradients.transpose(1, 0, 2).reshape(3 * spots, width), mesh.points[nodes]
    )
    inverse, measures = _invert(jacobians.reshape(len(nodes), spots, 3, 3))
    # one long product per place: rows are cells, stress components and directions of the
    # displacement
    turned = np.tensordot(_stress_law(material), inverse, (2, 2)).transpose(3, 2, 0, 1, 4)
    turned = turned.reshape(spots, -1, 3).astype(np.float32)
    table = np.matmul(turned, gradients.transpose(1, 0, 2).astype(np.float32))
    table = table.reshape(spots, len(nodes), COMPONENTS, 3 * width).swapaxes(0, 1)
    return _StressOperators(
        table.reshape(len(nodes), COMPONENTS * spots, 3 * width), np.abs(measures)
    )


def local_motions(mesh: ComponentMesh, displacement: FloatArray, cells: IntArray) -> StressArray:
    """Return the displacements of the nodes of cells against the first of each,
    ``(n_cells, 3 n_nodes, k)`` in the order of the operators.

    Args:
        displacement: ``(3 n_points, k)``.
    """
    nodes = mesh.cells[cells]
    dofs = 3 * nodes[:, None, :] + np.arange(3)[:, None]
    moved = displacement[dofs]
    # taken in double precision: what is common to a cell would eat the digits that its strain is
    # made of
    result = np.empty(moved.shape, dtype=np.float32)
    np.subtract(moved, moved[:, :, :1], out=result, casting="same_kind")
    return result.reshape(len(nodes), -1, displacement.shape[1])


@dataclass(frozen=True, eq=False)
class _Lists:
    """Numbers by corner, one after the other."""

    starts: IntArray  # (n_v + 1,)
    entries: IntArray

    @property
    def lengths(self) -> IntArray:
        return np.diff(self.starts)

    def table(self, rows: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the lists of some corners ``(n, longest)``, filled up with their first entries,
        and 1 for entries, 0 for fillers.
        """
        lengths = self.lengths[rows]
        column = np.arange(int(lengths.max()))
        real = column < lengths[:, None]
        return self.entries[self.starts[rows][:, None] + np.where(real, column, 0)], real.astype(
            float
        )


@dataclass(frozen=True, eq=False)
class _CornerPatches:
    """Cells to which the polynomial around each corner point is fitted.

    Attributes:
        corners: ``(n_v,)`` mesh points that are corners of cells.
        own: ``(n_cells, corners per cell)`` their numbers among these.
    """

    corners: IntArray
    own: IntArray
    cells: _Lists

    def around(self, cells: IntArray) -> IntArray:
        """Return all cells that stresses in some cells are recovered from, those among them."""
        chosen = np.unique(self.own[cells])
        starts, lengths = self.cells.starts[chosen], self.cells.lengths[chosen]
        first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        places = np.arange(lengths.sum()) + np.repeat(starts - first, lengths)
        cells_around: IntArray = np.unique(self.cells.entries[places])
        return cells_around


def corner_patches(
    mesh: ComponentMesh, samples: int, sides: FreeSides | None = None
) -> _CornerPatches:
    """Return the patches of a mesh.

    Args:
        mesh: Any kind of cells.
        samples: Number of places in each cell where stresses are sampled.
        sides: Free ones where single tetrahedra fill the part; None for none.
    """
    corners, corner_of = np.unique(mesh.cells[:, : corner_count(mesh.kind)], return_inverse=True)
    corner_of = corner_of.reshape(len(mesh.cells), -1)
    wanted = np.full(
        len(corners), SAMPLES_PER_COEFFICIENT[cell_family(mesh.kind)] * len(_exponents(mesh.kind))
    )
    if sides is not None:
        wanted[sides.alone[corners]] = SAMPLES_BESIDE_SIDES
    return _CornerPatches(
        corners, corner_of, _gather_patches(corner_of, len(corners), wanted / samples)
    )


def recover_stresses(
    mesh: ComponentMesh,
    places: FloatArray,
    taken: StressArray,
    *,
    wanted: int | None = None,
    sides: tuple[FreeSides, Material] | None = None,
) -> StressArray:
    """Return the nodal values ``(n_points, m)`` of stresses that are continuous and of the order of
    the displacement, from samples in every cell.

    Around each corner point a polynomial is fitted to the samples of the cells that meet there, and
    of the next ones where those are few (at edges, in coarse meshes). A point of the mesh takes the
    mean of the polynomials of the corners it lies between.

    Args:
        mesh: Any kind of cells.
        places: ``(n_places, 3)`` reference places of the samples in each cell.
        taken: ``(n_cells, n_places, m)`` the samples.
        wanted: Number of leading cells on which values are needed; None for all.
        sides: Free ones where single tetrahedra fill the part, and its material; there polynomials
            are fitted to both. None for none.

    Source: Zienkiewicz and Zhu (1992), Int. J. Numer. Meth. Engng. 33, 1331-1364, superconvergent
    patch recovery.
    """
    powers = _exponents(mesh.kind)
    node_patches = corner_patches(mesh, len(places), None if sides is None else sides[0])
    corners, patches = node_patches.corners, node_patches.cells
    near = _gather_points(mesh, node_patches.own, len(corners))
    used = np.unique(node_patches.own[:wanted])
    # linear shape functions weigh the corners between which a point lies alike
    shares = 1.0 / np.maximum(np.bincount(near.entries, minlength=len(mesh.points)), 1)
    where = np.matmul(cell_shape_functions(mesh.kind, places), mesh.points[mesh.cells])
    smooth = np.zeros((len(mesh.points), taken.shape[2]), dtype=np.float32)

    def add(points: IntArray, values: FloatArray | StressArray) -> None:
        reached, slots = np.unique(points, return_inverse=True)
        pairs = np.arange(points.size + 1)
        gather = scipy.sparse.csc_matrix(
            (np.ones(points.size, dtype=np.float32), slots.ravel(), pairs)
        ).tocsr()
        smooth[reached] += gather @ values.reshape(points.size, -1).astype(np.float32, copy=False)

    if sides is not None:
        alone = sides[0].alone[corners[used]]
        fit, polynomials, used = prepare_fit(mesh, sides[1], sides[0]), used[alone], used[~alone]
        for rows in _alike(patches, near, polynomials, taken.shape[1] * taken.shape[2]):
            (cells, real), (points, met) = patches.table(rows), near.table(rows)
            middle = mesh.points[corners[rows]][:, None]
            offsets = np.where(real[..., None, None] > 0.0, where[cells] - middle[:, None], np.nan)
            terms, lengths = fit.fit(
                offsets.reshape(len(rows), -1, 3),
                [around[is_real > 0.0] for around, is_real in zip(cells, real, strict=True)],
                middle[:, 0],
                taken[cells].reshape(len(rows), -1, taken.shape[2]),
            )
            ends = raise_powers((mesh.points[points] - middle) / lengths[:, None, None])
            add(points, np.matmul(ends * (met * shares[points])[..., None], terms))
    for rows in _alike(patches, near, used, taken.shape[1] * taken.shape[2]):
        (cells, real), (points, met) = patches.table(rows), near.table(rows)
        middle = mesh.points[corners[rows]][:, None]
        offsets = (where[cells] - middle[:, None]).reshape(len(rows), -1, 3)
        operators = _fit_operators(
            offsets,
            np.repeat(real, len(places), axis=1),
            mesh.points[points] - middle,
            met * shares[points],
            powers,
        )
        add(points, np.matmul(operators, taken[cells].reshape(len(rows), -1, taken.shape[2])))
    return smooth


def _exponents(kind: CellKind) -> IntArray:
    """Return complete polynomials on tets, products on hexes: those of the displacement."""
    order = cell_order(kind)
    powers = np.array(sorted(product(range(order + 1), repeat=3), key=sum))
    return powers[powers.sum(axis=1) <= order] if cell_family(kind) == "tet" else powers


def _fit_operators(
    offsets: FloatArray, real: FloatArray, points: FloatArray, weights: FloatArray, powers: IntArray
) -> StressArray:
    """Return the operators from the samples of patches to weighted values of their polynomials at
    points, ``(n_v, n_points, n_samples)``.

    Args:
        offsets: ``(n_v, n_samples, 3)`` of the samples from the corners.
        real: ``(n_v, n_samples)`` 1 for samples, 0 for fillers.
        points: ``(n_v, n_points, 3)`` offsets of the points.
        weights: ``(n_v, n_points)``.
        powers: ``(n, 3)`` of the monomials.
    """
    sizes = np.abs(offsets).max(axis=(1, 2))[:, None, None]
    table = _monomials(offsets / sizes, powers) * real
    table = table.transpose(1, 2, 0)
    turn = _orthonormal_terms(np.matmul(table.swapaxes(1, 2), table))
    ends = (_monomials(points / sizes, powers) * weights).transpose(1, 2, 0)
    return np.asarray(
        np.matmul(np.matmul(ends, turn), np.matmul(table, turn).swapaxes(1, 2)), dtype=np.float32
    )


def _orthonormal_terms(normal: FloatArray) -> FloatArray:
    """Return the polynomials that are orthonormal over the samples of their patch ``(n_v, n, n)``,
    so that no digits are lost in the fit.

    They are made of the monomials in the order of their degree. One that the samples of a patch
    cannot distinguish from those before it is left out, as the square across a row of bricks.

    Args:
        normal: ``(n_v, n, n)`` products of the monomials over the samples.
    """
    count = normal.shape[1]
    rest = np.ascontiguousarray(normal.transpose(1, 2, 0))
    first = np.einsum("iiv->iv", rest).copy()
    terms = np.zeros(rest.shape)
    np.einsum("iiv->iv", terms)[:] = 1.0
    # Cholesky's factor, many at once, and its inverse with it
    for step in range(count):
        square = rest[step, step]
        new = square > DEPENDENT * first[step]
        scale = np.where(new, 1.0 / np.sqrt(np.where(new, square, 1.0)), 0.0)
        terms[step, : step + 1] *= scale
        row = rest[step, step + 1 :] * scale
        rest[step + 1 :, step + 1 :] -= row[:, None] * row[None]
        terms[step + 1 :, : step + 1] -= row[:, None] * terms[step, : step + 1]
    return np.ascontiguousarray(terms.transpose(2, 1, 0))


def _monomials(places: FloatArray, powers: IntArray) -> FloatArray:
    """Return the monomials ``(n_monomials, ...)`` at places ``(..., 3)``."""
    refinement = [np.ones_like(places), places, places * places]
    result = np.empty((len(powers), *places.shape[:-1]))
    for row in range(len(powers)):
        a, b, c = (int(power) for power in powers[row])
        np.multiply(refinement[a][..., 0], refinement[b][..., 1], out=result[row])
        result[row] *= refinement[c][..., 2]
    return result


def _gather_patches(corner_of: IntArray, count: int, enough: FloatArray) -> _Lists:
    """Return the cells around each corner.

    Args:
        corner_of: ``(n_cells, corners per cell)`` number of each corner.
        enough: ``(n_v,)`` least number of cells, where three more rings bring them.
    """
    starts = np.arange(0, corner_of.size + 1, corner_of.shape[1])
    corners_of = scipy.sparse.csr_matrix(
        (np.ones(corner_of.size), corner_of.ravel(), starts), shape=(len(corner_of), count)
    )
    touch = corners_of.T.tocsr()
    patches = touch
    for _ in range(LARGEST_RINGS):
        few = np.flatnonzero(np.diff(patches.indptr) < enough)
        if not len(few):
            break
        keep = np.ones(count)
        keep[few] = 0.0
        wider = patches[few] @ corners_of @ touch
        incidence = scipy.sparse.csr_matrix(
            (np.ones(len(few)), (few, np.arange(len(few)))), shape=(count, len(few))
        )
        patches = (scipy.sparse.diags(keep) @ patches + incidence @ wider).tocsr()
        patches.eliminate_zeros()
    return _Lists(patches.indptr.astype(np.int64), patches.indices.astype(np.int64))


def _gather_points(mesh: ComponentMesh, corner_of: IntArray, count: int) -> _Lists:
    """Return the points of the mesh that lie between each corner and others."""
    linear: CellKind = "tet4" if cell_family(mesh.kind) == "tet" else "hex8"
    node, corner = np.nonzero(cell_shape_functions(linear, reference_nodes(mesh.kind)) > 1e-9)
    keys = np.unique(corner_of[:, corner].astype(np.int64) * len(mesh.points) + mesh.cells[:, node])
    owners = keys // len(mesh.points)
    return _Lists(np.searchsorted(owners, np.arange(count + 1)), keys - owners * len(mesh.points))


def _alike(
    patches: _Lists, near: _Lists, used: IntArray, values_per_cell: int
) -> Iterator[IntArray]:
    """Yield some of the corners with patches of much the same size at a time."""
    order = used[np.lexsort((near.lengths[used], patches.lengths[used]))]
    while len(order):
        # the largest first: all others of a block are filled up to it
        most = max(1, BLOCK_VALUES // (values_per_cell * int(patches.lengths[order[-1]])))
        step = min(most, BLOCK_PATCHES)
        yield order[-step:]
        order = order[:-step]


def _stress_law(material: Material) -> FloatArray:
    """Return the scaled stress ``(6, 3, 3)`` per derivative [.., component of the displacement,
    direction].
    """
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    bulk = material.youngs_modulus / (3.0 * (1.0 - 2.0 * material.poisson_ratio))
    law = np.zeros((COMPONENTS, 3, 3))
    for axis in range(3):
        law[axis, axis, axis] = np.sqrt(2.0 * shear)
        law[axis] += np.eye(3) * (np.sqrt(3.0 * bulk) - np.sqrt(2.0 * shear)) / 3.0
    for row, (a, b) in enumerate(SHEAR_PAIRS):
        law[3 + row, a, b] = law[3 + row, b, a] = np.sqrt(shear)
    return law


def _invert(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverses and determinants of ``(..., 3, 3)``; by cofactors, as a factorisation of
    each takes longer than all the rest.
    """
    a, b, c = (matrices[..., row, :] for row in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    determinants = (a * cofactors[..., 0]).sum(axis=-1)
    return cofactors / determinants[..., None, None], determinants
