"""Lowest eigenpairs of ``K x = lambda M x`` by block Lanczos on the inverse, with full
reorthogonalisation, on SLEPc's basis vectors.
"""

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.eigenpairs import (
    MOST_VECTORS,
    RITZ_TOLERANCE,
    EigenPairs,
    ModeTarget,
    converged_pairs,
    select_pairs,
)
from headstock.solvers.elastic.eigenproblem import EigenProblem
from headstock.solvers.elastic.libraries import PETSc, SLEPc
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mpi import MPI

DEPENDENCE_TOLERANCE = 1e-10
WELL_CONDITIONED = 1e-6
SMALL_LEAK = 1e-4
NO_LEAK = 1e-11
MAXIMUM_PASSES = 4
MULTIPLICITY_TOLERANCE = 1e-4
FRESH_PHASE = 1e3


def block_lanczos_pairs(problem: EigenProblem, start: FloatArray, target: ModeTarget) -> EigenPairs:
    """Return the lowest eigenpairs, complete up to the target and to the end of the cluster there.

    A count is a number at most: frequencies that lie too densely to converge, such as those of a
    sheet fixed all over, are left out.

    Args:
        start: ``(n, b)`` start block; it is widened when a mode turns out to occur b times or
            more.

    Raises:
        ConvergenceError: A frequency was not reached when the Krylov space filled the whole space
            or its limit.

    Source: Grimes, Lewis and Simon (1994); residual bound: Parlett (1980), sec. 13.2.
    """
    usual = 20 * (target.count or 40) + 200
    most = MOST_VECTORS if target.up_to_hz is not None else max(usual, MOST_VECTORS)
    space = _KrylovSpace(problem, start)
    try:
        return _search(space, problem.dimension, target, usual, min(problem.dimension, most))
    finally:
        space.close()


def _search(
    space: "_KrylovSpace", dimension: int, target: ModeTarget, usual: int, limit: int
) -> EigenPairs:
    """Search until the target is reached, or the space is as large as its limit.

    Args:
        usual: Number of vectors by which the first pair of a count has converged, if ever.
        limit: Largest number of vectors.
    """
    while True:
        exhausted = not space.expand(limit)
        values, vectors, bounds = space.ritz_pairs()
        complete = exhausted and space.size >= dimension
        selected = select_pairs(values, bounds, target, complete)
        if selected is not None and (complete or _largest_cluster(values[:selected]) < space.width):
            following = next(iter(1.0 / values[selected : selected + 1]), np.inf)
            break
        # a mode that occurs as often as the start block is wide may occur once more, and an
        # invariant space may not be the whole: new directions must come in from outside
        if (selected is not None or exhausted) and space.size < limit and space.widen():
            continue
        hopeless = exhausted or (space.size >= usual and bounds[0] > RITZ_TOLERANCE)
        if target.count is not None and hopeless:
            selected, following = converged_pairs(values, bounds)
            return space.pairs(values, vectors, bounds, selected, following, complete=False)
        if exhausted:
            done = int((bounds < RITZ_TOLERANCE).sum())
            raise ConvergenceError(
                f"block Lanczos found {done} modes to {RITZ_TOLERANCE:g} with {space.size} vectors and could not finish {target}; "
                "ask for fewer modes (reduction.modes, or a lower reduction.modes_to)"
            )
    return space.pairs(values, vectors, bounds, selected, following)


def _largest_cluster(values: FloatArray) -> int:
    """Return how often the most frequent value occurs in a falling list."""
    if not len(values):
        return 0
    breaks = np.flatnonzero(values[:-1] - values[1:] > MULTIPLICITY_TOLERANCE * values[:-1])
    return int(np.diff(np.concatenate([[-1], breaks, [len(values) - 1]])).max())


