"""Volumetric errors in the report: error motions along each axis, and the volume as a grid that they
bend.
"""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.drawings.svg import Panel, draw_curve, draw_panel_axes, show_range
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import SCENE_UNITS
from headstock.pipeline.answers.volumetric import MICRO, SYMBOLS, VolumetricAnswer, name_travel
from headstock.solvers.linear.volumetric import AxisMotions, measure_range

WIDTH, LEFT, RIGHT, TITLE, FOOT, HEIGHT, BETWEEN = 1150, 52, 14, 24, 26, 150, 60
COLORS = ("#c0392b", "#2a8f3c", "#2b62d9")
FIELDS = ((0, 3, "µm"), (3, 6, "µrad"))
SOURCE_TITLES = {
    "total": "All together",
    "geometry": "Errors of guides and axes",
    "gravity": "Gravity",
    "static forces": "Static forces",
}
LEAST_RANGE = 1e-3  # [um or urad]: what varies less is not drawn


def draw_motions(found: VolumetricAnswer, identity: str) -> Markup:
    """The six error motions along each axis: translations on the left, rotations on the right.

    Args:
        identity: ``id`` in the page.
    """
    parts, top = [], 0.0
    for line in found.lines:
        parts.append(_draw_line(line, found.axis_units[line.axis], top))
        top += TITLE + HEIGHT + FOOT
    label = "Error motions of the tool along each axis"
    return svg.picture(
        parts, identity=identity, kind="sticks", width=WIDTH, height=top, label=label
    )


def _draw_line(line: AxisMotions, axis_unit: str, top: float) -> Markup:
    factor, unit = SCENE_UNITS[axis_unit]
    places = factor * line.positions
    room = (WIDTH - LEFT - RIGHT - BETWEEN) / 2
    parts = []
    for number, (first, last, amount) in enumerate(FIELDS):
        curves = list(MICRO * line.motions[:, first:last].T)
        panel = Panel(
            LEFT + number * (room + BETWEEN),
            top + TITLE,
            room,
            HEIGHT,
            (float(places[0]), float(places[-1])),
            show_range(curves),
        )
        parts.append(svg.heading(panel.x, panel.y - 10, f"Axis {line.axis} [{amount}]"))
        parts.append(draw_panel_axes(panel, unit, ""))
        for place, (symbol, curve) in enumerate(zip(SYMBOLS[first:last], curves, strict=True)):
            parts.append(draw_curve(panel, places, curve, COLORS[place], 1.5))
            beside = panel.x + panel.width - 55 * (2 - place)
            parts.append(
                svg.text(
                    beside,
                    panel.y - 10,
                    f"{symbol}{line.axis}",
                    anchor="end",
                    size=10.5,
                    color=COLORS[place],
                )
            )
    return Markup("").join(parts)


class _MapChoice(NamedTuple):
    """A quantity to draw as a map, and what it is called."""

    name: str
    title: str


def list_maps(found: VolumetricAnswer) -> dict[str, list[_MapChoice]]:
    """Maps that are drawn, by the heading of what causes them: what varies over the volume."""
    shown: dict[str, list[_MapChoice]] = {}
    for source, values in found.grids.items():
        ranges = MICRO * measure_range(values)
        # one source alone is all there is
        if len(found.grids) == 2 and source != "total":
            continue
        dofs = range(6) if source == "total" else range(3)
        maps = [
            _MapChoice(
                f"{source}_{SYMBOLS[dof]}",
                f"{SYMBOLS[dof]} [{'µm' if dof < 3 else 'µrad'}]",
            )
            for dof in dofs
            if ranges[dof] > LEAST_RANGE
        ]
        if maps:
            shown[SOURCE_TITLES.get(source, source)] = maps
    return shown


GRID_WIDTH, GRID_HEIGHT, GRID_ROOM = 640, 420, 46
GRID_SHARE = 0.06  # of the volume, as which the largest error is drawn
VIEW = np.array([[-0.766, 0.643, 0.0], [-0.278, -0.331, 0.902]])  # from the front, above


