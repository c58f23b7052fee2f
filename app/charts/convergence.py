"""Mesh convergence as a figure: how far numbers are from their limits, over degrees of freedom and
over seconds.
"""

from collections.abc import Sequence
from typing import Any

from headstock.app.charts.charts import (
    FAINT,
    INK,
    add_legend,
    calm_axes,
    encode_figure,
    label_decades,
    label_shares,
    line_style,
    new_figure,
)
from headstock.app.charts.study import COLORS, LINE
from headstock.app.pictures.libraries import Axes, Line2D
from headstock.studies.parameters.convergence import Convergence
from headstock.studies.parameters.limits import MeshNeed, list_deviations

SMALLEST = 1e-6  # a smaller error is drawn as that
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
    _draw_panel(panels[0], costs.dofs, lines, need.dofs, need)
    _draw_panel(panels[1], costs.seconds, lines, need.seconds, need)
    panels[0].set_xlabel("degrees of freedom", fontsize=9, color=INK)
    panels[1].set_xlabel("wall-clock time from scene to results [s]", fontsize=9, color=INK)
    panels[0].set_ylabel("distance from the limit", fontsize=9, color=INK)
    label_shares(panels[0])
    handles = [Line2D([], [], **LINE, **line_style(number, COLORS)) for number in range(len(lines))]
    labels = [name for name, _ in lines]
    star = f"needed for {100.0 * need.accuracy:g} %"
    add_legend(figure, [*handles, Line2D([], [], **STAR)], [*labels, star])
    return encode_figure(figure)


def _draw_panel(
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
