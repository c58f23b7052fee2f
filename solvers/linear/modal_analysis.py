"""Undamped natural frequencies and mode shapes of any second-order system, all or the lowest, and
their derivatives by parameters.

No eigenvalue is ever differenced: where two of them meet or change places, only the matrices are
asked how they change.

Source of the derivatives: Fox and Kapoor (1968) for eigenvalues; Nelson (1976) for shapes, with
every mode of a cluster in the border (Mills-Curran 1988), so that repeated eigenvalues leave the
system solvable.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.symmetric_matrices import is_symmetric, require_symmetric
from headstock.solvers.linear.symmetric_modes import (
    BEYOND,
    RESOLVED,
    ModalPairs,
    loses_digits,
    reduce_flexibility,
    solve_symmetric_modes,
)
from headstock.solvers.second_order import SecondOrderSystem

RESIDUAL_LIMIT = 1e-7
PROBES, PROBE_SAFETY = 8, 10.0
# entries of a shape that differ by less than this share of the largest are equal
EQUAL_ENTRIES = 1e-6
FEW = 0.5  # of all modes: from here on all of them cost no more
# eigenvalues closer than this share of themselves are one cluster: their shapes may turn into each
# other
CLUSTER_GAP = 1e-7


@dataclass(frozen=True, eq=False)
class ModalResult:
    """Undamped modes, rising in frequency, rigid-body modes first.

    Attributes:
        frequencies_hz: ``(m,)`` [Hz]; exactly zero for rigid-body modes.
        shapes: ``(n, m)`` mass-normalised, largest entry positive (of equal ones the first).
        rigid_count: How many of all modes are rigid-body modes.
        infinite_count: Dofs without mass, condensed statically: their frequencies are infinite and
            not listed.
        residuals: ``(m,)`` ``K x - omega^2 M x`` against the shape, each dof weighed by ``k_ii +
            omega^2 m_ii``; of rigid-body modes by the highest ``omega`` found, because nothing but
            roundoff is left of their own. Of many modes no more than these where even that is
            below the limit.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    rigid_count: int
    infinite_count: int
    residuals: FloatArray


def solve_modal(
    system: SecondOrderSystem,
    *,
    count: int | None = None,
    up_to_hz: float | None = None,
    resolved: float = RESOLVED,
) -> ModalResult:
    """Return the natural frequencies and mass-normalised shapes of the undamped system; what a run
    calls (sweeps: ``solve_lowest_modes``).

    Args:
        system: Mass and stiffness must be symmetric and positive semidefinite; damping is left out.
        count: Keep this many, rigid-body modes counted; None keeps all.
        up_to_hz: Keep modes up to this frequency [Hz]; both limits hold when both are given.
        resolved: Relative error that the highest eigenvalue may have, and residual of any mode.

    Raises:
        ModelError: A matrix is not symmetric, not finite or indefinite; nothing has mass; a dof has
            neither mass nor stiffness.
        ConvergenceError: LAPACK did not converge.
        AccuracyError: An eigenpair misses the residual limit.
        ValueError: ``count`` is below one.
    """
    if count is not None and count < 1:
        raise ValueError(f"count of modes is {count}; ask for at least one")
    for matrix, what in ((system.stiffness, "stiffness"), (system.mass, "mass")):
        require_symmetric(
            matrix, what, "control and gyroscopic terms need the complex modes of the damped system"
        )
    if len(system.mass) == 0:
        raise ModelError("no dof is left: every motion is fixed by rigid joints")
    limit = None if up_to_hz is None else (2.0 * np.pi * up_to_hz) ** 2
    return _finish_modes(
        system,
        solve_symmetric_modes(
            system.stiffness, system.mass, wanted=count, up_to=limit, resolved=resolved
        ),
        up_to_hz,
        max(RESIDUAL_LIMIT, resolved),
    )


def _finish_modes(
    system: SecondOrderSystem,
    pairs: ModalPairs,
    up_to_hz: float | None,
    largest_residual: float = RESIDUAL_LIMIT,
) -> ModalResult:
    """Return the frequencies, signs and residuals of eigenpairs; those beyond a limit are left out.

    Raises:
        AccuracyError: An eigenpair misses the residual limit.
    """
    frequencies = np.sqrt(np.abs(pairs.eigenvalues)) / (2.0 * np.pi)
    frequencies[: pairs.rigid_count] = 0.0
    kept = _count_lowest(frequencies, pairs.rigid_count, up_to_hz)
    shapes = _with_sign(pairs.shapes[:, :kept])
    residuals = _bound_residuals(system, pairs, shapes)
    if residuals is None or not (residuals <= largest_residual).all():
        residuals = _residuals(system, pairs, shapes)
    _require_small(residuals, frequencies, largest_residual)
    return ModalResult(
        frequencies[:kept], shapes, pairs.rigid_count, pairs.infinite_count, residuals
    )


