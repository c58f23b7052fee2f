"""Tool positions from CSV files: corners of a contour, and measured positions of axes or legs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import CORNERS
from headstock.scene.reading.forces import (
    ForceFileError,
    read_columns,
    read_numbers,
)

CORNER_COLUMNS = ("x", "y", "z")
FEED_COLUMN = "feed"
MOST_CORNERS = 2000


@dataclass(frozen=True, eq=False)
class PositionRecord:
    """Measured positions: ``(n,)`` rising times [s] and ``(n, k)`` values of axes or legs [m]."""

    times: FloatArray
    positions: FloatArray


def read_corners(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Corners ``(n, 3)`` of a contour from a CSV file with the columns ``x``, ``y``, ``z`` [m], and
    the feed rate to each corner ``(n,)`` [m/s] where it has a column ``feed``.

    Raises:
        ForceFileError: It cannot be read, has too many corners, or a feed rate that is not
            positive.
    """
    values = read_numbers(
        path, CORNER_COLUMNS, (FEED_COLUMN,), kind=CORNERS, most_rows=MOST_CORNERS
    )
    if values.shape[1] == len(CORNER_COLUMNS):
        return values, None
    feeds = values[:, 3]
    if not (feeds[1:] > 0.0).all():
        raise ForceFileError(
            f"{path.name}:{int(np.argmax(feeds[1:] <= 0.0)) + 3} has a feed rate that is not positive"
        )
    return values[:, :3], feeds


def read_positions(path: Path, names: tuple[str, ...]) -> PositionRecord:
    """Measured positions from a CSV file with the columns ``time`` [s] and one per name [m].

    Raises:
        ForceFileError: As :func:`headstock.scene.reading.forces.read_columns`.
    """
    values = read_columns(path, ("time", *(name.lower() for name in names)))
    return PositionRecord(values[:, 0], values[:, 1:])
