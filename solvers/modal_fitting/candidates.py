"""Poles of a rational model of frequency responses, order by order (polyreference least squares,
pLSCF): what a stabilisation diagram shows.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

SMALLEST_PIVOT = 1e-13  # of the largest: what is smaller is rounding
# noise over signal that is added to every sum of squares: without noise nothing would make
# computational poles unstable
LEAST_NOISE = 1e-5


@dataclass(frozen=True, eq=False)
class OrderPoles:
    """Poles of the model of one order.

    Attributes:
        order: Degree of its polynomials.
        poles: ``(p,)`` with a positive imaginary part [1/s]; those with a positive real part are
            computational.
        participations: ``(f, p)`` how the references excite them; columns of unit length.
    """

    order: int
    poles: ComplexArray
    participations: ComplexArray


def find_candidates(
    frequencies_hz: FloatArray, values: ComplexArray, *, order: int
) -> list[OrderPoles]:
    """Find the poles of rational models ``H A = B`` of orders 1 to ``order``.

    The polynomials are in ``z = exp(i (omega - omega_0) T)``, so that the lines lie on half a
    circle. The constant term of ``A`` is one: poles that only fit noise are then unstable.

    Args:
        frequencies_hz: ``(l,)`` lines, increasing.
        values: ``(l, m, f)`` weighted by one factor per line, motion and force.

    Returns:
        One entry per order; fewer where the data leave no more.

    Source: Guillaume et al. (2003); Peeters et al. (2004); for the constraint, Cauberghe et al. (2005).
    """
    low, high = float(frequencies_hz[0]), float(frequencies_hz[-1])
    period = 0.5 / (high - low)
    matrix, forces = _normal_matrices(
        2.0 * np.pi * period * (frequencies_hz - low), values, order=order
    )
    noise = LEAST_NOISE**2 * float(np.sum(np.abs(values) ** 2)) / forces
    steps = []
    for degree in range(1, len(matrix) + 1):
        size = (degree + 1) * forces
        rows = matrix[degree - 1][forces:size]
        try:
            coefficients = scipy.linalg.solve(
                rows[:, forces:size] + noise * np.eye(size - forces),
                -rows[:, :forces],
                assume_a="pos",
            )
        except scipy.linalg.LinAlgError:
            break
        logs, participations = _roots(coefficients.reshape(degree, forces, forces))
        poles = logs / period
        upper = poles.imag > 0.0
        steps.append(OrderPoles(degree, poles[upper] + 2j * np.pi * low, participations[:, upper]))
    return steps


def _normal_matrices(
    angles: FloatArray, values: ComplexArray, *, order: int
) -> tuple[list[FloatArray], int]:
    """Return, for every degree from one, the matrix ``M`` with ``sum |H A - B|^2 = a^T M a`` for the
    best numerators; and the count of forces.

    All sums over lines are Toeplitz matrices. A Cholesky factor of a smaller degree is the corner of
    that of a larger one, so that numerators are eliminated once for all degrees.
    """
    lines, motions, forces = values.shape
    powers = np.exp(1j * np.outer(np.arange(-order, order + 1), angles))
    lag = np.arange(order + 1)[None, :] - np.arange(order + 1)[:, None] + order
    plain = powers.sum(axis=1).real[lag]
    mixed = (powers @ values.reshape(lines, -1)).real[lag].reshape(order + 1, order + 1, -1)
    squares = np.einsum("loj,loi->lji", values.conj(), values).reshape(lines, -1)
    outer = (powers @ squares).real[lag].reshape(order + 1, order + 1, forces, forces)
    matrix = outer.transpose(0, 2, 1, 3).reshape((order + 1) * forces, -1)
    pivots = plain.diagonal().max() * SMALLEST_PIVOT * np.eye(order + 1)
    factor = np.linalg.cholesky(plain + pivots)
    rows = scipy.linalg.solve_triangular(factor, mixed.reshape(order + 1, -1), lower=True)
    rows = rows.reshape(order + 1, order + 1, motions, forces)
    matrices: list[FloatArray] = []
    for degree in range(order + 1):
        row = rows[degree].transpose(1, 0, 2).reshape(motions, -1)
        matrix = matrix - row.T @ row
        matrices.append(matrix)
    return matrices[1:], forces


def _roots(coefficients: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Return ``log z`` ``(n f,)`` and left null vectors ``(f, n f)`` of ``I + sum z^r A_r``.

    Args:
        coefficients: ``(n, f, f)`` from the first power to the highest.
    """
    degree, forces = coefficients.shape[:2]
    companion = np.eye(degree * forces, k=forces)
    companion[-forces:] = -np.hstack([block.T for block in coefficients[::-1]])
    inverses, vectors = np.linalg.eig(companion)
    inverses = np.where(inverses == 0.0, np.finfo(float).tiny, inverses)
    participations = np.asarray(vectors[:forces], dtype=np.complex128)
    lengths = np.linalg.norm(participations, axis=0)
    return -np.log(inverses.astype(np.complex128)), participations / np.where(
        lengths > 0.0, lengths, 1.0
    )
