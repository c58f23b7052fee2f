"""A study's records as a table, one row per point; and what three meshes say about an infinitely
fine one: order and limit.
"""

import math
import re
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

from scipy.optimize import brentq

from headstock.geometry.errors import NumberNameError
from headstock.pipeline.numbers.estimates import known_part
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.results.short_forms import Displayed, ShortForm, list_few
from headstock.pipeline.results.short_forms import show_short as show_cell
from headstock.pipeline.storage.frames import Frame, frame_columns
from headstock.scene.reading.files import TomlValue
from headstock.scene.reading.units import DIMENSIONS, LENGTH, UnitError, parse_quantity
from headstock.scene.reading.watch_paths import (
    MEASURED_NAMES,
    Watched,
    WatchError,
    find_entry,
    parse_watch,
    read_watch,
)
from headstock.scene.studies import Study, StudyFamily, show_setting
from headstock.studies.parameters.records import StudyRecord

LEAST_SIZES = 3
SMALLEST_ORDER, LARGEST_ORDER = 0.05, 12.0
TRUSTED_ORDER = 0.5
UNCHANGED = 1e-12
MESH_SIZE = re.compile(r"components\.[^.]+\.mesh\.size")
PROPORTION_TOLERANCE = 1e-6
# of names in summary.json, longer endings first
RESULT_UNITS = {
    "_um_per_kN": "um/kN",
    "_N_per_um": "N/um",
    "seconds": "s",
    "_hz": "Hz",
    "_kg": "kg",
    "_mm": "mm",
    "_um": "um",
    "_mb": "MB",
    "_rpm": "rpm",
}
# of an error, in whatever unit; its shares by source stand beside it
ERROR_NAME = re.compile(r"((?:\w+_)?error)(?:_(?:hz|um|mm|mpa|um_per_kN))?")
WATCHED_NAME = re.compile(r"[A-Za-z_][\w-]*")


@dataclass(frozen=True)
class Extrapolation:
    """Where a value goes as the mesh size goes to zero, by its three finest meshes.

    Attributes:
        order: Observed order of convergence [-]; None where the three values show none.
        limit: Extrapolated value; None without an order.
        remark: Why there is no order, or what to mind; empty when all is well.
    """

    order: float | None
    limit: float | None
    finest: float
    remark: str = ""

    @property
    def error(self) -> float | None:
        """Relative distance of the finest value from the limit [-]."""
        return None if self.limit is None or self.limit == 0.0 else self.finest / self.limit - 1.0


def extrapolate_values(sizes: Sequence[float], values: Sequence[float]) -> Extrapolation:
    """Observed order and limit of a value from the three finest of at least three meshes.

    Args:
        sizes: Mesh sizes, each another; in any order.
        values: One per size.

    Raises:
        ValueError: There are fewer than three sizes, or two are equal.

    Source: Richardson (1911); Roache (1994) for sizes that do not halve: ``f = f0 + c h^p`` through
    three points.
    """
    if len(set(sizes)) != len(values) or len(values) < LEAST_SIZES:
        raise ValueError(f"an order takes at least {LEAST_SIZES} meshes of different sizes")
    pairs = sorted(zip(sizes, values, strict=True))[:LEAST_SIZES]
    (fine, f3), (middle, f2), (coarse, f1) = pairs
    first, last = f1 - f2, f2 - f3
    if max(abs(first), abs(last)) <= UNCHANGED * max(abs(f3), 1e-300):
        return Extrapolation(None, None, f3, "does not depend on the mesh size")
    if last == 0.0 or first / last <= 0.0:
        return Extrapolation(
            None, None, f3, "not monotone: the last two changes have different signs"
        )

    def excess(order: float) -> float:
        return float((coarse**order - middle**order) / (middle**order - fine**order) - first / last)

    if excess(SMALLEST_ORDER) >= 0.0:
        return Extrapolation(
            None, None, f3, "not converging: the last change is not smaller than the one before"
        )
    if excess(LARGEST_ORDER) <= 0.0:
        return Extrapolation(
            None,
            None,
            f3,
            f"changes fall faster than any order up to {LARGEST_ORDER:g}: too coarse to tell",
        )
    order = float(brentq(excess, SMALLEST_ORDER, LARGEST_ORDER, xtol=1e-12))
    remark = (
        ""
        if order >= TRUSTED_ORDER
        else f"an order below {TRUSTED_ORDER:g}: too coarse to trust the limit"
    )
    return Extrapolation(order, f3 - last / ((middle / fine) ** order - 1.0), f3, remark)


