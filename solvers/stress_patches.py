"""Smooth stresses out of element stresses: polynomials fitted over the cells around each corner point of a mesh."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.sparse

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.element_topology import cell_family, cell_order, corner_count, reference_nodes, shape_functions

# A fit to hardly more samples than coefficients swings between them: a column of single tetrahedra came out fifteen times too bad
# with half as many again, and right with three times as many.
SAMPLES_PER_COEFFICIENT = {"tet": 3.0, "hex": 1.1}  # brick patches lie in rows: four cells of a face determine products
LARGEST_RINGS = 3
DEPENDENT = 1e-9  # share of a monomial's square that must be new to the samples of a patch


@dataclass(frozen=True, eq=False)
class StressRecovery:
    """Two sparse matrices that turn samples into smooth nodal values.

    Attributes:
        fit: ``(n_coefficients, n_samples)``.
        spread: ``(n_points, n_coefficients)``.
    """

    fit: scipy.sparse.csr_matrix
    spread: scipy.sparse.csr_matrix


@dataclass(frozen=True, eq=False)
class _Patches:
    """Pairs of a corner and a cell of its patch, corner by corner."""

    corners: IntArray  # (n_v,) mesh points
    starts: IntArray  # (n_v + 1,) first pair of each corner
    owners: IntArray  # (n_pairs,) corner
    cells: IntArray  # (n_pairs,)
    own: IntArray  # (n_cells, corners per cell) corner of each cell


def recover_stresses(mesh: ComponentMesh, places: FloatArray) -> StressRecovery:
    """Recovery of a stress that is continuous and of the order of the displacement, from samples in every cell.

    Around each corner point a polynomial is fitted to the samples of the cells that meet there, and of the next ones where those are
    few (at edges, in coarse meshes). A point of the mesh takes the mean of the polynomials of the corners it lies between.

    Args:
        mesh: Any kind of cells.
        places: ``(n_places, 3)`` reference places of the samples in each cell.

    Source: Zienkiewicz and Zhu (1992), Int. J. Numer. Meth. Engng. 33, 1331-1364, superconvergent patch recovery.
    """
    powers = _exponents(mesh.kind)
    patches = _gather_patches(mesh, enough=SAMPLES_PER_COEFFICIENT[cell_family(mesh.kind)] * len(powers) / len(places))
    samples = np.einsum("sn,cnd->csd", shape_functions(mesh.kind, places), mesh.points[mesh.cells])
    offsets = samples[patches.cells] - mesh.points[patches.corners[patches.owners]][:, None]
    sizes = np.maximum.reduceat(np.abs(offsets).max(axis=(1, 2)), patches.starts[:-1])
    table = _monomials(offsets / sizes[patches.owners][:, None, None], powers)
    normal = np.add.reduceat(np.matmul(table.transpose(0, 2, 1), table), patches.starts[:-1], axis=0)
    turn = _orthonormal_terms(normal)
    fit = _stack_rows(np.matmul(table, turn[patches.owners]), patches, samples.shape[:2])
    return StressRecovery(fit, _spread(mesh, patches, sizes, turn, powers))


def _exponents(kind: CellKind) -> IntArray:
    """Complete polynomials on tetrahedra, products on hexahedra: those of the displacement."""
    order = cell_order(kind)
    powers = np.array(sorted(product(range(order + 1), repeat=3), key=sum))
    return np.asarray(powers[powers.sum(axis=1) <= order] if cell_family(kind) == "tet" else powers)


def _orthonormal_terms(normal: FloatArray) -> FloatArray:
    """Polynomials that are orthonormal over the samples of their patch ``(n_v, n, n)``, so that no digits are lost in the fit.

    They are made of the monomials in the order of their degree. One that the samples of a patch cannot tell from those before it is
    left out, as the square across a row of bricks.

    Args:
        normal: ``(n_v, n, n)`` products of the monomials over the samples.
    """
    terms = np.zeros(normal.shape)
    for column in range(normal.shape[1]):
        vector = np.zeros(normal.shape[:2])
        vector[:, column] = 1.0
        known = terms[:, :, :column]
        for _ in range(2):
            weighed = np.matmul(normal, vector[:, :, None])
            vector = vector - np.matmul(known, np.matmul(known.transpose(0, 2, 1), weighed))[:, :, 0]
        square = np.einsum("va,vab,vb->v", vector, normal, vector, optimize=True)
        new = square > DEPENDENT * normal[:, column, column]
        terms[:, :, column] = vector * np.where(new, 1.0 / np.sqrt(np.where(new, square, 1.0)), 0.0)[:, None]
    return terms


def _monomials(places: FloatArray, powers: IntArray) -> FloatArray:
    """``(..., n_monomials)`` at places ``(..., 3)``."""
    ladder = [np.ones_like(places), places, places * places]
    columns = [ladder[a][..., 0] * ladder[b][..., 1] * ladder[c][..., 2] for a, b, c in powers]
    return np.stack(columns, axis=-1)


def _gather_patches(mesh: ComponentMesh, *, enough: float) -> _Patches:
    count = corner_count(mesh.kind)
    corners, own = np.unique(mesh.cells[:, :count], return_inverse=True)
    own = own.reshape(-1, count)
    pairs = np.repeat(np.arange(len(own)), count)
    touch = scipy.sparse.csr_matrix((np.ones(own.size), (own.ravel(), pairs)), shape=(len(corners), len(own)))
    patches = touch
    for _ in range(LARGEST_RINGS):
        few = np.diff(patches.indptr) < enough
        if not few.any():
            break
        keep = scipy.sparse.diags(np.where(few, 0.0, 1.0))
        wider = scipy.sparse.diags(np.where(few, 1.0, 0.0)) @ patches @ touch.T @ touch
        patches = (keep @ patches + wider).tocsr()
        patches.eliminate_zeros()
    owners = np.repeat(np.arange(len(corners)), np.diff(patches.indptr))
    return _Patches(corners, patches.indptr.astype(np.int64), owners, patches.indices.astype(np.int64), own)


def _stack_rows(table: FloatArray, patches: _Patches, samples: tuple[int, int]) -> scipy.sparse.csr_matrix:
    """CSR matrix of the rows of all patches from ``(n_pairs, n_places, n_coefficients)``."""
    pairs, places, rows = table.shape
    lengths = places * np.diff(patches.starts)
    before = places * (np.arange(pairs) - patches.starts[patches.owners])
    first = (rows * places * patches.starts[:-1])[patches.owners] + before
    where = first[:, None, None] + np.arange(places)[:, None] + np.arange(rows) * lengths[patches.owners][:, None, None]
    data, indices = np.empty(table.size, dtype=np.float32), np.empty(table.size, dtype=np.int64)
    data[where] = table
    indices[where] = (patches.cells[:, None] * places + np.arange(places))[:, :, None]
    pointers = np.concatenate([[0], np.cumsum(np.repeat(lengths, rows))])
    return scipy.sparse.csr_matrix((data, indices, pointers), shape=(rows * len(patches.corners), samples[0] * samples[1]))


def _spread(
    mesh: ComponentMesh, patches: _Patches, sizes: FloatArray, turn: FloatArray, powers: IntArray
) -> scipy.sparse.csr_matrix:
    """Values at the mesh points from the coefficients of the corners, weighted as linear shape functions weigh them."""
    linear: CellKind = "tet4" if cell_family(mesh.kind) == "tet" else "hex8"
    shares = shape_functions(linear, reference_nodes(mesh.kind))
    node, corner = np.nonzero(shares > 1e-9)
    points, vertices = mesh.cells[:, node].ravel(), patches.own[:, corner].ravel()
    weights = np.tile(shares[node, corner], len(mesh.cells))
    once = np.unique(points * len(patches.corners) + vertices, return_index=True)[1]
    points, vertices, weights = points[once].ravel(), vertices[once].ravel(), weights[once].ravel()
    offsets = (mesh.points[points] - mesh.points[patches.corners[vertices]]) / sizes[vertices][:, None]
    rows = np.matmul(_monomials(offsets, powers)[:, None, :], turn[vertices])[:, 0] * weights[:, None]
    count = turn.shape[2]
    columns = vertices[:, None] * count + np.arange(count)
    shape = (len(mesh.points), count * len(patches.corners))
    entries = (rows.astype(np.float32).ravel(), (np.repeat(points, count), columns.ravel()))
    return scipy.sparse.csr_matrix(entries, shape=shape)
