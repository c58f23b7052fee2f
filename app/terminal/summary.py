"""What the terminal shows of a run: its plan, stages as they end, and everything that it found in
tables.
"""

from collections.abc import Iterable, Mapping, Sequence

from rich.table import Table

from headstock.app.tables.static import merge_families, sort_shares
from headstock.app.tables.table import Column, Listing, drop_noise, find_unit, find_unit_scales
from headstock.app.terminal.console import (
    Screen,
    add_row,
    counted,
    make_console,
    make_table,
    print_assumptions,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.texts.bounded_values import show_bound, show_bounded
from headstock.app.views.registry import COMPONENT_COLUMNS, find_views
from headstock.app.views.view import Shares, TerminalPart
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.results import Results
from headstock.scene.scene import Scene

CONTRIBUTORS_SHOWN = 5
BAR_LENGTH = 30
SMALLEST_SHARE = 0.005


def print_header(scene: Scene, *, ranks: int) -> None:
    """Name what is run."""
    variant = f", variant {scene.variant}" if scene.variant else ""
    made_of = f"{counted(len(scene.machine.components), 'component')}, {counted(len(scene.machine.joints), 'joint')}{variant}"
    make_console().say(f"{scene.name}  ({made_of}, {counted(ranks, 'rank')})", style="bold")


def print_stage(record: StageRecord) -> None:
    """One line per stage: what, of which component or in which pose, seconds, and what came out."""
    stage = record.stage
    subject = stage.component or stage.pose or ""
    detail = f"cached  {record.detail}" if record.cached else record.detail
    if stage.kind == "refine" or (stage.kind in ("models", "joints") and stage.component):
        make_console().say(f"  {stage.kind:<7} {subject:<18} {detail}")
        return
    line = f"  {stage.kind:<7} {subject:<18} {record.seconds:8.2f} s  {detail}"
    make_console().say(line, soft_wrap=True)


def print_summary(
    run: Results, *, seconds: float, folder: object, said: Sequence[str] = ()
) -> None:
    """Print everything a run found, but warnings that were printed before.

    Args:
        seconds: That the run took [s].
        said: Warnings that were printed before.
    """
    console = make_console()
    console.print()
    print_table(console, "Components", _format_rows(COMPONENT_COLUMNS, run.components.items()))
    for view in find_views(run):
        for part in view.terminal(run):
            print_part(console, part)
    print_remarks([warning for warning in run.warnings if warning not in said])
    print_assumptions(run.assumptions)
    for failure in run.failures:
        console.say(f"failed: {failure}", style="bold red")
    console.say(f"{run.status} in {seconds:.2f} s, results in {folder}", style="bold")


def print_part(console: Screen, part: TerminalPart) -> None:
    """Print a table, shares as bars, or a text."""
    if isinstance(part, Listing):
        print_table(console, part.title, _format_rows(part.columns, part.rows))
    elif isinstance(part, Shares):
        _print_shares(console, part.label, part.shares)
    else:
        console.say(part)


def _format_rows[Row](columns: Sequence[Column[Row]], rows: Iterable[Row]) -> Table:
    """A table on the screen, of the columns that it has there."""
    shown = [column for column in columns if column.screen]
    table, rows = make_table(*(column.screen for column in shown)), list(rows)
    scales = find_unit_scales(shown, rows)
    for row in rows:
        add_row(
            table,
            *(_format_cell(column, row, scales.get(find_unit(column), 0.0)) for column in shown),
        )
    return table


def _format_cell[Row](column: Column[Row], row: Row, scale: float) -> str:
    value, error = column.value(row), None if column.error is None else column.error(row)
    if isinstance(value, str):
        return value
    if value is None:
        return column.missing or "-"
    if error is not None:
        return f"{show_bounded(value, error)} {show_bound(value, error)}"
    if column.show is not None:
        return column.show(value)
    if isinstance(value, int):
        return spaced(value)
    return f"{drop_noise(value, scale):.{column.digits}g}"


def _print_shares(console: Screen, label: str, shares: Mapping[str, float]) -> None:
    ordered = sort_shares(merge_families(shares))
    shown = [item for item in ordered[:CONTRIBUTORS_SHOWN] if item[1] >= SMALLEST_SHARE]
    for index, (name, share) in enumerate(shown):
        head = f"budget {label}" if index == 0 else ""
        bar = "█" * max(1, round(BAR_LENGTH * share))
        console.say(f"  {head:<9} {name:<24} {100 * share:5.1f} %  {bar}", soft_wrap=True)
    rest = sum(share for _, share in ordered) - sum(share for _, share in shown)
    if abs(rest) >= SMALLEST_SHARE:
        console.say(f"  {'':<9} {'all others':<24} {100 * rest:5.1f} %", soft_wrap=True)
