"""Motion under loads over time in the report: the loads, below them every output, and what drives
under control do.
"""

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.drawings.svg import Panel, draw_curve, draw_panel_axes, show_range
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.path import PathCurves, deviation_unit
from headstock.pipeline.answers.probes import MEGA
from headstock.pipeline.answers.transient import TransientCurves
from headstock.solvers.second_order import name_channel

WIDTH, LEFT, RIGHT, TITLE, FOOT = 1150, 58, 14, 24, 30
LOAD_HEIGHT, OUTPUT_HEIGHT, DRIVE_HEIGHT = 70, 150, 100
DRIVES_HEIGHT = 2 * (TITLE + DRIVE_HEIGHT + FOOT)
COLORS = ("#2f6db3", "#d08a4a", "#6a9a5b", "#8a6bb0", "#b5566e", "#5d8f8f")
UNITS = {"um": "µm", "urad": "µrad"}
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
            top += TITLE + LOAD_HEIGHT + FOOT
    for unit in ("um", "urad"):
        chosen = [
            number
            for number, channel in enumerate(curves.outputs)
            if deviation_unit(channel)[0] == unit
        ]
        moved = 1e6 * curves.displacements[:, chosen]
        sizes = np.abs(moved).max(axis=0, initial=0.0)
        lines = [
            (name_channel(curves.outputs[number]), moved[:, place], COLORS[place % len(COLORS)])
            for place, number in enumerate(chosen)
            if sizes[place] > NEGLIGIBLE * sizes.max()
        ]
        if lines:
            label = f"{'Displacement' if unit == 'um' else 'Rotation'} [{UNITS[unit]}]"
            parts.append(_draw_field(curves.times, lines, label, top, OUTPUT_HEIGHT))
            top += TITLE + OUTPUT_HEIGHT + FOOT
    if curves.probes:
        lines = [
            (probe.name, MEGA * probe.von_mises, COLORS[number % len(COLORS)])
            for number, probe in enumerate(curves.probes)
        ]
        label = "Equivalent stress at probes [MPa]"
        parts.append(_draw_field(curves.times, lines, label, top, DRIVE_HEIGHT))
        top += TITLE + DRIVE_HEIGHT + FOOT
    if curves.drives:
        parts.append(_draw_drives(curves.times, curves, top))
        top += DRIVES_HEIGHT
    said = f"Motion in pose {curves.pose}"
    return svg.picture(parts, identity=identity, kind="sticks", width=WIDTH, height=top, label=said)


def draw_path_drives(curves: PathCurves, identity: str) -> Markup:
    """One SVG: torques and position errors of drives along a path."""
    said = f"Drives at {curves.name}"
    drawn = [_draw_drives(curves.deviation.times, curves, 0.0)]
    return svg.picture(
        drawn, identity=identity, kind="sticks", width=WIDTH, height=DRIVES_HEIGHT, label=said
    )


def _draw_drives(times: FloatArray, curves: TransientCurves | PathCurves, top: float) -> Markup:
    """A panel for the torques of motors, and one for position errors."""
    parts = []
    for label, values in (
        ("Torque of motors [N m]", curves.torques),
        ("Position error [µm]", 1e6 * curves.position_errors),
    ):
        lines = [
            (name, values[:, number], COLORS[number % len(COLORS)])
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
    panel = Panel(LEFT, top + TITLE, WIDTH - LEFT - RIGHT, height, across, up)
    parts = [svg.heading(LEFT, panel.y - 10, label), draw_panel_axes(panel, "ms", "")]
    for number, (name, values, color) in enumerate(lines):
        parts.append(draw_curve(panel, milliseconds, values, color, 1.3))
        if name:
            place = WIDTH - RIGHT - 90 * (len(lines) - number - 1)
            parts.append(svg.text(place, panel.y - 10, name, anchor="end", size=10.5, color=color))
    return Markup("").join(parts)
