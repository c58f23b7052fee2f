"""Element sizes on curved faces, around imprinted patches, and on faces full of small holes and
short edges.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.size_field import SizeField
from headstock.meshing.cad.features import NAMED_FACES, face_radius, quote_faces, radius_of
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.sizing import count_rim_cells

LARGEST_TURN = np.pi / 2
COARSEST_SHARE = 1.0 / 3.0
FLOOR_STEP, FLOOR_STEPS = 0.8, 20
CELLS_PER_FACET = (
    12.0  # measured on filleted blocks: the grading around fine faces fills many layers
)
# an arc of angle theta replaced by a parabola (order 2) or chord (order 1) loses this share of its
# sector
LOSS = {1: (1.0 / 6.0, 2), 2: (7.8e-4 / (np.pi / 4) ** 4, 4)}
TURNS = {1: 24, 2: 8}
PATCH_ANGLE = {1: 0.3, 2: 0.7}
# A chord of length s lies s^2 / (8 R) off its arc. In a wall of thickness t << R chords of both its
# faces would cross elements, which straightening then takes off the volume: meshes of tubes (R / t
# = 5 to 15) fail from s^2 = 1.7 R t on.
THIN_WALL = 2.0  # times the thickness is the smallest radius of a face that counts as one of a wall
WALL_CHORD = 1.2
LOST_SHARE = {1: 1e-2, 2: 5e-4}  # of the volume, and of the area of a plane patch with a round rim
CLASSES_PER_OCTAVE = 4
RIM_SAMPLES = 200  # points of a curve from which distances are taken
TRIANGLE = 2  # gmsh's number of its kind
TRIANGLES = 2.3  # per area / size^2
CROWDED_SHARE = 2.0  # times the triangles that the size alone makes
CROWDED_TRIANGLES = 5000
# a mesh may grow from size to size by 1.5 from element to element without bad elements
GROWTH = 0.5
SAMPLES = 20  # points of a short edge from which distances are taken
CROWDED_PER_OCTAVE = 2
SHORT_SHARE = 0.1
ROUND = (
    0.7 * np.pi
    # the angle from which on a face goes round a hole, where an element that spans R turns by 60
    # degrees
)


@dataclass(frozen=True, eq=False)
class SizePlan:
    """Element sizes on the curved faces and rims of a shape, and elsewhere."""

    curved: "_CurvedFaces"
    faces: FloatArray
    rims: FloatArray
    elsewhere: float


@dataclass(frozen=True, eq=False)
class _CurvedFaces:
    """The curved faces and rims of a shape.

    Attributes:
        tags: ``(n,)`` gmsh tags of the curved faces.
        areas: ``(n,)`` their areas.
        radii: ``(n,)`` their smallest radii.
        patches: ``(n,)`` whether they belong to a patch.
        rims: ``(m, 2)`` round rims of plane patches: gmsh tag of the curve, and the size that keeps
            the patch's area.
    """

    tags: IntArray
    areas: FloatArray
    radii: FloatArray
    patches: FloatArray
    rims: FloatArray


def measure_curved_faces(
    faces: Sequence[int], patch_faces: Mapping[str, Sequence[int]], order: int
) -> _CurvedFaces:
    """Return the curved faces of the open gmsh model, and the round rims of its plane patches."""
    chosen = {tag for tags in patch_faces.values() for tag in tags}
    rows: list[tuple[float, ...]] = []
    rims: list[tuple[float, float]] = []
    for tag in faces:
        radius = face_radius(tag)
        if np.isfinite(radius):
            rows.append((tag, gmsh.model.occ.getMass(2, tag), radius, float(tag in chosen)))
        elif tag in chosen:
            rims += _rim_sizes(tag, order)
    table = np.array(rows, dtype=float).reshape(-1, 4)
    _, areas, radii, patches = table.T
    return _CurvedFaces(
        table[:, 0].astype(np.int64),
        areas,
        radii,
        patches,
        np.array(rims, dtype=float).reshape(-1, 2),
    )


def size_curved_faces(
    curved: _CurvedFaces,
    *,
    volume: float,
    thickness: float,
    size: float,
    order: int,
    refinement: float,
) -> SizePlan:
    """Return the element sizes on curved faces: as coarse as volume and patch areas allow.

    Args:
        order: 1 or 2.
        refinement: How many times finer than that the curved faces are to be meshed.
    """
    factor, power = LOSS[order]
    floor, finest = size * COARSEST_SHARE, 2 * np.pi / TURNS[order]
    for _ in range(FLOOR_STEPS):
        angles = np.minimum(np.maximum(floor / curved.radii, finest), LARGEST_TURN)
        # what even the finest angle loses on wide faces, no smaller size on narrow ones brings back
        lost = float(
            np.sum(curved.areas * curved.radii / 2 * factor * (angles**power - finest**power))
        )
        if lost <= LOST_SHARE[order] * volume:
            break
        floor *= FLOOR_STEP
    sizes = np.clip(2 * np.pi * curved.radii / TURNS[order], floor, size)
    walls = np.where(
        curved.radii > THIN_WALL * thickness, np.sqrt(WALL_CHORD * curved.radii * thickness), np.inf
    )
    sizes = np.minimum(sizes, walls)
    sizes = np.where(
        curved.patches > 0.0, np.minimum(sizes, PATCH_ANGLE[order] * curved.radii), sizes
    )
    return SizePlan(
        curved, np.asarray(sizes / refinement), np.asarray(curved.rims[:, 1] / refinement), size
    )


def count_curved_cells(plan: SizePlan) -> int:
    """Return the number of cells that curved faces add, roughly."""
    finer = 1.0 - np.minimum(plan.faces / plan.elsewhere, 1.0)
    return int(CELLS_PER_FACET * np.sum(2.3 * plan.curved.areas / plan.faces**2 * finer))


def add_size_fields(plan: SizePlan) -> list[int]:
    """Set the sizes in gmsh and return the tags of its fields; what is not finer than elsewhere
    needs no telling.
    """
    rims = plan.curved.rims[:, 0].astype(np.int64)
    faces = _size_classes(plan.curved.tags, plan.faces, plan.elsewhere, CLASSES_PER_OCTAVE)
    curves = _size_classes(rims, plan.rims, plan.elsewhere, CLASSES_PER_OCTAVE)
    fields = [_add_field("SurfacesList", size, tags) for size, tags in faces]
    return fields + [_add_field("CurvesList", size, tags) for size, tags in curves]


def add_sizes_view(sizes: SizeField) -> int:
    """Set element sizes in gmsh from place to place, and return the tag of the field; beyond the
    tetrahedra those of the closest corner hold.
    """
    corners = sizes.points[sizes.tets].transpose(0, 2, 1).reshape(-1, 12)
    view = int(gmsh.view.add("sizes"))
    rows = np.hstack([corners, sizes.sizes[sizes.tets]])
    gmsh.view.addListData(view, "SS", len(rows), rows.ravel())
    field = int(gmsh.model.mesh.field.add("PostView"))
    gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
    return field


def _size_classes(
    tags: IntArray, sizes: FloatArray, size: float, per_octave: int
) -> list[tuple[float, list[int]]]:
    """Return the tags grouped by size, rounded down to a part of an octave below the size
    elsewhere.
    """
    steps = np.ceil(per_octave * np.log2(size / sizes) - 1e-9).astype(np.int64)
    return [
        (size * 2.0 ** (-step / per_octave), tags[steps == step].tolist())
        for step in np.unique(steps)
        if step > 0
    ]


def _add_field(entities: str, value: float, tags: list[int]) -> int:
    field = int(gmsh.model.mesh.field.add("Constant"))
    gmsh.model.mesh.field.setNumber(field, "VIn", value)
    gmsh.model.mesh.field.setNumbers(field, entities, tags)
    return field


def _rim_sizes(face: int, order: int) -> list[tuple[float, float]]:
    """Return the round rims of a plane patch with the element size at which together they lose no
    more than the share of its area.
    """
    rims = []
    for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False):
        if gmsh.model.getType(1, curve) != "Line":
            low, high = gmsh.model.getParametrizationBounds(1, curve)
            radius = radius_of(
                float(gmsh.model.getCurvature(1, curve, [(low[0] + high[0]) / 2])[0])
            )
            if np.isfinite(radius):
                rims.append(
                    (int(curve), radius, float(gmsh.model.occ.getMass(1, curve)) * radius / 2)
                )
    factor, power = LOSS[order]
    sectors = sum(sector for _, _, sector in rims)
    allowed = LOST_SHARE[order] * float(gmsh.model.occ.getMass(2, face))
    angle = (
        min((allowed / (factor * sectors)) ** (1.0 / power), LARGEST_TURN)
        if sectors > 0.0
        else LARGEST_TURN
    )
    return [(curve, angle * radius) for curve, radius, _ in rims]


def add_grading_fields(rims: Mapping[int, float], *, growth: float, size: float) -> list[int]:
    """Let elements in gmsh grow from curves, and return the tags of its fields.

    Where stresses are singular, as at the rim of a rigid patch, the error of an element of size ``h
    = growth * distance`` is the same at any distance, so that the number of elements grows with the
    inverse of the smallest size only.

    Args:
        rims: Element size at each curve.
        growth: Share of the distance from the curve that is added to it.
        size: Element size far away.

    Source: Babuska, Kellogg and Pitkaranta (1979), Numer. Math. 33, 447-471, graded meshes at
    singular corners.
    """
    return [
        _grow(
            sorted(curve for curve in rims if rims[curve] == smallest),
            smallest,
            size,
            growth=growth,
            samples=RIM_SAMPLES,
        )
        for smallest in sorted({smallest for smallest in rims.values() if smallest < size})
    ]


def count_graded_cells(rims: Mapping[int, float], *, growth: float, size: float) -> int:
    """Return the number of cells that growing from curves adds, roughly; of each curve the element
    size there.

    Args:
        rims: Curve tag to the element size there [m].
        growth: Of the element size per distance from the curve.
        size: Largest element size [m].
    """
    length = gmsh.model.occ.getMass
    return int(
        sum(
            count_rim_cells(float(length(1, curve)), s, growth=growth, size=size)
            for curve, s in rims.items()
        )
    )


def _grow(curves: list[int], smallest: float, size: float, *, growth: float, samples: int) -> int:
    fields = gmsh.model.mesh.field
    distance = int(fields.add("Distance"))
    fields.setNumbers(distance, "CurvesList", curves)
    fields.setNumber(distance, "Sampling", samples)
    grown = int(fields.add("Threshold"))
    fields.setNumber(grown, "InField", distance)
    fields.setNumber(grown, "SizeMin", smallest)
    fields.setNumber(grown, "SizeMax", size)
    fields.setNumber(grown, "DistMin", 0.0)
    fields.setNumber(grown, "DistMax", (size - smallest) / growth)
    return grown


@dataclass(frozen=True, eq=False)
class _EdgeSizes:
    """The meshed edges of the open gmsh model.

    Attributes:
        curves: ``(n,)`` tags.
        sizes: ``(n,)`` mean length of the elements on each.
        faces: ``(m,)`` tags of the faces looked at.
        extra: ``(m,)`` triangles on each that are there only because its edges are short.
        plain: Triangles that the element size alone makes, on all of them.
    """

    curves: IntArray
    sizes: FloatArray
    faces: IntArray
    extra: FloatArray
    plain: float

    @property
    def crowded(self) -> bool:
        """Short edges make most of the triangles, and many."""
        return float(self.extra.sum()) > max(CROWDED_SHARE * self.plain, CROWDED_TRIANGLES)


def measure_edges(faces: Sequence[int], size: float) -> _EdgeSizes:
    """Measure how the meshed edges of the open gmsh model would fill its faces if sizes inside were
    those of the edges around them.
    """
    lengths: dict[int, float] = {}
    counts: dict[int, int] = {}
    for _, curve in gmsh.model.getEntities(1):
        kinds: Any = gmsh.model.mesh.getElements(1, curve)
        number = sum(len(tags) for tags in kinds[1])
        lengths[curve], counts[curve] = float(gmsh.model.occ.getMass(1, curve)), max(number, 1)
    extra: list[float] = []
    plain = 0.0
    for face in faces:
        around = [abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False)]
        area = float(gmsh.model.occ.getMass(2, face))
        at_size = TRIANGLES * area / size**2
        number = sum(counts[curve] for curve in around)
        mean = sum(lengths[curve] for curve in around) / number if number else size
        extra.append(
            max(TRIANGLES * area / min(mean, size) ** 2 - at_size, 0.0) if mean > 0.0 else 0.0
        )
        plain += at_size
    tags = sorted(lengths)
    sizes = np.array([lengths[curve] / counts[curve] for curve in tags], dtype=float)
    return _EdgeSizes(
        np.array(tags, dtype=np.int64),
        sizes,
        np.array(faces, dtype=np.int64),
        np.array(extra),
        plain,
    )


def add_growth_fields(edges: _EdgeSizes, *, size: float, smallest: float) -> list[int]:
    """Let elements grow from short edges, and return the tags of the fields.

    Args:
        size: Element size far away.
        smallest: Where growth begins at edges that are shorter still.
    """
    starts = np.maximum(edges.sizes, smallest)
    classes = _size_classes(edges.curves, starts, size, CROWDED_PER_OCTAVE)
    grown = [
        _grow(curves, start, size, growth=GROWTH, samples=SAMPLES) for start, curves in classes
    ]
    return grown + _round_fields(edges.faces, size)


def describe_short_edges(
    edges: _EdgeSizes, numbers: Mapping[int, int], *, smallest: float, unit: float
) -> list[str]:
    """Return what a user should know of edges that are far shorter than the elements, with the
    faces they belong to.

    Args:
        numbers: What ``face:N`` counts, by tag.
        smallest: Element size beside them.
        unit: Length of the model's unit [m].
    """
    short: list[int] = list(edges.curves[edges.sizes < SHORT_SHARE * smallest])
    if not short:
        return []
    touched = {int(face) for curve in short for face in gmsh.model.getAdjacencies(1, int(curve))[0]}
    named = quote_faces([numbers[face] for face in touched if face in numbers])
    return [
        f"{len(short)} of {len(edges.curves)} edges, of {len(touched)} of {len(edges.faces)} faces{named},"
        f" are as short as {float(edges.sizes.min()) * unit:.2g} m; elements beside them are {smallest * unit:.2g} m (mesh.smallest)"
    ]


def name_finest_faces(numbers: Mapping[int, int]) -> str:
    """Return the faces that hold most triangles of a meshed surface, for a message; nothing before
    it is meshed.
    """
    counts = {face: len(gmsh.model.mesh.getElementsByType(TRIANGLE, face)[0]) for face in numbers}
    total = sum(counts.values())
    if not total:
        return ""
    largest = sorted(counts, key=lambda face: -counts[face])[:NAMED_FACES]
    return "; most lie at " + ", ".join(
        f"face:{numbers[face]} ({counts[face] / total:.0%})" for face in largest
    )


def _round_fields(faces: IntArray, size: float) -> list[int]:
    """Make the size fields of the walls of holes: coarser elements than their radius would cut
    through each other.
    """
    classes: dict[int, list[int]] = {}
    for face in map(int, faces):
        if gmsh.model.getType(2, face) not in ("Cylinder", "Cone"):
            continue
        low, high = gmsh.model.getParametrizationBounds(2, face)
        if high[0] - low[0] < ROUND:
            continue
        curvature = gmsh.model.getCurvature(
            2, face, [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2]
        )[0]
        if curvature * size > 1.0:
            classes.setdefault(
                int(np.ceil(CROWDED_PER_OCTAVE * np.log2(curvature * size))), []
            ).append(face)
    return [
        _add_field("SurfacesList", size * 2.0 ** (-step / CROWDED_PER_OCTAVE), tags)
        for step, tags in sorted(classes.items())
    ]
