"""How much noise frequency responses have, line by line and channel by channel: the weights of a
fit.
"""

import numpy as np
import scipy  # whose filters, a tenth of a second, are loaded where they are used

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.second_order import ComplexArray

LEAST_NOISE = 1e-3  # of the responses at a line: no measurement is better
WINDOW = 51  # lines of a running median
AVERAGED = 60  # values of neighbouring lines over which squares are averaged
THIRD_DIFFERENCE = 20.0  # sum of squares of 1, -3, 3, -1
SWEEPS = 4


def noise_from_neighbours(values: ComplexArray) -> FloatArray:
    """Return the noise of responses ``(l, m, f)`` in squares, from third differences of neighbouring
    lines: a smooth response has hardly any.

    A running median over lines leaves out resonances, where lines are far apart.
    """
    squares = np.abs(np.diff(values, n=3, axis=0)) ** 2 / THIRD_DIFFERENCE
    middle = np.nanmedian(squares.reshape(len(squares), -1), axis=1)
    middle = scipy.ndimage.median_filter(middle, min(WINDOW, len(middle)), mode="nearest")
    lines = np.interp(np.arange(len(values)), np.arange(len(middle)) + 1.5, middle)
    levels = np.nanmedian(squares / np.maximum(middle, np.finfo(float).tiny)[:, None, None], axis=0)
    return np.asarray(lines[:, None, None] * levels)


def noise_from_residuals(residuals: ComplexArray) -> FloatArray:
    """Return the noise of responses ``(l, m, f)`` in squares, from what a fit leaves of them, averaged
    over some neighbouring lines.
    """
    squares = np.abs(residuals) ** 2
    pairs = max(1, int(np.isfinite(squares[0]).sum()))
    width = 1 + 2 * (AVERAGED // (2 * pairs))
    return np.asarray(scipy.ndimage.uniform_filter1d(squares, width, axis=0, mode="nearest"))


def separate_deviations(
    squares: FloatArray, values: ComplexArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return standard deviations of the real and of the imaginary part as a product of one factor per
    line, motion and force: ``(l,)``, ``(m,)``, ``(f,)``.

    Args:
        squares: ``(l, m, f)`` mean squares of noise; nan where not measured.
        values: ``(l, m, f)`` responses, a small share of which is noise in any case.
    """
    power = np.abs(values) ** 2
    sizes = np.nanmean(power, axis=0)
    relative = np.nanmean(power / np.where(sizes > 0.0, sizes, 1.0), axis=(1, 2))
    squares = squares + LEAST_NOISE**2 * relative[:, None, None] * sizes
    measured: BoolArray = np.isfinite(squares)
    factors = [np.ones(size) for size in squares.shape]
    for _ in range(SWEEPS):
        for axis in (0, 1, 2):
            others = [
                factor if place != axis else np.ones_like(factor)
                for place, factor in enumerate(factors)
            ]
            product = np.einsum("l,m,f->lmf", *others)
            quotients = np.where(measured, squares, 0.0) / product
            rest = tuple(place for place in (0, 1, 2) if place != axis)
            mean = quotients.sum(axis=rest) / np.maximum(measured.sum(axis=rest), 1)
            factors[axis] = np.where(mean > 0.0, mean, 1.0)
    lines, motions, forces = (np.sqrt(factor) for factor in factors)
    return lines * np.sqrt(0.5), motions, forces
