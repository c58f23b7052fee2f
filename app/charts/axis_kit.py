"""The figures of Kono et al. of the machine: deviations of its compliances. Loads finite elements."""

from collections.abc import Mapping, Sequence

import numpy as np

from headstock.app.charts.charts import INK, calm_axes, encode_figure, label_axes, new_figure
from headstock.app.pictures.libraries import Axes
from headstock.pipeline.results.views import COLORS
from headstock.validation.machines.axis_kit_cases import (
    CASE,
    FIDELITIES,
    MEASURED_COMPLIANCE,
    VARIANTS,
    compliance_name,
)
from headstock.validation.references.rows import ValidationRow

FIGURE_NAME = "axis_construction_kit_figures_17_18"
TITLES = {
    "segmented": "Figure 17: rigid bodies and segments",
    "elastic": "Figure 18: finite elements",
}
BAR_WIDTH = 0.26


def draw_axis_kit(rows: Sequence[ValidationRow]) -> dict[str, bytes]:
    """Figure name to a PNG file; nothing when the rows hold no such
    compliances.
    """
    found = {row.quantity: row for row in rows if row.case == CASE}
    if compliance_name(VARIANTS[0], FIDELITIES[0], "z") not in found:
        return {}
    figure = new_figure(11.0, 4.6)
    panels = figure.subplots(1, len(FIDELITIES), sharey=True)
    for axes, fidelity in zip(panels, FIDELITIES, strict=True):
        _draw_bars(axes, found, fidelity)
    label_axes(panels[0], y="deviation from the measured compliance [%]")
    panels[-1].legend(fontsize=8, frameon=False, loc="upper left")
    return {FIGURE_NAME: encode_figure(figure)}


def _draw_bars(axes: Axes, found: Mapping[str, ValidationRow], fidelity: str) -> None:
    for number, (axis, measured) in enumerate(MEASURED_COMPLIANCE.items()):
        values = [
            100.0 * found[compliance_name(variant, fidelity, axis)].relative_error
            for variant in VARIANTS
        ]
        places = np.arange(len(VARIANTS)) + (number - 1) * BAR_WIDTH
        axes.bar(
            places,
            values,
            BAR_WIDTH,
            color=COLORS[number],
            label=f"dz/F{axis}, measured {measured:g} µm/kN",
        )
        for place, value in zip(places, values, strict=True):
            offset = (0, 2) if value >= 0.0 else (0, -9)
            text = f"{round(value):+d}" if round(value) else "0"
            axes.annotate(
                text,
                (float(place), value),
                offset,
                textcoords="offset points",
                ha="center",
                fontsize=7,
                color=INK,
            )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_xticks(range(len(VARIANTS)), VARIANTS)
    axes.set_title(TITLES[fidelity], fontsize=10, color=INK, loc="left")
    axes.margins(y=0.12)
    calm_axes(axes, grid="y")
