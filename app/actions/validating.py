"""``headstock validate``: numbers compared with their references, one section per case, notes below
the numbers they belong to.
"""

import contextlib
import importlib
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import click
from rich.markup import escape

from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.commands.tool_commands import ValidateOptions
from headstock.app.terminal.console import Screen, make_console, print_remarks
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.outputs import write_named_files
from headstock.solvers.mpi import MPI
from headstock.validation.case_registry import Case, SeedError, UnknownCaseError, run_validation
from headstock.validation.references.rows import ValidationRow, rows_as_json

QUANTITY = 38
NUMBER = 13
FIGURES_MODULE = "headstock.app.charts.axis_kit"


def _print_validation(console: Screen, rows: Sequence[ValidationRow]) -> None:
    """Print rows grouped by case, then how many passed."""
    head = _line("quantity", "value", "reference", "unit", "error", "allowed", "kind")
    for case, members in groupby(rows, key=lambda row: row.case):
        group = list(members)
        failed = sum(not row.passed for row in group)
        verdict = (
            f"[bold red]{failed} of {len(group)} fail[/bold red]" if failed else "[green]ok[/green]"
        )
        console.print(f"\n[bold]{escape(case)}[/bold]  {verdict}")
        console.print(f"[dim]{escape(head)}[/dim]", highlight=False, soft_wrap=True)
        for row in group:
            _print_row(console, row)
    failed = sum(not row.passed for row in rows)
    console.print(
        f"\n{len(rows) - failed} of {len(rows)} rows passed",
        style="bold red" if failed else "bold green",
    )


def _print_row(console: Screen, row: ValidationRow) -> None:
    name, rest = _split(row.quantity)
    value, reference, error, allowed = (
        _number(row.value),
        _number(row.reference),
        _error(row.relative_error),
        _error(row.tolerance),
    )
    line = escape(_line(name, value, reference, row.unit, error, allowed, row.kind))
    console.print(
        line if row.passed else f"[bold red]{line}  FAIL[/bold red]",
        highlight=False,
        soft_wrap=True,
    )
    for text in [*rest, *([row.note] if row.note else [])]:
        console.print(f"[dim]      {escape(text)}[/dim]", highlight=False)


def _split(quantity: str) -> tuple[str, list[str]]:
    """A quantity that is too long for its column goes on in the line below."""
    if len(quantity) <= QUANTITY - 2:
        return quantity, []
    cut = quantity.rfind(" ", 0, QUANTITY - 2)
    cut = cut if cut > 0 else QUANTITY - 2
    return quantity[:cut], [quantity[cut:].strip()]


def _line(
    name: str, value: str, reference: str, unit: str, error: str, allowed: str, kind: str
) -> str:
    return f"  {name:<{QUANTITY - 2}}{value:>{NUMBER}}{reference:>{NUMBER}} {unit:<7}{error:>9}{allowed:>9}  {kind}"


def _number(value: float) -> str:
    return "-" if value != value else f"{value:.7g}"


def _error(value: float) -> str:
    if value != value:
        return "-"
    return f"{100 * value:.3g} %" if abs(value) >= 1e-5 else f"{value:.1e}"


def validate_command(options: ValidateOptions, comm: MPI.Comm) -> int:
    """Compute the rows of cases and groups, print them, draw what has a figure, and fail when a row
    falls short.

    Raises:
        click.UsageError: A name is unknown, or a case cannot begin at the seed.
    """
    require_ranks(options.ranks, comm)
    console = make_console(stderr=True)

    def report_progress(case: Case, rows: Sequence[ValidationRow]) -> None:
        failed = sum(not row.passed for row in rows)
        if comm.rank == 0:
            console.print(
                f"{case.name}: {len(rows)} rows"
                + (f", [red]{failed} failed[/red]" if failed else "")
            )

    output = options.output
    with contextlib.nullcontext() if output is None else claim_on_root(comm, output):
        try:
            rows = run_validation(
                options.cases or [], comm=comm, on_case=report_progress, seed=options.seed
            )
        except (UnknownCaseError, SeedError) as error:
            raise click.UsageError(str(error)) from error
        if comm.rank == 0:
            _print_validation(make_console(), rows)
            options.write_json(rows_as_json(rows))
            if output is not None:
                _draw_figures(rows, output)
    return DONE if all(row.passed for row in rows) else FAILED


def _draw_figures(rows: Sequence[ValidationRow], output: Path) -> None:
    # matplotlib takes long to import: only where a folder for figures is asked for
    draw_axis_kit = importlib.import_module(FIGURES_MODULE).draw_axis_kit
    print_remarks(
        write_named_files(
            output,
            {f"{name}.png": image for name, image in draw_axis_kit(rows).items()},
        )
    )
