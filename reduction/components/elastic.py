"""A meshed elastic component to a Craig-Bampton superelement with one factorisation."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Probe, Sensor
from headstock.geometry.parts.components import (
    EDGE_GROUP,
    SUPPORT_GROUP,
    Component,
    Load,
    Material,
    SolverMethod,
    Support,
)
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.elements.surface import (
    MeshSurface,
    corner_normals,
    extract_surface,
    match_facets,
)
from headstock.reduction.components.boundary_basis import build_boundary_basis
from headstock.reduction.components.constraint_modes import (
    MeanConstraints,
    find_constraint_modes,
    find_dofs,
)
from headstock.reduction.components.elastic_checks import (
    remark_on_element_order,
    without_rigid_stiffness,
)
from headstock.reduction.components.fixed_interface_modes import (
    FixedInterfaceModes,
    add_attachment_modes,
    find_fixed_interface_modes,
    measure_truncation,
    verify_mode_count,
)
from headstock.reduction.components.nodal_loads import assemble_loads, make_of_mesh, scatter_rows
from headstock.reduction.components.probes import (
    SEEN,
    ProbePlace,
    find_probe_places,
    gather_probes,
    read_smoothing,
    watch_dofs,
)
from headstock.reduction.components.sensor_places import load_sensors
from headstock.reduction.components.solver_choice import choose_method, predict_factor_entries
from headstock.reduction.components.subspace import ReductionSpace, project_component
from headstock.reduction.requests import ReductionRequest, mode_target, needs_mass
from headstock.reduction.superelement import ErrorEstimates, Recovery, StaticLoad, Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.elastic.split_estimates import estimate_split_errors
from headstock.solvers.errors import AccuracyError, ConvergenceError, ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import RowBlocks, SharedFailure, order_rows
from headstock.solvers.recovery.discretisation_error import (
    detects_errors,
    estimate_cell_errors,
    locate_truth,
    mesh_safety,
)
from headstock.solvers.recovery.free_sides import find_free_sides

# Recovered stresses follow a singularity no better than those of the elements: over blocks, sheets,
# plates and tubes cells at rigid faces showed 0.35 to 0.4 of the energy that they missed, those at
# the rims of rigid pads within a face 0.5 to 0.8. At the rims of averaging patches tractions end
# abruptly, which smoothed stresses hide: cells there showed half as much as others do
RIM_WEIGHT, PAD_RIM_WEIGHT, AVERAGING_RIM_WEIGHT = 2.5, 1.8, 2.0
FLAT = 0.87  # cosine between normals on both sides of a rim where the surface goes on
ROW_OF_ELEMENTS = "its mesh is a row of single elements, whose errors cannot be estimated; write a smaller mesh size"
ELASTIC_ERRORS = (ModelError, ConvergenceError, AccuracyError)


def reduce_elastic(
    component: Component,
    mesh: ComponentMesh | None,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    comm: MPI.Comm,
    request: ReductionRequest | None = None,
    probes: Sequence[Probe] = (),
    sensors: Sequence[Sensor] = (),
) -> Superelement:
    """Return the Craig-Bampton superelement of a component.

    Args:
        component: Description; its material's density is scaled when the component states its mass.
        mesh: Its mesh on rank 0; what other ranks hand in is not looked at.
        request: What to deliver; by default the component's own reduction settings with mass.
        probes: Places where displacement and stress are wanted; those in other components are left
            out.
        sensors: On this component; static responses to forces at the loaded ones are kept.

    Returns:
        The superelement, equal on every rank but for the recovery basis, which rank 0 alone holds.

    Raises:
        ModelError: An interface is degenerate, a rigid motion is left free, first-order elements
            would lock grossly, or a probe lies outside.
        ConvergenceError: A factorisation, solve or mode search failed.
        AccuracyError: The operators fail their checks.
        SharedFailure: On several ranks, all of which know it; its cause is one of these.

    Source: Craig and Bampton (1968); mean interfaces by Lagrange multipliers as in Kaufmann et al.
    (2019).
    """
    request = request or ReductionRequest(modes=mode_target(component))
    with_mass = needs_mass(component, loads, request)
    mesh = mesh if comm.rank == 0 else None
    try:
        material = make_of_mesh(comm, mesh, functools.partial(scaled_material, component))
        method = make_of_mesh(comm, mesh, functools.partial(_method, component))
        operators = assemble_elasticity(
            mesh, material, comm=comm, with_mass=with_mass, with_corners=method == "iterative"
        )
        return _reduce_operators(
            component,
            mesh,
            operators,
            supports,
            loads,
            request=request,
            probes=probes,
            sensors=[sensor for sensor in sensors if sensor.is_loaded],
        )
    except SharedFailure as failure:
        if isinstance(failure.__cause__, ELASTIC_ERRORS):
            raise SharedFailure from _name_component(component, failure.__cause__)
        raise
    except ELASTIC_ERRORS as error:
        named = _name_component(component, error)
        # what a model lacks shows in sums over all ranks, and all of them find it
        if comm.size > 1 and isinstance(error, ModelError):
            raise SharedFailure from named
        raise named from error.__cause__


def _name_component(component: Component, error: Exception) -> Exception:
    if component.name in str(error):
        return error
    named = type(error)(f"component {component.name}: {error}")
    named.__cause__ = error
    return named


def _method(component: Component, mesh: ComponentMesh) -> SolverMethod:
    """Return the method as planned; what nobody planned goes by the factors that its mesh would
    have.
    """
    entries = predict_factor_entries(3 * len(mesh.points), np.ptp(mesh.points, axis=0).tolist())
    return choose_method(component.reduction, entries).method


def _reduce_operators(
    component: Component,
    mesh: ComponentMesh | None,
    operators: ElasticOperators,
    supports: Sequence[Support],
    loads: Sequence[Load],
    *,
    request: ReductionRequest,
    probes: Sequence[Probe] = (),
    sensors: Sequence[Sensor] = (),
) -> Superelement:
    """Return the superelement of a meshed elastic component, see ``reduce_elastic``, from operators
    that are already assembled.

    Args:
        component: Geometry, material, interfaces and reduction settings.
        mesh: Its mesh on rank 0.
        operators: Stiffness, and mass where the request needs it, of this mesh.
        loads: Static loads; those on other components are left out.
        request: How many modes, and whether gravity, recovery and error estimates.
        probes: Those on other components are left out.
        sensors: Those on this component at which forces act.

    Raises:
        ModelError, ConvergenceError, AccuracyError: As ``reduce_elastic``.
    """
    comm = operators.comm
    remarks = make_of_mesh(comm, mesh, functools.partial(remark_on_element_order, component))
    basis = make_of_mesh(comm, mesh, lambda whole: build_boundary_basis(component, whole, supports))
    means = MeanConstraints(basis, operators)
    component_probes = [probe for probe in probes if probe.component == component.name]
    places = make_of_mesh(
        comm, mesh, lambda whole: find_probe_places(component, whole, supports, component_probes)
    )
    method: SolverMethod = "direct" if operators.corners is None else "iterative"
    fixed = find_dofs(operators, basis.fixed)
    with ConstrainedSolver(operators, fixed, means.columns, method=method) as solver:
        psi = find_constraint_modes(basis, means, solver)
        modes = _find_modes(component, mesh, operators, solver, request, sensors)
        result = project_component(component, solver, ReductionSpace(basis, means, psi, modes))
        vectors = assemble_loads(component, mesh, operators, loads, gravity=request.gravity)
        reduced, particular = _reduce_loads(vectors, solver, psi, modes)
        watched = watch_dofs(solver, places, (psi, modes.shapes), modes.eigenvalues, particular)
        truncation = measure_truncation(solver, psi, modes) if request.modes is not None else None
        residual = max(solver.largest_residual, modes.residual)
    recovered = _Recovered()
    if request.recovery:
        fields = _order_fields(operators, np.hstack([psi, modes.shapes, particular, watched.moved]))
        recovered = _recover_fields(
            component, mesh, operators, result, fields, places, estimated=request.errors
        )
    size, missing = len(result.stiffness), recovered.missing
    of_loads, of_probes = (None, None) if missing is None else np.split(missing, [len(vectors)])
    return dataclasses.replace(
        result,
        stiffness=make_of_mesh(
            comm,
            mesh,
            lambda whole: without_rigid_stiffness(
                result, whole.points, basis.held, scale=operators.stiffness_scale
            ),
        ),
        recovery=recovered.recovery,
        residual=residual,
        errors=dataclasses.replace(recovered.errors, truncation=truncation),
        warnings=remarks + result.warnings + recovered.warnings,
        loads={
            name: StaticLoad(
                reduced[:, column],
                _gather_field(_order_fields(operators, particular[:, [column]])),
                None if of_loads is None else of_loads[column, :size],
            )
            for column, name in enumerate(vectors)
        },
        probes=gather_probes(
            places,
            watched,
            list(vectors),
            recovered.smoothing,
            None if of_probes is None else of_probes[:, : size + len(vectors)],
        ),
    )


def _find_modes(
    component: Component,
    mesh: ComponentMesh | None,
    operators: ElasticOperators,
    solver: ConstrainedSolver,
    request: ReductionRequest,
    sensors: Sequence[Sensor],
) -> FixedInterfaceModes:
    """Return the fixed-interface modes, and residual-attachment modes of the sensors at which forces
    act.
    """
    modes = find_fixed_interface_modes(
        solver, request.modes, eigensolver=component.reduction.eigensolver
    )
    if component.reduction.verify and request.modes is not None:
        verify_mode_count(solver, modes)
    if not sensors:
        return modes
    nodes, forces = make_of_mesh(
        operators.comm, mesh, lambda whole: load_sensors(whole, component.material, sensors)
    )
    attached = scatter_rows(forces, nodes, operators).reshape(-1, forces.shape[2])
    return add_attachment_modes(solver, modes, attached)


@dataclass(frozen=True, eq=False)
class _Recovered:
    """What the displacement fields of a superelement's dofs, loads and probes show.

    Attributes:
        recovery: Motion of the mesh; None on other ranks than 0.
        missing: ``(loads + probes, n + loads + probes)`` energy products of the errors of their fields
            with those of all; None where nobody knows.
        smoothing: By probe, what recovery changes in the stresses of dofs and loads; None where
            nobody knows.
    """

    recovery: Recovery | None = None
    errors: ErrorEstimates = field(default_factory=ErrorEstimates)
    missing: FloatArray | None = None
    smoothing: dict[str, FloatArray] | None = None
    warnings: tuple[str, ...] = ()


def _recover_fields(
    component: Component,
    mesh: ComponentMesh | None,
    operators: ElasticOperators,
    element: Superelement,
    fields: RowBlocks,
    places: Mapping[str, ProbePlace],
    *,
    estimated: bool,
) -> _Recovered:
    """Recover motions of the mesh from displacement fields of dofs, loads and probes.

    Args:
        estimated: Estimate the errors of the mesh.
    """
    comm = operators.comm
    errors, missing, smoothing = ErrorEstimates(), None, None
    warnings: tuple[str, ...] = ()
    shown = estimated and make_of_mesh(comm, mesh, detects_errors)
    if estimated:
        errors, missing = _estimate_errors(
            component, mesh, operators, element, fields if shown else None
        )
        warnings = () if shown else (ROW_OF_ELEMENTS,)
    gathered = _gather_field(fields)
    if shown and places:
        smoothing = make_of_mesh(
            comm,
            mesh,
            lambda whole: _smooth_probes(component, whole, element, places, gathered),
        )
    recovery = None
    if gathered is not None and mesh is not None:
        dofs = len(element.stiffness)
        recovery = Recovery(np.ascontiguousarray(gathered[:, :dofs]), mesh.points)
    return _Recovered(recovery, errors, missing, smoothing, warnings)


def _smooth_probes(
    component: Component,
    mesh: ComponentMesh,
    element: Superelement,
    places: Mapping[str, ProbePlace],
    fields: FloatArray | None,
) -> dict[str, FloatArray]:
    """Return what recovery changes in the stresses that probes see of dofs and loads, on rank 0."""
    if fields is None:
        raise ValueError("rank 0 has no fields")
    probes = SEEN * len(places)
    smoothing = read_smoothing(
        mesh, component.material, places, fields[:, : fields.shape[1] - probes]
    )
    size, strained = len(element.stiffness), _strained_motions(element)
    projector = strained @ strained.T
    return {
        name: np.concatenate([rows[..., :size] @ projector, rows[..., size:]], axis=-1)
        for name, rows in smoothing.items()
    }


def _estimate_errors(
    component: Component,
    mesh: ComponentMesh | None,
    operators: ElasticOperators,
    element: Superelement,
    fields: RowBlocks | None,
) -> tuple[ErrorEstimates, FloatArray | None]:
    """Estimate what its mesh makes of the displacement fields of a superelement's dofs, and energy
    products of the errors of further fields with those of all; zeros stand for what nobody knows,
    where there are no fields.
    """
    if fields is None:
        return ErrorEstimates(missing_energy=np.zeros(element.stiffness.shape)), None

    comm, weights, facts = operators.comm, None, (0.0, (0.0, 0.0), False)
    if mesh is not None:
        surface = extract_surface(mesh.cells, mesh.kind)
        weights, safety = _rim_weights(component, mesh, surface), mesh_safety(mesh, surface)
        exact = mesh.gaps is None and mesh.missing is None
        facts = safety, locate_truth(mesh, safety), exact
    safety, truth, exact = comm.bcast(facts)
    # a mesh misses no energy of rigid motions, and no mass either where it fills the part
    strained, size = _strained_motions(element), len(element.stiffness)
    if exact:
        rows = [fields.rows[..., :size] @ strained, fields.rows[..., size:]]
        fields = dataclasses.replace(fields, rows=np.concatenate(rows, axis=-1))
    else:
        strained = strained @ strained.T
    material = make_of_mesh(comm, mesh, functools.partial(scaled_material, component))
    estimates = estimate_split_errors(mesh, material, operators, fields, weights)
    count = strained.shape[1]
    extra = estimates.missing_energy[count:]
    extra = np.hstack([extra[:, :count] @ strained.T, extra[:, count:]])

    def of_dofs(change: FloatArray) -> FloatArray:
        return strained @ change[:count, :count] @ strained.T

    return ErrorEstimates(
        missing_energy=of_dofs(estimates.missing_energy),
        mesh_safety=safety,
        mesh_truth=truth,
        shape_stiffness=None if estimates.shape is None else of_dofs(estimates.shape.stiffness),
        shape_mass=None if estimates.shape is None else estimates.shape.mass[:size, :size],
        left_out_stiffness=None
        if estimates.left_out is None
        else of_dofs(estimates.left_out.stiffness),
        left_out_mass=None if estimates.left_out is None else estimates.left_out.mass[:size, :size],
    ), extra


def _strained_motions(element: Superelement) -> FloatArray:
    """Return an orthonormal basis ``(n, m)`` of motions of the dofs without rigid ones, which miss
    no energy: what rounding leaves of it would look large compared with that of a soft mount.
    """
    if element.supported:
        return np.eye(len(element.stiffness))
    rigid = rigid_motions(element, element.center_of_mass)
    return np.linalg.qr(rigid, mode="complete")[0][:, rigid.shape[1] :]


def find_cell_errors(
    component: Component, mesh: ComponentMesh, element: Superelement, motions: FloatArray
) -> FloatArray:
    """Find where a mesh misses energy: squared energy norms ``(n_cells, k)`` of the discretisation
    errors in each cell, times the factor that covers 95 % of true errors.

    Args:
        motions: ``(n, k)`` of the superelement's dofs.

    Raises:
        ModelError: The superelement has no recovery basis.
    """
    if element.recovery is None:
        raise ModelError(f"component {component.name}: its superelement was made without recovery")
    surface = extract_surface(mesh.cells, mesh.kind)
    return mesh_safety(mesh, surface) * estimate_cell_errors(
        mesh,
        scaled_material(component, mesh),
        element.recovery.basis @ motions,
        _rim_weights(component, mesh, surface),
        find_free_sides(mesh),
    )


def _rim_weights(component: Component, mesh: ComponentMesh, surface: MeshSurface) -> FloatArray:
    """Return the weights ``(n_cells,)`` of the energies that cells miss.

    More where stresses are singular, at what is fixed like a rigid plate, and where tractions end
    abruptly, at averaging patches' rims. Within a pad, around which the face goes on, they are not.
    """
    weights = np.ones(len(mesh.cells))

    def count_more(nodes: IntArray, weight: float) -> None:
        touched = np.isin(mesh.cells, nodes).any(axis=1)
        weights[touched] = np.maximum(weights[touched], weight)

    for name, facets in mesh.patches.items():
        interface = component.interfaces.get(name)
        if name.endswith(EDGE_GROUP) or (interface is not None and interface.rail is not None):
            continue
        if (edge := mesh.patches.get(f"{name}{EDGE_GROUP}")) is not None:
            count_more(np.intersect1d(facets, edge), RIM_WEIGHT)
        elif name.startswith(SUPPORT_GROUP) or interface is not None:
            flat, bent = _rim_nodes(mesh, surface, facets)
            if interface is not None and interface.coupling != "rigid":
                count_more(np.concatenate([flat, bent]), AVERAGING_RIM_WEIGHT)
            elif len(flat) > len(bent):
                count_more(flat, PAD_RIM_WEIGHT)
                count_more(bent, RIM_WEIGHT)
            else:
                count_more(facets.ravel(), RIM_WEIGHT)
    return weights


def _rim_nodes(
    mesh: ComponentMesh, surface: MeshSurface, facets: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the nodes that a patch shares with facets of the surface outside of it: those beyond
    which the surface goes on flat, and those where it bends.
    """
    within, _ = match_facets(surface, facets)
    outside = np.setdiff1d(np.arange(len(surface.facets)), within)
    rim: IntArray = np.intersect1d(surface.facets[within], surface.facets[outside])
    if len(rim) == 0:
        return rim, rim
    normals = corner_normals(mesh.points, surface)
    sides = []
    for part in (within, outside):
        places = np.searchsorted(rim, nodes := surface.facets[part]).clip(max=len(rim) - 1)
        at_rim = rim[places] == nodes
        summed = np.zeros((len(rim), 3))
        np.add.at(summed, places[at_rim], np.repeat(normals[part], at_rim.sum(axis=1), axis=0))
        sides.append(summed / np.linalg.norm(summed, axis=1, keepdims=True).clip(min=1e-300))
    goes_on = (sides[0] * sides[1]).sum(axis=1) > FLAT
    return rim[goes_on], rim[~goes_on]


