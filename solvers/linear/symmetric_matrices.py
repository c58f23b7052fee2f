"""Null space of a symmetric positive semidefinite matrix whose entries differ by many decades."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh, solve_triangular
from scipy.linalg.lapack import dpstrf

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError

IntArray = NDArray[np.int64]

EPS = float(np.finfo(float).eps)
PIVOT_FACTOR = 16.0  # pivots below PIVOT_FACTOR * n * eps of their own diagonal entry are roundoff
DEAD_DIAGONAL = 1e-28  # (eps^2 and a margin) of the largest diagonal entry: a direction cosine squared, not a stiffness
DEAD_MASS = 1e-18  # the same for masses, which differ by fewer decades than springs: what long levers leave of a dof without mass
INDEFINITE_LIMIT = 1e-9  # scaled Schur complement below minus this: really negative, not roundoff


@dataclass(frozen=True, eq=False)
class NullSpace:
    """What a symmetric positive semidefinite matrix does not see.

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
    """Null space of a symmetric positive semidefinite matrix by Cholesky's method with diagonal pivoting.

    Each pivot is weighed against its *own* diagonal entry, which is what its roundoff is proportional to, so the decision
    does not depend on units and a soft spring beside a stiff one is not taken for none.

    Args:
        matrix: ``(n, n)`` symmetric.
        what: Name of the matrix for messages.

    Returns:
        The null space, perhaps empty.

    Raises:
        ModelError: The matrix has negative directions.

    Source: Higham (1990), Analysis of the Cholesky decomposition of a semi-definite matrix; LAPACK ``dpstrf``.
    """
    size = len(matrix)
    diagonal = np.array(matrix.diagonal())
    dead = DEAD_MASS if what == "mass" else DEAD_DIAGONAL
    live = diagonal > dead * np.abs(diagonal).max(initial=0.0)
    _require_no_negative(diagonal, what)
    scale = np.where(live, 1.0 / np.sqrt(np.where(live, diagonal, 1.0)), 0.0)
    scaled = matrix * scale * scale[:, None]
    factor, pivots, rank, _ = dpstrf(scaled, tol=PIVOT_FACTOR * size * EPS, lower=1)
    order = np.asarray(pivots, dtype=np.int64) - 1
    kept, rest = order[:rank], order[rank:]
    lower = np.tril(factor)[:, :rank]
    schur = scaled[np.ix_(rest, rest)] - lower[rank:] @ lower[rank:].T
    _require_semidefinite(schur, what)
    unscale = np.where(live, scale, 1.0)
    vectors = np.zeros((size, size - rank))
    if len(rest):
        vectors[rest] = np.eye(len(rest))
        if rank:
            solved = solve_triangular(lower[:rank], lower[rank:].T, lower=True, trans="T", check_finite=False)
            vectors[kept] = -unscale[kept, None] * solved / unscale[rest]
    return NullSpace(vectors, np.asarray(rest), np.asarray(kept))


def _require_no_negative(diagonal: FloatArray, what: str) -> None:
    largest = np.abs(diagonal).max(initial=0.0)
    if diagonal.min(initial=0.0) < -INDEFINITE_LIMIT * largest:
        raise _indefinite(what, int(np.argmin(diagonal)))


def _require_semidefinite(schur: FloatArray, what: str) -> None:
    if len(schur) and eigvalsh(schur, check_finite=False)[0] < -INDEFINITE_LIMIT:
        raise _indefinite(what, None)


def _indefinite(what: str, dof: int | None) -> ModelError:
    place = "" if dof is None else f" (dof {dof} has a negative diagonal entry)"
    if what == "mass":
        return ModelError(f"the mass matrix is not positive semidefinite{place}; look for a negative mass or a broken superelement")
    return ModelError(
        f"the {what} matrix has negative directions{place}: the machine is statically unstable; "
        "look for a negative joint stiffness or a broken superelement"
    )
