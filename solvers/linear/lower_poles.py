"""The lowest poles of a system whose dampers couple its undamped modes, from a small space that grows until they are converged."""

from collections.abc import Callable

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dpotrf

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

Inverse = Callable[[ComplexArray, ComplexArray], ComplexArray]  # of the pencil at poles (p,), each times its column of (m, p)
START_FACTOR, START_EXTRA = 1.25, 24  # undamped modes in the first space, against those wanted
ROUNDS = 12
LARGEST_SHARE = 0.5  # of all modes: from here on all poles cost no more
DEPENDENT = 1e-8  # a direction that the space holds but for this share of it adds nothing
POLISH_EXTRA = 12  # undamped modes besides those wanted, where poles are polished
POLISH_ROUNDS = 8
POLISHED = 1e-8  # change of a pole in the last round, after which the next digits are right, too
ROUGH = 1e-9  # error of a pole over its size from which it is polished
LEEWAY = 10.0  # times its estimated error: as far as a pole may move before it counts as another
LEADING = 0.05  # share of the wanted undamped modes from which a pole is one of theirs
NEGATIVE = 1e-12  # of the largest entry: below zero by more than this, a damper feeds energy


def find_lower_poles(
    squares: FloatArray,
    viscous: FloatArray,
    wanted: int,
    *,
    tolerance: float,
    width_share: float = 0.0,
    invert: Inverse | None = None,
) -> tuple[ComplexArray, ComplexArray] | None:
    """Every pole whose motion is for the most part one of the lowest undamped modes.

    The quadratic pencil is projected on the lower undamped modes; what each pole lacks is its residual over the diagonal of the
    pencil, which joins the space until the poles move no more. As the pencil is symmetric, the error of a pole is quadratic in its
    residual.

    Args:
        squares: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2].
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        wanted: Number of the lowest undamped modes.
        tolerance: Error of a pole over its size that is good enough.
        width_share: And over its real part, the half-width of its peak.
        invert: Where it is cheap, the inverse of the pencil: poles that are not good enough are then polished one by one.

    Returns:
        Poles ``(p,)`` on and above the real axis [rad/s] and shapes ``(m, p)``; None where all poles must be
        computed at once: negative dampers, or a space that does not converge while it is small.

    Source: Sleijpen and van der Vorst (1996), SIAM J. Matrix Anal. Appl. 17, 401-425 (Davidson's correction); Tisseur and Meerbergen
        (2001), SIAM Review 43, 235-286, section 4.
    """
    size = len(squares)
    start = int(START_FACTOR * wanted) + START_EXTRA if invert is None else wanted + POLISH_EXTRA
    if start > LARGEST_SHARE * size or not _takes_energy(viscous):
        return None
    space = np.eye(size, start)
    for _ in range(ROUNDS):
        poles, coordinates = _project(squares, viscous, space)
        shapes = space @ coordinates
        # a conjugate pole says the same
        picked = np.flatnonzero(_led_by(shapes, wanted) & (poles.imag >= 0.0))
        poles, shapes = poles[picked], shapes[:, picked]
        damped = viscous @ np.ascontiguousarray(shapes.real) + 1j * (viscous @ np.ascontiguousarray(shapes.imag))
        residuals = (poles**2 + squares[:, None]) * shapes + poles * damped
        diagonal = poles**2 + squares[:, None] + poles * viscous.diagonal()[:, None]
        sizes = np.maximum(np.abs(diagonal), np.finfo(float).eps * (np.abs(poles) ** 2 + squares[:, None]))
        slopes = np.abs(np.einsum("mp,mp->p", shapes, 2.0 * poles * shapes + damped))
        errors = (np.abs(residuals) ** 2 / sizes).sum(axis=0) / np.maximum(slopes, np.finfo(float).tiny)
        open_ = errors > np.maximum(tolerance * np.abs(poles), width_share * np.abs(poles.real))
        if invert is not None:
            rough = np.flatnonzero(errors > ROUGH * np.abs(poles))
            polished = _polish(squares, viscous, invert, poles[rough], shapes[:, rough], LEEWAY * errors[rough])
            if polished is not None:
                moved = poles.copy()
                moved[rough], shapes[:, rough] = polished
                doubled = _count_neighbours(moved) > _count_neighbours(poles)
                if not doubled.any():
                    return moved, shapes
                # two went to one pole: their space was too small
                open_ = doubled
        if not open_.any():
            return poles, shapes
        missing = residuals[:, open_] / np.where(np.abs(diagonal[:, open_]) < sizes[:, open_], sizes[:, open_], diagonal[:, open_])
        space = _widen(space, np.hstack([missing.real, missing.imag]))
        if space.shape[1] > LARGEST_SHARE * size:
            return None
    return None


