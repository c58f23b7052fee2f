"""Frequency responses as images: magnitude over phase, one field per output and input, by matplotlib."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from headstock.app.charts import DPI, FAINT, INK, read_pixels
from headstock.app.frf_tables import MOST_FIELDS, broken_phase, magnitude_range, name_entry, response_unit
from headstock.pipeline.frf_results import ResponseCurves
from headstock.pipeline.mode_files import file_stem

CURVE, DIRECT = "#4f7cac", "#b5566e"


def draw_responses(responses: Sequence[ResponseCurves]) -> dict[str, NDArray[np.uint8]]:
    """A grid of Bode plots per pose: name to ``(height, width, 4)`` pixels."""
    return {f"frf_{file_stem(curves.pose)}": _draw_grid(curves) for curves in responses}


def _draw_grid(curves: ResponseCurves) -> NDArray[np.uint8]:
    outputs, inputs = curves.outputs[:MOST_FIELDS], curves.inputs[:MOST_FIELDS]
    figure = Figure(figsize=(1.5 + 3.4 * len(inputs), 0.8 + 2.7 * len(outputs)), dpi=DPI, layout="constrained")
    grid = figure.add_gridspec(2 * len(outputs), len(inputs), height_ratios=[3.0, 1.0] * len(outputs))
    values = curves.values
    for row, output in enumerate(outputs):
        for column, given in enumerate(inputs):
            upper, lower = figure.add_subplot(grid[2 * row, column]), figure.add_subplot(grid[2 * row + 1, column])
            unit, factor = response_unit(curves.motion, output, given)
            color = DIRECT if output == given else CURVE
            size = factor * np.abs(values[:, row, column])
            _draw_magnitude(upper, curves, size, color)
            upper.set_title(f"{name_entry(output, given)} [{unit}]", fontsize=9, color=INK, loc="left")
            _draw_phase(lower, curves, values[:, row, column], color)
            if row == len(outputs) - 1:
                lower.set_xlabel("frequency [Hz]", fontsize=9, color=INK)
    return read_pixels(figure)


def _draw_magnitude(axes: Axes, curves: ResponseCurves, size: Any, color: str) -> None:
    axes.semilogy(curves.frequencies_hz, np.where(size > 0.0, size, np.nan), color=color, linewidth=1.2)
    axes.set_ylim(*magnitude_range(size))
    axes.tick_params(labelbottom=False)
    _frame(axes, curves)


def _draw_phase(axes: Axes, curves: ResponseCurves, values: Any, color: str) -> None:
    axes.plot(curves.frequencies_hz, broken_phase(values), color=color, linewidth=1.0)
    axes.set_ylim(-190.0, 190.0)
    axes.set_yticks([-180, 0, 180], ["−180°", "0°", "180°"])
    _frame(axes, curves)


def _frame(axes: Axes, curves: ResponseCurves) -> None:
    axes.set_xscale(curves.spacing)
    axes.set_xlim(curves.frequencies_hz[0], curves.frequencies_hz[-1])
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("bottom", "left"):
        axes.spines[side].set_color(FAINT)
    axes.tick_params(labelsize=8, colors=INK, length=0, which="both")
    axes.grid(color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
