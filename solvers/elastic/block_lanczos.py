"""Lowest eigenpairs of ``K x = lambda M x`` by block Lanczos on the inverse, with full
reorthogonalisation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from mpi4py import MPI

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

RITZ_TOLERANCE = 1e-7
NEIGHBOUR_TOLERANCE = 1e-3
CLUSTER_GAP = 5e-3
# beyond the modes wanted; waves across a sheet that is held all over have frequencies without gaps
LONGEST_CLUSTER = 30
DEPENDENCE_TOLERANCE = 1e-10
WELL_CONDITIONED = 1e-6
SMALL_LEAK = 1e-4
NO_LEAK = 1e-11
MAXIMUM_PASSES = 4
MULTIPLICITY_TOLERANCE = 1e-4
FRESH_PHASE = 1e3
MOST_VECTORS = 1000  # of a search up to a frequency

Operator = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class ModeTarget:
    """Which modes are wanted: the lowest ``count``, all up to ``up_to_hz``, or with both whichever
    are fewer.

    A cluster at the end is completed unless it has no end.
    """

    count: int | None = None
    up_to_hz: float | None = None

    def count_wanted(self, frequencies: FloatArray) -> int:
        """How many are wanted where these are the lowest frequencies [Hz], rising; a count may go
        beyond them.
        """
        limits = [] if self.count is None else [self.count]
        if self.up_to_hz is not None:
            limits.append(int((frequencies <= self.up_to_hz).sum()))
        return min(limits, default=0)


@dataclass(frozen=True, eq=False)
class EigenPairs:
    """What a search found.

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


def lowest_eigenpairs(
    apply_inverse: Operator,
    apply_mass: Operator,
    start: FloatArray,
    target: ModeTarget,
    *,
    comm: MPI.Comm,
    dimension: int,
) -> EigenPairs:
    """Lowest eigenpairs, complete up to the target and to the end of the cluster there.

    A count is a number at most: frequencies that lie too densely to converge, such as those of a
    sheet held all over, are left out.

    Args:
        apply_inverse: ``F -> K^-1 F`` on blocks ``(n_owned, b)``, symmetric, on the constrained
            space.
        apply_mass: ``X -> M X``.
        start: ``(n_owned, b)`` start block; it is widened when a mode turns out to occur b times or
            more.
        target: Which modes.
        comm: Communicator over which rows are distributed.
        dimension: Dimension of the constrained space.

    Raises:
        ConvergenceError: A frequency was not reached when the Krylov space filled the whole space
            or its limit.

    Source: Grimes, Lewis and Simon (1994); residual bound: Parlett (1980), sec. 13.2.
    """
    space = _KrylovSpace(apply_inverse, apply_mass, comm, start)
    usual = 20 * (target.count or 40) + 200
    limit = min(dimension, max(usual if target.up_to_hz is None else 0, MOST_VECTORS))
    while True:
        exhausted = not space.expand(limit)
        values, vectors, bounds = space.ritz_pairs()
        complete = exhausted and space.size >= dimension
        selected = _select(values, bounds, target, complete)
        if selected is not None and (complete or _largest_cluster(values[:selected]) < space.width):
            break
        # a mode that occurs as often as the start block is wide may occur once more, and an
        # invariant space may not be the whole: new directions must come in from outside
        if (selected is not None or exhausted) and space.size < limit and space.widen():
            continue
        hopeless = space.size >= usual and bounds[0] > RITZ_TOLERANCE
        if target.count is not None and (exhausted or hopeless):
            return _converged_pairs(space, values, vectors, bounds)
        if exhausted:
            done = int((bounds < RITZ_TOLERANCE).sum())
            raise ConvergenceError(
                f"block Lanczos found {done} modes to {RITZ_TOLERANCE:g} with {space.size} vectors and could not finish {target}; "
                "ask for fewer modes (reduction.modes, or a lower reduction.modes_to)"
            )
    shapes = space.combine(vectors[:, :selected])
    following = 1.0 / values[selected] if selected < len(values) else np.inf
    return EigenPairs(
        np.asarray(1.0 / values[:selected]),
        shapes,
        bounds[:selected],
        float(following),
        space.solves,
    )


def _converged_pairs(
    space: "_KrylovSpace", values: FloatArray, vectors: FloatArray, bounds: FloatArray
) -> EigenPairs:
    """The lowest pairs up to the first that did not converge, with a bound below that one."""
    done = int(np.argmax(np.append(bounds, np.inf) > RITZ_TOLERANCE))
    following = 1.0 / (values[done] * (1.0 + bounds[done])) if done < len(values) else np.inf
    shapes = space.combine(vectors[:, :done])
    return EigenPairs(
        np.asarray(1.0 / values[:done]),
        shapes,
        bounds[:done],
        float(following),
        space.solves,
        complete=False,
    )