@dataclass(frozen=True, eq=False)
class StudyRow:
    """A point as it is shown.

    Attributes:
        values: Watched value by column; a column that this point has not is missing. Numbers are in
            the unit on screen.
        problems: Watched paths and names that led nowhere, in plain words.
        known: Column of an error with unknown sources to the sum of those that are known.
        unknown: What those errors lack, in plain words.
    """

    record: StudyRecord
    values: dict[str, Watched]
    units: dict[str, str] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    known: dict[str, float] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SizeSeries:
    """A watched number over the sizes of a mesh, everything else equal.

    Attributes:
        others: Varied keys that stay the same along the series, and their values.
        sizes: Mesh sizes [m].
        values: One per size.
        extrapolation: What they say about an infinitely fine mesh.
    """

    column: str
    family: str
    others: dict[str, TomlValue]
    sizes: tuple[float, ...]
    values: tuple[float, ...]
    extrapolation: Extrapolation


@dataclass(frozen=True, eq=False, repr=False)
class StudyTable(Displayed):
    """Everything a study shows.

    Attributes:
        study: What was varied.
        rows: One per point.
        series: Observed orders, where a mesh size was varied.
    """

    study: Study
    varied: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[StudyRow, ...]
    series: tuple[SizeSeries, ...] = field(default=())

    @property
    def numbers(self) -> tuple[Numbers, ...]:
        """Every number of each point with its ±, by name."""
        return tuple(row.record.numbers for row in self.rows)

    def unit_of(self, column: str) -> str:
        """Return the unit of a watched value; empty where nothing says one."""
        return next(
            (row.units[column] for row in self.rows if column in row.units), _unit_of_result(column)
        )

    def head_of(self, column: str) -> str:
        """Return the heading of a column: a name of a number with its unit, a path as watched."""
        named = any(column in row.units for row in self.rows)
        return _with_unit(column, self.unit_of(column)) if named else column

    def to_pandas(self) -> Frame:
        """A row per point as a pandas frame: varied and watched values as floats in SI units, or in
        those that a name says, with the unit in the head; NaN where there is none.

        Raises:
            HeadstockError: pandas is missing.
        """
        return frame_columns(self._columns())

    def _columns(self) -> dict[str, list[object]]:
        """Return heads with units, and the value of every row."""
        records = [row.record for row in self.rows]
        columns: dict[str, list[object]] = {}
        if any(record.family for record in records):
            columns["family"] = [record.family for record in records]
        columns.update(map(self._varied_column, self.varied))
        for name in self.columns:
            columns.update(self._watched_columns(name))
        columns["status"] = [record.status for record in records]
        if any(record.error for record in records):
            columns["error"] = [record.error for record in records]
        return columns

    def _varied_column(self, key: str) -> tuple[str, list[object]]:
        if (numbers := varied_numbers(self, key)) is not None:
            return _with_unit(key, numbers.unit), list(numbers.values)
        settings = (row.record.varied.get(key) for row in self.rows)
        return key, [None if value is None else show_setting(value) for value in settings]

    def _watched_columns(self, name: str) -> Iterator[tuple[str, list[object]]]:
        """Yield a watched value, and what is known of it where anything is."""
        unit = self.unit_of(name)
        yield _with_unit(name, unit), [row.values.get(name) for row in self.rows]
        if any(name in row.known for row in self.rows):
            known: list[object] = [row.known.get(name) for row in self.rows]
            yield _with_unit(known_head(name), unit), known

    def _short_form(self) -> ShortForm:
        failed = sum(row.record.status == "failed" for row in self.rows)
        facts = [("points", f"{len(self.rows)}{f', {failed} failed' if failed else ''}")]
        for name, keys in (("varied", self.varied), ("watched", self.columns)):
            if keys:
                facts.append((name, list_few(keys)))
        columns = self._columns()
        rows = [[show_cell(cell) for cell in row] for row in zip(*columns.values(), strict=True)]
        return ShortForm(f"Study {self.study.name}", facts, list(columns), rows)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _unit_of_result(path: str) -> str:
    """Unit of a watched number by the end of its name; empty where that says none.

    Args:
        path: As watched, indices included.
    """
    names = WATCHED_NAME.findall(path)
    for name in reversed(names):
        for ending, unit in RESULT_UNITS.items():
            if name.endswith(ending):
                return unit
    return ""


