"""Compliance budgets, natural frequencies and responses as images, and what all charts share:
figures, axes, legends, PNG files.
"""

import io
import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np

from headstock.app.pictures.libraries import (
    Artist,
    Axes,
    Axis,
    Figure,
    FigureCanvasAgg,
    FuncFormatter,
    NullFormatter,
    NullLocator,
)
from headstock.app.tables.static import sort_shares, static_by_pose
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
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.answers.modal import ModesSummary
from headstock.pipeline.results.files import open_results, read_summary
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.results.views import COLORS, component_colors
from headstock.solvers.second_order import Channel, ComplexArray

DPI = 130
BARS_SHOWN, MOST_TICKS = 8, 7
OVERLAYS_ACROSS = 3
JOINT_COLOR = "#94a3b8"
INK, FAINT = "#1f2937", "#cbd5e1"
# in a decade, and every how many decades
TICK_STEPS = (
    ((1.0, 1.5, 2.0, 3.0, 5.0, 7.0), 1),
    ((1.0, 2.0, 5.0), 1),
    *(((1.0,), stride) for stride in (1, 2, 3)),
)
# of the labels of ticks, whose figures are wider than letters are on average; of a panel beside its y labels
TICK_INCHES, LEAST_GAP, PANEL_SHARE = 0.085, 1.5, 0.85
LETTER_INCHES, LINE_INCHES, HANDLE_INCHES = 0.066, 0.17, 0.55  # of a legend at 8 points
DASHES = ("-", "--", ":", "-.")
CURVE, DIRECT = "#4f7cac", "#b5566e"


def draw_folder(folder: Path) -> dict[str, bytes]:
    """Every chart of a folder of results: name to a PNG file."""
    results = open_results(folder)
    charts = draw_summary(read_summary(folder), component_colors(results.view))
    return charts | draw_responses([response.curves for response in results.frf.values()])


def draw_summary(summary: RunSummary, colors: dict[str, str]) -> dict[str, bytes]:
    """Every chart of a summary: name to a PNG file.

    Args:
        summary: Content of ``summary.json``.
    """
    found = {}
    for pose, points in static_by_pose(summary).items():
        for name, point in points.items():
            found[f"budget_{file_stem(pose)}_{file_stem(name)}"] = _draw_budget(
                point["budget"], colors
            )
    if any(modes["frequencies_hz"] for modes in summary["modal"]):
        found["frequencies"] = _draw_frequencies(summary["modal"])
    return found


def _draw_budget(budget: dict[str, dict[str, float]], colors: dict[str, str]) -> bytes:
    figure = new_figure(10.0, 3.2)
    for number, (direction, shares) in enumerate(budget.items()):
        axes = figure.add_subplot(1, len(budget), number + 1)
        rows = sort_shares(shares)[:BARS_SHOWN][::-1]
        axes.barh(
            [name for name, _ in rows],
            [100 * share for _, share in rows],
            color=[colors.get(n, JOINT_COLOR) for n, _ in rows],
        )
        axes.set_title(
            f"{direction}: share of the compliance [%]", fontsize=9, color=INK, loc="left"
        )
        calm_axes(axes)
    return encode_figure(figure)


