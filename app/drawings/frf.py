"""Frequency responses in the report: a grid of Bode plots as SVG, and what its cursor reads."""

import dataclasses
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.app.drawings.markup import script_json
from headstock.app.texts.bounded_values import raise_digits
from headstock.app.texts.curves import (
    MOST_FIELDS,
    broken_phase,
    even_ticks,
    magnitude_range,
    name_entry,
    response_unit,
    round_ticks,
)
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.answers.probes import MEGA, probe_units
from headstock.pipeline.results.views import COLORS
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.stresses import STRESS_NAMES

PAGE_WIDTH, SMALLEST_CELL, LARGEST_CELL = 1150, 300, 720
LEFT, RIGHT, TITLE, SIZE_HEIGHT, GAP, PHASE_HEIGHT, FOOT = 46, 24, 22, 130, 10, 44, 24
CURVE, DIRECT = "#4f7cac", "#b5566e"
DIGITS = 4
LEAST_PLAIN, MOST_PLAIN = 0.001, 10_000.0  # decades outside are written as powers
LEGEND_STEP = 16.0
BAND = '<path class="band" d="{}Z" fill="{}" opacity="{}" stroke="none"/>'
PATH = '<path d="{}" fill="none" stroke="{}" stroke-width="{}" stroke-linejoin="round"/>'
WIDTH, OVERLAYS_ACROSS = 1.5, 3
FAINT, CLEAR, THIN = 0.25, 0.45, 0.8  # of bands alone and among curves; of curves over others
type _Entry = tuple[Channel, Channel]


@dataclass(frozen=True, eq=False)
class _Cell:
    """One entry and where it is drawn: its upper left corner, its width, and its range of
    magnitudes.
    """

    title: str
    unit: str
    color: str
    size: FloatArray
    phase: FloatArray
    error: FloatArray
    corner: tuple[float, float]
    width: float
    low: float
    high: float

    def size_level(self, value: FloatArray) -> FloatArray:
        """Height ``y`` of magnitudes, zero and less at the foot."""
        share = np.log(np.maximum(value, self.low) / self.low) / math.log(self.high / self.low)
        return self.corner[1] + TITLE + SIZE_HEIGHT * (1.0 - share)

    def phase_level(self, value: FloatArray) -> FloatArray:
        """Height ``y`` of phases in degrees."""
        return self.corner[1] + TITLE + SIZE_HEIGHT + GAP + PHASE_HEIGHT * (180.0 - value) / 360.0


def draw_response(curves: ResponseCurves, identity: str) -> Markup:
    """The Bode plots of a pose as one SVG, with the numbers behind it for the cursor."""
    return _draw_grid(curves, *_lay_out(curves), identity)


def draw_probes(curves: ResponseCurves, identity: str) -> Markup:
    """Largest equivalent stress over a cycle at every probe of a pose, under every load, over the
    phase of its largest component; one SVG with the numbers behind it for the cursor.
    """
    return _draw_grid(curves, *_lay_out_probes(curves), identity)


def _draw_grid(curves: ResponseCurves, cells: list[_Cell], columns: int, identity: str) -> Markup:
    width, height = _size(cells, columns)
    parts = [_draw_cell(curves, cell) for cell in cells]
    parts.append(Markup('<g class="cursor" visibility="hidden"></g>'))
    script = Markup(
        '<script type="application/json" class="response-data" data-for="{}">{}</script>'
    )
    return _picture(parts, identity, width, height) + script.format(
        identity, Markup(script_json(_cursor_data(curves, cells)))
    )


def draw_overlay(
    responses: Sequence[ResponseCurves],
    identity: str,
    names: Sequence[str] = (),
    entries: Sequence[_Entry] = (),
) -> Markup:
    """The Bode plots of several poses, or models, over each other, a colour for each.

    Args:
        identity: ``id`` in the page.
        names: Of the curves; their poses without it.
        entries: Output and input of each plot; all of them without it.
    """
    laid_out = [_lay_out(curves, entries) for curves in responses]
    layouts, columns = [cells for cells, _ in laid_out], laid_out[0][1]
    widest = dataclasses.replace(
        responses[0],
        frequencies_hz=np.array(
            [
                min(c.frequencies_hz[0] for c in responses),
                max(c.frequencies_hz[-1] for c in responses),
            ]
        ),
    )
    parts = []
    for place, frame in enumerate(layouts[0]):
        same = [layout[place] for layout in layouts]
        low, high = magnitude_range(np.concatenate([cell.size for cell in same]))
        parts.append(_draw_frame(widest, dataclasses.replace(frame, low=low, high=high)))
        for number, (curves, cell) in enumerate(zip(responses, same, strict=True)):
            own = dataclasses.replace(cell, low=low, high=high, color=COLORS[number % len(COLORS)])
            # what lies over another curve is thinner, so that both and a band of a few percent are seen
            width = THIN + 1.2 * (len(responses) - 1 - number) if names else WIDTH
            along = _places(widest, own, curves.frequencies_hz)
            if names:
                parts.append(_draw_band(own, along, CLEAR))
            parts.append(_draw_curves(own, along, width))
    width, height = _size(layouts[0], columns)
    for number, name in enumerate(names or [f"pose {curves.pose}" for curves in responses]):
        y = height + LEGEND_STEP * number + 12.0
        parts.append(
            Markup('<rect x="{}" y="{:.0f}" width="18" height="3" fill="{}"/>').format(
                LEFT, y - 5.0, COLORS[number % len(COLORS)]
            )
        )
        parts.append(_text(LEFT + 24, y, name))
    height += LEGEND_STEP * len(responses) + 6.0
    return _picture(parts, identity, width, height)


