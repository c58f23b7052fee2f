"""Surfaces with fewer triangles by VTK, for pictures that are to stay small: what is seen of them
stays where it was. Loaded where a surface is too fine, as VTK takes a third of a second.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import mutable, vtkObject, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkStaticCellLocator
from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.skins import IntArray, Skin, sharp_edges
from headstock.meshing.errors import MeshError

# how much the squares of the coordinates over the size, a field that bends, count beside the
# shape: without them VTK leaves flat walls without points to bend with
BEND_WEIGHT = 0.02
# Sharp edges are drawn as lines. Theirs may change in length by this share, as much as a zigzag of
# one pixel every six: more are lines over fillets that came apart into facets, or lines lost.
LARGEST_EDGE_CHANGE = 0.05
# where triangles are compared with the original: their middle, next to corners, next to middles of
# sides
SAMPLES = np.array(
    [
        [1 / 3, 1 / 3, 1 / 3],
        [0.8, 0.1, 0.1],
        [0.1, 0.8, 0.1],
        [0.1, 0.1, 0.8],
        [0.1, 0.45, 0.45],
        [0.45, 0.1, 0.45],
        [0.45, 0.45, 0.1],
    ]
)
# a triangle whose nearest place on the original faces away by more than 120 degrees is nearer to
# the other side of a wall than to its own
OTHER_SIDE = -0.5
GROWTH = 1.5  # triangles of the next try over those of one that broke a limit


@dataclass(frozen=True, eq=False)
class _Surface:
    """Triangles ``(m, 3)`` of points ``(n, 3)`` [m], and VTK's search for the nearest of them."""

    points: FloatArray
    triangles: IntArray
    locator: vtkStaticCellLocator


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Places ``(k, 3)`` on a surface and the triangle ``(k,)`` that each lies in."""

    places: FloatArray
    triangles: IntArray


def reduce_skin(skin: Skin, *, largest: int, tolerance: float) -> Skin:
    """Return the same surface with the fewest triangles, from ``largest`` up, with which it keeps
    its form, stays within the tolerance, keeps its sharp edges, and the sides of its walls stay
    apart.

    Its points lie on triangles of the original, so that a field known at the points of those is
    known there.

    Args:
        skin: The surface; edges of more than two triangles are refused.
        largest: How many triangles there may be if the limits allow it.
        tolerance: How far the two surfaces may be apart anywhere [m].

    Raises:
        MeshError: No smaller surface keeps within the limits; says why.

    Source: Garland and Heckbert (1997), quadric error metrics; Hoppe (1999) for attributes.
    """
    form = _find_form(skin.triangles)
    if form is None:
        raise MeshError("edges of it belong to more than two triangles")
    whole = _search(skin.points, skin.triangles)
    wanted = float(largest)
    while wanted < len(skin.triangles):
        reduced = _decimate(skin, whole, share=1.0 - wanted / len(skin.triangles))
        if (
            reduced is not None
            and _find_form(reduced.triangles) == form
            and _keeps_edges(skin, reduced)
            and _keeps_places(whole, reduced, tolerance)
        ):
            return reduced
        wanted *= GROWTH
    raise MeshError("fewer would show another shape")


def _decimate(skin: Skin, whole: _Surface, *, share: float) -> Skin | None:
    """Return the surface without a share of its triangles, its points moved onto the original; None
    where VTK fails.
    """
    size = float(np.linalg.norm(np.ptp(skin.points, axis=0)))
    middle = 0.5 * (skin.points.min(axis=0) + skin.points.max(axis=0))
    surface = _poly_data((skin.points - middle) / size, skin.triangles)
    bend = numpy_to_vtk(np.ascontiguousarray(((skin.points - middle) / size) ** 2), deep=True)
    bend.SetName("bend")
    surface.GetPointData().SetVectors(bend)
    step = vtkQuadricDecimation()
    step.SetInputData(surface)
    step.SetTargetReduction(share)
    step.VolumePreservationOn()
    step.AttributeErrorMetricOn()
    step.ScalarsAttributeOff()
    step.NormalsAttributeOff()
    step.TCoordsAttributeOff()
    step.TensorsAttributeOff()
    step.VectorsAttributeOn()
    step.SetVectorsWeight(BEND_WEIGHT)
    _run_silently(step)
    output = step.GetOutput()
    flat = vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    used, numbers = np.unique(flat, return_inverse=True)
    places = vtk_to_numpy(output.GetPoints().GetData()).astype(np.float64)[used] * size + middle
    if not 0 < len(flat) < len(skin.triangles) or not np.isfinite(places).all():
        return None
    return _project(skin, whole, places=places, triangles=numbers.reshape(-1, 3))


def _run_silently(step: vtkQuadricDecimation) -> None:
    """Run a step without VTK's line of warning for each edge whose quadric has no single lowest
    point, as on a flat wall: it then takes the middle, and what came out is checked here.
    """
    display = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        step.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(display)


def _project(skin: Skin, whole: _Surface, *, places: FloatArray, triangles: IntArray) -> Skin:
    """Return points moved onto the nearest original triangle, with shares of its corners."""
    nearest = _find_nearest(whole, places)
    sources = skin.triangles[nearest.triangles]
    a, b, c = (skin.points[sources[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    area = np.where(area > 0.0, area, 1.0)
    second = np.einsum("ij,ij->i", np.cross(nearest.places - a, c - a), normal) / area
    third = np.einsum("ij,ij->i", np.cross(b - a, nearest.places - a), normal) / area
    shares = np.clip(np.column_stack([1.0 - second - third, second, third]), 0.0, 1.0)
    shares /= shares.sum(axis=1, keepdims=True)
    points = np.einsum("ij,ijk->ik", shares, skin.points[sources])
    nodes = weights = None
    if skin.nodes is not None and skin.weights is not None:
        nodes = skin.nodes[sources].reshape(len(points), -1)
        weights = (shares[:, :, None] * skin.weights[sources]).reshape(len(points), -1)
    return Skin(
        points,
        triangles,
        sharp_edges(points, triangles),
        skin.source,
        nodes,
        weights,
        thinned_from=skin.thinned_from or len(skin.triangles),
    )


def _find_form(triangles: IntArray) -> tuple[int, bool] | None:
    """Return Euler's number and whether the surface is open; None where an edge belongs to more
    than two triangles, or to two that do not go on in one another.
    """
    ways = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = int(triangles.max()) + 1
    forth, back = ways @ [count, 1], ways @ [1, count]
    if len(np.unique(forth)) != len(forth):
        return None
    edges = len(np.unique(np.minimum(forth, back)))
    return len(np.unique(triangles)) - edges + len(triangles), 2 * edges != len(ways)


def _keeps_edges(skin: Skin, reduced: Skin) -> bool:
    before, after = (
        float(np.linalg.norm(np.diff(surface.points[edges], axis=1), axis=2).sum())
        for surface in (skin, reduced)
        for edges in [sharp_edges(surface.points, surface.triangles)]
    )
    return abs(after - before) <= LARGEST_EDGE_CHANGE * before


def _keeps_places(whole: _Surface, reduced: Skin, tolerance: float) -> bool:
    """Return whether two surfaces are nowhere apart by more than the tolerance, and every triangle
    is nearer to what it stands for than to the other side of a wall.
    """
    tried = np.einsum("sc,mck->msk", SAMPLES, reduced.points[reduced.triangles]).reshape(-1, 3)
    there = _find_nearest(whole, tried)
    back = _find_nearest(_search(reduced.points, reduced.triangles), whole.points)
    apart = np.vstack([there.places - tried, back.places - whole.points])
    if np.linalg.norm(apart, axis=1).max() > tolerance:
        return False
    reduced_normals = np.repeat(_normals(reduced.points, reduced.triangles), len(SAMPLES), axis=0)
    original = _normals(whole.points, whole.triangles)[there.triangles]
    return bool(np.einsum("ij,ij->i", reduced_normals, original).min() > OTHER_SIDE)


def _normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0.0, lengths, 1.0)


def _search(points: FloatArray, triangles: IntArray) -> _Surface:
    locator = vtkStaticCellLocator()
    locator.SetDataSet(_poly_data(points, triangles))
    locator.BuildLocator()
    return _Surface(points, triangles, locator)


def _find_nearest(surface: _Surface, places: FloatArray) -> _Nearest:
    # VTK writes into these; its types call them plain numbers
    cell: Any = mutable(0)
    part: Any = mutable(0)
    squared: Any = mutable(0.0)
    nearest = [0.0, 0.0, 0.0]
    closest, cells = np.empty_like(places), np.empty(len(places), dtype=np.int64)
    rows = zip(*(places[:, axis].tolist() for axis in range(3)), strict=True)
    for index, nearby in enumerate(rows):
        surface.locator.FindClosestPoint(nearby, nearest, cell, part, squared)
        closest[index], cells[index] = nearest, int(cell)
    return _Nearest(closest, cells)


def _poly_data(points: FloatArray, triangles: IntArray) -> vtkPolyData:
    cloud = vtkPoints()
    cloud.SetDataTypeToDouble()
    cloud.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    cells = vtkCellArray()
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(triangles.ravel()), deep=True))
    surface = vtkPolyData()
    surface.SetPoints(cloud)
    surface.SetPolys(cells)
    return surface
