"""Milled faces in the report: the profile of each face along the travel, and a short piece of it in
which the marks of the teeth are seen.
"""

from collections.abc import Callable, Sequence

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.texts.curves import even_ticks
from headstock.pipeline.answers.milled_faces import MilledFaceSummary

WIDTH, TITLE, HEIGHT, FOOT = 1150, 24, 130, 26
WHOLE, PIECE = (52.0, 770.0), (850.0, 1138.0)  # from left to right
LINE_COLOR, BAND_COLOR = "#2f6db3", "#8c9bab"
SEEN = (10.0, 90.0)  # percentiles that the axis spans: an entry does not flatten profiles
HEADROOM, MOST_ROUGH = 2.0, 1.25
Scale = Callable[[float], float]


def draw_milled_faces(faces: Sequence[MilledFaceSummary]) -> Markup:
    """The profiles of faces under each other, micrometres equally long in all of them."""
    half = max(_half_span(face) for face in faces)
    rough = max(float(np.ptp(face["detail"]["height_um"])) for face in faces)
    parts, top = list[Markup](), 0.0
    for face in faces:
        parts += [_draw_whole(face, top, half), _draw_piece(face, top, 0.5 * rough)]
        top += TITLE + HEIGHT + FOOT
    return svg.picture(
        parts,
        identity="milled_faces",
        kind="sticks",
        width=WIDTH,
        height=top,
        label="Profiles of the milled faces",
    )


def _half_span(face: MilledFaceSummary) -> float:
    profile = face["profile"]
    ends = np.concatenate([profile["lowest_um"], profile["highest_um"]]) - face["location_error_um"]
    return float(np.abs(np.percentile(ends, SEEN)).max())


def _draw_whole(face: MilledFaceSummary, top: float, half: float) -> Markup:
    profile, middle = face["profile"], face["location_error_um"]
    places, low, high, line = (
        np.array(values)
        for values in (
            profile["at_mm"],
            profile["lowest_um"],
            profile["highest_um"],
            profile["waviness_um"],
        )
    )
    across, up = _scales(WHOLE, (0.0, face["length_mm"]), top, middle, HEADROOM * half)
    begin, end = (across(place) for place in face["evaluated_mm"])
    band = [*zip(places, low, strict=True), *zip(places[::-1], high[::-1], strict=True)]
    title = (
        f"Face {face['face']}, {face['at']}: height [µm] at {face['height_mm']:.3g} mm, mean line of"
        f" {face['cut_off_mm']:.3g} mm; evaluated where shaded"
    )
    return Markup("").join(
        [
            Markup(
                '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{}" fill="currentColor" opacity="0.05"/>'
            ).format(begin, top + TITLE, end - begin, HEIGHT),
            *_grid(
                WHOLE, (0.0, face["length_mm"]), across, up, top, middle, 0.95 * HEADROOM * half
            ),
            Markup(
                '<clipPath id="milled_face_{}"><rect x="{}" y="{}" width="{}" height="{}"/></clipPath>'
            ).format(face["face"], WHOLE[0], top + TITLE, WHOLE[1] - WHOLE[0], HEIGHT),
            Markup('<g clip-path="url(#milled_face_{})">').format(face["face"]),
            Markup('<polygon points="{}" fill="{}" opacity="0.45"/>').format(
                _points([(across(x), up(y)) for x, y in band]), BAND_COLOR
            ),
            _polyline([(across(x), up(y)) for x, y in zip(places, line, strict=True)]),
            Markup("</g>"),
            svg.heading(WHOLE[0], top + TITLE - 8, title),
        ]
    )


def _draw_piece(face: MilledFaceSummary, top: float, half: float) -> Markup:
    places, heights = np.array(face["detail"]["at_mm"]), np.array(face["detail"]["height_um"])
    middle = 0.5 * float(heights.max() + heights.min())
    span = float(places[0]), float(places[-1])
    across, up = _scales(PIECE, span, top, middle, MOST_ROUGH * half)
    return Markup("").join(
        [
            *_grid(PIECE, span, across, up, top, middle, half),
            _polyline([(across(x), up(y)) for x, y in zip(places, heights, strict=True)]),
            svg.heading(
                PIECE[0],
                top + TITLE - 8,
                f"Marks of the teeth, {face['feed_per_tooth_mm']:.3g} mm apart if rigid",
            ),
        ]
    )


def _scales(
    sides: tuple[float, float],
    span: tuple[float, float],
    top: float,
    middle: float,
    half: float,
) -> tuple[Scale, Scale]:
    """From millimetres along and micrometres across a face to places in the picture."""
    low, high = top + TITLE, top + TITLE + HEIGHT

    def across(value: float) -> float:
        return float(sides[0] + (sides[1] - sides[0]) * (value - span[0]) / (span[1] - span[0]))

    def up(value: float) -> float:
        return float(0.5 * (low + high) - 0.5 * HEIGHT * (value - middle) / (half or 1.0))

    return across, up


def _grid(
    sides: tuple[float, float],
    span: tuple[float, float],
    across: Scale,
    up: Scale,
    top: float,
    middle: float,
    half: float,
) -> list[Markup]:
    base, parts = top + TITLE + HEIGHT, list[Markup]()
    for value in even_ticks(middle - half, middle + half, 4):
        parts.append(svg.line(sides[0], up(value), sides[1], up(value), opacity=0.13))
        parts.append(
            svg.text(sides[0] - 5, up(value) + 3.5, f"{value:.6g}", anchor="end", size=10.5)
        )
    ticks = even_ticks(span[0], span[1], 6)
    for value in ticks:
        words = f"{value:.6g}{' mm' if value == ticks[-1] else ''}"
        parts.append(svg.line(across(value), base, across(value), base + 4.0, opacity=0.5))
        parts.append(svg.text(across(value), base + 15, words, anchor="middle", size=10.5))
    parts.append(svg.line(sides[0], base, sides[1], base, opacity=0.35))
    return parts


def _polyline(places: Sequence[tuple[float, float]]) -> Markup:
    return Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="1.3"/>').format(
        _points(places), LINE_COLOR
    )


def _points(places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
