"""A measured machine beside its model as figures: MAC, cross-orthogonality, FDAC, responses."""

import numpy as np

from headstock.app.charts.charts import (
    INK,
    add_scale,
    draw_matrix,
    encode_figure,
    label_axes,
    new_figure,
)
from headstock.app.charts.results import encode_drawings
from headstock.app.drawings.frf import draw_overlay
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.correlation.responses import ComparedResponses

LARGEST_CELL, PANEL_WIDTH = 0.3, 9.0  # inches


def draw_correlation(found: Correlation) -> dict[str, bytes]:
    """Return figure name to a PNG file; no figure for what was not compared."""
    figures = {}
    if found.mac.size:
        figures["mac"] = _draw_shapes(found)
    responses = found.responses
    if responses is not None:
        figures["fdac"] = _draw_domain(responses)
        if responses.shown:
            curves = [responses.measured, responses.computed]
            drawn = draw_overlay(
                curves, "test", ["measured", "computed, with its ±"], responses.shown
            )
            figures["responses"] = encode_drawings([drawn])
    return figures


def _draw_shapes(found: Correlation) -> bytes:
    """Draw the MAC, and the cross-orthogonality where there is one."""
    tables = {"MAC": found.mac, "cross-orthogonality": found.orthogonality}
    shown = {name: table for name, table in tables.items() if table is not None}
    rows, columns = found.mac.shape
    cell = min(LARGEST_CELL, PANEL_WIDTH / (len(shown) * max(columns, 6)))
    figure = new_figure(
        max(5.0, len(shown) * cell * max(columns, 6) + 1.6), max(cell * rows, 1.2) + 1.1
    )
    for number, (name, table) in enumerate(shown.items(), 1):
        axes = figure.add_subplot(1, len(shown), number)
        draw_matrix(axes, table, cell)
        label_axes(axes, x="computed mode", y="measured mode", title=name)
    add_scale(figure, " and ".join(shown))
    return encode_figure(figure)


def _draw_domain(responses: ComparedResponses) -> bytes:
    figure = new_figure(5.6, 4.6)
    axes = figure.add_subplot()
    low, high = float(responses.fdac_hz[0]), float(responses.fdac_hz[-1])
    axes.imshow(
        np.nan_to_num(responses.fdac),
        cmap="RdBu_r",
        vmin=-1.0,
        vmax=1.0,
        origin="lower",
        extent=(low, high, low, high),
        aspect="equal",
    )
    axes.plot([low, high], [low, high], color=INK, linewidth=0.5, linestyle=":")
    label_axes(axes, x="computed [Hz]", y="measured [Hz]")
    axes.tick_params(labelsize=7, colors=INK, length=0)
    add_scale(figure, "FDAC")
    return encode_figure(figure)
