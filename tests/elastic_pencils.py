"""Eigenproblems with a known answer, given to SLEPc as those of components are."""

from collections.abc import Callable

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.eigenproblem import EigenProblem, shell_inverse

Operator = Callable[[FloatArray], FloatArray]


class _Inverse:
    def __init__(self, inverse: Operator) -> None:
        self.inverse = inverse

    def apply(self, _: PETSc.PC, given: PETSc.Vec, found: PETSc.Vec) -> None:
        found.setArray(self.inverse(given.getArray(readonly=True)[:, None])[:, 0])

    def matApply(self, _: PETSc.PC, given: PETSc.Mat, found: PETSc.Mat) -> None:  # noqa: N802
        found.getDenseArray()[:] = self.inverse(given.getDenseArray(readonly=True))


def eigen_problem(
    inverse: Operator, mass: Operator, size: int, dimension: int | None = None
) -> EigenProblem:
    """K^-1 and M as SLEPc takes them, of a space of ``size``."""
    weights = scipy.sparse.csr_matrix(mass(np.eye(size)))
    matrix = PETSc.Mat().createAIJ(
        weights.shape, csr=(weights.indptr, weights.indices, weights.data), comm=MPI.COMM_SELF
    )
    matrix.assemble()
    return EigenProblem(
        shell_inverse(_Inverse(inverse), matrix), matrix, size if dimension is None else dimension
    )
