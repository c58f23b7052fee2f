"""The stages that turn one component into a superelement: mesh, reduce, rigid, segment,
polynomials, load.

Of a superelement in the store that holds more than is requested, the requested part is taken.
"""

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from headstock.geometry.parts.components import Component, with_loaded_areas
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import MeshFile, StepFile, SuperelementFile
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.components.skins import mesh_skin, unmeshed_skin
from headstock.meshing.errors import MeshError
from headstock.pipeline.exchange.scene_parts import read_part
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.reductions import choose_solver
from headstock.pipeline.stages.run_state import (
    Outcome,
    ReducedComponent,
    RunState,
    component_loads,
    component_probes,
    component_sensors,
    component_supports,
)
from headstock.pipeline.storage.content_keys import mesh_key, skin_key, superelement_key
from headstock.pipeline.storage.part_files import describe_solid
from headstock.pipeline.storage.store import Store, StoreRead, list_keys, read_entry, write_entry
from headstock.reduction.components.polynomial import reduce_polynomial
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented, segment_skin
from headstock.reduction.estimates.corrected_elements import correct_mesh
from headstock.reduction.requests import (
    ReductionExtent,
    ReductionRequest,
    mode_target,
    needs_mass,
    trim_superelement,
)
from headstock.reduction.scaled_material import scale_material
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.scene.scene import Scene
from headstock.solvers.ranks import make_on_root

STATIC = "static"
SEPARATOR = "_"  # a number may hold a minus
# dolfinx, PETSc and SLEPc take a second to import: the one module that needs them is loaded when
# something is really reduced, so that a run whose superelements all come from the store does
# without
ELASTIC_MODULE = "headstock.reduction.components.elastic"


@dataclass(frozen=True)
class StoredRequest:
    """What is requested from the store.

    Attributes:
        key: Of everything that the superelements of a component depend on but how much they hold.
        reduction: How much is requested.
        verify: The number of modes is to be counted.
    """

    key: str
    reduction: ReductionRequest
    mass: bool
    verify: bool


def _find_superelement(store: Store, request: StoredRequest) -> StoreRead[ReducedComponent]:
    """The smallest stored superelement that serves, as if it had been reduced for the request;
    warnings of entries not believed.
    """
    warning = None
    for key in serving_keys(store, request):
        read = read_entry(store, key, ReducedComponent)
        warning = warning or read.warning
        if read.value is not None:
            element = trim_superelement(
                read.value.superelement, request.reduction, mass=request.mass
            )
            return StoreRead(dataclasses.replace(read.value, superelement=element), warning)
    return StoreRead(None, warning)


def serving_keys(store: Store, request: StoredRequest) -> list[str]:
    """Keys of stored superelements that hold all that is requested, the smallest first."""
    serving = [
        (-1 if extent.modes is None else extent.modes, key)
        for key in list_keys(store, ReducedComponent, f"{request.key}{SEPARATOR}")
        if (extent := _read_extent(key)) is not None
        and extent.serves(request.reduction, mass=request.mass, verify=request.verify)
    ]
    return [key for _, key in sorted(serving)]


def _find_scaled(
    state: RunState, component: Component, request: StoredRequest
) -> ReducedComponent | None:
    """The smallest stored superelement of another modulus, density or mass that serves, scaled to
    those of the component.
    """
    if component.fidelity != "elastic" or component_probes(state, component):
        return None
    family, _, amounts = request.key.partition(SEPARATOR)
    bodies = [load.name for load in component_loads(state, component) if load.kind == "body"]
    for key in list_keys(state.store, ReducedComponent, f"{family}{SEPARATOR}"):
        _, stored, *_ = key.split(SEPARATOR)
        factors = _compare_amounts(stored, amounts)
        extent = _read_extent(key)
        if factors is None or extent is None:
            continue
        stiffer, heavier = factors
        faster = dataclasses.replace(
            extent, cutoff_hz=extent.cutoff_hz * (stiffer / heavier) ** 0.5
        )
        if faster.serves(request.reduction, mass=request.mass, verify=request.verify):
            read = read_entry(state.store, key, ReducedComponent)
            state.warn(read.warning)
            if read.value is not None:
                scaled = scale_material(
                    read.value.superelement, stiffer=stiffer, heavier=heavier, body_loads=bodies
                )
                element = trim_superelement(scaled, request.reduction, mass=request.mass)
                return dataclasses.replace(read.value, superelement=element)
    return None


