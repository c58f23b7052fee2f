"""Smaller state spaces by balanced truncation, with the bound of their error."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.state_space import StateSpace


@dataclass(frozen=True, eq=False)
class BalancedReduction:
    """A truncated state space and what it may be off by.

    Attributes:
        space: Of the wanted order; its states have no meaning of their own.
        hankel: ``(n,)`` Hankel singular values of the whole, falling.
        bound: The largest singular value of the error lies below this at every frequency.
    """

    space: StateSpace
    hankel: FloatArray
    bound: float


def balance_truncate(space: StateSpace, order: int) -> BalancedReduction:
    """Keep the states that loads reach and outputs see most.

    Args:
        space: Every pole must decay.
        order: Number of states to keep.

    Raises:
        ModelError: A pole does not decay, or the order is not between one and the number of states.

    Source: Moore (1981); Laub, Heath, Paige and Ward (1987), square-root algorithm; Glover (1984) for the bound
        ``2 (sigma_{r+1} + ... + sigma_n)``.
    """
    size = len(space.a)
    if not 1 <= order <= size:
        raise ModelError(f"order {order} is not between 1 and the {size} states there are")
    slowest = float(np.linalg.eigvals(space.a).real.max())
    if not slowest < 0.0:
        raise ModelError(
            f"balanced truncation needs poles that decay, and one has the real part {slowest:.3g}; give the machine damping"
        )
    reach = _root(scipy.linalg.solve_continuous_lyapunov(space.a, -space.b @ space.b.T))
    sight = _root(scipy.linalg.solve_continuous_lyapunov(space.a.T, -space.c.T @ space.c))
    left, hankel, right = np.linalg.svd(sight.T @ reach)
    scale = 1.0 / np.sqrt(hankel[:order])
    into, back = (sight @ left[:, :order] * scale).T, reach @ right[:order].T * scale
    reduced = dataclasses.replace(
        space,
        a=into @ space.a @ back,
        b=into @ space.b,
        c=space.c @ back,
        states=tuple(f"balanced {number + 1}" for number in range(order)),
        pairs=None,
    )
    return BalancedReduction(reduced, hankel, float(2.0 * hankel[order:].sum()))


def measure_error(whole: StateSpace, reduced: StateSpace, frequencies_hz: FloatArray) -> float:
    """Largest singular value of the difference of two responses over given frequencies."""
    omega = 2.0 * np.pi * np.asarray(frequencies_hz, dtype=float)
    return float(np.linalg.norm(whole.respond(omega) - reduced.respond(omega), ord=2, axis=(1, 2)).max())


def _root(gramian: FloatArray) -> FloatArray:
    """``R`` with ``R R^T`` equal to a gramian; what rounding makes negative is zero."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
