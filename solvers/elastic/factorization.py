"""Sparse Cholesky factorisation of a component's stiffness with fixed dofs, ordered by METIS where
it is there: factor once, solve many.
"""

import contextlib
import ctypes
import ctypes.util
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from headstock.geometry.errors import lacks_memory, out_of_memory
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.elastic.libraries import PETSc, la
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mpi import MPI

IntArray32 = NDArray[np.int32]
METIS_OK = 1
METIS_OPTIONS = 40
# MUMPS: 60 % more workspace than estimated avoids a second try
MUMPS_OUT_OF_MEMORY = (-5, -7, -13)
MUMPS_OPTIONS = {"mat_mumps_icntl_14": 60, "mat_mumps_icntl_24": 0}
# every factor as L L^T: a simplicial L D L^T would take an indefinite matrix without a word
CHOLMOD_OPTIONS = {"mat_cholmod_supernodal_switch": 0, "mat_cholmod_print": 0}
# 4 is PORD, by far the best ordering in builds without METIS; but where all dofs meet in one
# element, PORD ends the process, so small matrices get 0, approximate minimum degree
PORD, MINIMUM_DEGREE = 4, 0
SMALL_MATRIX = 2000


def _dissect_nodes(pattern: scipy.sparse.spmatrix) -> IntArray32 | None:
    """Return the order in which to eliminate the nodes of a symmetric pattern, or None where METIS
    is missing or gives no order.

    On the graph of nodes this takes a tenth of the time of an order of dofs, and is as good.

    Args:
        pattern: ``(n, n)`` compressed rows; whose entries are there counts, not their values.

    Source: Karypis and Kumar (1998), multilevel nested dissection.
    """
    library = _load_metis()
    count = pattern.shape[0]
    if library is None or count == 0:
        return None
    rows = np.repeat(np.arange(count, dtype=np.int32), np.diff(pattern.indptr))
    off_diagonal = rows != pattern.indices
    neighbours = np.ascontiguousarray(pattern.indices[off_diagonal], dtype=np.int32)
    pointers = np.concatenate(
        [[0], np.cumsum(np.bincount(rows[off_diagonal], minlength=count))]
    ).astype(np.int32)
    options = np.zeros(METIS_OPTIONS, dtype=np.int32)
    order, position = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    library.METIS_SetDefaultOptions(_pointer(options))
    size = ctypes.byref(ctypes.c_int32(count))
    status = library.METIS_NodeND(
        size,
        *map(_pointer, (pointers, neighbours)),
        None,
        *map(_pointer, (options, order, position)),
    )
    return order if status == METIS_OK else None


def _load_metis() -> ctypes.CDLL | None:
    """Return METIS with 32-bit indices; None when there is none.

    The widths of its integers cannot be asked for: with 64-bit ones the default options, all -1,
    would fill twice the space.
    """
    name = ctypes.util.find_library("metis") or "libmetis.so.5"
    try:
        library = ctypes.CDLL(name)
    except OSError:
        return None
    options = np.zeros(2 * METIS_OPTIONS, dtype=np.int32)
    library.METIS_SetDefaultOptions(_pointer(options))
    return library if not options[METIS_OPTIONS:].any() else None


def _pointer(array: IntArray32) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


