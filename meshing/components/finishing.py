"""Turns raw cells and facets into a checked component mesh: second order, quality, connectivity,
patches, volume and areas.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Patch
from headstock.geometry.parts.mass_properties import SolidProperties, closed_form_properties
from headstock.geometry.parts.solids import HollowColumn, MeshFile, StepFile, Tube
from headstock.meshing.component_mesh import (
    POOR_QUALITY,
    CellKind,
    ComponentMesh,
    IntArray,
    LeftOut,
    MeshQuality,
    MissingVolumes,
    SurfaceGaps,
)
from headstock.meshing.elements.quadratic import (
    complete_hexes,
    elevate_tets,
    is_straight,
    repair_tets,
)
from headstock.meshing.elements.quality import (
    PLACES,
    facet_moments,
    mesh_volume,
    scaled_jacobians,
)
from headstock.meshing.elements.regions import are_planes, are_whole_faces
from headstock.meshing.elements.surface import (
    FlatTets,
    MeshSurface,
    count_parts,
    extract_surface,
    find_flat_tets,
    gaps_agree,
    match_facets,
    measure_gaps,
)
from headstock.meshing.elements.topology import cell_family, cell_shape_functions, corner_count
from headstock.meshing.errors import MeshError, MeshQualityError, PatchError
from headstock.meshing.files.patches import available_names, select_facets, set_nodes
from headstock.meshing.process.job import MeshData
from headstock.meshing.scipy_library import scipy

# of the volume of tets that fill walls alone: a thinner wall is none, but slivers in thicker ones
SLIVERS = 0.01
SAME_WALL = 0.9  # of a thickness
QUALITY_FLOOR = 1e-3
CAD_TOLERANCE = 1e-3
# of the kernel's volume of a part with spline faces: 0.2 % for a cylinder of two
KERNEL_ERROR = 5e-3
LINEAR_CURVED_TOLERANCE = 2e-2  # flat facets inscribed in round faces, 24 to the turn
STRAIGHT_TOLERANCE = 1e-12
NAMED_ELEMENTS = 5

Groups = Mapping[str, tuple[Patch, ...]]
CANDIDATES = 60  # cells with the nearest middles, of which one holds a point or is closest to it
# weights along the depth: through a wall in bending the density of energy is a parabola
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0


def finish_mesh(data: MeshData, component: Component, groups: Groups) -> ComponentMesh:
    """Elevate or repair, check and tag a mesh.

    Args:
        data: Points [m], cells, and the facet corners of each group or, from a mesh file, of each
            named set.

    Raises:
        MeshError: The mesh is disconnected, has bad elements, or misses the CAD volume or a patch
            area.
    """
    what = f"component {component.name!r}"
    points, cells, kind, repaired = _shape_elements(data, component)
    straight = is_straight(points, cells, kind, STRAIGHT_TOLERANCE)
    parts, _ = count_parts(cells, kind, len(points))
    if parts > 1:
        raise MeshError(
            f"{what}: the mesh falls into {parts} parts that share no node; make one component of each, or merge coincident nodes"
        )
    from_file = isinstance(component.solid, MeshFile)
    jacobians = _check_quality(
        points, cells, kind, what=what, straight=straight, from_file=from_file
    )
    surface = extract_surface(cells, kind)
    if from_file:
        data = _resolve_file_patches(data, surface, component, groups)
    patches = {name: _tag_facets(surface, data, name, what) for name in groups}
    properties = None if from_file else data.properties or closed_form_properties(component)
    affine = straight and cell_family(kind) == "tet"
    volume = (
        mesh_volume(points, cells[:, :4], "tet4") if affine else mesh_volume(points, cells, kind)
    )
    areas = {name: float("nan") for name in groups}
    cad_volume = float("nan")
    if properties is not None:
        if data.curved is not None and len(data.curved.nodes):
            between = measure_gaps(points, surface, data.curved)
            properties = _correct_volume(properties, volume, between)
        cad_volume = properties.volume
        areas |= properties.patch_areas
        _check_sizes(points, patches, volume, properties, component)
    quality = dataclasses.replace(
        _rate_cells(data, points, cells, kind, jacobians, volume),
        repaired=repaired,
        cad_volume=cad_volume,
        cad_areas=areas,
        remarks=_list_remarks(data, component, repaired, len(cells)),
    )
    gaps = _find_gaps(points, surface, data, component, quality, straight=straight)
    missing = None if data.left_out is None else _place_features(points, cells, kind, data.left_out)
    return ComponentMesh(points, cells, kind, straight, patches, quality, gaps, missing)


def _rate_cells(
    data: MeshData,
    points: FloatArray,
    cells: IntArray,
    kind: CellKind,
    jacobians: FloatArray,
    volume: float,
) -> MeshQuality:
    """Return how good cells are; see ``MeshQuality``.

    Args:
        jacobians: Scaled Jacobian ``(n_cells,)`` of each.
        volume: Of the mesh [m^3].
    """
    flat = _find_flat_tets(points, cells, kind)
    # a cell that is flat because its wall is thin is as good as it can be; what else is wrong with
    # it counts
    shapes = jacobians.copy()
    shapes[flat.cells] = np.maximum(jacobians[flat.cells], flat.qualities)
    worst, poor = int(np.argmin(shapes)), cells[shapes < POOR_QUALITY]
    a, b, c = (points[cells[flat.cells, k]] - points[cells[flat.cells, 0]] for k in (1, 2, 3))
    sizes = np.abs(np.einsum("ci,ci->c", a, np.cross(b, c))) / 6.0  # edges taken as straight
    walls = flat.thickness >= _thinnest_wall(flat.thickness, sizes)
    slopes = flat.lengths[walls] ** 6 / flat.thickness[walls] ** 4
    bent = float(sizes[walls] @ slopes) / volume
    share = mesh_volume(points, poor, kind) / mesh_volume(points, cells, kind) if len(poor) else 0.0
    return MeshQuality(
        float(shapes[worst]),
        0,
        volume,
        float("nan"),
        poor_share=share,
        worst_place=np.asarray(points[cells[worst, : corner_count(kind)]].mean(axis=0)),
        worst_face=_face_at(data, cells[worst]),
        flatness=bent if kind == "tet10" else 0.0,
        flat_size=float(np.median(flat.lengths)) if len(flat.cells) else 0.0,
        flat_thickness=float(np.median(flat.thickness)) if len(flat.cells) else 0.0,
    )


def _list_remarks(
    data: MeshData, component: Component, repaired: int, count: int
) -> tuple[str, ...]:
    """Return what the user should know of how the mesh came about; that a file's cells were changed
    is part of it.
    """
    if not repaired or not isinstance(component.solid, MeshFile):
        return tuple(data.remarks)
    return (
        *data.remarks,
        f"{repaired} of the {count} curved tets of {component.solid.path.name} were inverted, or nearly so, and were "
        "straightened",
    )


def find_patch_faults(data: MeshData, component: Component, groups: Groups) -> list[PatchError]:
    """Find what is wrong with the patches on a mesh file, the first fault of each group.

    Args:
        data: What the file holds [m].
    """
    _, cells, kind, _ = _shape_elements(data, component)
    surface = extract_surface(cells, kind)
    faults = []
    for name, patches in groups.items():
        try:
            _resolve_file_patches(data, surface, component, {name: patches})
        except PatchError as error:
            faults.append(error)
    return faults


def _thinnest_wall(thickness: FloatArray, sizes: FloatArray) -> float:
    """Return the thickness below which tets are slivers [m].

    Args:
        thickness: Of the walls that tets fill, ``(n,)`` [m].
        sizes: Their volumes, ``(n,)`` [m^3].
    """
    if not len(sizes):
        return 0.0
    order = np.argsort(thickness)
    volumes = np.cumsum(sizes[order])
    return SAME_WALL * float(thickness[order][np.searchsorted(volumes, SLIVERS * volumes[-1])])


def _find_flat_tets(points: FloatArray, cells: IntArray, kind: CellKind) -> FlatTets:
    if cell_family(kind) == "tet":
        return find_flat_tets(points, cells[:, :4])
    none = np.zeros(0)
    return FlatTets(np.zeros(0, dtype=np.int64), none, none, none)


def _face_at(data: MeshData, cell: IntArray) -> str:
    """Return ``face:N`` on which most nodes of a cell lie, where faces have numbers."""
    on_faces = cell[cell < len(data.owners)]
    owners = data.owners[on_faces]
    owners = owners[owners > 0]
    return f"face:{np.bincount(owners).argmax()}" if len(owners) else ""


def patch_moments(
    points: FloatArray, patches: Mapping[str, IntArray]
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Return the area [m^2] and centroid ``(3,)`` [m] of each patch group."""
    areas: dict[str, float] = {}
    centroids: dict[str, FloatArray] = {}
    for name, facets in patches.items():
        parts, places = facet_moments(points, facets)
        areas[name] = float(parts.sum())
        centroids[name] = (
            parts @ places / parts.sum()
            if areas[name] > 0.0
            else points[np.unique(facets)].mean(axis=0)
        )
    return areas, centroids


