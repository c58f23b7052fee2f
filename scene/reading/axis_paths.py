"""Paths of axes from a CSV file: a header that names axes and units, a waypoint per row; every
fault is reported with its line.
"""

import csv
import math
import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import WAYPOINTS, Arrays, read_apart
from headstock.scene.reading.units import ANGLE, LENGTH, Unit, UnitError, read_unit, show_value

EXAMPLE = "X [mm],Y [mm]"
MOST_WAYPOINTS = 100_000
MOST_COLUMNS = 20
_HEADING = re.compile(r"([A-Za-z_][A-Za-z0-9_-]{0,63})\s*(?:\[([^\[\]]*)\])?")


class PathFileError(HeadstockError):
    """A file of waypoints cannot be used."""


@dataclass(frozen=True, eq=False)
class AxisPath:
    """Waypoints of axes.

    Attributes:
        units: ``m`` or ``rad`` of each.
        positions: ``(n, k)`` of every waypoint [m, rad].
        lines: ``(n,)`` of the file in which each stands.
    """

    name: str
    axes: tuple[str, ...]
    units: tuple[str, ...]
    positions: FloatArray
    lines: NDArray[np.int64]

    def waypoints(self) -> list[dict[str, float]]:
        """Axis to position [m, rad], one per waypoint."""
        return [dict(zip(self.axes, map(float, row), strict=True)) for row in self.positions]


def read_path(path: Path) -> AxisPath:
    """Read a CSV file whose first line names axes with their units, such as ``X [mm],B [deg]``;
    every other line is a waypoint.

    A position is the same number as that of a scene that writes it with the same digits and unit.

    Raises:
        PathFileError: A column has no axis or no unit of length or angle, an entry is no finite
            number, a row is too short or too long, or there are fewer than two or more than
            ``MOST_WAYPOINTS`` waypoints; says where.
    """
    found = read_apart(path, WAYPOINTS, parse_path, error=PathFileError)
    axes, units = (tuple(map(str, found[name])) for name in ("axes", "units"))
    return AxisPath(path.name, axes, units, found["positions"], found["lines"])


def parse_path(path: Path) -> Arrays:
    """The fields of an `AxisPath` from a file, without a look at its size."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return _read_rows(path.name, csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PathFileError(f"{path.name} cannot be read: {error}") from error


def _read_rows(name: str, rows: Iterator[list[str]]) -> Arrays:
    axes, units = _read_head(name, next(rows, []))
    numbers, lines = array("d"), array("q")
    # lines of the file, not rows: an entry in quotes may hold line ends, but no number does
    for line, row in enumerate(rows, 2):
        if not any(entry.strip() for entry in row):
            continue
        if len(lines) == MOST_WAYPOINTS:
            raise PathFileError(
                f"{name}:{line}: a path has {MOST_WAYPOINTS} waypoints at most; write fewer, or cut it in two"
            )
        numbers.extend(_read_row(f"{name}:{line}", row, axes, units))
        lines.append(line)
    if len(lines) < 2:
        raise PathFileError(
            f"{name} holds {len(lines)} waypoints; a path needs at least two, each in a line of its own"
        )
    positions = np.array(numbers).reshape(-1, len(axes)) + 0.0
    return {
        "axes": np.array(axes),
        "units": np.array([unit.dimension.unit for unit in units]),
        "positions": positions,
        "lines": np.array(lines),
    }


def _read_head(name: str, head: list[str]) -> tuple[tuple[str, ...], tuple[Unit, ...]]:
    if not any(entry.strip() for entry in head):
        raise PathFileError(
            f"{name}:1 names no axes; the first line names the columns, such as {EXAMPLE}"
        )
    if len(head) > MOST_COLUMNS:
        raise PathFileError(f"{name}:1 has {len(head)} columns; a path has {MOST_COLUMNS} at most")
    if len(head) == 1 and ";" in head[0]:
        raise PathFileError(
            f"{name}:1 holds semicolons; separate columns by commas and write numbers with a point: {EXAMPLE}"
        )
    found = [
        _read_heading(f"{name}:1", number, entry.strip()) for number, entry in enumerate(head, 1)
    ]
    axes = tuple(axis for axis, _ in found)
    for axis in axes:
        if axes.count(axis) > 1:
            raise PathFileError(f"{name}:1 names axis {axis} twice; keep one of the columns")
    return axes, tuple(unit for _, unit in found)


def _read_heading(place: str, number: int, text: str) -> tuple[str, Unit]:
    match = _HEADING.fullmatch(text)
    if match is None:
        raise PathFileError(
            f"{place}: column {number} is {show_value(text)} and names no axis with its unit; write {EXAMPLE}"
        )
    axis, unit = match[1], match[2]
    if unit is None:
        raise PathFileError(
            f'{place}: column {axis} has no unit; write "{axis} [mm]" or "{axis} [deg]"'
        )
    try:
        return axis, read_unit(unit.strip(), LENGTH, ANGLE)
    except UnitError as error:
        raise PathFileError(f"{place}: column {axis}: {error}") from error


def _read_row(
    place: str, row: list[str], axes: tuple[str, ...], units: tuple[Unit, ...]
) -> list[float]:
    shown = show_value(",".join(row))
    if len(row) != len(axes):
        hint = "; write numbers with a point, not a comma" if len(row) == 2 * len(axes) else ""
        raise PathFileError(
            f"{place} has {len(row)} entries, the first line has {len(axes)}: {shown}{hint}"
        )
    try:
        # decimal, as quantities of a scene are read: the same digits give the same number
        values = [
            float(Decimal(entry.strip()) * unit.factor)
            for entry, unit in zip(row, units, strict=True)
        ]
    except (ArithmeticError, ValueError) as error:
        raise PathFileError(f"{place} is no row of numbers: {shown}") from error
    if not all(map(math.isfinite, values)):
        raise PathFileError(f"{place} holds a value that is not finite: {shown}; write a position")
    return values
