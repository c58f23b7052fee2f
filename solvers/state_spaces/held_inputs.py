"""State spaces at a fixed step whose inputs are held over it, in blocks of two states: exact, and cheap
enough for real time.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.sparse.csgraph import connected_components

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.state_spaces.time_response import exact_step

WORST_CONDITION = 1e5  # of eigenvectors that states are measured along


@dataclass(frozen=True, eq=False)
class HeldSystem:
    """``x+ = A x + B u``, ``y = C x + D u`` at a step, u held over it; y after a step uses the u of
    that step.

    Attributes:
        step_s: Length of the step [s].
        pairs: How many blocks of two states A begins with; behind them stands one block of states
            that nothing takes apart.
        a: ``(n, n)``.
        b: ``(n, k)``.
        c: ``(p, n)``.
        d: ``(p, k)``.
    """

    step_s: float
    pairs: int
    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray


def hold_inputs(space: StateSpace, step_s: float) -> HeldSystem:
    """Return a state space at a step with held inputs (zero-order hold), exact to rounding.

    States that damping couples are turned into the real and imaginary parts of their eigenvectors;
    where those lie too close together, they stay one dense block.
    """
    pairs: list[
        tuple[FloatArray, FloatArray, FloatArray]
    ] = []  # block of A, rows of B, columns of C
    rest: list[int] = []
    for group in _split_states(space.a):
        blocks = list(_take_apart(space.a[np.ix_(group, group)]))
        if not blocks:
            rest += map(int, group)
        for block, forwards, backwards in blocks:
            pairs.append((block, backwards @ space.b[group], space.c[:, group] @ forwards))
    steps = [exact_step(block, rows, step_s) for block, rows, _ in pairs]
    dense, dense_drive, _ = exact_step(space.a[np.ix_(rest, rest)], space.b[rest], step_s)
    return HeldSystem(
        step_s,
        len(pairs),
        scipy.linalg.block_diag(*(motion for motion, _, _ in steps), dense),
        np.vstack([*(drive for _, drive, _ in steps), dense_drive]),
        np.hstack([*(columns for _, _, columns in pairs), space.c[:, rest]]),
        space.d,
    )


def _split_states(a: FloatArray) -> Iterator[IntArray]:
    """Yield the groups of states that have nothing to do with each other."""
    count, labels = connected_components(a != 0.0, directed=False)
    for label in range(count):
        yield np.flatnonzero(labels == label)


def _take_apart(a: FloatArray) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield blocks ``(2, 2)`` of a group of states, with the states ``(n, 2)`` that they stand for
    and the inverse ``(2, n)``; nothing for a group that stays one.
    """
    size = len(a)
    if size == 2:
        yield a, np.eye(2), np.eye(2)
        return
    if size % 2:
        return
    values, vectors = np.linalg.eig(a)
    order = np.lexsort((values.real, np.abs(values.imag) > 0.0, values.imag))
    upper = [k for k in order if values[k].imag > 0.0]
    real = [k for k in order if values[k].imag == 0.0]
    columns = [part for k in upper for part in (vectors[:, k].real, vectors[:, k].imag)]
    basis = np.column_stack([*columns, *(vectors[:, k].real for k in real)])
    if np.linalg.cond(basis) > WORST_CONDITION:
        return
    inverse = np.linalg.inv(basis)
    turned = inverse @ a @ basis
    for first in range(0, size, 2):
        pair = slice(first, first + 2)
        yield turned[pair, pair], basis[:, pair], inverse[pair]
