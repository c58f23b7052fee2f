"""A study as small charts: one per watched number, a line per family and per value of the other varied keys."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, NullLocator
from numpy.typing import NDArray

from headstock.app.charts import DPI, FAINT, INK, calm_axes, read_pixels
from headstock.pipeline.study_points import shorten_key, show_value
from headstock.pipeline.study_tables import MESH_SIZE, StudyRow, StudyTable, is_number, shorten_columns
from headstock.pipeline.units import DIMENSIONS, UnitError, parse_quantity

MOST_PANELS = 12
MOST_LINES = 12
MOST_TICKS = 7
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


@dataclass(frozen=True, eq=False)
class _Axis:
    """What is drawn along x: a varied key, the place of each of its values, and how they are written."""

    key: str
    places: dict[str, float]
    logarithmic: bool


def draw_study(table: StudyTable) -> NDArray[np.uint8] | None:
    """The first twelve watched numbers over the first varied key (a mesh size before others); None where no number is watched."""
    columns = [column for column in table.columns if any(is_number(row.values.get(column)) for row in table.rows)][:MOST_PANELS]
    axis = _choose_axis(table)
    if not columns or axis is None:
        return None
    width = min(PANEL_COLUMNS, len(columns))
    height = -(-len(columns) // width)
    figure = Figure(figsize=(3.6 * width + 0.6, 2.5 * height + 0.7), dpi=DPI, layout="constrained")
    short = shorten_columns(columns)
    for number, column in enumerate(columns):
        axes = figure.add_subplot(height, width, number + 1)
        _draw_panel(axes, table, column, axis)
        axes.set_title(short[column], fontsize=9, color=INK, loc="left")
        if number >= len(columns) - width:
            axes.set_xlabel(shorten_key(axis.key), fontsize=8, color=INK)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return read_pixels(figure)


def _choose_axis(table: StudyTable) -> _Axis | None:
    values = {
        key: list(dict.fromkeys(show_value(row.record.varied[key]) for row in table.rows if key in row.record.varied))
        for key in table.varied
    }
    many = [key for key in table.varied if len(values[key]) > 1] or list(table.varied)
    sizes = [key for key in many if MESH_SIZE.fullmatch(key)]
    if not many:
        return None
    key = (sizes or many)[0]
    numbers = [_read_number(value) for value in values[key]]
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return _Axis(key, {value: float(place) for place, value in enumerate(values[key])}, logarithmic=False)
    wide = min(known) > 0.0 and max(known) >= 4.0 * min(known)
    return _Axis(key, dict(zip(values[key], known, strict=True)), logarithmic=wide)


def _read_number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse_quantity(text, *DIMENSIONS).value
    except UnitError:
        return None


def _draw_panel(axes: Axes, table: StudyTable, column: str, axis: _Axis) -> None:
    lines = _lines(table, axis.key)
    for (title, rows), color in zip(list(lines.items())[:MOST_LINES], COLORS, strict=False):
        points = sorted(
            (axis.places[show_value(row.record.varied[axis.key])], row.values[column]) for row in rows if _is_drawn(row, column)
        )
        if points:
            x, y = zip(*points, strict=True)
            axes.plot(x, y, marker="o", markersize=3.5, linewidth=1.3, color=color, label=title or None)
    for series in table.series:
        if series.column == column and series.extrapolation.limit is not None and len(lines) == 1:
            axes.axhline(series.extrapolation.limit, color=FAINT, linestyle="--", linewidth=1.0)
    calm_axes(axes)
    axes.grid(axis="y", color=FAINT, linewidth=0.5)
    axes.ticklabel_format(axis="y", useOffset=False)
    if axis.logarithmic:
        axes.set_xscale("log")
    _set_ticks(axes, axis)


def _is_drawn(row: StudyRow, column: str) -> bool:
    return is_number(row.values.get(column))


def _set_ticks(axes: Axes, axis: _Axis) -> None:
    """The values themselves, as they are written in the scene; not all of them where they are many."""
    ordered = sorted(axis.places.items(), key=lambda item: item[1])
    step = -(-len(ordered) // MOST_TICKS)
    shown = ordered[::step]
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks([place for _, place in shown], [text for text, _ in shown])


def _lines(table: StudyTable, key: str) -> dict[str, Sequence[StudyRow]]:
    labels = {family.name: family.label for family in table.study.families if family.name}
    lines: dict[str, list[StudyRow]] = {}
    for row in table.rows:
        varied: dict[str, Any] = row.record.varied
        if key in varied:
            words = [f"{shorten_key(other)} = {show_value(value)}" for other, value in varied.items() if other != key]
            title = ", ".join([labels[row.record.family], *words] if row.record.family in labels else words)
            lines.setdefault(title, []).append(row)
    return dict(lines)
