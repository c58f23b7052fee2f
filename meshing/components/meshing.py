"""Meshes one component, or measures its solid, in the component's own frame."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Load, MeshSettings, Patch, Support
from headstock.geometry.parts.mass_properties import (
    SolidProperties,
    closed_form_properties,
    solid_volume,
)
from headstock.geometry.parts.patches import FACE_DIRECTIONS, PlanarSolid
from headstock.geometry.parts.plane_shapes import patch_width
from headstock.geometry.parts.solids import (
    Box,
    Imported,
    MeshFile,
    ParametricSolid,
    PointMass,
    StepFile,
    SuperelementFile,
    Tube,
)
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.finishing import find_patch_faults, finish_mesh, patch_moments
from headstock.meshing.components.mesh_request import (
    Groups,
    element_size,
    has_plane_faces_only,
    patch_groups,
    require_sound,
)
from headstock.meshing.elements.hex_grid import count_grid_cells, grid_lines, mesh_box_grid
from headstock.meshing.elements.quality import integrate_mesh
from headstock.meshing.errors import MeshError, MeshQualityError, PatchError
from headstock.meshing.length_units import STEP_UNIT
from headstock.meshing.process.job import MeshData, MeshJob, format_job, scale_properties
from headstock.meshing.process.running import run_job
from headstock.meshing.sizing import (
    CELL_BUDGET,
    UNCOUNTED,
    budget_message,
    count_patch_cells,
    estimate_tets,
    largest_extent,
    round_length,
    thinnest_feature,
)

# Parametric solids are meshed 1000 units long, whatever their size: OpenCASCADE's tolerances are
# absolute
JOB_EXTENT = 1000.0
DESCRIBE_TIME_LIMIT = 120.0
SURVEY_TIME_LIMIT = 300.0  # that of a mesh
LINE_LIKE = 1e-4
# imprints and curved faces are meshed finer when a mesh fails its checks: in small steps, a failed
# mesh costs less than a fine one
REFINEMENTS = (1.0, 1.25, 1.6, 2.0, 4.0)

MeshJobText = str
_ANSWERED: dict[tuple[MeshJobText, int | None], MeshData] = {}  # by question and age of its file


def mesh_component(
    component: Component,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    time_limit: float = 300.0,
) -> ComponentMesh:
    """Mesh a component and tag its patches.

    Args:
        component: What to mesh; its placement plays no part.
        supports: Supports of this component (others are ignored).
        loads: Loads on patches of this component (others are ignored).
        time_limit: Processor time that meshing may take [s].

    Returns:
        The mesh with one patch group per interface, ``support:NAME`` and ``load:NAME``.

    Raises:
        MeshError: The solid or a patch cannot be meshed as described, or the mesh fails a check.
    """
    groups = patch_groups(component, supports, loads)
    _check_request(component, groups)
    solid = component.solid
    what = f"component {component.name!r}"
    if isinstance(solid, MeshFile):
        data = read_mesh_file(solid, what, time_limit)
        return finish_mesh(data, component, groups)
    if not isinstance(solid, StepFile | SuperelementFile):
        count, size = _planned_cells(component), element_size(component)
        if count > CELL_BUDGET:
            raise MeshError(f"{what}: {budget_message(count, size)}")
    if component.mesh.cells == "hex":
        return finish_mesh(_mesh_grid(component, groups, what), component, groups)
    for refinement in REFINEMENTS[:-1]:
        try:
            return finish_mesh(
                _run_shape_job(component, groups, time_limit=time_limit, refinement=refinement),
                component,
                groups,
            )
        except MeshQualityError:
            if not _needs_survey(component, groups):
                raise
    return finish_mesh(
        _run_shape_job(component, groups, time_limit=time_limit, refinement=REFINEMENTS[-1]),
        component,
        groups,
    )


def find_file_faults(
    component: Component, supports: Sequence[Support] = (), loads: Sequence[Load] = ()
) -> tuple[list[PatchError], list[str]]:
    """Find what is wrong with the patches of a component from a mesh file, which is read for it,
    and remarks on the file; none of any other solid.

    Raises:
        MeshError: The file cannot be read.
    """
    if not isinstance(component.solid, MeshFile):
        return [], []
    data = read_mesh_file(component.solid, f"component {component.name!r}")
    faults = find_patch_faults(data, component, patch_groups(component, supports, loads))
    return faults, data.remarks


def describe_component(component: Component) -> SolidProperties:
    """Return the volume, centre, inertia for unit density, and interface areas and centroids of a
    component, without meshing it.

    Closed forms for boxes, tubes, plates and columns without core holes; the CAD kernel for other
    solids and patches; the integral over the mesh for mesh files. A mass that the component
    overrides plays no part.

    Raises:
        MeshError: The solid cannot be built or a patch does not exist.
    """
    groups: Groups = {name: interface.patches for name, interface in component.interfaces.items()}
    solid = component.solid
    what = f"component {component.name!r}"
    require_sound(component)
    if isinstance(solid, MeshFile):
        mesh = finish_mesh(read_mesh_file(solid, what), component, groups)
        whole = integrate_mesh(mesh.points, mesh.cells, mesh.kind)
        areas, centroids = patch_moments(mesh.points, mesh.patches)
        boxes = {name: _box_of(mesh.points[facets]) for name, facets in mesh.patches.items()}
        return SolidProperties(
            *(whole.volume, whole.center, whole.inertia, areas, centroids),
            box=_box_of(mesh.points),
            patch_boxes=boxes,
            remarks=mesh.quality.remarks,
        )
    properties = closed_form_properties(component)
    if properties is None:
        properties = _describe_shape(_without_mesh_settings(component), groups).properties
    if properties is None:
        raise MeshError(f"{what}: the CAD kernel returned no properties")
    return properties


def _box_of(points: FloatArray) -> FloatArray:
    """Return the lowest and highest coordinates ``(2, 3)`` of points ``(..., 3)``."""
    flat = points.reshape(-1, 3)
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


@dataclasses.dataclass(frozen=True)
class MeshEstimate:
    """Rough estimate of a mesh.

    Attributes:
        nodes: Number of nodes; 0 where it follows from the cells alone.
        volume: Of the solid [m^3]; None where it is not known.
    """

    cells: int
    nodes: int = 0
    volume: float | None = None


def estimate_mesh(
    component: Component,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    survey: bool = False,
    known: dict[MeshJobText, MeshEstimate] | None = None,
    before_survey: Callable[[], None] | None = None,
) -> MeshEstimate:
    """Estimate what a component's mesh will be like before meshing.

    Args:
        survey: Mesh the surface of what has patches or curved faces, with the sizes of the mesh
            itself: within a factor of 1.5.
        known: Surveys that were made before, which equal components share; this one is added.
        before_survey: Called before a surface is meshed, which can take seconds.

    Raises:
        MeshError: A STEP file cannot be read, or a patch does not exist.
    """
    solid, settings = component.solid, component.mesh
    if settings.sizes is not None:
        return MeshEstimate(settings.sizes.cells, volume=float(settings.sizes.volumes.sum()))
    volume = solid_volume(solid) if isinstance(solid, PlanarSolid | Tube) else None
    if settings.cells == "hex":
        return MeshEstimate(_count_hex_cells(component, supports, loads), volume=volume)
    if isinstance(solid, MeshFile | SuperelementFile | PointMass):
        return MeshEstimate(_estimate_cells(component))
    groups = patch_groups(component, supports, loads)
    if survey and (settings.growth is not None or _needs_survey(component, groups)):
        known = {} if known is None else known
        job = format_job(_shape_job(component, groups, task="estimate"))
        if job not in known:
            if before_survey is not None:
                before_survey()
            known[job] = _survey(component, groups)
        return known[job]
    cells = _estimate_cells(component)
    if not isinstance(solid, StepFile) and settings.growth is None:
        across, size = settings.across_patches, element_size(component)
        count = functools.partial(count_patch_cells, solid=solid, across=across, size=size)
        cells += int(sum(map(count, itertools.chain(*groups.values()))))
    return MeshEstimate(cells, volume=volume)


def _survey(component: Component, groups: Groups) -> MeshEstimate:
    data = _run_shape_job(component, groups, task="estimate", time_limit=SURVEY_TIME_LIMIT)
    volume = None if data.properties is None else data.properties.volume
    return MeshEstimate(data.estimate, data.nodes, volume)


def _needs_survey(component: Component, groups: Groups) -> bool:
    """Return whether a solid has curved faces or imprints, which take cells of their own."""
    return not has_plane_faces_only(component) or any(
        patch.shape != "whole" for patches in groups.values() for patch in patches
    )


def _count_hex_cells(
    component: Component, supports: Sequence[Support], loads: Sequence[Load]
) -> int:
    """Return the number of hexes with grid lines along all patches; without them where the grid
    cannot follow, which meshing will say.
    """
    roughly = _estimate_cells(component)
    if not isinstance(component.solid, Box) or roughly > CELL_BUDGET:
        return roughly  # lines of a grid that is refused anyway could fill the memory
    patches = [
        patch for group in patch_groups(component, supports, loads).values() for patch in group
    ]
    try:
        return count_grid_cells(
            grid_lines(
                component.solid, patches, element_size(component), component.mesh.across_patches
            )
        )
    except MeshError:
        return roughly


def _estimate_cells(component: Component) -> int:
    """Return the number of cells a component's mesh will have, roughly (hexes: exactly up to patch
    lines), before meshing.

    STEP files are measured by the CAD kernel and mesh files are read.
    """
    solid = component.solid
    if isinstance(solid, SuperelementFile):
        return 0
    if isinstance(solid, MeshFile):
        return len(read_mesh_file(solid, f"component {component.name!r}").cells)
    if isinstance(solid, StepFile) or (
        component.mesh.growth is not None and component.mesh.cells == "tet"
    ):
        groups = patch_groups(component, (), ()) if component.mesh.growth is not None else {}
        return _describe_shape(component, groups).estimate
    return _planned_cells(component)


def automatic_size(component: Component) -> float:
    """Return the element size that the sizing rules choose for a component, whatever it asks for
    [m].

    Raises:
        MeshError: A STEP file cannot be read.
    """
    unsized = _without_mesh_settings(component)
    if isinstance(component.solid, StepFile):
        return _describe_shape(unsized, patch_groups(component, (), ())).size
    return element_size(unsized)


def _without_mesh_settings(component: Component) -> Component:
    """Return the component with a mesh of which nothing is said but its order: features that meshes
    leave out belong to what is described.
    """
    return dataclasses.replace(component, mesh=MeshSettings(order=component.mesh.order))


def _describe_shape(component: Component, groups: Groups) -> MeshData:
    """Return what the CAD kernel reports of an unmeshed component, asked once in a process."""
    path = component.solid.path if isinstance(component.solid, StepFile) else None
    changed = None if path is None or not path.exists() else path.stat().st_mtime_ns
    question = format_job(_shape_job(component, groups, task="describe")), changed
    if question not in _ANSWERED:
        _ANSWERED[question] = _run_shape_job(
            component, groups, task="describe", time_limit=DESCRIBE_TIME_LIMIT
        )
    return _ANSWERED[question]


def count_hexes(component: Component, size: float, across: int = 4) -> int:
    """Return the number of hexes of a box with grid lines along its patches.

    Args:
        size: Largest side of a hex [m].
        across: Fewest hexes across a patch.

    Raises:
        MeshError: A patch cannot follow the grid.
    """
    return count_grid_cells(grid_of(component, size, across))


def grid_of(
    component: Component, size: float, across: int = 4
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the grid lines along the patches of a box [m], see ``count_hexes``."""
    if not isinstance(component.solid, Box):
        raise ValueError("only boxes are meshed with hexes")
    patches = [patch for interface in component.interfaces.values() for patch in interface.patches]
    return grid_lines(component.solid, patches, size, across)


