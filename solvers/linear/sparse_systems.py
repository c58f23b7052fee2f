"""Sparse factorisation and lowest modes of coupled systems of many bodies, whose matrices are
mostly zero.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.solvers.errors import ConvergenceError

SMALLEST = 1200  # dofs from which a matrix is looked at
FILLED = 0.1  # share of entries that are not zero, from which a full factorisation is as fast
SPARE = 8  # modes asked for beyond those wanted, so that a gap can be found above them
# reciprocal condition of the mass, all dofs scaled to the same, below which one may be without
LEAST_MASS = 1e-11
GAP = (
    1e-6  # between neighbouring eigenvalues, from which a count between them is safe from rounding
)


@dataclass(frozen=True, eq=False)
class _SparseFactor:
    """``A = L D L^T`` of a symmetric matrix, scaled to a diagonal of ones, with pivots on the
    diagonal.

    Attributes:
        scaled: The scaled matrix, ``(n, n)``.
        scale: ``(n,)`` by which rows and columns were multiplied.
        negative: How many pivots are below zero: the number of negative eigenvalues (Sylvester's
            law of inertia).
    """

    factor: "scipy.sparse.linalg.SuperLU"
    scaled: "scipy.sparse.csc_matrix"
    scale: FloatArray
    negative: int

    def solve(self, loads: FloatArray) -> FloatArray:
        """Return ``A^-1 f`` for loads ``(n,)`` or ``(n, m)``, refined once."""
        scale = self.scale if loads.ndim == 1 else self.scale[:, None]
        right = scale * loads
        solution = self.factor.solve(right)
        return scale * (solution + self.factor.solve(right - self.scaled @ solution))

    def reciprocal_condition(self) -> float:
        """Return the reciprocal condition of the scaled matrix in the 1-norm, estimated (Higham and
        Tisseur 2000).
        """
        inverse = scipy.sparse.linalg.LinearOperator(
            self.scaled.shape, matvec=self.factor.solve, rmatvec=self.factor.solve, dtype=float
        )
        return 1.0 / float(
            abs(self.scaled).sum(axis=0).max() * scipy.sparse.linalg.onenormest(inverse)
        )


def find_sparse(matrix: FloatArray) -> "scipy.sparse.csc_matrix | None":
    """Find entries that are not zero, or None where they are many or the matrix is small."""
    size = len(matrix)
    if size < SMALLEST or np.count_nonzero(matrix) > FILLED * size * size:
        return None
    return scipy.sparse.csc_matrix(matrix)


def factorise_sparse(matrix: "scipy.sparse.csc_matrix") -> _SparseFactor | None:
    """Factorise a sparse matrix; None where a pivot is zero or lies off the diagonal."""
    diagonal = np.abs(matrix.diagonal())
    if not diagonal.all():
        return None
    scale = 1.0 / np.sqrt(diagonal)
    scaled = scipy.sparse.csc_matrix(matrix.multiply(scale[:, None]).multiply(scale))
    try:
        factor = scipy.sparse.linalg.splu(
            scaled,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        return None
    pivots = factor.U.diagonal()
    if not np.array_equal(factor.perm_r, factor.perm_c) or not np.isfinite(pivots).all():
        return None
    return _SparseFactor(factor, scaled, scale, int(np.count_nonzero(pivots < 0.0)))


def lowest_sparse_modes(
    stiffness: FloatArray, mass: FloatArray, wanted: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return the lowest eigenvalues ``(m,)`` and mass-normalised shapes ``(n, m)`` by Lanczos'
    method, none left out.

    Args:
        stiffness: ``(n, n)`` symmetric, positive definite.
        mass: The same, ``(n, n)``: no dof is without mass.

    Returns:
        None where the matrices are not sparse, one of them is not clearly positive definite, or a
        count of eigenvalues below a gap above those wanted (Sturm) is not what was found, as
        repeated ones may be missed: the caller then solves in full.

    Source: Ericsson and Ruhe (1980) (spectral transformation); Parlett (1998), section 3.3
    (Sylvester's inertia).
    """
    sparse, size = find_sparse(stiffness), len(mass)
    heavy = None if sparse is None else find_sparse(mass)
    if sparse is None or heavy is None or wanted + SPARE >= size // 2:
        return None
    factor, inertia = factorise_sparse(sparse), factorise_sparse(heavy)
    if (
        factor is None
        or inertia is None
        or factor.negative
        or inertia.negative
        or inertia.reciprocal_condition() < LEAST_MASS
    ):
        return None
    inverse = scipy.sparse.linalg.LinearOperator(sparse.shape, matvec=factor.solve, dtype=float)
    start = np.random.default_rng(0).normal(size=size)
    count = wanted + SPARE
    try:
        eigenvalues, shapes = scipy.sparse.linalg.eigsh(
            sparse, count, heavy, sigma=0.0, OPinv=inverse, v0=start, ncv=3 * count, tol=0.0
        )
    except scipy.sparse.linalg.ArpackError as error:
        raise ConvergenceError(
            f"Lanczos' method for the lowest {count} modes of {size} dofs stopped: {error}"
        ) from error
    order = np.argsort(eigenvalues)
    eigenvalues, shapes = eigenvalues[order], shapes[:, order]
    gaps = eigenvalues[wanted:] / eigenvalues[wanted - 1 : -1] - 1.0
    kept = wanted + int(np.argmax(gaps))
    if not gaps.max() > GAP:
        return None
    shifted = factorise_sparse(
        scipy.sparse.csc_matrix(sparse - np.sqrt(eigenvalues[kept - 1] * eigenvalues[kept]) * heavy)
    )
    if shifted is None or shifted.negative != kept:
        return None
    return eigenvalues[:wanted], shapes[:, :wanted]
