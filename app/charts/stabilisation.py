"""The stabilisation diagram of a modal fit as SVG: poles of all orders over frequency, and the modes
that were chosen.
"""

import numpy as np
from markupsafe import Markup

from headstock.app.drawings import svg
from headstock.geometry.frames import FloatArray
from headstock.solvers.modal_fitting.stabilisation import PoleLabel, label_poles
from headstock.studies.correlation.modal_fit import ModalFit

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 1040.0, 420.0, 46.0, 44.0, 28.0, 34.0
CHOSEN, RESPONSE = "#b5566e", "#94a3b8"
DECADES = 5.0  # of the responses that are drawn
# colour, size and meaning, the least first
MARKS = {
    PoleLabel.NEW: ("#cbd5e1", 1.6, "new"),
    PoleLabel.FREQUENCY: ("#d9a441", 1.9, "stable frequency"),
    PoleLabel.DAMPING: ("#4f7cac", 2.2, "and damping"),
    PoleLabel.VECTOR: ("#2f855a", 2.8, "and participation"),
}
DOT = '<circle cx="{:.1f}" cy="{:.1f}" r="{}" fill="{}"/>'
LEGEND_STEP = 150.0
FILE = '<svg xmlns="http://www.w3.org/2000/svg" style="background:#fff;color:#1f2937;font-family:sans-serif" '


def draw_stabilisation(fit: ModalFit) -> str:
    """Return the diagram of modes that were fitted to responses as an SVG file; empty for modes of a
    file.
    """
    if fit.responses is None:
        return ""
    hz = fit.responses.frequencies_hz
    highest = max((step.order for steps in fit.steps for step in steps), default=1)
    panel = svg.Panel(
        LEFT,
        TOP,
        WIDTH - LEFT - RIGHT,
        HEIGHT - TOP - BOTTOM,
        (float(hz[0]), float(hz[-1])),
        (0.0, float(highest + 1)),
    )
    parts = [svg.draw_panel_axes(panel, "Hz", "order")]
    parts.append(svg.draw_curve(panel, hz, _response_level(fit, highest), RESPONSE, 1.2))
    for mode in fit.modes.frequencies_hz:
        x = float(panel.place(mode))
        parts.append(svg.polyline([(x, TOP), (x, TOP + panel.height)], CHOSEN, 1.0, opacity=0.6))
    for label, mark in MARKS.items():
        parts += _draw_marks(fit, panel, label, *mark[:2])
    for number, (color, _, words) in enumerate(MARKS.values()):
        x = LEFT + number * LEGEND_STEP
        parts += [Markup(DOT).format(x, 14.0, 4, color), svg.text(x + 9, 18, words)]
    lines = "line: chosen mode; curve: size of all responses, logarithmic"
    parts.append(svg.text(LEFT + len(MARKS) * LEGEND_STEP, 18, lines))
    drawn = svg.picture(
        parts,
        identity="stabilisation",
        kind="stabilisation",
        width=WIDTH,
        height=HEIGHT,
        label=f"Stabilisation diagram, {len(fit.modes.frequencies_hz)} modes chosen",
    )
    return str(drawn).replace("<svg ", FILE, 1)


def _draw_marks(
    fit: ModalFit, panel: svg.Panel, wanted: PoleLabel, color: str, size: float
) -> list[Markup]:
    """Draw all poles with one label."""
    marks = []
    for steps in fit.steps:
        for step, labels in zip(steps, label_poles(steps), strict=True):
            places = np.abs(step.poles[labels == wanted]) / (2.0 * np.pi)
            inside = places[(places >= panel.across[0]) & (places <= panel.across[1])]
            y = float(panel.level(np.array(float(step.order))))
            marks += [Markup(DOT).format(float(x), y, size, color) for x in panel.place(inside)]
    return marks


def _response_level(fit: ModalFit, highest: int) -> FloatArray:
    """Return the rms of all responses ``(l,)`` as heights, logarithmic."""
    assert fit.responses is not None
    values = np.abs(fit.responses.values)
    sizes = np.sqrt(np.nanmean(values**2, axis=(1, 2)))
    level = np.log10(np.maximum(sizes, np.finfo(float).tiny))
    share = 1.0 + (level - level.max()) / DECADES
    return np.asarray(highest * np.clip(share, 0.0, 1.0))