def _draw_frequencies(modal: Sequence[ModesSummary]) -> bytes:
    figure = new_figure(10.0, 0.9 + 0.55 * len(modal))
    axes = figure.add_subplot()
    for row, modes in enumerate(modal):
        elastic = modes["frequencies_hz"][modes["rigid_count"] :]
        axes.vlines(elastic, row - 0.32, row + 0.32, color="#4f7cac", linewidth=1.8)
    axes.set_yticks(range(len(modal)), [modes["pose_name"] for modes in modal])
    axes.set_ylim(len(modal) - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("natural frequency [Hz]", fontsize=9, color=INK)
    calm_axes(axes)
    return encode_figure(figure)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], whose panels make space for what is written around
    them.
    """
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")


def add_legend(figure: Figure, handles: Sequence[Artist], labels: Sequence[str]) -> None:
    """A legend below the panels, whole: as many columns as fit, long labels over several lines, and
    a figure as much higher.

    Args:
        handles: What the labels stand beside.
    """
    if not labels:
        return
    wide, high = figure.get_size_inches()
    shown = [
        "\n".join(textwrap.wrap(label, max(20, int(wide / LETTER_INCHES) - 8))) for label in labels
    ]
    longest = max(len(line) for label in shown for line in label.split("\n"))
    columns = max(1, min(6, len(shown), int(wide / (LETTER_INCHES * longest + HANDLE_INCHES))))
    rows = -(-len(shown) // columns) * max(label.count("\n") + 1 for label in shown)
    figure.set_size_inches(wide, high + LINE_INCHES * rows)
    figure.legend(
        handles, shown, loc="outside lower center", ncols=columns, fontsize=8, frameon=False
    )


class _LineStyle(TypedDict):
    """What lines are distinguished by."""

    color: str
    linestyle: str


def line_style(number: int, colors: Sequence[str]) -> _LineStyle:
    """Colour and dashes of the line of this number: dashes change where colours begin again."""
    return {
        "color": colors[number % len(colors)],
        "linestyle": DASHES[(number // len(colors)) % len(DASHES)],
    }


def calm_axes(axes: Axes, *, grid: Literal["x", "y", "both"] = "x") -> None:
    """Leave only what is read: no frame, a faint grid across an axis."""
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(FAINT)
    axes.tick_params(labelsize=8, colors=INK, length=0)
    axes.grid(axis=grid, color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)


def _choose_ticks(low: float, high: float, letters: float = math.inf) -> list[float]:
    """Round numbers from low to high for a logarithmic axis: whole decades, or some of them, where more
    would be many or touch.

    Args:
        letters: As many as it has room for.
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for steps, stride in TICK_STEPS:
        powers = range(first, last + 1, stride)
        every = [step * 10.0**power for power in powers for step in steps]
        ticks = [tick for tick in every if low <= tick <= high]
        if len(ticks) <= MOST_TICKS and _have_room(ticks, letters / math.log(high / low)):
            break
    return ticks


def _have_room(ticks: Sequence[float], letters: float) -> bool:
    """Whether the labels of ticks stay apart, with so many letters per unit of their logarithm."""
    return all(
        letters * math.log(after / before)
        >= LEAST_GAP + 0.5 * len(_show_round(before) + _show_round(after))
        for before, after in itertools.pairwise(ticks)
    )


def _show_round(value: float) -> str:
    """A round number with its thousands apart."""
    return f"{value:,.10g}".replace(",", " ")


def label_decades(axes: Axes) -> None:
    """Round numbers at a logarithmic x axis, some between the decades where these are few."""
    low, high = axes.get_xlim()
    figure, place = axes.get_figure(root=True), axes.get_subplotspec()
    columns = place.get_gridspec().ncols if place is not None else 1
    width = PANEL_SHARE * figure.get_figwidth() / columns if figure is not None else math.inf
    ticks = _choose_ticks(low, high, width / TICK_INCHES)
    axes.set_xticks(ticks, [_show_round(tick) for tick in ticks])
    axes.set_xlim(low, high)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", length=0)


def label_shares(axes: Axes) -> None:
    """Round per cents at a logarithmic y axis of shares."""
    low, high = axes.get_ylim()
    axes.set_yticks(_choose_ticks(low, high))
    axes.set_ylim(low, high)
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100.0 * value:g} %"))


