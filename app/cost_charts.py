"""Error against processor time, memory and degrees of freedom, with the front of what is worth its cost."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from headstock.app.charts import DPI, FAINT, INK, calm_axes, read_pixels
from headstock.app.study_charts import COLORS
from headstock.pipeline.cost_points import CostPoint, pareto_front, read_cost

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
    figure = Figure(figsize=(12.0, 4.6), dpi=DPI, layout="constrained")
    for number, (cost, title) in enumerate(TITLES.items()):
        axes = figure.add_subplot(1, 3, number + 1)
        _draw_panel(axes, shown, cost, labels)
        axes.set_xlabel(title, fontsize=9, color=INK)
        if number == 0:
            axes.set_ylabel("largest relative error", fontsize=9, color=INK)
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return read_pixels(figure)


def _draw_panel(axes: Axes, points: Sequence[CostPoint], cost: str, labels: dict[str, str]) -> None:
    calm_axes(axes)
    axes.set_xscale("log")
    axes.set_yscale("log")
    families = list(dict.fromkeys(point.row.record.family for point in points if not point.automatic))
    points = [point for point in points if cost != "memory" or point.memory_known]
    swept = [point for point in points if not point.automatic]
    front = pareto_front(swept, cost)
    axes.plot(*_places(front, cost), color=FAINT, linewidth=5.0, solid_capstyle="round", zorder=0, label="cheapest for its error")
    for number, family in enumerate(families):
        own = sorted((point for point in swept if point.row.record.family == family), key=lambda point: read_cost(point, cost))
        color, mark = COLORS[number % len(COLORS)], MARKS[number % len(MARKS)]
        axes.plot(*_places(own, cost), color=color, marker=mark, markersize=4.5, linewidth=0.9, label=labels.get(family, family))
    automatic = [point for point in points if point.automatic]
    if automatic:
        axes.plot(
            *_places(automatic, cost),
            linestyle="",
            marker="*",
            markersize=13,
            color="#111111",
            zorder=5,
            label="chosen automatically",
        )
    for level in (0.01, 0.001):
        axes.axhline(level, color=FAINT, linewidth=0.8, linestyle=":")


def _places(points: Sequence[CostPoint], cost: str) -> tuple[list[float], list[float]]:
    return [read_cost(point, cost) for point in points], [max(point.error, SMALLEST) for point in points]