def draw_volume(found: VolumetricAnswer, identity: str) -> Markup:
    """The edges and lines of the volume as the tool travels it, errors magnified, over the straight
    ones; empty where the axes of the map are not linear.

    Args:
        identity: ``id`` in the page.
    """
    travelled = _travel_volume(found)
    if travelled is None:
        return Markup("")
    nominal, error = travelled
    shape = nominal.shape[:-1]
    size = float(np.linalg.norm(np.ptp(nominal.reshape(-1, 3), axis=0)))
    largest = float(np.nanmax(np.linalg.norm(error, axis=-1)))
    if not largest > 0.0:
        return Markup("")
    scale = float(f"{GRID_SHARE * size / largest:.1g}")
    flat, bent = nominal @ VIEW.T, (nominal + scale * error) @ VIEW.T
    both = np.concatenate([flat.reshape(-1, 2), bent.reshape(-1, 2)])
    low, high = np.nanmin(both, axis=0), np.nanmax(both, axis=0)
    zoom = min(
        (GRID_WIDTH - 2 * GRID_ROOM) / max(high[0] - low[0], 1e-12),
        (GRID_HEIGHT - 2 * GRID_ROOM) / max(high[1] - low[1], 1e-12),
    )

    def place_points(points: FloatArray) -> FloatArray:
        shifted = (points - 0.5 * (low + high)) * zoom
        return np.stack(
            [GRID_WIDTH / 2 + shifted[..., 0], GRID_HEIGHT / 2 - shifted[..., 1]], axis=-1
        )

    parts = [
        _draw_grid(place_points(flat), "currentColor", 0.8, 0.25),
        _draw_grid(place_points(bent), "#2f6db3", 1.3, 1.0),
        svg.heading(
            4,
            16,
            f"The volume as the tool travels it, errors magnified {scale:,.0f} times".replace(
                ",", "\u202f"
            ),
        ),
    ]
    corner = place_points(flat)[tuple(0 for _ in shape)]
    for place, axis in enumerate(found.axes):
        index = [0] * len(shape)
        index[place] = -1
        end = place_points(flat)[tuple(index)]
        words = end + 16.0 * (end - corner) / max(float(np.linalg.norm(end - corner)), 1.0)
        parts.append(
            svg.text(float(words[0]), float(words[1]) + 4, f"{axis}+", anchor="middle", size=11)
        )
    return svg.picture(
        parts,
        identity=identity,
        kind="sticks",
        width=GRID_WIDTH,
        height=GRID_HEIGHT,
        label="Bent volume",
        widest=760,
    )


def _travel_volume(found: VolumetricAnswer) -> tuple[FloatArray, FloatArray] | None:
    """Return where the tool travels and its error there, ``(..., 3)`` over the grid of positions [m];
    None where the axes of the map are not linear.
    """
    lines = {line.axis: line for line in found.lines}
    alongs = [name_travel(lines[axis]) for axis in found.axes if found.axis_units[axis] == "m"]
    directions = {along[-1] for along in alongs if along is not None}
    if len(directions) != len(found.axes):
        return None
    shape = [len(positions) for positions in found.positions]
    grid = np.meshgrid(*found.positions, indexing="ij")
    nominal = np.zeros((*shape, 3))
    for place, along in enumerate(alongs):
        sign = -1.0 if str(along).startswith("-") else 1.0
        nominal[..., "xyz".index(str(along)[-1])] = sign * grid[place]
    error = found.total[..., :3]
    # the middle stands where it should: what is constant is zeroed when a tool is measured
    error = error - error[tuple(size // 2 for size in shape)]
    return nominal, error


def _draw_grid(points: FloatArray, color: str, width: float, opacity: float) -> Markup:
    """Lines of a grid ``(n0, n1, ..., 2)``: all of a plane, those on the surface of a volume."""
    shape = points.shape[:-1]
    lines = []
    for along in range(len(shape)):
        others = [axis for axis in range(len(shape)) if axis != along]
        for place in np.ndindex(*(shape[axis] for axis in others)):
            edges = [
                number in (0, shape[axis] - 1) for number, axis in zip(place, others, strict=True)
            ]
            if len(shape) == 3 and not any(edges):
                continue
            index: list[int | slice] = [0] * len(shape)
            index[along] = slice(None)
            for number, axis in zip(place, others, strict=True):
                index[axis] = number
            row = points[tuple(index)]
            known = row[np.isfinite(row).all(axis=1)]
            lines.append(svg.polyline(known, color, width, opacity=opacity))
    return Markup("").join(lines)