class Factorization:
    """Cholesky factors of ``K_ff``, the stiffness between the dofs that are not fixed.

    Collective over the operators' communicator. Blocks of vectors span all owned dofs ``(3 n_owned,
    k)``; entries on fixed dofs are ignored in right-hand sides and zero in solutions.

    Args:
        fixed: ``(3 n_owned,)`` dofs that do not move.

    Raises:
        ConvergenceError: ``K_ff`` is not positive definite or does not fit into memory.
    """

    def __init__(self, operators: ElasticOperators, fixed: BoolArray) -> None:
        self._comm = operators.comm
        self._free, self._ordered = _elimination_order(operators, fixed)
        self.free_total = int(self._comm.allreduce(len(self._free)))
        self._factors: PETSc.KSP | None = None
        if self.free_total:
            self._matrix = free_block(operators, fixed, operators.stiffness, order=self._free)
            self._matrix.setOption(PETSc.Mat.Option.SPD, True)
            self._factors = _factorize(self._matrix, self._comm, ordered=self._ordered)

    @property
    def elimination_order(self) -> NDArray[np.int64]:
        """The owned dofs that are not fixed, in the order of the rows of ``factors``."""
        return self._free

    @property
    def factors(self) -> PETSc.KSP:
        """Solver with ``K_ff`` and its factors; there are none where every dof is fixed."""
        if self._factors is None:
            raise ConvergenceError("there is nothing to solve for: every dof is fixed")
        return self._factors

    def solve(self, loads: FloatArray) -> FloatArray:
        """Return the displacements ``(3 n_owned, k)`` under loads ``(3 n_owned, k)``:
        ``K_ff u_f = F_f``, fixed dofs zero.
        """
        result = np.zeros(loads.shape)
        if self._factors is None or loads.shape[1] == 0:
            return result
        right = np.asfortranarray(loads[self._free])
        left = np.zeros(right.shape, order="F")
        rows = (len(self._free), self.free_total)
        columns = (PETSc.DECIDE, loads.shape[1])
        given = PETSc.Mat().createDense((rows, columns), array=right, comm=self._comm)
        solution = PETSc.Mat().createDense((rows, columns), array=left, comm=self._comm)
        for matrix in (given, solution):
            matrix.assemble()
        self._factors.matSolve(given, solution)
        result[self._free] = solution.getDenseArray()
        given.destroy()
        solution.destroy()
        if not np.isfinite(self._comm.allreduce(float(np.abs(result).sum()))):
            raise ConvergenceError(
                "the factorised stiffness returned values that are not finite: the component is fixed too weakly"
            )
        return result

    def close(self) -> None:
        """Release the factors."""
        if self._factors is not None:
            self._factors.destroy()
            self._matrix.destroy()
            self._factors = None
            # the C library would keep what was freed, most of a part's memory, for itself
            with contextlib.suppress(OSError, AttributeError):  # others have no such function
                ctypes.CDLL(None).malloc_trim(0)

    def __enter__(self) -> "Factorization":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def free_block(
    operators: ElasticOperators,
    fixed: BoolArray,
    matrix: scipy.sparse.spmatrix,
    *,
    order: NDArray[np.int64] | None = None,
) -> PETSc.Mat:
    """Return the upper triangle, between the dofs that are not fixed, of a matrix distributed like
    the stiffness; the caller destroys it.

    Args:
        operators: How rows and columns are distributed.
        fixed: ``(3 n_owned,)`` dofs to leave out.
        matrix: ``(3 n_owned, 3 n_local)`` symmetric over all ranks.
        order: The owned dofs that are not fixed, as they are to follow each other; rising when left
            out.
    """
    comm = operators.comm
    free = np.flatnonzero(~fixed) if order is None else order
    total = int(comm.allreduce(len(free)))
    upper = _upper_rows(
        scipy.sparse.bsr_matrix(matrix, blocksize=(3, 3)),
        free,
        _free_numbers(operators, fixed, free),
    )
    csr = (upper.indptr, upper.indices, upper.data)
    block = PETSc.Mat().createSBAIJ(((len(free), total), (len(free), total)), 1, csr=csr, comm=comm)
    block.assemble()
    return block


