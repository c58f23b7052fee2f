"""Child process that draws a folder of results: ``worker DIR TARGET vtk|painted
machine|all``.
"""

import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

from headstock.app.pictures.png_images import encode_png
from headstock.app.pictures.scenes import Picture, mode_picture, rest_picture
from headstock.pipeline.results.files import read_curves, read_summary, read_view
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.results.views import MachineView, component_colors

MACHINE_SIZE = (1500, 960)
MODE_SIZE = (720, 480)
MODES_DRAWN = 40
LIFETIME = 150  # seconds
CHARTS = "headstock.app.charts.charts"
RENDERERS = {
    "vtk": ("headstock.app.pictures.vtk", "draw_with_vtk"),
    "painted": ("headstock.app.pictures.painted", "paint"),
}


def list_machine_pictures(view: MachineView) -> list[Picture]:
    """The machine in each pose."""
    return [
        rest_picture(f"machine_{file_stem(name)}", view, pose, MACHINE_SIZE)
        for name, pose in view.poses.items()
    ]


def list_mode_pictures(summary: RunSummary, view: MachineView) -> list[Picture]:
    """The modes of each pose."""
    return [
        mode_picture(
            f"mode_{file_stem(modes['pose_name'])}_{index + 1:02d}",
            view,
            view.poses[modes["pose_name"]],
            index,
            MODE_SIZE,
        )
        for modes in summary["modal"]
        if view.poses[modes["pose_name"]].shifts
        for index in range(min(len(modes["frequencies_hz"]), MODES_DRAWN))
    ]


def main(arguments: list[str]) -> int:
    """Draw everything that is wanted and write it to the open file with the number TARGET (npz of
    PNG files).
    """
    signal.alarm(LIFETIME)  # where nobody waits any more
    folder, target = Path(arguments[0]), int(arguments[1])
    renderer, wanted = arguments[2:]
    view = read_view(folder)
    pictures = list_machine_pictures(view)
    images = {}
    if wanted == "all":
        # matplotlib takes most of a second to import
        charts = importlib.import_module(CHARTS)
        summary = read_summary(folder)
        pictures += list_mode_pictures(summary, view)
        images = charts.draw_charts(summary, component_colors(view))
        images |= importlib.import_module(CHARTS).draw_responses(read_curves(folder))
    if view.skins:
        module, function = RENDERERS[renderer]
        images |= getattr(importlib.import_module(module), function)(pictures)
    packed: dict[str, Any] = {
        name: np.frombuffer(encode_png(pixels), dtype=np.uint8) for name, pixels in images.items()
    }
    with os.fdopen(target, "wb") as file:
        np.savez(file, **packed)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
