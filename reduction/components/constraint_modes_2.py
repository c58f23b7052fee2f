"""Constraint modes: static shapes of a component for unit boundary dofs."""

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray, rigid_map, rigid_transfer
from headstock.reduction.components.boundary_basis import BoundaryBasis
from headstock.reduction.components.constraint_modes import DEPENDENCE_TOLERANCE, MeanConstraints, local_dofs
from headstock.reduction.rails import station_motion
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver, free_combinations
from headstock.solvers.ranks import max_over_ranks, sum_over_ranks

RIGID_MATCH = 1e-10  # by what share of their size rigid motions may miss what their boundary dofs prescribe


def find_constraint_modes(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver) -> FloatArray:
    """``psi``, ``(3 n_owned, n_b)``: displacement for unit boundary dofs, the interior free of loads.

    Boundary dofs that move as a rigid body move the whole component so, which no solve has to find; only the others are solved for.
    Mass, centre of mass and inertia then come out right however badly the stiffness is conditioned.

    Source: Craig and Bampton (1968); mean interfaces by Lagrange multipliers as in Kaufmann et al. (2019).
    """
    if means.body_motions is not None:
        return means.body_motions
    prescribed = _prescribe_patches(basis, means, solver)
    targets = means.range.T @ (means.select - solver.product(means.full, prescribed))
    motions, boundary, units = _rigid_part(basis, means, solver)
    if not _follow(boundary, motions, prescribed, targets, solver):
        motions, boundary = motions[:, :0], boundary[:, :0]
    orthogonal, triangle = scipy.linalg.qr(boundary / units[:, None])
    count = boundary.shape[1]
    rigid, elastic = orthogonal[:, :count].T / units, orthogonal[:, count:].T / units
    directions = units[:, None] * orthogonal[:, count:]
    shapes = prescribed @ directions
    shapes = shapes + solver.solve(-solver.forces(shapes), targets @ directions)
    psi = motions @ np.linalg.solve(triangle[:count], rigid) + shapes @ elastic
    return np.where(solver.held[:, None], prescribed, psi)


def _rigid_part(
    basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rigid motions that supports leave free ``(3 n_owned, k)``, their boundary dofs ``(n_b, k)``, and the unit of each dof ``(n_b,)``."""
    operators = solver.operators
    supported = basis.supported[local_dofs(operators)]
    center, free = free_combinations(operators, supported)
    rows = [rigid_transfer(center, frame.origin) for frame in means.node_frames]
    rows += [station_motion(station.point, station.axis, center) for station in basis.stations]
    boundary = np.vstack([np.zeros((0, 6)), *rows]) @ free
    arms = max_over_ranks(operators.comm, np.abs(operators.points - center).max(axis=0, initial=0.0))
    turn = 1.0 / (float(np.linalg.norm(arms)) or 1.0)
    units = np.concatenate([np.repeat([1.0, turn], [3, len(row) - 3]) for row in rows] or [np.zeros(0)])
    return np.where(supported[:, None], 0.0, rigid_map(operators.points, center) @ free), boundary, units


def _follow(
    boundary: FloatArray, motions: FloatArray, prescribed: FloatArray, targets: FloatArray, solver: ConstrainedSolver
) -> bool:
    """Whether rigid motions are told by their boundary dofs and have them; not so where a patch leaves a rotation undetermined."""
    if not boundary.size or np.linalg.matrix_rank(boundary) < boundary.shape[1]:
        return False
    rest = motions - prescribed @ boundary
    held = max_over_ranks(solver.comm, np.abs(rest[solver.held]).max(axis=0, initial=0.0))
    means = np.abs(solver.product(solver.constraints, rest) - targets @ boundary)
    sizes = sum_over_ranks(solver.comm, np.abs(solver.constraints).T @ np.abs(motions))
    reach = max_over_ranks(solver.comm, np.abs(motions).max(axis=0, initial=0.0))
    return bool((held <= RIGID_MATCH * reach).all() and (means <= RIGID_MATCH * sizes.max(axis=1, initial=0.0)[:, None]).all())


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