def keep_lowest(
    modes: ModalResult, *, count: int | None = None, up_to_hz: float | None = None
) -> ModalResult:
    """Return the lowest of all modes, without solving anew.

    Args:
        modes: By rising frequency, rigid-body modes first.
        count: Keep at most this many, rigid-body modes counted; None keeps all.
        up_to_hz: Keep modes up to this frequency [Hz], rigid-body modes always; both limits hold
            when both are given.
    """
    kept = _count_lowest(modes.frequencies_hz, modes.rigid_count, up_to_hz)
    kept = kept if count is None else min(count, kept)
    return replace(
        modes,
        frequencies_hz=modes.frequencies_hz[:kept],
        shapes=modes.shapes[:, :kept],
        residuals=modes.residuals[:kept],
    )


def _count_lowest(frequencies: FloatArray, rigid_count: int, up_to_hz: float | None) -> int:
    """Count modes up to a frequency [Hz], rigid-body modes always; None counts all."""
    if up_to_hz is None:
        return len(frequencies)
    below = int(np.searchsorted(frequencies, up_to_hz, side="right"))
    return min(len(frequencies), max(rigid_count, below))


def _with_sign(shapes: FloatArray) -> FloatArray:
    """Return the shapes whose largest entry is positive; of entries of equal size, which symmetric
    machines have, the first.
    """
    sizes = np.abs(shapes)
    # rounding does not choose between equal entries of different signs
    first = np.argmax(sizes >= (1.0 - EQUAL_ENTRIES) * sizes.max(axis=0), axis=0)
    largest = shapes[first, np.arange(shapes.shape[1])]
    return shapes * np.where(largest < 0.0, -1.0, 1.0)


def _bound_residuals(
    system: SecondOrderSystem, pairs: ModalPairs, shapes: FloatArray
) -> FloatArray | None:
    """Return what the residuals ``(m,)`` of many shapes do not exceed, at a tenth of their cost, from
    random sums of their rows; None where all are found as quickly, or a dof has no stiffness.

    The mean square of such sums is the square of the residual's length, a tenth of which eight of
    them miss once in ten million times.

    Source: Freivalds (1977), Probabilistic machines can use less running time; Rademacher signs.
    """
    count, stiffness = shapes.shape[1], system.stiffness.diagonal()
    if count <= 4 * PROBES or pairs.rigid_count or not stiffness.min() > 0.0:
        return None
    eigenvalues = pairs.eigenvalues[:count]
    signs = _draw_signs(len(stiffness)) / np.sqrt(stiffness)
    sums = (signs @ system.stiffness) @ shapes - (signs @ system.mass) @ shapes * eigenvalues
    squares = shapes**2
    sizes = stiffness @ squares + eigenvalues * (system.mass.diagonal() @ squares)
    return PROBE_SAFETY * np.sqrt(np.einsum("ij,ij->j", sums, sums) / (PROBES * sizes))


@functools.cache
def _draw_signs(size: int) -> FloatArray:
    """Return the same random signs ``(PROBES, size)`` every time."""
    return np.random.default_rng(size).choice([-1.0, 1.0], (PROBES, size))


def _residuals(system: SecondOrderSystem, pairs: ModalPairs, shapes: FloatArray) -> FloatArray:
    """Return the residual of each pair whose shape is kept, every dof weighed by its own
    ``k_ii + omega^2 m_ii``: independent of units and of grading.

    A rigid-body mode is weighed by the highest frequency found: its own, and the stiffness of dofs
    that it alone moves, are roundoff. Without any other the null space itself has been tested.
    """
    eigenvalues = pairs.eigenvalues[: shapes.shape[1]]
    rigid = np.arange(len(eigenvalues)) < pairs.rigid_count
    highest = np.abs(pairs.eigenvalues[pairs.rigid_count :]).max(initial=0.0)
    residual = system.stiffness @ shapes - (system.mass @ shapes) * np.where(
        rigid, 0.0, eigenvalues
    )
    weights = system.stiffness.diagonal()[:, None] + system.mass.diagonal()[:, None] * np.where(
        rigid, highest, np.abs(eigenvalues)
    )
    weights = np.maximum(weights, np.finfo(float).tiny)
    sizes = np.einsum("ij,ij,ij->j", shapes, shapes, weights)
    residuals = np.sqrt(
        (residual**2 / weights).max(axis=0, initial=0.0) / np.maximum(sizes, np.finfo(float).tiny)
    )
    return np.where(rigid & (highest == 0.0), 0.0, residuals)