def tabulate_study(study: Study, records: Sequence[StudyRecord]) -> StudyTable:
    """The table of a study from its records."""
    rows = tuple(_make_row(study, record) for record in records)
    columns = tuple(dict.fromkeys(column for row in rows for column in row.values))
    varied = tuple(dict.fromkeys(key for family in study.families for key in family.vary))
    return StudyTable(study, varied, columns, rows, tuple(_size_series(study, columns, rows)))


@dataclass(frozen=True)
class _VariedNumbers:
    """The values of a varied key as numbers: one per row of a table (None where a row has not the
    key), and their SI unit.
    """

    unit: str
    values: tuple[float | None, ...]


def varied_numbers(table: StudyTable, key: str) -> _VariedNumbers | None:
    """The values of a varied key as numbers in SI; None where some are no single number, or their
    units differ in kind.
    """
    read = [
        _read_number(row.record.varied[key]) if key in row.record.varied else _ABSENT
        for row in table.rows
    ]
    units = {item.unit for item in read if item is not None and item.value is not None}
    if None in read or len(units) != 1:
        return None
    return _VariedNumbers(units.pop(), tuple(item.value for item in read if item is not None))


@dataclass(frozen=True)
class _Number:
    value: float | None
    unit: str


_ABSENT = _Number(None, "")


def _read_number(value: TomlValue) -> _Number | None:
    if is_number(value):
        return _Number(value, "")
    try:
        quantity = parse_quantity(value, *DIMENSIONS) if isinstance(value, str) else None
    except UnitError:
        return None
    return None if quantity is None else _Number(quantity.value, quantity.dimension.unit)


def median_seconds(record: StudyRecord, name: str = "seconds") -> tuple[float, float] | None:
    """Median and spread (largest less smallest) of the repeats of a point [s]; None for a point
    that was not finished.
    """
    repeats = record.seconds if name == "seconds" else record.cpu_seconds
    return (statistics.median(repeats), max(repeats) - min(repeats)) if repeats else None


