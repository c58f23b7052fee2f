"""Budgets, natural frequencies, closed-loop poles and maps of the report as SVG, so that they print
and work without scripts.
"""

import base64
import io
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from PIL import Image

from headstock.app.drawings import svg
from headstock.app.tables.static import sort_shares, top_shares
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.control import ControlAnswer
from headstock.pipeline.answers.map import PoseGrid
from headstock.pipeline.answers.modal import PoseModes
from headstock.reduction.motions.part_names import name_families

SHOWN_SHARE = 0.005
SMALLEST_PERCENT = 0.0005  # what is shown as 0.0 %, without a sign
BARS_SHOWN = 10
JOINT_COLOR = "#94a3b8"
BAR_WIDTH, BAR_STEP = 340, 27
BUDGET_ROW = """<text x="0" y="{line}" font-size="11.5" fill="currentColor">{name}</text>
<text x="{width}" y="{line}" font-size="11.5" text-anchor="end" fill="currentColor" data-value="{value}">{text}</text>
<rect x="0" y="{bar}" width="{width}" height="7" rx="2" fill="currentColor" opacity="0.08"/>
<rect x="0" y="{bar}" width="{long}" height="7" rx="2" fill="{color}"/>"""
LABEL_WIDTH = 44
STICK_WIDTH, STICK_HEIGHT, STICK_LEFT = 1040, 62, 130
WIDTH, HEIGHT = 1040, 230
LEFT, RIGHT, TOP, BOTTOM = 56.0, 16.0, 22.0, 34.0
LEAST, MOST = 1e-3, 1.0
LEVELS = ((1e-3, "0.1 %"), (1e-2, "1 %"), (1e-1, "10 %"), (1.0, "100 %"))
COLORS = ("#4f7cac", "#d08a4a", "#6a9a5b", "#8a6fae", "#b5566e", "#777777")
GROWING = "#c0392b"
MAP_WIDTH, MAP_LEFT, MAP_TOP, MAP_BOTTOM = 340, 56, 22, 34
# five stops of viridis, distinguished by most colour-blind readers and in grey
STOPS = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], dtype=float
)
TITLES = {
    "condition_number": "condition number",
    "mean_leg_m": "mean leg length [m]",
    **{f"stiffness_{axis}_n_per_um": f"static stiffness {axis} [N/µm]" for axis in "xyz"},
    **{f"f{number}_hz": f"mode {number} [Hz]" for number in range(1, 7)},
}


def draw_budget(
    shares: Mapping[str, float], colors: Mapping[str, str], identity: str, longest: float
) -> Markup:
    """One bar per part, largest first, parts whose names differ by a number together; joints in
    grey, components in their colours; a share of ``longest`` fills the width.

    Args:
        shares: Part to its share of the compliance, 0 to 1.
        identity: ``id`` in the page.
        longest: Share whose bar is as wide as the picture.
    """
    rows, parts = top_shares(shares, BARS_SHOWN, SHOWN_SHARE), []
    families = name_families(shares)
    for number, (name, share) in enumerate(rows):
        places = {"line": number * BAR_STEP + 12, "bar": number * BAR_STEP + 16, "width": BAR_WIDTH}
        words = {
            "name": _shorten(name),
            "value": repr(share),
            "text": percent(share),
            "color": colors.get(families[name][0], JOINT_COLOR),
        }
        parts.append(
            Markup(BUDGET_ROW).format(
                **places, **words, long=f"{max(1.0, BAR_WIDTH * share / longest):.1f}"
            )
        )
    height = max(1, len(rows)) * BAR_STEP + 2
    return svg.picture(parts, identity=identity, kind="budget", width=BAR_WIDTH, height=height)


def draw_frequencies(modal: Sequence[PoseModes], identity: str) -> Markup:
    """A stick per elastic natural frequency, one row per pose, from zero to the highest."""
    last = (float(modes.frequencies_hz[-1]) for modes in modal if len(modes.frequencies_hz))
    highest = max(last, default=1.0) or 1.0
    scale = (STICK_WIDTH - STICK_LEFT - 40) / highest
    parts = []
    for row, modes in enumerate(modal):
        y = row * STICK_HEIGHT
        base = y + STICK_HEIGHT - 16
        parts.append(
            Markup('<text x="0" y="{}" font-size="13" fill="currentColor">{}</text>').format(
                base - 4, _shorten(modes.pose.name, 18)
            )
        )
        parts.append(svg.line(STICK_LEFT, base, STICK_WIDTH - 20, base, opacity=0.3))
        parts.append(_sticks(modes, scale, base))
    return svg.picture(
        parts, identity=identity, kind="sticks", width=STICK_WIDTH, height=len(modal) * STICK_HEIGHT
    )


