"""Closed-loop poles in the report: damping over frequency as SVG."""

import math

from markupsafe import Markup

from headstock.pipeline.storage.json_texts import Json

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1040, 230, 56, 16, 22, 34
LEAST, MOST = 1e-3, 1.0
LEVELS = ((1e-3, "0.1 %"), (1e-2, "1 %"), (1e-1, "10 %"), (1.0, "100 %"))
COLORS = ("#4f7cac", "#d08a4a", "#6a9a5b", "#8a6fae", "#b5566e", "#777777")
GROWING = "#c0392b"


def draw_poles(control: Json, identity: str) -> Markup:
    """Every pole as a dot in the colour of its drive; those that grow stand below the axis, in red."""
    names = list(control["drives"])
    parts = []
    for level, label in LEVELS:
        y = _height(level)
        parts.append(_line(LEFT, y, WIDTH - RIGHT, y, 0.15))
        parts.append(_text(LEFT - 6, y + 4, "end", label))
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = LEFT + share * (WIDTH - LEFT - RIGHT)
        parts.append(_line(x, TOP, x, HEIGHT - BOTTOM, 0.1))
        parts.append(_text(x, HEIGHT - BOTTOM + 22, "middle", f"{share * control['up_to_hz']:g}{' Hz' if share == 1.0 else ''}"))
    dot = Markup('<circle cx="{:.1f}" cy="{:.1f}" r="5" fill="{}" opacity="0.85"><title>{}</title></circle>')
    for pole in control["poles"]:
        grows = pole["real"] > 0.0
        color = GROWING if grows else COLORS[names.index(pole["drive"]) % len(COLORS)]
        y = HEIGHT - BOTTOM + 8 if grows else _height(pole["damping_ratio"])
        title = f"{pole['frequency_hz']:.4g} Hz, {100.0 * pole['damping_ratio']:.3g} %: {pole['name']}"
        x = LEFT + min(1.0, pole["frequency_hz"] / control["up_to_hz"]) * (WIDTH - LEFT - RIGHT)
        parts.append(dot.format(x, y, color, title))
    for number, name in enumerate(names):
        parts.append(_text(LEFT + 90 * number, 12, "start", f"● {name}", COLORS[number % len(COLORS)]))
    frame = '<svg id="{}" class="sticks" viewBox="0 0 {} {}" role="img" aria-label="Damping of closed-loop poles over frequency">{}</svg>'
    return Markup(frame).format(identity, WIDTH, HEIGHT, Markup("").join(parts))


def _height(ratio: float) -> float:
    """Place of a damping ratio on a logarithmic axis, cut at its ends."""
    shown = min(MOST, max(LEAST, ratio))
    return TOP + (HEIGHT - TOP - BOTTOM) * math.log(MOST / shown) / math.log(MOST / LEAST)


def _line(x1: float, y1: float, x2: float, y2: float, opacity: float) -> Markup:
    return Markup('<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}" stroke="currentColor" opacity="{}"/>').format(
        x1, y1, x2, y2, opacity
    )


def _text(x: float, y: float, anchor: str, words: str, color: str = "currentColor") -> Markup:
    return Markup('<text x="{:.1f}" y="{:.1f}" font-size="11" text-anchor="{}" fill="{}">{}</text>').format(
        x, y, anchor, color, words
    )
