"""Meshes a CAD shape with gmsh, or only measures it (runs in the worker process)."""

import dataclasses
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.patches import FACE_DIRECTIONS
from headstock.geometry.parts.plane_shapes import patch_width
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.cad.features import (
    PlainShape,
    leave_out_features,
    refuse_slivers,
    remove_narrow_features,
)
from headstock.meshing.cad.imprints import Imprints, OpenShape, imprint_patches
from headstock.meshing.cad.insets import close_planes
from headstock.meshing.cad.shapes import (
    Shape,
    boundary_faces,
    build_shape,
    read_nodes,
    total_area,
)
from headstock.meshing.cad.sizes import (
    SizePlan,
    add_grading_fields,
    add_growth_fields,
    add_size_fields,
    add_sizes_view,
    count_curved_cells,
    count_graded_cells,
    describe_short_edges,
    measure_curved_faces,
    measure_edges,
    name_finest_faces,
    size_curved_faces,
)
from headstock.meshing.component_mesh import CellKind, CurvedFacets, IntArray, LeftOut
from headstock.meshing.elements.quality import PLACES, facet_places, scaled_jacobians
from headstock.meshing.errors import MeshError, MeshQualityError
from headstock.meshing.process.job import MeshData, MeshJob
from headstock.meshing.sizing import (
    CELL_BUDGET,
    DEFAULT_FILE_CELLS,
    DETAIL_SHARE,
    LARGEST_SHARE,
    NARROW_GROWTH,
    NARROW_PATCH,
    PATCH_CELLS,
    SIZE_STEP,
    SMALLEST_SIZE,
    budget_message,
    count_quadratic_nodes,
    default_size,
    dense_patch_message,
    estimate_behind_faces,
    estimate_tets,
)

HXT, DELAUNAY = 10, 1
ROUND_KINDS = ("Cylinder", "Cone", "Sphere", "Torus")
FREE_FACETS = 4000  # their nearest points take 0.7 ms each
TETRAHEDRON = {1: 4, 2: 11}
TRIANGLE = {1: 2, 2: 9}
SLIVER_QUALITY = 0.02
USABLE_QUALITY = 2e-3  # of the worst tet: above what the mesh checks refuse
THIN_TRIANGLE = 0.05  # height over longest side
# HXT goes on to improve tets below this quality, and cannot in walls that are thinner than this share of
# their triangles' width: there it asks for what can be had
HXT_QUALITY, HXT_FLATNESS = 0.3, 0.2
NEVER_EXTEND = 0
# Up to so many cells a survey fills the meshed faces to count what is behind them, which takes about
# as long as their meshing; by rules of thumb blocks with fine patches had half of their nodes
COUNTED_CELLS = 400_000
NARROW_SHARE = 0.05  # of the smallest element size: what is narrower is not meshed
OPTIONS: dict[str, float] = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Geometry.OCCParallel": 0,
    "Mesh.ElementOrder": 1,
    "Mesh.Binary": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.RandomSeed": 1,
}