def _compare_amounts(stored: str, wanted: str) -> tuple[float, float] | None:
    """Return the factors on modulus and mass between two ends of keys; None where there are none."""
    (modulus, density, mass), (other, other_density, other_mass) = (
        text.split(",") for text in (stored, wanted)
    )
    if (mass == "None") != (other_mass == "None"):
        return None
    first, second = (density, other_density) if mass == "None" else (mass, other_mass)
    factors = float(other) / float(modulus), float(second) / (float(first) or np.nan)
    return factors if np.isfinite(factors).all() and min(factors) > 0.0 else None


def _keep_superelement(
    store: Store, request: StoredRequest, reduced: ReducedComponent
) -> str | None:
    """Keep what was reduced for a request; a warning where the store cannot be written."""
    return write_entry(
        store, f"{request.key}{SEPARATOR}{_describe_extent(request, reduced)}", reduced
    )


def _describe_extent(request: StoredRequest, reduced: ReducedComponent) -> str:
    """How much a superelement holds, as the end of its key."""
    element, modes = reduced.superelement, request.reduction.modes
    parts = (
        [STATIC] if modes is None else [str(element.modal_count), repr(float(element.cutoff_hz))]
    )
    flags = {
        "mass": request.mass,
        "gravity": request.reduction.gravity,
        "verified": request.verify and modes is not None,
    }
    return SEPARATOR.join([*parts, *(name for name, there in flags.items() if there)])


def _read_extent(key: str) -> ReductionExtent | None:
    """The inverse; None for what is no such key."""
    _, _, first, *rest = key.split(SEPARATOR)
    flags = {name: name in rest for name in ("mass", "gravity", "verified")}
    try:
        if first == STATIC:
            return ReductionExtent(None, 0.0, **flags)
        return ReductionExtent(int(first), float(rest[0]), **flags)
    except (ValueError, IndexError):
        return None


def _run_mesh_stage(state: RunState, stage: Stage) -> Outcome:
    """Fetch a component's superelement from the store, else its mesh, else mesh it, on rank 0."""
    component = _component(state, stage)

    def find_mesh() -> tuple[bool, Outcome]:
        mesh, outcome = None, Outcome(cached=True, detail="not needed")
        if not load_reduced(state, component):
            mesh, outcome = load_or_make_mesh(state, component)
            state.meshes[component.name] = mesh
        return mesh is not None, outcome

    meshed, outcome = make_on_root(state.comm, find_mesh)
    if meshed:
        state.meshes.setdefault(component.name, None)
    return outcome


def _run_reduce_stage(state: RunState, stage: Stage) -> Outcome:
    """Assemble and reduce a component on all ranks, unless its superelement is in the store."""
    component = _component(state, stage)
    if component.name not in state.meshes:
        # the mesh stage made none, as it found the superelement in the store
        return Outcome(
            cached=True,
            detail=_describe(state.reduced[component.name].superelement) if state.is_root else "",
        )
    mesh = state.meshes.pop(component.name)
    # the store knows it by what the scene says
    solved, why = make_on_root(state.comm, lambda: _choose_by_mesh(component, state.scene, mesh))
    supports, loads = component_supports(state, component), component_loads(state, component)
    elastic = importlib.import_module(ELASTIC_MODULE)
    request = _reduction_request(state, component)
    superelement: Superelement = elastic.reduce_elastic(
        solved,
        mesh,
        supports,
        loads,
        comm=state.comm,
        request=request,
        probes=component_probes(state, component),
        sensors=component_sensors(state, component),
    )

    def keep() -> Outcome:
        check_superelement(superelement)
        skin, quality = (None, None) if mesh is None else (mesh_skin(mesh), mesh.quality)
        reduced = ReducedComponent(superelement, quality, skin)
        state.reduced[component.name] = _as_asked(component, reduced)
        state.warn(_keep_superelement(state.store, stored_request(state, component), reduced))
        split = ""
        if state.comm.size > 1:
            iterates = solved.reduction.solver == "iterative"
            way = "without factors" if iterates else "MUMPS, ordered by PORD on one"
            split = f", split over {state.comm.size} ranks ({way})"
        return Outcome(detail=_describe(superelement) + split + why)

    return make_on_root(state.comm, keep)