def _run_shape_job(
    component: Component,
    groups: Groups,
    *,
    task: Literal["mesh", "describe", "estimate"] = "mesh",
    time_limit: float,
    refinement: float = 1.0,
) -> MeshData:
    """Run the CAD kernel on a component in a worker process and return what it found, in metres.

    Args:
        component: With a CAD or parametric solid.
        task: Mesh it, list its faces, or count what a mesh would have.
        time_limit: Processor time of the worker process [s].
        refinement: How many times finer the curved faces are to be meshed.
    """
    job = _shape_job(component, groups, task=task, refinement=refinement)
    data = run_job(job, what=f"component {component.name!r}", time_limit=time_limit)
    scale = job.unit
    properties = None if data.properties is None else scale_properties(data.properties, scale)
    curved = (
        None
        if data.curved is None
        else dataclasses.replace(data.curved, nearest=data.curved.nearest * scale)
    )
    return dataclasses.replace(
        data,
        points=data.points * scale,
        properties=properties,
        size=data.size * scale,
        curved=curved,
        left_out=None if data.left_out is None else data.left_out.scaled(scale),
    )


def _shape_job(
    component: Component,
    groups: Groups,
    *,
    task: Literal["mesh", "describe", "estimate"],
    refinement: float = 1.0,
) -> MeshJob:
    """Return what the worker process is to do; the same for components of the same shape, patches
    and mesh settings.
    """
    solid = component.solid
    if isinstance(solid, MeshFile | SuperelementFile | PointMass):
        raise MeshError(f"component {component.name!r}: a {type(solid).__name__} has no CAD shape")
    scale = (
        STEP_UNIT
        if isinstance(solid, StepFile)
        else round_length(largest_extent(solid)) / JOB_EXTENT
    )
    settings = component.mesh

    def in_unit(length: float | None) -> float | None:
        return None if length is None else round_length(length / scale)

    if not isinstance(solid, StepFile):
        size: float | None = element_size(component)
    else:
        size = None if settings.size is None else round_length(settings.size)
    return MeshJob(
        task,
        solid if isinstance(solid, StepFile) else _scaled_solid(solid, scale),
        {
            name: [_scaled_patch(patch, scale) for patch in patches]
            for name, patches in groups.items()
        },
        unit=scale,
        size=in_unit(size),
        refinement=refinement,
        across_patches=settings.across_patches,
        growth=settings.growth,
        rims=tuple(
            name
            for name in groups
            if name in component.interfaces and component.interfaces[name].coupling == "rigid"
        ),
        rim_size=in_unit(settings.rim_size),
        smallest=in_unit(settings.smallest),
        leave_out=in_unit(settings.leave_out),
        details=in_unit(settings.details),
        order=settings.order,
        straight=has_plane_faces_only(component),
        sizes=None if settings.sizes is None else settings.sizes.scaled(scale),
    )


