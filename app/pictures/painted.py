"""Pictures by matplotlib, far faces first: what is left where VTK finds no display."""

from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from headstock.app.pictures.scenes import Picture, camera_axes

DPI = 100
LIGHT = np.array([0.35, 0.55, 0.75]) / np.linalg.norm([0.35, 0.55, 0.75])


def paint(pictures: list[Picture]) -> dict[str, NDArray[np.uint8]]:
    """Draw pictures: name to ``(height, width, 4)`` red, green, blue, opacity on a transparent
    ground.
    """
    return {picture.name: _paint_one(picture) for picture in pictures}


def _paint_one(picture: Picture) -> NDArray[np.uint8]:
    axes_of_view = camera_axes()
    seen = picture.points @ axes_of_view.T
    corners = seen[picture.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    front = normals[:, 2] > 0.0
    order = np.flatnonzero(front)[np.argsort(corners[front, :, 2].mean(axis=1), kind="stable")]
    shade = 0.45 + 0.55 * np.clip(normals[order] @ LIGHT, 0.0, 1.0)
    colors = np.clip(
        picture.colors[picture.triangles[order]].mean(axis=1) * shade[:, None], 0.0, 1.0
    )
    width, height = picture.size
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    canvas: Any = FigureCanvasAgg(figure)
    figure.patch.set_alpha(0.0)
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.add_collection(
        PolyCollection(
            list(corners[order, :, :2]), facecolors=colors, edgecolors=colors, linewidths=0.4
        )
    )
    if picture.ghost is not None:
        rest = picture.ghost @ axes_of_view.T
        axes.add_collection(
            LineCollection(list(rest[picture.edges][:, :, :2]), colors="#9aa0a8", linewidths=0.6)
        )
    for places, color, size in ((picture.marks, "#d97706", 14.0), (picture.tools, "#cc1a33", 40.0)):
        flat = places @ axes_of_view.T
        axes.scatter(flat[:, 0], flat[:, 1], s=size, c=color, zorder=5)
    axes.autoscale_view()
    canvas.draw()
    return np.array(canvas.buffer_rgba(), dtype=np.uint8)