def cluster_end(frequencies: FloatArray, count: int) -> int:
    """Smallest number >= count after which the next frequency stands off by more than the cluster
    gap (5e-3).

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


def _select(
    values: FloatArray, bounds: FloatArray, target: ModeTarget, complete: bool
) -> int | None:
    """Number of converged leading pairs that fulfil the target, or None if not there yet."""
    frequencies = np.asarray(1.0 / (2.0 * np.pi * np.sqrt(values)))
    wanted = target.count_wanted(frequencies)
    if complete:
        wanted = min(wanted, len(values))
    if not complete and wanted >= len(values):
        return None
    end = cluster_end(frequencies, wanted)
    if complete:
        return end
    if (
        end >= len(values)
        or np.any(bounds[:end] > RITZ_TOLERANCE)
        or bounds[end] > NEIGHBOUR_TOLERANCE
    ):
        return None
    return end


def _largest_cluster(values: FloatArray) -> int:
    """How often the most frequent value occurs in a falling list."""
    if not len(values):
        return 0
    breaks = np.flatnonzero(values[:-1] - values[1:] > MULTIPLICITY_TOLERANCE * values[:-1])
    return int(np.diff(np.concatenate([[-1], breaks, [len(values) - 1]])).max())


class _KrylovSpace:
    """An M-orthonormal basis, the projected inverse, and the coupling to the next block."""

    def __init__(
        self, apply_inverse: Operator, apply_mass: Operator, comm: MPI.Comm, start: FloatArray
    ) -> None:
        self._inverse, self._mass, self._comm = apply_inverse, apply_mass, comm
        self._store: FloatArray = np.empty((len(start), 16 * start.shape[1]), order="F")
        self._projected: FloatArray = np.zeros((0, 0))
        self._start = start
        self.solves = self.width = start.shape[1]
        self._next, self._next_massive, _, _ = self._orthonormalize(
            apply_inverse(apply_mass(start)), 0.0
        )
        self._coupling: FloatArray = np.zeros((self._next.shape[1], 0))

    @property
    def size(self) -> int:
        return len(self._projected)

    @property
    def _basis(self) -> FloatArray:
        return self._store[:, : self.size]

    def expand(self, limit: int) -> bool:
        """Take the next block in; False when the space is exhausted."""
        width, size = self._next.shape[1], self.size
        if width == 0 or size >= limit:
            return False
        if size + width > self._store.shape[1]:
            grown = np.empty((len(self._store), 2 * self._store.shape[1]), order="F")
            grown[:, :size] = self._basis
            self._store = grown
        self._store[:, size : size + width] = self._next
        image = self._inverse(self._next_massive)
        self.solves += width
        column = np.zeros((size + width, width))
        # the three-term recurrence first: it needs no mass product; what it leaves comes out with
        # the reorthogonalisation
        column[size - self._coupling.shape[1] : size] = self._coupling.T
        column[size:] = self._dot(self._next_massive, image)
        recent = slice(size - self._coupling.shape[1], size + width)
        image = image - self._store[:, recent] @ column[recent]
        projected = np.zeros((size + width, size + width))
        projected[:size, :size] = self._projected
        self._projected = projected
        reach = float(np.abs(column).max())
        self._next, self._next_massive, self._coupling, rest = self._orthonormalize(image, reach)
        column += rest
        projected[:size, size:], projected[size:, :size] = column[:size], column[:size].T
        projected[size:, size:] = 0.5 * (column[size:] + column[size:].T)
        return True

    def widen(self) -> bool:
        """Add as many directions to the next block as the start had; False when there is nothing
        outside the space.
        """
        rounds = self.width // self._start.shape[1]
        # entry by entry of the start, so that it does not depend on how rows are distributed
        fresh = self._inverse(self._mass(self._start * np.cos(FRESH_PHASE * rounds * self._start)))
        fresh = fresh / np.sqrt(np.diag(self._dot(fresh, self._mass(fresh))))
        self.solves += self._start.shape[1]
        self.width += self._start.shape[1]
        old = self._next.shape[1]
        self._next, self._next_massive, factor, _ = self._orthonormalize(
            np.hstack([self._next, fresh]), 0.0
        )
        self._coupling = factor[:, :old] @ self._coupling
        return self._next.shape[1] > old

    def ritz_pairs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ritz values of the inverse, largest first, their vectors in the basis, and relative
        residual bounds.
        """
        values, vectors = scipy.linalg.eigh(self._projected, check_finite=False)
        values, vectors = values[::-1], vectors[:, ::-1]
        keep = values > 0.0
        values, vectors = values[keep], vectors[:, keep]
        last = vectors[len(vectors) - self._coupling.shape[1] :]
        return values, vectors, np.linalg.norm(self._coupling @ last, axis=0) / values

    def combine(self, coefficients: FloatArray) -> FloatArray:
        """Vectors of the full space from their coefficients in the basis."""
        return np.asarray(self._basis @ coefficients)

    def _dot(self, left: FloatArray, right: FloatArray) -> FloatArray:
        return sum_over_ranks(self._comm, left.T @ right)

    def _orthonormalize(
        self, block: FloatArray, reach: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """M-orthonormal directions of a block free of the basis, their mass images, and the factors
        that give the block back.

        ``block = directions @ factor + basis @ rest``. Directions that vanish against ``reach`` are
        dropped: the space is then invariant in them. Each pass takes the basis out and normalises;
        it is repeated until the block it met was already well conditioned and nearly free of the
        basis ("twice is enough", Parlett 1980).
        """
        factor, rest = np.eye(block.shape[1]), np.zeros((self.size, block.shape[1]))
        for _ in range(MAXIMUM_PASSES):
            massive = self._mass(block)
            overlap = self._dot(self._basis, massive)
            block = block - self._basis @ overlap
            gram = self._dot(block, massive)
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
            keep = values > DEPENDENCE_TOLERANCE**2 * max(
                float(values[-1]), reach * reach, np.finfo(float).tiny
            )
            roots = np.sqrt(values[keep])
            scale = vectors[:, keep] / roots
            rest += overlap @ factor
            block, massive, reach = block @ scale, massive @ scale, 0.0
            factor = (roots[:, None] * vectors[:, keep].T) @ factor
            leak = float(np.abs(overlap @ scale).max(initial=0.0))
            if not keep.any() or (
                values[keep][0] > WELL_CONDITIONED * values[-1] and leak < SMALL_LEAK
            ):
                break
        return block, massive if leak < NO_LEAK else self._mass(block), factor, rest
