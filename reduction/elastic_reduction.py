"""A meshed elastic component to a Craig-Bampton superelement with one factorisation."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from headstock.geometry.components import Component, Load, Support
from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.materials import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.boundary_basis import BoundaryBasis, boundary_labels, build_boundary_basis
from headstock.reduction.component_loads import assemble_loads
from headstock.reduction.fixed_interface_modes import FixedInterfaceModes, find_fixed_interface_modes, verify_mode_count
from headstock.reduction.locking_elements import judge_element_order
from headstock.reduction.mean_constraints import DEPENDENCE_TOLERANCE, MeanConstraints, local_dofs
from headstock.reduction.rails import STATION_DOFS, Rail
from headstock.reduction.rigid_stiffness import without_rigid_stiffness
from headstock.reduction.superelement import Attachment, StaticLoad, Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.reduction.truncation_moments import measure_truncation
from headstock.solvers.block_lanczos import ModeTarget
from headstock.solvers.constrained_solver import ConstrainedSolver
from headstock.solvers.discretisation_error import estimate_missing_energy
from headstock.solvers.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.errors import ModelError
from headstock.solvers.rank_sums import sum_over_ranks

BODY_NODE = "body"
# modes above this share of the cut-off take part in no answer that goes without a warning; what their errors add is below 4 %
ESTIMATED_SHARE = 2.0 / 3.0


@dataclass(frozen=True)
class ReductionRequest:
    """What a reduction has to deliver.

    Attributes:
        modes: Fixed-interface modes to keep; None for a static reduction without mass.
        gravity: Keep the response to unit gravity along each component axis.
        recovery: Keep the recovery basis on rank 0.
        errors: Estimate the discretisation error on rank 0; needs the recovery basis.
    """

    modes: ModeTarget | None = None
    gravity: bool = False
    recovery: bool = True
    errors: bool = True


def reduce_elastic(
    component: Component,
    mesh: ComponentMesh,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    comm: MPI.Comm,
    request: ReductionRequest | None = None,
) -> Superelement:
    """Craig-Bampton superelement of a component.

    Args:
        component: Description; its material's density is scaled when the component states its mass.
        mesh: Its mesh, the same on every rank.
        supports: Pointwise supports of this component.
        loads: Static loads on this component.
        comm: Communicator; collective.
        request: What to deliver; by default the component's own reduction settings with mass.

    Returns:
        The superelement, equal on every rank but for the recovery basis, which rank 0 alone holds.

    Raises:
        ModelError: An interface is degenerate, a rigid motion is left free, or first-order elements would lock grossly.
        ConvergenceError: A factorisation, solve or mode search failed.
        AccuracyError: The operators fail their checks.

    Source: Craig and Bampton (1968); mean interfaces by Lagrange multipliers as in Kaufmann et al. (2019).
    """
    request = request or ReductionRequest(modes=mode_target(component))
    with_mass = request.modes is not None or request.gravity or any(load.kind == "body" for load in loads)
    operators = assemble_elasticity(
        mesh, scaled_material(component, mesh), comm=comm, with_mass=with_mass or _is_loose(component, supports)
    )
    return reduce_operators(component, mesh, operators, supports, loads, request=request)


def reduce_operators(
    component: Component,
    mesh: ComponentMesh,
    operators: ElasticOperators,
    supports: Sequence[Support],
    loads: Sequence[Load],
    *,
    request: ReductionRequest,
) -> Superelement:
    """The same from operators that are already assembled."""
    remarks = judge_element_order(component, mesh)
    basis = build_boundary_basis(component, mesh, supports)
    local = local_dofs(operators)
    means = MeanConstraints(basis, operators, loose=not basis.nodes and not basis.rails and not basis.held.any())
    held = basis.held[local]
    with ConstrainedSolver(operators, held, means.columns) as solver:
        psi = _constraint_modes(basis, means, solver, local)
        modes = find_fixed_interface_modes(solver, request.modes)
        if component.reduction.verify and request.modes is not None:
            verify_mode_count(solver, modes)
        result = _project(component, basis, operators, solver, psi, modes, means)
        vectors = assemble_loads(component, mesh, operators, loads, gravity=request.gravity)
        reduced = {name: _reduce_load(vector, solver, psi, modes, result) for name, vector in vectors.items()}
        truncation = measure_truncation(solver, psi, modes) if request.modes is not None else None
        residual = max(solver.largest_residual, modes.residual)
    gathered = _gather_recovery(operators, mesh, np.hstack([psi, modes.shapes])) if request.recovery else None
    return dataclasses.replace(
        result,
        stiffness=without_rigid_stiffness(result, mesh.points, basis.supported, scale=operators.stiffness_scale),
        recovery=gathered,
        missing_energy=_missing_energy(component, mesh, result, gathered) if request.errors and gathered is not None else None,
        recovery_points=mesh.points,
        residual=residual,
        truncation=truncation,
        warnings=remarks + result.warnings,
        loads={name: StaticLoad(vector, _gather_recovery(operators, mesh, u[:, None])) for name, (vector, u) in reduced.items()},
    )


def _missing_energy(component: Component, mesh: ComponentMesh, element: Superelement, recovery: FloatArray) -> FloatArray:
    """Energy products ``(n, n)`` of the discretisation errors of the reduced dofs, on rank 0 alone."""
    reach = ESTIMATED_SHARE * element.cutoff_hz
    wanted = np.concatenate([np.ones(element.boundary_size, dtype=bool), element.modal_frequencies_hz <= reach])
    result = np.zeros(element.stiffness.shape)
    result[np.ix_(wanted, wanted)] = estimate_missing_energy(mesh, component.material, recovery[:, wanted])
    if element.supported:
        return result
    # rigid motions miss no energy: what rounding leaves of it would look large beside that of a soft mount
    rigid = np.linalg.qr(rigid_motions(element, element.center_of_mass))[0]
    strained = np.eye(len(result)) - rigid @ rigid.T
    return np.asarray(strained @ result @ strained)


def mode_target(component: Component) -> ModeTarget:
    """Mode target of a component's own reduction settings.

    Raises:
        ModelError: The component leaves the choice open.
    """
    settings = component.reduction
    if settings.modes is not None:
        return ModeTarget(count=settings.modes)
    if settings.modes_to_hz is not None:
        return ModeTarget(up_to_hz=settings.modes_to_hz)
    raise ModelError(
        f"component {component.name}: no number of fixed-interface modes was chosen; set reduction.modes or reduction.modes_to"
    )


def scaled_material(component: Component, mesh: ComponentMesh) -> Material:
    """The component's material, its density scaled so that a stated mass comes out."""
    if component.mass is None:
        return component.material
    return dataclasses.replace(component.material, density=component.mass / mesh.quality.volume)


