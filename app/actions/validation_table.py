"""The table of ``headstock validate``: one section per case, notes below the numbers they belong to."""

from collections.abc import Sequence
from itertools import groupby

from rich.console import Console
from rich.markup import escape

from headstock.validation.references.rows import ValidationRow

QUANTITY = 38
NUMBER = 13


def print_validation(console: Console, rows: Sequence[ValidationRow]) -> None:
    """Print rows grouped by case, then how many passed."""
    head = _line("quantity", "value", "reference", "unit", "error", "allowed", "kind")
    for case, members in groupby(rows, key=lambda row: row.case):
        group = list(members)
        failed = sum(not row.passed for row in group)
        verdict = f"[bold red]{failed} of {len(group)} fail[/bold red]" if failed else "[green]ok[/green]"
        console.print(f"\n[bold]{escape(case)}[/bold]  {verdict}")
        console.print(f"[dim]{escape(head)}[/dim]", highlight=False, soft_wrap=True)
        for row in group:
            _print_row(console, row)
    failed = sum(not row.passed for row in rows)
    console.print(f"\n{len(rows) - failed} of {len(rows)} rows passed", style="bold red" if failed else "bold green")


def _print_row(console: Console, row: ValidationRow) -> None:
    numbers = (_number(row.value), _number(row.reference), row.unit, _error(row.relative_error), _error(row.tolerance))
    name, rest = _split(row.quantity)
    line = escape(_line(name, *numbers, row.kind))
    console.print(line if row.passed else f"[bold red]{line}  FAIL[/bold red]", highlight=False, soft_wrap=True)
    for text in [*rest, *([row.note] if row.note else [])]:
        console.print(f"[dim]      {escape(text)}[/dim]", highlight=False)


def _split(quantity: str) -> tuple[str, list[str]]:
    """A quantity that is too long for its column goes on in the line below."""
    if len(quantity) <= QUANTITY - 2:
        return quantity, []
    cut = quantity.rfind(" ", 0, QUANTITY - 2)
    cut = cut if cut > 0 else QUANTITY - 2
    return quantity[:cut], [quantity[cut:].strip()]


def _line(*cells: str) -> str:
    name, value, reference, unit, error, allowed, kind = cells
    return f"  {name:<{QUANTITY - 2}}{value:>{NUMBER}}{reference:>{NUMBER}} {unit:<7}{error:>9}{allowed:>9}  {kind}"


def _number(value: float) -> str:
    return "-" if value != value else f"{value:.7g}"


def _error(value: float) -> str:
    if value != value:
        return "-"
    return f"{100 * value:.3g} %" if abs(value) >= 1e-5 else f"{value:.1e}"
