"""CSV files that a scene refers to: measured forces and positions, corners of contours and waypoints of
axes; every fault is reported with its line.
"""

import csv
import math
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import (
    CORNERS,
    RECORD,
    SMALL_BYTES,
    WAYPOINTS,
    FileKind,
    read_apart,
)
from headstock.meshing.process.worker import Arrays
from headstock.scene.reading.units import (
    ANGLE,
    FORCE,
    LENGTH,
    Dimension,
    Unit,
    UnitError,
    quote_value,
    read_unit,
)

FORCE_COLUMNS = ("time", "fx", "fy", "fz")
CORNER_COLUMNS = ("x", "y", "z")
FEED_COLUMN = "feed"
MOST_CORNERS = 2000
LARGEST_GAP = 5.0  # in typical sample distances: beyond it something is missing, not uneven
WAYPOINT_EXAMPLE = "X [mm],Y [mm]"
PUSH_COLUMNS = {"force": FORCE, "displacement": LENGTH}
PUSH_EXAMPLE = "force [N],displacement [um]"
MOST_PUSHES = 10_000
MOST_WAYPOINTS = 100_000
MOST_COLUMNS = 20
_UNITS = {LENGTH: "mm", ANGLE: "deg", FORCE: "N"}  # as columns are often written
_HEADING = re.compile(r"([A-Za-z_][A-Za-z0-9_-]{0,63})\s*(?:\[([^\[\]]*)\])?")
type Rows = Iterator[tuple[int, list[str]]]


class CsvError(HeadstockError):
    """A CSV file cannot be used."""


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Measured forces: ``(n,)`` rising times [s] and ``(n, k)`` values, such as the three forces on
    the tool in the machine frame [N].
    """

    times: FloatArray
    forces: FloatArray


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


def read_forces(path: Path) -> ForceRecord:
    """Read a CSV file with the columns ``time`` [s], ``fx``, ``fy``, ``fz`` [N].

    Raises:
        CsvError: As ``read_history``.
    """
    return ForceRecord(*read_history(path, FORCE_COLUMNS[1:]))


def read_history(path: Path, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Read times ``(n,)`` [s] and values ``(n, k)`` of a CSV file with the columns ``time`` and one per
    name, whatever their capitals.

    Raises:
        CsvError: A column is missing, an entry is no finite number, times do not rise, or samples
            are missing; says where.
    """
    values = _read_columns(path, RECORD, ("time", *(name.lower() for name in names)))
    _check_times(path, values[:, 0])
    return values[:, 0], values[:, 1:]


