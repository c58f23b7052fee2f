"""Poles of ``p'' + C p' + Omega^2 p = 0`` in modal coordinates: all by one state matrix, or those in a
circle by way of a small space that is shown to leave none out.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dsyevr, dsytrf

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

NEGATIVE = 1e-12  # of the largest entry: below zero by more than this, a damper feeds energy
REAL_POLE = 1e-9
AT_REST = 1e-8  # of the radius: poles below it are at rest
START_FACTOR, START_EXTRA = 1.15, 24  # undamped modes in the first space, against those wanted
LARGEST_SHARE = 0.6  # of all modes: from here on all poles cost no more
SMALL = 60  # modes up to which all poles cost next to nothing
HEAVY = 0.5  # x^T C x r over x^T (Omega^2 + r^2) x of outer motions that join the space
MARGIN = 1.02  # times the radius: poles up to here converge, too, so that none is at the rim
SEEN = 1.05  # times the radius: poles up to here must stay outside within their errors
BEYOND = 1.02  # times the frequency of the highest undamped mode wanted: radius of the circle
ROUNDS = 8
SWEEPS = 2  # of the outer equations after the first
RESOLVED = 0.1  # error of a pole over its distance to the next one, from where it is refined alone
STRAYED = 0.3  # of that distance: a pole refined alone is still the one it was
MOST_LEFT_OUT = 1e-2  # of a shape's energy norm, however far the next pole is
FINER = 0.3  # less of shapes is left out in each round
POLISH_ROUNDS = 8
POLISHED = 1e-8  # change of a pole in the last round, after which the next digits are right, too
REFINE_ROUNDS = 8
MOST_POLISHED = 12  # poles beyond the circle; each takes some factorisations of the whole pencil


@dataclass(frozen=True, eq=False)
class _Pencil:
    """``Q(s) = s^2 + s C + Omega^2`` and the circle in which its poles are wanted.

    Attributes:
        eigenvalues: ``(m,)`` of Omega [rad^2/s^2].
        viscous: ``(m, m)`` C [1/s].
        radius: [rad/s].
        tolerance: Error of a pole over its size that is good enough.
    """

    eigenvalues: FloatArray
    viscous: FloatArray
    radius: float
    tolerance: float

    def apply(self, poles: ComplexArray, shapes: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return ``Q(s) x`` and ``Q'(s) x`` of poles ``(p,)`` and shapes ``(m, p)``."""
        damped = real_product(self.viscous, shapes)
        inner = (poles**2 + self.eigenvalues[:, None]) * shapes + poles * damped
        return inner, 2.0 * poles * shapes + damped

    def allowed(self, poles: ComplexArray) -> FloatArray:
        """Return the errors ``(p,)`` of poles that are good enough [rad/s]."""
        return self.tolerance * np.maximum(np.abs(poles), AT_REST * self.radius)


@dataclass(frozen=True, eq=False)
class _ProjectedPencil:
    """All poles of the pencil on the lower modes and on columns of the outer ones.

    Attributes:
        columns: ``(k, w)`` orthonormal.
        stiffness: ``(n, n)`` on the space.
        damping: ``(n, n)``.
        poles: ``(2 n,)``.
        coordinates: ``(n, 2 n)`` of shapes in the space, of unit length.
        slopes: ``(2 n,)`` ``x^T Q'(s) x``.
        upper: Indices of poles on and above the real axis.
    """

    columns: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    poles: ComplexArray
    coordinates: ComplexArray
    slopes: ComplexArray
    upper: NDArray[np.int64]

    def expand(self, coordinates: ComplexArray) -> ComplexArray:
        """Return the shapes ``(m, p)`` from coordinates ``(n, p)``."""
        lower = len(coordinates) - self.columns.shape[1]
        return np.vstack([coordinates[:lower], real_product(self.columns, coordinates[lower:])])

    def solve(
        self, poles: ComplexArray, forces: ComplexArray, skipped: NDArray[np.int64]
    ) -> ComplexArray:
        """Return ``Q(s)^-1`` on the space times forces ``(m, p)``, each without its own pole.

        Source: Tisseur and Meerbergen (2001), SIAM Review 43, 235-286, section 3.5.
        """
        lower = len(forces) - len(self.columns)
        projected = np.vstack([forces[:lower], real_product(self.columns.T, forces[lower:])])
        weights = self.slopes[:, None] * (poles - self.poles[:, None])
        weights[skipped, np.arange(len(skipped))] = np.inf
        return self.expand(self.coordinates @ ((self.coordinates.T @ projected) / weights))

    def gaps(self, picked: NDArray[np.int64]) -> FloatArray:
        """Return the distances ``(p,)`` of picked poles to the next ones [rad/s]."""
        distances = np.abs(self.poles[picked, None] - self.poles)
        distances[np.arange(len(picked)), picked] = np.inf
        return distances.min(axis=1, initial=np.inf)


