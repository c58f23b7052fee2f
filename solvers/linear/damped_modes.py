"""Complex modes of a viscously damped second-order system: all of them, or the lowest from a small
space that grows until they converge.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.quadratic_poles import (
    SMALL,
    find_lowest_poles,
    real_product,
    state_eigenpairs,
    takes_energy,
)
from headstock.solvers.linear.symmetric_matrices import is_symmetric
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

# of the pencil at poles (p,), each times its column of (m, p)
Inverse = Callable[[ComplexArray, ComplexArray], ComplexArray]
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
REAL_POLE = 1e-9
MASSLESS_CONDITION = 1e14
LOWEST_TOLERANCE = 1e-10  # of a pole, where only the lowest are computed
MASSLESS_DAMPING = (
    1e-9  # share of the damping that dofs without mass, or rigid motions, may feel: roundoff
)


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

    The quadratic pencil is projected on the lower undamped modes; what each pole lacks is its
    residual over the diagonal of the pencil, which joins the space until the poles move no more. As
    the pencil is symmetric, the error of a pole is quadratic in its residual.

    Args:
        squares: ``(m,)`` omega^2 of all undamped modes [rad^2/s^2].
        viscous: ``(m, m)`` symmetric damping in their coordinates [1/s].
        wanted: Number of the lowest undamped modes.
        tolerance: Error of a pole over its size that is good enough.
        width_share: And over its real part, the half-width of its peak.
        invert: Where it is cheap, the inverse of the pencil: poles that are not good enough are
            then polished one by one.

    Returns:
        Poles ``(p,)`` on and above the real axis [rad/s] and shapes ``(m, p)``; None where all
        poles must be
        computed at once: negative dampers, or a space that does not converge while it is small.

    Source: Sleijpen and van der Vorst (1996), SIAM J. Matrix Anal. Appl. 17, 401-425 (Davidson's
    correction); Tisseur and Meerbergen
        (2001), SIAM Review 43, 235-286, section 4.
    """
    size = len(squares)
    start = int(START_FACTOR * wanted) + START_EXTRA if invert is None else wanted + POLISH_EXTRA
    if start > LARGEST_SHARE * size or not takes_energy(viscous):
        return None
    space = np.eye(size, start)
    for _ in range(ROUNDS):
        poles, coordinates = _project(squares, viscous, space)
        shapes = space @ coordinates
        # a conjugate pole says the same
        picked = np.flatnonzero(_led_by(shapes, wanted) & (poles.imag >= 0.0))
        poles, shapes = poles[picked], shapes[:, picked]
        damped = viscous @ np.ascontiguousarray(shapes.real) + 1j * (
            viscous @ np.ascontiguousarray(shapes.imag)
        )
        residuals = (poles**2 + squares[:, None]) * shapes + poles * damped
        diagonal = poles**2 + squares[:, None] + poles * viscous.diagonal()[:, None]
        sizes = np.maximum(
            np.abs(diagonal), np.finfo(float).eps * (np.abs(poles) ** 2 + squares[:, None])
        )
        slopes = np.abs(np.einsum("mp,mp->p", shapes, 2.0 * poles * shapes + damped))
        errors = (np.abs(residuals) ** 2 / sizes).sum(axis=0) / np.maximum(
            slopes, np.finfo(float).tiny
        )
        open_ = errors > np.maximum(tolerance * np.abs(poles), width_share * np.abs(poles.real))
        if invert is not None:
            rough = np.flatnonzero(errors > ROUGH * np.abs(poles))
            polished = _polish(
                squares, viscous, invert, poles[rough], shapes[:, rough], LEEWAY * errors[rough]
            )
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
        missing = residuals[:, open_] / np.where(
            np.abs(diagonal[:, open_]) < sizes[:, open_], sizes[:, open_], diagonal[:, open_]
        )
        space = _widen(space, np.hstack([missing.real, missing.imag]))
        if space.shape[1] > LARGEST_SHARE * size:
            return None
    return None


