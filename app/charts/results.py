"""Figures of a run: the report's drawings as PNG files. What their SVG says, said to matplotlib."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from markupsafe import Markup

from headstock.app.charts.charts import DPI, INK, encode_figure
from headstock.app.drawings.figures import draw_budget, draw_frequencies
from headstock.app.drawings.frf import draw_overlay, draw_response
from headstock.app.pictures.libraries import Axes, Figure
from headstock.app.tables.static import longest_share
from headstock.app.texts.curves import overlaid_responses
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.views import component_colors

UNITS, POINTS = 96.0, 72.0  # of a drawing, and of widths here, per inch
LETTERS = 0.92  # letters here are wider than a browser's
GAP, TITLE = 16.0, 24.0
ANCHORS = {"start": "left", "middle": "center", "end": "right"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def draw_folder(folder: Path) -> dict[str, bytes]:
    """Every chart of a folder of results: name to a PNG file."""
    results = open_results(folder)
    responses = [response.curves for response in results.frf.values()]
    return _draw_budgets(results, component_colors(results.view)) | _draw_responses(responses)


def _draw_budgets(results: Results, colors: Mapping[str, str]) -> dict[str, bytes]:
    """Budgets of points and natural frequencies: name to a PNG file."""
    found = {}
    for pose, points in results.static.items():
        for name, point in points.items():
            budget = point.budget
            drawn = [
                draw_budget(shares, colors, "budget", longest_share(budget))
                for shares in budget.values()
            ]
            titles = [f"{direction}: share of the compliance" for direction in budget]
            found[f"budget_{file_stem(pose)}_{file_stem(name)}"] = encode_drawings(drawn, titles)
    if any(len(modes.frequencies_hz) for modes in results.modal):
        drawn = [draw_frequencies(results.modal, "frequencies")]
        found["frequencies"] = encode_drawings(drawn, ["natural frequencies [Hz]"])
    return found


def _draw_responses(responses: Sequence[ResponseCurves]) -> dict[str, bytes]:
    """A grid of Bode plots per pose, and one of all poses: name to a PNG file."""
    drawn = {f"frf_{file_stem(curves.pose)}": draw_response(curves, "frf") for curves in responses}
    together = overlaid_responses(responses)
    if together:
        drawn["frf_all_poses"] = draw_overlay(together, "frf")
    return {name: encode_drawings([drawing]) for name, drawing in drawn.items()}


def encode_drawings(drawings: Sequence[Markup], titles: Sequence[str] = ()) -> bytes:
    """Drawings beside each other as one PNG file.

    Args:
        titles: Above each of them; none without it.
    """
    # what follows a drawing is for the scripts of a page
    trees = [
        ElementTree.fromstring(f"{drawing}".partition("</svg>")[0] + "</svg>")
        for drawing in drawings
    ]
    sizes = np.array([_numbers(tree.get("viewBox", ""))[2:] for tree in trees])
    lefts = np.cumsum([GAP, *(sizes[:-1, 0] + GAP)])
    top = GAP + (TITLE if titles else 0.0)
    wide, high = lefts[-1] + sizes[-1, 0] + GAP, top + sizes[:, 1].max() + GAP
    figure = Figure(figsize=(wide / UNITS, high / UNITS), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set(xlim=(0.0, wide), ylim=(high, 0.0))
    for left, title in zip(lefts, titles, strict=False):
        _write(axes, np.array([left, GAP + 8.0]), title, 12.0)
    for left, tree in zip(lefts, trees, strict=True):
        for element in tree:
            _draw(axes, element, np.array([left, top]))
    return encode_figure(figure)


def _draw(axes: Axes, element: "ElementTree.Element[str]", corner: FloatArray) -> None:
    """A line, field or text at its place in a drawing whose corner is here."""
    found: dict[str, str] = dict(element.items())

    def point(x: str, y: str) -> FloatArray:
        return np.add(corner, [float(found.get(x, 0.0)), float(found.get(y, 0.0))])

    look: dict[str, Any] = {"alpha": float(found.get("opacity", 1.0))}
    lines: list[FloatArray] = []
    match element.tag:
        case "text":
            look |= {
                "ha": ANCHORS[found.get("text-anchor", "start")],
                "weight": found.get("font-weight"),
            }
            look["color"] = _color(found["fill"])
            _write(axes, point("x", "y"), element.text or "", float(found["font-size"]), **look)
        case "line":
            lines = [np.stack([point("x1", "y1"), point("x2", "y2")])]
        case "rect":
            low, size = point("x", "y"), (float(found["width"]), float(found["height"]))
            lines = [low + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size]
        case "polyline" | "polygon":
            lines = [corner + _numbers(found["points"]).reshape(-1, 2)]
        case "path":
            lines = [corner + _numbers(part).reshape(-1, 2) for part in found["d"].split("M")[1:]]
    filled = found.get("fill", "none") != "none"
    for places in lines:
        if filled:
            axes.fill(*places.T, color=_color(found["fill"]), linewidth=0.0, **look)
        else:
            width = float(found.get("stroke-width", 1.0)) * POINTS / UNITS
            axes.plot(*places.T, color=_color(found["stroke"]), linewidth=width, **look)


def _write(axes: Axes, place: FloatArray, words: str, size: float, **look: Any) -> None:
    points = LETTERS * size * POINTS / UNITS
    axes.text(
        place[0], place[1], words, fontsize=points, parse_math=False, **({"color": INK} | look)
    )


def _color(color: str) -> str:
    return INK if color == "currentColor" else color


def _numbers(text: str) -> FloatArray:
    return np.array(NUMBER.findall(text), dtype=float)
