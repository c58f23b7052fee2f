"""Damping: ratios given per mode, viscous damping in place of structural damping where there is no one
frequency, and complex modes of a damped system, all of them or the lowest.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import ModalResult, solve_modal
from headstock.solvers.linear.quadratic_poles import (
    find_lowest_poles,
    real_product,
    state_eigenpairs,
)
from headstock.solvers.linear.symmetric_matrices import is_symmetric
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

REAL_POLE = 1e-9
ROUNDING = 1e-14  # of a pole: a real part below is neither decay nor growth
MASSLESS_CONDITION = 1e14
LOWEST_TOLERANCE = 1e-10  # of a pole, where only the lowest are computed
FAR_ABOVE = (
    1e6  # of the lowest frequency: what dofs without mass are given where damping acts on them
)
MASSLESS_DAMPING = (
    1e-9  # share of the damping that dofs without mass, or rigid motions, may have: roundoff
)


def add_modal_damping(
    system: SecondOrderSystem, ratios: Sequence[float], modes: ModalResult | None = None
) -> SecondOrderSystem:
    """Return the system with a damping ratio on every elastic mode, on top of what it has;
    rigid-body modes stay free.

    Args:
        system: Symmetric.
        ratios: Of the first, second, ... elastic mode; the last one holds for all that follow.
        modes: All undamped modes, where they are already known.

    Raises:
        ModelError: There is no ratio, or one is negative or not finite.

    Source: Wilson and Penzien (1972): C = M Phi diag(2 zeta omega) Phi^T M.
    """
    given = np.asarray(ratios, dtype=float)
    if not len(given) or not np.isfinite(given).all() or given.min() < 0.0:
        raise ModelError(
            f"modal damping ratios {list(ratios)} must be one or more numbers from zero upwards"
        )
    modes = modes or solve_modal(system)
    count = modes.shapes.shape[1]
    every = np.zeros(count)
    flexible = np.arange(modes.rigid_count, count)
    every[flexible] = given[np.minimum(flexible - modes.rigid_count, len(given) - 1)]
    weighed = system.mass @ modes.shapes
    loss = 4.0 * np.pi * every * modes.frequencies_hz
    return _add_damping(system, (weighed * loss) @ weighed.T)


def equivalent_viscous(
    system: SecondOrderSystem, modes: ModalResult | None = None
) -> SecondOrderSystem:
    """Return the system with a viscous damping in place of its structural one: the same loss per
    cycle in each mode at its own frequency.

    In modal coordinates ``C_ij = H_ij / sqrt(omega_i omega_j)``: a loss factor eta of a mode
    becomes the damping ratio eta / 2, and modes of nearly one frequency stay coupled as they are.
    Between modes far apart the coupling is approximate.

    Args:
        system: Symmetric.
        modes: All undamped modes, where they are already known.

    Source: Crandall (1970), The role of damping in vibration theory; Geradin and Rixen (2015),
    section 3.1.
    """
    if system.hysteretic is None:
        return system
    modes = modes or solve_modal(system)
    flexible = slice(modes.rigid_count, None)
    omega = 2.0 * np.pi * modes.frequencies_hz[flexible]
    shapes = modes.shapes[:, flexible]
    loss = np.zeros((modes.shapes.shape[1],) * 2)
    loss[flexible, flexible] = (shapes.T @ system.hysteretic @ shapes) / np.sqrt(
        np.outer(omega, omega)
    )
    weighed = system.mass @ modes.shapes
    return _add_damping(dataclasses.replace(system, hysteretic=None), weighed @ loss @ weighed.T)


def _add_damping(system: SecondOrderSystem, added: FloatArray) -> SecondOrderSystem:
    added = 0.5 * (added + added.T)
    return dataclasses.replace(
        system, damping=added if system.damping is None else system.damping + added
    )


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
    """Return all complex modes of a damped system, by its state matrix in the coordinates of all
    undamped modes.

    In these coordinates stiffness and mass are diagonal, so that springs which differ by many
    decades cost no digits. Where only the lowest are wanted they come by way of a small space
    (``find_lowest_poles``), to the same digits; from the whole state matrix if that fails. Dofs
    without mass that damping acts on, which have no place in a state matrix, get a little.

    Unsymmetric terms of control or gyroscopes are found by a test and take the general method,
    without undamped modes and shares.

    Args:
        system: Positive definite mass; the damping need not be proportional. Structural damping
            must have been replaced (``equivalent_viscous``).
        undamped: All undamped modes, where they are already known.
        lowest: Only the poles in the circle of this many lowest undamped modes, and those beyond it
            that are for the most part one of them; None for all.

    Raises:
        ModelError: Structural damping, or a dof without mass in an unsymmetric system.
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
    if _damps_massless(system, modes):
        system = add_little_mass(system, modes)
        modes = solve_modal(system)
    count = modes.shapes.shape[1]
    eigenvalues = (2.0 * np.pi * modes.frequencies_hz) ** 2
    eigenvalues[: modes.rigid_count] = 0.0
    damping = (
        np.zeros((count, count))
        if system.damping is None
        else _between_modes(system.damping, modes.shapes)
    )
    damping = 0.5 * (damping + damping.T) if is_symmetric(damping) else damping
    # a rigid motion that no damper resists is at rest exactly: solved for, roundoff would let it
    # grow
    resisted = np.abs(damping[: modes.rigid_count]).max(initial=0.0)
    largest = np.abs(damping).max(initial=0.0)
    rest = modes.rigid_count if resisted <= MASSLESS_DAMPING * largest else 0
    poles, shapes = _elastic_poles(
        eigenvalues[rest:], damping[rest:, rest:], None if lowest is None else max(1, lowest - rest)
    )
    resting = np.repeat(np.eye(count, rest), 2, axis=1)
    poles, shapes = (
        np.concatenate([np.zeros(2 * rest), poles]),
        np.hstack([resting, np.vstack([np.zeros((rest, len(poles))), shapes])]),
    )
    return _sort_poles(poles, shapes, modes.shapes)


