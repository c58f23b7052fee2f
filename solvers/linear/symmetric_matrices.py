"""Symmetric positive semidefinite matrices whose entries differ by many decades: the test a solver
needs, and their null space.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.solvers.errors import ModelError

IntArray = NDArray[np.int64]
EPS = float(np.finfo(float).eps)
PIVOT_FACTOR = 16.0  # pivots below PIVOT_FACTOR * n * eps of their own diagonal entry are roundoff
# (eps^2 and a margin for long levers) of the largest diagonal entry: a direction cosine squared, not
# a stiffness
DEAD_DIAGONAL = 1e-25
# the same for masses, which differ by fewer decades than springs: what long levers leave of a dof
# without mass
DEAD_MASS = 1e-18
INDEFINITE_LIMIT = 1e-9  # scaled Schur complement below minus this: really negative, not roundoff
SYMMETRY_TOLERANCE = 1e-12
PIECE = 256  # rows looked at together, so that large matrices are not copied
# of the share of gravity at which a machine buckles: how close it is sought, and where it is none
BUCKLING_STEP = 1e-3
LEAST_SHARE, LEAST_SHOWN = 1e-6, 1e-4


@dataclass(frozen=True, eq=False)
class NullSpace:
    """Null space of a symmetric positive semidefinite matrix.

    Attributes:
        vectors: ``(n, r)`` basis of the null space with the unit matrix on the rows ``pinned``.
        pinned: ``(r,)`` dofs without which the matrix is positive definite.
        free: ``(n - r,)`` the other dofs.
    """

    vectors: FloatArray
    pinned: IntArray
    free: IntArray

    @property
    def dimension(self) -> int:
        """Number of independent null vectors."""
        return len(self.pinned)


def find_null_space(matrix: FloatArray, *, what: str = "stiffness") -> NullSpace:
    """Find the null space of a symmetric positive semidefinite matrix by Cholesky's method with
    diagonal pivoting.

    Each pivot is weighed against its *own* diagonal entry, which is what its roundoff is
    proportional to, so the decision does not depend on units and a soft spring next to a stiff one
    is not taken for none.

    Args:
        matrix: ``(n, n)`` symmetric.
        what: Name of the matrix for messages.

    Returns:
        The null space, perhaps empty.

    Raises:
        ModelError: The matrix has negative directions.

    Source: Higham (1990), Analysis of the Cholesky decomposition of a semi-definite matrix; LAPACK
    ``dpstrf``.
    """
    size = len(matrix)
    diagonal = np.array(matrix.diagonal())
    dead = DEAD_MASS if what == "mass" else DEAD_DIAGONAL
    live = diagonal > dead * np.abs(diagonal).max(initial=0.0)
    if diagonal.min(initial=0.0) < -INDEFINITE_LIMIT * np.abs(diagonal).max(initial=0.0):
        raise _indefinite(what, int(np.argmin(diagonal)))
    scale = np.where(live, 1.0 / np.sqrt(np.where(live, diagonal, 1.0)), 0.0)
    scaled = matrix * scale * scale[:, None]
    factor, pivots, rank, _ = scipy.linalg.lapack.dpstrf(
        scaled, tol=PIVOT_FACTOR * size * EPS, lower=1
    )
    order = np.asarray(pivots, dtype=np.int64) - 1
    kept, rest = order[:rank], order[rank:]
    lower = np.tril(factor)[:, :rank]
    schur = scaled[np.ix_(rest, rest)] - lower[rank:] @ lower[rank:].T
    if len(schur) and scipy.linalg.eigvalsh(schur, check_finite=False)[0] < -INDEFINITE_LIMIT:
        raise _indefinite(what, None)
    unscale = np.where(live, scale, 1.0)
    vectors = np.zeros((size, size - rank))
    if len(rest):
        vectors[rest] = np.eye(len(rest))
        if rank:
            solved = scipy.linalg.solve_triangular(
                lower[:rank], lower[rank:].T, lower=True, trans="T", check_finite=False
            )
            vectors[kept] = -unscale[kept, None] * solved / unscale[rest]
    return NullSpace(vectors, np.asarray(rest), np.asarray(kept))


def _indefinite(what: str, dof: int | None) -> ModelError:
    dof_shown = "" if dof is None else f" (dof {dof} has a negative diagonal entry)"
    if what == "mass":
        return ModelError(
            f"the mass matrix is not positive semidefinite{dof_shown}; look for a negative mass or a broken superelement"
        )
    return ModelError(
        f"the {what} matrix has negative directions{dof_shown}: the machine is statically unstable; "
        "look for a negative joint stiffness or a broken superelement"
    )


def require_standing(stiffness: FloatArray, geometric: FloatArray) -> None:
    """Refuse a machine that buckles under its own weight.

    Args:
        stiffness: ``(n, n)`` without gravity [N/m, N m/rad].
        geometric: ``(n, n)`` that gravity adds.

    Raises:
        ModelError: Both together have negative directions, and the stiffness alone has none.
    """
    if _stands(stiffness + geometric) or not _stands(stiffness):
        return
    standing, buckled = 0.0, 1.0
    while buckled - standing > BUCKLING_STEP * buckled and buckled > LEAST_SHARE:
        middle = 0.5 * (standing + buckled)
        if _stands(stiffness + middle * geometric):
            standing = middle
        else:
            buckled = middle
    share = f"at {buckled:.2g} of the" if buckled > LEAST_SHOWN else "under any"
    raise ModelError(
        f"the machine buckles under its own weight, {share} gravity of the scene (gravity_stiffening): "
        "stiffen what carries its heavy parts high up, or check their masses and places; without the effect nothing tips over"
    )


def _stands(matrix: FloatArray) -> bool:
    """Return whether a symmetric matrix has no negative direction."""
    try:
        find_null_space(matrix)
    except ModelError:
        return False
    return True


def is_symmetric(matrix: FloatArray) -> bool:
    """Return whether ``|A - A^T|`` stays below 1e-12 of the largest entry; False too when a value
    is not finite.
    """
    if len(matrix) <= PIECE and (matrix == matrix.T).all():
        return bool(np.isfinite(matrix).all())
    # without copies of the matrix; what is not a number stays one in a sum
    largest = max(matrix.max(initial=0.0), -matrix.min(initial=0.0))
    if not np.isfinite(largest):
        return False
    pieces = (slice(start, start + PIECE) for start in range(0, len(matrix), PIECE))
    return all(
        np.abs(matrix[piece] - matrix[:, piece].T).max() <= SYMMETRY_TOLERANCE * largest
        for piece in pieces
    )


def symmetrise(matrix: FloatArray) -> FloatArray:
    """Return ``(A + A^T) / 2`` in the place of ``A``, which is given back."""
    for start in range(0, len(matrix), PIECE):
        piece, rest = slice(start, start + PIECE), slice(start, None)
        half = 0.5 * (matrix[piece, rest] + matrix[rest, piece].T)
        matrix[piece, rest] = half
        matrix[rest, piece] = half.T
    return matrix


def absolute_product(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return ``|A| |x|``: the size of the terms of a product."""
    sizes = np.abs(vectors)
    parts = [
        np.abs(matrix[start : start + PIECE]) @ sizes for start in range(0, len(matrix), PIECE)
    ]
    return np.concatenate(parts) if parts else sizes


def require_symmetric(matrix: FloatArray, what: str, remedy: str) -> None:
    """Refuse a matrix that a symmetric solver would silently symmetrise.

    Args:
        matrix: ``(n, n)`` in any unit.
        what: Which matrix, for the message: ``stiffness``, ``mass``.
        remedy: End of the message: what the user can do.

    Raises:
        ModelError: A value is not finite, or the matrix is not symmetric.
    """
    if is_symmetric(matrix):
        return
    if not np.isfinite(matrix).all():
        raise ModelError(
            f"the {what} matrix holds values that are not finite; look for NaN or inf in its superelements and joints"
        )
    error = float(np.abs(matrix - matrix.T).max() / np.abs(matrix).max())
    raise ModelError(
        f"the {what} matrix is not symmetric: |A - A^T| = {error:.2g} of its largest entry, limit {SYMMETRY_TOLERANCE:g}; {remedy}"
    )
