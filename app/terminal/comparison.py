"""Variants side by side as the terminal shows them."""

from collections.abc import Mapping, Sequence

from rich.table import Table
from rich.text import Text

from headstock.app.tables.comparison import (
    STEP_NAMES,
    alike_rigid_modes,
    describe_store,
    list_points,
    read_compliance,
    row_frequencies,
    variant_error_words,
)
from headstock.app.tables.model_answers import (
    CANNOT,
    MISSING,
    ModelRow,
    cannot_words,
    cost_rows,
    nearest_mac,
    other_sections,
    response_sections,
    share_rows,
    show_change,
    verdict_words,
)
from headstock.app.terminal.console import (
    WIDTH_WITHOUT_TERMINAL,
    Screen,
    make_console,
    make_table,
    print_table,
)
from headstock.app.texts.bounded_values import show_bound, show_bounded, show_digits
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.numbers.estimates import known_part
from headstock.studies.comparison_summary import (
    ComparisonSummary,
    EffortSummary,
    RowSummary,
    VariantSummary,
)

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
    make_console().say("\n".join(parts), soft_wrap=True)


def print_comparison(summary: ComparisonSummary) -> None:
    """The table a designer decides from: modes, compliances, responses, weak links, and what each
    variant costs; then what a simpler model of the same machine is good for.
    """
    console = make_console()
    console.print()
    rows = _Rows(summary, make_table("", *(f">{name}" for name in summary["columns"])))
    piped = console.width == WIDTH_WITHOUT_TERMINAL and not console.is_terminal
    rows.table.columns[0].min_width = NAME_WIDTH if piped else None
    if summary["modes"]:
        _add_modes(rows)
    for point in list_points(summary):
        _add_point(rows, point)
    for section in (*response_sections(summary, drive_points=True), *other_sections(summary)):
        rows.table.add_section()
        rows.add_head(section.title)
        rows.add_rows(section.rows)
    rows.table.add_section()
    rows.add_rows(cost_rows(summary))
    what = "models" if summary["verdicts"] else "variants"
    print_table(
        console,
        f"{summary['scene']}: {what} in pose {summary['pose']}, compared with {summary['reference']}",
        rows.table,
    )
    for words in verdict_words(summary):
        console.say(words, style="bold")
    for words in cannot_words(summary):
        console.say(words)
    _print_notes(console, summary)


class _Rows:
    """Rows of the table, in the order of its columns."""

    def __init__(self, summary: ComparisonSummary, table: Table) -> None:
        self.summary, self.table = summary, table

    def add_head(self, title: str, cells: Mapping[str, str] | None = None) -> None:
        """A heading of a section."""
        shown = [(cells or {}).get(name, "") for name in self.summary["columns"]]
        self.table.add_row(Text(title, style="bold"), *(Text(cell, style="dim") for cell in shown))

    def add(self, head: str, cells: Mapping[str, str]) -> None:
        """A row; a model that there is none of cannot answer."""
        shown = [
            CANNOT if name in self.summary["not_computed"] else cells.get(name, MISSING)
            for name in self.summary["columns"]
        ]
        self.table.add_row(Text(head), *(Text(cell) for cell in shown))

    def add_rows(self, rows: Sequence[ModelRow]) -> None:
        """Rows whose cells are laid out."""
        for row in rows:
            self.add(
                row.head,
                {
                    name: "\n".join(filter(None, (cell.text, cell.small)))
                    for name, cell in row.cells.items()
                },
            )


def _add_modes(rows: _Rows) -> None:
    summary, variants = rows.summary, rows.summary["variants"]
    rows.add_head(
        "Natural frequencies [Hz]",
        {name: _describe_fidelity(variant) for name, variant in variants.items()},
    )
    alike = alike_rigid_modes(summary)
    if alike:
        spans = {name: [row_frequencies(row)[name] for row in alike] for name in variants}
        rows.add(
            f"{len(alike)} rigid-body modes, alike",
            {name: f"{min(span):.4g} .. {max(span):.4g}" for name, span in spans.items()},
        )
    for row in (row for row in summary["modes"] if row not in alike):
        rows.add(
            _name_row(summary, row),
            {name: _mode_cell(summary, row, name) for name in variants},
        )
    rows.table.add_section()
    rows.add("largest deviation", {name: _largest_deviation(summary, name) for name in variants})
    rows.add("modes it misses, adds", {name: _missed_and_added(summary, name) for name in variants})