def mesh_shape(job: MeshJob) -> MeshData:
    """Build, imprint and (unless only described) mesh the shape of a job.

    Raises:
        MeshError: The shape cannot be built, imprinted, meshed or would need too many cells.
    """
    with open_kernel():
        solid = require_shape(job)
        volume = build_shape(solid)
        size = _element_size(job, solid, volume)
        as_shown = boundary_faces(volume)
        removed: list[str] = []
        left_out: LeftOut | None = None
        if isinstance(solid, StepFile) and job.task != "describe":
            plain = _remove_features(job, solid, volume, size)
            volume, as_shown, removed = plain.volume, plain.faces, plain.remarks
            left_out = plain.left_out
        if isinstance(solid, StepFile):
            refuse_slivers(as_shown, left=set(boundary_faces(volume)), size=size, unit=job.unit)
        imprints = imprint_patches(_open_shape(job, solid, volume, size, as_shown), job.groups)
        faces, removed = imprints.faces, removed + imprints.remarks
        properties = _measure(volume, faces)
        rims = _find_rims(job, imprints)
        plan, count = _plan_sizes(job, volume, faces, size)
        # elements grow from patches narrower than they are, unless a growth is requested
        narrow = any(at_rim < NARROW_PATCH * size for at_rim in imprints.sizes.values())
        growth = NARROW_GROWTH if job.growth is None and narrow else job.growth
        graded = 0 if growth is None else count_graded_cells(rims, growth=growth, size=size)
        if job.growth is None and graded > PATCH_CELLS:
            raise MeshError(_name_dense_patch(job, graded))
        count += graded
        nothing = np.zeros((0, 4), dtype=np.int64)
        described = MeshData(
            np.zeros((0, 3)), nothing, None, properties=properties, size=size, estimate=count
        )
        if job.task == "describe":
            return described
        # imprints cut faces up, and what is left has other numbers
        present = set(boundary_faces(volume))
        numbers = (
            {tag: number for number, tag in enumerate(as_shown, 1) if tag in present}
            if present <= set(as_shown)
            else {}
        )
        _check_budget(count, job, size, numbers)
        fields = _set_sizes(job.sizes, growth, size, plan, rims)
        remarks = removed + _mesh_faces(
            job, volume, size, fields, numbers, graded=growth is not None
        )
        count, nodes = _count_cells(job, volume, size)
        if job.task == "estimate":
            if count <= COUNTED_CELLS:
                count, nodes = _fill_roughly(job.order) or (count, nodes)
            return dataclasses.replace(described, estimate=count, nodes=nodes, remarks=remarks)
        _check_budget(count, job, size, numbers)
        _generate(job, volume)
        data = _collect(job, volume, faces, properties, size)
        return dataclasses.replace(
            data,
            estimate=count,
            remarks=remarks,
            owners=_point_owners(data, numbers),
            left_out=left_out,
        )


@contextmanager
def open_kernel() -> Iterator[None]:
    """Provide an empty gmsh model with the options all jobs share."""
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    try:
        for name, value in OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        yield
    finally:
        gmsh.finalize()


def require_shape(job: MeshJob) -> Shape:
    """Return the solid of a job that has a CAD shape."""
    if isinstance(job.solid, MeshFile):
        raise MeshError("a mesh file has no CAD shape")
    return job.solid


def _element_size(job: MeshJob, solid: Shape, volume: int) -> float:
    """Return the element size as requested, or by the sizing rule; for files coarser until curved
    faces included there are not too many cells.
    """
    if job.size is not None:
        return job.size
    low, high = shape_bounds(volume)
    content = float(gmsh.model.occ.getMass(3, volume))
    thickness = _mean_thickness(volume)
    extent = float((high - low).max())
    size = default_size(content, thickness, extent)
    if not isinstance(solid, StepFile):
        return size
    curved = measure_curved_faces(boundary_faces(volume), {}, job.order)
    while size < extent / LARGEST_SHARE:
        plan = size_curved_faces(
            curved,
            volume=content,
            thickness=thickness,
            size=size,
            order=job.order,
            refinement=job.refinement,
        )
        if estimate_tets(content, thickness, size) + count_curved_cells(plan) <= DEFAULT_FILE_CELLS:
            break
        size *= SIZE_STEP
    return size


def _mean_thickness(volume: int) -> float:
    return 2.0 * float(gmsh.model.occ.getMass(3, volume)) / total_area(boundary_faces(volume))


def _plan_sizes(
    job: MeshJob, volume: int, faces: dict[str, list[int]], size: float
) -> tuple[SizePlan | None, int]:
    """Return the element sizes on curved faces and rims, and the number of cells to expect."""
    content = float(gmsh.model.occ.getMass(3, volume))
    thickness = _mean_thickness(volume)
    count = estimate_tets(content, thickness, size)
    if job.straight:
        return None, count
    curved = measure_curved_faces(boundary_faces(volume), faces, job.order)
    plan = size_curved_faces(
        curved,
        volume=content,
        thickness=thickness,
        size=size,
        order=job.order,
        refinement=job.refinement,
    )
    return plan, count + count_curved_cells(plan)


