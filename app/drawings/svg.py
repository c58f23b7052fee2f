"""Lines, texts, frames and fields with axes of SVG pictures, as every plot of the report draws them; places
in user units, ``y`` downwards.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from headstock.app.texts.curves import even_ticks, thin_curve
from headstock.geometry.frames import FloatArray


def line(x1: float, y1: float, x2: float, y2: float, *, opacity: float) -> Markup:
    """A line in the colour of the text. Places to a tenth; whole numbers (``int``) are written as
    such.

    Args:
        x2: Where it ends, to the right.
        y2: Where it ends, downwards.
        opacity: From 0 to 1.
    """
    ends = (_place(end) for end in (x1, y1, x2, y2))
    return Markup(
        '<line x1="{}" y1="{}" x2="{}" y2="{}" stroke="currentColor" opacity="{}"/>'
    ).format(*ends, opacity)


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    size: float = 11,
    color: str = "currentColor",
    opacity: float | None = None,
) -> Markup:
    """A line of text.

    Args:
        x: Of its start, middle or end.
        anchor: ``start``, ``middle`` or ``end``: which part of it is at ``x``.
        opacity: From 0 to 1; opaque without it.
    """
    faint = Markup("") if opacity is None else Markup(' opacity="{}"').format(opacity)
    return Markup(
        '<text x="{:.1f}" y="{:.1f}" font-size="{}" text-anchor="{}" fill="{}"{}>{}</text>'
    ).format(x, y, size, anchor, color, faint, words)


def hatching(identity: str, color: str) -> Markup:
    """Slanted lines to fill areas with: ``url(#identity)``."""
    return Markup(
        '<defs><pattern id="{}" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
        '<rect width="2" height="7" fill="{}" opacity="0.45"/></pattern></defs>'
    ).format(identity, color)


def area(places: Iterable[tuple[float, float]], fill: str, *, opacity: float = 1.0) -> Markup:
    """A filled area.

    Args:
        opacity: From 0 to 1.
    """
    return Markup('<polygon points="{}" fill="{}" opacity="{:g}"/>').format(
        points(places), fill, opacity
    )


def polyline(
    places: Iterable[tuple[float, float]],
    color: str,
    width: float,
    *,
    joined: bool = False,
    opacity: float | None = None,
) -> Markup:
    """Draw a line through places.

    Args:
        joined: Corners are round.
        opacity: From 0 to 1; opaque without it.
    """
    more = Markup(' stroke-linejoin="round"') if joined else Markup("")
    if opacity is not None:
        more += Markup(' opacity="{}"').format(opacity)
    return Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="{}"{}/>').format(
        points(places), color, width, more
    )


def shade(x: float, y: str, width: float, height: float, opacity: float) -> Markup:
    """Draw a faint rectangle in the colour of the text.

    Args:
        opacity: From 0 to 1.
    """
    return Markup(
        '<rect x="{:.1f}" y="{}" width="{:.1f}" height="{}" fill="currentColor" opacity="{}"/>'
    ).format(x, y, width, height, opacity)


def points(places: Iterable[tuple[float, float]]) -> str:
    """Places as lines and areas take them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def heading(x: float, y: float, words: str, *, size: float = 11.5) -> Markup:
    """Write what a plot shows, above its left end."""
    return Markup(
        '<text x="{:.1f}" y="{:.1f}" font-size="{}" font-weight="600" fill="currentColor">{}</text>'
    ).format(x, y, size, words)


def picture(
    parts: Iterable[Markup],
    *,
    identity: str,
    kind: str,
    width: float,
    height: float,
    label: str = "",
    widest: float | None = None,
) -> Markup:
    """A whole picture.

    Args:
        parts: What is in it, the lowest first.
        identity: Its ``id`` in the page.
        label: Said where it cannot be seen.
        widest: On the page [px]; as wide as there is space without it.
    """
    said = Markup(' aria-label="{}"').format(label) if label else Markup("")
    style = Markup("") if widest is None else Markup(' style="max-width:{:.0f}px"').format(widest)
    return Markup(
        '<svg id="{}" class="{}" viewBox="0 0 {:.0f} {:.0f}" role="img"{}{}>{}</svg>'
    ).format(identity, kind, width, height, said, style, Markup("").join(parts))


def _place(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.1f}"


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
        """Return where values are from left to right."""
        low, high = self.across
        return np.asarray(self.x + self.width * (np.asarray(values) - low) / (high - low))

    def level(self, values: FloatArray) -> FloatArray:
        """Return where values are from top to bottom."""
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
    places = zip(panel.place(thin[0]), panel.level(thin[1]), strict=True)
    return polyline(places, color, width, joined=True)


def draw_shade(panel: Panel, begin: float, end: float) -> Markup:
    """A shade over a part of a field."""
    low, high = panel.place(np.clip([begin, end], *panel.across))
    return shade(low, f"{panel.y:.1f}", max(high - low, 1.0), panel.height, 0.09)


def draw_panel_axes(panel: Panel, unit: str, side: str) -> Markup:
    """Grid lines with numbers; units behind the last one and above the first."""
    parts = []
    levels = even_ticks(panel.up[0], panel.up[1], 4)
    if len(levels) < 2:  # one number is no scale
        levels = even_ticks(panel.up[0], panel.up[1], 8)
    for value in levels:
        y = float(panel.level(np.array(value)))
        parts.append(
            line(
                float(panel.x),
                y,
                float(panel.x + panel.width),
                y,
                opacity=0.45 if value == 0.0 else 0.13,
            )
        )
        parts.append(text(panel.x - 5, y + 3.5, round_label(value), anchor="end", size=10.5))
    ticks = even_ticks(panel.across[0], panel.across[1], 6)
    for value in ticks:
        x = float(panel.place(np.array(value)))
        words = round_label(value) + (f" {unit}" if value == ticks[-1] else "")
        parts.append(text(x, panel.y + panel.height + 14, words, anchor="middle", size=10.5))
    if side:
        parts.append(text(panel.x - 5, panel.y - 4, side, anchor="end", size=10.5))
    return Markup("").join(parts)


def round_label(value: float) -> str:
    """A number of an axis."""
    text = (
        f"{value:.3g}"
        if abs(value) < 1000.0
        else f"{float(f'{value:.2g}'):,.0f}".replace(",", "\u202f")
    )
    return text.replace("-", "−") if text.startswith("-") else text
