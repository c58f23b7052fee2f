"""Variants side by side as figures: frequencies as levels joined where modes are the same,
compliances as bars.
"""

import itertools
import textwrap
from collections.abc import Mapping, Sequence

import numpy as np

from headstock.app.charts.charts import (
    FAINT,
    INK,
    add_legend,
    add_scale,
    calm_axes,
    draw_matrix,
    encode_figure,
    label_axes,
    new_figure,
)
from headstock.app.charts.results import encode_drawings
from headstock.app.drawings.frf import draw_overlay
from headstock.app.pictures.libraries import Axes
from headstock.app.tables.comparison import alike_rigid_modes, list_points, row_frequencies
from headstock.app.texts.bounded_values import show_digits
from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.results.views import COLORS
from headstock.solvers.second_order import Channel
from headstock.studies.comparison_summary import ComparisonSummary

Entry = tuple[Channel, Channel]
LEVEL_HALF_WIDTH = 0.3
LABEL_INCHES = 0.17
NAME_LENGTH = 60
VARIANT_LENGTH = 14
MOST_UPRIGHT = 15  # bars whose numbers stand upright beside each other


def draw_comparison(
    summary: ComparisonSummary, lines: Mapping[str, ResponseCurves]
) -> dict[str, bytes]:
    """Figure name to a PNG file; no figure for what was not computed.

    Args:
        lines: Variant to its frequency response, all on the same lines; empty without one.
    """
    figures = {}
    if summary["modes"]:
        figures["frequencies"] = _draw_levels(summary)
    points = list_points(summary)
    if points:
        figures["compliances"] = _draw_compliances(summary, points)
    entries = _list_entries(summary, lines)
    if entries:
        drawn = draw_overlay(list(lines.values()), "models", list(lines), entries)
        figures["responses"] = encode_drawings([drawn])
    if any(variant["mac"] for variant in summary["variants"].values()):
        figures["mac"] = _draw_mac(summary)
    return figures


def _list_entries(summary: ComparisonSummary, lines: Mapping[str, ResponseCurves]) -> list[Entry]:
    """Output and input of every entry that is more than a trace of symmetry lost in a variant."""
    found = [
        ((entry["output"][0], entry["output"][1]), (entry["input"][0], entry["input"][1]))
        for name in lines
        for entry in summary["variants"][name]["frf"]
        if not entry["negligible"]
    ]
    return list(dict.fromkeys(found))


def _draw_mac(summary: ComparisonSummary) -> bytes:
    """MAC of the reference's modes with those of each other variant, the larger the darker."""
    shown = {
        name: np.array(each["mac"]) for name, each in summary["variants"].items() if each["mac"]
    }
    rows = max(len(table) for table in shown.values())
    widths = [max(table.shape[1], 6) for table in shown.values()]
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    cell = min(0.3, 11.0 / (across * max(widths)))
    figure = new_figure(
        max(5.0, cell * across * max(widths) + 1.2), down * (max(cell * rows, 1.2) + 0.9)
    )
    for number, (name, table) in enumerate(shown.items()):
        axes = figure.add_subplot(down, across, number + 1)
        draw_matrix(axes, table, cell)
        label_axes(axes, x=f"mode of {name}", y=f"mode of {summary['reference']}")
    add_scale(figure, "MAC")
    return encode_figure(figure)


def _draw_levels(summary: ComparisonSummary) -> bytes:
    names = list(summary["variants"])
    alike = alike_rigid_modes(summary)
    rows = [row for row in summary["modes"] if row not in alike]
    height = max(6.0, LABEL_INCHES * (len(rows) + 4) + 1.0)
    figure = new_figure(4.4 + 1.25 * len(names), height)
    axes = figure.add_subplot()
    for row in alike:
        for x, name in enumerate(names):
            hz = row_frequencies(row)[name]
            axes.plot(
                [x - LEVEL_HALF_WIDTH, x + LEVEL_HALF_WIDTH], [hz, hz], color=FAINT, linewidth=1.0
            )
    ends = (
        [
            (
                (len(names) - 1, row_frequencies(alike[-1])[names[-1]]),
                f"{len(alike)} rigid-body modes",
                INK,
            )
        ]
        if alike
        else []
    )
    for number, row in enumerate(rows):
        color = COLORS[number % len(COLORS)]
        known = row_frequencies(row)
        places = [(x, known[name]) for x, name in enumerate(names) if name in known]
        _draw_mode(axes, places, color)
        ends.append((places[-1], row["name"], color))
    axes.set_xticks(
        range(len(names)), ["\n".join(textwrap.wrap(name, VARIANT_LENGTH)) for name in names]
    )
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(0.0, (1.0 + 1.5 * LABEL_INCHES / height) * axes.get_ylim()[1])
    label_axes(axes, y="natural frequency [Hz]")
    calm_axes(axes, grid="y")
    gap = LABEL_INCHES / (height - 1.0) * axes.get_ylim()[1]
    for x, name in enumerate(names):
        cells = [
            (row_frequencies(row).get(name), COLORS[number % len(COLORS)])
            for number, row in enumerate(rows)
        ]
        _write_levels(axes, x, [(hz, color) for hz, color in cells if hz is not None], gap)
    _name_levels(axes, ends, len(names) - 0.6, gap)
    return encode_figure(figure)