def shape_bounds(volume: int) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner ``(3,)`` of a volume's bounding box."""
    box = np.array(gmsh.model.occ.getBoundingBox(3, volume))
    return box[:3], box[3:]


def _named_faces(job: MeshJob) -> list[int]:
    """Return the numbers of the faces that patches name by them."""
    faces = [patch.face for patches in job.groups.values() for patch in patches]
    return [int(face.removeprefix("face:")) for face in faces if face.startswith("face:")]


def _remove_features(job: MeshJob, solid: StepFile, volume: int, size: float) -> PlainShape:
    """Return the shape to be meshed: without details that are small compared with the elements, or
    as requested.
    """

    def build_anew() -> PlainShape:
        gmsh.clear()
        volume = build_shape(solid)
        return PlainShape(volume, boundary_faces(volume), [])

    def close(volume: int) -> PlainShape:
        width = DETAIL_SHARE * size if job.details is None else job.details
        closed = close_planes(
            volume,
            width=width,
            named=_named_faces(job),
            ends=_named_ends(job, volume),
            unit=job.unit,
        )
        return build_anew() if closed is None else closed

    def rebuild() -> int:
        return close(build_anew().volume).volume

    shape = close(volume)
    named = _named_faces(job)
    if job.leave_out is not None:
        return leave_out_features(shape, rebuild, radius=job.leave_out, named=named, unit=job.unit)
    width = NARROW_SHARE * _smallest(job, size)
    plain = remove_narrow_features(shape, width=width, named=named, unit=job.unit)
    return close(build_anew().volume) if plain is None else plain


def _named_ends(job: MeshJob, volume: int) -> list[tuple[int, float]]:
    """Return axis and coordinate of the outermost planes that patches name by direction."""
    corners = dict(zip((-1.0, 1.0), shape_bounds(volume), strict=True))
    named = {patch.face for patches in job.groups.values() for patch in patches}
    return [
        (axis, float(corners[float(sign)][axis]))
        for face, (axis, sign) in FACE_DIRECTIONS.items()
        if face in named
    ]


def _open_shape(
    job: MeshJob, solid: Shape, volume: int, size: float, faces: list[int]
) -> OpenShape:
    low, high = shape_bounds(volume)
    return OpenShape(
        volume,
        solid,
        tuple(faces),
        low,
        high,
        size,
        job.unit,
        job.across_patches,
        job.refinement,
        polygons=job.straight,
    )


def _measure(volume: int, faces: dict[str, list[int]]) -> SolidProperties:
    occ = gmsh.model.occ
    areas: dict[str, float] = {}
    centroids: dict[str, FloatArray] = {}
    for name, tags in faces.items():
        parts = np.array([occ.getMass(2, tag) for tag in tags])
        places = np.array([occ.getCenterOfMass(2, tag) for tag in tags])
        areas[name] = float(parts.sum())
        centroids[name] = parts @ places / parts.sum()
    inertia = np.array(occ.getMatrixOfInertia(3, volume)).reshape(3, 3)
    return SolidProperties(
        float(occ.getMass(3, volume)),
        np.array(occ.getCenterOfMass(3, volume)),
        inertia,
        areas,
        centroids,
        _box(3, [volume]),
        {name: _box(2, tags) for name, tags in faces.items()},
    )


def _box(dimension: int, tags: list[int]) -> FloatArray:
    """Return the box ``(2, 3)`` around shapes."""
    ends = np.array([gmsh.model.occ.getBoundingBox(dimension, tag) for tag in tags])
    return np.stack([ends[:, :3].min(axis=0), ends[:, 3:].max(axis=0)])


def _name_dense_patch(job: MeshJob, count: int) -> str:
    widths = {
        name: min(widths)
        for name, patches in job.groups.items()
        if (widths := [patch_width(patch) for patch in patches if patch.shape != "whole"])
    }
    name = min(widths, key=lambda each: widths[each])
    return f"{name}: {dense_patch_message(count, widths[name] * job.unit, job.across_patches)}"


