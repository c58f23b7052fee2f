"""The contour in the report: tool gap and leg forces over time as SVG, the faces marked."""

from collections.abc import Callable, Sequence
from typing import Literal

from markupsafe import Markup

from headstock.app.report import svg
from headstock.pipeline.results.contouring import ContourSummary

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1040, 240, 56, 12, 20, 30
COLORS = ("#4f7cac", "#d08a4a", "#6a9a5b")
PICTURES = {"gap": (("x", "y", "z"), "Gap of the tool point, gravity sag subtracted [µm]"),
            "legs": (("leg 1", "leg 2", "leg 3"), "Force of each leg's drive [N]")}  # fmt: skip


def draw_contour(found: ContourSummary, picture: Literal["gap", "legs"]) -> Markup:
    """One picture of a contour, ``gap`` or ``legs``: a line per column over time."""
    names, title = PICTURES[picture]
    times, values = found["series"]["time_s"], found["series"]["gap_um" if picture == "gap" else "leg_force_n"]
    low, high = min(min(row) for row in values), max(max(row) for row in values)
    room = 0.05 * ((high - low) or 1.0)
    low, high = low - room, high + room

    def across(time: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (time - times[0]) / ((times[-1] - times[0]) or 1.0)

    def up(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low)

    parts = [_faces(found["marks_s"], across, times[-1])]
    for value in (low + room, 0.0, high - room):
        if low <= value <= high:
            parts.append(svg.line(LEFT, up(value), WIDTH - RIGHT, up(value), opacity=0.25))
            parts.append(svg.text(LEFT - 5, up(value) + 4, f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}", anchor="end"))
    for column, color in enumerate(COLORS):
        points = " ".join(f"{across(time):.1f},{up(row[column]):.1f}" for time, row in zip(times, values, strict=True))
        parts.append(Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="1.3"/>').format(points, color))
        parts.append(svg.text(LEFT + 470 + 60 * column, 13, names[column], color=color))
    parts += [
        svg.text(LEFT, 13, title),
        svg.text(WIDTH - RIGHT, HEIGHT - 4, f"{times[-1]:.1f} s", anchor="end"),
        svg.text(LEFT, HEIGHT - 4, "0 s"),
    ]
    return svg.picture(parts, identity=f"contour_{picture}", kind="sticks", width=WIDTH, height=HEIGHT, label=title)


def _faces(marks: Sequence[float], across: Callable[[float], float], last: float) -> Markup:
    parts = []
    for face in range(4):
        if marks[face] < last:
            start, end = across(marks[face]), across(min(marks[face + 1], last))
            shade = 0.07 if face % 2 == 0 else 0.0
            parts.append(
                Markup('<rect x="{:.1f}" y="{}" width="{:.1f}" height="{}" fill="currentColor" opacity="{}"/>').format(
                    start, TOP, end - start, HEIGHT - TOP - BOTTOM, shade
                )
            )
            parts.append(svg.text((start + end) / 2, HEIGHT - BOTTOM + 13, f"face {face + 1}", anchor="middle"))
    return Markup("").join(parts)