def _size(cells: Sequence[_Cell], columns: int) -> tuple[float, float]:
    return columns * cells[0].width, _cell_height() * -(-len(cells) // columns)


def _picture(parts: Sequence[Markup], identity: str, width: float, height: float) -> Markup:
    widest = max(width, 0.6 * PAGE_WIDTH)
    return svg.picture(
        parts, identity=identity, kind="response", width=width, height=height, widest=widest
    )


def _lay_out_probes(curves: ResponseCurves) -> tuple[list[_Cell], int]:
    probes, inputs = curves.probes[:MOST_FIELDS], curves.inputs[:MOST_FIELDS]
    cells = []
    for place, (probe, (column, given)) in enumerate(itertools.product(probes, enumerate(inputs))):
        unit, _, per = probe_units(given)
        largest = int(np.nanargmax(np.nanmax(np.abs(probe.stress[:, :, column]), axis=0)))
        title = f"{probe.name} / {name_channel(given)}, phase of {STRESS_NAMES[largest]}"
        phase = broken_phase(probe.stress[:, largest, column])
        error = None if probe.von_mises_error is None else probe.von_mises_error[:, column]
        size = probe.von_mises[:, column]
        cells.append(
            _make_cell(
                title,
                unit,
                CURVE,
                size,
                phase,
                error,
                factor=per * MEGA,
                number=place,
                columns=len(inputs),
            )
        )
    return cells, len(inputs)


def has_more_fields(curves: ResponseCurves) -> bool:
    """Tell whether some entries are not drawn."""
    return max(len(curves.outputs), len(curves.inputs)) > MOST_FIELDS


def _lay_out(curves: ResponseCurves, entries: Sequence[_Entry] = ()) -> tuple[list[_Cell], int]:
    """The plots of these entries, or of as many as can be read in a grid of outputs and inputs; and
    how many are beside each other.
    """
    outputs, inputs = curves.outputs[:MOST_FIELDS], curves.inputs[:MOST_FIELDS]
    columns = min(OVERLAYS_ACROSS, len(entries)) or len(inputs)
    cells = []
    for number, (output, given) in enumerate(entries or itertools.product(outputs, inputs)):
        place = (..., curves.outputs.index(output), curves.inputs.index(given))
        value = curves.values[place]
        error = None if curves.value_errors is None else curves.value_errors[place]
        unit, factor = response_unit(curves.motion, output, given)
        cells.append(
            _make_cell(
                name_entry(output, given),
                unit,
                DIRECT if output == given else CURVE,
                np.abs(value),
                broken_phase(value),
                error,
                factor=factor,
                number=number,
                columns=columns,
            )
        )
    return cells, columns


def _make_cell(
    title: str,
    unit: str,
    color: str,
    size: FloatArray,
    phase: FloatArray,
    error: FloatArray | None,
    *,
    factor: float,
    number: int,
    columns: int,
) -> _Cell:
    """A plot of magnitudes and phases.

    Args:
        size: ``(n,)`` magnitudes in SI.
        error: Of the magnitudes; None where there is none.
        number: Place of the plot in its page, row by row from 0.
        columns: Plots beside each other.
    """
    size = np.asarray(factor * size, dtype=float)
    own = np.full(size.shape, np.nan) if error is None else np.asarray(factor * error, dtype=float)
    width = min(LARGEST_CELL, max(SMALLEST_CELL, PAGE_WIDTH / columns))
    corner = (number % columns * width, number // columns * _cell_height())
    return _Cell(title, unit, color, size, phase, own, corner, width, *magnitude_range(size))


def _cell_height() -> float:
    return TITLE + SIZE_HEIGHT + GAP + PHASE_HEIGHT + FOOT


def _places(curves: ResponseCurves, cell: _Cell, frequencies: FloatArray) -> FloatArray:
    """Where frequencies stand on a cell's axis."""
    f = np.log(frequencies) if curves.spacing == "log" else frequencies
    ends = curves.frequencies_hz[[0, -1]]
    low, high = np.log(ends) if curves.spacing == "log" else ends
    return np.asarray(
        cell.corner[0] + LEFT + (cell.width - LEFT - RIGHT) * (f - low) / (high - low)
    )


def _draw_cell(curves: ResponseCurves, cell: _Cell) -> Markup:
    along = _places(curves, cell, curves.frequencies_hz)
    return _draw_frame(curves, cell) + _draw_band(cell, along) + _draw_curves(cell, along)


def _draw_curves(cell: _Cell, along: FloatArray, width: float = WIDTH) -> Markup:
    levels = ((cell.size_level, cell.size), (cell.phase_level, cell.phase))
    return Markup("").join(
        Markup(PATH).format(_path(along, level(values), np.isfinite(values)), cell.color, width)
        for level, values in levels
    )


def _draw_frame(curves: ResponseCurves, cell: _Cell) -> Markup:
    left, top = float(cell.corner[0] + LEFT), float(cell.corner[1] + TITLE)
    right, middle = float(cell.corner[0] + cell.width - RIGHT), top + SIZE_HEIGHT
    low = middle + GAP + PHASE_HEIGHT
    parts = [svg.heading(left, top - 8, f"{cell.title}  [{cell.unit}]")]
    for value in round_ticks(cell.low, cell.high):
        y = float(cell.size_level(np.array(value)))
        parts += [
            svg.line(left, y, right, y, opacity=0.13),
            _text(left - 5, y + 3.5, _name_tick(value), anchor="end"),
        ]
    for angle, label in ((180.0, "180°"), (0.0, "0°"), (-180.0, "−180°")):
        y = float(cell.phase_level(np.array(angle)))
        parts += [
            svg.line(left, y, right, y, opacity=0.13),
            _text(left - 5, y + 3.5, label, anchor="end"),
        ]
    begin, end = float(curves.frequencies_hz[0]), float(curves.frequencies_hz[-1])
    ticks = round_ticks(begin, end) if curves.spacing == "log" else even_ticks(begin, end, 5)
    for frequency in ticks:
        x = float(_places(curves, cell, np.array(frequency)))
        words = f"{frequency:g}{' Hz' if frequency == ticks[-1] else ''}"
        parts += [
            svg.line(x, top, x, low, opacity=0.13),
            _text(x, low + 13, words, anchor="middle"),
        ]
    return Markup("").join(parts)


def _draw_band(cell: _Cell, along: FloatArray, opacity: float = FAINT) -> Markup:
    """Where the magnitude may lie by its error, as far as there is a bound."""
    known = np.isfinite(cell.error) & np.isfinite(cell.size)
    if np.count_nonzero(known) < 2:
        return Markup("")
    x, size, error = along[known], cell.size[known], cell.error[known]
    upper = cell.size_level(np.minimum(size + error, cell.high))
    lower = cell.size_level(size - error)
    outline = np.concatenate([upper, lower[::-1]])
    path = _path(np.concatenate([x, x[::-1]]), outline, np.ones(len(outline), dtype=bool))
    return Markup(BAND).format(path, cell.color, opacity)


def _text(x: float, y: float, words: str, *, anchor: str = "start") -> Markup:
    return svg.text(x, y, words, anchor=anchor, size=10.5, opacity=0.75)


def _path(x: FloatArray, y: FloatArray, known: np.ndarray) -> str:  # type: ignore[type-arg]
    """Path through the known points, broken at the others."""
    words, down = [], False
    for place, level, good in zip(x, y, known, strict=True):
        if good:
            words.append(f"{'L' if down else 'M'}{place:.1f} {level:.1f}")
        down = bool(good)
    return "".join(words)


def _name_tick(value: float) -> str:
    power = round(math.log10(value))
    if math.isclose(value, 10.0**power, rel_tol=1e-9) and not LEAST_PLAIN <= value <= MOST_PLAIN:
        return f"10{raise_digits(power)}"
    return f"{value:g}"


def _cursor_data(curves: ResponseCurves, cells: list[_Cell]) -> dict[str, object]:
    """Rounded curves, and the boxes in which they are drawn."""
    return {
        "hz": _rounded(curves.frequencies_hz),
        "log": curves.spacing == "log",
        "heights": [TITLE, SIZE_HEIGHT, GAP, PHASE_HEIGHT],
        "cells": [
            {
                "box": [cell.corner[0], cell.corner[1], cell.width],
                "axis": [cell.corner[0] + LEFT, cell.corner[0] + cell.width - RIGHT],
                "range": [cell.low, cell.high],
                "unit": cell.unit,
                "color": cell.color,
                "size": _rounded(cell.size),
                "phase": _rounded(cell.phase),
            }
            for cell in cells
        ],
    }


def _rounded(values: FloatArray) -> list[float | None]:
    return [json.loads(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values]
