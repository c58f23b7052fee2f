"""Pictures by pyvista, off-screen. Without any OpenGL VTK may end the process: only ``worker``
calls this.
"""

import io
from dataclasses import replace

import numpy as np

from headstock.app.pictures.picture import Marks, Picture, PictureFrame, frame_picture
from headstock.geometry.frames import FloatArray
from headstock.geometry.loading import load_library
from headstock.meshing.component_mesh import IntArray

if load_library("pyvista"):
    import pyvista

Color = tuple[float, float, float]
EDGE_COLOR: Color = (0.10, 0.13, 0.18)
GHOST_COLOR: Color = (0.55, 0.58, 0.62)
# three lamps that move with the camera: direction in its axes and strength
LAMPS = (((0.3, 0.6, 1.0), 0.82), ((-0.8, 0.3, 0.4), 0.33), ((0.9, -0.5, 0.3), 0.22))
LOOK = {"ambient": 0.42, "diffuse": 0.72, "specular": 0.08, "specular_power": 20.0}
SHARP_DEG = 35.0
EDGE_WIDTH, GHOST_WIDTH = 1.4, 0.9  # pixels
FINENESS = 3.0
WINDOW_OPACITY = 0.6


def draw_pictures(pictures: list[Picture]) -> dict[str, bytes]:
    """Draw pictures: name to a PNG file on a transparent ground."""
    return {picture.name: _draw_one(picture) for picture in pictures}


def _draw_one(picture: Picture) -> bytes:
    plotter = pyvista.Plotter(off_screen=True, window_size=list(picture.size), lighting="none")
    _compose_picture(plotter, picture)
    if picture.flat:
        plotter.disable_anti_aliasing()
        plotter.render_window.SetMultiSamples(0)
    else:
        plotter.enable_anti_aliasing("ssaa")
    file = io.BytesIO()
    plotter.screenshot(file, transparent_background=True)
    plotter.close()
    return file.getvalue()


def open_window(pictures: list[Picture]) -> None:
    """Show the first picture in a window, to be turned with the mouse, until it is closed."""
    picture = pictures[0]
    plotter = pyvista.Plotter(window_size=list(picture.size), lighting="none", title=picture.name)
    plotter.enable_anti_aliasing("msaa")
    # nothing moved in front: it would be elsewhere as soon as the view turns
    marks = tuple(replace(marks, in_front=False) for marks in picture.marks)
    _compose_picture(plotter, replace(picture, marks=marks), fineness=1.0, opacity=WINDOW_OPACITY)
    plotter.set_background("white")
    plotter.add_axes()
    for color in dict.fromkeys(note.color for note in picture.notes):
        notes = [note for note in picture.notes if note.color == color]
        plotter.add_point_labels(
            np.array([note.place for note in notes]),
            [note.text for note in notes],
            text_color=color,
            font_size=14,
            shape_opacity=0.6,
            shape_color="white",
            show_points=False,
            always_visible=True,
        )
    plotter.show()


def _compose_picture(
    plotter: pyvista.Plotter, picture: Picture, *, fineness: float = FINENESS, opacity: float = 1.0
) -> None:
    """Put everything that a picture shows in front of a plotter's camera.

    Args:
        fineness: Pixels that are drawn for one that is seen, in each direction.
    """
    for position, strength in LAMPS:
        plotter.add_light(
            pyvista.Light(light_type="camera light", position=position, intensity=strength)
        )
    frame = frame_picture(picture)
    _add_surface(plotter, picture, opacity)
    if not picture.flat:
        _add_lines(plotter, picture.points, picture.edges, EDGE_COLOR, fineness * EDGE_WIDTH)
    if picture.ghost is not None:
        _add_lines(plotter, picture.ghost, picture.edges, GHOST_COLOR, fineness * GHOST_WIDTH)
    for marks in picture.marks:
        _add_marks(plotter, marks, frame)
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = frame.middle
    camera.position = frame.middle + 4.0 * frame.reach * frame.towards
    camera.up = (0.0, 0.0, 1.0)
    camera.parallel_scale = frame.half_height
    plotter.renderer.ResetCameraClippingRange()


def _add_marks(plotter: pyvista.Plotter, marks: Marks, frame: PictureFrame) -> None:
    if not len(marks.places):
        return
    # seen along parallel rays, a mark that is moved towards the viewer stays where it is and is
    # hidden by nothing
    shift = 2.0 * frame.reach * frame.towards if marks.in_front else np.zeros(3)
    cloud = pyvista.PolyData(marks.places + shift)
    size = marks.share * frame.reach
    if marks.shape == "ball":
        form = pyvista.Sphere(radius=size, theta_resolution=20, phi_resolution=14)
    elif marks.shape == "arrow":
        form = pyvista.Arrow(scale=size, tip_length=0.3, tip_radius=0.09, shaft_radius=0.035)
    else:
        form = pyvista.Cone(
            center=(0.5 * size, 0.0, 0.0),
            direction=(-1.0, 0.0, 0.0),
            height=size,
            radius=0.6 * size,
            resolution=24,
        )
    if marks.directions is not None:
        cloud["direction"] = marks.directions
    along = False if marks.directions is None else "direction"
    plotter.add_mesh(
        cloud.glyph(geom=form, scale=False, orient=along), color=marks.color, ambient=0.4
    )


def _add_surface(plotter: pyvista.Plotter, picture: Picture, opacity: float) -> None:
    surface = pyvista.PolyData.from_regular_faces(picture.points, picture.triangles)
    surface["color"] = (255.0 * picture.colors).round().astype(np.uint8)
    if picture.flat:
        plotter.add_mesh(surface, scalars="color", rgb=True, lighting=False)
        return
    actor = plotter.add_mesh(
        surface,
        scalars="color",
        rgb=True,
        smooth_shading=True,
        split_sharp_edges=True,
        feature_angle=SHARP_DEG,
        opacity=opacity,
        **LOOK,
    )
    # edges lie on the surface: push it back a little
    actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
    actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)


def _add_lines(
    plotter: pyvista.Plotter, points: FloatArray, edges: IntArray, color: Color, width: float
) -> None:
    if len(edges):
        lines = np.column_stack([np.full(len(edges), 2), edges]).ravel()
        plotter.add_mesh(
            pyvista.PolyData(points, lines=lines), color=color, line_width=width, lighting=False
        )
