"""Lowest eigenpairs of ``K x = lambda M x`` without a factorisation: block LOBPCG on a multigrid, with
converged vectors locked.
"""

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import (
    MOST_VECTORS,
    EigenPairs,
    ModeTarget,
    select_pairs,
)
from headstock.solvers.elastic.multigrid import Multigrid
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

# error of a shape in its own energy; its eigenvalue is off by the square, but what it is coupled to
# by about a tenth of it
TOLERANCE = 1e-6
LARGEST_BLOCK = 40
FIRST_GUESS = 20  # modes up to a frequency
GUARD_SHARE, FEWEST_GUARDS = 0.15, 4
MOST_STEPS = 100  # without a vector that converges
ROWS_AT_A_TIME = 50_000
DEPENDENCE_TOLERANCE = 1e-14  # of squared lengths, of vectors of unit length
FRESH_PHASE = 1e3


def block_width(target: ModeTarget) -> int:
    """Return the vectors that are iterated together for a target: a few more than are wanted."""
    wanted = FIRST_GUESS if target.count is None else target.count
    return min(wanted + max(FEWEST_GUARDS, round(GUARD_SHARE * wanted)), LARGEST_BLOCK)


def lobpcg_pairs(
    solver: ConstrainedSolver, multigrid: Multigrid, start: FloatArray, target: ModeTarget
) -> EigenPairs:
    """Return the lowest eigenpairs, complete up to the target and to the end of the cluster there;
    collective.

    Args:
        solver: Constraints of the component, around the multigrid.
        multigrid: Stiffness, and what is near its inverse.
        start: ``(3 n_owned, b)`` random block, of ``block_width`` vectors; where more are wanted,
            those that converged make room for new ones.

    Returns:
        Pairs with shapes ``(3 n_owned, m)``.

    Raises:
        ConvergenceError: No further vector converges.

    Source: Knyazev (2001), SIAM J. Sci. Comput. 23, 517-541; orthonormal bases and locking as in
    Duersch, Shao, Yang and Gu (2018), SIAM J. Sci. Comput. 40, C655-C676.
    """
    block = _Block(solver, multigrid, start)
    steps, done_before = 0, 0
    while True:
        bounds = block.precondition_residuals()
        values = np.concatenate([block.locked_values, block.values])
        every = np.concatenate([np.zeros(len(block.locked_values)), bounds])
        selected = select_pairs(1.0 / values, every, target, complete=False, tolerance=TOLERANCE)
        if selected is not None:
            return EigenPairs(
                values[:selected],
                block.vectors(selected),
                every[:selected],
                float(values[selected]),
                block.cycles,
            )
        done = int(np.argmax(np.append(every, np.inf) > TOLERANCE))
        steps, done_before = (0, done) if done > done_before else (steps + 1, done_before)
        if steps > MOST_STEPS or len(values) > MOST_VECTORS:
            raise ConvergenceError(
                f"LOBPCG found {done} modes to {TOLERANCE:g} in {block.cycles} multigrid cycles and could not finish {target}: ask for "
                'fewer modes (reduction.modes, or a lower reduction.modes_to), or write reduction = { solver = "direct" }'
            )
        converged = done - len(block.locked_values)
        if _needs_more(values, target) and 2 * converged >= len(bounds):
            block.lock(converged)
        block.improve()


def _needs_more(values: FloatArray, target: ModeTarget) -> bool:
    """Return whether a target lies beyond the vectors at hand."""
    frequencies_hz = np.sqrt(values) / (2.0 * np.pi)
    return target.count_wanted(frequencies_hz) + FEWEST_GUARDS > len(values) or bool(
        len(values) and target.count is None and frequencies_hz[-1] <= (target.up_to_hz or 0.0)
    )


