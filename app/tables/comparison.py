"""Variants side by side in words and rows: which modes are alike, where errors come from, tables
for CSV files.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

from headstock.app.tables.frf import tabulate_response
from headstock.app.tables.table import Cell, PlainTable, encode_csv
from headstock.app.texts.bounded_values import (
    bound_size,
    error_words,
    share_words,
)
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.reduction.motions.mode_naming import WHOLE_MACHINE
from headstock.studies.comparison_summary import (
    CellSummary,
    ComparisonSummary,
    EffortSummary,
    OtherSummary,
    RowSummary,
)

VALUE_AND_ERROR: tuple[Literal["value"], Literal["error"]] = ("value", "error")
ALIKE = 0.9  # MAC from which rigid-body modes of variants are shown in one line
STEP_NAMES = {
    "load": "scene",
    "components": "components",
    "couple": "coupling",
    "modes": "modes",
    "static": "compliances",
    "frf": "responses",
    "others": "other analyses",
}


def describe_store(effort: EffortSummary) -> str:
    """Say where the elastic components came from."""
    if not effort["elastic_components"]:
        return "nothing meshed"
    if not effort["from_store"]:
        return "cold"
    every = effort["from_store"] == effort["elastic_components"]
    return (
        "from the store"
        if every
        else f"{effort['from_store']} of {effort['elastic_components']} from the store"
    )


def variant_error_words(summary: ComparisonSummary) -> list[str]:
    """Say where the errors of the variants' numbers come from and what is not in them; once for
    variants that share the words.
    """
    owners: dict[str, list[str]] = {}
    for name, variant in summary["variants"].items():
        shares = variant["error_share"][variant["rigid_count"] :]
        words = [*share_words(shares), *error_words(shares, variant["error_left_out"])]
        owners.setdefault("; ".join(words), []).append(name)
    return [f"{', '.join(names)}: {words}" for words, names in owners.items() if words]


def alike_rigid_modes(summary: ComparisonSummary) -> list[RowSummary]:
    """Rows in which the machine moves as one body, much the same in every variant: one line is
    enough for all of them, unless the columns are models of one machine.
    """
    if summary["verdicts"]:
        return []
    return [
        row
        for row in summary["modes"]
        if WHOLE_MACHINE in row["name"] and all(map(_is_alike, row["variants"].values()))
    ]


def _is_alike(cell: CellSummary | None) -> bool:
    return cell is not None and (cell["mac"] is None or cell["mac"] >= ALIKE)


def row_frequencies(row: RowSummary) -> dict[str, float]:
    """Frequency of a mode in each variant that has it [Hz]."""
    return {
        name: cell["frequency_hz"] for name, cell in row["variants"].items() if cell is not None
    }


def list_points(summary: ComparisonSummary) -> list[str]:
    """Points at which a variant has a compliance, in their order."""
    return list(
        dict.fromkeys(
            point for variant in summary["variants"].values() for point in variant["static"]
        )
    )


def read_compliance(
    summary: ComparisonSummary, name: str, point: str, row: int, column: int
) -> float | None:
    """Entry of the compliance matrix of a variant at a point [µm/kN]; None where it has no such
    point, or moves freely.

    Args:
        row: Direction of the motion, 0 to 2.
        column: Direction of the force, 0 to 2.
    """
    found = summary["variants"][name]["static"].get(point)
    return None if found is None else found["compliance_um_per_kN"][row][column]


def comparison_csv(summary: ComparisonSummary) -> dict[str, bytes]:
    """Return CSV by the stem of its file: modes, compliances, variants and, where there are any, numbers
    of other analyses, unrounded.
    """
    others = _tabulate_others(summary)
    tables = (
        _tabulate_modes(summary),
        _tabulate_compliances(summary),
        _tabulate_costs(summary),
        *([others] if others.rows else []),
    )
    return {table.name: encode_csv(table) for table in tables}


def _tabulate_modes(summary: ComparisonSummary) -> PlainTable:
    """Return a row per mode, with what each variant has of it."""
    names = list(summary["variants"])
    labels = ("number in {}", "{} [Hz]", "{} ± [Hz]", "{} deviation", "{} MAC")
    rows = (
        (
            row["name"],
            row["origin"],
            *(item for name in names for item in _list_cell(row["variants"][name])),
        )
        for row in summary["modes"]
    )
    headings = ("mode", "origin", *(label.format(name) for name in names for label in labels))
    return PlainTable("modes", headings, tuple(rows))


def _tabulate_compliances(summary: ComparisonSummary) -> PlainTable:
    """Return a row per point, direction of motion and of force."""
    names = list(summary["variants"])
    rows = (
        (
            *(point, moved, pushed),
            *(item for name in names for item in _list_entry(summary, name, point, row, column)),
        )
        for point in list_points(summary)
        for column, pushed in enumerate(DIRECTIONS)
        for row, moved in enumerate(DIRECTIONS)
    )
    values = (text for name in names for text in (f"{name} [um/kN]", f"{name} ± [um/kN]"))
    return PlainTable("compliances", ("point", "motion in", "force in", *values), tuple(rows))


def _tabulate_costs(summary: ComparisonSummary) -> PlainTable:
    """Return a row per variant: its dofs, times and memory."""
    steps = (*STEP_NAMES, "total")
    headings = (
        *("variant", "dofs", "reduced dofs", "coupled dofs"),
        *(f"{step} [s]" for step in steps),
        *("CPU [s]", "peak memory [MB]", "from store"),
    )
    rows: Iterator[tuple[Cell, ...]] = (
        (
            name,
            variant["full_dofs"],
            variant["reduced_dofs"],
            variant["coupled_dofs"],
            *(variant["effort"]["seconds"][step] for step in steps),
            variant["effort"]["cpu_seconds"]["total"],
            variant["effort"]["peak_rss_mb"],
            describe_store(variant["effort"]),
        )
        for name, variant in summary["variants"].items()
    )
    return PlainTable("variants", headings, tuple(rows))


def _tabulate_others(summary: ComparisonSummary) -> PlainTable:
    """Tabulate a row per number of the other analyses."""
    found = {name: variant["others"] for name, variant in summary["variants"].items()}
    rows: dict[tuple[str, str, str], dict[str, OtherSummary]] = {}
    for name, kinds in found.items():
        for answer, numbers in kinds.items():
            for entry, number in numbers.items():
                rows.setdefault((answer, number["unit"], entry), {})[name] = number
    return PlainTable(
        "others",
        ("answer", "unit", "entry", *(text for name in found for text in (name, f"{name} ±"))),
        tuple(
            (
                *head,
                *(
                    None if name not in numbers else numbers[name][item]
                    for name in found
                    for item in VALUE_AND_ERROR
                ),
            )
            for head, numbers in rows.items()
        ),
    )


def tabulate_lines(lines: Mapping[str, ResponseCurves]) -> PlainTable:
    """Tabulate a row per frequency: real and imaginary part of every entry of every variant, in SI.

    Args:
        lines: Variant to its response, all on the same frequencies.
    """
    tables = {name: tabulate_response(curves) for name, curves in lines.items()}
    first = next(iter(tables.values()))
    headings = [f"{name} {text}" for name, table in tables.items() for text in table.headings[1:]]
    rows = zip(*(table.rows for table in tables.values()), strict=True)
    return replace(
        first,
        name="responses",
        headings=(first.headings[0], *headings),
        rows=tuple((cells[0][0], *(item for row in cells for item in row[1:])) for cells in rows),
    )


def _list_cell(cell: CellSummary | None) -> tuple[float | None, ...]:
    if cell is None:
        return (None,) * 5
    return (
        cell["number"],
        cell["frequency_hz"],
        bound_size(cell["frequency_hz"], cell["error_hz"]),
        cell["deviation"],
        cell["mac"],
    )


def _list_entry(
    summary: ComparisonSummary, name: str, point: str, row: int, column: int
) -> tuple[float | None, float | None]:
    value = read_compliance(summary, name, point, row, column)
    if value is None or row != column:
        return value, None
    return value, bound_size(
        value, summary["variants"][name]["static"][point]["error_um_per_kN"][DIRECTIONS[row]]
    )
