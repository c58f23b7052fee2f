"""Constraint modes: static shapes of a component for unit boundary dofs; averaging interfaces as
weighted means, free bodies' mean motion.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import BoolArray, FloatArray, Frame, rigid_map, rigid_transfer
from headstock.meshing.component_mesh import IntArray
from headstock.reduction.components.boundary_basis import BoundaryBasis
from headstock.reduction.components.interface_patches import MeshPatch
from headstock.reduction.components.nodal_loads import scatter_rows
from headstock.reduction.components.supports import HeldPoints
from headstock.reduction.rails import control_point_motion
from headstock.solvers.elastic.constrained_solver import (
    ConstrainedSolver,
    free_combinations,
    scale_motions,
)
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import max_over_ranks, sum_over_ranks

DEPENDENCE_TOLERANCE = 1e-10
RIGID_MATCH = (
    1e-10  # by what share of their size rigid motions may miss what their boundary dofs prescribe
)


@dataclass(frozen=True, eq=False)
class _BodyMean:
    """Mass-weighted mean of the k rigid motions that supports leave free.

    Attributes:
        center: Centre of mass ``(3,)`` [m].
        motions: ``(3 n_owned, k)``.
        operator: ``(3 n_owned, k)``, its transpose takes the means of a displacement.
        values: ``(k, 6)`` means for unit dofs of the body.
        fixed: ``(6 - k, 6)`` orthonormal combinations of the body's dofs that vanish.
    """

    center: FloatArray
    motions: FloatArray
    operator: FloatArray
    values: FloatArray
    fixed: FloatArray


class MeanConstraints:
    """Columns C of the prescribed means, their dependent combinations taken out.

    ``targets`` maps boundary dofs to the values of ``C^T u``; ``dependent`` holds rows of boundary
    dofs that must vanish. A component without interfaces that supports leave free has one body node
    in ``loose_frame``: ``body_motions`` ``(3 n_owned, 6)`` is what its dofs do, and ``fixed`` ``(m,
    6)`` combinations of them that supports fix.
    """

    def __init__(self, basis: BoundaryBasis, operators: ElasticOperators) -> None:
        count = basis.size
        columns, selectors = [], []
        for number, node in enumerate(basis.nodes):
            if node.coupling == "average":
                columns.append(_scatter(node.mean_operator(), node.patch, operators))
                selectors.append(np.eye(count)[:, node.columns(number)])
        first = 6 * len(basis.nodes)
        for rail in basis.rails:
            columns.append(_scatter(rail.operator, rail.patch, operators))
            selectors.append(np.eye(count)[:, first : first + rail.operator.shape[1]])
            first += rail.operator.shape[1]
        self.node_frames = tuple(Frame(node.patch.centroid) for node in basis.nodes)
        self.loose_frame: Frame | None = None
        self.body_motions: FloatArray | None = None
        self.fixed: FloatArray = np.zeros((0, 6))
        supported = find_dofs(operators, basis.held.dofs)
        middle, free = free_combinations(operators, supported, basis.held.turned_motions)
        if not basis.nodes and not basis.rails and free.shape[1]:
            # a body that nothing holds in some motion: the mass-weighted mean of those motions is
            # the boundary node, so psi is rigid and phi free of them
            mean = _mass_mean(operators, supported, middle, free)
            columns, selectors, count = [mean.operator], [mean.values.T], 6
            self.loose_frame = Frame(mean.center)
            self.body_motions = mean.motions @ mean.values
            self.fixed = mean.fixed
            self.node_frames = (self.loose_frame,)
        if len(basis.held.nodes):
            # the points of supports in turned directions: each a mean of its own, which vanishes
            columns.append(_scatter_turned(basis.held, operators))
            selectors.append(np.zeros((count, len(basis.held.nodes))))
        full = np.hstack(columns) if columns else np.zeros((operators.owned_dofs, 0))
        self.boundary_size = count
        fixed = find_dofs(operators, basis.fixed)
        self.full = full
        self.select = np.hstack(selectors).T if selectors else np.zeros((0, count))
        self.range, dependent = _split_range(np.where(fixed[:, None], 0.0, full), operators.comm)
        self.columns = full @ self.range if dependent.shape[1] else full
        self.dependent = dependent


def _split_range(columns: FloatArray, comm: MPI.Comm) -> tuple[FloatArray, FloatArray]:
    """Return the orthonormal combinations of columns that are independent ``(n_c, r)``, and those
    that vanish ``(n_c, n_c - r)``.
    """
    if columns.shape[1] == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    gram = sum_over_ranks(comm, columns.T @ columns)
    scale = 1.0 / np.sqrt(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
    values, vectors = np.linalg.eigh(scale[:, None] * gram * scale)
    keep = values > DEPENDENCE_TOLERANCE
    if keep.all():
        return np.eye(len(gram)), np.zeros((len(gram), 0))
    vectors = scale[:, None] * vectors
    return np.linalg.qr(vectors[:, keep])[0], vectors[:, ~keep]


def _mass_mean(
    operators: ElasticOperators, supported: BoolArray, middle: FloatArray, free: FloatArray
) -> _BodyMean:
    """Return the mean of the motions about a point that supports leave free, from their
    combinations ``(6, k)``.
    """
    ones = np.zeros((operators.owned_dofs, 1))
    ones[0::3] = 1.0
    weights = operators.apply_mass(ones)[0::3, 0]
    mass = sum_over_ranks(operators.comm, weights.sum(keepdims=True))
    center = sum_over_ranks(operators.comm, weights @ operators.points) / mass
    # in one unit, the first k columns of Q span the motions that supports leave free, the others
    # those that they prevent. A mean weighted by mass does not see elastic modes, which are
    # orthogonal to rigid motions in that product
    units, count = scale_motions(operators)[1][:, None], free.shape[1]
    orthogonal = np.linalg.qr(rigid_transfer(middle, center) @ free / units, mode="complete")[0]
    motions = rigid_map(operators.points, center) @ (units * orthogonal[:, :count])
    rigid = np.where(supported[:, None], 0.0, motions)
    weighted = operators.apply_mass(rigid)
    gram = sum_over_ranks(operators.comm, rigid.T @ weighted)
    values, rest = (orthogonal / units).T[:count], (orthogonal / units)[:, count:]
    return _BodyMean(center, rigid, weighted @ np.linalg.inv(gram), values, np.linalg.qr(rest)[0].T)


def _local_dofs(operators: ElasticOperators) -> IntArray:
    """Return the mesh dofs ``(3 n_owned,)`` behind the rows this rank owns."""
    return (3 * operators.nodes[:, None] + np.arange(3)).ravel()


def find_dofs(operators: ElasticOperators, dofs: IntArray) -> BoolArray:
    """Find which rows of this rank ``(3 n_owned,)`` are among some mesh dofs."""
    return np.isin(_local_dofs(operators), dofs)


def _scatter_turned(held: HeldPoints, operators: ElasticOperators) -> FloatArray:
    """Return a column ``(3 n_owned, m)`` per point and turned direction that a support holds."""
    columns = np.zeros((len(operators.nodes), 3, len(held.nodes)))
    order = np.argsort(operators.nodes)
    places = np.searchsorted(operators.nodes, held.nodes, sorter=order)
    local_rows = order[np.minimum(places, len(order) - 1)] if len(order) else np.zeros(0, dtype=int)
    here = np.flatnonzero(operators.nodes[local_rows] == held.nodes) if len(order) else local_rows
    columns[local_rows[here], :, here] = held.directions[here]
    return columns.reshape(-1, len(held.nodes))


def _scatter(operator: FloatArray, patch: MeshPatch, operators: ElasticOperators) -> FloatArray:
    by_node = operator.reshape(len(patch.nodes), 3, operator.shape[1])
    return scatter_rows(by_node, patch.nodes, operators).reshape(-1, operator.shape[1])


def find_constraint_modes(
    basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver
) -> FloatArray:
    """Find the constraint modes ``psi``: displacement for unit boundary dofs, the interior free of
    loads.

    Boundary dofs that move as a rigid body move the whole component so, which no solve has to find;
    only the others are solved for. Mass, centre of mass and inertia then come out right however
    badly the stiffness is conditioned.

    Args:
        basis: Boundary nodes, fixed dofs and shapes of rigid interfaces.
        means: Weighted means that averaging interfaces and rails prescribe.
        solver: Factorised stiffness with those dofs fixed and those means constrained.

    Returns:
        ``(3 n_owned, n_b)`` rows of this rank's nodes [m/m, m/rad].

    Source: Craig and Bampton (1968); mean interfaces by Lagrange multipliers as in Kaufmann et al.
    (2019).
    """
    if means.body_motions is not None:
        return means.body_motions
    prescribed = _prescribe_patches(basis, means, solver)
    targets = means.range.T @ (means.select - solver.product(means.full, prescribed))
    motions, boundary, units = _rigid_part(basis, means, solver)
    if not _follow(boundary, motions, prescribed, targets, solver):
        motions, boundary = motions[:, :0], boundary[:, :0]
    # boundary dofs in one unit as Q1 r + Q2 e: Q1 spans those of rigid motions, which move the
    # whole component through R^-1 and need no solve; static shapes are solved for the columns of Q2
    # alone
    orthogonal, triangle = scipy.linalg.qr(boundary / units[:, None])
    count = boundary.shape[1]
    rigid, elastic = orthogonal[:, :count].T / units, orthogonal[:, count:].T / units
    directions = units[:, None] * orthogonal[:, count:]
    shapes = prescribed @ directions
    shapes = shapes + solver.solve(-solver.forces(shapes), targets @ directions)
    psi = motions @ np.linalg.solve(triangle[:count], rigid) + shapes @ elastic
    return np.where(solver.fixed[:, None], prescribed, psi)


def _rigid_part(
    basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rigid motions that supports leave free ``(3 n_owned, k)``, their boundary dofs
    ``(n_b, k)``, and the unit of each dof ``(n_b,)``.
    """
    operators = solver.operators
    supported = find_dofs(operators, basis.held.dofs)
    center, free = free_combinations(operators, supported, basis.held.turned_motions)
    rows = [rigid_transfer(center, frame.origin) for frame in means.node_frames]
    rows += [
        control_point_motion(control_point.point, control_point.axis, center)
        for control_point in basis.control_points
    ]
    # deformation shapes rest in a rigid motion
    more = means.boundary_size - sum(map(len, rows))
    boundary = np.vstack([np.zeros((0, 6)), *rows, np.zeros((more, 6))]) @ free
    arms = max_over_ranks(
        operators.comm, np.abs(operators.points - center).max(axis=0, initial=0.0)
    )
    turn = 1.0 / (float(np.linalg.norm(arms)) or 1.0)
    units = np.concatenate(
        [*(np.repeat([1.0, turn], [3, len(row) - 3]) for row in rows), np.ones(more)]
    )
    return (
        np.where(supported[:, None], 0.0, rigid_map(operators.points, center) @ free),
        boundary,
        units,
    )