class _Shaped(NamedTuple):
    """Points, cells and kind after elevation or repair, and the number of repaired cells."""

    points: FloatArray
    cells: IntArray
    kind: CellKind
    repaired: int = 0


def _shape_elements(data: MeshData, component: Component) -> _Shaped:
    kind = data.kind or "tet4"
    if kind == "hex20":
        points, cells = complete_hexes(data.points, data.cells)
        return _Shaped(points, cells, "hex27")
    if kind == "tet4" and isinstance(component.solid, MeshFile):
        return _Shaped(data.points, data.cells, kind)
    if kind == "tet4" and component.mesh.order == 2:
        points, cells = elevate_tets(data.points, data.cells)
        return _Shaped(points, cells, "tet10")
    if kind == "tet10":
        points, repaired = repair_tets(data.points, data.cells)
        return _Shaped(points, data.cells, kind, len(repaired))
    return _Shaped(data.points, data.cells, kind)


def _check_quality(
    points: FloatArray,
    cells: IntArray,
    kind: CellKind,
    *,
    what: str,
    straight: bool,
    from_file: bool,
) -> FloatArray:
    """Return the scaled Jacobian ``(n_cells,)`` of every element."""
    affine = straight and cell_family(kind) == "tet"
    shape: CellKind = "tet4" if affine else kind
    quality = scaled_jacobians(points, cells[:, :4] if affine else cells, shape)
    bad = np.flatnonzero(~(quality >= QUALITY_FLOOR))
    if not len(bad):
        return quality
    order = bad[np.argsort(quality[bad], kind="stable")]
    inverted = int((~(quality > 0.0)).sum())
    centers = points[cells[order[:NAMED_ELEMENTS], : corner_count(kind)]].mean(axis=1)
    named = "; ".join(
        f"element {cell + 1} at ({x:.4g}, {y:.4g}, {z:.4g}) m: {quality[cell]:.2g}"
        for cell, (x, y, z) in zip(order, centers, strict=False)
    )
    remedy = (
        "mesh the part again in the program that wrote the file"
        if from_file
        else "write another mesh size, move patches that almost touch an edge or each other, or repair the geometry"
    )
    raise MeshQualityError(
        f"{what}: {len(bad)} of {len(cells)} elements are unusable ({inverted} inverted, the rest with a scaled Jacobian below "
        f"{QUALITY_FLOOR:g}): {named}; {remedy}"
    )


