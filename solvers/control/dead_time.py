"""A dead time as a chain of all-pass filters: Pade's approximation in a form that rounding does not spoil."""

import functools
import math

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.linear_blocks import LinearBlock, connect_in_series

ORDER = 6
# the phase is within 1e-4 rad up to here, which is the Nyquist frequency of a controller whose dead time is 1.5 cycles
LARGEST_ANGLE = 1.5 * math.pi


def make_dead_time(dead_time: float) -> LinearBlock:
    """``exp(-s T)`` by the Pade approximation of order six: gain exactly one, phase within 1e-4 rad up to ``s T = 1.5 pi i``.

    Its poles come from the denominator ``sum c_k (s T)^k``; each pair becomes one all-pass of two states,
    ``1 - 2 b s / (s^2 + b s + c)``.

    Args:
        dead_time: T [s]; nothing is delayed where it is zero.

    Source: Golub and Van Loan (2013), section 9.3.1 (diagonal Pade approximants of the exponential).
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
        [math.factorial(2 * ORDER - k) / (math.factorial(k) * math.factorial(ORDER - k)) for k in powers]
    )
    roots = np.roots(coefficients / coefficients[0])
    upper = roots[roots.imag > 0.0]
    return tuple((-2.0 * float(root.real), float(abs(root)) ** 2) for root in upper)
