"""Averaging interfaces as weighted means of the displacement, and the mean motion of a body that nothing holds."""

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.meshing.component_mesh import IntArray
from headstock.reduction.boundary_basis import BoundaryBasis
from headstock.reduction.rails import STATION_DOFS
from headstock.solvers.elasticity import ElasticOperators
from headstock.solvers.rank_sums import sum_over_ranks

DEPENDENCE_TOLERANCE = 1e-10


class MeanConstraints:
    """Columns C of the prescribed means, their dependent combinations taken out.

    ``targets`` maps boundary dofs to the values of ``C^T u``; ``dependent`` holds rows of boundary dofs that must vanish.
    """

    def __init__(self, basis: BoundaryBasis, operators: ElasticOperators, *, loose: bool) -> None:
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
        if loose:
            # a body that nothing holds: its mass-weighted mean motion is the boundary node, so psi is rigid and phi free-free
            center, operator = _mass_mean(operators)
            columns, selectors, count = [operator], [np.eye(6)], 6
            self.loose_frame = Frame(center)
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


def _mass_mean(operators: ElasticOperators) -> tuple[FloatArray, FloatArray]:
    ones = np.zeros((operators.owned_dofs, 1))
    ones[0::3] = 1.0
    weights = operators.apply_mass(ones)[0::3, 0]
    mass = sum_over_ranks(operators.comm, weights.sum(keepdims=True))
    center = sum_over_ranks(operators.comm, weights @ operators.points) / mass
    rigid = rigid_map(operators.points, center)
    weighted = operators.apply_mass(rigid)
    gram = sum_over_ranks(operators.comm, rigid.T @ weighted)
    return center, weighted @ np.linalg.inv(gram)


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
