"""A preconditioner of the stiffness that needs no factorisation: smoothing on the mesh, and algebraic
multigrid on first-order elements at its corners.
"""

import numpy as np
import scipy.sparse

from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.solvers.elastic.corner_level import CornerLevel
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.elastic.factorization import apply_once
from headstock.solvers.elastic.libraries import PETSc
from headstock.solvers.errors import AccuracyError, ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

COLUMNS = 8  # at a time: what a cycle takes besides the solution
SMOOTHING_STEPS = 2
POWER_STEPS = 12
# part of the spectrum that smoothing has to damp, and what twelve power steps may fall short of the
# largest eigenvalue
SMOOTHED_SHARE, POWER_MARGIN = 0.1, 1.1
# of the diagonal: keeps the coarse stiffness of a free body positive definite; what it does to rigid
# motions is projected out
SHIFT = 1e-7
GAMG_OPTIONS = {
    "pc_gamg_threshold": 0.01,
    "pc_gamg_agg_nsmooths": 1,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
    "mg_levels_ksp_max_it": 2,
    "mg_coarse_pc_type": "redundant",
    "mg_coarse_redundant_pc_type": "cholesky",
}
# of the energy of the error; whoever solves refines it with the residual of K itself, so that the
# second solve leaves the square of it
TOLERANCE = 1e-7
MOST_STEPS = 300


class Multigrid:
    """``F -> T F``, symmetric and positive definite, near the inverse of the stiffness between the
    dofs that are not fixed; on what is left of ``F`` without the rigid motions.

    Two levels: Chebyshev smoothing by blocks of nodes on the mesh of order 2; one cycle of smoothed
    aggregation on the elements of order 1 in the same cells, whose stiffness is that of the fine
    level on the interpolated displacements. Collective.

    Args:
        operators: Stiffness, assembled with its corner level.
        fixed: ``(3 n_owned,)`` dofs that do not move.
        motions: ``(3 n_owned, r)`` rigid motions that these leave free.

    Source: Heys, Manteuffel, McCormick and Olson (2005), J. Comput. Phys. 204, 520-532, on algebraic
    multigrid for higher-order elements; Adams, Brezina, Hu and Tuminaro (2003) on Chebyshev smoothing;
    Vanek, Mandel and Brezina (1996) on smoothed aggregation.
    """

    def __init__(self, operators: ElasticOperators, fixed: BoolArray, motions: FloatArray) -> None:
        if operators.corners is None:
            raise AccuracyError("the corner level was not assembled, yet a multigrid was asked for")
        self._operators, self._fixed, self._comm = operators, fixed, operators.comm
        self._motions = _orthonormal(motions, operators)
        self._matrix = _local_matrix(operators.stiffness)
        self._inverse_blocks = _inverse_blocks(operators, fixed)
        self._largest = POWER_MARGIN * self._largest_eigenvalue()
        self._corners = _CornerSolver(operators.corners, fixed)

    def close(self) -> None:
        """Release both levels."""
        self._matrix.destroy()
        self._corners.close()

    def multiply(self, vectors: FloatArray) -> FloatArray:
        """Return ``K x`` ``(3 n_owned, k)`` between the dofs that are not fixed, with the rounding
        of K; in columns that follow each other.
        """
        local = vectors if self._comm.size == 1 else self._operators.with_ghosts(vectors)
        local, result = np.asfortranarray(local), np.zeros(vectors.shape, order="F")
        given, product = (
            PETSc.Mat().createDense(array.shape, array=array, comm=PETSc.COMM_SELF)
            for array in (local, result)
        )
        for matrix in (given, product):
            matrix.assemble()
        self._matrix.matMult(given, product)
        given.destroy()
        product.destroy()
        result[self._fixed] = 0.0
        return result

    def without_motions(self, vectors: FloatArray) -> FloatArray:
        """Return the vectors ``(3 n_owned, k)`` less their part along the rigid motions that are
        free, zero on fixed dofs.
        """
        result = np.array(vectors, order="F")
        result[self._fixed] = 0.0
        if self._motions.shape[1]:
            result -= self._motions @ sum_over_ranks(self._comm, self._motions.T @ result)
        return result

    def apply(self, loads: FloatArray) -> FloatArray:
        """Return ``T F`` ``(3 n_owned, k)``."""
        result = np.zeros(loads.shape, order="F")
        for first in range(0, loads.shape[1], COLUMNS):
            part = slice(first, first + COLUMNS)
            result[:, part] = self._cycle(self.without_motions(loads[:, part]))
        return result

    def _cycle(self, loads: FloatArray) -> FloatArray:
        shapes = self._smooth(loads, None)
        shapes += self._corners.correct(loads - self.multiply(shapes))
        return self.without_motions(self._smooth(loads, shapes))

    def _smooth(self, loads: FloatArray, shapes: FloatArray | None) -> FloatArray:
        """Smooth by Chebyshev iteration, from zero where no shapes are given."""
        high, low = self._largest, SMOOTHED_SHARE * self._largest
        middle, radius = 0.5 * (high + low), 0.5 * (high - low)
        rest: FloatArray = loads if shapes is None else loads - self.multiply(shapes)
        step: FloatArray = np.asarray(self._blocks(rest) / middle)
        result: FloatArray = step if shapes is None else shapes + step
        ratio = radius / middle
        for _ in range(SMOOTHING_STEPS - 1):
            before, ratio = ratio, 1.0 / (2.0 * middle / radius - ratio)
            rest = rest - self.multiply(step)
            step = ratio * before * step + (2.0 * ratio / radius) * self._blocks(rest)
            result = result + step
        return result

    def _blocks(self, forces: FloatArray) -> FloatArray:
        """Return each node's forces through the inverse of its own stiffness."""
        result = np.empty(forces.shape, order="F")
        for column in range(forces.shape[1]):
            nodal = forces[:, column].reshape(-1, 3)
            result[:, column] = np.einsum("nij,nj->ni", self._inverse_blocks, nodal).ravel()
        return result

    def _largest_eigenvalue(self) -> float:
        """Estimate the largest eigenvalue of the stiffness with the nodes' own stiffness as unit,
        from below.
        """
        vector = np.cos(1e3 * np.arange(self._operators.owned_dofs, dtype=float))[:, None]
        vector[self._fixed] = 0.0
        value = 1.0
        for _ in range(POWER_STEPS):
            vector = self._blocks(self.multiply(vector))
            size = np.sqrt(sum_over_ranks(self._comm, vector.T @ vector)[0, 0])
            value, vector = float(size), vector / size
        return value


