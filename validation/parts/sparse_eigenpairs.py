"""The lowest eigenpairs of a whole model given as two sparse matrices, by SLEPc's Krylov-Schur
search with shift and invert, and static solutions by MUMPS.

Reference solutions for reduced models: nothing here knows of components, fixed dofs or the block
Lanczos search of the reduction.
"""

import numpy as np
import scipy.sparse

from headstock.geometry.errors import lacks_memory, out_of_memory
from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.libraries import PETSc, SLEPc
from headstock.solvers.errors import AccuracyError, ConvergenceError

TOLERANCE = 1e-13  # of an eigenvalue of the inverse: asks for all digits there are
# of a solution: each entry of its residual over what is summed in its row; of an eigenpair:
# against the shape, each dof weighed by the entries of its row
RESIDUAL_LIMIT = 1e-9
SPARE = 6  # pairs beyond those wanted, so that a gap can be found above them
GAP = 1e-6  # of neighbouring eigenvalues, between which a count is safe from rounding
# 60 % more workspace than estimated; an approximate minimum degree order, since PORD, the default
# of builds without METIS, ends the process where many dofs meet in one element; null pivots are
# looked for (24)
MUMPS_OPTIONS = {"mat_mumps_icntl_14": 60, "mat_mumps_icntl_7": 0, "mat_mumps_icntl_24": 1}
PREFIX = "headstock_whole_"


def solve_symmetric(matrix: scipy.sparse.spmatrix, loads: FloatArray) -> FloatArray:
    """Return ``A^-1 f`` for a sparse symmetric matrix ``(n, n)``, definite or not, and loads
    ``(n, k)``.

    Raises:
        ConvergenceError: MUMPS found the matrix singular, or the solution misses the residual
            limit.
    """
    whole = _to_petsc(matrix)
    pc = _factorise(whole)
    solution = _apply(pc, loads)
    # refined once, residuals are small compared with each row of its own, a constraint's among them
    solution += _apply(pc, loads - matrix @ solution)
    for thing in (pc, whole):
        thing.destroy()
    sizes = np.abs(loads) + abs(matrix) @ np.abs(solution)
    # rows below rounding of the largest count with that
    sizes = np.maximum(sizes, np.finfo(float).eps * sizes.max(axis=0, initial=1e-300))
    _require_small(
        np.abs(loads - matrix @ solution) / sizes,
        f"a static solution with {len(loads)} dofs",
    )
    return solution


def lowest_symmetric_pairs(
    stiffness: scipy.sparse.spmatrix,
    mass: scipy.sparse.spmatrix,
    count: int,
    *,
    shift: float,
    constraints: int = 0,
) -> tuple[FloatArray, FloatArray]:
    """Return the lowest eigenvalues and mass-normalised shapes of ``K x = omega^2 M x``, none left
    out.

    Args:
        stiffness: ``(n, n)`` symmetric; bordered by constraint rows if there are any.
        mass: ``(n, n)`` symmetric, positive semidefinite; zero in the border.
        shift: Of omega^2 [rad^2/s^2], below all eigenvalues.
        constraints: Number of rows in the border.

    Returns:
        ``(count,)`` rising [rad^2/s^2] and ``(n, count)``.

    Raises:
        ConvergenceError: Fewer pairs were found, or one misses the residual limit.
        AccuracyError: The signs of pivots count other eigenvalues than were found (Sturm).

    Source: Stewart (2001), A Krylov-Schur algorithm for large eigenproblems; Ericsson and Ruhe
    (1980) for the spectral transformation; Gould (1985) for the inertia with constraints.
    """
    pair = tuple(map(_to_petsc, (stiffness, mass)))
    wanted = count + SPARE
    solver = SLEPc.EPS().create(pair[0].comm)
    _set_options(PREFIX + "st_")
    solver.setOptionsPrefix(PREFIX)
    solver.setOperators(*pair)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    solver.setDimensions(wanted, 2 * wanted + 20)
    solver.setTolerances(TOLERANCE, 200)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTarget(shift)
    transform = solver.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    transform.getKSP().setType(PETSc.KSP.Type.PREONLY)
    _choose_factorisation(transform.getKSP().getPC())
    transform.setFromOptions()
    try:
        solver.solve()
    except PETSc.Error as error:
        raise _failure(error, stiffness.shape[0]) from error
    converged = min(solver.getConverged(), wanted)
    if converged < wanted:
        raise ConvergenceError(
            f"SLEPc found {converged} of {wanted} eigenpairs of a model with {stiffness.shape[0]} dofs"
        )
    vector = pair[0].createVecRight()
    eigenvalues: FloatArray = np.zeros(converged)
    shapes: FloatArray = np.zeros((stiffness.shape[0], converged))
    for index in range(converged):
        eigenvalues[index] = solver.getEigenpair(index, vector).real
        shapes[:, index] = vector.array
    order = np.argsort(eigenvalues)
    eigenvalues, shapes = eigenvalues[order], shapes[:, order]
    shapes /= np.sqrt(np.einsum("ij,ij->j", shapes, mass @ shapes))
    for thing in (vector, solver, *pair):
        thing.destroy()
    residuals = stiffness @ shapes - (mass @ shapes) * eigenvalues
    weights = _row_weights(stiffness)[:, None] + _row_weights(mass)[:, None] * np.abs(eigenvalues)
    sizes = np.einsum("ij,ij,ij->j", shapes, shapes, weights)
    _require_small(
        np.sqrt((residuals**2 / weights).max(axis=0) / sizes), f"a mode of {len(shapes)} dofs"
    )
    _require_count(stiffness, mass, eigenvalues, count, constraints)
    return eigenvalues[:count], shapes[:, :count]