def _set_sizes(
    sizes: SizeField | None,
    growth: float | None,
    size: float,
    plan: SizePlan | None,
    rims: dict[int, float],
) -> list[int]:
    """Set the element sizes in gmsh; return the tags of the fields that hold them."""
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    fields = [] if plan is None else add_size_fields(plan)
    if growth is not None:
        fields += add_grading_fields(rims, growth=growth, size=size)
        # sizes on faces follow their distance from the rims, not those of the nearest edges
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", NEVER_EXTEND)
    if sizes is not None:
        fields.append(add_sizes_view(sizes))
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", NEVER_EXTEND)
    _use_fields(fields)
    return fields


def _use_fields(fields: list[int]) -> None:
    if fields:
        smallest = gmsh.model.mesh.field.add("Min")
        gmsh.model.mesh.field.setNumbers(smallest, "FieldsList", fields)
        gmsh.model.mesh.field.setAsBackgroundMesh(smallest)


def _smallest(job: MeshJob, size: float) -> float:
    return (SMALLEST_SIZE * size if job.smallest is None else job.smallest) / job.refinement


def _mesh_faces(
    job: MeshJob,
    volume: int,
    size: float,
    fields: list[int],
    numbers: dict[int, int],
    *,
    graded: bool,
) -> list[str]:
    """Mesh edges and faces, and say what was done about short edges; without graded sizes they grow
    from crowded ones only.
    """
    faces = boundary_faces(volume)
    gmsh.model.mesh.generate(1)
    remarks = []
    if isinstance(job.solid, StepFile) and job.growth is None:
        edges, smallest = measure_edges(faces, size), _smallest(job, size)
        if edges.crowded or graded:
            _use_fields(fields + add_growth_fields(edges, size=size, smallest=smallest))
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", NEVER_EXTEND)
        remarks = describe_short_edges(edges, numbers, smallest=smallest, unit=job.unit)
    gmsh.model.mesh.generate(2)
    return remarks


def _count_cells(job: MeshJob, volume: int, size: float) -> tuple[int, int]:
    """Return the number of cells and nodes to expect behind the triangles of the meshed faces."""
    triangles = sum(
        len(gmsh.model.mesh.getElementsByType(TRIANGLE[1], face)[0])
        for face in boundary_faces(volume)
    )
    return estimate_behind_faces(
        triangles, float(gmsh.model.occ.getMass(3, volume)) / size**3, job.order
    )


def _fill_roughly(order: int) -> tuple[int, int] | None:
    """Return the number of cells and nodes with which gmsh fills the meshed faces, whatever their
    quality; None where it cannot.
    """
    # HXT makes fewer tets of blocks, and takes long on slivers
    algorithm = DELAUNAY if _worst_triangle(_read_triangles()) < THIN_TRIANGLE else HXT
    gmsh.option.setNumber("Mesh.Optimize", 0.0)
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    try:
        gmsh.model.mesh.generate(3)
    except Exception:  # gmsh raises the bare class; meshing says so in time
        return None
    cells = len(gmsh.model.mesh.getElementsByType(TETRAHEDRON[1])[0])
    corners = len(gmsh.model.mesh.getNodes()[0])
    triangles = len(gmsh.model.mesh.getElementsByType(TRIANGLE[1])[0])
    return cells, corners if order == 1 else count_quadratic_nodes(corners, cells, triangles)


def _check_budget(count: int, job: MeshJob, size: float, numbers: dict[int, int]) -> None:
    """Refuse what would be too large.

    Raises:
        MeshError: With a size that would do; of CAD parts also the faces that hold most elements,
            and the key that coarsens them.
    """
    if count <= CELL_BUDGET:
        return
    message = budget_message(count, size * job.unit)
    if not isinstance(job.solid, StepFile):
        raise MeshError(message)
    smallest = _smallest(job, size) * job.unit
    raise MeshError(
        f"{message}, coarsen curved faces and short edges by mesh.smallest, now {smallest:.2g} m, or leave out fillets and holes"
        f" by mesh.leave_out and mesh.details"
        f"{name_finest_faces(numbers)}"
    )