class _KrylovSpace:
    """An M-orthonormal basis, the projected inverse, and the coupling to the next block.

    ``K^-1 M V = V T + V_next C``, C coupling the last block to the next one. The next block stands
    apart from the basis, beside its product with the mass.
    """

    def __init__(self, problem: EigenProblem, start: FloatArray) -> None:
        self._problem = problem
        self._start = start
        self.width = start.shape[1]
        self.solves = 0
        self._basis = self._vectors(16 * self.width)
        self._next, self._massive = self._vectors(self.width), self._vectors(self.width)
        self._projected: FloatArray = np.zeros((0, 0))
        self._coupling: FloatArray = np.zeros((0, 0))
        self._fill(start)
        self._weigh()
        self._solve()
        self._orthonormalize(0.0)
        self._coupling = np.zeros((_width(self._next), 0))

    @property
    def size(self) -> int:
        return len(self._projected)

    def close(self) -> None:
        for vectors in (self._basis, self._next, self._massive):
            vectors.destroy()

    def expand(self, limit: int) -> bool:
        """Take the next block in; False when the space is exhausted."""
        width, size = _width(self._next), self.size
        if width == 0 or size >= limit:
            return False
        if size + width > self._basis.getSizes()[1]:
            # anew: BV.resize forgets the leading dimension
            small, self._basis = self._basis, self._vectors(2 * self._basis.getSizes()[1])
            for vectors in (small, self._basis):
                vectors.setActiveColumns(0, size)
            small.copy(self._basis)
            small.destroy()
        self._basis.setActiveColumns(size, size + width)
        self._next.copy(self._basis)
        self._solve()
        column = np.zeros((size + width, width))
        # the three-term recurrence first: it needs no mass product; what it leaves comes out with
        # the reorthogonalisation
        recent = slice(size - self._coupling.shape[1], size + width)
        column[recent] = np.vstack([self._coupling.T, _products(self._massive, self._next)])
        self._basis.setActiveColumns(recent.start, recent.stop)
        _subtract(self._next, self._basis, column[recent])
        projected = np.zeros((size + width, size + width))
        projected[:size, :size] = self._projected
        self._projected = projected
        self._coupling, rest = self._orthonormalize(float(np.abs(column).max()))
        column += rest
        projected[:size, size:], projected[size:, :size] = column[:size], column[:size].T
        projected[size:, size:] = 0.5 * (column[size:] + column[size:].T)
        return True

    def widen(self) -> bool:
        """Add as many directions to the next block as the start had; False when there is nothing
        outside the space.
        """
        rounds = self.width // self._start.shape[1]
        old, kept = _width(self._next), _rows(self._next)
        # entry by entry of the start, so that it does not depend on how rows are distributed
        self._fill(self._start * np.cos(FRESH_PHASE * rounds * self._start))
        self._weigh()
        self._solve()
        self._weigh()
        fresh = _rows(self._next) / np.sqrt(np.diag(_products(self._next, self._massive)))
        self.width += self._start.shape[1]
        self._fill(np.hstack([kept, fresh]))
        factor, _ = self._orthonormalize(0.0)
        self._coupling = factor[:, :old] @ self._coupling
        return _width(self._next) > old

    def ritz_pairs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the Ritz values of the inverse, largest first, their vectors in the basis, and
        relative residual bounds.
        """
        values, vectors = scipy.linalg.eigh(self._projected, check_finite=False)
        values, vectors = values[::-1], vectors[:, ::-1]
        keep = values > 0.0
        values, vectors = values[keep], vectors[:, keep]
        return values, vectors, np.linalg.norm(self._couple(vectors), axis=0) / values

    def pairs(
        self,
        values: FloatArray,
        coefficients: FloatArray,
        bounds: FloatArray,
        count: int,
        following: float,
        *,
        complete: bool = True,
    ) -> EigenPairs:
        """Return the first pairs by Rayleigh-Ritz with the stiffness in what one more step of the
        inverse makes of the space, which costs nothing: ``K^-1 M V y = V y theta + V_next C y``.

        Args:
            values: ``(m,)`` theta, falling.
            coefficients: ``(size, m)`` y.
            bounds: ``(m,)`` of their residuals.
            following: Eigenvalue behind them.
            complete: They are all that were asked for.
        """
        fresh = self._couple(coefficients) / values
        # V y + V_next C y / theta have these energies and masses
        eigenvalues, turn = scipy.linalg.eigh(
            np.diag(1.0 / values), np.eye(len(values)) + fresh.T @ fresh, check_finite=False
        )
        turn = turn[:, :count]
        self._basis.setActiveColumns(0, self.size)
        shapes = _combined(self._basis, coefficients @ turn)
        if _width(self._next) and count:
            shapes += _combined(self._next, fresh @ turn)
        return EigenPairs(
            eigenvalues[:count],
            shapes,
            bounds[:count],
            float(following),
            self.solves,
            complete=complete,
        )

    def _couple(self, coefficients: FloatArray) -> FloatArray:
        last = coefficients[len(coefficients) - self._coupling.shape[1] :]
        return self._coupling @ last

    def _vectors(self, count: int) -> SLEPc.BV:
        vectors = SLEPc.BV().create(self._problem.mass.getComm())
        (owned, total), _ = self._problem.mass.getSizes()
        vectors.setSizes((owned, total), count)
        vectors.setType(SLEPc.BV.Type.MAT)
        # no padding behind each column: CHOLMOD and MUMPS would not see it
        vectors.setLeadingDimension(max(owned, 1))
        vectors.setActiveColumns(0, count)
        return vectors

    def _fill(self, block: FloatArray) -> None:
        """Take a block ``(n, k)`` in place of the next one."""
        if block.shape[1] > self._next.getSizes()[1]:
            self._next.destroy()
            self._massive.destroy()
            self._next, self._massive = (self._vectors(block.shape[1]) for _ in range(2))
        self._next.setActiveColumns(0, block.shape[1])
        matrix = self._next.getMat()
        matrix.getDenseArray()[:] = block
        self._next.restoreMat(matrix)

    def _solve(self) -> None:
        """Put ``K^-1`` of the massive block in place of the next one."""
        given, solution = self._massive.getMat(), self._next.getMat()
        self._problem.inverse.matSolve(given, solution)
        self._massive.restoreMat(given)
        self._next.restoreMat(solution)
        self.solves += _width(self._next)

    def _weigh(self) -> None:
        """Put M times the next block in place of the massive one."""
        self._massive.setActiveColumns(0, _width(self._next))
        self._next.matMult(self._problem.mass, self._massive)

    def _orthonormalize(self, reach: float) -> tuple[FloatArray, FloatArray]:
        """Make the next block M-orthonormal and free of the basis; returns the factors that give
        it back.

        ``block = directions @ factor + basis @ rest``. Directions that vanish against ``reach`` are
        dropped: the space is then invariant in them. Each pass takes the basis out and normalises;
        it is repeated until the block it met was already well conditioned and nearly free of the
        basis ("twice is enough", Parlett 1980).
        """
        width, leak = _width(self._next), 0.0
        factor, rest = np.eye(width), np.zeros((self.size, width))
        self._basis.setActiveColumns(0, self.size)
        for _ in range(MAXIMUM_PASSES):
            self._weigh()
            overlap = _products(self._basis, self._massive)
            _subtract(self._next, self._basis, overlap)
            gram = _products(self._next, self._massive)
            if not np.isfinite(gram).all():
                raise ConvergenceError(
                    "the factorised stiffness returned values that are not finite: the component is fixed too weakly"
                )
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
            keep = values > DEPENDENCE_TOLERANCE**2 * max(
                float(values[-1]), reach * reach, np.finfo(float).tiny
            )
            roots = np.sqrt(values[keep])
            scale = vectors[:, keep] / roots
            rest += overlap @ factor
            _transform(self._next, scale)
            _transform(self._massive, scale)
            reach = 0.0
            factor = (roots[:, None] * vectors[:, keep].T) @ factor
            leak = float(np.abs(overlap @ scale).max(initial=0.0))
            if not keep.any() or (
                values[keep][0] > WELL_CONDITIONED * values[-1] and leak < SMALL_LEAK
            ):
                break
        if leak >= NO_LEAK and _width(self._next):
            self._weigh()
        return factor, rest


def _width(vectors: SLEPc.BV) -> int:
    first, last = vectors.getActiveColumns()
    return int(last - first)


def _rows(vectors: SLEPc.BV) -> FloatArray:
    """Return a copy of the rows of this rank ``(n, k)``."""
    matrix = vectors.getMat()
    rows = np.array(matrix.getDenseArray(readonly=True))
    vectors.restoreMat(matrix)
    return rows


def _combined(vectors: SLEPc.BV, coefficients: FloatArray) -> FloatArray:
    """Return the combinations of vectors, the rows of this rank ``(n, m)``."""
    matrix = vectors.getMat()
    rows = np.asarray(matrix.getDenseArray(readonly=True) @ coefficients)
    vectors.restoreMat(matrix)
    return rows


def _small(values: FloatArray) -> PETSc.Mat:
    matrix = PETSc.Mat().createDense(
        values.shape, array=np.asfortranarray(values), comm=MPI.COMM_SELF
    )
    matrix.assemble()
    return matrix


def _products(left: SLEPc.BV, right: SLEPc.BV) -> FloatArray:
    """Return ``left^T right`` of active columns, over all ranks."""
    if not _width(left) or not _width(right):
        return np.zeros((_width(left), _width(right)))
    matrix = right.dot(left)
    first, last = left.getActiveColumns()
    products = np.array(matrix.getDenseArray()[first:last])
    matrix.destroy()
    return products


def _subtract(block: SLEPc.BV, basis: SLEPc.BV, coefficients: FloatArray) -> None:
    """Subtract: ``block -= basis @ coefficients`` of active columns."""
    if not coefficients.size:
        return
    first, _ = basis.getActiveColumns()
    # SLEPc counts rows from the first column of all, active or not
    matrix = _small(np.vstack([np.zeros((first, coefficients.shape[1])), coefficients]))
    block.mult(-1.0, 1.0, basis, matrix)
    matrix.destroy()


def _transform(block: SLEPc.BV, coefficients: FloatArray) -> None:
    """Put ``block @ coefficients`` in place of the block."""
    count = coefficients.shape[1]
    if count:
        matrix = _small(coefficients)
        block.multInPlace(matrix, 0, count)
        matrix.destroy()
    block.setActiveColumns(0, count)