def _choose_by_mesh(
    component: Component, scene: Scene, mesh: ComponentMesh | None
) -> tuple[Component, str]:
    """Factors or iteration for a mesh from a file, whose size nobody knew when the run was planned;
    on rank 0.
    """
    if mesh is None or not isinstance(component.solid, MeshFile):
        return component, ""
    extents = np.ptp(mesh.points, axis=0).tolist()
    choice = choose_solver(component, scene, 3 * len(mesh.points), extents)
    settings = dataclasses.replace(component.reduction, solver=choice.method)
    why = f", {choice.reason}" if choice.method == "iterative" else ""
    return dataclasses.replace(component, reduction=settings), why


def _make_rigid(state: RunState, component: Component) -> str:
    """Make a rigid superelement from a component's mass properties."""
    loads = component_loads(state, component)
    described = with_loaded_areas(component, loads)
    superelement = reduce_rigid(
        component,
        describe_solid(described, state.store, state.warn),
        loads,
        component_sensors(state, component),
    )
    skin = _file_skin(state, component)
    state.reduced[component.name] = ReducedComponent(superelement, skin=skin)
    return f"{superelement.mass_kg:.4g} kg"


def _make_segments(state: RunState, component: Component) -> str:
    """Cut a component into a row of rigid segments on beam springs."""
    properties = describe_solid(component, state.store, state.warn)
    superelement = reduce_segmented(
        component,
        properties,
        component_loads(state, component),
        component_sensors(state, component),
    )
    skin = _bending_skin(component)
    state.reduced[component.name] = ReducedComponent(superelement, skin=skin)
    return f"{superelement.mass_kg:.4g} kg, {component.segments.count} segments"


def _bending_skin(component: Component) -> Skin:
    skin = segment_skin(component)
    nodes = np.arange(len(skin.points))[:, None]
    return dataclasses.replace(skin, nodes=nodes, weights=np.ones(nodes.shape))


def _run_polynomial_stage(state: RunState, stage: Stage) -> Outcome:
    """Reduce a component whose displacements are polynomials, unless it is in the store."""
    if not state.is_root:
        return Outcome()
    component = _component(state, stage)
    if load_reduced(state, component):
        return Outcome(cached=True, detail=_describe(state.reduced[component.name].superelement))
    superelement = reduce_polynomial(
        component,
        describe_solid(component, state.store, state.warn),
        component_loads(state, component),
        component_sensors(state, component),
        request=_reduction_request(state, component),
    )
    reduced = ReducedComponent(superelement, skin=_bending_skin(component))
    state.reduced[component.name] = reduced
    state.warn(_keep_superelement(state.store, stored_request(state, component), reduced))
    return Outcome(detail=_describe(superelement))


def _load_file(state: RunState, component: Component) -> str:
    """Read an imported superelement."""
    read = read_part(state.scene, component, cast(SuperelementFile, component.solid))
    superelement = dataclasses.replace(read, name=component.name, probes={}, sensors={})
    state.reduced[component.name] = _as_asked(component, ReducedComponent(superelement))
    return _describe(superelement)


def _run_on_root(
    make: Callable[[RunState, Component], str],
) -> Callable[[RunState, Stage], Outcome]:
    """Return a stage of what rank 0 alone makes of a component, and says of it."""

    def run(state: RunState, stage: Stage) -> Outcome:
        return Outcome(detail=make(state, _component(state, stage))) if state.is_root else Outcome()

    return run


COMPONENT_STAGES: dict[str, Callable[[RunState, Stage], Outcome]] = {
    "mesh": _run_mesh_stage,
    "reduce": _run_reduce_stage,
    "rigid": _run_on_root(_make_rigid),
    "segment": _run_on_root(_make_segments),
    "expand": _run_polynomial_stage,
    "load": _run_on_root(_load_file),
}


def _component(state: RunState, stage: Stage) -> Component:
    if stage.component is None:
        raise ValueError(f"a {stage.kind} stage needs a component")
    return state.plan.components[stage.component]


