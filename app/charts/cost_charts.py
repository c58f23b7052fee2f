"""Error against processor time, memory and degrees of freedom, with the front of what is worth its cost."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import NDArray

from headstock.app.charts.charts import DPI, FAINT, INK, calm_axes, read_pixels
from headstock.app.charts.study import COLORS
from headstock.studies.parameters.costs import CostPoint, pareto_front, read_cost

TITLES = {"cpu": "processor time [s]", "memory": "peak memory [MB]", "dofs": "degrees of freedom"}
MARKS = "osD^vP<>hX"
SMALLEST = 1e-6


def draw_costs(points: Sequence[CostPoint], labels: dict[str, str]) -> NDArray[np.uint8] | None:
    """Three panels side by side; None where nothing can be drawn.

    Args:
        points: Of one study.
        labels: Family to how it is called.
    """
    shown = [point for point in points if math.isfinite(point.error)]
    if not shown:
        return None
    figure = Figure(figsize=(12.0, 5.0), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, len(TITLES), sharey=True)
    for axes, (cost, title) in zip(panels, TITLES.items(), strict=True):
        _draw_panel(axes, shown, cost, labels)
        axes.set_xlabel(title, fontsize=9, color=INK)
    panels[0].set_ylabel("largest relative error", fontsize=9, color=INK)
    panels[0].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100.0 * value:g} %"))
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return read_pixels(figure)


def _draw_panel(axes: Axes, points: Sequence[CostPoint], cost: str, labels: dict[str, str]) -> None:
    calm_axes(axes)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(axis="y", color=FAINT, linewidth=0.5)
    families = list(dict.fromkeys(point.row.record.family for point in points if not point.automatic))
    points = [point for point in points if cost != "memory" or point.memory_known]
    front = pareto_front([point for point in points if point.competes], cost)
    axes.plot(*_places(front, cost), color=FAINT, linewidth=5.0, solid_capstyle="round", zorder=1.5, label="cheapest for its error")
    for number, family in enumerate(families):
        # in the order of the scene: a line leads from coarse to fine even where the finer one was cheaper
        own = [point for point in points if not point.automatic and point.row.record.family == family]
        style: dict[str, Any] = {"linestyle": ":", "markerfacecolor": "white"} if any(point.other_model for point in own) else {}
        label = labels.get(family, family) + (": another model" if style else "")
        color, mark = COLORS[number % len(COLORS)], MARKS[number % len(MARKS)]
        axes.plot(*_places(own, cost), color=color, marker=mark, markersize=4.5, linewidth=0.9, label=label, **style)
    _mark_automatic(axes, [point for point in points if point.automatic], cost)
    low, high = axes.get_xlim()
    if high < 30.0 * low:
        _label_between(axes)


def _label_between(axes: Axes) -> None:
    """Ticks between decades, where there would be one or two at most."""
    axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 3.0, 5.0)))
    axes.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.tick_params(axis="x", which="minor", labelsize=8, colors=INK, length=0)


def _mark_automatic(axes: Axes, points: Sequence[CostPoint], cost: str) -> None:
    """A star at each automatic choice, with the accuracy that was asked for."""
    if points:
        star: dict[str, Any] = {"marker": "*", "markersize": 13, "color": "#111111", "zorder": 5}
        axes.plot(*_places(points, cost), linestyle="", label="chosen automatically, with the accuracy asked for", **star)
    for point in points:
        asked = point.row.record.summary["accuracy"]["asked"]
        place = (read_cost(point, cost), max(point.error, SMALLEST))
        halo = [withStroke(linewidth=2.5, foreground="white")]
        below: dict[str, Any] = {"xytext": (-8, -9), "textcoords": "offset points", "ha": "right"}
        axes.annotate(f"{100.0 * asked:g} %", place, fontsize=8, color=INK, zorder=6, path_effects=halo, **below)


def _places(points: Sequence[CostPoint], cost: str) -> tuple[list[float], list[float]]:
    return [read_cost(point, cost) for point in points], [max(point.error, SMALLEST) for point in points]