def read_corners(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Corners ``(n, 3)`` of a contour from a CSV file with the columns ``x``, ``y``, ``z`` [m], and
    the feed rate to each corner ``(n,)`` [m/s] where it has a column ``feed``.

    Raises:
        CsvError: It cannot be read, has too many corners, or a feed rate that is not positive.
    """
    values = _read_columns(path, CORNERS, CORNER_COLUMNS, (FEED_COLUMN,), most_rows=MOST_CORNERS)
    if values.shape[1] == len(CORNER_COLUMNS):
        return values, None
    feeds = values[:, 3]
    if not (feeds[1:] > 0.0).all():
        raise CsvError(
            f"{path.name}:{int(np.argmax(feeds[1:] <= 0.0)) + 3} has a feed rate that is not positive"
        )
    return values[:, :3], feeds


def read_waypoints(path: Path) -> AxisPath:
    """Read a CSV file whose first line names axes with their units, such as ``X [mm],B [deg]``;
    every other line is a waypoint.

    A position is the same number as that of a scene that writes it with the same digits and unit.

    Raises:
        CsvError: A column has no axis or no unit of length or angle, an entry is no finite number, a
            row is too short or too long, or there are fewer than two or more than
            ``MOST_WAYPOINTS`` waypoints; says where.
    """
    arrays = read_apart(path, WAYPOINTS, _parse_waypoints, error=CsvError)
    axes, units = (tuple(map(str, arrays[name])) for name in ("axes", "units"))
    return AxisPath(path.name, axes, units, arrays["positions"], arrays["lines"])


def read_pushes(path: Path) -> FloatArray:
    """Read forces [N] and displacements [m] ``(n, 2)`` of a CSV file with the columns ``force`` and
    ``displacement`` in their units, such as ``force [N],displacement [um]``.

    Raises:
        CsvError: A column or its unit is missing, or an entry is no finite number; says where.
    """
    return read_apart(path, RECORD, _parse_pushes, error=CsvError)["values"]


def resample_forces(record: ForceRecord, times: FloatArray) -> FloatArray:
    """Values ``(n, k)`` at even times, each the mean over the step around it: the impulse is kept
    and nothing folds back.

    Args:
        record: Linear between its samples.
        times: ``(n,)`` even steps within the record [s].

    Raises:
        CsvError: The record does not cover the times.
    """
    if times[0] < record.times[0] or times[-1] > record.times[-1]:
        raise CsvError(
            f"the forces were measured from {record.times[0]:g} to {record.times[-1]:g} s, and {times[0]:g} to {times[-1]:g} s are needed"
        )
    half = 0.5 * (times[1] - times[0])
    low, high = (np.clip(times + side, record.times[0], record.times[-1]) for side in (-half, half))
    return np.stack(
        [
            (_impulse(record, high, axis) - _impulse(record, low, axis)) / (high - low)
            for axis in range(record.forces.shape[1])
        ],
        axis=-1,
    )


def resampling_loss(record: ForceRecord, times: FloatArray) -> float:
    """Share of the record's rms that forces at even times ``(n,)`` do not hold: what is faster than
    the steps.
    """
    inside = (record.times >= times[0]) & (record.times <= times[-1])
    given = record.forces[inside]
    taken = resample_forces(record, times)
    resampled = np.stack(
        [np.interp(record.times[inside], times, column) for column in taken.T], axis=-1
    )
    total = float((given**2).sum())
    return float(np.sqrt(((given - resampled) ** 2).sum() / total)) if total else 0.0


def _impulse(record: ForceRecord, times: FloatArray, axis: int) -> FloatArray:
    """Integral of the piecewise linear force up to times, exactly."""
    force, spans = record.forces[:, axis], np.diff(record.times)
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * spans)])
    left = np.clip(np.searchsorted(record.times, times, side="right") - 1, 0, len(spans) - 1)
    part = times - record.times[left]
    slope = (force[left + 1] - force[left]) / spans[left]
    return whole[left] + part * (force[left] + 0.5 * slope * part)


def _read_columns(
    path: Path,
    kind: FileKind,
    headings: Sequence[str],
    optional: Sequence[str] = (),
    *,
    most_rows: int | None = None,
) -> FloatArray:
    """Columns ``(n, k)`` of a CSV file.

    Args:
        kind: How large it may be.
        headings: Names of the columns in its first line, whatever their order there, without
            capitals.
        optional: Names of columns that follow where they are all there.
        most_rows: It may have; None for no limit but the size.
    """
    names = (",".join(headings), ",".join(optional), str(most_rows or ""), kind.advice)
    return read_apart(path, kind, _parse_columns, *names, error=CsvError)["values"]


def read_lines[Parsed](path: Path, parse: Callable[[list[str], Rows], Parsed]) -> Parsed:
    """Parse the first line of a file and those rows of the others that are not blank, each with its
    number, by a function.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(stream)
            head = next(rows, [])
            # lines of the file, not rows: an entry in quotes may hold line ends, but no number does
            numbered = ((line, row) for line, row in enumerate(rows, 2) if any(map(str.strip, row)))
            return parse(head, numbered)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CsvError(f"{path.name} cannot be read: {error}") from error


def _parse_columns(
    path: Path, headings: str, optional: str, most_rows: str, advice: str
) -> dict[str, FloatArray]:
    """``values`` of a CSV file, its size unchecked; arguments as `_read_columns` joins them."""
    most = int(most_rows) if most_rows else None

    def parse(head: list[str], rows: Rows) -> FloatArray:
        columns = _find_columns(
            path, head, headings.split(","), list(filter(None, optional.split(",")))
        )
        values = _load_quickly(path, columns) if most is None else None
        return parse_rows(path, rows, columns, most, advice) if values is None else values

    values = read_lines(path, parse)
    if len(values) < 2:
        raise CsvError(f"{path.name} holds {len(values)} samples; at least two are needed")
    return {"values": values}


def _load_quickly(path: Path, columns: Sequence[int]) -> FloatArray | None:
    """Columns ``(n, k)`` of finite numbers; None for what has to be looked at row by row."""
    if path.stat().st_size <= SMALL_BYTES:
        return None
    try:
        values = np.loadtxt(
            path, delimiter=",", skiprows=1, usecols=columns, ndmin=2, comments=None, quotechar='"',
            encoding="utf-8-sig",
        )  # fmt: skip
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def parse_rows(
    path: Path, rows: Rows, columns: list[int], most: int | None, advice: str
) -> FloatArray:
    """Wanted columns ``(n, k)``, row by row: 8 bytes are kept of each number."""
    numbers = array("d")
    for line, row in rows:
        if most is not None and len(numbers) >= most * len(columns):
            raise CsvError(f"{path.name}:{line}: more than {most} rows; {advice}")
        shown = repr(",".join(row)[:80])
        try:
            values = [float(row[column]) for column in columns]
        except (ValueError, IndexError) as error:
            raise CsvError(f"{path.name}:{line} is no row of numbers: {shown}") from error
        if not np.isfinite(values).all():
            raise CsvError(
                f"{path.name}:{line} holds a value that is not finite: {shown}; cut the record, or fill the gap"
            )
        numbers.extend(values)
    return np.array(numbers).reshape(-1, len(columns))


def _find_columns(
    path: Path, head: list[str], headings: Sequence[str], optional: Sequence[str]
) -> list[int]:
    written = [heading.strip().lower().split("[")[0].strip() for heading in head]
    missing = [name for name in headings if name not in written]
    if missing:
        raise CsvError(
            f"{path.name}:1 has no column {', '.join(missing)}; the first line names the columns: {','.join(headings)}"
        )
    more = optional if set(optional) <= set(written) else ()
    return [written.index(name) for name in (*headings, *more)]


def _check_times(path: Path, times: FloatArray) -> None:
    steps = np.diff(times)
    if not (steps > 0.0).all():
        index = int(np.argmax(steps <= 0.0))
        raise CsvError(
            f"{path.name}: time does not rise after {times[index]:.6g} s (sample {index + 1}); sort or cut the record"
        )
    typical = float(np.median(steps))
    if steps.max() > LARGEST_GAP * typical:
        index = int(np.argmax(steps))
        raise CsvError(
            f"{path.name}: samples are missing between {times[index]:.6g} and {times[index + 1]:.6g} s: the gap is"
            f" {steps[index] / typical:.0f} times the usual distance of samples"
        )


def _parse_pushes(path: Path) -> Arrays:
    """``values`` of a record of forces and displacements in SI units, its size unchecked."""

    def parse(head: list[str], rows: Rows) -> Arrays:
        columns = _find_columns(path, head, list(PUSH_COLUMNS), ())
        units = [
            _read_heading(f"{path.name}:1", column + 1, head[column].strip(), PUSH_EXAMPLE, wanted)[
                1
            ]
            for column, wanted in zip(columns, PUSH_COLUMNS.values(), strict=True)
        ]
        values = parse_rows(path, rows, columns, MOST_PUSHES, "keep fewer samples per second")
        return {"values": values * [float(unit.factor) for unit in units]}

    return read_lines(path, parse)


def _parse_waypoints(path: Path) -> Arrays:
    """The fields of an `AxisPath` from a file, without a look at its size."""

    def parse(head: list[str], rows: Rows) -> Arrays:
        axes, units = _read_axes(path.name, head)
        numbers, lines = array("d"), array("q")
        for line, row in rows:
            if len(lines) == MOST_WAYPOINTS:
                raise CsvError(
                    f"{path.name}:{line}: a path has {MOST_WAYPOINTS} waypoints at most; write fewer, or cut it in two"
                )
            numbers.extend(_read_waypoint(f"{path.name}:{line}", row, units))
            lines.append(line)
        if len(lines) < 2:
            raise CsvError(
                f"{path.name} holds {len(lines)} waypoints; a path needs at least two, each in a line of its own"
            )
        return {
            "axes": np.array(axes),
            "units": np.array([unit.dimension.unit for unit in units]),
            "positions": np.array(numbers).reshape(-1, len(axes)) + 0.0,
            "lines": np.array(lines),
        }

    return read_lines(path, parse)


def _read_axes(name: str, head: list[str]) -> tuple[tuple[str, ...], tuple[Unit, ...]]:
    if not any(entry.strip() for entry in head):
        raise CsvError(
            f"{name}:1 names no axes; the first line names the columns, such as {WAYPOINT_EXAMPLE}"
        )
    if len(head) > MOST_COLUMNS:
        raise CsvError(f"{name}:1 has {len(head)} columns; a path has {MOST_COLUMNS} at most")
    if len(head) == 1 and ";" in head[0]:
        raise CsvError(
            f"{name}:1 holds semicolons; separate columns by commas and write numbers with a point: {WAYPOINT_EXAMPLE}"
        )
    columns = [
        _read_heading(f"{name}:1", number, entry.strip(), WAYPOINT_EXAMPLE, LENGTH, ANGLE)
        for number, entry in enumerate(head, 1)
    ]
    axes = tuple(axis for axis, _ in columns)
    for axis in axes:
        if axes.count(axis) > 1:
            raise CsvError(f"{name}:1 names axis {axis} twice; keep one of the columns")
    return axes, tuple(unit for _, unit in columns)


def _read_heading(
    line: str, number: int, text: str, example: str, *wanted: Dimension
) -> tuple[str, Unit]:
    """Return the name of a column and its unit, which has one of the wanted dimensions."""
    match = _HEADING.fullmatch(text)
    if match is None:
        raise CsvError(
            f"{line}: column {number} is {quote_value(text)} and has no name with a unit; write {example}"
        )
    name, unit = match[1], match[2]
    if unit is None:
        shown = " or ".join(f'"{name} [{one}]"' for one in (_UNITS[part] for part in wanted))
        raise CsvError(f"{line}: column {name} has no unit; write {shown}")
    try:
        return name, read_unit(unit.strip(), *wanted)
    except UnitError as error:
        raise CsvError(f"{line}: column {name}: {error}") from error


def _read_waypoint(line: str, row: list[str], units: tuple[Unit, ...]) -> list[float]:
    shown = quote_value(",".join(row))
    if len(row) != len(units):
        hint = "; write numbers with a point, not a comma" if len(row) == 2 * len(units) else ""
        raise CsvError(
            f"{line} has {len(row)} entries, the first line has {len(units)}: {shown}{hint}"
        )
    try:
        # decimal, as quantities of a scene are read: the same digits give the same number
        values = [
            float(Decimal(entry.strip()) * unit.factor)
            for entry, unit in zip(row, units, strict=True)
        ]
    except (ArithmeticError, ValueError) as error:
        raise CsvError(f"{line} is no row of numbers: {shown}") from error
    if not all(map(math.isfinite, values)):
        raise CsvError(f"{line} holds a value that is not finite: {shown}; write a position")
    return values