def _name_row(summary: ComparisonSummary, row: RowSummary) -> str:
    """A mode's name, with its number where the columns are models of one machine."""
    own = row["variants"][summary["reference"]]
    if row["origin"] != summary["reference"]:
        return f"{row['name']} (first in {row['origin']})"
    number = f"f{own['number']}  " if summary["verdicts"] and own is not None else ""
    return f"{number}{row['name']}"


def _print_notes(console: Screen, summary: ComparisonSummary) -> None:
    imports = sum(variant["effort"]["import_seconds"] for variant in summary["variants"].values())
    apart = (
        f" Loading the finite element library ({imports:.2f} s) is not counted." if imports else ""
    )
    text = (
        "Modes are paired by shape (MAC at sample points of each body); a MAC of "
        f"{summary['mac_threshold']:g} or more is the same mode. {MISSING} means that the variant "
        "has none, a question mark after ± that the error, or its rest, is not estimated. Deviations are "
        "relative to the first variant of a row. Seconds leave out error estimates; memory is "
        f"that of the whole process.{apart}"
    )
    console.say(text)
    for words in (*variant_error_words(summary), *summary["not_compared"]):
        console.say(words)
    for name, variant in summary["variants"].items():
        for failure in variant["failures"]:
            console.say(f"failed: {name}: {failure}", style="bold red")


def print_effort(summary: ComparisonSummary) -> None:
    """Print what the first model and a changed one cost, where that was measured from an empty store."""
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
    print_table(console, f"Effort from scene to answers, from an empty store{changed}", table)


def _add_point(rows: _Rows, point: str) -> None:
    summary, variants = rows.summary, rows.summary["variants"]
    rows.table.add_section()
    rows.add_head(f"Compliance at {point} [µm/kN]")
    for j, direction in enumerate(DIRECTIONS):
        first = read_compliance(summary, summary["reference"], point, j, j)
        cells = {}
        for name, variant in variants.items():
            value = read_compliance(summary, name, point, j, j)
            if value is not None:
                own = variant["static"][point]
                error, shares = (
                    own["error_um_per_kN"][direction],
                    own["error_share"].get(direction, {}),
                )
                shown = _with_error(value, error, shares)
                cells[name] = "\n".join(filter(None, (shown, show_change(value, first))))
        rows.add(f"d{direction}/F{direction}", cells)
        if summary["verdicts"]:
            rows.add_rows(share_rows(summary, point, direction))
    for direction in DIRECTIONS:
        links = {
            name: variant["static"][point]["weak_link"].get(direction)
            for name, variant in variants.items()
            if point in variant["static"]
        }
        cells = {
            name: f"{link['name']}\n{100 * link['share']:.0f} %"
            for name, link in links.items()
            if link is not None
        }
        if cells:
            rows.add(f"weak link {direction}", cells)


def _with_error(value: float, error: float | None, shares: Mapping[str, float | None]) -> str:
    return f"{show_bounded(value, error)} {show_bound(value, error, known_part(shares))}"


def _mode_cell(summary: ComparisonSummary, row: RowSummary, name: str) -> str:
    cell, variant = row["variants"][name], summary["variants"][name]
    if cell is None:
        return _missing_cell(summary, row, variant)
    hz, elastic = cell["frequency_hz"], cell["number"] > variant["rigid_count"]
    # modes beyond those asked for have an error, but no list of sources
    shares = dict(enumerate(variant["error_share"], 1)).get(cell["number"], {})
    shown = _with_error(hz, cell["error_hz"], shares) if elastic else show_digits(hz, 4)
    if cell["mac"] is None:
        return shown
    first = row["variants"][row["origin"]]
    known = first is not None and cell["deviation"] is not None
    change = show_change(hz, first["frequency_hz"]) if first is not None and known else ""
    deviation = f"{change}  " if change else ""
    return f"{shown}\n{deviation}MAC {cell['mac']:.2f}"


def _missing_cell(summary: ComparisonSummary, row: RowSummary, variant: VariantSummary) -> str:
    """A mode that a variant has not got, with the nearest shape that it has."""
    best = nearest_mac(summary, row, variant)
    return MISSING if best is None else f"{MISSING}\nMAC {best:.2f} at best"


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
        for kind in ("elastic", "superelement", "polynomial", "segmented", "rigid")
        if kind in kinds
    )
