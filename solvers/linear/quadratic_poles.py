"""Poles of ``p'' + C p' + Omega^2 p = 0`` in modal coordinates: all of them by one state matrix, or
those in a circle from a small space that is shown to leave none out.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dpotrf, dsyevr

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

START_FACTOR, START_EXTRA = 1.25, 24  # undamped modes in the first space, against those wanted
LARGEST_SHARE = 0.6  # of all modes: from here on all poles cost no more
SMALL = 200  # modes up to which all poles cost next to nothing
HEAVY = 0.5  # x^T C x r over x^T (Omega^2 + r^2) x of outer motions that join the space
MARGIN = 1.02  # times the radius: poles up to here converge, too, so that none is at the rim
SEEN = 1.05  # times the radius: poles up to here must stay outside within their errors
BEYOND = 1.02  # times the frequency of the highest undamped mode wanted: radius of the circle
ROUNDS = 8
SWEEPS = 5  # of the outer equations in each round
NEGLIGIBLE = 1e-6  # share of a shape's energy norm; a pole moves by the square of what is left out
FINER = 0.3  # less of it is left out in each round
NEGATIVE = 1e-12  # of the largest entry: below zero by more than this, a damper feeds energy
REAL_POLE = 1e-9
AT_REST = 1e-8  # of the radius: poles below it are at rest
POLISH_ROUNDS = 8
POLISHED = 1e-8  # change of a pole in the last round, after which the next digits are right, too
MOST_POLISHED = 12  # poles beyond the circle; each takes some factorisations of the whole pencil


@dataclass(frozen=True, eq=False)
class CirclePoles:
    """Poles on and above the real axis.

    Attributes:
        poles: ``(p,)`` all in the circle [rad/s].
        shapes: ``(m, p)`` of unit length.
        beyond: ``(q,)`` approximate ones outside the circle [rad/s]: where others may lie.
        beyond_shapes: ``(m, q)``.
    """

    poles: ComplexArray
    shapes: ComplexArray
    beyond: ComplexArray
    beyond_shapes: ComplexArray


@dataclass(frozen=True, eq=False)
class _Outer:
    """Modes above the first space without the motions that dampers all but block.

    In coordinates y with ``x = scale y`` the pencil is ``1 + (s^2 - r^2) scale^2 + s/r B``. No
    eigenvalue of B without its heavy part reaches 1/2, so ``Q(-r)`` is positive definite there. As
    ``C`` takes energy, no pole of these motions alone then lies in the circle: a complex one has
    the size of a natural frequency, all above r, and a real one in it would make ``Q`` singular
    somewhere on ``(-r, 0)``, where it is larger than at -r.

    Attributes:
        scale: ``(k,)`` ``(Omega^2 + r^2)^-1/2``.
        damping: ``(k, k)`` B without its heavy part.
        heavy: ``(k, h)`` orthonormal eigenvectors of B that join the space.
    """

    scale: FloatArray
    damping: FloatArray
    heavy: FloatArray


def find_poles_within(
    squares: FloatArray, viscous: FloatArray, radius: float, *, tolerance: float
) -> CirclePoles | None:
    """Every pole of at most a size, none left out.

    The pencil ``Q(s) = s^2 + s C + Omega^2`` is projected on the lower undamped modes, on the outer
    motions that are overdamped, and on what each pole's residual moves of the others. As the pencil
    is symmetric, the error of a pole is quadratic in what the space lacks.

    None is left out: the outer motions alone have no pole in the circle (``_Outer``), so the poles
    in it are those of the Schur complement on the space. The projection changes it by what the
    errors measure, and no pole near the circle is nearer to it than its error; real poles are
    counted by the inertia of ``Q(-r)`` as well.

    Args:
        squares: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2], rising.
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        radius: Largest size of a pole [rad/s].
        tolerance: Error of a pole over its size that is good enough.

    Returns:
        None where all poles must be computed at once: negative dampers, or a space that does not
        converge while it is small.

    Source: Sleijpen and van der Vorst (1996), SIAM J. Matrix Anal. Appl. 17, 401-425 (corrections);
    Tisseur and Meerbergen (2001), SIAM Review 43, 235-286, sections 3.1 and 4.
    """
    size, inside = len(squares), int(np.count_nonzero(squares <= radius**2))
    lower = max(int(START_FACTOR * inside) + START_EXTRA, 0)
    if size <= SMALL or lower > LARGEST_SHARE * size or not takes_energy(viscous):
        return None
    outer = _find_outer(squares[lower:], viscous[lower:, lower:], radius)
    if outer is None or lower + outer.heavy.shape[1] > LARGEST_SHARE * size:
        return None
    first = scipy.linalg.block_diag(
        np.eye(lower), np.linalg.qr(outer.scale[:, None] * outer.heavy)[0]
    )
    space = first
    for turn in range(ROUNDS):
        poles, coordinates = _project(squares, viscous, space)
        shapes = real_product(space, coordinates)
        shapes /= np.linalg.norm(shapes, axis=0)
        near = np.abs(poles) <= SEEN * radius
        errors = np.full(len(poles), np.inf)
        lacking, errors[near] = _correct(
            squares, viscous, outer, poles[near], shapes[:, near], radius
        )
        wanted = np.abs(poles[near]) <= MARGIN * radius
        allowed = tolerance * np.maximum(np.abs(poles), AT_REST * radius)
        apart = np.abs(np.abs(poles) - radius) > errors
        if (errors <= allowed)[near][wanted].all() and apart[near].all():
            if not _agree(squares, viscous, space, radius):
                return None
            within = np.abs(poles) <= radius
            return CirclePoles(poles[within], shapes[:, within], poles[~within], shapes[:, ~within])
        # shapes with their corrections take the place of those before, so that spaces stay small
        moved = shapes[lower:, near][:, wanted] + lacking[:, wanted]
        space = _widen(first, moved, outer, radius, NEGLIGIBLE * FINER**turn)
        if space.shape[1] > LARGEST_SHARE * size:
            return None
    return None


def find_lowest_poles(
    squares: FloatArray, viscous: FloatArray, wanted: int, *, tolerance: float
) -> tuple[ComplexArray, ComplexArray] | None:
    """Every pole in the circle of the lowest undamped modes, and those beyond it that are for the
    most part one of them, as the fast pole of an overdamped mode is.

    Args:
        squares: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2], rising.
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        wanted: Number of the lowest undamped modes.
        tolerance: Error of a pole over its size that is good enough.

    Returns:
        Poles ``(p,)`` on and above the real axis [rad/s] and shapes ``(m, p)``; None where all
        poles must be computed at once.
    """
    radius = BEYOND * float(np.sqrt(squares[min(wanted, len(squares)) - 1]))
    if not radius > 0.0:
        return None
    circle = find_poles_within(squares, viscous, radius, tolerance=tolerance)
    if circle is None:
        return None
    led = (np.abs(circle.beyond_shapes[:wanted]) ** 2).sum(axis=0) > 0.5
    polished = polish_poles(squares, viscous, circle.beyond[led], circle.beyond_shapes[:, led])
    if polished is None:
        return None
    return (
        np.concatenate([circle.poles, polished[0]]),
        np.hstack([circle.shapes, polished[1]]),
    )


def polish_poles(
    squares: FloatArray, viscous: FloatArray, poles: ComplexArray, shapes: ComplexArray
) -> tuple[ComplexArray, ComplexArray] | None:
    """Poles from where they are nearly right, each on its own; None where one does not converge.

    Args:
        squares: ``(m,)`` undamped eigenvalues [rad^2/s^2].
        viscous: ``(m, m)`` modal damping [1/s].
        poles: ``(k,)`` [1/s].
        shapes: ``(m, k)``.

    Source: Parlett (1974), Math. Comp. 28, 679-693, for the cubic convergence of Rayleigh quotient
    iteration.
    """
    if len(poles) > MOST_POLISHED:
        return None
    poles, shapes = poles.copy(), shapes.copy()
    for index in range(len(poles)):
        for _ in range(POLISH_ROUNDS):
            pole, shape = poles[index], shapes[:, index]
            pencil = pole * viscous + np.diag(pole**2 + squares)
            shape = np.linalg.solve(pencil, 2.0 * pole * shape + viscous @ shape)
            shape /= np.linalg.norm(shape)
            pushed = viscous @ shape
            step = (shape @ ((pole**2 + squares) * shape + pole * pushed)) / (
                shape @ (2.0 * pole * shape + pushed)
            )
            poles[index], shapes[:, index] = pole - step, shape
            if abs(step) <= POLISHED * abs(pole):
                break
        else:
            return None
    return poles, shapes


def state_eigenpairs(squares: FloatArray, viscous: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """All poles and shapes of ``p'' + C p' + K p = 0`` for a diagonal K ``(m,)`` or a symmetric one
    ``(m, m)``.
    """
    count = len(viscous)
    stiffness = np.diag(squares) if squares.ndim == 1 else squares
    state = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness, -viscous]])
    # balance displacement against velocity: both then have the size of the highest frequency
    scale = max(
        float(np.sqrt(np.abs(stiffness).max(initial=0.0))),
        float(np.abs(viscous).max(initial=0.0)),
        1.0,
    )
    state[:count, count:] *= scale
    state[count:, :count] /= scale
    poles, vectors = scipy.linalg.eig(state, check_finite=False)
    return np.asarray(poles, dtype=np.complex128), np.asarray(vectors[:count], dtype=np.complex128)


def takes_energy(viscous: FloatArray) -> bool:
    """Whether damping is positive semidefinite, to within rounding."""
    shift = NEGATIVE * len(viscous) * float(np.abs(viscous).max(initial=0.0))
    _, info = dpotrf(viscous + shift * np.eye(len(viscous)), lower=1) if shift else (None, 0)
    return bool(info == 0)


def _find_outer(squares: FloatArray, viscous: FloatArray, radius: float) -> _Outer | None:
    scale = 1.0 / np.sqrt(squares + radius**2)
    damping = radius * (scale[:, None] * viscous * scale)
    _, info = dpotrf(HEAVY * np.eye(len(scale)) - damping, lower=1)
    if info == 0:
        return _Outer(scale, damping, np.zeros((len(scale), 0)))
    most = 1.01 * float(np.abs(damping).sum(axis=1).max())
    values, vectors, count, _, info = dsyevr(damping, range="V", vl=HEAVY, vu=most, lower=1)
    if info != 0:
        return None
    heavy, values = vectors[:, :count], values[:count]
    return _Outer(scale, damping - (heavy * values) @ heavy.T, heavy)


def _project(
    squares: FloatArray, viscous: FloatArray, space: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Poles on and above the real axis of the pencil on a space, and coordinates of shapes."""
    poles, coordinates = state_eigenpairs(
        space.T @ (squares[:, None] * space), space.T @ viscous @ space
    )
    # a conjugate pole says the same; but equal real ones may come as a conjugate pair
    real = np.abs(poles.imag) <= REAL_POLE * np.abs(poles)
    upper = real | (poles.imag > 0.0)
    return np.where(real, poles.real + 0.0j, poles)[upper], coordinates[:, upper]