class _CornerSolver:
    """One cycle of algebraic multigrid on the corners' first-order elements."""

    def __init__(self, level: CornerLevel, fixed: BoolArray) -> None:
        self._level = level
        self._fixed = level.at_corners(fixed)
        self._matrix = _corner_matrix(level, self._fixed)
        self._solver, pc = apply_once(self._matrix, "headstock_corners_", GAMG_OPTIONS)
        pc.setType(PETSc.PC.Type.GAMG)  # one cycle of smoothed aggregation
        pc.setFromOptions()
        self._solver.setUp()
        self._given, self._found = self._matrix.createVecs()

    def close(self) -> None:
        for item in (self._solver, self._matrix, self._given, self._found):
            item.destroy()

    def correct(self, forces: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_owned, k)`` of all nodes for forces on them."""
        result = np.empty(forces.shape, order="F")
        for column in range(forces.shape[1]):
            at_corners = self._level.restrict(forces[:, column])
            at_corners[self._fixed] = 0.0
            self._given.setArray(at_corners)
            self._solver.solve(self._given, self._found)
            moved = np.array(self._found.getArray(readonly=True))
            moved[self._fixed] = 0.0
            result[:, column] = self._level.prolong(moved)
        return result


def _corner_matrix(level: CornerLevel, fixed: BoolArray) -> PETSc.Mat:
    """Return the corners' stiffness, fixed dofs on the diagonal, and its rigid motions."""
    total = 3 * level.stiffness_map.size_global
    matrix = level.stiffness.tocsr()
    columns = (3 * level.global_columns()[:, None] + np.arange(3)).ravel()
    result = PETSc.Mat().create(level.comm)
    result.setSizes(((level.owned_dofs, total), (level.owned_dofs, total)))
    result.setType(PETSc.Mat.Type.AIJ)
    result.setBlockSize(3)
    result.setPreallocationCSR(
        (
            matrix.indptr.astype(PETSc.IntType),
            columns[matrix.indices].astype(PETSc.IntType),
            matrix.data,
        )
    )
    result.assemble()
    first, _ = result.getOwnershipRange()
    scale = result.getDiagonal()
    result.zeroRowsColumns(
        (first + np.flatnonzero(fixed)).astype(PETSc.IntType), diag=scale.max()[1]
    )
    diagonal = result.getDiagonal()
    diagonal.scale(1.0 + SHIFT)
    result.setDiagonal(diagonal)
    result.setOption(PETSc.Mat.Option.SPD, True)
    points = level.points
    motions = rigid_map(points, np.zeros(3)) if len(points) else np.zeros((0, 6))
    motions[fixed] = 0.0
    vectors = []
    for column in range(6):
        vector = result.createVecLeft()
        vector.setArray(motions[:, column])
        vectors.append(vector)
    for number, vector in enumerate(vectors):
        for other in vectors[:number]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    result.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=level.comm))
    return result