def _scaled_solid(solid: ParametricSolid, scale: float) -> ParametricSolid:
    """Return a solid with its lengths, alone or several in a field, in another unit; its counts of
    ribs stay.
    """
    fields = dataclasses.asdict(solid)
    for name, value in fields.items():
        if isinstance(value, tuple):
            fields[name] = tuple(round_length(round_length(part) / scale) for part in value)
        elif not name.startswith("ribs_"):
            fields[name] = round_length(round_length(value) / scale)
    return type(solid)(**fields)


def _scaled_patch(patch: Patch, scale: float) -> Patch:
    def shrink(point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (round_length(value / scale) for value in point)
        return x, y, z

    return dataclasses.replace(
        patch,
        center=shrink(patch.center),
        size=tuple(round_length(value / scale) for value in patch.size),
        corners=tuple(map(shrink, patch.corners)),
    )


def _planned_cells(component: Component) -> int:
    solid = component.solid
    if isinstance(solid, Imported):
        raise ValueError("only parametric solids can be estimated without reading a file")
    size = element_size(component)
    if component.mesh.cells == "hex" and isinstance(solid, Box):
        return int(min(math.prod(float(np.ceil(side / size)) for side in solid.size), UNCOUNTED))
    return estimate_tets(solid_volume(solid), thinnest_feature(solid), size)


def _mesh_grid(component: Component, groups: Groups, what: str) -> MeshData:
    if not isinstance(component.solid, Box):
        raise MeshError(
            f"{what}: only boxes can be meshed with hexes, not {type(component.solid).__name__}; write cells = 'tet'"
        )
    box = Box(tuple(round_length(side) for side in component.solid.size))  # type: ignore[arg-type]
    size = element_size(component)
    try:
        count = count_grid_cells(
            grid_lines(
                box,
                [patch for patches in groups.values() for patch in patches],
                size,
                component.mesh.across_patches,
            )
        )
        if count > CELL_BUDGET:
            raise MeshError(budget_message(count, size))
        return mesh_box_grid(
            box, groups, size=size, order=component.mesh.order, across=component.mesh.across_patches
        )
    except MeshError as error:
        raise MeshError(f"{what}: {error}") from error


def read_mesh_file(solid: MeshFile, what: str, time_limit: float = DESCRIBE_TIME_LIMIT) -> MeshData:
    """Read a mesh file in a worker process, in metres.

    Args:
        what: Whose mesh it is, for messages.
        time_limit: Processor time of the worker process [s].

    Raises:
        MeshError: It cannot be read.
    """
    data = run_job(MeshJob("file", solid), what=what, time_limit=time_limit)
    return dataclasses.replace(data, points=data.points * solid.unit)


def _check_request(component: Component, groups: Groups) -> None:
    what = f"component {component.name!r}"
    require_sound(component)
    settings = component.mesh
    if settings.order not in (1, 2):
        raise MeshError(f"{what}: meshes have order 1 or 2, not {settings.order}")
    if settings.size is not None and not (np.isfinite(settings.size) and settings.size > 0.0):
        raise MeshError(f"{what}: the mesh size must be above zero, not {settings.size}")
    if settings.sizes is not None and (
        settings.cells == "hex" or isinstance(component.solid, MeshFile)
    ):
        raise MeshError(f"{what}: only tetrahedra made here take sizes from place to place")
    for name, patches in groups.items():
        if not patches:
            raise MeshError(
                f"{what}: {name} has no patches; write a face such as {', '.join(FACE_DIRECTIONS)}"
            )
        forced = name in component.interfaces and component.interfaces[name].allow_singular
        for patch in patches:
            if patch.shape != "whole" and not forced:
                _check_imprint(component, name, patch)


def _check_imprint(component: Component, name: str, patch: Patch) -> None:
    what = f"component {component.name!r}: {name}"
    if not (patch.size or patch.corners) or not patch_width(patch) > 0.0:
        raise MeshError(f"{what}: a {patch.shape} needs a size above zero, not {patch.size}")
    solid = component.solid
    if isinstance(solid, Imported):
        return
    width = patch_width(patch)
    if width < LINE_LIKE * largest_extent(solid):
        raise MeshError(
            f"{what}: a {patch.shape} of {1e3 * width:.4g} mm is a point or a line on a solid of {1e3 * largest_extent(solid):.4g} mm, "
            "and its compliance depends on the mesh; write a larger patch, or allow_singular = true"
        )