def _require_count(
    stiffness: scipy.sparse.spmatrix,
    mass: scipy.sparse.spmatrix,
    eigenvalues: FloatArray,
    count: int,
    constraints: int,
) -> None:
    """Require as many pivots below zero as eigenvalues were found below the widest gap above those
    wanted.
    """
    gaps = eigenvalues[count:] - eigenvalues[count - 1 : -1]
    gaps = gaps / np.maximum(np.abs(eigenvalues[count:]), np.finfo(float).tiny)
    kept = count + int(np.argmax(gaps))
    if not gaps.max() > GAP:
        raise AccuracyError(
            f"the eigenvalues {count} to {len(eigenvalues)} of a model are one cluster; ask for more"
        )
    between = 0.5 * (eigenvalues[kept - 1] + eigenvalues[kept])
    shifted = _to_petsc(stiffness - between * mass)
    pc = _factorise(shifted)
    negative = pc.getFactorMatrix().getInertia()[0] - constraints
    pc.destroy()
    shifted.destroy()
    if negative != kept:
        raise AccuracyError(
            f"{negative} eigenvalues of a model with {stiffness.shape[0]} dofs lie below "
            f"{between:.6g} rad^2/s^2, and {kept} were found"
        )


def _require_small(missed: FloatArray, what: str) -> None:
    largest = float(missed.max(initial=0.0))
    if not largest <= RESIDUAL_LIMIT:
        raise ConvergenceError(
            f"{what} keeps a residual of {largest:.2g}, limit {RESIDUAL_LIMIT:g}: its "
            "stiffness is too badly conditioned"
        )


def _row_weights(matrix: scipy.sparse.spmatrix) -> FloatArray:
    sums: FloatArray = np.asarray(abs(matrix).sum(axis=1), dtype=float)
    return sums.ravel()


def _to_petsc(matrix: scipy.sparse.spmatrix) -> PETSc.Mat:
    rows = scipy.sparse.csr_matrix(matrix)
    rows.sort_indices()
    index = PETSc.IntType
    csr = (rows.indptr.astype(index), rows.indices.astype(index), rows.data)
    whole = PETSc.Mat().createAIJ(rows.shape, csr=csr, comm=PETSc.COMM_SELF)
    whole.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    whole.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
    return whole


def _set_options(prefix: str) -> None:
    options = PETSc.Options(prefix)
    for name, value in MUMPS_OPTIONS.items():
        options[name] = value


def _choose_factorisation(pc: PETSc.PC) -> None:
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")


def _factorise(matrix: PETSc.Mat) -> PETSc.PC:
    pc = PETSc.PC().create(matrix.comm)
    _set_options(PREFIX)
    pc.setOptionsPrefix(PREFIX)
    pc.setOperators(matrix)
    _choose_factorisation(pc)
    pc.setFromOptions()
    try:
        pc.setUp()
    except PETSc.Error as error:
        raise _failure(error, matrix.getSize()[0]) from error
    factor = pc.getFactorMatrix()
    status, zero = factor.getMumpsInfog(1), factor.getMumpsInfog(28)
    if status < 0 or zero:
        raise ConvergenceError(
            f"MUMPS did not factorise a matrix with {matrix.getSize()[0]} dofs: INFOG(1) = {status}, "
            f"{zero} pivots are zero"
        )
    return pc


def _apply(pc: PETSc.PC, loads: FloatArray) -> FloatArray:
    right, left = (
        PETSc.Mat().createDense(loads.shape, array=np.array(block, order="F"), comm=pc.comm)
        for block in (loads, np.zeros(loads.shape))
    )
    for block in (right, left):
        block.assemble()
    pc.getFactorMatrix().matSolve(right, left)
    solution: FloatArray = np.array(left.getDenseArray(), dtype=float)
    for block in (right, left):
        block.destroy()
    return solution


def _failure(error: Exception, size: int) -> Exception:
    if lacks_memory(error):
        return out_of_memory(f"the factorisation of a whole model with {size} dofs")
    return ConvergenceError(f"a whole model with {size} dofs was not solved: {error}")
