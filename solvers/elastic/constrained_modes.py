"""Lowest modes of a component on the space that its constraints leave, by the eigensolver asked for,
on the factors that are there already.
"""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import DEFAULT_EIGENSOLVER, Eigensolver
from headstock.meshing.component_mesh import IntArray
from headstock.solvers.elastic.block_lanczos import block_lanczos_pairs
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import EigenPairs, ModeTarget
from headstock.solvers.elastic.eigenproblem import EigenProblem, shell_inverse
from headstock.solvers.elastic.factorization import full_block
from headstock.solvers.elastic.krylov_schur import krylov_schur_pairs
from headstock.solvers.elastic.libraries import PETSc
from headstock.solvers.elastic.lobpcg import lobpcg_pairs
from headstock.solvers.errors import AccuracyError


def lowest_modes(
    solver: ConstrainedSolver,
    start: FloatArray,
    target: ModeTarget,
    *,
    eigensolver: Eigensolver = DEFAULT_EIGENSOLVER,
) -> EigenPairs:
    """Return the lowest modes with fixed dofs at zero and constraints fulfilled, complete up to the
    target and to the end of the cluster there; collective.

    Args:
        solver: Factorised stiffness of the component.
        start: ``(3 n_owned, b)`` start block, of ``start_width`` vectors; Krylov-Schur takes its first.
        eigensolver: By which method where there are factors; else LOBPCG.

    Returns:
        Pairs with shapes ``(3 n_owned, m)``.

    Raises:
        ConvergenceError: The target was not reached.
        AccuracyError: The mass was not assembled.
    """
    if solver.multigrid is not None:
        return lobpcg_pairs(solver, solver.multigrid, start, target)
    search = {"block_lanczos": block_lanczos_pairs, "krylov_schur": krylov_schur_pairs}[eigensolver]
    with _constrained_problem(solver) as constrained:
        pairs = search(constrained.problem, start[constrained.rows], target)
        return dataclasses.replace(pairs, vectors=constrained.embed(pairs.vectors))


@dataclass(frozen=True, eq=False)
class _ConstrainedProblem:
    """The eigenproblem on the dofs that are not fixed.

    Attributes:
        rows: ``(n,)`` dof behind each row that this rank holds.
        owned: How many dofs this rank owns, fixed ones too.
    """

    problem: EigenProblem
    rows: IntArray
    owned: int

    def embed(self, vectors: FloatArray) -> FloatArray:
        """Return ``(owned, k)`` from rows ``(n, k)``, fixed dofs zero."""
        full = np.zeros((self.owned, vectors.shape[1]))
        full[self.rows] = vectors
        return full


@contextmanager
def _constrained_problem(solver: ConstrainedSolver) -> Iterator[_ConstrainedProblem]:
    """Provide the eigenproblem on a solver's constrained space, on its own factors; collective.

    Where there are neither constraints nor pins, SLEPc works on the factors directly.
    """
    operators = solver.operators
    if operators.scalar_mass is None:
        raise AccuracyError("the mass matrix was not assembled, yet modes were asked for")
    order = solver.elimination_order
    # pinned dofs carry no row of the factors, but they move
    pins = np.setdiff1d(np.flatnonzero(~solver.fixed), order)
    rows = np.concatenate([order, pins])
    mass = full_block(operators, solver.fixed, operators.scalar_mass, order=rows)
    plain = not solver.constraints.shape[1] and not solver.motions.shape[1]
    inverse = solver.factors if plain else shell_inverse(_ConstrainedInverse(solver, rows), mass)
    dimension = solver.free_total - solver.constraints.shape[1]
    try:
        yield _ConstrainedProblem(
            EigenProblem(inverse, mass, dimension), rows, operators.owned_dofs
        )
    finally:
        mass.destroy()
        if not plain:
            inverse.destroy()


class _ConstrainedInverse:
    """Constraints and pins taken care of by small dense corrections around the factors."""

    def __init__(self, solver: ConstrainedSolver, rows: IntArray) -> None:
        self._solver, self._rows = solver, rows

    def apply(self, _: PETSc.PC, given: PETSc.Vec, solution: PETSc.Vec) -> None:
        solution.setArray(self._displacements(given.getArray(readonly=True)[:, None])[:, 0])

    def matApply(self, _: PETSc.PC, given: PETSc.Mat, solution: PETSc.Mat) -> None:  # noqa: N802
        solution.getDenseArray()[:] = self._displacements(given.getDenseArray(readonly=True))

    def _displacements(self, forces: FloatArray) -> FloatArray:
        full = np.zeros((self._solver.operators.owned_dofs, forces.shape[1]))
        full[self._rows] = forces
        return self._solver.apply_inverse(full)[self._rows]
