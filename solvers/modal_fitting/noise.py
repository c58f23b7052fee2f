"""How much noise frequency responses have, line by line and channel by channel: the weights of a
fit.
"""

import numpy as np
import scipy  # whose filters, a tenth of a second, are loaded where they are used

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

LEAST_NOISE = 1e-3  # of the responses at a line: no measurement is better
WINDOW = 51  # lines of a running median
THIRD_DIFFERENCE = 20.0  # sum of squares of 1, -3, 3, -1
MEDIAN = np.log(2.0)  # of the square of complex noise over its mean
TALL = 3.0  # times its rms: a response this large is a resonance
DISTURBED = 100.0  # times the level around it: a line with this much is disturbed, as by mains
SWEEPS = 4


def noise_from_neighbours(values: ComplexArray, *, disturbed: bool = False) -> FloatArray:
    """Return the noise of responses ``(l, m, f)`` in squares, from third differences of neighbouring
    lines: a smooth response has hardly any.

    Args:
        disturbed: Lines that stand out have their own level. Narrow resonances stand out, too.
    """
    squares = np.abs(np.diff(values, n=3, axis=0)) ** 2 / THIRD_DIFFERENCE
    padded = np.concatenate([squares[:1], squares[:1], squares, squares[-1:]])
    return _level_by_line(padded, np.abs(values) ** 2, disturbed=disturbed)


def noise_from_residuals(residuals: ComplexArray, model: ComplexArray) -> FloatArray:
    """Return the noise of responses ``(l, m, f)`` in squares, from what a model leaves of them."""
    return _level_by_line(np.abs(residuals) ** 2, np.abs(model) ** 2, disturbed=True)


def _level_by_line(squares: FloatArray, sizes: FloatArray, *, disturbed: bool) -> FloatArray:
    """Return squares of noise as a level per line times one per pair, and a share of the size of a
    response, which shows at resonances.

    A running median over lines leaves out resonances that the squares still have.

    Args:
        sizes: ``(l, m, f)`` squares of the responses.
    """
    measured = np.isfinite(squares[0])
    known, size = squares[:, measured], sizes[:, measured]
    pairs = np.median(known, axis=0) / MEDIAN
    middle = np.median(known / np.where(pairs > 0.0, pairs, 1.0), axis=1) / MEDIAN
    lines = scipy.ndimage.median_filter(middle, min(WINDOW, len(middle)), mode="nearest")
    if disturbed:
        lines = np.where(middle > DISTURBED * lines, middle, lines)
    tall = size > TALL**2 * np.mean(size, axis=0)
    share = float(np.median(known[tall] / size[tall])) / MEDIAN if tall.any() else 0.0
    level = np.full(squares.shape, np.nan)
    level[:, measured] = lines[:, None] * pairs + share * size
    return level


def separate_deviations(
    squares: FloatArray, values: ComplexArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return standard deviations of the real and of the imaginary part as a product of one factor per
    line, motion and force: ``(l,)``, ``(m,)``, ``(f,)``.

    Args:
        squares: ``(l, m, f)`` mean squares of noise; nan where not measured.
        values: ``(l, m, f)`` responses, a small share of which is noise in any case.
    """
    measured = np.isfinite(squares) & np.isfinite(values)
    power = np.where(measured, np.abs(values), 0.0) ** 2
    sizes = power.mean(axis=0)
    relative = power / np.where(sizes > 0.0, sizes, 1.0)
    relative = relative.sum(axis=(1, 2)) / np.maximum(measured.sum(axis=(1, 2)), 1)
    least = LEAST_NOISE**2 * relative[:, None, None] * sizes
    known = np.where(measured, squares + least, 0.0)
    factors: list[FloatArray] = [np.ones(size) for size in squares.shape]
    names = ("l", "m", "f")
    for _ in range(SWEEPS):
        for axis, name in enumerate(names):
            others = [each for each in range(3) if each != axis]
            given = [1.0 / factors[each] for each in others]
            left, right = (names[each] for each in others)
            sums = np.einsum(f"lmf,{left},{right}->{name}", known, *given, optimize=True)
            mean = sums / np.maximum(measured.sum(axis=tuple(others)), 1)
            factors[axis] = np.where(mean > 0.0, mean, 1.0)
    lines, motions, forces = (np.asarray(np.sqrt(each), dtype=np.float64) for each in factors)
    return lines * np.sqrt(0.5), motions, forces