def _orthonormal(motions: FloatArray, operators: ElasticOperators) -> FloatArray:
    """Return an orthonormal basis of rigid motions ``(3 n_owned, r)``."""
    result = motions
    for _ in range(2):  # once more takes out what the first pass rounds
        gram = sum_over_ranks(operators.comm, result.T @ result)
        result = np.linalg.solve(np.linalg.cholesky(gram), result.T).T if gram.size else result
    return np.asarray(result)


def _local_matrix(stiffness: scipy.sparse.bsr_matrix) -> PETSc.Mat:
    """Return the rows of this rank, columns of their neighbours included."""
    csr = (
        stiffness.indptr.astype(PETSc.IntType),
        stiffness.indices.astype(PETSc.IntType),
        stiffness.data,
    )
    matrix = PETSc.Mat().createBAIJ(stiffness.shape, 3, csr=csr, comm=PETSc.COMM_SELF)
    matrix.assemble()
    return matrix


def _inverse_blocks(operators: ElasticOperators, fixed: BoolArray) -> FloatArray:
    """Return ``(n_owned, 3, 3)`` inverse stiffness of each node, with its fixed dofs at zero."""
    matrix, count = operators.stiffness, len(operators.nodes)
    rows = np.repeat(np.arange(count), np.diff(matrix.indptr))
    blocks = np.array(matrix.data[rows == matrix.indices])
    free = ~fixed.reshape(-1, 3)
    blocks *= free[:, :, None] & free[:, None, :]
    blocks[~free[:, :, None] & np.eye(3, dtype=bool)] = operators.stiffness_scale
    inverse = np.linalg.inv(blocks)
    return inverse * (free[:, :, None] & free[:, None, :])


class IterativeInverse:
    """``K^-1`` between the dofs that are not fixed, by iteration; an alternative to
    ``Factorization`` for parts whose factors do not fit.

    Rigid motions that the fixed dofs leave free carry no load: loads are taken less their part along
    them, and displacements hold none of them. Collective.

    Args:
        operators: Stiffness, assembled with its corner level.
        fixed: ``(3 n_owned,)`` dofs that do not move.
        motions: ``(3 n_owned, r)`` rigid motions that these leave free.
    """

    def __init__(self, operators: ElasticOperators, fixed: BoolArray, motions: FloatArray) -> None:
        self._comm = operators.comm
        self.multigrid = Multigrid(operators, fixed, motions)
        self.steps = 0

    def solve(self, loads: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_owned, k)`` under loads ``(3 n_owned, k)``.

        Raises:
            ConvergenceError: A load did not converge.

        Source: Hestenes and Stiefel (1952); each column is an iteration of its own.
        """
        result = np.zeros(loads.shape, order="F")
        rest = self.multigrid.without_motions(loads)
        preconditioned = self.multigrid.apply(rest)
        sizes = self._products(rest, preconditioned)
        limits = TOLERANCE**2 * sizes
        active = np.flatnonzero(sizes > 0.0)
        rest, step, sizes = rest[:, active], preconditioned[:, active], sizes[active]
        for _ in range(MOST_STEPS):
            if not len(active):
                return result
            forces = self.multigrid.without_motions(self.multigrid.multiply(step))
            lengths = sizes / self._products(step, forces)
            result[:, active] += lengths * step
            rest -= lengths * forces
            preconditioned = self.multigrid.apply(rest)
            before, sizes = sizes, self._products(rest, preconditioned)
            self.steps += 1
            going = sizes > limits[active]
            step = preconditioned + (sizes / before) * step
            active, rest, step, sizes = active[going], rest[:, going], step[:, going], sizes[going]
        left = float(np.sqrt((sizes / limits[active]).max())) * TOLERANCE
        raise ConvergenceError(
            f"conjugate gradients left an error of {left:.2g} (allowed {TOLERANCE:g}) after {MOST_STEPS} steps: the elements are too "
            'distorted or the part too thin for an iterative solver; write reduction = { solver = "direct" }, or look for slivers'
        )

    def close(self) -> None:
        """Release the multigrid."""
        self.multigrid.close()

    def _products(self, left: FloatArray, right: FloatArray) -> FloatArray:
        return sum_over_ranks(self._comm, np.einsum("ij,ij->j", left, right))
