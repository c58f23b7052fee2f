"""Averaging interfaces as weighted means of the displacement, and the mean motion of a body that nothing holds."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import BoolArray, FloatArray, Frame, rigid_map, rigid_transfer
from headstock.meshing.component_mesh import IntArray
from headstock.reduction.components.boundary_basis import BoundaryBasis
from headstock.reduction.rails import STATION_DOFS
from headstock.solvers.elastic.constrained_solver import free_combinations, scale_motions
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.ranks import sum_over_ranks

DEPENDENCE_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class BodyMean:
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

    ``targets`` maps boundary dofs to the values of ``C^T u``; ``dependent`` holds rows of boundary dofs that must vanish. A component
    without interfaces that supports leave free has one body node in ``loose_frame``: ``body_motions`` ``(3 n_owned, 6)`` is what its
    dofs do, and ``fixed`` ``(m, 6)`` combinations of them that supports fix.
    """

    def __init__(self, basis: BoundaryBasis, operators: ElasticOperators) -> None:
        local_of = {int(point): row for row, point in enumerate(operators.nodes)}
        count = 6 * len(basis.nodes) + STATION_DOFS * len(basis.stations)
        columns, selectors = [], []
        for number, node in enumerate(basis.nodes):
            if node.coupling == "average":
                columns.append(_scatter(node.patch.average_operator(), node.patch.nodes, local_of, operators.owned_dofs))
                selectors.append(np.eye(count)[:, 6 * number : 6 * number + 6])
        first = 6 * len(basis.nodes)
        for rail in basis.rails:
            columns.append(_scatter(rail.operator, rail.patch.nodes, local_of, operators.owned_dofs))
            selectors.append(np.eye(count)[:, first : first + rail.operator.shape[1]])
            first += rail.operator.shape[1]
        self.node_frames = tuple(Frame(node.patch.centroid) for node in basis.nodes)
        self.loose_frame: Frame | None = None
        self.body_motions: FloatArray | None = None
        self.fixed: FloatArray = np.zeros((0, 6))
        supported = basis.supported[local_dofs(operators)]
        middle, free = free_combinations(operators, supported)
        if not basis.nodes and not basis.rails and free.shape[1]:
            # a body that nothing holds in some motion: the mass-weighted mean of those motions is the boundary node, so psi is
            # rigid and phi free of them
            mean = _mass_mean(operators, supported, middle, free)
            columns, selectors, count = [mean.operator], [mean.values.T], 6
            self.loose_frame, self.body_motions, self.fixed = Frame(mean.center), mean.motions @ mean.values, mean.fixed
            self.node_frames = (self.loose_frame,)
        full = np.hstack(columns) if columns else np.zeros((operators.owned_dofs, 0))
        self.boundary_size = count
        held = basis.held[local_dofs(operators)]
        self.full = full
        self.select = np.hstack(selectors).T if selectors else np.zeros((0, count))
        self.range, dependent = _split_range(np.where(held[:, None], 0.0, full), operators.comm)
        self.columns = full @ self.range
        self.dependent = dependent


def _split_range(columns: FloatArray, comm: MPI.Comm) -> tuple[FloatArray, FloatArray]:
    """Orthonormal combinations of columns that are independent ``(n_c, r)``, and those that vanish ``(n_c, n_c - r)``."""
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


def _mass_mean(operators: ElasticOperators, supported: BoolArray, middle: FloatArray, free: FloatArray) -> BodyMean:
    """Mean of the motions about a point that supports leave free, from their combinations ``(6, k)``."""
    ones = np.zeros((operators.owned_dofs, 1))
    ones[0::3] = 1.0
    weights = operators.apply_mass(ones)[0::3, 0]
    mass = sum_over_ranks(operators.comm, weights.sum(keepdims=True))
    center = sum_over_ranks(operators.comm, weights @ operators.points) / mass
    units, count = scale_motions(operators)[1][:, None], free.shape[1]
    orthogonal = np.linalg.qr(rigid_transfer(middle, center) @ free / units, mode="complete")[0]
    motions = rigid_map(operators.points, center) @ (units * orthogonal[:, :count])
    rigid = np.where(supported[:, None], 0.0, motions)
    weighted = operators.apply_mass(rigid)
    gram = sum_over_ranks(operators.comm, rigid.T @ weighted)
    values, rest = (orthogonal / units).T[:count], (orthogonal / units)[:, count:]
    return BodyMean(center, rigid, weighted @ np.linalg.inv(gram), values, np.linalg.qr(rest)[0].T)


def local_dofs(operators: ElasticOperators) -> IntArray:
    """Mesh dofs ``(3 n_owned,)`` behind the rows this rank owns."""
    return np.asarray((3 * operators.nodes[:, None] + np.arange(3)).ravel())


def _scatter(operator: FloatArray, nodes: IntArray, local_of: dict[int, int], owned: int) -> FloatArray:
    result = np.zeros((owned, operator.shape[1]))
    for position, point in enumerate(nodes):
        row = local_of.get(int(point))
        if row is not None:
            result[3 * row : 3 * row + 3] = operator[3 * position : 3 * position + 3]
    return result
