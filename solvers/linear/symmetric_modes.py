"""Eigenpairs of a dense symmetric pencil ``K x = omega^2 M x``, accurate at the low end however
stiff the stiffest part is.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dsyevr, dsygst, dsygvd

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError, ModelError
from headstock.solvers.linear.sparse_systems import lowest_sparse_modes
from headstock.solvers.linear.symmetric_matrices import (
    EPS,
    NullSpace,
    absolute_product,
    find_null_space,
)

SPREAD_LIMIT = 1e-7  # smallest over largest flexibility that one solve resolves to RESOLVED
RESOLVED = 1e-9  # relative error of the highest eigenvalue
MASSLESS_LIMIT = 1e-12  # flexibility over the largest one below which a dof may be without mass
CANCELLATION_LIMIT = (
    1e-6  # roundoff of the lowest mode's strain energy above which a rigid mode is suspected
)
BEYOND = 0.99  # a pair at the limit itself must not be lost to roundoff
FEW = 0.1  # of all modes, up to which they are solved for alone
WIDENING = 1.0 + 1e-12
SPLIT_WINDOW = 30.0  # the two solves meet at the widest gap within this factor of the middle


@dataclass(frozen=True, eq=False)
class ModalPairs:
    """Eigenpairs, rising.

    Attributes:
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2]; of rigid modes the roundoff that is left.
        shapes: ``(n, m)`` mass-normalised.
        rigid_count: How many of the first are rigid-body modes (no strain energy).
        infinite_count: Dofs without mass that were condensed statically: infinite frequencies.
    """

    eigenvalues: FloatArray
    shapes: FloatArray
    rigid_count: int = 0
    infinite_count: int = 0


def solve_symmetric_modes(
    stiffness: FloatArray,
    mass: FloatArray,
    *,
    wanted: int | None = None,
    up_to: float | None = None,
    resolved: float = RESOLVED,
) -> ModalPairs:
    """Return the lowest eigenpairs, or all, of ``K x = omega^2 M x`` for symmetric positive
    semidefinite matrices.

    Few modes of a large sparse pencil are sought by Lanczos (``lowest_sparse_modes``). Else the
    pencil is solved as ``M x = mu K x``, mu = 1/omega^2: a Cholesky factorisation of K keeps small
    stiffnesses next to large ones (K is graded, not ill-conditioned), and the largest mu, the
    lowest modes, come out to machine precision. Where that does not do (rigid-body modes, massless
    dofs, a wide spread) the careful path takes over.

    Args:
        stiffness: ``(n, n)``.
        mass: ``(n, n)``.
        wanted: How many of the lowest must be accurate; the others are left out. None: all.
        up_to: The same as a limit of omega^2 [rad^2/s^2]; those beyond it may be left out.
        resolved: Relative error that the highest eigenvalue may have; that of lower ones falls with
            them.

    Raises:
        ModelError: A matrix is indefinite, or a dof has neither mass nor stiffness.
        ConvergenceError: LAPACK did not converge.

    Source: Barlow and Demmel (1990) on graded matrices; Guyan (1965) for massless dofs.
    """
    count = len(mass) if wanted is None else min(wanted, len(mass))
    sparse = lowest_sparse_modes(stiffness, mass, count)
    if sparse is not None:
        eigenvalues, shapes = sparse
        if not (
            loses_digits(stiffness, shapes[:, 0] / np.sqrt(eigenvalues[0]))
            and find_null_space(stiffness).dimension
        ):
            return ModalPairs(eigenvalues, shapes)
    pairs = _flexibility_modes(stiffness, mass, count, up_to, resolved)
    if pairs is None:
        careful = _careful_modes(stiffness, mass, count)
        return replace(
            careful, eigenvalues=careful.eigenvalues[:count], shapes=careful.shapes[:, :count]
        )
    return pairs


def _flexibility_modes(
    stiffness: FloatArray, mass: FloatArray, count: int, up_to: float | None, resolved: float
) -> ModalPairs | None:
    """Return the lowest eigenvalues and shapes by one LAPACK call, or None where its answer may not
    be good enough.
    """
    if _has_massless_dof(stiffness, mass):
        return None
    if 0 < count <= FEW * len(mass) and _few_lose_digits(stiffness, mass, count):
        return None
    flexibilities, shapes, info = dsygvd(mass.T, stiffness.T)
    if info != 0 or not flexibilities[0] > MASSLESS_LIMIT * flexibilities[-1]:
        return None
    if up_to is not None:
        count = min(count, max(1, int(np.count_nonzero(flexibilities * up_to >= BEYOND))))
    least = flexibilities[-count] * (resolved / RESOLVED)
    if _spreads_too_far(least, flexibilities[-1]) or loses_digits(stiffness, shapes[:, -1]):
        return None
    eigenvalues = 1.0 / flexibilities[: -count - 1 : -1]
    lowest_first = shapes[:, : -count - 1 : -1] * np.sqrt(eigenvalues)
    if _spreads_too_far(flexibilities[-count], flexibilities[-1]):
        # where digits of high modes are lost, they are still orthogonal to lower ones
        lowest_first = _mass_orthonormal(lowest_first, mass, times=1)
    return ModalPairs(eigenvalues, lowest_first)


def _has_massless_dof(stiffness: FloatArray, mass: FloatArray) -> bool:
    """Return whether single dofs alone show that flexibilities lie too far apart: by Rayleigh's
    quotient none of them is above the smallest flexibility, and none below the largest.
    """
    stiffnesses = stiffness.diagonal()
    if not stiffnesses.min(initial=np.inf) > 0.0:
        return True
    single = mass.diagonal() / stiffnesses
    return not single.min(initial=np.inf) > MASSLESS_LIMIT * single.max(initial=0.0)


def _few_lose_digits(stiffness: FloatArray, mass: FloatArray, count: int) -> bool:
    """Return whether the lowest modes alone show that the careful path has to take over, which
    saves the solve of all.
    """
    few = _few_modes(stiffness, mass, count)
    if few is None:
        return True
    eigenvalues, shapes = few
    return loses_digits(stiffness, shapes[:, 0] / np.sqrt(eigenvalues[0]))


def _spreads_too_far(smallest: float, largest: float) -> bool:
    """Return whether flexibilities lie too far apart for one solve to resolve both."""
    return not smallest > SPREAD_LIMIT * largest


def loses_digits(stiffness: FloatArray, lowest: FloatArray) -> bool:
    """Return whether roundoff is so much of the strain energy of the lowest shape ``(n,)``,
    ``x^T K x = 1``, that it may be a rigid motion.
    """
    size = np.abs(lowest)
    return bool(len(size) * EPS * (size @ absolute_product(stiffness, size)) > CANCELLATION_LIMIT)


def _careful_modes(stiffness: FloatArray, mass: FloatArray, wanted: int) -> ModalPairs:
    """Return the same when K or M is singular or the eigenvalues lie far apart; at least the lowest
    that are wanted.
    """
    back, condensed_stiffness, condensed_mass = _condense_massless(stiffness, mass)
    null = find_null_space(condensed_stiffness)
    rigid = _mass_orthonormal(null.vectors, condensed_mass)
    free = null.free
    coupling = condensed_mass @ rigid
    # x = P E y with P = 1 - R R^T M: orthogonal to the rigid modes, and K P E y = K E y because K R
    # = 0. E fills in zeros at as many dofs as there are rigid modes, so the stiffness of the free
    # ones is definite and its pencil regular; P is applied to the shapes below
    elastic_stiffness = condensed_stiffness[np.ix_(free, free)]
    elastic_mass = condensed_mass[np.ix_(free, free)] - coupling[free] @ coupling[free].T
    eigenvalues, reduced = _few_modes(elastic_stiffness, elastic_mass, wanted) or _two_sided_modes(
        elastic_stiffness, elastic_mass
    )
    shapes = np.zeros((len(condensed_mass), len(eigenvalues)))
    shapes[free] = reduced
    shapes -= rigid @ (coupling.T @ shapes)
    rigid_squares = np.einsum("ij,ij->j", rigid, condensed_stiffness @ rigid)
    return ModalPairs(
        np.concatenate([rigid_squares, eigenvalues]),
        back @ np.hstack([rigid, shapes]),
        null.dimension,
        len(mass) - len(condensed_mass),
    )


def _condense_massless(
    stiffness: FloatArray, mass: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the Guyan condensation of the null space of M: exact, as it has no inertia."""
    massless = find_null_space(mass, what="mass")
    if massless.dimension == 0:
        return np.eye(len(mass)), stiffness, mass
    if massless.dimension == len(mass):
        raise ModelError(
            "the system has no mass at all; natural frequencies need the mass to be assembled"
        )
    null, free = massless.vectors, massless.free
    inner = null.T @ stiffness @ null
    void = find_null_space(inner)
    if void.dimension:
        raise _void_error(massless, void)
    # back = E - N (N^T K N)^-1 N^T K E: dofs without inertia follow the others so that no force is
    # left on them
    kept = np.eye(len(mass))[:, free]
    back = kept - null @ cho_solve(cho_factor(inner), null.T @ (stiffness @ kept))
    condensed = (stiffness @ back)[free]
    return back, 0.5 * (condensed + condensed.T), mass[np.ix_(free, free)]