def _between_modes(damping: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the modal damping ``(m, m)``; only dofs that dampers act on take part."""
    damped = np.flatnonzero(damping.any(axis=0) | damping.any(axis=1))
    moved = shapes[damped]
    return moved.T @ damping[np.ix_(damped, damped)] @ moved


def _elastic_poles(
    eigenvalues: FloatArray, damping: FloatArray, lowest: int | None
) -> tuple[ComplexArray, ComplexArray]:
    few = None
    if lowest is not None and len(eigenvalues) and is_symmetric(damping):
        few = find_lowest_poles(eigenvalues, damping, lowest, tolerance=LOWEST_TOLERANCE)
    return state_eigenpairs(eigenvalues, damping) if few is None else few


def _damps_massless(system: SecondOrderSystem, modes: ModalResult) -> bool:
    """Return whether damping acts on dofs without mass; others follow the finite modes statically.

    Raises:
        ModelError: Modes were left out.
    """
    lacking = len(system.mass) - modes.shapes.shape[1]
    if lacking > modes.infinite_count:
        raise ModelError(
            f"{lacking - modes.infinite_count} modes were left out, so damped modes cannot be computed"
        )
    if not modes.infinite_count or system.damping is None:
        return False
    weighed = system.mass @ modes.shapes
    damped = weighed @ (modes.shapes.T @ system.damping @ modes.shapes) @ weighed.T
    largest = max(float(np.abs(system.damping).max()), np.finfo(float).tiny)
    return float(np.abs(system.damping - damped).max()) / largest > MASSLESS_DAMPING


def add_little_mass(system: SecondOrderSystem, modes: ModalResult) -> SecondOrderSystem:
    """Return the system with the mass ``K / Omega^2`` added: dofs without mass vibrate at
    ``Omega``, others change their frequency by the share ``omega^2 / (2 Omega^2)``.
    """
    lowest = float(modes.frequencies_hz[modes.rigid_count :].min(initial=np.inf))
    if not np.isfinite(lowest):
        return system
    omega = FAR_ABOVE * 2.0 * np.pi * lowest
    return dataclasses.replace(system, mass=system.mass + system.stiffness / omega**2)


def _solve_unsymmetric(system: SecondOrderSystem) -> DampedModes:
    """Return the complex modes from ``M^-1 K`` and ``M^-1 C`` as they are."""
    count = len(system.mass)
    if not np.linalg.cond(system.mass) < MASSLESS_CONDITION:
        raise ModelError(
            "a dof has no mass, so damped modes of an unsymmetric system cannot be computed; give every body a mass"
        )
    inverse = np.linalg.inv(system.mass)
    damping = np.zeros((count, count)) if system.damping is None else inverse @ system.damping
    stiffness = inverse @ system.stiffness
    poles, vectors = state_eigenpairs(stiffness, damping)
    factor = np.linalg.cholesky(0.5 * (system.mass + system.mass.T)).T
    sized = _sort_poles(poles, factor @ vectors, np.linalg.inv(factor))
    return dataclasses.replace(sized, shares=np.zeros((len(sized.poles), 0)))


def pair_with_undamped(damped: DampedModes, count: int) -> tuple[tuple[int | None, ...], ...]:
    """Return, for each of the first undamped modes, the index of the damped mode that is mostly it,
    and of a second, real one, if any.
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
    """Return the damping ratio and frequency of oscillation [Hz] of each of the first undamped
    modes.

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
                _overdamped_ratio(float(damped.poles[first].real), float(damped.poles[second].real))
            )
            frequencies.append(0.0)
        else:
            ratios.append(None)
            frequencies.append(None)
    return tuple(ratios), tuple(frequencies)


def _overdamped_ratio(first: float, second: float) -> float:
    """Return the damping ratio of a mode from its two real poles [rad/s] of one sign."""
    return -0.5 * (first + second) / math.sqrt(first * second)


def _sort_poles(poles: ComplexArray, shapes: ComplexArray, basis: FloatArray) -> DampedModes:
    real = np.abs(poles.imag) <= REAL_POLE * np.abs(poles)
    keep = np.flatnonzero(real | (poles.imag > 0.0))
    keep = keep[np.argsort(np.abs(poles[keep]), kind="stable")]
    poles, shapes, real = poles[keep], shapes[:, keep], real[keep]
    poles = np.where(real, poles.real + 0.0j, poles)
    poles = np.where(np.abs(poles.real) <= ROUNDING * np.abs(poles), 1j * poles.imag, poles)
    sizes = np.linalg.norm(shapes, axis=0)
    shapes = shapes / np.where(sizes > 0.0, sizes, 1.0)
    magnitude = np.abs(poles)
    ratios = np.where(magnitude > 0.0, -poles.real / np.where(magnitude > 0.0, magnitude, 1.0), 0.0)
    return DampedModes(
        poles=poles,
        frequencies_hz=np.where(real, 0.0, poles.imag / (2.0 * np.pi)),
        damping_ratios=ratios,
        shapes=real_product(basis, shapes),
        shares=(np.abs(shapes) ** 2).T,
    )
