"""Child process that draws: ``worker KIND SOURCE TARGET``, with KIND machine, modes or charts of the
folder SOURCE, or pictures, or a window, of the record in the open file with the number SOURCE.
"""

import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from headstock.app.pictures.scenes import Picture, PictureList, mode_picture, rest_picture
from headstock.pipeline.results.files import read_curves, read_summary, read_view
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.results.views import MachineView, component_colors
from headstock.pipeline.storage.records import read_record

MACHINE_SIZE = (1500, 960)
MODE_SIZE = (720, 480)
MODES_DRAWN = 40
LIFETIME = 150  # seconds
# imported where they are used: pyvista and matplotlib take most of a second each
CHARTS = "headstock.app.charts.charts"
RENDERER = "headstock.app.pictures.renderer"


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
    """Draw everything that is wanted and write it to the open file TARGET (npz of PNG files)."""
    kind, source, target = arguments
    if kind == "window":
        importlib.import_module(RENDERER).open_window(_read_pictures(int(source)))
        return 0
    signal.alarm(LIFETIME)  # where nobody waits any more
    if kind == "charts":
        images = _draw_charts(Path(source))
    else:
        if kind == "pictures":
            pictures = _read_pictures(int(source))
        else:
            view = read_view(Path(source))
            pictures = (
                list_machine_pictures(view)
                if kind == "machine"
                else list_mode_pictures(read_summary(Path(source)), view)
            )
        images = importlib.import_module(RENDERER).draw_pictures(pictures) if pictures else {}
    packed: dict[str, Any] = {
        name: np.frombuffer(image, dtype=np.uint8) for name, image in images.items()
    }
    with os.fdopen(int(target), "wb") as file:
        np.savez(file, **packed)
    return 0


def _read_pictures(source: int) -> list[Picture]:
    with os.fdopen(source, "rb") as file, h5py.File(file, "r") as record:
        return list(read_record(record, PictureList).pictures)


def _draw_charts(folder: Path) -> dict[str, bytes]:
    charts, view = importlib.import_module(CHARTS), read_view(folder)
    return {
        **charts.draw_charts(read_summary(folder), component_colors(view)),
        **charts.draw_responses(read_curves(folder)),
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
