"""The figures of Kono et al. of the beams: deviations over degrees of freedom and over time."""

import math
from collections.abc import Sequence
from typing import Literal

from headstock.app.charts.charts import (
    INK,
    calm_axes,
    encode_figure,
    label_axes,
    label_decades,
    new_figure,
)
from headstock.app.pictures.libraries import (
    Axes,
    FixedLocator,
    FuncFormatter,
    Line2D,
    NullFormatter,
)
from headstock.validation.refinement.points import (
    KINDS,
    ModelKind,
    RefinementPoint,
    RefinementSeries,
    deviations,
    pick_series,
    worst_by_ndof,
)
from headstock.validation.refinement.references import Group, ReferenceBeam

Over = Literal["ndof", "time"]
NDOF: Over = "ndof"
TIME: Over = "time"
# the paper's own first, then by pairs of the same order
PANELS: tuple[ModelKind, ...] = ("wilson8", "tet4", "hex8", "tet10", "hex27")
KIND_COLORS = ("#1f5fa8", "#d9660a", "#2f855a", "#b83280", "#6b46c1", "#64748b")
MARKERS = ("o", "s", "^", "D", "v", "P")
KIND_LABELS: dict[ModelKind, str] = {
    "segmented": "segmented bodies",
    "tet4": "linear tets (4 nodes)",
    "hex8": "linear hexes (8 nodes)",
    "tet10": "second-order tets (10 nodes)",
    "hex27": "second-order hexes (27 nodes)",
    "wilson8": "linear hexes with bending shapes, as the paper's",
}
X_LABELS: dict[Over, str] = {
    "ndof": "nDOF (6 per segment, 3 per node)",
    "time": "processor time from the scene to the result, empty store [s]",
}
LINEAR_RANGE = 10.0  # percent; logarithmic beyond, where a figure reaches far
FAR = 40.0
TICKS = (-100, -50, -20, -10, -5, 0, 5, 10, 20, 50, 100, 200, 500)
LEAST_SHOWN = 1e-3  # percent, in the overview


def draw_refinement(beam: ReferenceBeam, points: Sequence[RefinementPoint]) -> dict[str, bytes]:
    """Every figure of a refinement study by file name: those of the paper over nDOF and over time, and all
    models together.
    """
    found: dict[str, bytes] = {}
    cases: tuple[tuple[Group, tuple[ModelKind, ...]], ...] = (
        ("static", KINDS[:1]),
        ("static", PANELS),
        ("modal", KINDS[:1]),
        ("modal", PANELS),
    )
    for number, (group, kinds) in zip(beam.figures, cases, strict=True):
        for over, own in ((NDOF, points), (TIME, _timed(points))):
            panels = [
                series for kind in kinds if (series := pick_series(beam, own, group, kind)).points
            ]
            if panels:
                found[f"figure_{number:02d}_{over}"] = _draw_figure(panels, number, over)
    if _timed(points):
        found["overview"] = _draw_overview(beam, _timed(points))
    return found


def _timed(points: Sequence[RefinementPoint]) -> list[RefinementPoint]:
    return [point for point in points if math.isfinite(point.cpu_seconds)]


