"""Milled faces in the report: the profile of each face along the travel, and a short piece of it in
which the marks of the teeth are seen.
"""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.texts.curves import even_ticks
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.milled_faces import MilledFaceSummary

WIDTH, TITLE, HEIGHT, FOOT = 1150, 24, 130, 26
WHOLE, PIECE = (52.0, 770.0), (850.0, 1138.0)  # from left to right
LINE_COLOR, BAND_COLOR = "#2f6db3", "#8c9bab"
SEEN = (10.0, 90.0)  # percentiles that the axis spans: an entry does not flatten profiles
HEADROOM, MOST_ROUGH = 2.0, 1.25


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
    panel = _make_panel(WHOLE, (0.0, face["length_mm"]), top, middle, HEADROOM * half)
    begin, end = panel.place(np.array(face["evaluated_mm"]))
    band = zip(
        panel.place(np.concatenate([places, places[::-1]])),
        panel.level(np.concatenate([low, high[::-1]])),
        strict=True,
    )
    title = (
        f"Face {face['face']}, {face['at']}: height [µm] at {face['height_mm']:.3g} mm, mean line of"
        f" {face['cut_off_mm']:.3g} mm; evaluated where shaded"
    )
    return Markup("").join(
        [
            svg.shade(begin, f"{panel.y:.1f}", end - begin, HEIGHT, 0.05),
            *_grid(panel, middle, 0.95 * HEADROOM * half),
            Markup(
                '<clipPath id="milled_face_{}"><rect x="{}" y="{}" width="{}" height="{}"/></clipPath>'
            ).format(face["face"], panel.x, panel.y, panel.width, HEIGHT),
            Markup('<g clip-path="url(#milled_face_{})">').format(face["face"]),
            svg.area(band, BAND_COLOR, opacity=0.45),
            _draw_profile(panel, places, line),
            Markup("</g>"),
            svg.heading(panel.x, panel.y - 8, title),
        ]
    )


def _draw_piece(face: MilledFaceSummary, top: float, half: float) -> Markup:
    places, heights = np.array(face["detail"]["at_mm"]), np.array(face["detail"]["height_um"])
    middle = 0.5 * float(heights.max() + heights.min())
    span = float(places[0]), float(places[-1])
    panel = _make_panel(PIECE, span, top, middle, MOST_ROUGH * half)
    title = f"Marks of the teeth, {face['feed_per_tooth_mm']:.3g} mm apart if rigid"
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
    return svg.Panel(sides[0], top + TITLE, sides[1] - sides[0], HEIGHT, span, up)


def _grid(panel: svg.Panel, middle: float, half: float) -> list[Markup]:
    base, right, parts = panel.y + HEIGHT, panel.x + panel.width, list[Markup]()
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
