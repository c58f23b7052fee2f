"""What the fixed-interface modes that a superelement leaves out would add at its boundary."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray


@dataclass(frozen=True, eq=False)
class Truncation:
    """Two moments of the modes left out, from which their dynamic stiffness is bounded at every frequency below them.

    With the participation ``p_k = psi^T M phi_k`` ``(n_b,)`` and ``omega_k`` of each mode left out, eliminating its modal dof adds
    ``-lambda^2 p_k p_k^T / (omega_k^2 - lambda)`` to the dynamic stiffness of the boundary dofs at ``lambda = omega^2``.

    Attributes:
        first: ``(n_b, n_b)`` sum of ``p_k p_k^T / omega_k^2``.
        second: ``(n_b, n_b)`` sum of ``p_k p_k^T / omega_k^4``.
        limit: Lowest ``omega_k^2`` among them [rad^2/s^2]; inf when none is left out.
    """

    first: FloatArray
    second: FloatArray
    limit: float


def least_participation(truncation: Truncation, square: float) -> FloatArray:
    """What the sum of ``p_k p_k^T / (omega_k^2 - lambda)`` is at least ``(n_b, n_b)``: two terms of its geometric series."""
    return truncation.first + square * truncation.second


def most_participation(truncation: Truncation, square: float) -> FloatArray:
    """What the sum of ``p_k p_k^T / (omega_k^2 - lambda)`` is at most ``(n_b, n_b)``: all of the series' rest at the lowest mode.

    Raises:
        ValueError: The frequency is not below the lowest mode left out: there is no bound.
    """
    if not square < truncation.limit:
        raise ValueError(f"omega^2 = {square:g} lies beyond the lowest mode left out, {truncation.limit:g}")
    return truncation.first + (square / (1.0 - square / truncation.limit)) * truncation.second


def lowest_participating(first: FloatArray, second: FloatArray) -> float:
    """The lowest ``omega^2`` that the moments themselves show, where no mode was searched for; inf without any.

    A Rayleigh quotient over ``K^-1 M psi``: as a rule a few percent above the lowest mode that the boundary feels.
    """
    scale = np.sqrt(np.maximum(first.diagonal(), 0.0))
    scale = np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)
    values, vectors = np.linalg.eigh(first * scale * scale[:, None])
    kept = values > len(values) * np.finfo(float).eps * values.max(initial=0.0)
    if not kept.any():
        return np.inf
    white = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    return 1.0 / float(np.linalg.eigvalsh(white.T @ second @ white)[-1])
