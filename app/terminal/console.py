"""The screen: a console, tables in which nothing is cut, remarks, counts in words; reads well at
100 columns and without a terminal.
"""

import os
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, TextIO

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from headstock.app.texts.remarks import fold_remarks
from headstock.scene.scene import Scene

WIDTH_WITHOUT_TERMINAL = 100


# rich breaks lines at every kind of space; this stands for one where it must not
UNBROKEN_SPACE = "\ue000"
RANGE = re.compile(r"within a factor of ([\d.]+)")  # of a value of the catalogue
BEFORE_PERCENT = re.compile(r"(?<=\d) (?=%)")


class Screen(Console):
    """A console that keeps a number and its per cent sign in one line, and lets a command end as
    others do when the next one in a pipe closes it, without rich's own exit.
    """

    def on_broken_pipe(self) -> None:
        """End as other commands do."""
        raise BrokenPipeError

    def say(self, text: str, *, style: str | None = None, soft_wrap: bool = False) -> None:
        """Print a text as it is: brackets in it mean nothing."""
        self.print(text, style=style, soft_wrap=soft_wrap, markup=False)

    def render_str(self, text: str, **options: Any) -> Text:
        """A text with what may not be torn apart marked."""
        return super().render_str(_keep_percents(text), **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Write marks as spaces."""
        for segment in super().render(renderable, options):
            yield segment._replace(text=segment.text.replace(UNBROKEN_SPACE, " "))


def _keep_percents(text: str) -> str:
    return BEFORE_PERCENT.sub(UNBROKEN_SPACE, text)


def is_terminal(stream: TextIO) -> bool:
    """Tell whether somebody looks at a stream; mpirun gives every rank a terminal of its own, wherever
    its own output goes.
    """
    return stream.isatty() and not {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"} & set(os.environ)


def make_console(*, stderr: bool = False) -> Screen:
    """A console that does not colour numbers, 100 columns wide where there is no terminal."""
    terminal = is_terminal(sys.stderr if stderr else sys.stdout)
    width = None if terminal or "COLUMNS" in os.environ else WIDTH_WITHOUT_TERMINAL
    return Screen(stderr=stderr, highlight=False, width=width, emoji=False, force_terminal=terminal)


def print_remarks(remarks: Sequence[str]) -> None:
    """Print what the user should know: warnings of a run, or of how its results were written."""
    console = make_console()
    for remark in fold_remarks(remarks):
        console.say(f"warning: {remark}", style="yellow")


def print_assumptions(assumptions: Sequence[str]) -> None:
    """Print on one line which values are the catalogue's, and how uncertain they are."""
    if not assumptions:
        return
    text, *others = assumptions
    if others:
        factors = sorted(map(float, RANGE.findall(" ".join(assumptions))))
        ranges = (
            f", stiffness within a factor of {factors[0]:g} to {factors[-1]:g}" if factors else ""
        )
        keys = ", ".join(assumption.partition(": ")[0] for assumption in assumptions)
        text = (
            f"{len(assumptions)} entries of the catalogue{ranges}; "
            f"each range is in the report and with --json FILE: {keys}"
        )
    make_console().say(f"assumed: {text}")


def print_open(title: str, questions: Iterable[object]) -> None:
    """Print open values, a line for those that are alike, under a title."""
    console = make_console()
    console.say(title)
    for question in questions:
        console.say(f"  {question}", soft_wrap=True)


def warn_of_unused_accuracy(scene: Scene) -> None:
    """Say that a command takes meshes and modes as they are written although the scene asks for an
    accuracy.
    """
    if scene.accuracy is not None:
        asked = f"{100.0 * scene.accuracy.to:g} %"
        print_remarks(
            [
                f"accuracy = {asked} is for run, study and effects; here meshes and modes are those written in the scene"
            ]
        )


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number of things in words.

    Args:
        plural: Of several; the noun with an s without it.
    """
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def spaced(count: int) -> str:
    """A count in groups of three digits."""
    return f"{count:,}".replace(",", " ")


def make_table(*headings: str) -> Table:
    """A light table; a heading that starts with ``>`` is for numbers, with ``<`` for texts that are
    never broken.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        # headings of some tables come from scenes: a bracket in one is no markup
        whole = heading[:1] in (">", "<")
        table.add_column(
            Text(heading[whole:]),
            justify="right" if heading.startswith(">") else "left",
            no_wrap=whole,
            overflow="fold",
        )
    return table


def add_row(table: Table, *cells: str) -> None:
    """Add a row of plain text."""
    # names come from scenes: a bracket in one is no markup
    table.add_row(*(Text(_keep_percents(cell)) for cell in cells))


def print_table(console: Screen, title: str, table: Table) -> None:
    """Print a table under a bold title; nothing in it is cut.

    Where it is wider than the console, headings and texts are broken between words; if that is not
    enough, the last columns of texts are left out, which is said, and then the table is printed
    wider than the console. A pipe has no edge: nothing is left out there.

    Args:
        table: Of :func:`make_table`.
    """
    edge = console.width if console.is_terminal or "COLUMNS" in os.environ else None
    columns = list(table.columns)
    while (
        edge is not None
        and _is_spare(columns)
        and _spread_out([_least_width(column) for column in columns]) > edge
    ):
        columns.pop()
    widths = _share_width(columns, console.width)
    fitted = Table(box=table.box, pad_edge=False)
    for index, (column, width) in enumerate(zip(columns, widths, strict=True)):
        # rich counts a padding at the edges that it then leaves out
        edges = (index == 0) + (index == len(columns) - 1)
        fitted.add_column(
            column.header, justify=column.justify, width=width - edges, overflow="fold"
        )
    cells = [list(column.cells) for column in columns]
    for index, row in enumerate(table.rows):
        fitted.add_row(*(column[index] for column in cells), end_section=row.end_section)
    console.say(title, style="bold", soft_wrap=True)
    width = console.width
    console.width = max(width, _spread_out(widths))
    console.print(fitted)
    console.width = width
    if len(columns) < len(table.columns):
        left_out = ", ".join(str(column.header) for column in table.columns[len(columns) :])
        console.say(f"  left out at {edge} columns: {left_out}", soft_wrap=True)


def _is_spare(columns: Sequence[Column]) -> bool:
    """Whether the last column may be left out: texts, and not the only ones."""
    return not columns[-1].no_wrap and any(not column.no_wrap for column in columns[:-1])


def _spread_out(widths: Sequence[int]) -> int:
    """Width of a table: one character at each edge, three between columns."""
    return sum(widths) + 3 * len(widths) - 1


def _share_width(columns: Sequence[Column], available: int) -> list[int]:
    """Width of each column: the widest give way first, none below what its numbers or longest word
    need.
    """
    least = [_least_width(column) for column in columns]
    widths = [max(low, _natural_width(column)) for low, column in zip(least, columns, strict=True)]
    while _spread_out(widths) > available and widths != least:
        widest = max(
            range(len(widths)), key=lambda index: (widths[index] > least[index], widths[index])
        )
        widths[widest] -= 1
    return widths


def _natural_width(column: Column) -> int:
    return max(
        cell_len(line) for part in (column.header, *column.cells) for line in str(part).split("\n")
    )


def _least_width(column: Column) -> int:
    words = [
        *str(column.header).split(),
        *(word for cell in column.cells for word in _unbroken(column, str(cell))),
    ]
    return max([column.min_width or 1, *(cell_len(word) for word in words)])


def _unbroken(column: Column, cell: str) -> list[str]:
    return cell.split("\n") if column.no_wrap else cell.split()