def _polish(
    squares: FloatArray,
    viscous: FloatArray,
    invert: Inverse,
    poles: ComplexArray,
    shapes: ComplexArray,
    limits: FloatArray,
) -> tuple[ComplexArray, ComplexArray] | None:
    """Poles from where they are nearly right, each on its own; None where one does not converge
    near to where it was.

    Source: Parlett (1974), Math. Comp. 28, 679-693, for the cubic convergence of Rayleigh quotient
    iteration.
    """
    poles, shapes = poles.copy(), shapes.copy()
    first, left = poles.copy(), np.arange(len(poles))
    for _ in range(POLISH_ROUNDS):
        moved = invert(poles[left], shapes[:, left])
        moved /= np.linalg.norm(moved, axis=0)
        pushed = real_product(viscous, moved)
        slope = np.einsum("mp,mp->p", moved, 2.0 * poles[left] * moved + pushed)
        steps = (
            np.einsum(
                "mp,mp->p",
                moved,
                (poles[left] ** 2 + squares[:, None]) * moved + poles[left] * pushed,
            )
            / slope
        )
        shapes[:, left] = moved
        poles[left] -= steps
        left = left[~(np.abs(steps) <= POLISHED * np.abs(poles[left]))]
        if not len(left):
            return (poles, shapes) if (np.abs(poles - first) <= limits).all() else None
    return None


def _count_neighbours(poles: ComplexArray) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """How many poles each of them equals to within what polishing leaves."""
    return np.asarray(
        (np.abs(poles[:, None] - poles) <= POLISHED * np.abs(poles)[:, None]).sum(axis=1),
        dtype=np.int64,
    )


def _project(
    squares: FloatArray, viscous: FloatArray, space: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    poles, shapes = state_eigenpairs(
        space.T @ (squares[:, None] * space), space.T @ viscous @ space
    )
    return poles, shapes / np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)


