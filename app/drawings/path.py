"""Motions in the report: paths as travelled, their deviation over time, gap and leg forces of a contour; motion
under loads over time with the loads, and what drives under control do.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.drawings.svg import (
    Panel,
    draw_curve,
    draw_panel_axes,
    draw_shade,
    round_label,
    show_range,
)
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import SCENE_UNITS
from headstock.pipeline.answers.contouring import UM, ContourAnswer
from headstock.pipeline.answers.path import PathCurves, deviation_unit
from headstock.pipeline.answers.probes import MEGA
from headstock.pipeline.answers.transient import TransientCurves
from headstock.solvers.second_order import name_channel

WIDTH, LEFT, RIGHT, TITLE, FOOT = 1150, 52, 14, 24, 26
LINE_HEIGHT, PANEL_HEIGHT, GAP = 150, 150, 44
SHARES = (0.4, 0.3, 0.3)  # of the width: the whole move, and a closer look at both ramps
FEED_COLORS = ("#4f7cac", "#d08a4a", "#6a9a5b", "#8a6bb0", "#b5566e", "#5d8f8f")
TOTAL, QUASI_STATIC, RESIDUAL = "#2f6db3", "#d08a4a", "#8c9bab"
UNITS = {"um": "µm", "urad": "µrad"}
BEFORE, AFTER = 0.1, 2.4  # how far a closer look reaches before and after a ramp, in its durations


def draw_path(curves: Sequence[PathCurves], output: int, identity: str) -> Markup:
    """Everything of one output as one SVG: the path, then a row of three plots over time for each
    feed.

    Args:
        curves: One per feed.
        identity: ``id`` in the page.
    """
    channel = curves[0].outputs[output]
    parts = [_draw_line(curves, output)]
    top = TITLE + LINE_HEIGHT + GAP
    for run in curves:
        parts.append(_draw_run(run, output, top))
        top += TITLE + PANEL_HEIGHT + FOOT
    title = f"Deviation of {name_channel(channel)} from the path"
    return svg.picture(
        parts, identity=identity, kind="sticks", width=WIDTH, height=top, label=title
    )


def _draw_line(curves: Sequence[PathCurves], output: int) -> Markup:
    """The path as travelled: deviation over the place along it, one line per feed."""
    unit, factor = deviation_unit(curves[0].outputs[output])
    values = [factor * run.deviation.total[:, output] for run in curves]
    scale, shown = SCENE_UNITS[curves[0].unit]
    length = scale * float(curves[0].positions[-1])
    panel = Panel(LEFT, TITLE, WIDTH - LEFT - RIGHT, LINE_HEIGHT, (0.0, length), show_range(values))
    steepness = (panel.height / (panel.up[1] - panel.up[0])) / (panel.width / length) * 1e3
    title = f"The line as travelled, deviation of {name_channel(curves[0].outputs[output])}"
    if curves[0].unit == "m":
        title += f" magnified {round_label(steepness)} times"
    parts = [svg.heading(panel.x, panel.y - 10, title)]
    fastest = max(curves, key=lambda run: run.feed)
    for begin, end in fastest.zones:
        places = scale * np.interp([begin, end], fastest.deviation.times, fastest.positions)
        parts.append(draw_shade(panel, float(places[0]), float(places[1])))
    parts.append(draw_panel_axes(panel, shown, UNITS[unit]))
    for number, (run, value) in enumerate(zip(curves, values, strict=True)):
        color = FEED_COLORS[number % len(FEED_COLORS)]
        parts.append(draw_curve(panel, scale * run.positions, value, color, 1.3))
        parts.append(
            svg.text(
                WIDTH - RIGHT - 120 * (len(curves) - number - 1),
                TITLE - 10,
                run.name,
                anchor="end",
                size=10.5,
                color=color,
            )
        )
    return Markup("").join(parts)


def _draw_run(run: PathCurves, output: int, top: float) -> Markup:
    unit, factor = deviation_unit(run.outputs[output])
    found = run.deviation
    total, quasi_static = (
        factor * found.total[:, output],
        factor * (found.quasi_static + found.low_frequency)[:, output],
    )
    residual = factor * found.dynamic[:, output]
    last = float(found.times[-1])
    spans = [(0.0, last)]
    for begin, end in run.zones:
        ramp = end - begin
        spans.append((max(0.0, begin - BEFORE * ramp), min(last, end + AFTER * ramp)))
    room = WIDTH - LEFT - RIGHT - 2 * LEFT
    left, parts = float(LEFT), []
    words = (
        ("deviation", TOTAL),
        ("quasi-static, with low-frequency response", QUASI_STATIC),
        ("residual vibration", RESIDUAL),
    )
    for number, (span, share, (word, color)) in enumerate(zip(spans, SHARES, words, strict=True)):
        panel = Panel(
            left,
            top + TITLE,
            share * room,
            PANEL_HEIGHT,
            span,
            show_range([total, quasi_static, residual]),
        )
        parts.append(
            svg.heading(
                panel.x,
                panel.y - 10,
                (f"{run.name} [{UNITS[unit]}]", "accelerating", "decelerating")[number],
            )
        )
        # a line of the legend beside each heading
        beside = panel.x + (95 if number else 150)
        parts.append(svg.text(beside, panel.y - 10, word, size=10.5, color=color))
        parts += [
            draw_shade(panel, begin, end)
            for begin, end in run.zones
            if begin < span[1] and end > span[0]
        ]
        parts.append(draw_panel_axes(panel, "s", ""))
        if number:
            parts.append(draw_curve(panel, found.times, residual, RESIDUAL, 1.0))
        parts += [
            draw_curve(panel, found.times, quasi_static, QUASI_STATIC, 1.6),
            draw_curve(panel, found.times, total, TOTAL, 1.3),
        ]
        left += panel.width + LEFT
    return Markup("").join(parts)


CONTOUR_WIDTH, CONTOUR_HEIGHT, CONTOUR_LEFT, CONTOUR_RIGHT, TOP, BOTTOM = 1040, 240, 56, 12, 20, 30
CONTOUR_COLORS = ("#4f7cac", "#d08a4a", "#6a9a5b", "#9a6fb0", "#8a7a3a", "#4a9a9a")
GAP_TITLE, FORCES_TITLE, STRESS_TITLE = (
    "Gap of the tool point, deflection under gravity subtracted [µm]",
    "Force of each drive [N]",
    "Equivalent stress at probes, beside that under gravity [MPa]",
)


def draw_contour(found: ContourAnswer, picture: Literal["gap", "drives", "probes"]) -> Markup:
    """One picture of a contour: a line per column over time."""
    names: Sequence[str]
    match picture:
        case "gap":
            names, title, levels = DIRECTIONS, GAP_TITLE, UM * found.gap
        case "drives":
            names, title, levels = found.drives, FORCES_TITLE, found.drive_forces
        case "probes":
            names, title = [*found.probes], STRESS_TITLE
            stresses = [MEGA * probe.trace.von_mises for probe in found.probes.values()]
            levels = np.stack(stresses, axis=1)
    times = found.times
    low, high = float(levels.min()), float(levels.max())
    room = 0.05 * ((high - low) or 1.0)
    panel = Panel(
        CONTOUR_LEFT,
        TOP,
        CONTOUR_WIDTH - CONTOUR_LEFT - CONTOUR_RIGHT,
        CONTOUR_HEIGHT - TOP - BOTTOM,
        (float(times[0]), float(times[-1])),
        (low - room, high + room),
    )
    parts = [_shade_faces(found, panel)]
    for value in (low, 0.0, high):
        # beside zero there is no place for the number of another end
        if low - room <= value <= high + room and (value == 0.0 or abs(value) > room):
            y, right = float(panel.level(np.array(value))), CONTOUR_WIDTH - CONTOUR_RIGHT
            parts.append(svg.line(CONTOUR_LEFT, y, right, y, opacity=0.25))
            parts.append(svg.text(CONTOUR_LEFT - 5, y + 4, round_label(value), anchor="end"))
    for column, color in enumerate(CONTOUR_COLORS[: len(names)]):
        places = zip(panel.place(times), panel.level(levels[:, column]), strict=True)
        parts.append(svg.polyline(places, color, 1.3))
        parts.append(svg.text(CONTOUR_LEFT + 470 + 80 * column, 13, names[column], color=color))
    parts += [
        svg.text(CONTOUR_LEFT, 13, title),
        svg.text(
            CONTOUR_WIDTH - CONTOUR_RIGHT, CONTOUR_HEIGHT - 4, f"{times[-1]:.1f} s", anchor="end"
        ),
        svg.text(CONTOUR_LEFT, CONTOUR_HEIGHT - 4, "0 s"),
    ]
    return svg.picture(
        parts,
        identity=f"contour_{picture}",
        kind="sticks",
        width=CONTOUR_WIDTH,
        height=CONTOUR_HEIGHT,
        label=title,
    )


def _shade_faces(found: ContourAnswer, panel: Panel) -> Markup:
    parts = []
    for place, face in enumerate(found.faces):
        begins, ends = face.times
        start, end = panel.place(np.array([begins, min(ends, panel.across[1])]))
        faint = 0.0 if place % 2 else 0.07
        height = CONTOUR_HEIGHT - TOP - BOTTOM
        parts.append(svg.shade(start, str(TOP), end - start, height, faint))
        parts.append(
            svg.text(
                float(start + end) / 2,
                CONTOUR_HEIGHT - BOTTOM + 13,
                f"face {face.number}",
                anchor="middle",
            )
        )
    return Markup("").join(parts)


TIMES_WIDTH, TIMES_LEFT, TIMES_RIGHT, TIMES_TITLE, TIMES_FOOT = 1150, 58, 14, 24, 30
LOAD_HEIGHT, OUTPUT_HEIGHT, DRIVE_HEIGHT = 70, 150, 100
DRIVES_HEIGHT = 2 * (TIMES_TITLE + DRIVE_HEIGHT + TIMES_FOOT)
TIMES_COLORS = ("#2f6db3", "#d08a4a", "#6a9a5b", "#8a6bb0", "#b5566e", "#5d8f8f")
NEGLIGIBLE = 1e-10  # of the largest output of its kind: at rest by symmetry


def draw_transient(curves: TransientCurves, identity: str) -> Markup:
    """One SVG: a panel per load that has values over time, then one for all displacements and one
    for all rotations, one for the stress at probes, and of drives one for torques and one for
    position errors.

    Args:
        identity: ``id`` in the page.
    """
    parts, top = [], 0.0
    for number, (name, unit) in enumerate(zip(curves.loads, curves.units, strict=True)):
        values = curves.load_values[:, number]
        if not unit.endswith(" s") and values.any():
            label = f"Load {name} [{unit}]" if unit != "1" else f"Static load {name}, factor"
            lines = [("", values, "currentColor")]
            parts.append(_draw_field(curves.times, lines, label, top, LOAD_HEIGHT))
            top += TIMES_TITLE + LOAD_HEIGHT + TIMES_FOOT
    for unit in ("um", "urad"):
        chosen = [
            number
            for number, channel in enumerate(curves.outputs)
            if deviation_unit(channel)[0] == unit
        ]
        moved = 1e6 * curves.displacements[:, chosen]
        sizes = np.abs(moved).max(axis=0, initial=0.0)
        lines = [
            (
                name_channel(curves.outputs[number]),
                moved[:, place],
                TIMES_COLORS[place % len(TIMES_COLORS)],
            )
            for place, number in enumerate(chosen)
            if sizes[place] > NEGLIGIBLE * sizes.max()
        ]
        if lines:
            label = f"{'Displacement' if unit == 'um' else 'Rotation'} [{UNITS[unit]}]"
            parts.append(_draw_field(curves.times, lines, label, top, OUTPUT_HEIGHT))
            top += TIMES_TITLE + OUTPUT_HEIGHT + TIMES_FOOT
    if curves.probes:
        lines = [
            (probe.name, MEGA * probe.von_mises, TIMES_COLORS[number % len(TIMES_COLORS)])
            for number, probe in enumerate(curves.probes)
        ]
        label = "Equivalent stress at probes [MPa]"
        parts.append(_draw_field(curves.times, lines, label, top, DRIVE_HEIGHT))
        top += TIMES_TITLE + DRIVE_HEIGHT + TIMES_FOOT
    if curves.drives:
        parts.append(_draw_drives(curves.times, curves, top))
        top += DRIVES_HEIGHT
    said = f"Motion in pose {curves.pose}"
    return svg.picture(
        parts, identity=identity, kind="sticks", width=TIMES_WIDTH, height=top, label=said
    )


def draw_path_drives(curves: PathCurves, identity: str) -> Markup:
    """One SVG: torques and position errors of drives along a path."""
    said = f"Drives at {curves.name}"
    drawn = [_draw_drives(curves.deviation.times, curves, 0.0)]
    return svg.picture(
        drawn, identity=identity, kind="sticks", width=TIMES_WIDTH, height=DRIVES_HEIGHT, label=said
    )


def _draw_drives(times: FloatArray, curves: TransientCurves | PathCurves, top: float) -> Markup:
    """A panel for the torques of motors, and one for position errors."""
    parts = []
    for label, values in (
        ("Torque of motors [N m]", curves.torques),
        ("Position error [µm]", 1e6 * curves.position_errors),
    ):
        lines = [
            (name, values[:, number], TIMES_COLORS[number % len(TIMES_COLORS)])
            for number, name in enumerate(curves.drives)
        ]
        parts.append(_draw_field(times, lines, label, top, DRIVE_HEIGHT))
        top += 0.5 * DRIVES_HEIGHT
    return Markup("").join(parts)


def _draw_field(
    times: FloatArray,
    lines: list[tuple[str, FloatArray, str]],
    label: str,
    top: float,
    height: float,
) -> Markup:
    milliseconds = 1e3 * times
    across = (0.0, float(milliseconds[-1]))
    up = show_range([values for _, values, _ in lines])
    panel = Panel(
        TIMES_LEFT, top + TIMES_TITLE, TIMES_WIDTH - TIMES_LEFT - TIMES_RIGHT, height, across, up
    )
    parts = [svg.heading(TIMES_LEFT, panel.y - 10, label), draw_panel_axes(panel, "ms", "")]
    for number, (name, values, color) in enumerate(lines):
        parts.append(draw_curve(panel, milliseconds, values, color, 1.3))
        if name:
            place = TIMES_WIDTH - TIMES_RIGHT - 90 * (len(lines) - number - 1)
            parts.append(svg.text(place, panel.y - 10, name, anchor="end", size=10.5, color=color))
    return Markup("").join(parts)