def draw_stack(shares: Mapping[str, float], colors: Mapping[str, str]) -> Markup:
    """A thin stacked bar of shares, largest first."""
    parts, start = [], 0.0
    for name, share in sort_shares(shares):
        if share >= SHOWN_SHARE:
            piece = '<rect x="{:.1f}" width="{:.1f}" height="9" fill="{}"><title>{}</title></rect>'
            parts.append(
                Markup(piece).format(
                    100 * start, max(0.0, 100 * share - 0.4), colors.get(name, JOINT_COLOR), name
                )
            )
        start += max(0.0, share)
    return Markup(
        '<svg class="stack" viewBox="0 0 100 9" preserveAspectRatio="none" aria-hidden="true">{}</svg>'
    ).format(Markup("").join(parts))


def percent(share: float) -> str:
    """A share in per cent to three digits."""
    share = 0.0 if abs(share) < SMALLEST_PERCENT else share
    return f"{100 * share:.1f} %" if abs(share) < 0.9995 else f"{100 * share:.0f} %"


def _shorten(text: str, length: int = 38) -> str:
    """A text that fits beside its number."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def _sticks(modes: PoseModes, scale: float, base: int) -> Markup:
    parts, free_from = [], 0.0
    for frequency in map(float, modes.frequencies_hz[modes.rigid_count :]):
        x = STICK_LEFT + scale * frequency
        parts.append(
            Markup(
                '<line x1="{:.1f}" y1="{}" x2="{:.1f}" y2="{}" stroke="#4f7cac" stroke-width="2.4"/>'
            ).format(x, base - 30, x, base)
        )
        if x >= free_from:
            label = '<text x="{:.1f}" y="{}" font-size="11" text-anchor="middle" fill="currentColor" data-value="{}">{}</text>'
            # at 1000 Hz and above whole numbers: four digits and more
            text = f"{frequency:.4g}" if frequency < 1000.0 else f"{frequency:.0f}"
            parts.append(Markup(label).format(x, base + 13, repr(frequency), text))
            free_from = x + LABEL_WIDTH
    return Markup("").join(parts)


def draw_poles(control: ControlAnswer, identity: str) -> Markup:
    """Every pole as a dot in the colour of its drive; those that grow stand below the axis, in
    red.
    """
    names = [drive.train.name for drive in control.drives]
    parts = []
    for level, label in LEVELS:
        y = _height(level)
        parts.append(svg.line(LEFT, y, WIDTH - RIGHT, y, opacity=0.15))
        parts.append(svg.text(LEFT - 6, y + 4, label, anchor="end"))
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        x = LEFT + share * (WIDTH - LEFT - RIGHT)
        parts.append(svg.line(x, TOP, x, HEIGHT - BOTTOM, opacity=0.1))
        words = f"{share * control.up_to_hz:g}{' Hz' if share == 1.0 else ''}"
        parts.append(svg.text(x, HEIGHT - BOTTOM + 22, words, anchor="middle"))
    dot = Markup(
        '<circle cx="{:.1f}" cy="{:.1f}" r="5" fill="{}" opacity="0.85"><title>{}</title></circle>'
    )
    for pole in control.poles:
        grows = pole.pole.real > 0.0
        color = GROWING if grows else COLORS[names.index(pole.drive) % len(COLORS)]
        y = HEIGHT - BOTTOM + 8 if grows else _height(pole.damping_ratio)
        title = f"{pole.frequency_hz:.4g} Hz, {100.0 * pole.damping_ratio:.3g} %: {pole.name}"
        x = LEFT + min(1.0, pole.frequency_hz / control.up_to_hz) * (WIDTH - LEFT - RIGHT)
        parts.append(dot.format(x, y, color, title))
    for number, name in enumerate(names):
        parts.append(
            svg.text(LEFT + 90 * number, 12, f"● {name}", color=COLORS[number % len(COLORS)])
        )
    label = "Damping of closed-loop poles over frequency"
    return svg.picture(
        parts, identity=identity, kind="sticks", width=WIDTH, height=HEIGHT, label=label
    )


def _height(ratio: float) -> float:
    """Place of a damping ratio on a logarithmic axis, cut at its ends."""
    shown = min(MOST, max(LEAST, ratio))
    return TOP + (HEIGHT - TOP - BOTTOM) * math.log(MOST / shown) / math.log(MOST / LEAST)


class _MapLayer(NamedTuple):
    """A plane to draw: its place along the third axis of a volume, and what it stands at; of a
    plane it is the map itself.
    """

    place: int | None = None
    title: str = ""


def map_layers(found: PoseGrid) -> list[_MapLayer]:
    """The map itself, or the lowest, middle and highest layer of a volume."""
    if len(found.axes) == 2:
        return [_MapLayer()]
    levels, axis = found.positions[2], found.axes[2]
    places = sorted({0, (len(levels) - 1) // 2, len(levels) - 1})
    return [
        _MapLayer(place, f"{axis} = {show_position(levels[place], found.axis_units[axis])}")
        for place in places
    ]


def draw_map(
    found: PoseGrid, name: str, layer: int | None = None, *, title: str = "", stem: str = ""
) -> Markup:
    """One quantity over a plane: first axis to the right, second upwards; grey where the pose
    cannot be taken.

    Args:
        layer: Place along the third axis of a volume; colours are those of the whole volume.
        title: Above it, before its range; by default what the quantity is called.
        stem: Of its ``id`` in the page; by default the quantity.
    """
    whole = found.quantities[name]
    values = whole if layer is None else whole[:, :, layer]
    known = whole[np.isfinite(whole)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    share = np.clip((values - low) / ((high - low) or 1.0), 0.0, 1.0)
    pixels = np.full((*values.shape, 4), [200, 200, 200, 255], dtype=np.uint8)
    good = np.isfinite(values)
    channels = [
        np.interp(share[good], np.linspace(0.0, 1.0, len(STOPS)), STOPS[:, channel])
        for channel in range(3)
    ]
    pixels[good, :3] = np.round(np.stack(channels, axis=-1)).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels.transpose(1, 0, 2)[::-1])).save(file, "png")
    picture = base64.b64encode(file.getvalue()).decode()
    spans = [(float(positions[0]), float(positions[-1])) for positions in found.positions[:2]]
    ratio = (spans[1][1] - spans[1][0]) / ((spans[0][1] - spans[0][0]) or 1.0)
    inside = MAP_WIDTH - MAP_LEFT - 8
    height = float(np.clip(inside * ratio, 60.0, 480.0))
    title = f"{title or TITLES.get(name, name)}: {low:.4g} to {high:.4g}"
    shown = [
        [show_position(end, found.axis_units[axis]) for end in span]
        for axis, span in zip(found.axes, spans, strict=False)
    ]
    words = [
        svg.text(MAP_LEFT, 14, title, size=12),
        svg.text(MAP_LEFT, MAP_TOP + height + 14, shown[0][0], size=10),
        svg.text(MAP_WIDTH - 8, MAP_TOP + height + 14, shown[0][1], anchor="end", size=10),
        svg.text(
            MAP_LEFT + inside / 2, MAP_TOP + height + 14, found.axes[0], anchor="middle", size=10
        ),
        svg.text(MAP_LEFT - 4, MAP_TOP + height, shown[1][0], anchor="end", size=10),
        svg.text(MAP_LEFT - 4, MAP_TOP + 9, shown[1][1], anchor="end", size=10),
        svg.text(MAP_LEFT - 4, MAP_TOP + height / 2, found.axes[1], anchor="end", size=10),
    ]
    image = Markup(
        '<image x="{}" y="{}" width="{}" height="{:.1f}" preserveAspectRatio="none" style="image-rendering:pixelated"'
        ' href="data:image/png;base64,{}"/>'
    ).format(MAP_LEFT, MAP_TOP, inside, height, picture)
    stem = (stem or name) if layer is None else f"{stem or name}_{layer}"
    high = MAP_TOP + height + MAP_BOTTOM - 12
    return svg.picture(
        [image, *words],
        identity=f"map_{stem}",
        kind="map",
        width=MAP_WIDTH,
        height=high,
        label=title,
    )