def _void_error(massless: NullSpace, void: NullSpace) -> ModelError:
    vectors = np.abs(massless.vectors @ void.vectors)
    dofs = sorted({int(np.argmax(vector)) for vector in vectors.T})
    return ModelError(
        f"{void.dimension} motion(s) have neither mass nor stiffness (mainly dofs {dofs}); "
        "give the body a mass, or hold the motion by a joint"
    )


def _mass_orthonormal(vectors: FloatArray, mass: FloatArray, *, times: int = 2) -> FloatArray:
    """Return the same space with ``R^T M R = 1``, each vector less its part along those before; by
    default twice, because once leaves the square of the condition number.
    """
    for _ in range(times if vectors.shape[1] else 0):
        lower = np.linalg.cholesky(vectors.T @ mass @ vectors)
        vectors = solve_triangular(lower, vectors.T, lower=True, check_finite=False).T
    return vectors


@dataclass(frozen=True, eq=False)
class _ReducedFlexibility:
    """``M x = mu K x`` as one symmetric matrix ``L^-1 M L^-T``, K = L L^T.

    Attributes:
        lower: L ``(n, n)``.
        matrix: ``(n, n)``; only its lower half counts.
    """

    lower: FloatArray
    matrix: FloatArray

    def find_largest(self, count: int) -> tuple[FloatArray, FloatArray] | None:
        """Return the largest flexibilities mu, falling, and shapes of unit stiffness; None where these lie
        too far apart for one solve.
        """
        size = len(self.matrix)
        solved = dsyevr(self.matrix, range="I", il=size - count + 1, iu=size, lower=1)
        return self._expand(solved, count)

    def find_above(self, least: float, most: int | None) -> tuple[FloatArray, FloatArray] | None:
        """Return likewise those above a limit, the largest of them."""
        # no eigenvalue is negative, so none is larger than their sum
        largest = max(WIDENING * float(np.trace(self.matrix)), 2.0 * least)
        solved = dsyevr(self.matrix, range="V", vl=least, vu=largest, lower=1)
        return self._expand(solved, most)

    def _expand(
        self, solved: tuple[Any, ...], most: int | None
    ) -> tuple[FloatArray, FloatArray] | None:
        values, vectors, number, _, info = solved
        if info != 0 or number == 0 or _spreads_too_far(values[0], values[number - 1]):
            return None
        columns = np.arange(number)[::-1][:most]
        shapes = solve_triangular(
            self.lower, vectors[:, columns], lower=True, trans="T", check_finite=False
        )
        return values[columns], shapes


