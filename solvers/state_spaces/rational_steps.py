"""Steps in time by a rational approximation of the exponential that damps what is far too fast for them."""

from math import factorial

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

PAIRS = 3  # of poles: at half the sampling rate a step is off by 4e-6


def rational_exponential(pairs: int = PAIRS) -> tuple[ComplexArray, ComplexArray]:
    """Return poles ``s`` above the real axis and residues ``c``, ``(pairs,)`` each, of ``exp(z)``.

    ``2 Re sum c / (z - s)`` on the real axis is the Padé approximation of degrees ``2 pairs - 1`` and
    ``2 pairs``, which is below one in the left half plane and vanishes at infinity.

    Source: Hairer and Wanner (1996), section IV.3 (Radau IIA).
    """
    order = 2 * pairs
    above, below = (
        np.polynomial.Polynomial(
            [
                sign**j
                * factorial(2 * order - 1 - j)
                * factorial(degree)
                / (factorial(2 * order - 1) * factorial(j) * factorial(degree - j))
                for j in range(degree + 1)
            ]
        )
        for degree, sign in ((order - 1, 1.0), (order, -1.0))
    )
    roots: ComplexArray = np.asarray(below.roots(), dtype=np.complex128)
    poles = roots[roots.imag > 0.0]
    residues: ComplexArray = above(poles) / below.deriv()(poles)
    return poles, residues


def find_step_error(angle: float) -> float:
    """Find how far a step is off for an undamped motion, as a share of its amplitude.

    Args:
        angle: Angular frequency times step [rad].
    """
    poles, residues = rational_exponential()
    terms = [residues / (1j * angle - poles), residues.conj() / (1j * angle - poles.conj())]
    return float(abs(np.sum(terms) - np.exp(1j * angle)))


def list_poles() -> FloatArray:
    """Return ``(pairs, 4)``: real and imaginary part of a pole, and of its residue."""
    poles, residues = rational_exponential()
    return np.array([poles.real, poles.imag, residues.real, residues.imag]).T