def _correct(
    squares: FloatArray,
    viscous: FloatArray,
    outer: _Outer,
    poles: ComplexArray,
    shapes: ComplexArray,
    radius: float,
) -> tuple[ComplexArray, FloatArray]:
    """What outer motions lack ``(k, p)``, and errors of poles ``(p,)`` [rad/s] by that."""
    lower = len(squares) - len(outer.scale)
    damped = real_product(viscous, shapes)
    residuals = (poles**2 + squares[:, None]) * shapes + poles * damped
    given = -outer.scale[:, None] * residuals[lower:]
    inertia = (poles**2 - radius**2) * outer.scale[:, None] ** 2
    diagonal = 1.0 + inertia + poles / radius * outer.damping.diagonal()[:, None]
    floor = np.finfo(float).eps ** 0.5
    diagonal = np.where(np.abs(diagonal) < floor, floor, diagonal)
    found = np.zeros_like(given)
    for _ in range(SWEEPS):
        left = given - (1.0 + inertia) * found
        left -= poles / radius * real_product(outer.damping, found)
        found = found + left / diagonal
        found -= real_product(outer.heavy, real_product(outer.heavy.T, found))
    lacking = outer.scale[:, None] * found
    works = np.abs(np.einsum("mp,mp->p", residuals[lower:], lacking))
    slopes = np.abs(np.einsum("mp,mp->p", shapes, 2.0 * poles * shapes + damped))
    # where two poles meet, the slope vanishes and they part with the root
    errors = np.minimum(works / np.maximum(slopes, np.finfo(float).tiny), np.sqrt(works))
    return lacking, errors


