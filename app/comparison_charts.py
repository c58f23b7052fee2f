"""Variants side by side as figures: frequencies as levels joined where modes are the same, compliances as bars."""

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from headstock.app.charts import DPI, FAINT, INK, calm_axes, read_pixels
from headstock.app.comparison_listing import alike_rigid_modes
from headstock.pipeline.json_texts import Json
from headstock.pipeline.machine_views import COLORS

DIRECTIONS = ("x", "y", "z")
LEVEL_HALF_WIDTH = 0.3
LABEL_SPACE = 0.03
NAME_LENGTH = 44


def draw_comparison(summary: Json) -> dict[str, NDArray[np.uint8]]:
    """Figure name to ``(height, width, 4)`` pixels; no figure for what was not computed."""
    figures = {}
    if summary["modes"]:
        figures["frequencies"] = _draw_levels(summary)
    points = list(dict.fromkeys(point for variant in summary["variants"].values() for point in variant["static"]))
    if points:
        figures["compliances"] = _draw_compliances(summary, points)
    return figures


def _draw_levels(summary: Json) -> NDArray[np.uint8]:
    names = list(summary["variants"])
    figure = Figure(figsize=(4.4 + 1.15 * len(names), 6.0), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    alike = alike_rigid_modes(summary)
    for row in alike:
        for x, name in enumerate(names):
            hz = row["variants"][name]["frequency_hz"]
            axes.plot([x - LEVEL_HALF_WIDTH, x + LEVEL_HALF_WIDTH], [hz, hz], color=FAINT, linewidth=1.0)
    ends = [((len(names) - 1, _last_hz(alike[-1])), f"{len(alike)} rigid-body modes", INK)] if alike else []
    for number, row in enumerate(row for row in summary["modes"] if row not in alike):
        color = COLORS[number % len(COLORS)]
        places = [(x, row["variants"][name]["frequency_hz"]) for x, name in enumerate(names) if row["variants"][name] is not None]
        _draw_mode(axes, places, color)
        ends.append((places[-1], row["name"], color))
    axes.set_xticks(range(len(names)), names)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("natural frequency [Hz]", fontsize=9, color=INK)
    calm_axes(axes)
    axes.grid(axis="y", color=FAINT, linewidth=0.5)
    axes.grid(visible=False, axis="x")
    _name_levels(axes, ends, len(names) - 0.6)
    return read_pixels(figure)


def _draw_mode(axes: Axes, places: list[tuple[int, float]], color: str) -> None:
    """A level per variant that has the mode, joined by lines; dotted where variants between lack it."""
    for x, hz in places:
        axes.plot([x - LEVEL_HALF_WIDTH, x + LEVEL_HALF_WIDTH], [hz, hz], color=color, linewidth=2.6, solid_capstyle="butt")
        axes.annotate(f"{hz:#.4g}", (x, hz), (0, 3), textcoords="offset points", ha="center", fontsize=7, color=INK)
    for (x, hz), (next_x, next_hz) in itertools.pairwise(places):
        style = "-" if next_x == x + 1 else ":"
        axes.plot([x + LEVEL_HALF_WIDTH, next_x - LEVEL_HALF_WIDTH], [hz, next_hz], style, color=color, linewidth=1.0)


def _last_hz(row: Json) -> float:
    return float(list(row["variants"].values())[-1]["frequency_hz"])


def _name_levels(axes: Axes, ends: list[tuple[tuple[int, float], str, str]], right: float) -> None:
    """Names beside the last level of each mode, moved apart where they would touch."""
    span = axes.get_ylim()[1]
    below = -np.inf
    for (x, hz), name, color in sorted(ends, key=lambda end: end[0][1]):
        height = max(hz, below + LABEL_SPACE * span)
        below = height
        text = name if len(name) <= NAME_LENGTH else f"{name[: NAME_LENGTH - 1]}…"
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


def _draw_compliances(summary: Json, points: list[str]) -> NDArray[np.uint8]:
    variants = summary["variants"]
    width = max(6.0, 1.6 + 0.34 * 3 * len(variants))
    figure = Figure(figsize=(width, 2.9 * len(points) + 0.4), dpi=DPI, layout="constrained")
    for number, point in enumerate(points):
        axes = figure.add_subplot(len(points), 1, number + 1)
        known = [name for name in variants if point in variants[name]["static"]]
        bar = 0.8 / max(1, len(known))
        for place, name in enumerate(known):
            matrix = variants[name]["static"][point]["compliance_um_per_kN"]
            values = [matrix[i][i] for i in range(3)]
            at = [i - 0.4 + bar * (place + 0.5) for i in range(3)]
            bars = axes.bar(at, values, 0.92 * bar, label=name, color=COLORS[place % len(COLORS)])
            axes.bar_label(bars, [f"{value:.3g}" for value in values], fontsize=6.5, color=INK, padding=2)
        axes.set_xticks(range(3), [f"d{d}/F{d}" for d in DIRECTIONS])
        axes.set_title(f"compliance at {point} [µm/kN]", fontsize=9, color=INK, loc="left")
        calm_axes(axes)
        axes.grid(axis="y", color=FAINT, linewidth=0.5)
        axes.grid(visible=False, axis="x")
        if number == 0:
            figure.legend(loc="outside lower center", ncols=min(6, len(known)), fontsize=8, frameon=False)
    return read_pixels(figure)