def _constraint_modes(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver, local: IntArray) -> FloatArray:
    """``(3 n_owned, n_b)`` static shapes for unit boundary dofs, fixed-interface loads free."""
    prescribed = _prescribed_displacement(basis, means, local)
    forces = -solver.operators.apply_stiffness(prescribed)
    targets = means.range.T @ (means.select - solver.product(means.full, prescribed))
    return prescribed + solver.solve(forces, targets)


def _prescribed_displacement(basis: BoundaryBasis, means: MeanConstraints, local: IntArray) -> FloatArray:
    """``(3 n_owned, n_b)`` displacement of the points in rigid patches for unit boundary dofs; all others rest."""
    prescribed = np.zeros((len(local), means.boundary_size))
    where = np.full(len(basis.held), -1, dtype=np.int64)
    where[local] = np.arange(len(local))
    for dofs, values, number in basis.shapes:
        mine = where[dofs] >= 0
        prescribed[where[dofs[mine]], 6 * number : 6 * number + 6] = values[mine]
    return prescribed


def _project(
    component: Component,
    basis: BoundaryBasis,
    operators: ElasticOperators,
    solver: ConstrainedSolver,
    psi: FloatArray,
    modes: FixedInterfaceModes,
    means: MeanConstraints,
) -> Superelement:
    boundary, count = psi.shape[1], modes.shapes.shape[1]
    size = boundary + count
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    stiffness[:boundary, :boundary] = _symmetric(solver.product(psi, operators.apply_stiffness(psi)))
    stiffness[boundary:, boundary:] = np.diag(modes.eigenvalues)
    properties: tuple[float, FloatArray, FloatArray] = (0.0, np.zeros(3), np.zeros((3, 3)))
    if operators.scalar_mass is not None:
        weighted = operators.apply_mass(psi)
        mass[:boundary, :boundary] = _symmetric(solver.product(psi, weighted))
        mass[:boundary, boundary:] = solver.product(weighted, modes.shapes)
        mass[boundary:, :boundary] = mass[:boundary, boundary:].T
        mass[boundary:, boundary:] = np.eye(count)
        properties = _mass_properties(operators)
    labels = boundary_labels(basis) or [(BODY_NODE, dof) for dof in ("x", "y", "z", "rx", "ry", "rz")[:boundary]]
    labels += [("mode", str(number + 1)) for number in range(count)]
    constraints = np.vstack([_embed(basis.constraints, size), _embed(_dependent_rows(basis, means, solver), size)])
    return Superelement(
        name=component.name,
        labels=tuple(labels),
        frames=means.node_frames,
        attachments=basis.attachments if means.loose_frame is None else {BODY_NODE: Attachment(0, means.loose_frame)},
        stiffness=stiffness,
        mass=mass,
        damping=None,
        recovery=None,
        recovery_points=None,
        constraints=constraints,
        modal_frequencies_hz=np.sqrt(modes.eigenvalues) / (2.0 * np.pi),
        cutoff_hz=modes.cutoff_hz,
        full_dofs=3 * operators.total_nodes,
        mass_kg=properties[0],
        center_of_mass=properties[1],
        inertia=properties[2],
        supported=bool(basis.supported.any()),
        warnings=basis.warnings,
        stations=basis.stations,
        rails=_free_rails(basis, size),
    )


