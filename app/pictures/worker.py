"""Child process that draws: ``worker KIND SOURCE TARGET``, with KIND charts of the folder SOURCE, or
pictures, or a window, of the open file with the number SOURCE.
"""

import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

LIFETIME = 150  # seconds
# imported where they are used: nothing is drawn before what it needs is loaded
CHARTS = "headstock.app.charts.results"
PICTURE, RENDERER = "headstock.app.pictures.picture", "headstock.app.pictures.renderer"


def main(arguments: list[str]) -> int:
    """Draw everything that is wanted and write it to the open file TARGET (npz of PNG files)."""
    kind, source, target = arguments
    if kind == "charts":
        signal.alarm(LIFETIME)  # where nobody waits any more
        images = importlib.import_module(CHARTS).draw_folder(Path(source))
    else:
        with os.fdopen(int(source), "rb") as file:
            pictures = importlib.import_module(PICTURE).read_pictures(file)
        renderer = importlib.import_module(RENDERER)
        if kind == "window":
            renderer.open_window(pictures)
            return 0
        signal.alarm(LIFETIME)
        images = renderer.draw_pictures(pictures)
    packed: dict[str, Any] = {
        name: np.frombuffer(image, dtype=np.uint8) for name, image in images.items()
    }
    with os.fdopen(int(target), "wb") as file:
        np.savez(file, **packed)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