def _spread_labels(levels: Sequence[float], gap: float) -> list[float]:
    """Heights of labels at levels in rising order, moved up where one would touch the one below."""
    heights: list[float] = []
    for level in levels:
        heights.append(max(level, heights[-1] + gap) if heights else level)
    return heights


def _write_levels(axes: Axes, x: int, levels: list[tuple[float, str]], gap: float) -> None:
    """The frequency above each level of a variant, in its colour; on white, since lines may pass
    behind it.
    """
    ordered = sorted(levels)
    white = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
    for (hz, color), height in zip(
        ordered, _spread_labels([hz for hz, _ in ordered], gap), strict=True
    ):
        axes.annotate(
            show_digits(hz, 4),
            (x, height),
            (0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=7,
            color=color,
            bbox=white,
        )


def _draw_mode(axes: Axes, places: list[tuple[int, float]], color: str) -> None:
    """A level per variant that has the mode, joined by lines; dotted where variants between lack
    it.
    """
    for x, hz in places:
        axes.plot(
            [x - LEVEL_HALF_WIDTH, x + LEVEL_HALF_WIDTH],
            [hz, hz],
            color=color,
            linewidth=2.6,
            solid_capstyle="butt",
        )
    for (x, hz), (next_x, next_hz) in itertools.pairwise(places):
        style = "-" if next_x == x + 1 else ":"
        axes.plot(
            [x + LEVEL_HALF_WIDTH, next_x - LEVEL_HALF_WIDTH],
            [hz, next_hz],
            style,
            color=color,
            linewidth=1.0,
        )


def _name_levels(
    axes: Axes, ends: list[tuple[tuple[int, float], str, str]], right: float, gap: float
) -> None:
    """Names beside the last level of each mode, moved apart where they would touch."""
    ordered = sorted(ends, key=lambda end: end[0][1])
    heights = _spread_labels([hz for (_, hz), _, _ in ordered], gap)
    for ((x, hz), name, color), height in zip(ordered, heights, strict=True):
        text = "\n".join(textwrap.wrap(name, NAME_LENGTH)[:2])
        axes.annotate(
            text,
            (x + LEVEL_HALF_WIDTH, hz),
            (right + 0.35, height),
            va="center",
            fontsize=7.5,
            color=color,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.5, "alpha": 0.5},
        )


def _draw_compliances(summary: ComparisonSummary, points: list[str]) -> bytes:
    variants = summary["variants"]
    width = max(6.0, 1.6 + 0.34 * 3 * len(variants))
    figure = new_figure(width, 2.9 * len(points) + 0.4)
    for number, point in enumerate(points):
        axes = figure.add_subplot(len(points), 1, number + 1)
        known = [name for name in variants if point in variants[name]["static"]]
        bar = 0.8 / max(1, len(known))
        for place, name in enumerate(known):
            matrix = variants[name]["static"][point]["compliance_um_per_kN"]
            # a free direction has no bar
            values = [np.nan if size is None else size for size in (matrix[i][i] for i in range(3))]
            at = [i - 0.4 + bar * (place + 0.5) for i in range(3)]
            bars = axes.bar(at, values, 0.92 * bar, label=name, color=COLORS[place % len(COLORS)])
            crowded = 3 * len(known) > MOST_UPRIGHT
            words = ["" if np.isnan(value) else show_digits(value, 3) for value in values]
            axes.bar_label(
                bars, words, fontsize=6.5, color=INK, padding=2, rotation=90 if crowded else 0
            )
        axes.set_xticks(range(3), [f"d{d}/F{d}" for d in DIRECTIONS])
        label_axes(axes, title=f"compliance at {point} [µm/kN]")
        calm_axes(axes, grid="y")
        axes.margins(y=0.15)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    add_legend(figure, handles, labels)
    return encode_figure(figure)
