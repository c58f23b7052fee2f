"""What a study with a truth shows: error beside cost of every point, the best ones, and what the next digit costs."""

from collections.abc import Sequence

from headstock.app.console import add_row, make_console, make_table, print_table
from headstock.app.summary_tables import PlainTable
from headstock.pipeline.cost_points import CostPoint, cheapest_within
from headstock.pipeline.json_texts import Json
from headstock.pipeline.study_points import shorten_key, show_value

BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)


def print_costs(points: Sequence[CostPoint]) -> None:
    """Error and cost of each point, and the cheapest for each of some accuracies."""
    if not points:
        make_console().print("nothing to hold the points against: the study's truth failed", style="bold red", markup=False)
        return
    table = make_table("settings", ">off by %", "most off", ">cpu s", ">s", ">MB", ">dofs", "")
    for point in points:
        mark = "automatic" if point.automatic else "best" if point.best else ""
        cpu, wall = (f"{median:.3g} ± {spread / 2.0:.1g}" for median, spread in (point.cpu_seconds, point.seconds))
        numbers = (
            f"{100.0 * point.error:.3g}",
            point.worst,
            cpu,
            wall,
            f"{'' if point.memory_known else '≤ '}{point.memory_mb:.0f}",
            f"{point.dofs:,}".replace(",", " "),
        )
        add_row(table, name_point(point), *numbers, mark)
    print_table(
        make_console(), "What accuracy costs: largest error of a watched number, and processor time from an empty store", table
    )
    for line in digit_words(points):
        make_console().print(f"  {line}", markup=False)


def name_point(point: CostPoint) -> str:
    """A point in a few words."""
    record = point.row.record
    words = [f"{shorten_key(key)} = {show_value(value)}" for key, value in record.varied.items()]
    return ", ".join([*([record.family.replace("_", " ")] if record.family else []), *words])


def digit_words(points: Sequence[CostPoint]) -> list[str]:
    """The cheapest point for each accuracy, and how many times the time of the one before it takes."""
    lines, before = [], None
    for bound in BOUNDS:
        found = cheapest_within(points, bound)
        if found is None:
            lines.append(f"{100.0 * bound:g} %: reached by none of these")
            continue
        more = f", {found.cpu_seconds[0] / before:.2g} times the line above" if before else ""
        lines.append(f"{100.0 * bound:g} %: {name_point(found)}, {found.cpu_seconds[0]:.3g} s of processor time{more}")
        before = found.cpu_seconds[0]
    return lines + [_compare(point, points) for point in points if point.automatic]


def _compare(point: CostPoint, points: Sequence[CostPoint]) -> str:
    """An automatic choice beside the cheapest of the others that is as good as what it was asked for."""
    chosen = point.row.record.summary["accuracy"]
    words = f"automatic, {100.0 * chosen['asked']:g} % asked: off by {100.0 * point.error:.2g} %, {point.cpu_seconds[0]:.3g} s"
    other = cheapest_within(points, chosen["asked"])
    if other is None:
        return f"{words}; none of the others is that close"
    return (
        f"{words}, {point.cpu_seconds[0] / other.cpu_seconds[0]:.2g} times the cheapest that is close enough ({name_point(other)})"
    )


def cost_table(points: Sequence[CostPoint]) -> PlainTable:
    """The same for a CSV file."""
    columns = ("settings", "error", "most off", "cpu seconds", "cpu spread", "seconds", "spread", "MB", "dofs", "best", "automatic")
    rows = tuple(
        (
            name_point(point),
            point.error,
            point.worst,
            *point.cpu_seconds,
            *point.seconds,
            point.memory_mb,
            point.dofs,
            point.best,
            point.automatic,
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
