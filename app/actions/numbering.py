"""``headstock numbers``: every number of a run with its name, unit and ±."""

from collections.abc import Mapping
from typing import cast

from headstock.app.commands.tool_commands import NumbersOptions
from headstock.app.tables.table import Cell, PlainTable, encode_csv
from headstock.app.terminal.console import add_row, counted, make_console, make_table, print_table
from headstock.app.terminal.guard import DONE
from headstock.app.texts.bounded_values import show_bound, show_bounded
from headstock.geometry.errors import NumberNameError
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.folders import read_number_tables
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import check_output, write_output


def numbers_command(options: NumbersOptions) -> int:
    """Print the numbers of a run, or of every point or variant, and write them in SI units where files are named.

    Raises:
        UnusableOutputError: There are no results of this version.
        NumberNameError: No name fits.
    """
    if options.csv is not None:
        check_output(options.csv)
    tables = _select_numbers(read_number_tables(options.folder), options.pattern)
    if options.csv is not None:
        write_output(options.csv, encode_csv(_tabulate(tables)))
    listed = [
        ({"of": label} if label else {}) | number.summarise()
        for label, numbers in tables.items()
        for number in numbers.values()
    ]
    options.write_json(dump_json(listed))
    for label, numbers in tables.items():
        _print_numbers(numbers, label)
    return DONE


def _select_numbers(tables: Mapping[str, Numbers], pattern: str | None) -> dict[str, Numbers]:
    """Return the numbers whose names fit a pattern, of the tables that have any.

    Raises:
        NumberNameError: No table has one.
    """
    if pattern is None:
        return dict(tables)
    found: dict[str, Numbers] = {}
    failure: NumberNameError | None = None
    for label, numbers in tables.items():
        try:
            found[label] = numbers.select(pattern)
        except NumberNameError as error:
            failure = error
    if not found and failure is not None:
        raise failure
    return found


def _tabulate(tables: Mapping[str, Numbers]) -> PlainTable:
    """Return the numbers of all tables below each other; the first column names the table of several."""
    columns: dict[str, list[object]] = {}
    rows = 0
    for label, numbers in tables.items():
        own: dict[str, list[object]] = {"of": [label] * len(numbers)} if any(tables) else {}
        own |= numbers.tabulate()
        for head in dict.fromkeys((*columns, *own)):
            known = columns.setdefault(head, [None] * rows)
            known += own.get(head, [None] * len(numbers))
        rows += len(numbers)
    cells = tuple(zip(*columns.values(), strict=True))
    return PlainTable("numbers", tuple(columns), cast(tuple[tuple[Cell, ...], ...], cells))


def _print_numbers(numbers: Numbers, label: str) -> None:
    console, table = make_console(), make_table("<name", ">value", ">±", "<unit")
    left_out: dict[str, None] = {}
    for key, number in numbers.items():
        unit, factor = number.shown
        error = number.error or Estimate()
        left_out |= dict.fromkeys(error.left_out)
        value = factor * number.value
        total, known = (
            None if size is None else factor * size for size in (error.total, error.known)
        )
        bound = show_bound(value, total, known) if error.shares else ""
        add_row(table, str(key), show_bounded(value, total), bound, "" if unit == "1" else unit)
    title = f"{label}: " if label else ""
    print_table(console, f"{title}{counted(len(numbers), 'number')}", table)
    for words in left_out:
        console.say(f"  not in ±: {words}", soft_wrap=True)
