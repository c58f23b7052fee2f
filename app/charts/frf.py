"""Frequency responses as images: magnitude over phase, one field per output and input, by matplotlib."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from headstock.app.charts.charts import FAINT, INK, add_legend, new_figure, read_pixels
from headstock.app.texts.curves import (
    MOST_FIELDS,
    broken_phase,
    magnitude_range,
    name_entry,
    overlaid_responses,
    response_unit,
    round_ticks,
)
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.frf import ResponseCurves
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.views import COLORS
from headstock.solvers.second_order import ComplexArray

CURVE, DIRECT = "#4f7cac", "#b5566e"


def draw_responses(responses: Sequence[ResponseCurves]) -> dict[str, NDArray[np.uint8]]:
    """A grid of Bode plots per pose, and one of all poses: name to ``(height, width, 4)`` pixels."""
    drawn = {f"frf_{file_stem(curves.pose)}": _draw_grid([curves]) for curves in responses}
    together = overlaid_responses({curves.pose: curves for curves in responses})
    return drawn | ({"frf_all_poses": _draw_grid(together)} if together else {})


def _draw_grid(responses: Sequence[ResponseCurves]) -> NDArray[np.uint8]:
    curves = responses[0]
    outputs, inputs = curves.outputs[:MOST_FIELDS], curves.inputs[:MOST_FIELDS]
    figure = new_figure(1.5 + 3.4 * len(inputs), 0.8 + 2.7 * len(outputs))
    grid = figure.add_gridspec(2 * len(outputs), len(inputs), height_ratios=[3.0, 1.0] * len(outputs))
    values = [each.values for each in responses]
    for row, output in enumerate(outputs):
        for column, given in enumerate(inputs):
            upper, lower = figure.add_subplot(grid[2 * row, column]), figure.add_subplot(grid[2 * row + 1, column])
            unit, factor = response_unit(curves.motion, output, given)
            own = [DIRECT if output == given else CURVE] if len(responses) == 1 else COLORS
            sizes = [factor * np.abs(value[:, row, column]) for value in values]
            _draw_magnitude(upper, responses, sizes, own)
            upper.set_title(f"{name_entry(output, given)} [{unit}]", fontsize=9, color=INK, loc="left")
            _draw_phase(lower, responses, [value[:, row, column] for value in values], own)
            if row == len(outputs) - 1:
                lower.set_xlabel("frequency [Hz]", fontsize=9, color=INK)
    if len(responses) > 1:
        add_legend(figure, figure.axes[0].get_lines()[: len(responses)], [f"pose {each.pose}" for each in responses])
    return read_pixels(figure)


def _draw_magnitude(axes: Axes, responses: Sequence[ResponseCurves], sizes: Sequence[FloatArray], colors: Sequence[str]) -> None:
    for curves, size, color in zip(responses, sizes, itertools.cycle(colors), strict=False):
        axes.semilogy(curves.frequencies_hz, np.where(size > 0.0, size, np.nan), color=color, linewidth=1.2)
    low, high = magnitude_range(np.concatenate(sizes))
    axes.set_ylim(low, high)
    _set_ticks(axes.yaxis, round_ticks(low, high))
    axes.tick_params(labelbottom=False)
    _frame(axes, responses)


def _draw_phase(axes: Axes, responses: Sequence[ResponseCurves], values: Sequence[ComplexArray], colors: Sequence[str]) -> None:
    for curves, value, color in zip(responses, values, itertools.cycle(colors), strict=False):
        axes.plot(curves.frequencies_hz, broken_phase(value), color=color, linewidth=1.0)
    axes.set_ylim(-190.0, 190.0)
    axes.set_yticks([-180, 0, 180], ["−180°", "0°", "180°"])
    _frame(axes, responses)


def _set_ticks(axis: Axis, places: Sequence[float]) -> None:
    axis.set_ticks(places, [f"{place:g}" for place in places])
    axis.set_minor_locator(NullLocator())


def _frame(axes: Axes, responses: Sequence[ResponseCurves]) -> None:
    low, high = min(each.frequencies_hz[0] for each in responses), max(each.frequencies_hz[-1] for each in responses)
    axes.set_xscale(responses[0].spacing)
    axes.set_xlim(low, high)
    if responses[0].spacing == "log":
        _set_ticks(axes.xaxis, round_ticks(low, high))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("bottom", "left"):
        axes.spines[side].set_color(FAINT)
    axes.tick_params(labelsize=8, colors=INK, length=0, which="both")
    axes.grid(color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