def _tag_facets(surface: MeshSurface, data: MeshData, name: str, what: str) -> IntArray:
    if name in data.node_sets:  # a forced point or line: one facet per node, without area
        return np.repeat(data.node_sets[name][:, None], surface.facets.shape[1], axis=1)
    matched, missing = match_facets(surface, data.facets[name])
    if missing or not len(matched):
        raise MeshError(
            f"{what}: {name}: {missing} facets of the patch are not on the mesh's surface and {len(matched)} are; tagged: "
            f"{sorted(data.facets)}"
        )
    return surface.facets[matched]


def _correct_volume(
    properties: SolidProperties, volume: float, gaps: SurfaceGaps
) -> SolidProperties:
    """Return the volume that a mesh and the gaps to its CAD faces make, where that of the CAD
    kernel is not it: the kernel integrates over spline faces with few points.

    Args:
        properties: As the kernel has them.
        volume: Of the mesh [m^3].
        gaps: Between its facets and the faces.
    """
    whole = volume + float(gaps.volumes.sum())
    close = np.abs(gaps.volumes).sum() <= CAD_TOLERANCE * volume
    off = abs(properties.volume / whole - 1.0)
    if close and CAD_TOLERANCE < off < KERNEL_ERROR:
        return dataclasses.replace(properties, volume=whole)
    return properties


def _check_sizes(
    points: FloatArray,
    patches: Mapping[str, IntArray],
    volume: float,
    properties: SolidProperties,
    component: Component,
) -> None:
    """Compare volume and patch areas with CAD."""
    solid = component.solid
    curved = isinstance(solid, Tube | StepFile) or (
        isinstance(solid, HollowColumn) and solid.core_hole > 0.0
    )
    tolerance = LINEAR_CURVED_TOLERANCE if curved and component.mesh.order == 1 else CAD_TOLERANCE
    remedy = "write a smaller mesh size" if curved else "check the patches for slivers"
    error = abs(volume / properties.volume - 1.0)
    if not error <= tolerance:
        raise MeshQualityError(
            f"component {component.name!r}: the mesh has a volume of {volume:.6g} m^3, CAD {properties.volume:.6g} m^3: "
            f"{error:.2%} off, allowed {tolerance:.1%}; {remedy}"
        )
    areas, _ = patch_moments(points, patches)
    for name, area in properties.patch_areas.items():
        error = abs(areas[name] / area - 1.0)
        if not error <= tolerance:
            raise MeshQualityError(
                f"component {component.name!r}: {name} has an area of {areas[name]:.6g} m^2 in the mesh, CAD {area:.6g} m^2: "
                f"{error:.2%} off, allowed {tolerance:.1%}; {remedy}"
            )