def _draw_figure(panels: Sequence[RefinementSeries], number: int, over: Over) -> bytes:
    """One panel per kind of model, on the same axes; the legend in the first row where that has one
    panel of several.
    """
    beam, group = panels[0].beam, panels[0].group
    names = [
        name
        for name, reference in beam.references.items()
        if reference.group == group and "back face" not in name
    ]
    width = min(2, len(panels))
    height = -(-len(panels) // width)
    figure = new_figure(5.4 * width + 1.0, 3.1 * height + 1.2)
    what = "static displacements" if group == "static" else "natural frequencies"
    figure.suptitle(
        f"Figure {number} of Kono et al.: {what} of the {beam.title}",
        fontsize=11,
        color=INK,
        x=0.01,
        ha="left",
    )
    largest = max(abs(d.value) for series in panels for d in deviations(series, names)) * 100.0
    grid = figure.subplots(height, width, sharex=True, sharey=True, squeeze=False)
    odd = len(panels) % width > 0
    handles = _handles(names, segmented=panels[0].kinds == ("segmented",))
    if odd:
        grid[0, 1].set_axis_off()
        grid[0, 1].legend(handles=handles, loc="center", fontsize=9, frameon=False)
    else:
        figure.legend(
            handles=handles, loc="outside lower center", ncols=2 * width, fontsize=8, frameon=False
        )
    cells = [axes for place, axes in enumerate(grid.flat) if not (odd and place == 1)]
    for axes, series in zip(cells, panels, strict=True):
        _draw_panel(axes, series, names, over)
        label_axes(axes, title=KIND_LABELS[series.kinds[0]])
    for axes in cells:
        _shape_axes(axes, largest)
    for axes in grid[:, 0]:
        label_axes(axes, y="deviation from analytic [%]")
    for axes in grid[-1]:
        label_axes(axes, x=X_LABELS[over])
    return encode_figure(figure)


def _draw_panel(axes: Axes, series: RefinementSeries, names: Sequence[str], over: Over) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for name, color, marker in zip(names, KIND_COLORS, MARKERS, strict=False):
        found = deviations(series, [name])
        x = [
            deviation.point.ndof if over == "ndof" else deviation.point.cpu_seconds
            for deviation in found
        ]
        axes.plot(
            x,
            [100.0 * d.value for d in found],
            color=color,
            marker=marker,
            markersize=4.5,
            linewidth=1.3,
        )
        reference = series.beam.references[name]
        methods = [(reference.solid, "none")] + (
            [(reference.beam, color)] if series.kinds == ("segmented",) else []
        )
        for value, filled in methods:
            level = 100.0 * (value / reference.analytic - 1.0)
            axes.plot(
                1.015,
                level,
                marker="<",
                markersize=6,
                color=color,
                markerfacecolor=filled,
                clip_on=False,
                transform=axes.get_yaxis_transform(),
            )


def _shape_axes(axes: Axes, largest: float) -> None:
    axes.set_xscale("log")
    calm_axes(axes, grid="both")
    label_decades(axes)
    if largest > FAR:
        axes.set_yscale("symlog", linthresh=LINEAR_RANGE, linscale=1.0)
        axes.yaxis.set_major_locator(FixedLocator([tick for tick in TICKS if tick <= largest]))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:+g}" if value else "0"))


def _handles(names: Sequence[str], *, segmented: bool) -> list[Line2D]:
    lines = [
        Line2D([], [], color=color, marker=marker, markersize=4.5, linewidth=1.3, label=name)
        for name, color, marker in zip(names, KIND_COLORS, MARKERS, strict=False)
    ]
    lines.append(
        Line2D(
            [],
            [],
            color=INK,
            marker="<",
            linestyle="none",
            markerfacecolor="none",
            label="converged 3D elasticity",
        )
    )
    if segmented:
        lines.append(
            Line2D([], [], color=INK, marker="<", linestyle="none", label="beam theory with shear")
        )
    return lines


def _draw_overview(beam: ReferenceBeam, points: Sequence[RefinementPoint]) -> bytes:
    """Largest deviation from converged 3D elasticity over time, all models together."""
    both: tuple[Group, ...] = ("static", "modal")
    groups = [group for group in both if any(point.group == group for point in points)]
    figure = new_figure(5.2 * len(groups) + 0.8, 4.4)
    figure.suptitle(
        f"Accuracy against effort: {beam.title}", fontsize=11, color=INK, x=0.01, ha="left"
    )
    for number, group in enumerate(groups):
        axes = figure.add_subplot(1, len(groups), number + 1)
        names = [name for name, reference in beam.references.items() if reference.group == group]
        for kind, color, marker in zip(KINDS, KIND_COLORS, MARKERS, strict=False):
            worst = worst_by_ndof(pick_series(beam, points, group, kind), names, against="solid")
            if not worst:
                continue
            x, y = (
                [d.point.cpu_seconds for d in worst.values()],
                [max(LEAST_SHOWN, 100.0 * abs(d.value)) for d in worst.values()],
            )
            axes.plot(
                x,
                y,
                color=color,
                marker=marker,
                markersize=4.5,
                linewidth=1.3,
                label=KIND_LABELS[kind],
            )
        label_axes(
            axes, title="static displacements" if group == "static" else "natural frequencies"
        )
        axes.set_yscale("log")
        axes.set_xscale("log")
        calm_axes(axes, grid="both")
        label_decades(axes)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        label_axes(
            axes, x="processor time, empty store [s]", y="largest deviation from converged 3D [%]"
        )
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return encode_figure(figure)