def full_block(
    operators: ElasticOperators,
    fixed: BoolArray,
    scalar: scipy.sparse.csr_matrix,
    *,
    order: NDArray[np.int64],
) -> PETSc.Mat:
    """Return both triangles, between the dofs that are not fixed, of a matrix that acts alike in x,
    y and z; the caller destroys it.

    Args:
        operators: How rows and columns are distributed.
        fixed: ``(3 n_owned,)`` dofs to leave out.
        scalar: ``(n_owned, n_local)`` by nodes.
        order: The owned dofs that are not fixed, as they are to follow each other.
    """
    total = int(operators.comm.allreduce(len(order)))
    numbers = _free_numbers(operators, fixed, order).reshape(-1, 3)
    reached = np.flatnonzero((numbers >= 0).any(axis=1))
    rows = scipy.sparse.csr_matrix(scalar)[:, reached][order // 3]
    # the dof of the same direction at each neighbour
    columns = numbers[reached].ravel()[3 * rows.indices + np.repeat(order % 3, _lengths(rows))]
    rows = scipy.sparse.csr_matrix((rows.data, columns, rows.indptr), shape=(len(order), total))
    if (columns < 0).any():
        rows = _keep_entries(rows, columns >= 0)
    csr = (rows.indptr, rows.indices, rows.data)
    block = PETSc.Mat().createAIJ(
        ((len(order), total), (len(order), total)), csr=csr, comm=operators.comm
    )
    block.assemble()
    return block


def _free_numbers(
    operators: ElasticOperators, fixed: BoolArray, free: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Return the number over all ranks of each free local dof; -1 for fixed ones."""
    comm: Any = operators.comm  # mpi4py's types leave out exscan
    offset = int(comm.exscan(len(free)) or 0)
    numbers = la.vector(operators.column_map, bs=3, dtype=np.int32)
    local = np.full(len(fixed), -1, dtype=np.int32)
    local[free] = offset + np.arange(len(free))
    numbers.array[: len(fixed)] = local
    numbers.scatter_forward()
    return np.array(numbers.array)


def _upper_rows(
    matrix: scipy.sparse.bsr_matrix, free: NDArray[np.int64], numbers: NDArray[np.int32]
) -> scipy.sparse.csr_matrix:
    """Return the rows of free dofs and columns at or above the diagonal, columns sorted.

    Args:
        free: ``(n,)`` owned dofs, those of a node one after the other.
        numbers: Of local dofs; -1 for fixed ones.
    """
    by_node = numbers.reshape(-1, 3)
    highest = by_node.max(axis=1)
    nodes = free[np.flatnonzero(np.diff(free // 3, prepend=-1))] // 3
    # whole blocks are sorted, a ninth of the entries, and half of them lie below the diagonal
    blocks = scipy.sparse.csr_matrix(
        (np.arange(len(matrix.indices)), highest[matrix.indices], matrix.indptr),
        shape=(len(matrix.indptr) - 1, int(highest.max(initial=0)) + 1),
    )[nodes]
    blocks = _keep_entries(blocks, blocks.indices >= np.repeat(highest[nodes], _lengths(blocks)))
    blocks.sort_indices()
    chosen, shape = blocks.data, (3 * len(nodes), matrix.shape[1])
    rows = scipy.sparse.bsr_matrix(
        (matrix.data[chosen], matrix.indices[chosen], blocks.indptr), shape=shape
    ).tocsr()
    columns, diagonal = numbers[rows.indices], by_node[nodes].ravel()
    rows = scipy.sparse.csr_matrix(
        (rows.data, columns, rows.indptr), shape=(shape[0], int(numbers.max(initial=0)) + 1)
    )
    least = np.where(diagonal >= 0, diagonal, rows.shape[1])
    upper = _keep_entries(rows, columns >= np.repeat(least, _lengths(rows)))
    return upper if (diagonal >= 0).all() else upper[diagonal >= 0]


def _lengths(matrix: scipy.sparse.csr_matrix) -> NDArray[np.int32]:
    return np.diff(matrix.indptr)


def _keep_entries(matrix: scipy.sparse.csr_matrix, kept: BoolArray) -> scipy.sparse.csr_matrix:
    """Return a matrix with some of its entries only."""
    before = np.zeros(len(kept) + 1, dtype=PETSc.IntType)
    np.cumsum(kept, out=before[1:])
    return scipy.sparse.csr_matrix(
        (matrix.data[kept], matrix.indices[kept], before[matrix.indptr]), shape=matrix.shape
    )


def _elimination_order(
    operators: ElasticOperators, fixed: BoolArray
) -> tuple[NDArray[np.int64], bool]:
    """Return the free dofs, and whether their order is good for a factorisation already."""
    if operators.comm.size == 1 and _has_cholmod():
        stiffness = operators.stiffness
        count = len(fixed) // 3
        graph = scipy.sparse.csr_matrix(
            (np.ones(len(stiffness.indices), dtype=np.int8), stiffness.indices, stiffness.indptr),
            (count, count),
        )
        nodes = np.flatnonzero(~fixed.reshape(-1, 3).all(axis=1))
        order = _dissect_nodes(graph[nodes][:, nodes])
        if order is not None:
            dofs = (3 * nodes[order][:, None] + np.arange(3)).ravel()
            return dofs[~fixed[dofs]], True
    return np.flatnonzero(~fixed), False


def _has_cholmod() -> bool:
    return bool(PETSc.Sys.hasExternalPackage("cholmod"))


def ordering_option(matrix: PETSc.Mat) -> dict[str, int]:
    """Return which ordering MUMPS is to use for a matrix."""
    return {"mat_mumps_icntl_7": MINIMUM_DEGREE if matrix.getSize()[0] < SMALL_MATRIX else PORD}


def _factorize(matrix: PETSc.Mat, comm: MPI.Comm, *, ordered: bool) -> PETSc.KSP:
    """Return the solver with the Cholesky factor of a matrix: CHOLMOD on one rank, MUMPS on several
    and where CHOLMOD gives up.
    """
    if comm.size == 1 and _has_cholmod():
        try:
            return _factorize_with(
                "cholmod",
                matrix,
                CHOLMOD_OPTIONS | {"mat_cholmod_nmethods": int(ordered)},
                given=ordered,
            )
        except PETSc.Error:
            # not positive definite, or more than 2^31 factor entries: MUMPS takes these, and its
            # message names the reason
            pass
    try:
        solver = _factorize_with("mumps", matrix, MUMPS_OPTIONS | ordering_option(matrix))
    except PETSc.Error as error:
        if lacks_memory(error):
            raise out_of_memory(
                f"the factorisation of a stiffness with {matrix.getSize()[0]} dofs"
            ) from error
        raise ConvergenceError(
            f"factorisation of a stiffness with {matrix.getSize()[0]} dofs failed: {error}"
        ) from error
    factor = solver.getPC().getFactorMatrix()
    status = factor.getMumpsInfog(1)
    if status in MUMPS_OUT_OF_MEMORY:
        raise out_of_memory(f"the factorisation of a stiffness with {matrix.getSize()[0]} dofs")
    if status < 0:
        reason = {
            -9: "workspace too small",
            -10: "numerically singular",
            -40: "not positive definite",
        }
        raise ConvergenceError(
            f"factorisation of a stiffness with {matrix.getSize()[0]} dofs failed: {reason.get(status, 'MUMPS INFOG(1)')} "
            f"({status}); check that the component is fixed and its elements are sound"
        )
    negative = factor.getMumpsInfog(12)
    if negative:
        # MUMPS takes an indefinite matrix as a positive definite one without a word, but counts its
        # negative pivots
        raise ConvergenceError(
            f"a stiffness with {matrix.getSize()[0]} dofs is not positive definite: {negative} negative pivot(s); check that the "
            "component is fixed and its elements are sound"
        )
    return solver


def apply_once(
    matrix: PETSc.Mat, prefix: str, settings: Mapping[str, object]
) -> tuple[PETSc.KSP, PETSc.PC]:
    """Return a solver of one application of a preconditioner, which is still to be chosen, and
    that.

    Args:
        prefix: Of PETSc's options.
    """
    solver = PETSc.KSP().create(matrix.getComm())
    solver.setType(PETSc.KSP.Type.PREONLY)
    solver.setOperators(matrix)
    pc = solver.getPC()
    pc.setOptionsPrefix(prefix)
    options = PETSc.Options(prefix)
    for name, value in settings.items():
        options[name] = value
    return solver, pc


def _factorize_with(
    package: str, matrix: PETSc.Mat, settings: Mapping[str, int], *, given: bool = False
) -> PETSc.KSP:
    solver, pc = apply_once(matrix, "headstock_", settings)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType(package)
    if given:
        pc.setFactorOrdering(PETSc.Mat.OrderingType.NATURAL)
    pc.setFromOptions()
    pc.setUp()
    return solver