def state_eigenpairs(
    eigenvalues: FloatArray, viscous: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return all poles and shapes of ``p'' + C p' + K p = 0`` for a diagonal K ``(m,)`` or a
    full one ``(m, m)``.
    """
    count = len(viscous)
    stiffness = np.diag(eigenvalues) if eigenvalues.ndim == 1 else eigenvalues
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


def _takes_energy(viscous: FloatArray) -> bool:
    """Return whether damping is positive semidefinite, to within rounding."""
    shift = NEGATIVE * len(viscous) * float(np.abs(viscous).max(initial=0.0))
    _, info = dpotrf(viscous + shift * np.eye(len(viscous)), lower=1) if shift else (None, 0)
    return bool(info == 0)


def _project_pencil(pencil: _Pencil, columns: FloatArray) -> _ProjectedPencil:
    """Return the pencil on the lower modes and on columns ``(k, w)`` of the outer ones."""
    lower = len(pencil.eigenvalues) - len(columns)
    viscous, eigenvalues = pencil.viscous, pencil.eigenvalues
    stiffness = scipy.linalg.block_diag(
        np.diag(eigenvalues[:lower]), columns.T @ (eigenvalues[lower:, None] * columns)
    )
    coupling = viscous[:lower, lower:] @ columns
    damping = np.block(
        [
            [viscous[:lower, :lower], coupling],
            [coupling.T, columns.T @ (viscous[lower:, lower:] @ columns)],
        ]
    )
    poles, coordinates = state_eigenpairs(stiffness, damping)
    # a conjugate pole says the same; but equal real ones may come as a conjugate pair
    real = np.abs(poles.imag) <= REAL_POLE * np.abs(poles)
    poles = np.where(real, poles.real + 0.0j, poles)
    coordinates = coordinates / np.linalg.norm(coordinates, axis=0)
    resisted = 2.0 * poles * coordinates + real_product(damping, coordinates)
    slopes = np.einsum("np,np->p", coordinates, resisted)
    tiny = np.finfo(float).tiny
    return _ProjectedPencil(
        columns=columns,
        stiffness=stiffness,
        damping=damping,
        poles=poles,
        coordinates=coordinates,
        slopes=np.where(np.abs(slopes) > tiny, slopes, tiny),
        upper=np.flatnonzero(real | (poles.imag > 0.0)),
    )


def real_product(
    matrix: NDArray[np.floating], columns: NDArray[np.complexfloating]
) -> NDArray[np.complexfloating]:
    """Return a real matrix times complex columns as one real product, several times as fast."""
    product = matrix @ np.hstack([columns.real, columns.imag])
    return product[:, : columns.shape[1]] + 1j * product[:, columns.shape[1] :]


@dataclass(frozen=True, eq=False)
class _CirclePoles:
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
        heavy: ``(k, h)`` orthonormal eigenvectors of B that join the space.
        diagonal: ``(k,)`` of B without its heavy part; in single precision, as only sweeps use it.
        coupling: ``(k, k)`` the rest of it.
    """

    scale: FloatArray
    heavy: FloatArray
    diagonal: NDArray[np.float32]
    coupling: NDArray[np.float32]


def _find_poles_within(
    eigenvalues: FloatArray, viscous: FloatArray, radius: float, *, tolerance: float
) -> _CirclePoles | None:
    """Find every pole of at most a size, none left out.

    The pencil ``Q(s) = s^2 + s C + Omega^2`` is projected on the lower undamped modes, on the outer
    motions that are overdamped, and on what each pole's residual moves of the others, until every
    pole is nearer to the exact one than to the next. As the pencil is symmetric, the error of a
    pole is quadratic in what the space lacks. Poles that stand apart are then refined each on its
    own, without a larger space.

    None is left out: the outer motions alone have no pole in the circle (``_Outer``), so the poles
    in it are those of the Schur complement on the space. The projection changes it by what the
    errors measure, and no pole near the circle crosses it by that: it is farther from it than its
    error, or it is refined first. Real poles are counted by the inertia of
    ``Q(-r)`` as well.

    Args:
        eigenvalues: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2], rising.
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        radius: Largest size of a pole [rad/s].
        tolerance: Error of a pole over its size that is good enough.

    Returns:
        None where all poles must be computed at once: negative dampers, or a space that does not
        converge while it is small.

    Source: Sleijpen and van der Vorst (1996), SIAM J. Matrix Anal. Appl. 17, 401-425 (corrections);
    Neumaier (1985), SIAM J. Numer. Anal. 22, 914-923 (residual inverse iteration).
    """
    size, inside = len(eigenvalues), int(np.count_nonzero(eigenvalues <= radius**2))
    lower = max(int(START_FACTOR * inside) + START_EXTRA, 0)
    if size <= SMALL or lower > LARGEST_SHARE * size or not _takes_energy(viscous):
        return None
    pencil = _Pencil(eigenvalues, viscous, radius, tolerance)
    outer = _find_outer(pencil, lower)
    if outer is None or lower + outer.heavy.shape[1] > LARGEST_SHARE * size:
        return None
    first = columns = np.linalg.qr(outer.scale[:, None] * outer.heavy)[0]
    for turn in range(ROUNDS):
        small = _project_pencil(pencil, columns)
        near = small.upper[np.abs(small.poles[small.upper]) <= SEEN * radius]
        poles, shapes = small.poles[near], small.expand(small.coordinates[:, near])
        lacking, errors = _correct(pencil, outer, poles, shapes)
        wanted, gaps = np.abs(poles) <= MARGIN * radius, small.gaps(near)
        enough = np.maximum(pencil.allowed(poles), RESOLVED * gaps)
        apart = np.abs(np.abs(poles) - radius) > errors
        if np.where(wanted, errors <= enough, apart).all():
            rough = np.flatnonzero(wanted & (errors > pencil.allowed(poles)))
            refined = _refine(
                pencil, outer, small, near[rough], shapes[:, rough], lacking[:, rough]
            )
            if refined is not None:
                if not _agree(pencil, small):
                    return None
                far = np.setdiff1d(small.upper, near)
                poles[rough], shapes[:, rough] = refined
                within = np.abs(poles) <= radius
                return _CirclePoles(
                    poles[within],
                    shapes[:, within],
                    np.concatenate([poles[~within], small.poles[far]]),
                    np.hstack([shapes[:, ~within], small.expand(small.coordinates[:, far])]),
                )
        # the relative error of a pole is half the square of what its shape lacks
        left_out = np.sqrt(2.0 * enough * np.maximum(np.abs(poles), AT_REST * radius)) / radius
        left_out = FINER**turn * np.minimum(left_out, MOST_LEFT_OUT)
        # shapes with their corrections take the place of those before, so that spaces stay small
        moved = (shapes[lower:] + lacking) / left_out
        columns = _widen(first, moved[:, wanted | ~apart], outer, radius)
        if lower + columns.shape[1] > LARGEST_SHARE * size:
            return None
    return None


def find_lowest_poles(
    eigenvalues: FloatArray, viscous: FloatArray, wanted: int, *, tolerance: float
) -> tuple[ComplexArray, ComplexArray] | None:
    """Find every pole in the circle of the lowest undamped modes, and those beyond it that are for
    the most part one of them, as the fast pole of an overdamped mode is.

    Args:
        eigenvalues: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2], rising.
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        wanted: Number of the lowest undamped modes.
        tolerance: Error of a pole over its size that is good enough.

    Returns:
        Poles ``(p,)`` on and above the real axis [rad/s] and shapes ``(m, p)``; None where all
        poles must be computed at once.
    """
    radius = BEYOND * float(np.sqrt(eigenvalues[min(wanted, len(eigenvalues)) - 1]))
    if not radius > 0.0:
        return None
    circle = _find_poles_within(eigenvalues, viscous, radius, tolerance=tolerance)
    if circle is None:
        return None
    mostly_wanted = (np.abs(circle.beyond_shapes[:wanted]) ** 2).sum(axis=0) > 0.5
    polished = _polish_poles(
        eigenvalues, viscous, circle.beyond[mostly_wanted], circle.beyond_shapes[:, mostly_wanted]
    )
    if polished is None:
        return None
    return (
        np.concatenate([circle.poles, polished[0]]),
        np.hstack([circle.shapes, polished[1]]),
    )


def _polish_poles(
    eigenvalues: FloatArray, viscous: FloatArray, poles: ComplexArray, shapes: ComplexArray
) -> tuple[ComplexArray, ComplexArray] | None:
    """Return the poles from where they are nearly right, each on its own; None where one does not
    converge.

    Args:
        eigenvalues: ``(m,)`` undamped eigenvalues [rad^2/s^2].
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
            # a real pole keeps everything real
            pole = poles[index] if poles[index].imag else poles[index].real
            shape = shapes[:, index] if poles[index].imag else shapes[:, index].real
            matrix = pole * viscous
            matrix[np.diag_indices(len(matrix))] += pole**2 + eigenvalues
            shape = np.linalg.solve(matrix, 2.0 * pole * shape + viscous @ shape)
            shape /= np.linalg.norm(shape)
            resisted = viscous @ shape
            step = (shape @ ((pole**2 + eigenvalues) * shape + pole * resisted)) / (
                shape @ (2.0 * pole * shape + resisted)
            )
            poles[index], shapes[:, index] = pole - step, shape
            if abs(step) <= POLISHED * abs(pole):
                break
        else:
            return None
    return poles, shapes


def _find_outer(pencil: _Pencil, lower: int) -> _Outer | None:
    """Find the modes from a number on; None where LAPACK does not converge."""
    scale = 1.0 / np.sqrt(pencil.eigenvalues[lower:] + pencil.radius**2)
    damping = pencil.radius * (scale[:, None] * pencil.viscous[lower:, lower:] * scale)
    heavy = np.zeros((len(scale), 0))
    _, info = dpotrf(HEAVY * np.eye(len(scale)) - damping, lower=1)
    if info != 0:
        most = 1.01 * float(np.abs(damping).sum(axis=1).max())
        values, vectors, count, _, info = dsyevr(damping, range="V", vl=HEAVY, vu=most, lower=1)
        if info != 0:
            return None
        heavy = vectors[:, :count]
        damping -= (heavy * values[:count]) @ heavy.T
    diagonal = damping.diagonal().astype(np.float32)
    np.fill_diagonal(damping, 0.0)
    return _Outer(scale, heavy, diagonal, damping.astype(np.float32))


def _correct(
    pencil: _Pencil, outer: _Outer, poles: ComplexArray, shapes: ComplexArray
) -> tuple[ComplexArray, FloatArray]:
    """Return what outer motions lack ``(k, p)``, and errors of poles ``(p,)`` [rad/s] by that."""
    residuals, slopes = pencil.apply(poles, shapes)
    residuals = residuals[len(shapes) - len(outer.scale) :]
    # Jacobi's sweeps need no more than single precision, which takes half the time
    scale, heavy = outer.scale.astype(np.float32)[:, None], outer.heavy.astype(np.float32)
    ratios = (poles / pencil.radius).astype(np.complex64)
    diagonal = 1.0 + pencil.radius**2 * (ratios**2 - 1.0) * scale**2
    diagonal += ratios * outer.diagonal[:, None]
    floor = np.finfo(np.float32).eps ** 0.5
    inverse = 1.0 / np.where(np.abs(diagonal) < floor, floor, diagonal)
    given = (-outer.scale[:, None] * residuals).astype(np.complex64)
    motions = given * inverse
    for _ in range(SWEEPS):
        motions = (given - ratios * real_product(outer.coupling, motions)) * inverse
        motions -= real_product(heavy, real_product(heavy.T, motions))
    lacking = outer.scale[:, None] * motions.astype(np.complex128)
    works = np.abs(np.einsum("kp,kp->p", residuals, lacking))
    sizes = np.abs(np.einsum("mp,mp->p", shapes, slopes))
    # where two poles meet, the slope vanishes and they part with the root
    errors = np.minimum(works / np.maximum(sizes, np.finfo(float).tiny), np.sqrt(works))
    return np.asarray(lacking, dtype=np.complex128), np.asarray(errors)


def _refine(
    pencil: _Pencil,
    outer: _Outer,
    small: _ProjectedPencil,
    picked: NDArray[np.int64],
    shapes: ComplexArray,
    lacking: ComplexArray,
) -> tuple[ComplexArray, ComplexArray] | None:
    """Return the exact poles ``(p,)`` and shapes ``(m, p)`` of some that stand apart, each from its
    own.

    The outer motions and the space take turns: sweeps for the ones, the inverse by all its poles
    for the other, and between them the Rayleigh quotient. A pole has converged when it moves by
    less than is allowed: what then remains is quadratic in a smaller lack.

    Returns:
        None where one does not converge or leaves its neighbourhood: the space is then too small
        for them all.
    """
    first, lower = small.poles[picked], len(pencil.eigenvalues) - len(outer.scale)
    poles, shapes, left = first.copy(), shapes.copy(), np.arange(len(picked))
    for _ in range(REFINE_ROUNDS):
        if not len(left):
            break
        moved = shapes[:, left]
        moved[lower:] += lacking
        residuals, slopes = pencil.apply(poles[left], moved)
        steps = np.einsum("mp,mp->p", moved, residuals) / np.einsum("mp,mp->p", moved, slopes)
        poles[left] -= steps
        moved -= small.solve(poles[left], residuals - steps * slopes, picked[left])
        shapes[:, left] = moved / np.linalg.norm(moved, axis=0)
        left = left[~(np.abs(steps) <= pencil.allowed(poles[left]))]
        lacking, _ = _correct(pencil, outer, poles[left], shapes[:, left])
    near = np.abs(poles - first) <= STRAYED * small.gaps(picked)
    return (poles, shapes) if not len(left) and near.all() else None


def _widen(first: FloatArray, shapes: ComplexArray, outer: _Outer, radius: float) -> FloatArray:
    """Return the first columns with what the outer parts ``(k, p)`` of shapes add to them,
    orthonormal: all but a unit of their energy norm.
    """
    parts = np.hstack([shapes.real, shapes.imag]) / (radius * outer.scale[:, None])
    parts -= outer.heavy @ (outer.heavy.T @ parts)
    sizes, turned = np.linalg.eigh(parts.T @ parts)
    added = outer.scale[:, None] * (parts @ turned[:, sizes > 1.0])
    for _ in range(2):
        added = np.asarray(np.linalg.qr(added - first @ (first.T @ added))[0])
    return np.hstack([first, added])


def _agree(pencil: _Pencil, small: _ProjectedPencil) -> bool:
    """Return whether the whole ``Q(-r)`` has as many negative eigenvalues as its projection, by the
    inertia of its factors.
    """
    radius = pencil.radius
    whole = np.diag(pencil.eigenvalues + radius**2) - radius * pencil.viscous
    factors, pivots, info = dsytrf(whole, lower=1)
    # pivots of two rows, marked by negative indices, have one eigenvalue of either sign
    single = pivots > 0
    negative = np.count_nonzero(factors.diagonal()[single] < 0.0) + np.count_nonzero(~single) // 2
    projected = small.stiffness + radius**2 * np.eye(len(small.damping)) - radius * small.damping
    return bool(info == 0 and negative == np.count_nonzero(np.linalg.eigvalsh(projected) < 0.0))
