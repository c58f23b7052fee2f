"""Constraint modes: static shapes of a component for unit boundary dofs."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.boundary_basis import BoundaryBasis
from headstock.reduction.mean_constraints import DEPENDENCE_TOLERANCE, MeanConstraints, local_dofs
from headstock.solvers.constrained_solver import ConstrainedSolver


def find_constraint_modes(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver) -> FloatArray:
    """``psi``, ``(3 n_owned, n_b)``: displacement for unit boundary dofs, the interior free of loads.

    Source: Craig and Bampton (1968); mean interfaces by Lagrange multipliers as in Kaufmann et al. (2019).
    """
    prescribed = _prescribe_patches(basis, means, solver)
    forces = -solver.operators.apply_stiffness(prescribed)
    targets = means.range.T @ (means.select - solver.product(means.full, prescribed))
    return prescribed + solver.solve(forces, targets)


def dependent_rows(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver) -> FloatArray:
    """Rows of boundary dofs ``(m, n_b)`` that vanish because some means depend on each other or on rigid patches alone."""
    if not means.dependent.shape[1] or not (basis.nodes or basis.rails):
        return np.zeros((0, means.boundary_size))
    prescribed = _prescribe_patches(basis, means, solver)
    rows = means.dependent.T @ (means.select - solver.product(means.full, prescribed))
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray((rows / np.where(sizes > 0.0, sizes, 1.0))[sizes[:, 0] > DEPENDENCE_TOLERANCE])


def _prescribe_patches(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver) -> FloatArray:
    """``(3 n_owned, n_b)`` displacement of the points in rigid patches for unit boundary dofs; all others rest."""
    local = local_dofs(solver.operators)
    prescribed = np.zeros((len(local), means.boundary_size))
    where = np.full(len(basis.held), -1, dtype=np.int64)
    where[local] = np.arange(len(local))
    for dofs, values, number in basis.shapes:
        mine = where[dofs] >= 0
        prescribed[where[dofs[mine]], 6 * number : 6 * number + 6] = values[mine]
    return prescribed