def _follow(
    boundary: FloatArray,
    motions: FloatArray,
    prescribed: FloatArray,
    targets: FloatArray,
    solver: ConstrainedSolver,
) -> bool:
    """Return whether the boundary dofs determine the rigid motions; not so where a patch leaves a
    rotation undetermined.
    """
    if not boundary.size or np.linalg.matrix_rank(boundary) < boundary.shape[1]:
        return False
    rest = motions - prescribed @ boundary
    fixed = max_over_ranks(solver.comm, np.abs(rest[solver.fixed]).max(axis=0, initial=0.0))
    means = np.abs(solver.product(solver.constraints, rest) - targets @ boundary)
    sizes = sum_over_ranks(solver.comm, np.abs(solver.constraints).T @ np.abs(motions))
    reach = max_over_ranks(solver.comm, np.abs(motions).max(axis=0, initial=0.0))
    return bool(
        (fixed <= RIGID_MATCH * reach).all()
        and (means <= RIGID_MATCH * sizes.max(axis=1, initial=0.0)[:, None]).all()
    )


def dependent_rows(
    basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver
) -> FloatArray:
    """Return the rows of boundary dofs that vanish because some means depend on each other or on
    rigid patches alone.

    Args:
        basis: Boundary nodes, fixed dofs and shapes of rigid interfaces.
        means: Weighted means, with the combinations of them that depend on others.
        solver: Factorised operators with the fixed dofs.

    Returns:
        ``(m, n_b)`` of unit length.
    """
    if not means.dependent.shape[1] or not (basis.nodes or basis.rails):
        return np.zeros((0, means.boundary_size))
    prescribed = _prescribe_patches(basis, means, solver)
    rows = means.dependent.T @ (means.select - solver.product(means.full, prescribed))
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return (rows / np.where(sizes > 0.0, sizes, 1.0))[sizes[:, 0] > DEPENDENCE_TOLERANCE]


def _prescribe_patches(
    basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver
) -> FloatArray:
    """Return the displacement ``(3 n_owned, n_b)`` of the points in rigid patches for unit boundary
    dofs; all others rest.
    """
    local = _local_dofs(solver.operators)
    prescribed = np.zeros((len(local), means.boundary_size))
    for dofs, values, columns in basis.shapes:
        _, given, local_rows = np.intersect1d(dofs, local, assume_unique=True, return_indices=True)
        prescribed[np.ix_(local_rows, columns)] = values[given]
    return prescribed
