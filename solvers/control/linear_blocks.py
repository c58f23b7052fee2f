"""Linear blocks of controllers: in series and side by side, dead time, discrete ones in continuous time,
and their frequency response.
"""

import functools
import math
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import LinearBlock
from headstock.solvers.second_order import ComplexArray

ORDER = 6
# the phase is within 1e-4 rad up to here, which is the Nyquist frequency of a controller whose dead
# time is 1.5 cycles
LARGEST_ANGLE = 1.5 * math.pi


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


def to_continuous(block: LinearBlock) -> LinearBlock:
    """Return a block in continuous time: a discrete one by the bilinear transform, which keeps gains at
    0 Hz and stability, and moves a frequency f up by about ``(pi f T)^2 / 3`` of it.

    Args:
        block: Without a pole at z = -1 where it is discrete.

    Source: Franklin, Powell and Workman (1998), section 6.1 (Tustin's method), solved for s.
    """
    if block.step_s == 0.0:
        return block
    unit = np.eye(len(block.a))
    middle = np.linalg.inv(unit + block.a)
    scale = 2.0 / math.sqrt(block.step_s)
    return LinearBlock(
        a=2.0 / block.step_s * (block.a - unit) @ middle,
        b=scale * middle @ block.b,
        c=scale * block.c @ middle,
        d=block.d - block.c @ middle @ block.b,
    )


def block_response(block: LinearBlock, omega: FloatArray) -> ComplexArray:
    """Return the frequency response ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies
    [rad/s]; of a discrete block at ``z = exp(i omega T)``.
    """
    points = np.exp(1j * omega * block.step_s) if block.step_s else 1j * omega
    size = len(block.a)
    inner = np.linalg.solve(points[:, None, None] * np.eye(size) - block.a, block.b + 0j)
    return np.asarray(block.c @ inner + block.d)
