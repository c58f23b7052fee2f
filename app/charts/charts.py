"""What all charts share: figures, axes, legends, PNG files."""

import io
import itertools
import math
import textwrap
from collections.abc import Sequence
from typing import Any, Literal, TypedDict

import numpy as np

from headstock.app.pictures.libraries import (
    Artist,
    Axes,
    Figure,
    FigureCanvasAgg,
    FuncFormatter,
    NullFormatter,
)
from headstock.geometry.frames import FloatArray

DPI = 130
MOST_TICKS = 7
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
MATRIX_TICKS = 12
CELL_WITH_NUMBER, LEAST_NUMBER = 0.22, 0.1  # inches; share worth a number


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


def label_axes(axes: Axes, *, x: str = "", y: str = "", title: str = "") -> None:
    """Write titles at the axes of a chart and above it, as all charts have them."""
    look: dict[str, Any] = {"fontsize": 9, "color": INK}
    if x:
        axes.set_xlabel(x, **look)
    if y:
        axes.set_ylabel(y, **look)
    if title:
        axes.set_title(title, loc="left", **look)


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


def draw_matrix(axes: Axes, table: FloatArray, cell: float) -> None:
    """Draw a matrix of shares between modes, numbered from 1: the larger the darker.

    Args:
        table: ``(m, n)``, rows upwards.
        cell: Size of an entry [inch]; large ones hold their numbers.
    """
    axes.imshow(table, cmap="Blues", vmin=0.0, vmax=1.0, origin="lower", aspect="equal")
    for axis, count in ((axes.xaxis, table.shape[1]), (axes.yaxis, table.shape[0])):
        step = max(1, count // MATRIX_TICKS)
        axis.set_ticks(range(0, count, step), [str(i + 1) for i in range(0, count, step)])
    axes.tick_params(labelsize=7, colors=INK, length=0)
    if cell < CELL_WITH_NUMBER:
        return
    for (row, column), value in np.ndenumerate(table):
        if value >= LEAST_NUMBER:
            text = f"{value:.2f}".removeprefix("0")
            color = "white" if value > 0.5 else INK
            axes.text(column, row, text, ha="center", va="center", fontsize=6, color=color)


def add_scale(figure: Figure, label: str) -> None:
    """Add the scale of colours of the last matrix beside all panels."""
    images = [image for axes in figure.axes for image in axes.get_images()]
    if images:
        bar = figure.colorbar(images[-1], ax=figure.axes, shrink=0.8)
        bar.set_label(label, fontsize=9, color=INK)
        bar.ax.tick_params(labelsize=7, colors=INK, length=0)


def encode_figure(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    canvas: Any = FigureCanvasAgg(figure)
    file = io.BytesIO()
    canvas.print_png(file)
    return file.getvalue()
