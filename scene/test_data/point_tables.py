"""Tables of sensors and point masses in CSV files: one place on a component in each row."""

import re
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import TEST_POINTS, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.scene.reading.csv_files import CsvError, Rows, read_lines
from headstock.scene.reading.units import LENGTH, MASS, UnitError, quote_value, read_unit
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import TableRow, Vector

POSITION = ("x", "y", "z")
NAMES = {"part": "component", "point": "name", "sensor": "name", "direction": "directions"}
COLUMNS = ("name", "component", *POSITION, "directions", "mass")
EXAMPLE = "name,x [mm],y [mm],z [mm]"
MOST_ROWS = 10_000
SAME_DIRECTION = 0.9999  # cosine
_HEADING = re.compile(r"([A-Za-z_]+)\s*(?:\[([^\[\]]*)\])?")
_LABEL = re.compile(r"[A-Za-z0-9_-]{1,64}")


def read_places(path: Path, unit: str) -> tuple[TableRow, ...]:
    """Read a CSV table, or the points of a file of test data with what was measured at each.

    Args:
        unit: See ``_read_point_table``; files of test data name theirs.

    Raises:
        CsvError, MeasurementError: The file cannot be used; says where.
    """
    if path.suffix.lower() == ".csv":
        return _read_point_table(path, unit)
    data = read_test_data(path)
    channels = [*(data.modes.channels if data.modes is not None else ())]
    if data.responses is not None:
        channels += [*data.responses.motions, *data.responses.forces]
    return tuple(
        TableRow(
            1,
            name,
            point.part or "",
            point.position,
            "",
            None,
            _list_directions(one.direction for one in channels if one.point == name),
        )
        for name, point in data.points.items()
    )


def _list_directions(vectors: Iterable[Vector]) -> tuple[Vector, ...]:
    """Return directions without signs, each once."""
    listed: list[Vector] = []
    for vector in vectors:
        if all(abs(float(np.dot(vector, one))) < SAME_DIRECTION for one in listed):
            listed.append(vector)
    return tuple(listed)


def _read_point_table(path: Path, unit: str) -> tuple[TableRow, ...]:
    """Read a CSV file with the columns ``x``, ``y``, ``z`` and, as wanted, ``name``, ``component``,
    ``directions`` and ``mass``, whatever their order.

    Args:
        unit: Of positions whose columns name none; empty where each has to.

    Raises:
        CsvError: A column is missing, unknown or without unit, or a row is no place; says where.
    """
    arrays = read_apart(path, TEST_POINTS, _parse_rows, unit, error=CsvError)
    masses = arrays["masses"]
    return tuple(
        TableRow(
            int(arrays["lines"][row]),
            str(arrays["names"][row]),
            str(arrays["components"][row]),
            (float(x), float(y), float(z)),
            str(arrays["directions"][row]),
            float(masses[row]) if len(masses) else None,
        )
        for row, (x, y, z) in enumerate(arrays["positions"])
    )


def _parse_rows(path: Path, unit: str) -> Arrays:
    """The columns of a table, its size unchecked."""

    def parse(head: list[str], rows: Rows) -> Arrays:
        factors = _read_head(path.name, head, unit)
        entries: dict[str, tuple[int, dict[str, str]]] = {}
        for number, (line, row) in enumerate(rows, 1):
            where = f"{path.name}:{line}"
            if number > MOST_ROWS:
                raise CsvError(f"{where}: more than {MOST_ROWS} rows; leave out what is not needed")
            if len(row) != len(head):
                raise CsvError(f"{where} has {len(row)} entries, the first line has {len(head)}")
            entry = {name: text.strip() for name, text in zip(factors, row, strict=True)}
            name = entry.setdefault("name", str(number))
            if _LABEL.fullmatch(name) is None:
                raise CsvError(
                    f"{where}: {quote_value(name)} is no name of a point; write letters, digits, _ and -"
                )
            if name in entries:
                raise CsvError(f"{where} repeats point {name} of line {entries[name][0]}")
            entries[name] = line, entry
        if not entries:
            raise CsvError(
                f"{path.name} holds no rows; the first line names the columns: {EXAMPLE}"
            )

        def read_numbers(column: str) -> FloatArray:
            return np.array(
                [
                    _read_number(f"{path.name}:{line}", entry[column], factors[column])
                    for line, entry in entries.values()
                ]
            )

        def read_texts(column: str) -> NDArray[np.str_]:
            return np.array([entry.get(column, "") for _, entry in entries.values()])

        return {
            "lines": np.array([line for line, _ in entries.values()]),
            "names": np.array(list(entries)),
            "components": read_texts("component"),
            "directions": read_texts("directions"),
            "positions": np.stack([read_numbers(column) for column in POSITION], axis=1),
            "masses": read_numbers("mass") if "mass" in factors else np.zeros(0),
        }

    return read_lines(path, parse)


def _read_head(file: str, head: list[str], unit: str) -> dict[str, Decimal]:
    """Column to the factor of its numbers to SI units."""
    factors: dict[str, Decimal] = {}
    for text in head:
        match = _HEADING.fullmatch(text.strip())
        name = "" if match is None else NAMES.get(match[1].lower(), match[1].lower())
        if match is None or name not in COLUMNS:
            raise CsvError(
                f"{file}:1: {quote_value(text)} is no column; columns: {', '.join(COLUMNS)}"
            )
        if name in factors:
            raise CsvError(f"{file}:1 names column {name} twice")
        factors[name] = _read_factor(file, name, match[2] or "", unit)
    missing = [name for name in POSITION if name not in factors]
    if missing:
        raise CsvError(
            f"{file}:1 has no column {', '.join(missing)}; the first line names the columns: {EXAMPLE}"
        )
    return factors


def _read_factor(file: str, name: str, written: str, unit: str) -> Decimal:
    """Return the factor of a column to SI units; one of a column of texts."""
    if name not in (*POSITION, "mass"):
        return Decimal(1)
    example, dimension = ("g", MASS) if name == "mass" else ("mm", LENGTH)
    written = written or ("" if name == "mass" else unit)
    if not written:
        raise CsvError(f'{file}:1: column {name} has no unit; write "{name} [{example}]"')
    try:
        return read_unit(written, dimension).factor
    except UnitError as error:
        raise CsvError(f"{file}:1: column {name}: {error}") from error


def _read_number(where: str, text: str, factor: Decimal) -> float:
    try:
        value = float(Decimal(text) * factor)
    except ArithmeticError:
        value = np.nan
    if not np.isfinite(value):
        raise CsvError(f"{where}: {quote_value(text)} is no finite number")
    return value
