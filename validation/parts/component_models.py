"""Components meshed and reduced the way a scene does it, and unreduced models of them: distributed,
and as plain sparse matrices.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.geometry.parts.components import (
    DEFAULT_EIGENSOLVER,
    Component,
    Eigensolver,
    Load,
    Material,
    SolverMethod,
    Support,
)
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.elastic.constrained_modes import lowest_modes
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver, rigid_node_motions
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import share_from_root, sum_over_ranks
from headstock.validation.parts.sparse_eigenpairs import lowest_symmetric_pairs, solve_symmetric

_BLOCK = 6
_FREE = 1e-9
_SHIFT = -1e6  # of omega^2, below the rigid-body modes
Compliance = dict[tuple[str, str], FloatArray]


@dataclass(frozen=True, eq=False)
class FullModel:
    """Operators of a component and what holds it.

    Attributes:
        operators: Stiffness and mass, distributed.
        fixed: ``(n_points, 3)`` mesh dofs that do not move.
        means: ``(n_points, 3, n_c)`` weighted means of the displacement that vanish.
    """

    mesh: ComponentMesh
    operators: ElasticOperators
    fixed: BoolArray
    means: FloatArray

    def owned(self, field: FloatArray) -> FloatArray:
        """Return the rows that this rank owns ``(3 n_owned, k)`` of a field on all mesh points
        ``(n_points, 3, k)``.
        """
        return np.asarray(
            field[self.operators.nodes].reshape(self.operators.owned_dofs, -1), dtype=float
        )

    @property
    def owned_fixed(self) -> BoolArray:
        """The fixed dofs among this rank's ``(3 n_owned,)``."""
        return self.fixed[self.operators.nodes].ravel()

    def everywhere(self, vectors: FloatArray) -> FloatArray:
        """Return the field on all mesh points ``(n_points, 3, k)`` of rows ``(3 n_owned, k)``."""
        field = np.zeros((len(self.mesh.points), 3, vectors.shape[1]))
        field[self.operators.nodes] = vectors.reshape(-1, 3, vectors.shape[1])
        return sum_over_ranks(self.operators.comm, field)


@dataclass(frozen=True, eq=False)
class FullModes:
    """Natural frequencies [Hz] ``(m,)``, mass-normalised shapes on own rows ``(3 n_owned, m)``."""

    frequencies_hz: FloatArray
    shapes: FloatArray


def full_model(
    mesh: ComponentMesh,
    material: Material,
    *,
    comm: MPI.Comm,
    fixed: BoolArray | None = None,
    means: FloatArray | None = None,
    with_corners: bool = False,
) -> FullModel:
    """Assemble stiffness and mass of a component; without supports by default.

    Args:
        mesh: The same on every rank.
        fixed: ``(n_points, 3)`` dofs that do not move.
        means: ``(n_points, 3, n_c)`` means that vanish.
        with_corners: Assemble what iteration needs, too.
    """
    shape = (len(mesh.points), 3)
    operators = assemble_elasticity(
        mesh, material, comm=comm, with_mass=True, with_corners=with_corners
    )
    no_dofs, no_means = np.zeros(shape, dtype=bool), np.zeros((*shape, 0))
    return FullModel(
        mesh, operators, no_dofs if fixed is None else fixed, no_means if means is None else means
    )


def fixed_by(mesh: ComponentMesh, supports: Sequence[Support]) -> BoolArray:
    """Dofs ``(n_points, 3)`` that supports hold, from the patch groups of a mesh."""
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    for support in supports:
        nodes = np.unique(mesh.patches[f"support:{support.name}"])
        for direction in support.directions:
            if not isinstance(direction, str):
                raise TypeError("these models are fixed along the axes only")
            fixed[nodes, "xyz".index(direction)] = True
    return fixed


