"""Fewer states for the same inputs and outputs, with a bound of the error at every frequency."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, schur, solve_continuous_lyapunov, solve_sylvester

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.state_spaces.state_space import StateSpace

MARGINAL = 1e-9  # of the largest pole: what decays more slowly is kept as it is

ROUNDING = 1e-10  # of the largest response


@dataclass(frozen=True, eq=False)
class BalancedSpace:
    """A state space with fewer states.

    Attributes:
        space: Poles that do not decay first, exactly as they were; D is that of the whole.
        share: Largest error over the largest response, channels scaled.
        bounds: ``(p, k)`` largest error of each entry of the frequency response at any frequency.
    """

    space: StateSpace
    share: float
    bounds: FloatArray


def truncate_balanced(
    space: StateSpace,
    share: float,
    input_units: Sequence[str],
    output_units: Sequence[str],
) -> BalancedSpace:
    """Return the state space with the fewest states whose error is at most a share of the largest
    response.

    Channels of one unit are scaled together by their largest response. The bound is twice the sum of
    the Hankel singular values left out. An even number of states stays where it was even.

    Args:
        space: Continuous in time, with ``n`` states.
        share: Of the largest response at any frequency.
        input_units: ``k`` of them.
        output_units: ``p`` of them.

    Raises:
        ModelError: A pole grows, or nothing decays.

    Source: Laub, Heath, Paige and Ward (1987), Computation of system balancing transformations;
    Glover (1984) for the bound.
    """
    resting, decaying = _split_poles(space)
    size = len(decaying.a)
    if not size:
        raise ModelError(
            "no pole of the machine decays, so no state can be left out to a stated error; write [effects] damping"
        )
    responses = decaying.respond(_find_peaks(decaying))
    sizes = np.abs(responses).max(axis=0)
    rows = _share_sizes(sizes.max(axis=1), output_units)
    columns = _share_sizes((sizes / rows[:, None]).max(axis=0), input_units)
    b, c = decaying.b / columns, decaying.c / rows[:, None]
    factors = [
        _factorise(solve_continuous_lyapunov(matrix, -force @ force.T))
        for matrix, force in ((decaying.a, b), (decaying.a.T, c.T))
    ]
    left, hankel, right = np.linalg.svd(factors[1].T @ factors[0])
    largest = float(np.linalg.norm(responses / np.outer(rows, columns), 2, (1, 2)).max())
    # what is left out from each number of states on
    tails = 2.0 * np.append(np.cumsum(hankel[::-1])[::-1], 0.0)
    kept = int(np.argmax(tails <= share * largest))
    kept = min(size, kept + (kept + len(resting.a) + len(space.a)) % 2)
    roots = np.sqrt(hankel[:kept])
    forwards = factors[0] @ (right[:kept].T / roots)
    backwards = (left[:, :kept] / roots).T @ factors[1].T
    smaller = dataclasses.replace(
        space,
        a=block_diag(resting.a, backwards @ decaying.a @ forwards),
        b=np.vstack([resting.b, backwards @ decaying.b]),
        c=np.hstack([resting.c, decaying.c @ forwards]),
        states=tuple(f"balanced {number + 1}" for number in range(len(resting.a) + kept)),
        pairs=None,
        modal=False,
    )
    bound = max(float(tails[kept]), ROUNDING * largest)
    return BalancedSpace(smaller, bound / largest, bound * np.outer(rows, columns))


def _split_poles(space: StateSpace) -> tuple[StateSpace, StateSpace]:
    """Return the parts of a system whose poles do not decay, and whose poles do; their sum is the
    system less its D.

    Raises:
        ModelError: A pole grows.
    """
    poles = np.linalg.eigvals(space.a)
    limit = MARGINAL * float(np.abs(poles).max(initial=0.0))
    if poles.real.max(initial=0.0) > np.sqrt(MARGINAL) * np.abs(poles).max(initial=0.0):
        raise ModelError(
            f"a motion of the machine grows by {poles.real.max():.3g} 1/s; it has no bound"
        )
    size = len(space.a)
    shifted, vectors, count = schur(space.a + limit * np.eye(size), sort="rhp")
    whole = shifted - limit * np.eye(size)
    first, second = slice(0, count), slice(count, size)
    mixed = np.zeros((count, size - count))
    if mixed.size:
        mixed = solve_sylvester(whole[first, first], -whole[second, second], -whole[first, second])
    forwards = np.hstack([vectors[:, first], vectors[:, first] @ mixed + vectors[:, second]])
    backwards = np.vstack(
        [vectors[:, first].T - mixed @ vectors[:, second].T, vectors[:, second].T]
    )
    resting, decaying = (
        dataclasses.replace(
            space,
            a=whole[part, part],
            b=backwards[part] @ space.b,
            c=space.c @ forwards[:, part],
            d=np.zeros_like(space.d),
            pairs=None,
        )
        for part in (first, second)
    )
    return resting, decaying


def _find_peaks(space: StateSpace) -> FloatArray:
    """Find the angular frequencies at which a system responds most: at rest, and its poles'."""
    return np.unique(np.append(0.0, np.abs(np.linalg.eigvals(space.a).imag)))


def _share_sizes(sizes: FloatArray, units: Sequence[str]) -> FloatArray:
    """Return the largest of the sizes ``(n,)`` of channels of each one's unit; one where all are zero."""
    named = np.array(units)
    return np.array([sizes[named == unit].max() or 1.0 for unit in units])


def _factorise(gramian: FloatArray) -> FloatArray:
    """Return ``L (n, n)`` with ``L L^T`` equal to a Gramian."""
    levels, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return vectors * np.sqrt(np.maximum(levels, 0.0))