def _polish(
    squares: FloatArray, viscous: FloatArray, invert: Inverse, poles: ComplexArray, shapes: ComplexArray, limits: FloatArray
) -> tuple[ComplexArray, ComplexArray] | None:
    """Poles from where they are nearly right, each on its own; None where one does not converge near to where it was.

    Source: Parlett (1974), Math. Comp. 28, 679-693, for the cubic convergence of Rayleigh quotient iteration.
    """
    poles, shapes = poles.copy(), shapes.copy()
    first, left = poles.copy(), np.arange(len(poles))
    for _ in range(POLISH_ROUNDS):
        moved = invert(poles[left], shapes[:, left])
        moved /= np.linalg.norm(moved, axis=0)
        pushed = _real_product(viscous, moved)
        slope = np.einsum("mp,mp->p", moved, 2.0 * poles[left] * moved + pushed)
        steps = np.einsum("mp,mp->p", moved, (poles[left] ** 2 + squares[:, None]) * moved + poles[left] * pushed) / slope
        shapes[:, left] = moved
        poles[left] -= steps
        left = left[~(np.abs(steps) <= POLISHED * np.abs(poles[left]))]
        if not len(left):
            return (poles, shapes) if (np.abs(poles - first) <= limits).all() else None
    return None


def _count_neighbours(poles: ComplexArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """How many poles each of them equals to within what polishing leaves."""
    return np.asarray((np.abs(poles[:, None] - poles) <= POLISHED * np.abs(poles)[:, None]).sum(axis=1), dtype=np.int64)


def _real_product(matrix: FloatArray, columns: ComplexArray) -> ComplexArray:
    found = matrix @ np.hstack([columns.real, columns.imag])
    return np.asarray(found[:, : columns.shape[1]] + 1j * found[:, columns.shape[1] :])


def state_eigenpairs(squares: FloatArray, viscous: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """All poles and shapes of ``p'' + C p' + K p = 0`` for a diagonal K ``(m,)`` or a symmetric one ``(m, m)``."""
    count = len(viscous)
    stiffness = np.diag(squares) if squares.ndim == 1 else squares
    state = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness, -viscous]])
    # balance displacement against velocity: both then have the size of the highest frequency
    scale = max(float(np.sqrt(np.abs(stiffness).max(initial=0.0))), float(np.abs(viscous).max(initial=0.0)), 1.0)
    state[:count, count:] *= scale
    state[count:, :count] /= scale
    poles, vectors = scipy.linalg.eig(state, check_finite=False)
    return np.asarray(poles, dtype=np.complex128), np.asarray(vectors[:count], dtype=np.complex128)


def _takes_energy(viscous: FloatArray) -> bool:
    shift = NEGATIVE * len(viscous) * float(np.abs(viscous).max(initial=0.0))
    _, info = dpotrf(viscous + shift * np.eye(len(viscous)), lower=1) if shift else (None, 0)
    return bool(info == 0)


def _project(squares: FloatArray, viscous: FloatArray, space: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    poles, shapes = state_eigenpairs(space.T @ (squares[:, None] * space), space.T @ viscous @ space)
    return poles, shapes / np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)


def _led_by(shapes: ComplexArray, wanted: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Poles that move the wanted modes: with a noticeable share, or more than any other pole does."""
    shares = np.abs(shapes[:wanted]) ** 2
    led = shares.sum(axis=0) > LEADING
    led[np.argmax(shares, axis=1)] = True
    return np.asarray(led)


def _widen(space: FloatArray, directions: FloatArray) -> FloatArray:
    """The space with what directions ``(m, k)`` add to it, orthonormal."""
    directions = directions / np.maximum(np.linalg.norm(directions, axis=0), np.finfo(float).tiny)
    for _ in range(2):
        directions = directions - space @ (space.T @ directions)
    span, triangular, _ = scipy.linalg.qr(directions, mode="economic", pivoting=True, check_finite=False)
    return np.hstack([space, span[:, np.abs(triangular.diagonal()) > DEPENDENT]])