def encode_figure(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    canvas: Any = FigureCanvasAgg(figure)
    file = io.BytesIO()
    canvas.print_png(file)
    return file.getvalue()


def draw_responses(responses: Sequence[ResponseCurves]) -> dict[str, bytes]:
    """A grid of Bode plots per pose, and one of all poses: name to a PNG file."""
    drawn = {f"frf_{file_stem(curves.pose)}": _draw_grid([curves]) for curves in responses}
    together = overlaid_responses({curves.pose: curves for curves in responses})
    return drawn | ({"frf_all_poses": _draw_grid(together)} if together else {})


def draw_models(
    responses: Mapping[str, ResponseCurves], entries: Sequence[tuple[Channel, Channel]]
) -> bytes:
    """Bode plots of several models over each other, as a PNG file.

    Args:
        responses: Name of the model to its curves; the same inputs and outputs.
        entries: Output and input of each plot.
    """
    known = list(responses.values())
    first, across = known[0], min(OVERLAYS_ACROSS, len(entries))
    down = -(-len(entries) // across)
    figure = new_figure(1.5 + 3.4 * across, 0.8 + 3.0 * down)
    grid = figure.add_gridspec(2 * down, across, height_ratios=[3.0, 1.0] * down)
    for number, (output, given) in enumerate(entries):
        row, column = divmod(number, across)
        upper = figure.add_subplot(grid[2 * row, column])
        lower = figure.add_subplot(grid[2 * row + 1, column])
        place = (first.outputs.index(output), first.inputs.index(given))
        values = [curves.values[:, *place] for curves in known]
        unit, factor = response_unit(first.motion, output, given)
        _draw_magnitude(upper, known, [factor * np.abs(value) for value in values], COLORS)
        _draw_phase(lower, known, values, COLORS)
        # what lies over another curve is thinner, so that both are seen
        for axes in (upper, lower):
            for above, line in enumerate(reversed(axes.get_lines()[: len(known)])):
                line.set_linewidth(1.2 + above)
        upper.set_title(f"{name_entry(output, given)} [{unit}]", fontsize=9, color=INK, loc="left")
        lower.set_xlabel("frequency [Hz]", fontsize=9, color=INK)
    add_legend(figure, figure.axes[0].get_lines()[: len(known)], list(responses))
    return encode_figure(figure)


def _draw_grid(responses: Sequence[ResponseCurves]) -> bytes:
    curves = responses[0]
    outputs, inputs = curves.outputs[:MOST_FIELDS], curves.inputs[:MOST_FIELDS]
    figure = new_figure(1.5 + 3.4 * len(inputs), 0.8 + 2.7 * len(outputs))
    grid = figure.add_gridspec(
        2 * len(outputs), len(inputs), height_ratios=[3.0, 1.0] * len(outputs)
    )
    values = [each.values for each in responses]
    for row, output in enumerate(outputs):
        for column, given in enumerate(inputs):
            upper, lower = (
                figure.add_subplot(grid[2 * row, column]),
                figure.add_subplot(grid[2 * row + 1, column]),
            )
            unit, factor = response_unit(curves.motion, output, given)
            own = [DIRECT if output == given else CURVE] if len(responses) == 1 else COLORS
            sizes = [factor * np.abs(value[:, row, column]) for value in values]
            _draw_magnitude(upper, responses, sizes, own)
            upper.set_title(
                f"{name_entry(output, given)} [{unit}]", fontsize=9, color=INK, loc="left"
            )
            _draw_phase(lower, responses, [value[:, row, column] for value in values], own)
            if row == len(outputs) - 1:
                lower.set_xlabel("frequency [Hz]", fontsize=9, color=INK)
    if len(responses) > 1:
        add_legend(
            figure,
            figure.axes[0].get_lines()[: len(responses)],
            [f"pose {each.pose}" for each in responses],
        )
    return encode_figure(figure)


def _draw_magnitude(
    axes: Axes,
    responses: Sequence[ResponseCurves],
    sizes: Sequence[FloatArray],
    colors: Sequence[str],
) -> None:
    for curves, size, color in zip(responses, sizes, itertools.cycle(colors), strict=False):
        axes.semilogy(
            curves.frequencies_hz, np.where(size > 0.0, size, np.nan), color=color, linewidth=1.2
        )
    low, high = magnitude_range(np.concatenate(sizes))
    axes.set_ylim(low, high)
    _set_ticks(axes.yaxis, round_ticks(low, high))
    axes.tick_params(labelbottom=False)
    _frame(axes, responses)


def _draw_phase(
    axes: Axes,
    responses: Sequence[ResponseCurves],
    values: Sequence[ComplexArray],
    colors: Sequence[str],
) -> None:
    for curves, value, color in zip(responses, values, itertools.cycle(colors), strict=False):
        axes.plot(curves.frequencies_hz, broken_phase(value), color=color, linewidth=1.0)
    axes.set_ylim(-190.0, 190.0)
    axes.set_yticks([-180, 0, 180], ["−180°", "0°", "180°"])
    _frame(axes, responses)


def _set_ticks(axis: Axis, places: Sequence[float]) -> None:
    axis.set_ticks(places, [f"{place:g}" for place in places])
    axis.set_minor_locator(NullLocator())


def _frame(axes: Axes, responses: Sequence[ResponseCurves]) -> None:
    low, high = (
        min(each.frequencies_hz[0] for each in responses),
        max(each.frequencies_hz[-1] for each in responses),
    )
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
