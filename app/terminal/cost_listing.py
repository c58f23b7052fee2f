"""What a study with a truth shows: error beside cost of every point, the best ones, and what the next digit costs."""

from collections.abc import Sequence

from headstock.app.terminal.console import add_row, make_console, make_table, print_table, spaced
from headstock.app.texts.error_texts import show_bound, show_bounded
from headstock.app.texts.tables import PlainTable
from headstock.pipeline.storage.json_texts import Json
from headstock.studies.parameters.costs import CostPoint, cheapest_within
from headstock.studies.parameters.tables import shorten_columns

BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)


def print_costs(points: Sequence[CostPoint]) -> None:
    """Error and cost of each point, and the cheapest for each of some accuracies."""
    console = make_console()
    console.print()
    if not points:
        console.print("nothing to hold the points against: the study's truth failed", style="bold red", markup=False)
        return
    table = make_table("settings", ">off by %", "most off", ">cpu s", ">of it solving", ">MB", ">dofs", "")
    short = shorten_columns(list(dict.fromkeys(point.worst for point in points)))
    for point in points:
        memory = f"{'' if point.memory_known else '≤ '}{spaced(round(point.memory_mb))}"
        cost = (_show_seconds(point), f"{point.solve_seconds:.3g}", memory, spaced(point.dofs))
        add_row(table, point.name, f"{100.0 * point.error:.3g}", short[point.worst], *cost, _mark(point))
    print_table(console, "What accuracy costs: largest error of a watched number, and processor time from an empty store", table)
    for line in digit_words(points):
        console.print(f"  {line}", markup=False)
    console.print()


def _show_seconds(point: CostPoint) -> str:
    median, spread = point.cpu_seconds
    if len(point.row.record.cpu_seconds) < 2:
        return f"{median:.3g}"
    return f"{show_bounded(median, spread / 2.0)} {show_bound(median, spread / 2.0)}"


def _mark(point: CostPoint) -> str:
    return "automatic" if point.automatic else "other model" if point.other_model else "best" if point.best else ""


def digit_words(points: Sequence[CostPoint]) -> list[str]:
    """The cheapest point for each accuracy and how many times the time of the one before it takes, automatic choices, other models."""
    lines = []
    before: CostPoint | None = None
    for bound in BOUNDS:
        found = cheapest_within(points, bound)
        if found is None:
            lines.append(f"{100.0 * bound:g} %: reached by none of these")
        elif found is before:
            lines.append(f"{100.0 * bound:g} %: the same")
        else:
            more = f", {found.cpu_seconds[0] / before.cpu_seconds[0]:.2g} times the line above" if before else ""
            lines.append(
                f"{100.0 * bound:g} %: {found.name} ({100.0 * found.error:.2g} %), {found.cpu_seconds[0]:.3g} s of processor time{more}"
            )
        before = found
    return [*lines, *(_compare(point, points) for point in points if point.automatic), *_spreads(points)]


def _compare(point: CostPoint, points: Sequence[CostPoint]) -> str:
    """An automatic choice beside the cheapest of the others that is as good as what it was asked for."""
    chosen = point.row.record.summary["accuracy"]
    words = f"automatic, {100.0 * chosen['asked']:g} % asked: off by {100.0 * point.error:.2g} %, {point.cpu_seconds[0]:.3g} s"
    other = cheapest_within(points, chosen["asked"])
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
        *("settings", "error", "most off", "cpu seconds", "cpu spread", "seconds", "spread", "solving cpu seconds"),
        *("MB", "MB known", "dofs", "best", "automatic", "other model"),
    )
    rows = tuple(
        (
            *(point.name, point.error, point.worst, *point.cpu_seconds, *point.seconds, point.solve_seconds),
            *(point.memory_mb, point.memory_known, point.dofs, point.best, point.automatic, point.other_model),
        )
        for point in points
    )
    return PlainTable("cost", columns, rows)


def list_costs(points: Sequence[CostPoint]) -> Json:
    """The same for ``study.json``."""
    table = cost_table(points)
    rows = [dict(zip(table.headings, row, strict=True)) for row in table.rows]
    return {
        "costs": [row | {"error": row["error"] if row["error"] != float("inf") else None} for row in rows],
        "digits": digit_words(points),
    }