def reduce_flexibility(stiffness: FloatArray, mass: FloatArray) -> _ReducedFlexibility | None:
    """Reduce a pencil to one symmetric matrix; None where the stiffness is not positive definite."""
    lower, info = dpotrf(stiffness, lower=1)
    reduced, failed = dsygst(mass, lower, itype=1, lower=1) if info == 0 else (mass, 1)
    return None if failed != 0 else _ReducedFlexibility(lower, reduced)


def _few_modes(
    stiffness: FloatArray, mass: FloatArray, wanted: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return the lowest modes alone, at a tenth of the cost of all; None where many are wanted or
    one solve does not resolve them.
    """
    reduced = reduce_flexibility(stiffness, mass) if 0 < wanted <= FEW * len(mass) else None
    solved = None if reduced is None else reduced.find_largest(wanted)
    if solved is None or len(solved[0]) < wanted:
        return None
    flexibilities, shapes = solved
    return np.asarray(1.0 / flexibilities), np.asarray(shapes / np.sqrt(flexibilities))


def _two_sided_modes(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the low modes from ``M x = mu K x``, high ones from ``K x = lambda M x`` where one
    solve cannot resolve both ends.
    """
    if len(mass) == 0:
        return np.zeros(0), np.zeros((0, 0))
    # a solve loses eigenvalues below rounding of its largest: that of M x = mu K x is exact where
    # mu is large, so at low modes. Its shapes have unit stiffness; times omega they have unit mass.
    # Transposed, because LAPACK's matrices lie by columns
    flexibilities, flexible, info = dsygvd(mass.T, stiffness.T)
    _require_converged(info, "stiffness", len(mass))
    if flexibilities[0] > SPREAD_LIMIT * flexibilities[-1]:
        eigenvalues = 1.0 / flexibilities[::-1]
        return eigenvalues, flexible[:, ::-1] * np.sqrt(eigenvalues)
    eigenvalues, shapes, info = dsygvd(stiffness.T, mass.T)
    _require_converged(info, "mass", len(mass))
    split = _widest_gap(eigenvalues, float(np.sqrt(eigenvalues[-1] / flexibilities[-1])))
    if split:
        eigenvalues[:split] = 1.0 / flexibilities[: -split - 1 : -1]
        shapes[:, :split] = flexible[:, : -split - 1 : -1] * np.sqrt(eigenvalues[:split])
    return eigenvalues, shapes


def _widest_gap(eigenvalues: FloatArray, middle: float) -> int:
    """Return the number of modes below the widest gap near the middle: no cluster is cut."""
    inside = np.flatnonzero(
        (eigenvalues > middle / SPLIT_WINDOW) & (eigenvalues < middle * SPLIT_WINDOW)
    )
    start = int(np.searchsorted(eigenvalues, middle))
    candidates = [start, *(int(i) for i in inside if i > 0)]
    gaps = [
        np.inf
        if i in (0, len(eigenvalues))
        else eigenvalues[i] / max(eigenvalues[i - 1], middle / SPLIT_WINDOW**2)
        for i in candidates
    ]
    return candidates[int(np.argmax(gaps))]


def _require_converged(info: int, which: str, size: int) -> None:
    if info > size:
        raise ModelError(
            f"the {which} matrix is not positive definite once rigid-body motions and massless dofs are taken out"
        )
    if info != 0:
        raise ConvergenceError(
            f"LAPACK dsygvd stopped with info = {info}; look for entries that differ by more than 15 decades"
        )
