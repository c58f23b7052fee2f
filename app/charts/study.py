"""A study as figures: a small chart per watched number, and error against cost with the front of what is worth
its cost; and mesh convergence: how far numbers are from their limits, over degrees of freedom and over seconds.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from headstock.app.charts.charts import (
    FAINT,
    INK,
    add_legend,
    calm_axes,
    encode_figure,
    label_axes,
    label_decades,
    label_shares,
    line_style,
    new_figure,
)
from headstock.app.pictures.libraries import Axes, Line2D, NullFormatter, NullLocator, withStroke
from headstock.scene.reading.units import DIMENSIONS, read_unit, unit_of
from headstock.scene.studies import shorten_key, show_setting
from headstock.studies.parameters.convergence import Convergence
from headstock.studies.parameters.costs import CostPoint, pareto_front, read_cost
from headstock.studies.parameters.limits import MeshNeed, list_deviations
from headstock.studies.parameters.tables import (
    MESH_SIZE,
    StudyRow,
    StudyTable,
    is_number,
    shorten_columns,
    varied_numbers,
)

MOST_PANELS = 30
MOST_TICKS = 7
MOST_LETTERS = 30  # below a panel, side by side
PANEL_COLUMNS = 3
COLORS = (
    "#4f7cac",
    "#d97706",
    "#2f855a",
    "#b83280",
    "#6b46c1",
    "#718096",
    "#0e7490",
    "#be123c",
    "#a16207",
    "#334155",
    "#65a30d",
    "#7c3aed",
)
# ending of a result's name to its unit
UNITS = {
    "um_per_kN": "µm/kN",
    "N_per_um": "N/µm",
    "hz": "Hz",
    "kg": "kg",
    "mb": "MB",
    "mpa": "MPa",
    "um": "µm",
    "urad": "µrad",
    "mm": "mm",
    "s": "s",
    "seconds": "s",
}
TITLE_LENGTH = 44
LINE: dict[str, Any] = {"marker": "o", "markersize": 3.5, "linewidth": 1.3}
_STEP = re.compile(r"[^.\[\]]+|\[-?\d+\]")
TITLES = {"cpu": "processor time [s]", "memory": "peak memory [MB]", "dofs": "degrees of freedom"}
MARKS = "osD^vP<>hX"
SMALLEST = 1e-6


@dataclass(frozen=True, eq=False)
class _Axis:
    """What is drawn along x: a varied key, its label, the place of each of its values, and what
    stands at each place.
    """

    key: str
    label: str
    places: dict[str, float]
    marks: dict[float, str]
    logarithmic: bool


def draw_study(table: StudyTable) -> bytes | None:
    """The watched numbers over the first varied key (a mesh size before others); None where no
    number is watched.

    Every line is drawn; of more than thirty watched numbers the first thirty, which the figure
    says.
    """
    every = [
        column
        for column in table.columns
        if any(is_number(row.values.get(column)) for row in table.rows)
    ]
    columns, axis = every[:MOST_PANELS], _choose_axis(table)
    if not columns or axis is None:
        return None
    width = min(PANEL_COLUMNS, len(columns))
    height = -(-len(columns) // width)
    figure = new_figure(3.6 * width + 0.6, 2.5 * height + 0.7)
    short = shorten_columns(columns)
    lines = _lines(table, axis.key)
    for number, column in enumerate(columns):
        axes = figure.add_subplot(height, width, number + 1)
        _draw_panel(axes, table, lines, column, axis)
        named = table.head_of(column)
        title = named if named != column else _describe_column(column, short[column])
        label_axes(axes, title=title)
        if number >= len(columns) - width:
            axes.set_xlabel(axis.label, fontsize=8, color=INK)
    if len(columns) < len(every):
        figure.suptitle(
            f"the first {len(columns)} of {len(every)} watched numbers; study.csv holds all",
            fontsize=9,
            color=INK,
        )
    titled = {
        title: Line2D([], [], **LINE, **line_style(number, COLORS))
        for number, title in enumerate(lines)
        if title
    }
    add_legend(figure, list(titled.values()), list(titled))
    return encode_figure(figure)


def _describe_column(column: str, short: str) -> str:
    """A watched path in words with its unit: ``modal.frequencies_hz[0]`` is ``frequency 1 [Hz]``.

    Args:
        short: Its last names, as many as tell it from the others.
    """
    steps = _STEP.findall(short if "." in short or "[" in short else column.split(".")[-1])
    names = [step for step in steps if not step.startswith("[")]
    numbers = [int(step[1:-1]) for step in steps if step.startswith("[")]
    ending = next((end for end in UNITS if names[-1] == end or names[-1].endswith(f"_{end}")), None)
    words = [*names[:-1], names[-1].removesuffix(ending or "").rstrip("_") or names[-1]]
    if names[-1].startswith("compliance") and len(numbers) == len("xy"):
        words.append("".join(map(_name_axis, numbers)))
    else:
        words += [str(number + 1 if number >= 0 else number) for number in numbers]
    text = " ".join(words).replace("_", " ").replace("frequencies", "frequency")
    text = text if len(text) <= TITLE_LENGTH else f"…{text[-TITLE_LENGTH:]}"
    return f"{text} [{UNITS[ending]}]" if ending else text


def _name_axis(number: int) -> str:
    return "xyz"[number] if 0 <= number < len("xyz") else str(number + 1)


def _choose_axis(table: StudyTable) -> _Axis | None:
    values = {key: _list_settings(table, key) for key in table.varied}
    many = [key for key in table.varied if len(values[key]) > 1] or list(table.varied)
    sizes = [key for key in many if MESH_SIZE.fullmatch(key)]
    if not many:
        return None
    key = (sizes or many)[0]
    found = varied_numbers(table, key)
    if found is None:
        places = {value: float(place) for place, value in enumerate(values[key])}
        return _Axis(
            key,
            shorten_key(key),
            places,
            {place: value for value, place in places.items()},
            logarithmic=False,
        )
    rows = [
        (show_setting(row.record.varied[key]), number)
        for row, number in zip(table.rows, found.values, strict=True)
        if number is not None
    ]
    unit, factor = _written_unit(values[key], found.unit)
    known = {text: number / factor for text, number in rows}
    label = f"{shorten_key(key)} [{unit}]" if unit else shorten_key(key)
    low, high = min(known.values()), max(known.values())
    marks = {number: f"{number:.6g}" for number in known.values()}
    return _Axis(key, label, known, marks, logarithmic=low > 0.0 and high >= 4.0 * low)


def _list_settings(table: StudyTable, key: str) -> list[str]:
    """The values of a key as they are written, each once."""
    varied = [row.record.varied for row in table.rows]
    return list(dict.fromkeys(show_setting(each[key]) for each in varied if key in each))


def _written_unit(texts: Sequence[str], unit: str) -> tuple[str, float]:
    """The unit in which all values are written, and its size in SI; else the SI unit."""
    written = {unit_of(text) for text in texts}
    if len(written) == 1 and (name := written.pop()):
        return name, float(read_unit(name, *DIMENSIONS).factor)
    return unit, 1.0


def _draw_panel(
    axes: Axes, table: StudyTable, lines: dict[str, Sequence[StudyRow]], column: str, axis: _Axis
) -> None:
    for number, rows in enumerate(lines.values()):
        points = sorted(
            (axis.places[show_setting(row.record.varied[axis.key])], row.values[column])
            for row in rows
            if _is_drawn(row, column)
        )
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(x, y, **LINE, **line_style(number, COLORS))
    for series in table.series:
        if series.column == column and series.extrapolation.limit is not None and len(lines) == 1:
            axes.axhline(series.extrapolation.limit, color=FAINT, linestyle="--", linewidth=1.0)
    calm_axes(axes, grid="both")
    axes.ticklabel_format(axis="y", useOffset=False)
    if axis.logarithmic:
        axes.set_xscale("log")
    _set_ticks(axes, axis)


def _is_drawn(row: StudyRow, column: str) -> bool:
    return is_number(row.values.get(column))


def _set_ticks(axes: Axes, axis: _Axis) -> None:
    """The values themselves; not all of them where they are many or would touch."""
    ordered = sorted(axis.marks.items())
    step = -(-len(ordered) // MOST_TICKS)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    shown = ordered[::step]
    longest = max(len(text) for _, text in shown)
    crowded = longest * len(shown) > MOST_LETTERS
    axes.set_xticks([place for place, _ in shown], [text for _, text in shown])
    if crowded:
        axes.tick_params(axis="x", rotation=30)
        for label in axes.get_xticklabels():
            label.set_horizontalalignment("right")


def _lines(table: StudyTable, key: str) -> dict[str, Sequence[StudyRow]]:
    labels = {family.name: family.label for family in table.study.families if family.name}
    lines: dict[str, list[StudyRow]] = {}
    for row in table.rows:
        varied = row.record.varied
        if key in varied:
            words = [
                f"{shorten_key(other)} = {show_setting(value)}"
                for other, value in varied.items()
                if other != key
            ]
            title = ", ".join(
                [labels[row.record.family], *words] if row.record.family in labels else words
            )
            lines.setdefault(title, []).append(row)
    return dict(lines)


def draw_costs(points: Sequence[CostPoint], labels: dict[str, str]) -> bytes | None:
    """Three panels side by side; None where nothing can be drawn.

    Args:
        labels: Family to how it is called.
    """
    shown = [point for point in points if math.isfinite(point.error)]
    if not shown:
        return None
    figure = new_figure(12.0, 5.0)
    panels = figure.subplots(1, len(TITLES), sharey=True)
    for axes, (cost, title) in zip(panels, TITLES.items(), strict=True):
        _draw_cost_panel(axes, shown, cost, labels)
        label_axes(axes, x=title)
    label_axes(panels[0], y="largest relative error")
    label_shares(panels[0])
    handles, names = figure.axes[0].get_legend_handles_labels()
    add_legend(figure, handles, names)
    return encode_figure(figure)


def _draw_cost_panel(
    axes: Axes, points: Sequence[CostPoint], cost: str, labels: dict[str, str]
) -> None:
    calm_axes(axes, grid="both")
    axes.set_xscale("log")
    axes.set_yscale("log")
    families = list(
        dict.fromkeys(point.row.record.family for point in points if not point.automatic)
    )
    points = [point for point in points if cost != "memory" or point.memory_known]
    front = pareto_front([point for point in points if point.competes], cost)
    axes.plot(
        *_places(front, cost),
        color=FAINT,
        linewidth=5.0,
        solid_capstyle="round",
        zorder=1.5,
        label="cheapest for its error",
    )
    for number, family in enumerate(families):
        # in the order of the scene: a line leads from coarse to fine even where the finer one was
        # cheaper
        own = [
            point for point in points if not point.automatic and point.row.record.family == family
        ]
        style: dict[str, Any] = (
            {"linestyle": ":", "markerfacecolor": "white"}
            if any(point.other_model for point in own)
            else {}
        )
        label = labels.get(family, family) + (": another model" if style else "")
        color, mark = COLORS[number % len(COLORS)], MARKS[number % len(MARKS)]
        axes.plot(
            *_places(own, cost),
            color=color,
            marker=mark,
            markersize=4.5,
            linewidth=0.9,
            label=label,
            **style,
        )
    _mark_automatic(axes, [point for point in points if point.automatic], cost)
    label_decades(axes)


def _mark_automatic(axes: Axes, points: Sequence[CostPoint], cost: str) -> None:
    """A star at each automatic choice, with the accuracy that was asked for."""
    if points:
        star: dict[str, Any] = {"marker": "*", "markersize": 13, "color": "#111111", "zorder": 5}
        axes.plot(
            *_places(points, cost),
            linestyle="",
            label="chosen automatically, with the accuracy asked for",
            **star,
        )
    for point in points:
        if point.accuracy is None:
            continue
        place = (read_cost(point, cost), max(point.error, SMALLEST))
        halo = [withStroke(linewidth=2.5, foreground="white")]
        below: dict[str, Any] = {"xytext": (-8, -9), "textcoords": "offset points", "ha": "right"}
        axes.annotate(
            f"{100.0 * point.accuracy['requested']:g} %",
            place,
            fontsize=8,
            color=INK,
            zorder=6,
            path_effects=halo,
            **below,
        )


def _places(points: Sequence[CostPoint], cost: str) -> tuple[list[float], list[float]]:
    return [read_cost(point, cost) for point in points], [
        max(point.error, SMALLEST) for point in points
    ]


STAR: dict[str, Any] = {"marker": "*", "markersize": 13, "color": "#111111", "linestyle": ""}


def draw_convergence(found: Convergence, need: MeshNeed) -> bytes | None:
    """Two panels side by side; None where no number has a limit.

    Args:
        found: What the meshes say.
    """
    lines = [
        (
            each.name,
            [None if error is None else abs(error) for error in list_deviations(each, limit)],
        )
        for each, limit in zip(found.watched, found.limits, strict=True)
        if limit.order is not None
    ]
    if not lines:
        return None
    figure = new_figure(10.0, 4.2)
    panels = figure.subplots(1, 2, sharey=True)
    costs = found.costs
    _draw_errors(panels[0], costs.dofs, lines, need.dofs, need)
    _draw_errors(panels[1], costs.seconds, lines, need.seconds, need)
    label_axes(panels[0], x="degrees of freedom")
    label_axes(panels[1], x="wall-clock time from scene to results [s]")
    label_axes(panels[0], y="distance from the limit")
    label_shares(panels[0])
    handles = [Line2D([], [], **LINE, **line_style(number, COLORS)) for number in range(len(lines))]
    labels = [name for name, _ in lines]
    star = f"needed for {100.0 * need.accuracy:g} %"
    add_legend(figure, [*handles, Line2D([], [], **STAR)], [*labels, star])
    return encode_figure(figure)


def _draw_errors(
    axes: Axes,
    costs: Sequence[float],
    lines: Sequence[tuple[str, Sequence[float | None]]],
    needed: float,
    need: MeshNeed,
) -> None:
    calm_axes(axes, grid="both")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.axhline(need.accuracy, color=FAINT, linewidth=1.2, linestyle="--", zorder=1.0)
    for number, (_, errors) in enumerate(lines):
        points = [
            (cost, max(error, SMALLEST))
            for cost, error in zip(costs, errors, strict=True)
            if error is not None
        ]
        x, y = zip(*points, strict=True)
        axes.plot(x, y, **LINE, **line_style(number, COLORS))
    axes.plot([needed], [need.accuracy], zorder=5.0, **STAR)
    low, high = min(*costs, needed), max(*costs, needed)
    axes.set_xlim(low / 1.3, high * 1.3)
    label_decades(axes)
