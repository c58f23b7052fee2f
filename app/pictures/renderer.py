"""Pictures by pyvista, off-screen. Without any OpenGL VTK may end the process: only ``worker``
calls this.
"""

import io

import numpy as np
import pyvista

from headstock.app.pictures.scenes import Picture, frame_picture
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray

Color = tuple[float, float, float]
EDGE_COLOR: Color = (0.10, 0.13, 0.18)
GHOST_COLOR: Color = (0.55, 0.58, 0.62)
# three lamps that move with the camera: direction in its axes and strength
LAMPS = (((0.3, 0.6, 1.0), 0.82), ((-0.8, 0.3, 0.4), 0.33), ((0.9, -0.5, 0.3), 0.22))
LOOK = {"ambient": 0.42, "diffuse": 0.72, "specular": 0.08, "specular_power": 20.0}
SHARP_DEG = 35.0
# widths in pixels of the finer grid on which edges are smoothed
EDGE_WIDTH, GHOST_WIDTH = 4.2, 2.6


def draw_pictures(pictures: list[Picture]) -> dict[str, bytes]:
    """Draw pictures: name to a PNG file on a transparent ground."""
    return {picture.name: _draw_one(picture) for picture in pictures}


def _draw_one(picture: Picture) -> bytes:
    plotter = pyvista.Plotter(off_screen=True, window_size=list(picture.size), lighting="none")
    compose_picture(plotter, picture)
    if picture.flat:
        plotter.disable_anti_aliasing()
        plotter.render_window.SetMultiSamples(0)
    else:
        plotter.enable_anti_aliasing("ssaa")
    file = io.BytesIO()
    plotter.screenshot(file, transparent_background=True)
    plotter.close()
    return file.getvalue()


def compose_picture(plotter: pyvista.Plotter, picture: Picture) -> None:
    """Put everything that a picture shows in front of a plotter's camera."""
    for position, strength in LAMPS:
        plotter.add_light(
            pyvista.Light(light_type="camera light", position=position, intensity=strength)
        )
    frame = frame_picture(picture)
    _add_surface(plotter, picture)
    if not picture.flat:
        _add_lines(plotter, picture.points, picture.edges, EDGE_COLOR, EDGE_WIDTH)
    if picture.ghost is not None:
        _add_lines(plotter, picture.ghost, picture.edges, GHOST_COLOR, GHOST_WIDTH)
    for mark in picture.marks:
        # seen along parallel rays, a mark that is moved towards the viewer stays where it is and
        # is hidden by nothing
        places = mark.places + (2.0 * frame.reach * frame.towards if mark.in_front else 0.0)
        ball = pyvista.Sphere(
            radius=mark.share * frame.reach, theta_resolution=20, phi_resolution=14
        )
        if len(places):
            plotter.add_mesh(
                pyvista.PolyData(places).glyph(geom=ball, scale=False, orient=False),
                color=mark.color,
                ambient=0.4,
            )
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = frame.middle
    camera.position = frame.middle + 4.0 * frame.reach * frame.towards
    camera.up = (0.0, 0.0, 1.0)
    camera.parallel_scale = frame.half_height
    plotter.renderer.ResetCameraClippingRange()


def _add_surface(plotter: pyvista.Plotter, picture: Picture) -> None:
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