def _find_rims(job: MeshJob, imprints: Imprints) -> dict[int, float]:
    """Find the curves from which elements grow, and the size there."""
    sizes: dict[int, float] = {}
    groups = [([face], size) for face, size in imprints.sizes.items()]
    groups += (
        []
        if job.rim_size is None
        else [(imprints.faces[name], job.rim_size / job.refinement) for name in job.rims]
    )
    for faces, size in groups:
        for _, curve in gmsh.model.getBoundary([(2, face) for face in faces], oriented=False):
            sizes[curve] = min(size, sizes.get(curve, size))
    return sizes


def _generate(job: MeshJob, volume: int) -> None:
    if not _mesh_acceptably(volume, from_cad=isinstance(job.solid, StepFile)):
        limit = f"{resource.getrlimit(resource.RLIMIT_AS)[0] / 2**30:.3g} GiB of memory"
        # coarse facets of narrow curved faces cut through each other; finer ones do not
        raise MeshQualityError(
            f"gmsh could not mesh the solid within {limit}; write another mesh size, or repair the CAD model"
        )
    if job.order == 2 and not job.straight:
        gmsh.model.mesh.setOrder(2)


def _mesh_acceptably(volume: int, *, from_cad: bool) -> bool:
    """Return the mesh with the algorithm that leaves no slivers, or else with the one whose worst
    tet is best.

    No algorithm makes good tets on triangles that are slivers themselves, and HXT takes ten times
    as long there: the other one goes first, and alone if its tets can be used. On thin triangles of
    curved faces, which may cut through each other, HXT takes all memory: the other one does alone.
    """
    qualities: dict[int, float] = {}
    triangles = _read_triangles()
    flatness = _mean_thickness(volume) / _median_width(triangles)
    quality = HXT_QUALITY * min(1.0, flatness / HXT_FLATNESS)
    gmsh.option.setNumber("Mesh.OptimizeThreshold", quality)
    worst = _worst_triangle(triangles)
    if from_cad and worst < THIN_TRIANGLE:
        return _try_algorithm(DELAUNAY) > 0.0
    if worst < SLIVER_QUALITY and _try_algorithm(DELAUNAY) > USABLE_QUALITY:
        return True
    for algorithm in (HXT, DELAUNAY):
        qualities[algorithm] = _try_algorithm(algorithm)
        if qualities[algorithm] >= SLIVER_QUALITY:
            return True
    best = max(qualities, key=lambda algorithm: qualities[algorithm])
    return qualities[best] > 0.0 if best == DELAUNAY else _try_algorithm(best) > 0.0


def _try_algorithm(algorithm: int) -> float:
    """Fill the faces' mesh, which is made once, with straight tets; return the quality of the
    worst, 0 where meshing failed.
    """
    gmsh.model.mesh.clear(gmsh.model.getEntities(3))
    gmsh.option.setNumber("Mesh.Algorithm3D", algorithm)
    try:
        gmsh.model.mesh.generate(3)
        if _worst_quality() < SLIVER_QUALITY:
            gmsh.model.mesh.optimize("")
    except Exception:  # gmsh raises the bare class; the next algorithm may do
        return 0.0
    bare = any(
        not len(gmsh.model.mesh.getElements(2, tag)[0]) for _, tag in gmsh.model.getEntities(2)
    )
    return 0.0 if bare else _worst_quality()


def _read_triangles() -> FloatArray:
    """Return the corners ``(n, 3, 3)`` of the triangles of the meshed faces."""
    points, row = read_nodes()
    _, nodes = gmsh.model.mesh.getElementsByType(TRIANGLE[1])
    return np.asarray(points[row[nodes].reshape(-1, 3)])


def _median_width(corners: FloatArray) -> float:
    """Return the width of an even triangle with the median area of triangles ``(n, 3, 3)``."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # an even triangle of a side has 0.43 times its square
    return float(np.sqrt(2.3 * np.median(0.5 * np.linalg.norm(normals, axis=1))))


def _worst_triangle(corners: FloatArray) -> float:
    """Return the height of the flattest of triangles ``(n, 3, 3)`` over its longest side."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return float((doubled / sides**2).min(initial=1.0))


