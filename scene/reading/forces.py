"""Measured forces from a CSV file: read with every fault named, and resampled so that impulses are
kept.
"""

import csv
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import RECORD, SMALL_BYTES, FileKind, read_apart

HEADINGS = ("time", "fx", "fy", "fz")
LARGEST_GAP = 5.0  # in typical sample distances: beyond it something is missing, not uneven


class ForceFileError(HeadstockError):
    """A file of measured forces cannot be used."""


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Measured forces: ``(n,)`` rising times [s] and ``(n, k)`` values, such as the three forces on
    the tool in the machine frame [N].
    """

    times: FloatArray
    forces: FloatArray


def read_forces(path: Path) -> ForceRecord:
    """Read a CSV file with the columns ``time`` [s], ``fx``, ``fy``, ``fz`` [N].

    Raises:
        ForceFileError: As ``read_columns``.
    """
    values = read_columns(path, HEADINGS)
    return ForceRecord(values[:, 0], values[:, 1:])


def read_columns(path: Path, headings: Sequence[str]) -> FloatArray:
    """Read columns ``(n, k)`` of a CSV file, the first of them times [s].

    Args:
        headings: Names of the columns in its first line, whatever their order there.

    Raises:
        ForceFileError: A column is missing, an entry is no finite number, times do not rise, or
            samples are missing; says where.
    """
    values = read_numbers(path, headings)
    _check_times(path, values[:, 0])
    return values


def read_numbers(
    path: Path,
    headings: Sequence[str],
    optional: Sequence[str] = (),
    *,
    kind: FileKind = RECORD,
    most_rows: int | None = None,
) -> FloatArray:
    """Read columns ``(n, k)`` of a CSV file.

    Args:
        headings: Names of the columns in its first line, whatever their order there, without
            capitals.
        optional: Names of columns that follow where they are all there.
        kind: How large it may be.
        most_rows: It may have; None for no limit but the size.

    Raises:
        ForceFileError: A column is missing, an entry is no finite number, there are fewer than two
            rows or too many, or it is too large; says where.
    """
    names = (",".join(headings), ",".join(optional), str(most_rows or ""), kind.advice)
    return read_apart(path, kind, _parse_numbers, *names, error=ForceFileError)["values"]


def _parse_numbers(
    path: Path, headings: str, optional: str, most_rows: str, advice: str
) -> dict[str, FloatArray]:
    """``values`` of a CSV file, without a look at its size; arguments as `read_numbers` joins them."""
    wanted, more = headings.split(","), [name for name in optional.split(",") if name]
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.reader(stream)
            columns = _find_columns(path, next(rows, []), wanted, more)
            most = int(most_rows) if most_rows else None
            values = _load_quickly(path, columns) if most is None else None
            if values is None:
                values = _read_values(path, rows, columns, most, advice)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ForceFileError(f"{path.name} cannot be read: {error}") from error
    if len(values) < 2:
        raise ForceFileError(f"{path.name} holds {len(values)} samples; at least two are needed")
    return {"values": values}


def resample_forces(record: ForceRecord, times: FloatArray) -> FloatArray:
    """Values ``(n, k)`` at even times, each the mean over the step around it: the impulse is kept
    and nothing folds back.

    Args:
        record: Linear between its samples.
        times: ``(n,)`` even steps within the record [s].

    Raises:
        ForceFileError: The record does not cover the times.
    """
    if times[0] < record.times[0] or times[-1] > record.times[-1]:
        raise ForceFileError(
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
    return np.asarray(whole[left] + part * (force[left] + 0.5 * slope * part))


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


def _read_values(
    path: Path, rows: Iterator[list[str]], columns: list[int], most: int | None, advice: str
) -> FloatArray:
    """Wanted columns ``(n, k)``, row by row: 8 bytes are kept of each number."""
    numbers = array("d")
    for number, row in enumerate(rows, 2):
        if most is not None and len(numbers) >= most * len(columns):
            raise ForceFileError(f"{path.name}:{number}: more than {most} rows; {advice}")
        if row:
            numbers.extend(_read_row(path, number, row, columns))
    return np.array(numbers).reshape(-1, len(columns))


def _find_columns(
    path: Path, written: list[str], headings: Sequence[str], optional: Sequence[str]
) -> list[int]:
    found = [heading.strip().lower().split("[")[0].strip() for heading in written]
    missing = [name for name in headings if name not in found]
    if missing:
        raise ForceFileError(
            f"{path.name}:1 has no column {', '.join(missing)}; the first line names the columns: {','.join(headings)}"
        )
    more = optional if set(optional) <= set(found) else ()
    return [found.index(name) for name in (*headings, *more)]


def _read_row(path: Path, number: int, row: list[str], columns: list[int]) -> list[float]:
    try:
        values = [float(row[column]) for column in columns]
    except (ValueError, IndexError) as error:
        raise ForceFileError(
            f"{path.name}:{number} is no row of numbers: {','.join(row)[:80]!r}"
        ) from error
    if not np.isfinite(values).all():
        raise ForceFileError(
            f"{path.name}:{number} holds a value that is not finite: {','.join(row)[:80]!r}; cut the record, or fill the gap"
        )
    return values


def _check_times(path: Path, times: FloatArray) -> None:
    steps = np.diff(times)
    if not (steps > 0.0).all():
        index = int(np.argmax(steps <= 0.0))
        raise ForceFileError(
            f"{path.name}: time does not rise after {times[index]:.6g} s (sample {index + 1}); sort or cut the record"
        )
    typical = float(np.median(steps))
    if steps.max() > LARGEST_GAP * typical:
        index = int(np.argmax(steps))
        raise ForceFileError(
            f"{path.name}: samples are missing between {times[index]:.6g} and {times[index + 1]:.6g} s: the gap is"
            f" {steps[index] / typical:.0f} times the usual distance of samples"
        )
