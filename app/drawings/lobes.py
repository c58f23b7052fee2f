"""What cutting leads to, in the report: stability lobes, limit depth over the speed of the spindle, one picture
for each direction of travel, each lobe in the colour of its mode (two stand side by side; one alone can be read
on a screen of 400 pixels); and the profile of each milled face along the travel, with a short piece of it in
which the marks of the teeth are seen.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.texts.bounded_values import show_best_depth, show_bound, show_bounded
from headstock.app.texts.curves import even_ticks
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.lobes import HZ, MM, DirectionLobes, PoseLobes
from headstock.pipeline.answers.milled_faces import UM, MilledFace
from headstock.pipeline.numbers.estimates import scale_total

WIDTH, LEFT, RIGHT, TITLE, HEIGHT, LINE = 600, 34, 14, 28, 230, 19
WIDEST = 780.0  # on the page [px]
SIZE = 12.5  # of the font
COLORS = ("#2f6db3", "#d08a4a", "#6a9a5b", "#8a6bb0", "#b5566e", "#5d8f8f", "#8c9bab")
HEADROOM = 1.15
MOST_OVER_LOWEST = 12.0  # of the axis over the lowest limit: one deep pocket does not flatten lobes
LETTER = 7.0  # width of a letter
LABEL = 150.0  # width of the text at a best speed
LOWEST, BEST, UNKNOWN = "#b5566e", "#6a9a5b", "#8c9bab"
MOST_DOTS = 60  # speeds that are dots on the line
Scale = Callable[[float], float]
Sign = Callable[[float, float, str], Markup]


def draw_lobes(found: PoseLobes, direction: DirectionLobes, identity: str) -> Markup:
    """The lobes of a direction of travel in a pose: green below the border, hatched where nothing is
    known of it.

    Args:
        identity: ``id`` in the page.
    """
    speeds, depths, confirmed = found.rpm, MM * direction.depths, found.confirmed
    known = np.isfinite(depths)
    ends = (depths[known].min(), depths[known].max()) if known.any() else (1.0, 1.0)
    highest = HEADROOM * float(min(ends[1], MOST_OVER_LOWEST * max(ends[0], 1e-6)))
    base = float(TITLE + HEIGHT)

    def across(value: float) -> float:
        return float(LEFT + (WIDTH - LEFT - RIGHT) * (value - speeds[0]) / (speeds[-1] - speeds[0]))

    def up(value: float) -> float:
        return float(base - HEIGHT * min(max(value, 0.0), highest) / highest)

    parts = [
        svg.heading(
            4, TITLE - 12, f"Travel {direction.name}: limit depth of cut [mm]", size=SIZE + 1.0
        ),
        svg.hatching(f"{identity}_hatch", UNKNOWN),
    ]
    for value in even_ticks(0.0, highest, 5):
        parts.append(
            svg.line(float(LEFT), up(value), float(WIDTH - RIGHT), up(value), opacity=0.13)
        )
        parts.append(svg.text(LEFT - 6, up(value) + 4.5, f"{value:g}", anchor="end", size=SIZE))
    ticks = even_ticks(float(speeds[0]), float(speeds[-1]), 5)
    for value in ticks:
        words = f"{value:g}{' rpm' if value == ticks[-1] else ''}"
        parts.append(svg.line(across(value), base, across(value), base + 4.0, opacity=0.5))
        middle = min(across(value), WIDTH - 0.6 * LETTER * len(words))
        parts.append(svg.text(middle, base + 18, words, anchor="middle", size=SIZE))
    modes = list(dict.fromkeys(lobe.mode for lobe in direction.lobes))
    colors = dict(zip(modes, itertools.cycle(COLORS), strict=False))
    green = _Fill("#6a9a5b", 0.12) if confirmed else _Fill(f"url(#{identity}_hatch)", 1.0)
    hatch = _Fill(f"url(#{identity}_hatch)", 1.0)
    parts += _fill_below(speeds, depths, across, up, stable=green, unknown=hatch)
    parts += _draw_band(speeds, depths, MM * direction.errors, across, up)
    parts += _draw_border(found, direction, colors, across, up)
    parts += [_mark_lowest(found, direction, across, up), _mark_best(found, direction, across, up)]
    bounded = direction.lowest_errors[0].total
    dots = [("lowest limit, with its ±" if bounded else "lowest limit", LOWEST)]
    dots += [("best speeds", BEST)] if direction.best else []
    legend, y = _legend(direction, colors, dots if direction.lowest else [], base + 42.0)
    if not (confirmed and known.all()):
        what = (
            "hatched: nothing is known" if confirmed else "hatched: nothing confirms these limits"
        )
        y += LINE
        legend.append(svg.text(float(LEFT), y, what, size=SIZE))
    return svg.picture(
        [*parts, *legend],
        identity=identity,
        kind="sticks",
        width=WIDTH,
        height=y + 8.0,
        label=f"Limit depth of cut over the speed of the spindle, travel {direction.name}",
        widest=WIDEST,
    )


class _Fill(NamedTuple):
    """Colour or pattern of an area, and how opaque it is."""

    paint: str
    opacity: float


def _fill_below(
    speeds: FloatArray,
    depths: FloatArray,
    across: Scale,
    up: Scale,
    *,
    stable: _Fill,
    unknown: _Fill,
) -> Iterator[Markup]:
    """What is stable between two speeds, up to the lower limit of both; all of it in the other fill
    where one is not known.
    """
    known = np.isfinite(depths)
    for place in range(len(speeds) - 1):
        left, right = across(float(speeds[place])), across(float(speeds[place + 1]))
        both = bool(known[place : place + 2].all())
        height = up(float(depths[place : place + 2].min()) if both else math.inf)
        corners = [(left, up(0.0)), (left, height), (right, height), (right, up(0.0))]
        fill = stable if both else unknown
        yield svg.area(corners, fill.paint, opacity=fill.opacity)


def _draw_band(
    speeds: FloatArray, depths: FloatArray, errors: FloatArray, across: Scale, up: Scale
) -> Iterator[Markup]:
    """The ± of the border, along neighbours that have one."""
    bounded = np.isfinite(depths) & np.isfinite(errors)
    for run in _runs(list(bounded)):
        if bounded[run[0]] and len(run) > 1:
            band = [(across(speeds[p]), up(depths[p] + errors[p])) for p in run]
            band += [(across(speeds[p]), up(depths[p] - errors[p])) for p in reversed(run)]
            yield svg.area(band, UNKNOWN, opacity=0.25)


def _draw_border(
    found: PoseLobes, direction: DirectionLobes, colors: dict[str, str], across: Scale, up: Scale
) -> Iterator[Markup]:
    """The border in the colours of its modes, and dots where speeds stand alone or are few."""
    rpm, depths, known = found.rpm, MM * direction.depths, np.isfinite(direction.depths)
    looked = [int(place) for place in np.flatnonzero(known)]
    places = [(across(float(rpm[p])), up(float(depths[p]))) for p in looked]
    for run in _runs([int(direction.owner[place]) for place in looked]):
        lobe = int(direction.owner[looked[run[0]]])
        color = UNKNOWN if lobe < 0 else colors[direction.lobes[lobe].mode]
        for piece in _pieces(looked, places, run[0], run[-1] + 2):
            yield svg.polyline(piece, color, 1.8, joined=True)
    if len(looked) > MOST_DOTS and len(looked) == len(known):
        return
    for (x, y), place in zip(places, looked, strict=True):
        if found.confirmed and not known[max(place - 1, 0) : place + 2].all():
            side = [(x - 1.0, up(0.0)), (x - 1.0, y), (x + 1.0, y), (x + 1.0, up(0.0))]
            yield svg.area(side, BEST, opacity=0.6)
        yield _circle(x, y, UNKNOWN, 2.0)


def _pieces(
    looked: list[int], places: list[tuple[float, float]], first: int, end: int
) -> list[list[tuple[float, float]]]:
    """Lines between neighbouring speeds that were both looked at, of some places."""
    pieces: list[list[tuple[float, float]]] = []
    for number in range(first, min(end, len(looked))):
        if number == first or looked[number] != looked[number - 1] + 1:
            pieces.append([])
        pieces[-1].append(places[number])
    return [piece for piece in pieces if len(piece) > 1]


def _legend(
    direction: DirectionLobes, colors: dict[str, str], dots: list[tuple[str, str]], y: float
) -> tuple[list[Markup], float]:
    """Lines of modes and dots with their words, and where the last row is."""
    entries: list[tuple[Sign, str, str]] = []
    for mode, color in colors.items():
        hz = next(lobe.mode_hz for lobe in direction.lobes if lobe.mode == mode)
        entries.append((_stroke, mode + (f", {hz:.0f} Hz" if hz is not None else ""), color))
    entries += [(_circle, words, color) for words, color in dots]
    parts, x = [], float(LEFT)
    for sign, words, color in entries:
        width = 30.0 + LETTER * len(words)
        if x > LEFT and x + width > WIDTH - RIGHT:
            x, y = float(LEFT), y + LINE
        parts += [sign(x + 8.0, y - 4.5, color), svg.text(x + 21.0, y, words, size=SIZE)]
        x += width
    return parts, y


def _mark_lowest(found: PoseLobes, direction: DirectionLobes, across: Scale, up: Scale) -> Markup:
    lowest = direction.lowest
    if lowest is None:
        return Markup("")
    depth_error, chatter_error = direction.lowest_errors
    depth, error = float(MM * direction.depths[lowest.place]), scale_total(depth_error, MM)
    x, y = across(float(found.rpm[lowest.place])), up(depth)
    limit = _show_value(depth, error)
    chatter = _show_value(float(HZ * direction.chatter[lowest.place]), chatter_error.total)
    parts = [_circle(x, y, LOWEST)]
    if error is not None:
        ends = [up(depth + error), up(max(depth - error, 0.0))]
        parts.append(svg.polyline([(x, end) for end in ends], LOWEST, 1.2, joined=True))
        parts += [
            svg.polyline([(x - 5.0, end), (x + 5.0, end)], LOWEST, 1.2, joined=True) for end in ends
        ]
    words = f"{limit} mm, chatter {chatter} Hz"
    half = 0.5 * LETTER * len(words)
    beside = min(max(x, LEFT + half), WIDTH - RIGHT - half)
    parts.append(svg.text(beside, y + 20, words, anchor="middle", size=SIZE))
    return Markup("").join(parts)


def _mark_best(found: PoseLobes, direction: DirectionLobes, across: Scale, up: Scale) -> Markup:
    parts = []
    taken: list[float] = []
    rpm, depths = found.rpm, MM * direction.depths
    known = np.isfinite(depths)
    line = [*zip(map(float, rpm[known]), map(float, depths[known]), strict=True)]
    for place in direction.best:
        depth = float(depths[place])
        x, y = across(float(rpm[place])), up(depth)
        parts.append(_circle(x, y, BEST))
        if all(abs(x - other) > LABEL for other in taken):
            taken.append(x)
            words = f"{show_best_depth(direction, place)} mm at {rpm[place]:.0f} rpm"
            # on the side where the line falls, so that it does not cross the text
            beside = [d for s, d in line if 0.0 < across(s) - x < LABEL]
            rises = max(beside, default=0.0) > depth
            anchor = "end" if x > WIDTH - LABEL or (rises and x > LEFT + LABEL) else "start"
            parts.append(
                svg.text(x + (-7 if anchor == "end" else 7), y - 5, words, anchor=anchor, size=SIZE)
            )
    return Markup("").join(parts)


def _show_value(value: float, error: float | None) -> str:
    """A value with its ±, where one is known."""
    if error is None:
        return f"{value:.3g}"
    return f"{show_bounded(value, error)} {show_bound(value, error)}"


def _stroke(x: float, y: float, color: str) -> Markup:
    return svg.polyline([(x - 8.0, y), (x + 8.0, y)], color, 3.0, joined=True)


def _circle(x: float, y: float, color: str, radius: float = 4.0) -> Markup:
    return Markup('<circle cx="{:.1f}" cy="{:.1f}" r="{:g}" fill="{}"/>').format(
        x, y, radius, color
    )


def _runs(owners: Sequence[object]) -> list[list[int]]:
    """Numbers of neighbours with the same owner."""
    return [
        [place for place, _ in group]
        for _, group in itertools.groupby(enumerate(owners), key=lambda item: item[1])
    ]


FACE_WIDTH, FACE_TITLE, FACE_HEIGHT, FACE_FOOT = 1150, 24, 130, 26
WHOLE, PIECE = (52.0, 770.0), (850.0, 1138.0)  # from left to right
LINE_COLOR, BAND_COLOR = "#2f6db3", "#8c9bab"
SEEN = (10.0, 90.0)  # percentiles that the axis spans: an entry does not flatten profiles
FACE_HEADROOM, MOST_ROUGH = 2.0, 1.25


def draw_milled_faces(faces: Sequence[MilledFace]) -> Markup:
    """The profiles of faces under each other, micrometres equally long in all of them."""
    half = max(_half_span(face) for face in faces)
    rough = max(float(np.ptp(UM * face.detail)) for face in faces)
    parts, top = list[Markup](), 0.0
    for face in faces:
        parts += [_draw_whole(face, top, half), _draw_piece(face, top, 0.5 * rough)]
        top += FACE_TITLE + FACE_HEIGHT + FACE_FOOT
    return svg.picture(
        parts,
        identity="milled_faces",
        kind="sticks",
        width=FACE_WIDTH,
        height=top,
        label="Profiles of the milled faces",
    )


def _half_span(face: MilledFace) -> float:
    ends = UM * np.concatenate([face.lowest, face.highest]) - UM * face.parameters.location
    return float(np.abs(np.percentile(ends, SEEN)).max())


def _draw_whole(face: MilledFace, top: float, half: float) -> Markup:
    middle, places = UM * face.parameters.location, MM * face.places
    low, high, line = UM * face.lowest, UM * face.highest, UM * face.waviness
    panel = _make_panel(WHOLE, (0.0, MM * face.length), top, middle, FACE_HEADROOM * half)
    begin, end = panel.place(MM * np.array(face.evaluated))
    band = zip(
        panel.place(np.concatenate([places, places[::-1]])),
        panel.level(np.concatenate([low, high[::-1]])),
        strict=True,
    )
    title = (
        f"Face {face.number}, {face.at}: height [µm] at {MM * face.height:.3g} mm, mean line of"
        f" {MM * face.cut_off:.3g} mm; evaluated where shaded"
    )
    return Markup("").join(
        [
            svg.shade(begin, f"{panel.y:.1f}", end - begin, FACE_HEIGHT, 0.05),
            *_grid(panel, middle, 0.95 * FACE_HEADROOM * half),
            Markup(
                '<clipPath id="milled_face_{}"><rect x="{}" y="{}" width="{}" height="{}"/></clipPath>'
            ).format(face.number, panel.x, panel.y, panel.width, FACE_HEIGHT),
            Markup('<g clip-path="url(#milled_face_{})">').format(face.number),
            svg.area(band, BAND_COLOR, opacity=0.45),
            _draw_profile(panel, places, line),
            Markup("</g>"),
            svg.heading(panel.x, panel.y - 8, title),
        ]
    )


def _draw_piece(face: MilledFace, top: float, half: float) -> Markup:
    places, heights = MM * face.detail_places, UM * face.detail
    middle = 0.5 * float(heights.max() + heights.min())
    span = float(places[0]), float(places[-1])
    panel = _make_panel(PIECE, span, top, middle, MOST_ROUGH * half)
    title = f"Marks of the teeth, {MM * face.per_tooth:.3g} mm apart if rigid"
    return Markup("").join(
        [
            *_grid(panel, middle, half),
            _draw_profile(panel, places, heights),
            svg.heading(panel.x, panel.y - 8, title),
        ]
    )


def _make_panel(
    sides: tuple[float, float],
    span: tuple[float, float],
    top: float,
    middle: float,
    half: float,
) -> svg.Panel:
    """Return the field of a profile: millimetres along and micrometres across a face."""
    half = half or 1.0
    up = (middle - half, middle + half)
    return svg.Panel(sides[0], top + FACE_TITLE, sides[1] - sides[0], FACE_HEIGHT, span, up)


def _grid(panel: svg.Panel, middle: float, half: float) -> list[Markup]:
    base, right, parts = panel.y + FACE_HEIGHT, panel.x + panel.width, list[Markup]()
    for value in even_ticks(middle - half, middle + half, 4):
        y = float(panel.level(np.array(value)))
        parts.append(svg.line(panel.x, y, right, y, opacity=0.13))
        parts.append(svg.text(panel.x - 5, y + 3.5, f"{value:.6g}", anchor="end", size=10.5))
    ticks = even_ticks(*panel.across, 6)
    for value in ticks:
        x, words = float(panel.place(np.array(value))), f"{value:.6g}"
        parts.append(svg.line(x, base, x, base + 4.0, opacity=0.5))
        words += " mm" if value == ticks[-1] else ""
        parts.append(svg.text(x, base + 15, words, anchor="middle", size=10.5))
    parts.append(svg.line(panel.x, base, right, base, opacity=0.35))
    return parts


def _draw_profile(panel: svg.Panel, places: FloatArray, heights: FloatArray) -> Markup:
    points = zip(panel.place(places), panel.level(heights), strict=True)
    return svg.polyline(points, LINE_COLOR, 1.3)