def _worst_quality() -> float:
    _, nodes = gmsh.model.mesh.getElementsByType(TETRAHEDRON[1])
    if not len(nodes):
        return 0.0
    points, row = read_nodes()
    return float(scaled_jacobians(points, row[nodes].reshape(-1, 4), "tet4").min())


def _point_owners(data: MeshData, numbers: dict[int, int]) -> IntArray:
    """Return the number ``(n,)`` of a face that each point of a mesh lies on, 0 inside or where
    faces have no numbers.
    """
    tags, _, _ = gmsh.model.mesh.getNodes()
    owner = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    for face, number in numbers.items():
        owner[gmsh.model.mesh.getNodes(2, face, includeBoundary=True)[0]] = number
    # points are the nodes of the cells, in the order of their tags
    kept = owner[
        np.unique(
            gmsh.model.mesh.getElementsByType(TETRAHEDRON[1 if data.kind == "tet4" else 2])[1]
        )
    ]
    return np.asarray(kept, dtype=np.int64)


def _collect(
    job: MeshJob, volume: int, faces: dict[str, list[int]], properties: SolidProperties, size: float
) -> MeshData:
    # straight cells are raised to the second order, and checked, by `finish_mesh` in the parent
    # process
    order = 1 if job.straight else job.order
    points, row = read_nodes()
    _, cell_nodes = gmsh.model.mesh.getElementsByType(TETRAHEDRON[order], volume)
    per_cell = 4 if order == 1 else 10
    used = np.unique(cell_nodes)
    row_of = np.full(len(row), -1, dtype=np.int64)
    row_of[used] = np.arange(len(used))
    points = points[row[used]]
    facets = {name: _face_corners(row_of, tags_of, order) for name, tags_of in faces.items()}
    kind: CellKind = "tet4" if order == 1 else "tet10"
    curved = _curved_facets(boundary_faces(volume), row_of, points, order)
    return MeshData(
        points,
        row_of[cell_nodes.reshape(-1, per_cell)],
        kind,
        facets,
        properties=properties,
        size=size,
        curved=curved,
    )


def _curved_facets(
    faces: list[int], row_of: IntArray, points: FloatArray, order: int
) -> CurvedFacets:
    """Return the facets on faces that are not plane, and where these lie; of free-form faces, which
    take long, no more than a sample.
    """
    per_facet = 3 if order == 1 else 6
    kinds = {face: gmsh.model.getType(2, face) for face in faces}
    face_facets = {
        face: row_of[gmsh.model.mesh.getElementsByType(TRIANGLE[order], face)[1]].reshape(
            -1, per_facet
        )
        for face, kind in kinds.items()
        if kind != "Plane"
    }
    free = sum(
        len(facets) for face, facets in face_facets.items() if kinds[face] not in ROUND_KINDS
    )
    nodes = [np.zeros((0, per_facet), dtype=np.int64)]
    nearest = [np.zeros((0, PLACES**2, 3))]
    shares = [np.zeros(0)]
    for face, facets in face_facets.items():
        step = 1 if kinds[face] in ROUND_KINDS else max(1, -(-free // FREE_FACETS))
        chosen = facets[::step]
        nodes.append(chosen)
        closest, _ = gmsh.model.getClosestPoint(2, face, facet_places(points, chosen).ravel())
        nearest.append(np.array(closest).reshape(len(chosen), -1, 3))
        shares.append(np.full(len(chosen), len(facets) / max(1, len(chosen))))
    return CurvedFacets(np.concatenate(nodes), np.concatenate(nearest), np.concatenate(shares))


def _face_corners(row_of: IntArray, faces: list[int], order: int) -> IntArray:
    per_facet = 3 if order == 1 else 6
    parts: list[Any] = []
    for tag in faces:
        _, nodes = gmsh.model.mesh.getElementsByType(TRIANGLE[order], tag)
        parts.append(row_of[nodes].reshape(-1, per_facet)[:, :3])
    return np.concatenate(parts)
