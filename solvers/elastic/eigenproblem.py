"""The eigenproblem ``K x = lambda M x`` as SLEPc is given it: the mass as a matrix, the inverse of
the stiffness as a solver.
"""

from dataclasses import dataclass

from headstock.solvers.elastic.libraries import PETSc


@dataclass(frozen=True, eq=False)
class EigenProblem:
    """``K x = lambda M x``, rows distributed over a communicator.

    Attributes:
        inverse: ``F -> K^-1 F``, symmetric, on the constrained space; on vectors (``solve``) and on
            dense blocks (``matSolve``).
        mass: ``(n, n)``.
    """

    inverse: PETSc.KSP
    mass: PETSc.Mat
    dimension: int


def shell_inverse(context: object, matrix: PETSc.Mat) -> PETSc.KSP:
    """Return a solver that applies an inverse of one's own; the caller destroys it.

    Args:
        context: Has ``apply(pc, given, found)`` for vectors, and ``matApply`` where it is given
            dense blocks.
        matrix: ``(n, n)``, for its layout only.
    """
    inverse = PETSc.KSP().create(matrix.getComm())
    inverse.setType(PETSc.KSP.Type.PREONLY)
    inverse.setOperators(matrix)
    shell = inverse.getPC()
    shell.setType(PETSc.PC.Type.PYTHON)
    shell.setPythonContext(context)
    inverse.setUp()
    return inverse
