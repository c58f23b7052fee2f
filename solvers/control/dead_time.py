"""Linear blocks ``x' = A x + B u``, ``y = C x + D u``, how they are put together, and a dead time
as one (Pade, by all-pass filters).
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray

ORDER = 6
# the phase is within 1e-4 rad up to here, which is the Nyquist frequency of a controller whose dead
# time is 1.5 cycles
LARGEST_ANGLE = 1.5 * math.pi


@dataclass(frozen=True, eq=False)
class LinearBlock:
    """A linear system without names.

    Attributes:
        a: ``(n, n)``.
        b: ``(n, n_inputs)``.
        c: ``(n_outputs, n)``.
        d: ``(n_outputs, n_inputs)``.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    @staticmethod
    def gain(*factors: float) -> "LinearBlock":
        """A weighted sum of inputs, without states."""
        count = len(factors)
        return LinearBlock(
            np.zeros((0, 0)),
            np.zeros((0, count)),
            np.zeros((1, 0)),
            np.array([factors], dtype=float),
        )


def connect_in_series(first: LinearBlock, second: LinearBlock) -> LinearBlock:
    """The second block fed by the first."""
    a = np.block(
        [[first.a, np.zeros((len(first.a), len(second.a)))], [second.b @ first.c, second.a]]
    )
    return LinearBlock(
        a=a,
        b=np.vstack([first.b, second.b @ first.d]),
        c=np.hstack([second.d @ first.c, second.c]),
        d=second.d @ first.d,
    )


def stack_blocks(blocks: Sequence[LinearBlock]) -> LinearBlock:
    """Blocks side by side, none of which sees another."""
    parts = ("a", "b", "c", "d")
    return LinearBlock(
        **{
            part: scipy.linalg.block_diag(*(getattr(block, part) for block in blocks))
            for part in parts
        }
    )


def make_dead_time(dead_time: float) -> LinearBlock:
    """``exp(-s T)`` by the Pade approximation of order six: gain exactly one, phase within 1e-4 rad
    up to ``s T = 1.5 pi i``.

    Its poles come from the denominator ``sum c_k (s T)^k``; each pair becomes one all-pass of two
    states, ``1 - 2 b s / (s^2 + b s + c)``.

    Args:
        dead_time: T [s]; nothing is delayed where it is zero.

    Source: Golub and Van Loan (2013), section 9.3.1 (diagonal Pade approximants of the
    exponential).
    """
    chain = LinearBlock.gain(1.0)
    if dead_time == 0.0:
        return chain
    for middle, square in _pairs():
        b, c = middle / dead_time, square / dead_time**2
        root = math.sqrt(c)
        section = LinearBlock(
            a=np.array([[0.0, root], [-root, -b]]),
            b=np.array([[0.0], [root]]),
            c=np.array([[0.0, -2.0 * b / root]]),
            d=np.ones((1, 1)),
        )
        chain = connect_in_series(chain, section)
    return chain


@functools.cache
def _pairs() -> tuple[tuple[float, float], ...]:
    """``b`` and ``c`` of ``s^2 + b s + c`` for each pair of poles, T = 1."""
    powers = range(ORDER, -1, -1)
    coefficients: FloatArray = np.array(
        [
            math.factorial(2 * ORDER - k) / (math.factorial(k) * math.factorial(ORDER - k))
            for k in powers
        ]
    )
    roots = np.roots(coefficients / coefficients[0])
    upper = roots[roots.imag > 0.0]
    return tuple((-2.0 * float(root.real), float(abs(root)) ** 2) for root in upper)