def scaled_material(component: Component, mesh: ComponentMesh) -> Material:
    """Return the component's material, its density scaled so that a stated mass comes out."""
    if component.mass is None:
        return component.material
    return dataclasses.replace(component.material, density=component.mass / mesh.quality.volume)


def _reduce_loads(
    vectors: Mapping[str, FloatArray],
    solver: ConstrainedSolver,
    psi: FloatArray,
    modes: FixedInterfaceModes,
) -> tuple[FloatArray, FloatArray]:
    """Return the forces on the reduced dofs ``(n_b + m, k)``, and displacements that remain with
    those at zero ``(3 n_owned, k)``.
    """
    forces = np.column_stack([np.zeros((len(psi), 0)), *vectors.values()])
    modal = solver.product(modes.shapes, forces)
    if not vectors:
        return np.zeros((psi.shape[1] + len(modal), 0)), forces
    # the modes take their share of the load in the reduced model, so the particular response must
    # not hold it again
    particular = solver.solve(forces) - modes.shapes @ (modal / modes.eigenvalues[:, None])
    return np.vstack([solver.product(psi, forces), modal]), particular


def _order_fields(operators: ElasticOperators, vectors: FloatArray) -> RowBlocks:
    """Return the vectors ``(3 n_owned, k)`` of all ranks as ``(n_points, 3, k)``, as meshed."""
    by_node = vectors.reshape(len(operators.nodes), 3, vectors.shape[1])
    return order_rows(operators.comm, operators.nodes, by_node, operators.total_nodes)


def _gather_field(fields: RowBlocks) -> FloatArray | None:
    """Return ``(3 n_points, k)`` on rank 0."""
    gathered = fields.gather()
    return None if gathered is None else gathered.reshape(3 * len(gathered), gathered.shape[2])
