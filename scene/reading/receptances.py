"""Measured receptances of an assembly of spindle, holder and tool from a CSV file: read with every
fault named.
"""

import csv
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import RECEPTANCES, read_apart
from headstock.solvers.milling.tool_dynamics import MeasuredAssembly, across_axis

HEADINGS = (
    "frequency",
    "tip_re",
    "tip_im",
    "cross_re",
    "cross_im",
    "base_re",
    "base_im",
)


class ReceptanceFileError(HeadstockError):
    """A file of receptances cannot be used."""


def read_receptances(path: Path, axis: tuple[float, float, float]) -> MeasuredAssembly:
    """Read a CSV file with the columns ``frequency`` [Hz] and real and imaginary parts of the
    receptances of tip, cross and base [m/N].

    Args:
        axis: Of the tool, machine frame.

    Raises:
        ReceptanceFileError: A column is missing, an entry is no finite number, or frequencies do not
            rise; says where.
    """
    values = read_apart(path, RECEPTANCES, _parse_receptances, error=ReceptanceFileError)["values"]
    falls = np.flatnonzero(np.diff(values[:, 0]) <= 0.0)
    if len(falls):
        raise ReceptanceFileError(
            f"{path.name}:{int(falls[0]) + 3}: frequencies must rise; {values[falls[0] + 1, 0]:g} Hz follows {values[falls[0], 0]:g} Hz"
        )
    tip, cross, base = (values[:, column] + 1j * values[:, column + 1] for column in (1, 3, 5))
    return MeasuredAssembly(values[:, 0], tip, cross, base, across_axis(np.array(axis)))


def _parse_receptances(path: Path) -> dict[str, FloatArray]:
    """``values`` of the columns of a file, without a look at its size."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            values = _read_values(path, csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ReceptanceFileError(f"{path.name} cannot be read: {error}") from error
    if len(values) < 2:
        raise ReceptanceFileError(f"{path.name} holds {len(values)} lines; at least two are needed")
    return {"values": values}


def _read_values(path: Path, rows: Iterator[list[str]]) -> FloatArray:
    heads = [head.strip().lower() for head in next(rows, [])]
    missing = [name for name in HEADINGS if name not in heads]
    if missing:
        raise ReceptanceFileError(
            f"{path.name}:1: the column {missing[0]} is missing; the first line must be {','.join(HEADINGS)}"
        )
    columns = [heads.index(name) for name in HEADINGS]
    values = array("d")
    for number, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            entry = [float(row[column]) for column in columns]
        except (ValueError, IndexError):
            raise ReceptanceFileError(
                f"{path.name}:{number}: holds something else than {len(HEADINGS)} numbers"
            ) from None
        if not np.isfinite(entry).all():
            raise ReceptanceFileError(f"{path.name}:{number}: holds a number that is not finite")
        values.extend(entry)
    return np.array(values).reshape(-1, len(HEADINGS))
