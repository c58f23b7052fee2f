"""The fidelity series of a beam on the terminal: references, dofs needed for an accuracy, and which
statements of the paper hold.
"""

import dataclasses
import math
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from headstock.app.tables.table import PlainTable
from headstock.app.terminal.console import Screen, add_row, make_console, make_table, print_table
from headstock.validation.references.rows import verdict
from headstock.validation.refinement.points import KINDS, RefinementPoint, ndof_within, pick_series
from headstock.validation.refinement.references import Group, ReferenceBeam
from headstock.validation.refinement.statements import EvaluatedStatement

LIMITS = (0.10, 0.05, 0.01, 0.003)
UNITS: dict[Group, str] = {"static": "um", "modal": "Hz"}


def print_refinement(
    beam: ReferenceBeam,
    points: Sequence[RefinementPoint],
    statements: Sequence[EvaluatedStatement],
    own: Sequence[EvaluatedStatement],
) -> None:
    """References, effort and statements of a refinement study.

    Args:
        beam: Whose references they are.
        points: Every model that was run.
        own: That Headstock's own models show.
    """
    console = make_console()
    print_table(console, f"References of the {beam.title}", _reference_table(beam))
    _print_reasons(console, beam)
    print_table(
        console,
        "nDOF (CPU seconds) from which every quantity is so near to converged 3D elasticity",
        _effort_table(beam, points),
    )
    _print_statements(console, "What the paper says", statements)
    _print_statements(console, "What Headstock's own models show", own)


def refinement_tables(
    beam: ReferenceBeam, points: Sequence[RefinementPoint], statements: Sequence[EvaluatedStatement]
) -> list[PlainTable]:
    """Every value of a refinement study beside its three references, and the statements.

    Args:
        beam: Whose references they are.
        points: Every model that was run.
        statements: Of the paper and of Headstock's own.
    """
    headings = (
        "model", "nDOF", "quantity", "unit", "value", "analytic", "deviation", "beam with shear", "deviation from it",
        "converged 3D", "deviation from that", "seconds", "cpu seconds", "MAC",
    )  # fmt: skip
    rows = []
    for point in sorted(
        points, key=lambda item: (item.group != "static", KINDS.index(item.kind), item.ndof)
    ):
        for name, value in point.values.items():
            reference = beam.references[name]
            methods = (reference.analytic, reference.beam, reference.solid)
            compared = [cell for right in methods for cell in (right, value / right - 1.0)]
            cost = (
                *(
                    time if math.isfinite(time) else None
                    for time in (point.seconds, point.cpu_seconds)
                ),
                point.macs.get(name),
            )
            rows.append((point.kind, point.ndof, name, UNITS[point.group], value, *compared, *cost))
    table = PlainTable("refinement", headings, tuple(rows))
    verdicts = tuple(
        (c.figure, c.models, c.text, verdict(c.confirmed), c.decides, c.value, c.note)
        for c in statements
    )
    return [
        table,
        PlainTable(
            "claims",
            ("figure", "models", "claim", "verdict", "decided by", "number", "note"),
            verdicts,
        ),
    ]


def list_statements(statements: Sequence[EvaluatedStatement]) -> list[dict[str, object]]:
    """Return statements as ``study.json`` has them."""
    return [dataclasses.asdict(statement) for statement in statements]


def _reference_table(beam: ReferenceBeam) -> Table:
    table = make_table(
        "quantity", "", ">analytic", ">beam with shear", ">off by", ">converged 3D", ">off by"
    )
    for name, reference in beam.references.items():
        off = [
            100.0 * (value / reference.analytic - 1.0)
            for value in (reference.beam, reference.solid)
        ]
        numbers = (
            f"{reference.beam:.5g}",
            f"{off[0]:+.2f} %",
            f"{reference.solid:.5g}",
            f"{off[1]:+.2f} %",
        )
        add_row(table, name, UNITS[reference.group], f"{reference.analytic:.5g}", *numbers)
    return table


def _print_reasons(console: Screen, beam: ReferenceBeam) -> None:
    """Why the analytic values are off, each reason with its quantities."""
    reasons: dict[str, list[str]] = {}
    for name, reference in beam.references.items():
        reasons.setdefault(reference.note, []).append(name)
    lines = Table.grid(padding=(0, 2))
    for reason, names in reasons.items():
        lines.add_row(Text("; ".join(names)), Text(reason))
    console.print(lines)
    console.print()


def _effort_table(beam: ReferenceBeam, points: Sequence[RefinementPoint]) -> Table:
    table = make_table("models", "", *(f">{100 * limit:g} %" for limit in LIMITS))
    groups: tuple[Group, ...] = ("static", "modal")
    for group in groups:
        names = [name for name, reference in beam.references.items() if reference.group == group]
        for kind in KINDS:
            series = pick_series(beam, points, group, kind)
            if not series.points:
                continue
            cells = []
            for limit in LIMITS:
                ndof = ndof_within(series, names, limit, against="solid")
                seconds = [point.cpu_seconds for point in series.points if point.ndof == ndof]
                timed = (
                    f" ({max(seconds):.2g} s)" if seconds and math.isfinite(max(seconds)) else ""
                )
                cells.append("-" if ndof is None else f"{ndof}{timed}")
            add_row(table, kind, group, *cells)
    return table


def _print_statements(
    console: Screen, title: str, statements: Sequence[EvaluatedStatement]
) -> None:
    confirmed = sum(statement.confirmed for statement in statements)
    console.say(f"{title}: {confirmed} of {len(statements)} confirmed", style="bold")
    lines = Table.grid(padding=(0, 2))
    for statement in statements:
        cell = Text(statement.text)
        cell.append(f"\n{statement.decides}", style="bold")
        cell.append(f"\n{statement.note}" if statement.note else "", style="dim")
        outcome = Text(
            verdict(statement.confirmed), style="green" if statement.confirmed else "yellow"
        )
        lines.add_row(Text(f"fig. {statement.figure}"), Text(statement.models), outcome, cell)
    console.print(lines)
    console.print()