def is_number(value: object) -> TypeGuard[int | float]:
    """A number to compute with; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _make_row(study: Study, record: StudyRecord) -> StudyRow:
    values: dict[str, Watched] = {}
    units: dict[str, str] = {}
    problems: list[str] = []
    for text in study.watch:
        try:
            values |= _read_watched(text, record, units)
        except NumberNameError as error:
            problems.append(str(error))
        except WatchError as error:
            problems.append(f"{text}: {error}")
    known_parts: dict[str, float] = {}
    unknown: list[str] = []
    for column in (name for name, value in values.items() if value is None):
        part, lacking = _known_part(column, record.summary or {})
        if part is not None:
            known_parts[column] = part
            unknown += lacking
    return StudyRow(
        record, values, units, tuple(problems), known_parts, tuple(dict.fromkeys(unknown))
    )


def _read_watched(text: str, record: StudyRecord, units: dict[str, str]) -> dict[str, Watched]:
    """Return the watched values of a point by column.

    Args:
        units: Takes those of numbers.

    Raises:
        NumberNameError: No number has such a name.
        WatchError: The path leads nowhere.
    """
    path = parse_watch(text)
    if path.steps[0] in MEASURED_NAMES:
        measured = median_seconds(record, str(path.steps[0]))
        return {} if measured is None else {text: measured[0]}
    if not record.summary:
        return {}
    if not path.names_numbers:
        return read_watch(path, record.summary)
    values: dict[str, Watched] = {}
    for key, number in record.numbers.select(text).items():
        unit, factor = number.shown
        value = factor * number.value
        values[str(key)] = value if math.isfinite(value) else None
        units[str(key)] = unit
    return values


def known_head(column: str) -> str:
    """Heading of what is known of an error whose other sources are not."""
    return f"{column} without unknown sources"


def _known_part(column: str, summary: Mapping[str, object]) -> tuple[float | None, list[str]]:
    """What is known of a watched error without a bound, and what it lacks; None of what is no error."""
    steps = parse_watch(column).steps
    for index, step in enumerate(steps):
        named = ERROR_NAME.fullmatch(step) if isinstance(step, str) else None
        if named is not None:
            where, rest = steps[:index], steps[index + 1 :]
            shares = find_entry((*where, f"{named[1]}_share", *rest), summary)
            if isinstance(shares, dict) and (part := known_part(shares)) is not None:
                sources = [f"{source}" for source, size in shares.items() if size is None]
                left_out = find_entry((*where, "error_left_out"), summary)
                others = left_out if isinstance(left_out, list) else []
                return part, [f"not in {named[0]}: {'; '.join(sources + list(map(str, others)))}"]
    return None, []


def _size_series(
    study: Study, columns: Sequence[str], rows: Sequence[StudyRow]
) -> list[SizeSeries]:
    all_series: list[SizeSeries] = []
    for family in study.families:
        of_family = [row for row in rows if row.record.family == family.name]
        for key in _size_keys(family):
            groups: dict[str, list[StudyRow]] = {}
            for row in of_family:
                groups.setdefault(repr(_others(row, family, key)), []).append(row)
            all_series += [
                series
                for group in groups.values()
                for column in columns
                if column not in MEASURED_NAMES
                and (series := _make_series(column, key, family, group))
            ]
    return all_series


def _size_keys(family: StudyFamily) -> list[str]:
    """Mesh sizes that are varied by themselves; of sizes that are varied together in proportion,
    and with nothing else, the first.
    """
    keys = [key for key in family.vary if MESH_SIZE.fullmatch(key)]
    if not family.pairwise:
        return keys
    if len(keys) < len(family.vary):
        return []
    sizes = [[_read_size(value) for value in family.vary[key]] for key in keys]
    ratios = [
        [size / first for size, first in zip(other, sizes[0], strict=True)] for other in sizes
    ]
    together = all(max(ratio) - min(ratio) <= PROPORTION_TOLERANCE * max(ratio) for ratio in ratios)
    return keys[:1] if together else []


def _others(row: StudyRow, family: StudyFamily, key: str) -> dict[str, TomlValue]:
    if family.pairwise:
        return {}
    return {other: value for other, value in row.record.varied.items() if other != key}


def _make_series(
    column: str, key: str, family: StudyFamily, group: Sequence[StudyRow]
) -> SizeSeries | None:
    # counts (dofs, stages) are whole numbers and converge to nothing
    pairs = {
        _read_size(row.record.varied[key]): value
        for row in group
        if isinstance(value := row.values.get(column), float)
    }
    if len(pairs) < LEAST_SIZES:
        return None
    sizes, values = tuple(pairs), tuple(pairs.values())
    return SizeSeries(
        column,
        family.name,
        _others(group[0], family, key),
        sizes,
        values,
        extrapolate_values(sizes, values),
    )


def _read_size(value: TomlValue) -> float:
    return parse_quantity(value, LENGTH).value


def shorten_columns(columns: Sequence[str]) -> dict[str, str]:
    """A short heading for each column: the last names of its path, as many as tell it from the
    others; of a number its whole name.
    """
    short: dict[str, str] = {}
    for column in columns:
        parts = [column] if column.endswith(")") else column.split(".")
        for count in range(1, len(parts) + 1):
            tail = ".".join(parts[-count:])
            if not any(other != column and f".{other}".endswith(f".{tail}") for other in columns):
                break
        short[column] = tail
    return short


def series_title(series: SizeSeries) -> str:
    """Return what stays the same along a series, in a few words."""
    words = [f"{key} = {show_setting(value)}" for key, value in series.others.items()]
    return ", ".join([*([series.family] if series.family else []), *words])