def _free_rails(basis: BoundaryBasis, size: int) -> dict[str, Rail]:
    """Rails whose control values are dofs of their own."""
    rails, first = {}, 6 * len(basis.nodes)
    for fit in basis.rails:
        count = STATION_DOFS * len(fit.points)
        low, high = float(fit.knots[0]), float(fit.knots[-1])
        blur = float(np.diff(fit.knots).max())
        rails[fit.name] = Rail(fit.axis, fit.center, low, high, fit.knots, np.eye(count, size, first), blur)
        first += count
    return rails


def _dependent_rows(basis: BoundaryBasis, means: MeanConstraints, solver: ConstrainedSolver) -> FloatArray:
    """Rows of boundary dofs that vanish because some means depend on each other or on rigid patches alone."""
    if not means.dependent.shape[1] or not (basis.nodes or basis.rails):
        return np.zeros((0, means.boundary_size))
    prescribed = _prescribed_displacement(basis, means, local_dofs(solver.operators))
    rows = means.dependent.T @ (means.select - solver.product(means.full, prescribed))
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray((rows / np.where(sizes > 0.0, sizes, 1.0))[sizes[:, 0] > DEPENDENCE_TOLERANCE])


def _reduce_load(
    vector: FloatArray, solver: ConstrainedSolver, psi: FloatArray, modes: FixedInterfaceModes, element: Superelement
) -> tuple[FloatArray, FloatArray]:
    column = vector[:, None]
    modal = solver.product(modes.shapes, column)
    reduced = np.vstack([solver.product(psi, column), modal])[:, 0]
    # the modes take their share of the load in the reduced model, so the particular response must not hold it again
    particular = solver.solve(column) - modes.shapes @ (modal / modes.eigenvalues[:, None])
    return reduced, particular[:, 0]


def _mass_properties(operators: ElasticOperators) -> tuple[float, FloatArray, FloatArray]:
    # about the mean point: far from the origin the inertia would cancel
    middle = sum_over_ranks(operators.comm, operators.points.sum(axis=0)) / operators.total_nodes
    rigid = rigid_map(operators.points, middle)
    gram = sum_over_ranks(operators.comm, rigid.T @ operators.apply_mass(rigid))
    mass = float(np.trace(gram[:3, :3]) / 3.0)
    static = gram[:3, 3:]
    arm = np.array([static[1, 2] - static[2, 1], static[2, 0] - static[0, 2], static[0, 1] - static[1, 0]]) / (2.0 * mass)
    inertia = gram[3:, 3:] - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, middle + arm, _symmetric(inertia)


def _gather_recovery(operators: ElasticOperators, mesh: ComponentMesh, vectors: FloatArray) -> FloatArray | None:
    """Vectors of all ranks in mesh point order, on rank 0."""
    parts = operators.comm.gather((operators.nodes, vectors), root=0)
    if parts is None:
        return None
    result = np.zeros((len(mesh.points), 3, vectors.shape[1]))
    for nodes, rows in parts:
        result[nodes] = rows.reshape(len(nodes), 3, vectors.shape[1])
    return result.reshape(3 * len(mesh.points), vectors.shape[1])


def _embed(rows: FloatArray, size: int) -> FloatArray:
    result = np.zeros((len(rows), size))
    result[:, : rows.shape[1]] = rows
    return result


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + matrix.T))


def _is_loose(component: Component, supports: Sequence[Support]) -> bool:
    return not component.interfaces and not supports
