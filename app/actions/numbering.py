"""``headstock numbers``: every number of a run with its name, unit and ±."""

from pathlib import Path

from headstock.app.tables.table import PlainTable, encode_csv
from headstock.app.terminal.console import add_row, counted, make_console, make_table, print_table
from headstock.app.texts.bounded_values import show_bound, show_bounded
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.folders import read_numbers
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import check_output, write_output


def list_numbers(
    folder: Path, pattern: str | None, csv_file: Path | None, json_file: Path | None
) -> int:
    """Print the numbers of a run, and write them in SI units where files are named.

    Args:
        folder: Of results.
        pattern: That names fit; None for all.
        csv_file: None for none.
        json_file: None for none.

    Raises:
        UnusableOutputError: There are no results of this version.
        NumberNameError: No name fits.
    """
    for path in (csv_file, json_file):
        if path is not None:
            check_output(path)
    every = read_numbers(folder)
    numbers = every if pattern is None else every.select(pattern)
    if csv_file is not None:
        columns = numbers.tabulate()
        rows = tuple(zip(*columns.values(), strict=True))
        write_output(csv_file, encode_csv(PlainTable("numbers", tuple(columns), rows)))
    if json_file is not None:
        listed = [number.summarise() for number in numbers.values()]
        write_output(json_file, dump_json(listed).encode())
    _print_numbers(numbers)
    return 0


def _print_numbers(numbers: Numbers) -> None:
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
    print_table(console, counted(len(numbers), "number"), table)
    for words in left_out:
        console.print(f"  not in ±: {words}", markup=False, soft_wrap=True)
