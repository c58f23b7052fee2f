"""Variants side by side as the terminal shows them."""

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table
from rich.text import Text

from headstock.app.terminal.console import make_console, make_table, print_table, spaced
from headstock.app.texts.bounded_values import show_bound, show_bounded, show_digits
from headstock.app.texts.comparison import (
    STEP_NAMES,
    alike_rigid_modes,
    describe_store,
    list_points,
    read_compliance,
    row_frequencies,
    variant_error_words,
)
from headstock.geometry.frames import DIRECTIONS
from headstock.studies.comparison import (
    CellSummary,
    ComparisonSummary,
    EffortSummary,
    VariantSummary,
)

MISSING = "–"
NAME_WIDTH = 40  # of the first column where there is no terminal


def print_variant(name: str, runs: Mapping[str, EffortSummary]) -> None:
    """One line when a variant is solved: what it cost."""
    parts = []
    for run, effort in runs.items():
        steps = ", ".join(
            f"{STEP_NAMES[step]} {effort['seconds'][step]:.2f}" for step in STEP_NAMES
        )
        stored = f", {describe_store(effort)}" if effort["elastic_components"] else ""
        parts.append(
            f"  {name if run == 'first' else run:<16} {effort['seconds']['total']:6.2f} s  {steps}{stored}"
        )
    make_console().print("\n".join(parts), markup=False, soft_wrap=True)


def print_comparison(summary: ComparisonSummary) -> None:
    """The table a designer decides from: modes, compliances, weak links, and what each variant
    costs.
    """
    variants = summary["variants"]
    console = make_console()
    console.print()
    table = make_table("", *(f">{name}" for name in variants))
    table.columns[0].min_width = NAME_WIDTH if not console.is_terminal else None
    if summary["modes"]:
        _add_heads(
            table,
            "Natural frequencies [Hz]",
            [_describe_fidelity(variant) for variant in variants.values()],
        )
        alike = alike_rigid_modes(summary)
        if alike:
            spans = [[row_frequencies(row)[name] for row in alike] for name in variants]
            _add_cells(
                table,
                f"{len(alike)} rigid-body modes, alike",
                [f"{min(span):.4g} .. {max(span):.4g}" for span in spans],
            )
        for row in (row for row in summary["modes"] if row not in alike):
            origin = "" if row["origin"] == summary["reference"] else f" (first in {row['origin']})"
            cells = [
                _mode_cell(row["variants"][name], variant) for name, variant in variants.items()
            ]
            _add_cells(table, f"{row['name']}{origin}", cells)
        table.add_section()
        _add_cells(
            table, "largest deviation", [_largest_deviation(summary, name) for name in variants]
        )
        _add_cells(
            table, "modes it misses, adds", [_missed_and_added(summary, name) for name in variants]
        )
    for point in list_points(summary):
        _add_point(table, summary, point)
    table.add_section()
    _add_cells(
        table,
        "dofs of the components",
        [spaced(variant["full_dofs"]) for variant in variants.values()],
    )
    _add_cells(
        table, "dofs solved for", [spaced(variant["coupled_dofs"]) for variant in variants.values()]
    )
    efforts = [variant["effort"] for variant in variants.values()]
    _add_cells(
        table,
        "seconds from scene to modes",
        [f"{e['seconds']['total']:.2f}\n{describe_store(e)}" for e in efforts],
    )
    print_table(
        console,
        f"{summary['scene']}: variants in pose {summary['pose']}, held against {summary['reference']}",
        table,
    )
    _print_notes(console, summary)


def _print_notes(console: Console, summary: ComparisonSummary) -> None:
    imports = sum(variant["effort"]["import_seconds"] for variant in summary["variants"].values())
    apart = (
        f"; loading the finite element library ({imports:.2f} s) is not counted" if imports else ""
    )
    text = (
        f"Modes are paired by shape: MAC at places that stand for the mass of each body, {summary['same_from']:g} and more is the same "
        f"mode, {MISSING} means that the variant has none; deviations are from the first variant of a row{apart}."
    )
    console.print(text, markup=False)
    for words in variant_error_words(summary):
        console.print(words, markup=False)
    for name, variant in summary["variants"].items():
        for failure in variant["failures"]:
            console.print(f"failed: {name}: {failure}", style="bold red", markup=False)


