"""``headstock validate``: the table of numbers held against their references."""

import contextlib
import importlib
from collections.abc import Sequence
from pathlib import Path

import click
from mpi4py import MPI

from headstock.app.actions.running import require_ranks
from headstock.app.actions.validation_table import print_validation
from headstock.app.pictures.png_images import encode_png
from headstock.app.terminal.console import make_console, print_remarks
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.outputs import claim_output, write_beside, write_output
from headstock.validation.case_registry import Case
from headstock.validation.references.row_files import rows_as_json
from headstock.validation.references.rows import ValidationRow
from headstock.validation.validation_runs import UnknownCaseError, run_validation

FIGURES_MODULE = "headstock.app.charts.axis_kit"


def validate_cases(
    names: Sequence[str], json_file: Path | None, ranks: int | None, comm: MPI.Comm, output: Path | None = None
) -> int:
    """Compute the rows of cases and groups, print them, draw what has a figure, and fail when a row falls short.

    Raises:
        click.UsageError: A name is unknown.
    """
    require_ranks(ranks, comm)
    console = make_console(stderr=True)

    def report_progress(case: Case, rows: Sequence[ValidationRow]) -> None:
        failed = sum(not row.passed for row in rows)
        if comm.rank == 0:
            console.print(f"{case.name}: {len(rows)} rows" + (f", [red]{failed} failed[/red]" if failed else ""))

    with claim_output(output) if output is not None and comm.rank == 0 else contextlib.nullcontext():
        try:
            rows = run_validation(names, comm=comm, on_case=report_progress)
        except UnknownCaseError as error:
            raise click.UsageError(str(error)) from error
        if comm.rank == 0:
            print_validation(make_console(), rows)
            if json_file is not None:
                write_output(json_file, rows_as_json(rows).encode())
            if output is not None:
                _draw_figures(rows, output)
    return DONE if all(row.passed for row in rows) else FAILED


def _draw_figures(rows: Sequence[ValidationRow], output: Path) -> None:
    # matplotlib takes long to import: only where a folder for figures is asked for
    draw_axis_kit = importlib.import_module(FIGURES_MODULE).draw_axis_kit
    print_remarks(write_beside(output, {f"{name}.png": encode_png(pixels) for name, pixels in draw_axis_kit(rows).items()}))
