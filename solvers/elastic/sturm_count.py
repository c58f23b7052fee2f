"""The number of natural frequencies below a given one, from the signs of the pivots of a
factorisation (Sturm count).
"""

import numpy as np
import scipy.sparse

from headstock.geometry.errors import out_of_memory
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.elastic.factorization import (
    MUMPS_OPTIONS,
    MUMPS_OUT_OF_MEMORY,
    free_block,
    ordering_option,
)
from headstock.solvers.elastic.libraries import PETSc
from headstock.solvers.errors import AccuracyError, ConvergenceError
from headstock.solvers.ranks import sum_over_ranks

# null pivots are looked for (24), and the inertia needs no scaling tricks: a pivot that vanishes
# means the shift is a frequency
INERTIA_OPTIONS = MUMPS_OPTIONS | {"mat_mumps_icntl_24": 1}


def count_frequencies_below(
    operators: ElasticOperators,
    fixed: BoolArray,
    frequency_hz: float,
    *,
    constraints: FloatArray | None = None,
) -> int:
    """Return the number of natural frequencies of a component below a given one, each counted as
    often as it occurs.

    Rigid-body motions that nothing holds count too. Collective over the operators' communicator.

    Args:
        fixed: ``(3 n_owned,)`` dofs that do not move.
        frequency_hz: Shift [Hz], above zero and not itself a natural frequency.
        constraints: ``(3 n_owned, n_c)`` independent columns C with ``C^T u = 0``.

    Raises:
        ConvergenceError: The factorisation failed.
        AccuracyError: The mass was not assembled, or the shift is a natural frequency to working
            accuracy.

    Source: Sylvester's law of inertia; for the constraints Haynsworth (1968): with ``A = K -
    omega^2 M`` the inertia of ``[[A, C], [C^T, 0]]`` is that of A and of ``-C^T A^-1 C``, and Gould
    (1985) for what it says about A on the null space of C^T.
    """
    if operators.scalar_mass is None:
        raise AccuracyError(
            "the mass matrix was not assembled, yet natural frequencies are to be counted"
        )
    comm = operators.comm
    free_total = int(comm.allreduce(int((~fixed).sum())))
    if free_total == 0:
        return 0
    shift = (2.0 * np.pi * frequency_hz) ** 2
    mass = scipy.sparse.kron(operators.scalar_mass, np.eye(3), format="bsr")
    matrix = free_block(operators, fixed, operators.stiffness - shift * mass)
    try:
        return _count_with(
            matrix,
            np.zeros((len(fixed), 0)) if constraints is None else constraints,
            operators,
            fixed,
        )
    finally:
        matrix.destroy()


def _count_with(
    matrix: PETSc.Mat, constraints: FloatArray, operators: ElasticOperators, fixed: BoolArray
) -> int:
    comm = operators.comm
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc = PETSc.PC().create(comm)
    pc.setOptionsPrefix("headstock_inertia_")
    options = PETSc.Options("headstock_inertia_")
    for name, value in (INERTIA_OPTIONS | ordering_option(matrix)).items():
        options[name] = value
    pc.setOperators(matrix)
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType("mumps")
    pc.setFromOptions()
    try:
        pc.setUp()
        factor = pc.getFactorMatrix()
        status = factor.getMumpsInfog(1)
        if status in MUMPS_OUT_OF_MEMORY:
            raise out_of_memory(
                f"the count of frequencies of a part with {matrix.getSize()[0]} dofs"
            )
        if status < 0:
            raise ConvergenceError(
                f"the factorisation for counting frequencies failed: MUMPS INFOG(1) = {status}"
            )
        negative, zero, _ = factor.getInertia()
        if zero:
            raise AccuracyError(
                f"the shift meets {zero} natural frequencies to working accuracy; count at another frequency"
            )
        return int(negative) - _negative_directions(factor, constraints, operators, fixed)
    finally:
        pc.destroy()


def _negative_directions(
    factor: PETSc.Mat, constraints: FloatArray, operators: ElasticOperators, fixed: BoolArray
) -> int:
    """Return the negative eigenvalues of ``C^T A^-1 C``: what the constraints take from the
    count.
    """
    count = constraints.shape[1]
    if count == 0:
        return 0
    comm = operators.comm
    free = constraints[~fixed]
    sizes = ((len(free), int(comm.allreduce(len(free)))), (PETSc.DECIDE, count))
    given = PETSc.Mat().createDense(sizes, array=np.asfortranarray(free), comm=comm)
    solution = PETSc.Mat().createDense(sizes, array=np.zeros(free.shape, order="F"), comm=comm)
    for block in (given, solution):
        block.assemble()
    factor.matSolve(given, solution)
    lifted = np.array(solution.getDenseArray())
    given.destroy()
    solution.destroy()
    complement = sum_over_ranks(comm, free.T @ lifted)
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(complement)), np.finfo(float).tiny))
    values = np.linalg.eigvalsh(0.5 * (complement + complement.T) * scale * scale[:, None])
    return int((values < 0.0).sum())