def _require_small(residuals: FloatArray, frequencies: FloatArray, limit: float) -> None:
    if not (residuals <= limit).all():
        worst = int(np.argmax(residuals))
        raise AccuracyError(
            f"mode {worst + 1} at {frequencies[worst]:.6g} Hz leaves a residual of {residuals[worst]:.2g}, "
            f"limit {limit:g}; look for joint stiffnesses or masses that differ by more than 14 decades"
        )


def solve_lowest_modes(
    system: SecondOrderSystem, *, count: int | None = None, up_to_hz: float | None = None
) -> ModalResult:
    """Solve like ``solve_modal``, at two thirds of its cost where few modes are wanted; dofs
    without mass are not counted.

    ``M x = mu K x`` is reduced by ``K = L L^T`` to one symmetric matrix, of which LAPACK finds the
    largest eigenvalues only. Where the answer may not be good enough (free motions, a wide spread)
    ``solve_modal`` takes over.

    Args:
        system: Mass and stiffness as for ``solve_modal``; damping is left out.
        count: Keep at most this many, rigid-body modes counted; None keeps all.
        up_to_hz: Keep modes up to this frequency [Hz]; both limits hold when both are given.

    Raises:
        ModelError, ConvergenceError, AccuracyError: As ``solve_modal``.

    Source: Dhillon and Parlett (2004), relatively robust representations (LAPACK ``dsyevr``).
    """
    pairs = None
    if is_symmetric(system.stiffness) and is_symmetric(system.mass):
        pairs = _largest_flexibilities(system.stiffness, system.mass, count, up_to_hz)
    if pairs is None:
        return solve_modal(system, count=count, up_to_hz=up_to_hz)
    return _finish_modes(system, pairs, up_to_hz)


def _largest_flexibilities(
    stiffness: FloatArray, mass: FloatArray, count: int | None, up_to_hz: float | None
) -> ModalPairs | None:
    size = len(mass)
    if (
        size == 0
        or (count is None and up_to_hz is None)
        or (count is not None and count > FEW * size)
    ):
        return None
    reduced = reduce_flexibility(stiffness, mass)
    if reduced is None:
        return None
    least = None if up_to_hz is None else BEYOND / (2.0 * np.pi * up_to_hz) ** 2
    solved = reduced.find_largest(count or 0) if least is None else reduced.find_above(least, count)
    if solved is None or loses_digits(stiffness, solved[1][:, 0]):
        return None
    eigenvalues: FloatArray = np.asarray(1.0 / solved[0])
    return ModalPairs(eigenvalues, solved[1] * np.sqrt(eigenvalues))


def slope_squares(shapes: FloatArray, forces: FloatArray) -> FloatArray:
    """Return the derivatives ``(m,)`` of ``omega^2`` by one parameter.

    Args:
        shapes: ``(n, m)`` mass-normalised mode shapes ``phi_i``.
        forces: ``(n, m)`` column ``(dK - omega_i^2 dM) phi_i`` for each mode.
    """
    return np.einsum("ij,ij->j", shapes, forces)


def slope_shape(
    stiffness: FloatArray,
    mass: FloatArray,
    eigenvalues: FloatArray,
    shapes: FloatArray,
    index: int,
    *,
    forces: FloatArray,
    mass_terms: FloatArray,
) -> FloatArray:
    """Return the derivatives ``(n, p)`` of one mass-normalised mode shape by p parameters.

    In a cluster of repeated eigenvalues the part that turns the shapes of the cluster into each
    other is left out: it has no definite value.

    Args:
        stiffness: ``(n, n)``.
        mass: ``(n, n)``.
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2].
        shapes: ``(n, m)`` mass-normalised.
        forces: ``(dK - omega^2 dM) phi`` of that mode for each parameter ``(n, p)``.
        mass_terms: ``phi^T dM phi`` of it ``(p,)``.
    """
    square = float(eigenvalues[index])
    cluster = np.flatnonzero(np.abs(eigenvalues - square) <= CLUSTER_GAP * abs(square))
    fixed = mass @ shapes[:, cluster]
    count, size = len(cluster), len(mass)
    system = np.zeros((size + count, size + count))
    # the border in the units of the stiffness, so that the factorisation sees one scale
    border = fixed * np.sqrt(
        np.abs(stiffness.diagonal()).mean() / np.einsum("ij,ij->", fixed, fixed)
    )
    system[:size, :size] = stiffness - square * mass
    system[:size, size:], system[size:, :size] = border, border.T
    right = np.zeros((size + count, forces.shape[1]))
    right[:size] = fixed @ (shapes[:, cluster].T @ forces) - forces
    turned = lu_solve(lu_factor(system, check_finite=False), right, check_finite=False)[:size]
    return turned - 0.5 * np.outer(shapes[:, index], mass_terms)
