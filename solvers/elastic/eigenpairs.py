"""Lowest eigenpairs of ``K x = lambda M x``: which are wanted, what was found, and when a search has
them all. Without any solver, so that whoever only states a target imports none.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray

# relative residual bound of the inverse. Block Lanczos has one more step of the inverse for nothing:
# after it shapes are off by a tenth of this. Frequencies of a part that is free, or coupled, follow
# the shapes in first order, by less than 1e-2 of that (1e-8 at 5e-6)
RITZ_TOLERANCE = 2e-6
NEIGHBOUR_TOLERANCE = 1e-3
CLUSTER_GAP = 5e-3
# beyond the modes wanted; waves across a sheet that is fixed all over have frequencies without gaps
LONGEST_CLUSTER = 30
MOST_VECTORS = 1000  # of a search up to a frequency


@dataclass(frozen=True)
class ModeTarget:
    """Modes that are wanted: the lowest ``count``, all up to ``up_to_hz``, or with both whichever
    are fewer.

    A cluster at the end is completed unless it has no end.
    """

    count: int | None = None
    up_to_hz: float | None = None

    def count_wanted(self, frequencies: FloatArray) -> int:
        """Return how many are wanted where these are the lowest frequencies [Hz], rising; a count
        may go beyond them.
        """
        limits = [] if self.count is None else [self.count]
        if self.up_to_hz is not None:
            limits.append(int((frequencies <= self.up_to_hz).sum()))
        return min(limits, default=0)


@dataclass(frozen=True, eq=False)
class EigenPairs:
    """Result of a search.

    Attributes:
        values: ``(m,)`` eigenvalues [rad^2/s^2].
        vectors: ``(n, m)`` mass-normalised.
        residuals: ``(m,)`` relative residual bounds.
        next_value: The next eigenvalue, or a bound below it where it did not converge; inf when
            there is none.
        solves: Number of right-hand sides solved.
        complete: Whether the target was reached; else these are the lowest that converged, perhaps
            none.
    """

    values: FloatArray
    vectors: FloatArray
    residuals: FloatArray
    next_value: float
    solves: int
    complete: bool = True


def cluster_end(frequencies: FloatArray, count: int) -> int:
    """Return the smallest number >= count after which the next frequency stands off by more than
    the cluster gap (5e-3).

    A run longer than ``LONGEST_CLUSTER`` is cut at its widest gap: nobody asked for all of it, and
    what is left out is in the ±.
    """
    end = count
    while 0 < end < len(frequencies) and frequencies[end] <= frequencies[end - 1] * (
        1.0 + CLUSTER_GAP
    ):
        end += 1
        if end - count > LONGEST_CLUSTER:
            return count + int(np.argmax(frequencies[count:end] / frequencies[count - 1 : end - 1]))
    return end


def select_pairs(
    values: FloatArray,
    bounds: FloatArray,
    target: ModeTarget,
    complete: bool,
    *,
    tolerance: float = RITZ_TOLERANCE,
) -> int | None:
    """Return the number of converged leading pairs that fulfil the target, or None if not there
    yet.

    Args:
        values: ``(m,)`` of the inverse, falling.
        bounds: ``(m,)`` relative residual bounds.
        tolerance: Of the bounds of wanted pairs.
    """
    frequencies = np.asarray(1.0 / (2.0 * np.pi * np.sqrt(values)))
    wanted = target.count_wanted(frequencies)
    if complete:
        wanted = min(wanted, len(values))
    if not complete and wanted >= len(values):
        return None
    end = cluster_end(frequencies, wanted)
    if complete:
        return end
    if end >= len(values) or np.any(bounds[:end] > tolerance) or bounds[end] > NEIGHBOUR_TOLERANCE:
        return None
    return end


def converged_pairs(values: FloatArray, bounds: FloatArray) -> tuple[int, float]:
    """Return how many of the leading pairs come before the first that did not converge, and a bound
    below the eigenvalue of that one.

    Args:
        values: ``(m,)`` of the inverse, falling.
        bounds: ``(m,)`` relative residual bounds.
    """
    done = int(np.argmax(np.append(bounds, np.inf) > RITZ_TOLERANCE))
    following = 1.0 / (values[done] * (1.0 + bounds[done])) if done < len(values) else np.inf
    return done, float(following)
