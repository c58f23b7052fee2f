"""A study on the terminal, as CSV and as JSON: progress, its table, orders of convergence; with a
reference run, error beside cost.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from headstock.app.tables.table import Cell, PlainTable, encode_csv
from headstock.app.terminal.console import (
    Screen,
    add_row,
    make_console,
    make_table,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.texts.bounded_values import AND_MORE, show_bound, show_bounded, show_error
from headstock.scene.reading.watch_paths import MEASURED_NAMES
from headstock.scene.studies import describe_point, list_varied, shorten_key, show_setting
from headstock.studies.parameters.costs import CostPoint, cheapest_within, weigh_costs
from headstock.studies.parameters.records import POINTS_FILE, StudyRecord
from headstock.studies.parameters.runs import StudyProgress
from headstock.studies.parameters.tables import (
    SizeSeries,
    StudyRow,
    StudyTable,
    known_head,
    median_seconds,
    series_title,
    shorten_columns,
    varied_numbers,
)

BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)
DIGITS = 6
ERROR_LENGTH = 300
HEADING_WIDTH = 12


def _print_costs(points: Sequence[CostPoint]) -> None:
    """Error and cost of each point, and the cheapest for each of some accuracies."""
    console = make_console()
    console.print()
    if not points:
        console.say(
            "nothing to compare the points with: the reference run of the study failed",
            style="bold red",
        )
        return
    table = make_table(
        "settings", ">off by %", "most off", ">cpu s", ">of it solving", ">MB", ">dofs", ""
    )
    short = shorten_columns(list(dict.fromkeys(point.worst for point in points)))
    for point in points:
        memory = f"{'' if point.memory_known else '≤ '}{spaced(round(point.memory_mb))}"
        cost = (_show_seconds(point), f"{point.solve_seconds:.3g}", memory, spaced(point.dofs))
        add_row(
            table, point.name, f"{100.0 * point.error:.3g}", short[point.worst], *cost, _mark(point)
        )
    print_table(
        console,
        "What accuracy costs: largest error of a watched number, and processor time from an empty store",
        table,
    )
    for line in digit_words(points):
        console.say(f"  {line}")
    console.print()


def _show_seconds(point: CostPoint) -> str:
    median, spread = point.cpu_seconds
    if len(point.row.record.cpu_seconds) < 2:
        return f"{median:.3g}"
    return f"{show_bounded(median, spread / 2.0)} {show_bound(median, spread / 2.0)}"


def _mark(point: CostPoint) -> str:
    return (
        "automatic"
        if point.automatic
        else "other model"
        if point.other_model
        else "best"
        if point.best
        else ""
    )


def digit_words(points: Sequence[CostPoint]) -> list[str]:
    """The cheapest point for each accuracy and how many times the time of the one before it takes,
    automatic choices, other models.
    """
    lines = []
    before: CostPoint | None = None
    for bound in BOUNDS:
        found = cheapest_within(points, bound)
        if found is None:
            lines.append(f"{100.0 * bound:g} %: reached by none of these")
        elif found is before:
            lines.append(f"{100.0 * bound:g} %: the same")
        else:
            more = (
                f", {found.cpu_seconds[0] / before.cpu_seconds[0]:.2g} times the line above"
                if before
                else ""
            )
            lines.append(
                f"{100.0 * bound:g} %: {found.name} ({100.0 * found.error:.2g} %), {found.cpu_seconds[0]:.3g} s of processor time{more}"
            )
        before = found
    return [
        *lines,
        *(
            _compare(point, point.accuracy["requested"], points)
            for point in points
            if point.automatic and point.accuracy
        ),
        *_spreads(points),
    ]


def _compare(point: CostPoint, asked: float, points: Sequence[CostPoint]) -> str:
    """An automatic choice beside the cheapest of the others that is as good as what it was asked
    for.
    """
    words = f"automatic, {100.0 * asked:g} % asked: off by {100.0 * point.error:.2g} %, {point.cpu_seconds[0]:.3g} s"
    other = cheapest_within(points, asked)
    if other is None:
        return f"{words}; none of the others is that close"
    return f"{words}, {point.cpu_seconds[0] / other.cpu_seconds[0]:.2g} times the cheapest that is close enough ({other.name})"


def _spreads(points: Sequence[CostPoint]) -> list[str]:
    """How far each other model lies from this one, on its finest mesh."""
    finest: dict[str, CostPoint] = {}
    for point in points:
        family = point.row.record.family
        if point.other_model and (family not in finest or point.dofs > finest[family].dofs):
            finest[family] = point
    return [
        f"{point.name}: another model, {100.0 * point.error:.2g} % away in {point.worst}: a spread that no finer mesh takes away"
        for point in finest.values()
    ]


def cost_table(points: Sequence[CostPoint]) -> PlainTable:
    """The same for a CSV file."""
    columns = (
        *(
            "settings",
            "error",
            "most off",
            "cpu seconds",
            "cpu spread",
            "seconds",
            "spread",
            "solving cpu seconds",
        ),
        *("MB", "MB known", "dofs", "best", "automatic", "other model"),
    )
    rows = tuple(
        (
            *(
                point.name,
                point.error,
                point.worst,
                *point.cpu_seconds,
                *point.seconds,
                point.solve_seconds,
            ),
            *(
                point.memory_mb,
                point.memory_known,
                point.dofs,
                point.best,
                point.automatic,
                point.other_model,
            ),
        )
        for point in points
    )
    return PlainTable("cost", columns, rows)


def list_costs(points: Sequence[CostPoint]) -> list[dict[str, Cell]]:
    """The same for ``study.json``, a row per point."""
    table = cost_table(points)
    rows = [dict(zip(table.headings, row, strict=True)) for row in table.rows]
    return [row | {"error": row["error"] if row["error"] != float("inf") else None} for row in rows]


def print_progress(progress: StudyProgress) -> None:
    """One line per point: how it went, and whether it was finished before."""
    record = progress.record
    seconds = median_seconds(record)
    spent = (
        "  finished before"
        if progress.known
        else f"{seconds[0]:8.2f} s"
        if seconds
        else f"{'':8}  "
    )
    state = f"  {record.status}: {record.error[:ERROR_LENGTH]}" if record.status == "failed" else ""
    line = f"  {progress.number + 1:>4}/{progress.total}  {spent}  {describe_point(progress.point)}{state}"
    make_console().say(line, soft_wrap=True)


def print_study(table: StudyTable, *, seconds: float, folder: Path) -> None:
    """The table of a study (of one with a reference run: errors beside costs), its orders of convergence,
    and what was measured how.

    Args:
        seconds: That this run took [s].
    """
    console = make_console()
    console.print()
    if table.columns and table.study.reference_run is None:
        _print_rows(console, table)
    if table.series:
        _print_orders(console, table.series)
    if table.study.reference_run is not None:
        _print_costs(weigh_costs(table))
    failed = [row.record for row in table.rows if row.record.status == "failed"]
    for record in failed:
        name = ", ".join([record.family, *list_varied(record.varied)])
        console.say(f"failed: {name.removeprefix(', ')}: {record.error}", style="bold red")
    for words in dict.fromkeys(words for row in table.rows for words in row.unknown):
        console.say(f"  {AND_MORE} : {words}")
    print_remarks(list(dict.fromkeys(problem for row in table.rows for problem in row.problems)))
    console.say(_describe_timing(table))
    done = len(table.rows) - len(failed)
    text = f"{done} of {len(table.rows)} points done, {seconds:.2f} s in this run, results in {folder} ({POINTS_FILE}, study.csv)"
    console.say(text, style="bold")


def _describe_timing(table: StudyTable) -> str:
    """How the seconds of a study were measured: store, repeats, threads, ranks."""
    records = [row.record for row in table.rows if row.record.seconds]
    threads, ranks = (
        _span(getattr(record, name) for record in records) for name in ("threads", "ranks")
    )
    spreads = [
        spread / median
        for record in records
        if (measured := median_seconds(record))
        for median, spread in [measured]
        if median
    ]
    cached = sum(record.cached_stages for record in records)
    store = (
        "every point from an empty store (element kernels are compiled once per installation and not counted)"
        if table.study.cold
        else f"with the store in use, which answered {cached} stages; --cold measures without it"
    )
    repeats = (
        f"median of {table.study.repeats} runs, spread up to {100 * max(spreads):.0f} %"
        if table.study.repeats > 1 and spreads
        else "one run"
    )
    return f"seconds: {store}; {repeats}; BLAS threads {threads}, ranks {ranks}"


def study_csv(table: StudyTable) -> bytes:
    """One row per point: family, varied keys, watched values, seconds with their spread, state.

    Varied quantities are numbers in SI with their unit in the head (``components.bed.mesh.size
    [m]``); other values stand as written.
    """
    varied = [_tabulate_key(table, key) for key in table.varied]
    columns = [column for column in table.columns if column not in MEASURED_NAMES]
    partly = [column for column in columns if any(column in row.known for row in table.rows)]
    rows = tuple(
        (
            row.record.family,
            *(values[number] for _, values in varied),
            *(row.values.get(column) for column in columns),
            *(row.known.get(column) for column in partly),
            *_timing_cells(row.record),
        )
        for number, row in enumerate(table.rows)
    )
    heads = (*map(table.head_of, columns), *map(known_head, partly), *TIMING_HEADS)
    headings = ("family", *(head for head, _ in varied), *heads)
    return encode_csv(PlainTable("study", headings, rows))


def _tabulate_key(table: StudyTable, key: str) -> tuple[str, Sequence[Cell]]:
    """Head and values of a key, as numbers where they are quantities of one kind."""
    found = varied_numbers(table, key)
    if found is not None:
        return (f"{key} [{found.unit}]" if found.unit else key), found.values
    settings = [row.record.varied for row in table.rows]
    return key, [show_setting(varied[key]) if key in varied else None for varied in settings]


def list_study(table: StudyTable, scene: Path) -> dict[str, object]:
    """Return the content of ``study.json``; with a published reference ``claims`` on its statements, and
    costs with a reference run, join it.
    """
    return {
        "scene": scene.name,
        "study": table.study.name,
        "reference": table.study.reference,
        "store": "cold" if table.study.cold else "warm",
        "repeats": table.study.repeats,
        "timing": _describe_timing(table),
        "rows": [_list_row(row) for row in table.rows],
        "orders": [_list_series(series) for series in table.series],
    }


def _list_row(row: StudyRow) -> dict[str, object]:
    """Return a point: of errors with unknown sources ``known`` is the sum of the others, ``missing`` says
    which watched paths led nowhere, seconds have an item per repeat.
    """
    record = row.record
    partly = {"known": dict(row.known), "unknown": list(row.unknown)} if row.known else {}
    return {
        "family": record.family,
        "varied": record.varied,
        "status": record.status,
        "error": record.error,
        "values": row.values,
        "missing": list(row.problems),
        **partly,
        "measured": record.measured,
        "seconds": list(record.seconds),
        "cpu_seconds": list(record.cpu_seconds),
        "threads": record.threads,
        "ranks": record.ranks,
        "cached_stages": record.cached_stages,
    }


def _list_series(series: SizeSeries) -> dict[str, object]:
    found = series.extrapolation
    return {
        "column": series.column,
        "family": series.family,
        "others": series.others,
        "sizes_m": list(series.sizes),
        "values": list(series.values),
        "order": found.order,
        "extrapolated": found.limit,
        "finest_error": found.error,
        "remark": found.remark,
    }


TIMING_HEADS = (
    *("seconds", "seconds spread", "cpu seconds"),
    *("threads", "ranks", "cached stages", "status", "error"),
)


def _timing_cells(record: StudyRecord) -> tuple[Cell, ...]:
    wall, cpu = median_seconds(record), median_seconds(record, "cpu_seconds")
    spent = (wall[0], wall[1]) if wall else (None, None)
    return (
        *spent,
        cpu[0] if cpu else None,
        record.threads,
        record.ranks,
        record.cached_stages,
        record.status,
        record.error,
    )


def _print_rows(console: Screen, table: StudyTable) -> None:
    short = shorten_columns(table.columns)
    families = any(row.record.family for row in table.rows)
    keys = {key: shorten_key(key) for key in table.varied}
    headings = [
        *keys.values(),
        *(
            table.head_of(column) if short[column] == column else short[column]
            for column in table.columns
        ),
    ]
    shown = make_table(
        *(["family"] if families else []), *(f">{_break_heading(heading)}" for heading in headings)
    )
    for row in table.rows:
        varied = (
            show_setting(row.record.varied[key]) if key in row.record.varied else "" for key in keys
        )
        values = (_show_cell(row, column, repeats=table.study.repeats) for column in table.columns)
        add_row(shown, *([row.record.family] if families else []), *varied, *values)
    print_table(console, f"Study {table.study.name}", shown)


def _break_heading(text: str) -> str:
    """A long heading over several lines, broken where its parts meet."""
    lines = [""]
    for part in re.findall(r"[._\[]?[^._\[]+", text):
        if lines[-1] and len(lines[-1]) + len(part) > HEADING_WIDTH:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def _show_cell(row: StudyRow, column: str, *, repeats: int) -> str:
    value = row.values.get(column)
    if column in row.known:
        return f"{show_error(row.known[column])} {AND_MORE}"
    if value is None:
        return "failed" if row.record.status == "failed" else "-"
    if column in MEASURED_NAMES:
        measured = median_seconds(row.record, column)
        if measured is None or repeats < 2:
            return f"{value:.3g}"
        return f"{show_bounded(measured[0], measured[1] / 2.0)} {show_bound(measured[0], measured[1] / 2.0)}"
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


def _print_orders(console: Screen, found: Sequence[SizeSeries]) -> None:
    short = shorten_columns([series.column for series in found])
    titled = any(series_title(series) for series in found)
    remarks = list(dict.fromkeys(filter(None, (series.extrapolation.remark for series in found))))
    table = make_table(
        "value",
        *(["of"] if titled else []),
        ">finest",
        ">order",
        ">extrapolated",
        ">finest off by",
        "",
    )
    for series in found:
        out = series.extrapolation
        numbers = (
            ("-", "-", "-")
            if out.order is None or out.limit is None
            else (
                f"{out.order:.2f}",
                f"{out.limit:.{DIGITS}g}",
                "-" if out.error is None else f"{100 * out.error:+.3f} %",
            )
        )
        title = [series_title(series)] if titled else []
        note = f"({remarks.index(out.remark) + 1})" if out.remark else ""
        add_row(table, short[series.column], *title, f"{out.finest:.{DIGITS}g}", *numbers, note)
    print_table(
        console,
        "Order of convergence by the three finest meshes, and Richardson's extrapolation",
        table,
    )
    for number, remark in enumerate(remarks, 1):
        console.say(f"  ({number}) {remark}")


def _span(numbers: Iterable[int]) -> str:
    known = sorted(set(numbers))
    return "-" if not known else f"{known[0]}" if len(known) == 1 else f"{known[0]} to {known[-1]}"
