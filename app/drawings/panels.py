"""Fields with axes and curves, as plots over time and position of the report have them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.texts.curves import even_ticks, thin_curve
from headstock.geometry.frames import FloatArray


@dataclass(frozen=True)
class Panel:
    """A field with axes: its left upper corner, its size, and what it shows from where to where."""

    x: float
    y: float
    width: float
    height: float
    across: tuple[float, float]
    up: tuple[float, float]

    def place(self, values: FloatArray) -> FloatArray:
        """Where values stand from left to right."""
        low, high = self.across
        return np.asarray(self.x + self.width * (np.asarray(values) - low) / (high - low))

    def level(self, values: FloatArray) -> FloatArray:
        """Where values stand from top to bottom."""
        low, high = self.up
        return np.asarray(self.y + self.height * (high - np.asarray(values)) / (high - low))


def show_range(values: Sequence[FloatArray]) -> tuple[float, float]:
    """From the lowest to the highest value and zero, with some room."""
    low, high = (
        min(0.0, *(float(part.min()) for part in values)),
        max(0.0, *(float(part.max()) for part in values)),
    )
    room = 0.06 * ((high - low) or 1.0)
    return low - room, high + room


def draw_curve(panel: Panel, x: FloatArray, y: FloatArray, color: str, width: float) -> Markup:
    """A line through the points that lie within a field."""
    inside = (x >= panel.across[0]) & (x <= panel.across[1])
    thin = thin_curve(np.asarray(x[inside]), np.asarray(y[inside]), int(panel.width))
    points = " ".join(
        f"{a:.1f},{b:.1f}" for a, b in zip(panel.place(thin[0]), panel.level(thin[1]), strict=True)
    )
    return Markup(
        '<polyline points="{}" fill="none" stroke="{}" stroke-width="{}" stroke-linejoin="round"/>'
    ).format(points, color, width)


def draw_shade(panel: Panel, begin: float, end: float) -> Markup:
    """A shade over a part of a field."""
    low, high = panel.place(np.clip([begin, end], *panel.across))
    return Markup(
        '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{}" fill="currentColor" opacity="0.09"/>'
    ).format(low, panel.y, max(high - low, 1.0), panel.height)


def draw_axes(panel: Panel, unit: str, side: str) -> Markup:
    """Grid lines with numbers; units behind the last one and above the first."""
    parts = []
    levels = even_ticks(panel.up[0], panel.up[1], 4)
    if len(levels) < 2:  # one number is no scale
        levels = even_ticks(panel.up[0], panel.up[1], 8)
    for value in levels:
        y = float(panel.level(np.array(value)))
        parts.append(
            svg.line(
                float(panel.x),
                y,
                float(panel.x + panel.width),
                y,
                opacity=0.45 if value == 0.0 else 0.13,
            )
        )
        parts.append(svg.text(panel.x - 5, y + 3.5, round_label(value), anchor="end", size=10.5))
    ticks = even_ticks(panel.across[0], panel.across[1], 6)
    for value in ticks:
        x = float(panel.place(np.array(value)))
        words = round_label(value) + (f" {unit}" if value == ticks[-1] else "")
        parts.append(svg.text(x, panel.y + panel.height + 14, words, anchor="middle", size=10.5))
    if side:
        parts.append(svg.text(panel.x - 5, panel.y - 4, side, anchor="end", size=10.5))
    return Markup("").join(parts)


def round_label(value: float) -> str:
    """A number of an axis."""
    text = (
        f"{value:.3g}"
        if abs(value) < 1000.0
        else f"{float(f'{value:.2g}'):,.0f}".replace(",", "\u202f")
    )
    return text.replace("-", "−") if text.startswith("-") else text