class _Block:
    """M-orthonormal shapes X, directions P and preconditioned residuals W side by side, with their
    products with K and M.
    """

    def __init__(self, solver: ConstrainedSolver, multigrid: Multigrid, start: FloatArray) -> None:
        self._solver, self._multigrid, self._start = solver, multigrid, start
        self.width = start.shape[1]
        self.cycles, self._rounds = 0, 0
        rows = (len(start), 3 * self.width)
        self._basis, self._forces, self._massive = (np.zeros(rows, order="F") for _ in range(3))
        self._locked: FloatArray = np.zeros((len(start), 0))
        self._locked_massive: FloatArray = np.zeros((len(start), 0))
        self.locked_values: FloatArray = np.zeros(0)
        self.values: FloatArray = np.zeros(0)
        self._projected: FloatArray = np.zeros((0, 0))
        self._bounds: FloatArray = np.zeros(0)
        self._residuals = 0
        self._take_fresh(self.width)
        self.improve()

    def vectors(self, count: int) -> FloatArray:
        """Return the lowest shapes, locked ones first ``(n, count)``."""
        return np.hstack([self._locked, self._basis[:, : len(self.values)]])[:, :count]

    def precondition_residuals(self) -> FloatArray:
        """Return the error bound of each shape, relative, in its own energy ``(b,)``; the
        preconditioned residuals of those that have not converged become the next directions.

        Where the preconditioner is the inverse, ``r^T T r`` is the energy of ``x - lambda K^-1 M x``.
        """
        size, start = len(self.values), len(self._projected)
        bounds = self._bounds if len(self._bounds) == size else np.full(size, np.inf)
        # once below the tolerance a shape stays: Rayleigh-Ritz makes it no worse
        active = np.flatnonzero(bounds > TOLERANCE)
        residuals = self._forces[:, active] - self._massive[:, active] * self.values[active]
        improved = self._solver.precondition(residuals)
        self.cycles += len(active)
        energies = self._sum(np.einsum("ij,ij->j", residuals, improved))
        bounds[active] = np.sqrt(np.maximum(energies, 0.0) / self.values[active])
        self._bounds = bounds
        going = active[bounds[active] > TOLERANCE]
        kept = improved[:, np.isin(active, going)]
        self._residuals = kept.shape[1]
        self._basis[:, start : start + self._residuals] = kept
        return bounds

    def lock(self, count: int) -> None:
        """Take the lowest shapes out of the iteration and new random ones in."""
        self._locked = np.hstack([self._locked, self._basis[:, :count]])
        self._locked_massive = np.hstack([self._locked_massive, self._massive[:, :count]])
        self.locked_values = np.concatenate([self.locked_values, self.values[:count]])
        size, start = len(self.values), len(self._projected)
        # directions are given up: their room is that of the new shapes
        residuals = self._basis[:, start : start + self._residuals].copy()
        for table in (self._basis, self._forces, self._massive):
            table[:, : size - count] = table[:, count:size].copy()
        self.values, self._bounds = self.values[count:], self._bounds[count:]
        self._projected = np.diag(self.values)
        self._basis[:, size - count : size - count + self._residuals] = residuals
        self._take_fresh(count)

    def improve(self) -> None:
        """Apply Rayleigh-Ritz to all vectors at hand."""
        self._complete_basis()
        values, vectors = scipy.linalg.eigh(self._projected)
        old, width = len(self.values), min(self.width, len(values))
        shapes = vectors[:, :width]
        going = np.ones(width, dtype=bool)
        going[: len(self._bounds)] = (self._bounds > TOLERANCE)[:width]
        # what a step adds to the old shapes, free of the new ones
        along = shapes[:, going].copy()
        along[:old] = 0.0
        along -= shapes @ (shapes.T @ along)
        factor, sizes, _ = np.linalg.svd(along, full_matrices=False)
        along = factor[:, sizes > 1e-8 * sizes.max(initial=1e-300)] if old else along[:, :0]
        change = np.hstack([shapes, along])
        change, _ = np.linalg.qr(change)
        for table in (self._basis, self._forces, self._massive):
            for first in range(0, len(table), ROWS_AT_A_TIME):  # in place, piece by piece
                piece = table[first : first + ROWS_AT_A_TIME]
                piece[:, : change.shape[1]] = piece[:, : len(change)] @ change
        self._projected = change.T @ (self._projected @ change)
        if len(self._bounds) == width == old:
            # another shape may have come in before one that had converged
            moved = np.abs(values[:width] / self.values - 1.0) > TOLERANCE
            self._bounds[moved] = np.inf
        else:
            self._bounds = np.full(width, np.inf)
        self.values, self._residuals = values[:width], 0

    def _complete_basis(self) -> None:
        """Make the new vectors M-orthonormal to all others and to each other, and project K."""
        start = len(self._projected)
        new = slice(start, start + self._residuals)
        vectors = self._basis[:, new]
        old, old_massive = self._basis[:, :start], self._massive[:, :start]
        massive = self._solver.operators.apply_mass(vectors)
        lengths = np.sqrt(self._sum(np.einsum("ij,ij->j", vectors, massive)))
        vectors, massive = vectors / lengths, massive / lengths
        for _ in range(2):  # twice is enough (Parlett 1980)
            for space, weighted in ((self._locked, self._locked_massive), (old, old_massive)):
                overlap = self._sum(weighted.T @ vectors)
                vectors = vectors - space @ overlap
                massive = massive - weighted @ overlap
            gram = self._sum(vectors.T @ massive)
            sizes, turned = np.linalg.eigh(0.5 * (gram + gram.T))
            keep = sizes > DEPENDENCE_TOLERANCE
            scale = turned[:, keep] / np.sqrt(sizes[keep])
            vectors, massive = vectors @ scale, massive @ scale
        count = vectors.shape[1]
        self._residuals, new = count, slice(start, start + count)
        self._basis[:, new], self._massive[:, new] = vectors, massive
        self._forces[:, new] = self._multigrid.multiply(vectors)
        every = slice(0, start + count)
        column = self._sum(self._basis[:, every].T @ self._forces[:, new])
        projected = np.zeros((start + count, start + count))
        projected[:start, :start] = self._projected
        projected[:start, start:], projected[start:, :start] = column[:start], column[:start].T
        projected[start:, start:] = 0.5 * (column[start:] + column[start:].T)
        self._projected = projected

    def _take_fresh(self, count: int) -> None:
        """Append random directions, smoothed by one cycle, to the residuals."""
        fresh = self._start[:, :count]
        if self._rounds:
            # entry by entry of the start, so that it does not depend on how rows are distributed
            fresh = fresh * np.cos(FRESH_PHASE * self._rounds * fresh)
        self._rounds += 1
        first = len(self._projected) + self._residuals
        weighted = self._solver.operators.apply_mass(fresh)
        self._basis[:, first : first + count] = self._solver.precondition(weighted)
        self._residuals += count
        self.cycles += count

    def _sum(self, values: FloatArray) -> FloatArray:
        return sum_over_ranks(self._solver.comm, values)