def _widen(
    first: FloatArray, shapes: ComplexArray, outer: _Outer, radius: float, negligible: float
) -> FloatArray:
    """The first space with what the outer parts ``(k, p)`` of shapes add to it, orthonormal."""
    parts = np.hstack([shapes.real, shapes.imag]) / (radius * outer.scale[:, None])
    parts -= outer.heavy @ (outer.heavy.T @ parts)
    directions, sizes, _ = np.linalg.svd(parts, full_matrices=False)
    lower = len(first) - len(outer.scale)
    added: FloatArray = np.zeros((len(first), int(np.count_nonzero(sizes > negligible))))
    added[lower:] = outer.scale[:, None] * directions[:, : added.shape[1]]
    for _ in range(2):
        added = np.asarray(np.linalg.qr(added - first @ (first.T @ added))[0])
    return np.hstack([first, added])


def _agree(squares: FloatArray, viscous: FloatArray, space: FloatArray, radius: float) -> bool:
    """Whether the whole ``Q(-r)`` has as many negative eigenvalues as its projection."""
    pencil = np.diag(squares + radius**2) - radius * viscous
    negative = [
        int(np.count_nonzero(np.linalg.eigvalsh(matrix) < 0.0))
        for matrix in (pencil, space.T @ pencil @ space)
    ]
    return negative[0] == negative[1]


def real_product(matrix: FloatArray, columns: ComplexArray) -> ComplexArray:
    """A real matrix times complex columns as one real product, several times as fast."""
    found = matrix @ np.hstack([columns.real, columns.imag])
    return np.asarray(found[:, : columns.shape[1]] + 1j * found[:, columns.shape[1] :])