def _find_gaps(
    points: FloatArray,
    surface: MeshSurface,
    data: MeshData,
    component: Component,
    quality: MeshQuality,
    *,
    straight: bool,
) -> SurfaceGaps | None:
    """Find what the mesh cuts short of curved faces; None where nobody knows, or where it does not
    add up to the volume it misses.
    """
    if isinstance(component.solid, MeshFile) and not (straight and are_planes(points, surface)):
        return None
    if data.curved is None or not len(data.curved.nodes):
        return SurfaceGaps(surface.facets[:0], np.zeros((0, PLACES**2)))
    gaps = measure_gaps(points, surface, data.curved)
    return gaps if gaps_agree(gaps, quality.volume, quality.cad_volume) else None


def _resolve_file_patches(
    data: MeshData, surface: MeshSurface, component: Component, groups: Groups
) -> MeshData:
    """Return the mesh of a file with the facet corners of each patch group in place of the file's
    own sets.

    Forced point and line groups leave their nodes in ``node_sets``.

    Raises:
        PatchError: A patch selects nothing, or a single point, line or facet of a larger face
            without ``allow_singular``.
    """
    facets: dict[str, IntArray] = {}
    nodes: dict[str, IntArray] = {}
    for name, patches in groups.items():
        what = f"component {component.name!r}: {name}"
        resolved = []
        for index, patch in enumerate(patches):
            try:
                resolved.append(select_facets(data, surface, patch))
            except (MeshError, ValueError) as error:
                raise PatchError(f"{what}: {error}", name, index) from error
        chosen = np.unique(np.concatenate(resolved))
        facets[name] = surface.facets[chosen][:, : surface.corners]
        members = np.unique(np.concatenate([set_nodes(data, patch) for patch in patches]))
        forced = name in component.interfaces and component.interfaces[name].allow_singular
        if not len(chosen) and len(members):
            if not forced:
                raise PatchError(
                    f"{what}: {len(members)} nodes span no facet of the surface; a point or a line has a compliance that depends "
                    "on the mesh; name an area, or write allow_singular = true",
                    name,
                )
            nodes[name] = members
        elif not len(chosen):
            raise PatchError(
                f"{what}: no facet of the surface lies in the patch; available: {available_names(data, surface)}",
                name,
            )
        elif (
            name in component.interfaces
            and not forced
            and len(chosen) == 1
            and not are_whole_faces(data.points, surface, chosen)
        ):
            raise PatchError(
                f"{what}: a single facet of a larger face has a compliance that depends on the mesh; name a larger area, or write "
                "allow_singular = true",
                name,
            )
    return dataclasses.replace(data, facets=facets, node_sets=nodes)


def _place_features(
    points: FloatArray, cells: IntArray, kind: CellKind, left_out: LeftOut
) -> MissingVolumes:
    """Return the features shared out among the cells that hold their ends and middles.

    Args:
        points: ``(n_points, 3)`` [m].
        cells: ``(n_cells, nodes per cell)`` tetrahedra.
        left_out: The features [m].
    """
    places = left_out.places.reshape(-1, 3)
    corners = points[cells[:, :4]]
    candidates = np.atleast_2d(
        scipy.spatial.KDTree(corners.mean(axis=1)).query(places, k=min(CANDIDATES, len(cells)))[1]
    ).reshape(len(places), -1)
    edges = (corners[:, 1:] - corners[:, :1])[candidates]
    inside = np.linalg.solve(
        edges.swapaxes(2, 3), (places[:, None] - corners[candidates, 0])[..., None]
    )[..., 0]
    shares = np.concatenate([1.0 - inside.sum(axis=2, keepdims=True), inside], axis=2)
    best = shares.min(axis=2).argmax(axis=1)
    rows = np.arange(len(places))
    # pads and what curved faces leave outside count at the nearest place inside
    nearest = np.maximum(shares[rows, best], 0.0)
    nearest /= nearest.sum(axis=1, keepdims=True)
    volumes = (left_out.volumes[:, None] * SIMPSON).ravel()
    return MissingVolumes(
        candidates[rows, best],
        cell_shape_functions(kind, nearest[:, 1:]),
        volumes,
        np.repeat(left_out.strengths, len(SIMPSON)),
    )