def full_modes(
    model: FullModel,
    count: int,
    *,
    eigensolver: Eigensolver = DEFAULT_EIGENSOLVER,
    method: SolverMethod = "direct",
) -> FullModes:
    """Return the lowest elastic modes of a component: those that are mass-orthogonal to the rigid
    motions that nothing holds.

    Args:
        model: Operators and what holds it.
        count: How many at least; a cluster at the end is completed.
        method: By factors, or by LOBPCG on a multigrid.

    Raises:
        ConvergenceError: The eigensolver did not finish.

    Source: Geradin and Rixen (2015), section 2.6, elimination of the rigid-body modes.
    """
    operators = model.operators
    free = free_motions(model)
    constraints = np.hstack(
        [model.owned(model.means), operators.apply_mass(free) if free.shape[1] else free]
    )
    # the same start on any number of ranks
    start = model.owned(np.random.default_rng(0).standard_normal((*model.fixed.shape, _BLOCK)))
    with ConstrainedSolver(operators, model.owned_fixed, constraints, method=method) as solver:
        dimension = solver.free_total - constraints.shape[1]
        target = ModeTarget(count=min(count, dimension))
        pairs = lowest_modes(solver, start, target, eigensolver=eigensolver)
    return FullModes(np.sqrt(pairs.values) / (2.0 * np.pi), pairs.vectors)


def free_motions(model: FullModel) -> FloatArray:
    """Return the rigid motions that neither fixed dofs nor means prevent, on this rank's rows ``(3
    n_owned, m)``.
    """
    motions = rigid_node_motions(model.operators)
    fixed, means = model.owned_fixed, model.owned(model.means)
    blocked = sum_over_ranks(model.operators.comm, motions[fixed].T @ motions[fixed])
    means_of_motions = sum_over_ranks(model.operators.comm, means.T @ motions)
    sizes = np.linalg.norm(means_of_motions, axis=1, keepdims=True)
    rows = means_of_motions / np.where(sizes > 0.0, sizes, 1.0)
    values, vectors = np.linalg.eigh(blocked + rows.T @ rows)
    return motions @ vectors[:, values < _FREE * max(values[-1], 1.0)]


def rigid_frequencies(model: FullModel) -> FloatArray:
    """Rayleigh quotients of the six rigid motions as frequencies [Hz] ``(6,)``: what rounding makes
    of zero.
    """
    motions = rigid_node_motions(model.operators)
    comm = model.operators.comm
    stiffness = sum_over_ranks(comm, motions.T @ model.operators.apply_stiffness(motions))
    mass = sum_over_ranks(comm, motions.T @ model.operators.apply_mass(motions))
    factor = np.linalg.cholesky(mass)
    values = np.linalg.eigvalsh(np.linalg.solve(factor, np.linalg.solve(factor, stiffness).T))
    return np.sqrt(np.abs(values)) / (2.0 * np.pi)


def full_displacement(model: FullModel, loads: FloatArray) -> FloatArray:
    """Static displacement on all mesh points ``(n_points, 3)`` under nodal loads ``(n_points, 3)``
    [N].

    Raises:
        ConvergenceError: The solve keeps a residual.
        ModelError: A rigid motion is free.
    """
    with ConstrainedSolver(model.operators, model.owned_fixed, model.owned(model.means)) as solver:
        return model.everywhere(solver.solve(model.owned(loads)))[:, :, 0]


def shared_mesh(
    component: Component,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    comm: MPI.Comm,
) -> ComponentMesh:
    """Share the mesh of a component, made by rank 0, with every rank.

    Args:
        comm: Ranks that get the mesh; collective.

    Raises:
        HeadstockError: Meshing failed; raised on every rank.
    """
    made: tuple[ComponentMesh | None, HeadstockError | None] = (None, None)
    if comm.rank == 0:
        try:
            made = (mesh_component(component, supports, loads), None)
        except HeadstockError as error:
            made = (None, error)
    mesh, failure = share_from_root(comm, made)
    if mesh is None:
        raise failure or HeadstockError(f"component {component.name!r} has no mesh")
    return mesh


def interface_compliance(
    component: Component, mesh: ComponentMesh, supports: Sequence[Support], *, comm: MPI.Comm
) -> Compliance:
    """Compliances of the interfaces of a supported component by its static superelement.

    Args:
        supports: That leave no rigid motion free.

    Returns:
        For each pair of interface names the motion ``(6, 6)`` of the first under unit forces and
        moments on the second.
    """
    element = reduce_elastic(
        component, mesh, supports, comm=comm, request=ReductionRequest(recovery=False)
    )
    whole: FloatArray = np.asarray(np.linalg.inv(element.stiffness), dtype=float)
    rows = {
        name: slice(6 * place.node, 6 * place.node + 6)
        for name, place in element.interface_maps.items()
    }
    return {(moved, loaded): whole[rows[moved], rows[loaded]] for moved in rows for loaded in rows}