def print_effort(summary: ComparisonSummary) -> None:
    """What the first model and a changed one cost, where that was measured from an empty store."""
    if "effort" not in summary:
        return
    change = summary["effort"]["change"]
    runs = ["first", "changed"] if change else ["first"]
    console = make_console()
    table = make_table(
        "variant",
        *(f">{run} model, s" for run in runs),
        *(f">{run}, CPU s" for run in runs),
        "of it",
    )
    for name, efforts in summary["effort"]["variants"].items():
        steps = ", ".join(
            f"{STEP_NAMES[step]} {efforts[runs[-1]]['seconds'][step]:.3f}" for step in STEP_NAMES
        )
        walls = [f"{efforts[run]['seconds']['total']:.3f}" for run in runs]
        used = [f"{efforts[run]['cpu_seconds']['total']:.3f}" for run in runs]
        table.add_row(*(Text(cell) for cell in (name, *walls, *used, steps)))
    changed = f", then with {', '.join(change)} from the same store" if change else ""
    print_table(console, f"Effort from scene to modes, from an empty store{changed}", table)


def _add_heads(table: Table, title: str, cells: list[str]) -> None:
    table.add_row(Text(title, style="bold"), *(Text(cell, style="dim") for cell in cells))


def _add_cells(table: Table, head: str, cells: list[str]) -> None:
    table.add_row(Text(head), *(Text(cell) for cell in cells))


def _add_point(table: Table, summary: ComparisonSummary, point: str) -> None:
    variants = summary["variants"]
    table.add_section()
    _add_heads(table, f"Compliance at {point} [µm/kN]", [""] * len(variants))
    for j, direction in enumerate(DIRECTIONS):
        cells = []
        for name, variant in variants.items():
            value, first = (
                read_compliance(summary, name, point, j, j),
                read_compliance(summary, summary["reference"], point, j, j),
            )
            if value is None:
                cells.append(MISSING)
                continue
            errors = variant["static"][point]["error_um_per_kN"]
            cells.append(f"{_with_error(value, errors[direction])}{_percent(value, first)}")
        _add_cells(table, f"d{direction}/F{direction}", cells)
    found = [variant["static"].get(point) for variant in variants.values()]
    for direction in DIRECTIONS:
        links = [place["weak_link"].get(direction) if place else None for place in found]
        if not any(links):
            continue
        _add_cells(
            table,
            f"weak link {direction}",
            [
                MISSING if link is None else f"{link['name']}\n{100 * link['share']:.0f} %"
                for link in links
            ],
        )


def _with_error(value: float, error: float | None) -> str:
    return f"{show_bounded(value, error)} {show_bound(value, error)}"


def _mode_cell(cell: CellSummary | None, variant: VariantSummary) -> str:
    if cell is None:
        return MISSING
    hz, elastic = cell["frequency_hz"], cell["number"] > variant["rigid_count"]
    shown = _with_error(hz, cell["error_hz"]) if elastic else show_digits(hz, 4)
    if cell["mac"] is None:
        return shown
    deviation = "" if cell["deviation"] is None else f"{100 * cell['deviation']:+.1f} %  "
    return f"{shown}\n{deviation}MAC {cell['mac']:.2f}"


def _percent(value: float, first: float | None) -> str:
    if not first or value == first:
        return ""
    return f"\n{100 * (value / first - 1.0):+.1f} %"


def _largest_deviation(summary: ComparisonSummary, name: str) -> str:
    cells = [row["variants"][name] for row in summary["modes"]]
    found = [
        cell["deviation"] for cell in cells if cell is not None and cell["deviation"] is not None
    ]
    return f"{100 * max(found, key=abs):+.1f} %" if found else MISSING


def _missed_and_added(summary: ComparisonSummary, name: str) -> str:
    if name == summary["reference"]:
        return MISSING
    cells = [
        (row["origin"] == summary["reference"], row["variants"][name] is not None)
        for row in summary["modes"]
    ]
    return f"{sum(mine and not there for mine, there in cells)}, {sum(there and not mine for mine, there in cells)}"


def _describe_fidelity(variant: VariantSummary) -> str:
    kinds = list(variant["fidelity"].values())
    return "\n".join(
        f"{kinds.count(kind)} {kind}"
        for kind in ("elastic", "superelement", "segmented", "rigid")
        if kind in kinds
    )
