"""A table of rows, for terminal, report and CSV files."""

import csv
import io
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.numbers.estimates import scale_total
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.storage.json_texts import find_known

type Cell = str | float | None

NOISE = 1e-9  # of the largest number of a table in the same unit: what is smaller is roundoff


@dataclass(frozen=True)
class PlainTable:
    """A table: the stem of its file, headings and rows; numbers unrounded."""

    name: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Column[Row]:
    """A column of a table, the same for the screen, the report and files; each leaves out what has
    no heading there.

    Attributes:
        value: Of a row, unrounded; None where there is none.
        file: Heading in CSV files, with the unit.
        screen: Heading on the screen, after ``>`` for numbers.
        digits: Significant ones of a number on the screen and in the report.
        show: Another way to write a number there.
        missing: Written there in place of None; empty for a dash.
        error: How far the number of a row may be off; None where nobody says, and the number is
            then written like any other.
    """

    value: Callable[[Row], Cell]
    file: str = ""
    screen: str = ""
    report: str = ""
    digits: int = 4
    show: Callable[[float], str] | None = None
    missing: str = ""
    error: Callable[[Row], float | None] | None = None


def bound_column(
    value: Callable[[Any], Cell],
    error: Callable[[Any], float | None],
    file: str,
    screen: str = "",
    report: str = "",
    *,
    error_file: str = "",
    open_errors: bool = True,
) -> tuple[Column[Any], Column[Any]]:
    """Return the column of a number with its ±, and the one of the ± that files have.

    Args:
        error_file: Heading of the ± in files; that of the number behind ± without it.
        open_errors: A ± that nobody knows is shown as such.
    """

    def show_error(row: Any) -> float | None:
        size = error(row)
        return math.nan if size is None and open_errors else size

    return (
        Column(value, file, screen, report, error=show_error),
        Column(error, error_file or f"± {file}"),
    )


@dataclass(frozen=True, eq=False)
class NumbersRow:
    """A row of numbers of an answer, in the units that are shown.

    Attributes:
        numbers: Of the answer, by key.
        roles: That keys of the row share, such as a face or a feed.
    """

    numbers: Mapping[Key, Number]
    roles: Mapping[str, str | int]

    def find(self, kind: str, **roles: str) -> Number | None:
        """Return a number in SI; None where there is none."""
        return self.numbers.get(make_key(kind, **self.roles, **roles))

    def value(self, kind: str, **roles: str) -> float | None:
        """Return a number; None where there is none."""
        number = self.find(kind, **roles)
        return None if number is None else find_known(number.shown[1] * number.value)

    def error(self, kind: str, **roles: str) -> float | None:
        """Return ± of a number; None where it is not known."""
        number = self.find(kind, **roles)
        return None if number is None else scale_total(number.error, number.shown[1])


def number_column[Row: NumbersRow](
    kind: str, file: str, screen: str = "", report: str = "", *, digits: int = 4, **roles: str
) -> Column[Row]:
    """Return the column of a number with its ±, which zero has not.

    Args:
        roles: Of its key, beside those of the row.
    """

    def find_error(row: Row) -> float | None:
        return row.error(kind, **roles) if row.value(kind, **roles) else None

    return Column(
        lambda row: row.value(kind, **roles), file, screen, report, digits=digits, error=find_error
    )


def plain_column(
    value: Callable[[Any], Cell], file: str = "", screen: str = "", report: str = ""
) -> Column[Any]:
    """Return a column of rows of any type, for tables that hold those of ``bound_column``."""
    return Column(value, file, screen, report)


def tabulate[Row](name: str, columns: Sequence[Column[Row]], rows: Iterable[Row]) -> PlainTable:
    """The columns of a table that files have.

    Args:
        rows: As the columns take them.
    """
    kept = [column for column in columns if column.file]
    headings = tuple(column.file for column in kept)
    return PlainTable(
        name, headings, tuple(tuple(column.value(row) for column in kept) for row in rows)
    )


@dataclass(frozen=True, eq=False)
class Listing[Row]:
    """A table for files, terminal and report, which each take the columns that they have.

    Attributes:
        rows: As the columns take them.
        name: Stem of its file; in the report its ``id`` is this with ``-table``.
    """

    title: str
    columns: Sequence[Column[Row]]
    rows: Iterable[Row]
    name: str = ""

    def tabulate(self) -> PlainTable:
        """Return the columns that files have."""
        return tabulate(self.name, self.columns, self.rows)


def list_text_columns(*headings: str) -> list[Column[tuple[str, ...]]]:
    """Return columns of the screen for rows that are texts, a heading for each."""
    return [
        Column(operator.itemgetter(number), screen=heading)
        for number, heading in enumerate(headings)
    ]


def tabulate_curves(name: str, columns: Iterable[tuple[str, FloatArray]]) -> PlainTable:
    """Tabulate a row per sample of curves.

    Args:
        columns: Heading and values ``(n,)`` of each; NaN where there is none.
    """
    headings, values = zip(*columns, strict=True)
    cells = tuple(
        tuple(None if math.isnan(value) else float(value) for value in row)
        for row in np.column_stack(values).astype(float)
    )
    return PlainTable(name, headings, cells)


def find_unit_scales[Row](columns: Sequence[Column[Row]], rows: Sequence[Row]) -> dict[str, float]:
    """The largest number of a table in each unit, for :func:`drop_noise`.

    Args:
        columns: Of the table; one without a unit in files has no scale.
        rows: As the columns take them.
    """
    found: dict[str, float] = {}
    for column in columns:
        values = [value for value in map(column.value, rows) if isinstance(value, int | float)]
        if unit := find_unit(column):
            found[unit] = max(found.get(unit, 0.0), *(abs(value) for value in values), 0.0)
    return found


def find_unit[Row](column: Column[Row]) -> str:
    """Unit of a column as its heading in files has it, ``[um]``; empty for none."""
    return column.file[column.file.rindex("[") :] if column.file.endswith("]") else ""


def drop_noise(value: float, scale: float) -> float:
    """A number, or zero where it is roundoff beside a scale."""
    return 0.0 if abs(value) < NOISE * scale else value


def show_percent(share: float) -> str:
    """A share in per cent, to a tenth."""
    return f"{100.0 * share:.1f} %"


def show_deviation(value: float) -> str:
    """A deviation in micrometres or microradians: four digits, and zero below a picometre."""
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


def encode_csv(table: PlainTable) -> bytes:
    """A table as CSV (RFC 4180) in UTF-8. A text that a spreadsheet would take for a formula gets
    an apostrophe before it.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(table.headings)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def _cell(value: Cell) -> Cell:
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value