def load_reduced(state: RunState, component: Component) -> bool:
    """Take a component's superelement from the store, if one is there that serves; on rank 0."""
    request = stored_request(state, component)
    stored = state.read.get(request)
    if stored is None:
        read = _find_superelement(state.store, request)
        state.warn(read.warning)
        stored = read.value or _find_scaled(state, component, request)
        if stored is None:
            return False
        state.read[request] = stored
    # equal components share an entry and its arrays: the name is not part of the key
    superelement = dataclasses.replace(stored.superelement, name=component.name)
    named = dataclasses.replace(stored, superelement=superelement)
    state.reduced[component.name] = _as_asked(component, named)
    return True


def _as_asked(component: Component, reduced: ReducedComponent) -> ReducedComponent:
    """What the store or a file holds as it is, corrected by the estimate of its mesh where that is asked for."""
    if component.fidelity != "elastic" or not component.reduction.correct_mesh:
        return reduced
    return dataclasses.replace(reduced, superelement=correct_mesh(reduced.superelement))


def _reduction_request(state: RunState, component: Component) -> ReductionRequest:
    return ReductionRequest(
        modes=mode_target(component) if state.plan.with_modes else None,
        gravity=state.plan.gravity is not None or bool(state.scene.machine.base_motions),
        attached=any(sensor.is_loaded for sensor in component_sensors(state, component)),
    )


def stored_request(state: RunState, component: Component) -> StoredRequest:
    """Return the request to the store for a component."""
    supports, loads = component_supports(state, component), component_loads(state, component)
    request = _reduction_request(state, component)
    return StoredRequest(
        key=superelement_key(
            component,
            supports,
            loads,
            component_probes(state, component),
            component_sensors(state, component),
        ),
        reduction=request,
        mass=needs_mass(component, loads, request),
        verify=component.reduction.verify,
    )


def _file_skin(state: RunState, component: Component) -> Skin | None:
    """What is drawn of a body that is not meshed and whose shape only a file knows."""
    if not isinstance(component.solid, StepFile | MeshFile):
        return None
    key = skin_key(component)
    read = read_entry(state.store, key, Skin)
    state.warn(read.warning)
    if read.value is not None:
        return read.value
    try:
        skin = unmeshed_skin(component.solid)
    except MeshError as error:
        # no number depends on it
        state.warn(f"component {component.name!r} is drawn as a block of equal inertia: {error}")
        return None
    if skin is not None:
        state.warn(write_entry(state.store, key, skin))
    return skin


def stored_mesh(state: RunState, component: Component) -> ComponentMesh | None:
    """The mesh of a component from the store; None where it is not there."""
    key = mesh_key(
        component, component_supports(state, component), component_loads(state, component)
    )
    return read_entry(state.store, key, ComponentMesh).value


def load_or_make_mesh(state: RunState, component: Component) -> tuple[ComponentMesh, Outcome]:
    """The mesh of a component from the store, or made and kept there, and what was done; on rank 0.

    Raises:
        MeshError: It cannot be meshed as described.
    """
    supports, loads = component_supports(state, component), component_loads(state, component)
    key = mesh_key(component, supports, loads)
    read = read_entry(state.store, key, ComponentMesh)
    state.warn(read.warning)
    mesh = read.value
    if mesh is None:
        limit = state.scene.limits.time_s
        mesh = (
            mesh_component(component, supports, loads)
            if limit is None
            else mesh_component(component, supports, loads, time_limit=limit)
        )
        state.warn(write_entry(state.store, key, mesh))
    return mesh, Outcome(
        cached=read.value is not None, detail=f"{_spaced(3 * len(mesh.points))} dofs"
    )


def _describe(superelement: Superelement) -> str:
    modes = superelement.modal_count
    shapes = [
        f", {entry.shapes.count} shapes at {name}"
        for name, entry in superelement.interface_maps.items()
        if entry.shapes is not None
    ]
    return "".join(
        [
            f"{_spaced(superelement.full_dofs)} → {len(superelement.labels)} dofs",
            f", {modes} modes" if modes else "",
            *shapes,
        ]
    )


def _spaced(count: int) -> str:
    return f"{count:,}".replace(",", " ")
