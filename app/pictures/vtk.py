"""Pictures by VTK's off-screen renderer. Without a display VTK may end the process: only
``worker`` calls this.
"""

import numpy as np
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  registers the renderer
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersCore import vtkPolyDataNormals
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkLight,
    vtkPolyDataMapper,
    vtkRenderer,
    vtkRenderWindow,
    vtkWindowToImageFilter,
)

from headstock.app.pictures.scenes import CAMERA, Picture, camera_axes
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray

MARK_COLOR = (0.85, 0.47, 0.02)
TOOL_COLOR = (0.80, 0.10, 0.20)
EDGE_COLOR = (0.10, 0.13, 0.18)
GHOST_COLOR = (0.55, 0.58, 0.62)
MARGIN = 1.06
# radius of a mark against the size of the machine
MARK_SHARE, TOOL_SHARE = 0.006, 0.010


def draw_with_vtk(pictures: list[Picture]) -> dict[str, NDArray[np.uint8]]:
    """Draw pictures: name to ``(height, width, 4)`` red, green, blue, opacity on a transparent
    ground.
    """
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetAlphaBitPlanes(1)
    window.SetMultiSamples(8)
    window.SetNumberOfLayers(2)
    found = {}
    for picture in pictures:
        renderer = _compose(picture)
        marks = _mark_points(picture, renderer)
        window.SetSize(*picture.size)
        window.AddRenderer(renderer)
        window.AddRenderer(marks)
        window.Render()
        grab = vtkWindowToImageFilter()
        grab.SetInput(window)
        grab.SetInputBufferTypeToRGBA()
        grab.ReadFrontBufferOff()
        grab.Update()
        image = grab.GetOutput()
        width, height, _ = image.GetDimensions()
        pixels = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 4)
        found[picture.name] = np.ascontiguousarray(pixels[::-1])
        window.RemoveRenderer(renderer)
        window.RemoveRenderer(marks)
    return found


def _compose(picture: Picture) -> vtkRenderer:
    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.SetBackgroundAlpha(0.0)
    renderer.AutomaticLightCreationOff()
    _add_lights(renderer)
    renderer.AddActor(_surface(picture))
    renderer.AddActor(_lines(picture.points, picture.edges, EDGE_COLOR, 1.6))
    if picture.ghost is not None:
        renderer.AddActor(_lines(picture.ghost, picture.edges, GHOST_COLOR, 1.0))
    everything = (
        picture.points if picture.ghost is None else np.vstack([picture.points, picture.ghost])
    )
    reach = float(np.linalg.norm(np.ptp(everything, axis=0)))
    for place in picture.marks:
        renderer.AddActor(_ball(place, MARK_SHARE * reach, MARK_COLOR))
    _place_camera(renderer, everything, picture.size, reach)
    return renderer


def _mark_points(picture: Picture, below: vtkRenderer) -> vtkRenderer:
    """The named points in a layer above, so that no body hides them."""
    renderer = vtkRenderer()
    renderer.SetLayer(1)
    renderer.SetActiveCamera(below.GetActiveCamera())
    renderer.AutomaticLightCreationOff()
    _add_lights(renderer)
    reach = float(np.linalg.norm(np.ptp(picture.points, axis=0)))
    for place in picture.tools:
        renderer.AddActor(_ball(place, TOOL_SHARE * reach, TOOL_COLOR))
    return renderer


def _add_lights(renderer: vtkRenderer) -> None:
    for position, strength in (
        ((0.3, 0.6, 1.0), 0.82),
        ((-0.8, 0.3, 0.4), 0.33),
        ((0.9, -0.5, 0.3), 0.22),
    ):
        light = vtkLight()
        light.SetLightTypeToCameraLight()
        light.SetPosition(*position)
        light.SetFocalPoint(0.0, 0.0, 0.0)
        light.SetIntensity(strength)
        renderer.AddLight(light)


def _surface(picture: Picture) -> vtkActor:
    data = _poly_data(picture.points)
    data.SetPolys(_cells(picture.triangles))
    colors = numpy_to_vtk((255.0 * picture.colors).round().astype(np.uint8), deep=True)
    data.GetPointData().SetScalars(colors)
    normals = vtkPolyDataNormals()
    normals.SetInputData(data)
    normals.SetFeatureAngle(35.0)
    normals.ConsistencyOff()
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    # edges lie on the surface: push it back a little
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
    actor = vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetAmbient(0.42)
    look.SetDiffuse(0.72)
    look.SetSpecular(0.08)
    look.SetSpecularPower(20.0)
    return actor


def _lines(points: FloatArray, edges: IntArray, color: tuple[float, ...], width: float) -> vtkActor:
    data = _poly_data(points)
    data.SetLines(_cells(edges))
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(data)
    actor = vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetColor(*color)
    look.SetLineWidth(width)
    look.LightingOff()
    return actor


def _ball(place: FloatArray, radius: float, color: tuple[float, ...]) -> vtkActor:
    source = vtkSphereSource()
    source.SetRadius(radius)
    source.SetCenter(*place)
    source.SetThetaResolution(20)
    source.SetPhiResolution(14)
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(source.GetOutputPort())
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*color)
    actor.GetProperty().SetAmbient(0.4)
    return actor


def _place_camera(
    renderer: vtkRenderer, points: FloatArray, size: tuple[int, int], reach: float
) -> None:
    axes = camera_axes()
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = axes.T @ (0.5 * (low + high))
    half = 0.5 * (high - low)
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(*middle)
    camera.SetPosition(*(middle + 2.0 * reach * CAMERA))
    camera.SetViewUp(0.0, 0.0, 1.0)
    camera.SetParallelScale(MARGIN * max(half[1], half[0] * size[1] / size[0], 1e-9))
    renderer.ResetCameraClippingRange()


def _poly_data(points: FloatArray) -> vtkPolyData:
    places = vtkPoints()
    places.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32), deep=True))
    data = vtkPolyData()
    data.SetPoints(places)
    return data


def _cells(rows: IntArray) -> vtkCellArray:
    width = rows.shape[1]
    cells = vtkCellArray()
    table = np.hstack([np.full((len(rows), 1), width), rows]).astype(np.int64).ravel()
    cells.SetCells(len(rows), numpy_to_vtkIdTypeArray(table, deep=True))
    return cells
