"""Undamped natural frequencies and mode shapes of any second-order system."""

from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.symmetric_matrices_2 import require_symmetric
from headstock.solvers.linear.symmetric_modes import ModalPairs, solve_symmetric_modes
from headstock.solvers.second_order import SecondOrderSystem

RESIDUAL_LIMIT = 1e-7


@dataclass(frozen=True, eq=False)
class ModalResult:
    """Undamped modes, rising in frequency, rigid-body modes first.

    Attributes:
        frequencies_hz: ``(m,)`` [Hz]; for rigid-body modes the roundoff that is left, far below the first elastic one.
        shapes: ``(n, m)`` mass-normalised, largest entry positive.
        rigid_count: How many of all modes are rigid-body modes.
        infinite_count: Dofs without mass, condensed statically: their frequencies are infinite and not listed.
        residuals: ``(m,)`` ``K x - omega^2 M x`` against the shape, each dof weighed by ``k_ii + omega^2 m_ii``.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    rigid_count: int
    infinite_count: int
    residuals: FloatArray


def solve_modal(system: SecondOrderSystem, *, count: int | None = None, up_to_hz: float | None = None) -> ModalResult:
    """Natural frequencies and mass-normalised shapes of the undamped system.

    Args:
        system: Mass and stiffness must be symmetric and positive semidefinite; damping is left out.
        count: Keep this many, rigid-body modes counted; None keeps all.
        up_to_hz: Keep modes up to this frequency [Hz]; both limits hold when both are given.

    Raises:
        ModelError: A matrix is not symmetric, not finite or indefinite; nothing has mass; a dof has neither mass nor stiffness.
        ConvergenceError: LAPACK did not converge.
        AccuracyError: An eigenpair misses the residual limit.
        ValueError: ``count`` is below one.
    """
    if count is not None and count < 1:
        raise ValueError(f"count of modes is {count}; ask for at least one")
    for matrix, what in ((system.stiffness, "stiffness"), (system.mass, "mass")):
        require_symmetric(matrix, what, "control and gyroscopic terms need the complex modes of the damped system")
    if len(system.mass) == 0:
        raise ModelError("no dof is left: every motion is held by rigid joints")
    limit = None if up_to_hz is None else (2.0 * np.pi * up_to_hz) ** 2
    return finish_modes(system, solve_symmetric_modes(system.stiffness, system.mass, wanted=count, up_to=limit), up_to_hz)


def finish_modes(system: SecondOrderSystem, pairs: ModalPairs, up_to_hz: float | None) -> ModalResult:
    """Frequencies, signs and residuals of eigenpairs; those beyond a limit are left out.

    Raises:
        AccuracyError: An eigenpair misses the residual limit.
    """
    frequencies = np.sqrt(np.abs(pairs.squares)) / (2.0 * np.pi)
    kept = len(frequencies)
    if up_to_hz is not None:
        kept = min(kept, max(pairs.rigid_count, int(np.searchsorted(frequencies, up_to_hz, side="right"))))
    shapes = _with_sign(pairs.shapes[:, :kept])
    residuals = _residuals(system, pairs.squares[:kept], shapes)
    _require_small(residuals, frequencies)
    return ModalResult(frequencies[:kept], shapes, pairs.rigid_count, pairs.infinite_count, residuals)


def keep_lowest(modes: ModalResult, *, count: int | None = None, up_to_hz: float | None = None) -> ModalResult:
    """The lowest of all modes: at most a count of them, and those up to a frequency [Hz]; rigid-body modes stay with the latter."""
    kept = len(modes.frequencies_hz) if count is None else min(count, len(modes.frequencies_hz))
    if up_to_hz is not None:
        kept = min(kept, max(modes.rigid_count, int(np.searchsorted(modes.frequencies_hz, up_to_hz, side="right"))))
    return replace(
        modes, frequencies_hz=modes.frequencies_hz[:kept], shapes=modes.shapes[:, :kept], residuals=modes.residuals[:kept]
    )


def _with_sign(shapes: FloatArray) -> FloatArray:
    """Shapes whose largest entry is positive."""
    columns = np.arange(shapes.shape[1])
    largest = shapes[np.argmax(np.abs(shapes), axis=0), columns]
    return np.asarray(shapes * np.where(largest < 0.0, -1.0, 1.0))


def _residuals(system: SecondOrderSystem, squares: FloatArray, shapes: FloatArray) -> FloatArray:
    """Residual of each pair, every dof weighed by its own ``k_ii + omega^2 m_ii``: independent of units and of grading."""
    residual = system.stiffness @ shapes - (system.mass @ shapes) * squares
    weights = system.stiffness.diagonal()[:, None] + system.mass.diagonal()[:, None] * np.abs(squares)
    weights = np.maximum(weights, np.finfo(float).tiny)
    sizes = np.einsum("ij,ij,ij->j", shapes, shapes, weights)
    return np.asarray(np.sqrt((residual**2 / weights).max(axis=0, initial=0.0) / np.maximum(sizes, np.finfo(float).tiny)))


def _require_small(residuals: FloatArray, frequencies: FloatArray) -> None:
    if not (residuals <= RESIDUAL_LIMIT).all():
        worst = int(np.argmax(residuals))
        raise AccuracyError(
            f"mode {worst + 1} at {frequencies[worst]:.6g} Hz leaves a residual of {residuals[worst]:.2g}, "
            f"limit {RESIDUAL_LIMIT:g}; look for joint stiffnesses or masses that differ by more than 14 decades"
        )