@dataclass(frozen=True, eq=False)
class ConstrainedMatrices:
    """Stiffness and mass of a component whose interface dofs stand first, six for each, before the
    free mesh dofs.

    Attributes:
        stiffness: ``(n, n)`` sparse.
        mass: ``(n, n)`` sparse.
        boundary: Number of interface dofs.
    """

    stiffness: scipy.sparse.csc_matrix
    mass: scipy.sparse.csc_matrix
    boundary: int


def rigid_face_matrices(
    mesh: ComponentMesh, material: Material, centers: Mapping[str, FloatArray]
) -> ConstrainedMatrices:
    """Matrices of a component whose named patches move as rigid bodies about given points.

    Args:
        centers: ``(3,)`` reference point [m] of each patch, in the order of its dofs.
    """
    stiffness, mass = _whole_matrices(mesh, material)
    free = np.ones(3 * len(mesh.points), dtype=bool)
    columns = []
    for name, center in centers.items():
        nodes = np.unique(mesh.patches[name])
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        free[dofs] = False
        block = scipy.sparse.lil_matrix((len(free), 6))
        block[dofs] = rigid_map(mesh.points[nodes], center)
        columns.append(block)
    interior = scipy.sparse.identity(len(free), format="csc")[:, np.flatnonzero(free)]
    transform = scipy.sparse.hstack([*columns, interior], format="csc")
    return ConstrainedMatrices(
        (transform.T @ stiffness @ transform).tocsc(),
        (transform.T @ mass @ transform).tocsc(),
        6 * len(centers),
    )


def all_frequencies(matrices: ConstrainedMatrices) -> FloatArray:
    """Return every natural frequency [Hz] by dense algebra; rigid motions come out as what rounding
    makes of zero.
    """
    values = scipy.linalg.eigh(
        matrices.stiffness.toarray(), matrices.mass.toarray(), eigvals_only=True
    )
    return np.sqrt(np.abs(values)) / (2.0 * np.pi)


def lowest_frequencies(matrices: ConstrainedMatrices, count: int) -> FloatArray:
    """Return the lowest natural frequencies [Hz] ``(count,)``, rigid ones too, by shift-invert."""
    eigenvalues, _ = lowest_symmetric_pairs(matrices.stiffness, matrices.mass, count, shift=_SHIFT)
    return np.sqrt(np.abs(eigenvalues)) / (2.0 * np.pi)


def guyan_matrices(matrices: ConstrainedMatrices) -> tuple[FloatArray, FloatArray]:
    """Stiffness and mass ``(n_b, n_b)`` condensed statically to the interface dofs.

    Source: Guyan (1965).
    """
    count = matrices.boundary
    inner = matrices.stiffness[count:, count:]
    coupling = matrices.stiffness[count:, :count].toarray()
    shapes = np.vstack([np.eye(count), -solve_symmetric(inner, coupling)])
    return shapes.T @ (matrices.stiffness @ shapes), shapes.T @ (matrices.mass @ shapes)


def fixed_compliance(matrices: ConstrainedMatrices) -> FloatArray:
    """Compliance ``(6, 6)`` of the last interface of two with the first one fixed, by one sparse
    solve of the whole model.
    """
    loads = np.zeros((matrices.stiffness.shape[0] - 6, 6))
    loads[:6] = np.eye(6)
    return solve_symmetric(matrices.stiffness[6:, 6:], loads)[:6]


def _whole_matrices(
    mesh: ComponentMesh, material: Material
) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
    """Stiffness and mass in mesh point order; every rank makes its own."""
    operators = assemble_elasticity(mesh, material, comm=MPI.COMM_SELF, with_mass=True)
    place = np.argsort((3 * operators.nodes[:, None] + np.arange(3)).ravel())
    stiffness = scipy.sparse.csr_matrix(operators.stiffness)[place][:, place]
    mass = scipy.sparse.csr_matrix(scipy.sparse.kron(operators.scalar_mass, np.eye(3)))[place][
        :, place
    ]
    return stiffness, mass