def _led_by(shapes: ComplexArray, wanted: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Poles that move the wanted modes: with a noticeable share, or more than any other pole
    does.
    """
    shares = np.abs(shapes[:wanted]) ** 2
    led = shares.sum(axis=0) > LEADING
    led[np.argmax(shares, axis=1)] = True
    return np.asarray(led)


def _widen(space: FloatArray, directions: FloatArray) -> FloatArray:
    """The space with what directions ``(m, k)`` add to it, orthonormal."""
    directions = directions / np.maximum(np.linalg.norm(directions, axis=0), np.finfo(float).tiny)
    for _ in range(2):
        directions = directions - space @ (space.T @ directions)
    span, triangular, _ = scipy.linalg.qr(
        directions, mode="economic", pivoting=True, check_finite=False
    )
    return np.hstack([space, span[:, np.abs(triangular.diagonal()) > DEPENDENT]])


@dataclass(frozen=True, eq=False)
class DampedModes:
    """Poles of ``M q'' + C q' + K q = 0``, rising in size; conjugate pairs stand once, with the
    pole above the real axis.

    Attributes:
        poles: ``(m,)`` complex [rad/s]; real poles of overdamped motions stand each on its own.
        frequencies_hz: ``(m,)`` frequency of the oscillation ``Im/(2 pi)``; zero for real poles.
        damping_ratios: ``(m,)`` ``-Re/|pole|``; one for real poles, negative for unstable ones,
            zero for a pole at rest.
        shapes: ``(n, m)`` complex, unit length in the mass norm.
        shares: ``(m, n_undamped)`` squared size of each undamped mode in a shape; rows sum to 1.
    """

    poles: ComplexArray
    frequencies_hz: FloatArray
    damping_ratios: FloatArray
    shapes: ComplexArray
    shares: FloatArray


def solve_damped(
    system: SecondOrderSystem, undamped: ModalResult | None = None, *, lowest: int | None = None
) -> DampedModes:
    """All complex modes of a damped system, by its state matrix in the coordinates of all undamped
    modes.

    In these coordinates stiffness and mass are diagonal, so that springs which differ by many
    decades cost no digits. Where only the lowest are wanted they come from a small space
    (``find_lower_poles``, for more modes ``find_lowest_poles``), to the same digits; from the whole
    state matrix if that fails.

    Unsymmetric terms of control or gyroscopes are found by a test and take the general road,
    without undamped modes and shares.

    Args:
        system: Positive definite mass; the damping need not be proportional. Structural damping
            must have been replaced (``equivalent_viscous``).
        undamped: All undamped modes, where they are already known.
        lowest: Only the poles that are for the most part one of this many lowest undamped modes, of
            large systems all in their circle; None for all.

    Raises:
        ModelError: Dofs without mass that damping acts on, which have no place in a state matrix.
        ConvergenceError: LAPACK did not converge.

    Source: Frazer, Duncan and Collar (1938); Geradin and Rixen (2015), sec. 3.3.
    """
    if system.hysteretic is not None:
        raise ModelError(
            "structural damping has no place in a state matrix; replace it by equivalent_viscous first"
        )
    if not (is_symmetric(system.mass) and is_symmetric(system.stiffness)):
        return _solve_unsymmetric(system)
    modes = undamped or solve_modal(system)
    _require_complete(system, modes)
    count = modes.shapes.shape[1]
    squares = (2.0 * np.pi * modes.frequencies_hz) ** 2
    squares[: modes.rigid_count] = 0.0
    damping = (
        np.zeros((count, count))
        if system.damping is None
        else modes.shapes.T @ system.damping @ modes.shapes
    )
    damping = 0.5 * (damping + damping.T) if is_symmetric(damping) else damping
    # a rigid motion that no damper resists is at rest exactly: solved for, roundoff would let it
    # grow
    rest = modes.rigid_count if _is_undamped(damping, modes.rigid_count) else 0
    poles, shapes = _elastic_poles(
        squares[rest:], damping[rest:, rest:], None if lowest is None else max(1, lowest - rest)
    )
    resting = np.repeat(np.eye(count, rest), 2, axis=1)
    poles, shapes = (
        np.concatenate([np.zeros(2 * rest), poles]),
        np.hstack([resting, np.vstack([np.zeros((rest, len(poles))), shapes])]),
    )
    return _sort_poles(poles, shapes, modes.shapes)


def _is_undamped(damping: FloatArray, rigid_count: int) -> bool:
    return bool(
        np.abs(damping[:rigid_count]).max(initial=0.0)
        <= MASSLESS_DAMPING * np.abs(damping).max(initial=0.0)
    )


def _elastic_poles(
    squares: FloatArray, damping: FloatArray, lowest: int | None
) -> tuple[ComplexArray, ComplexArray]:
    few = None
    if lowest is not None and is_symmetric(damping):
        find = find_lower_poles if len(squares) <= SMALL else find_lowest_poles
        few = find(squares, damping, lowest, tolerance=LOWEST_TOLERANCE)
    return state_eigenpairs(squares, damping) if few is None else few


def _require_complete(system: SecondOrderSystem, modes: ModalResult) -> None:
    """Refuse modes that were left out, and dofs without mass that damping acts on; others follow
    the finite modes statically.
    """
    lacking = len(system.mass) - modes.shapes.shape[1]
    unseen = 0.0
    if modes.infinite_count and system.damping is not None:
        weighed = system.mass @ modes.shapes
        seen = weighed @ (modes.shapes.T @ system.damping @ modes.shapes) @ weighed.T
        unseen = float(
            np.abs(system.damping - seen).max()
            / max(float(np.abs(system.damping).max()), np.finfo(float).tiny)
        )
    if lacking > modes.infinite_count or unseen > MASSLESS_DAMPING:
        raise ModelError(
            f"{lacking} dofs have no mass or were left out, so damped modes cannot be computed; give every body a mass, or take the "
            "damping off joints between parts without mass"
        )


def _solve_unsymmetric(system: SecondOrderSystem) -> DampedModes:
    """Complex modes from ``M^-1 K`` and ``M^-1 C`` as they are."""
    count = len(system.mass)
    inverse = _invert_mass(system.mass)
    damping = np.zeros((count, count)) if system.damping is None else inverse @ system.damping
    stiffness = inverse @ system.stiffness
    scale = max(
        float(np.sqrt(np.abs(stiffness).max(initial=0.0))),
        float(np.abs(damping).max(initial=0.0)),
        1.0,
    )
    state = np.block(
        [[np.zeros((count, count)), scale * np.eye(count)], [-stiffness / scale, -damping]]
    )
    poles, vectors = scipy.linalg.eig(state, check_finite=False)
    factor = np.linalg.cholesky(0.5 * (system.mass + system.mass.T)).T
    sized = _sort_poles(poles, factor @ vectors[:count], np.linalg.inv(factor))
    return dataclasses.replace(sized, shares=np.zeros((len(sized.poles), 0)))


def _invert_mass(mass: FloatArray) -> FloatArray:
    if not np.linalg.cond(mass) < MASSLESS_CONDITION:
        raise ModelError(
            "a dof has no mass, so damped modes of an unsymmetric system cannot be computed; give every body a mass"
        )
    return np.asarray(np.linalg.inv(mass))


def pair_with_undamped(damped: DampedModes, count: int) -> tuple[tuple[int | None, ...], ...]:
    """For each of the first undamped modes the index of the damped mode that is mostly it, and of a
    second, real one, if any.
    """
    pairs: list[tuple[int | None, ...]] = []
    for mode in range(count):
        share = damped.shares[:, mode]
        order = np.argsort(-share, kind="stable")
        best = int(order[0])
        if damped.frequencies_hz[best] > 0.0:
            pairs.append((best, None))
            continue
        second = next(
            (int(i) for i in order[1:] if damped.frequencies_hz[i] == 0.0 and share[i] > 0.5), None
        )
        pairs.append((best, second))
    return tuple(pairs)


def damping_of_undamped(
    damped: DampedModes, count: int
) -> tuple[tuple[float | None, ...], tuple[float | None, ...]]:
    """Damping ratio and frequency of oscillation [Hz] of each of the first undamped modes.

    An overdamped mode has a ratio above one, from its two real poles; None where the poles do not
    show one.
    """
    ratios: list[float | None] = []
    frequencies: list[float | None] = []
    for first, second in pair_with_undamped(damped, count):
        if first is not None and damped.frequencies_hz[first] > 0.0:
            ratios.append(float(damped.damping_ratios[first]))
            frequencies.append(float(damped.frequencies_hz[first]))
        elif (
            first is not None
            and second is not None
            and damped.poles[first].real * damped.poles[second].real > 0.0
        ):
            ratios.append(
                overdamped_ratio(float(damped.poles[first].real), float(damped.poles[second].real))
            )
            frequencies.append(0.0)
        else:
            ratios.append(None)
            frequencies.append(None)
    return tuple(ratios), tuple(frequencies)


def overdamped_ratio(first: float, second: float) -> float:
    """Damping ratio of a mode from its two real poles [rad/s] of one sign."""
    return -0.5 * (first + second) / math.sqrt(first * second)


def _sort_poles(poles: ComplexArray, shapes: ComplexArray, basis: FloatArray) -> DampedModes:
    real = np.abs(poles.imag) <= REAL_POLE * np.abs(poles)
    keep = np.flatnonzero(real | (poles.imag > 0.0))
    keep = keep[np.argsort(np.abs(poles[keep]), kind="stable")]
    poles, shapes, real = poles[keep], shapes[:, keep], real[keep]
    poles = np.where(real, poles.real + 0.0j, poles)
    sizes = np.linalg.norm(shapes, axis=0)
    shapes = shapes / np.where(sizes > 0.0, sizes, 1.0)
    magnitude = np.abs(poles)
    ratios = np.where(magnitude > 0.0, -poles.real / np.where(magnitude > 0.0, magnitude, 1.0), 0.0)
    return DampedModes(
        poles=poles,
        frequencies_hz=np.where(real, 0.0, poles.imag / (2.0 * np.pi)),
        damping_ratios=ratios,
        shapes=basis @ shapes,
        shares=(np.abs(shapes) ** 2).T,
    )
