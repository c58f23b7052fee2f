"""Element sizes on faces full of small holes and short edges, where sizes taken from the nearest edges would stay small everywhere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.cad.slivers import NAMED_FACES, list_faces
from headstock.meshing.component_mesh import IntArray

TRIANGLE = 2  # gmsh's number of its kind
TRIANGLES = 2.3  # per area / size^2
CROWDED_SHARE = 2.0  # times the triangles that the size alone makes
CROWDED_TRIANGLES = 5000
# a mesh may grow from size to size by 1.5 from element to element without bad elements
GROWTH = 0.5
SAMPLES = 20  # points of a short edge from which distances are taken
CLASSES_PER_OCTAVE = 2
SHORT_SHARE = 0.1
ROUND = 0.7 * np.pi  # the angle from which on a face goes round a hole, where an element that spans R turns by 60 degrees


@dataclass(frozen=True, eq=False)
class EdgeSizes:
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


def measure_edges(faces: Sequence[int], size: float) -> EdgeSizes:
    """How the meshed edges of the open gmsh model would fill its faces if sizes inside were those of the edges around them."""
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
        own = TRIANGLES * area / size**2
        number = sum(counts[curve] for curve in around)
        mean = sum(lengths[curve] for curve in around) / number if number else size
        extra.append(max(TRIANGLES * area / min(mean, size) ** 2 - own, 0.0) if mean > 0.0 else 0.0)
        plain += own
    tags = sorted(lengths)
    sizes = np.array([lengths[curve] / counts[curve] for curve in tags], dtype=float)
    return EdgeSizes(np.array(tags, dtype=np.int64), sizes, np.array(faces, dtype=np.int64), np.array(extra), plain)


def add_growth_fields(edges: EdgeSizes, *, size: float, smallest: float) -> list[int]:
    """Let elements grow from short edges, and return the tags of the fields.

    Args:
        edges: Of the open model.
        size: Element size far away.
        smallest: Where growth begins at edges that are shorter still.
    """
    starts = np.maximum(edges.sizes, smallest)
    steps = np.ceil(CLASSES_PER_OCTAVE * np.log2(size / starts) - 1e-9).astype(np.int64)
    classes = [
        (edges.curves[steps == step].tolist(), size * 2.0 ** (-step / CLASSES_PER_OCTAVE)) for step in np.unique(steps) if step > 0
    ]
    return [_grow(curves, start, size) for curves, start in classes] + _round_fields(edges.faces, size)


def describe_short_edges(edges: EdgeSizes, numbers: Mapping[int, int], *, smallest: float, unit: float) -> list[str]:
    """What a user should know of edges that are far shorter than the elements, with the faces they belong to.

    Args:
        edges: Of the open model.
        numbers: What ``face:N`` counts, by tag.
        smallest: Element size beside them.
        unit: Length of the model's unit [m].
    """
    short: list[int] = list(edges.curves[edges.sizes < SHORT_SHARE * smallest])
    if not short:
        return []
    touched = {int(face) for curve in short for face in gmsh.model.getAdjacencies(1, int(curve))[0]}
    named = list_faces([numbers[face] for face in touched if face in numbers])
    return [
        f"{len(short)} of {len(edges.curves)} edges, of {len(touched)} of {len(edges.faces)} faces{named},"
        f" are as short as {float(edges.sizes.min()) * unit:.2g} m; elements beside them are {smallest * unit:.2g} m (mesh.smallest)"
    ]


def name_finest_faces(numbers: Mapping[int, int]) -> str:
    """The faces that hold most triangles of a meshed surface, for a message; nothing before it is meshed."""
    counts = {face: len(gmsh.model.mesh.getElementsByType(TRIANGLE, face)[0]) for face in numbers}
    total = sum(counts.values())
    if not total:
        return ""
    largest = sorted(counts, key=lambda face: -counts[face])[:NAMED_FACES]
    return "; most lie at " + ", ".join(f"face:{numbers[face]} ({counts[face] / total:.0%})" for face in largest)


def _grow(curves: list[int], smallest: float, size: float) -> int:
    fields = gmsh.model.mesh.field
    distance = int(fields.add("Distance"))
    fields.setNumbers(distance, "CurvesList", curves)
    fields.setNumber(distance, "Sampling", SAMPLES)
    grown = int(fields.add("Threshold"))
    for name, value in (("InField", distance), ("SizeMin", smallest), ("SizeMax", size), ("DistMin", 0.0)):
        fields.setNumber(grown, name, value)
    fields.setNumber(grown, "DistMax", (size - smallest) / GROWTH)
    return grown


def _round_fields(faces: IntArray, size: float) -> list[int]:
    """The walls of holes: coarser elements than their radius would cut through each other."""
    classes: dict[int, list[int]] = {}
    for face in map(int, faces):
        if gmsh.model.getType(2, face) not in ("Cylinder", "Cone"):
            continue
        low, high = gmsh.model.getParametrizationBounds(2, face)
        if high[0] - low[0] < ROUND:
            continue
        curvature = gmsh.model.getCurvature(2, face, [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2])[0]
        if curvature * size > 1.0:
            classes.setdefault(int(np.ceil(CLASSES_PER_OCTAVE * np.log2(curvature * size))), []).append(face)
    found = []
    for step, tags in sorted(classes.items()):
        field = int(gmsh.model.mesh.field.add("Constant"))
        gmsh.model.mesh.field.setNumber(field, "VIn", size * 2.0 ** (-step / CLASSES_PER_OCTAVE))
        gmsh.model.mesh.field.setNumbers(field, "SurfacesList", tags)
        found.append(field)
    return found
