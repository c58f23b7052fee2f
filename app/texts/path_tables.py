"""Deviations from a path as plain rows, and the few points of a curve that a plot can show."""

import itertools

import numpy as np

from headstock.app.texts.tables import PlainTable
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.path import PathCurves, deviation_unit
from headstock.solvers.system_ports import name_port

PART_NAMES = {"total": "deviation", "quasi_static": "quasi-static", "sway": "sway", "dynamic": "ringing"}


def path_stem(curves: PathCurves) -> str:
    """Name of a feed's files: ``path_3000``."""
    return f"path_{6e4 * curves.feed:g}".replace(".", "_").replace("+", "")


def tabulate_path(curves: PathCurves) -> PlainTable:
    """A row per sample: time, set point, and the deviation of every output with its parts."""
    found = curves.deviation
    headings = ["time [s]", "position [mm]", "acceleration [m/s^2]"]
    columns = [found.times, 1e3 * curves.positions, curves.accelerations]
    for number, port in enumerate(curves.outputs):
        unit, factor = deviation_unit(port)
        for part, words in PART_NAMES.items():
            headings.append(f"{words} {name_port(port)} [{unit}]")
            columns.append(factor * getattr(found, part)[:, number])
        headings.append(f"deviation in the pose of the middle {name_port(port)} [{unit}]")
        columns.append(factor * curves.frozen[:, number])
    return PlainTable(
        path_stem(curves), tuple(headings), tuple(tuple(float(value) for value in row) for row in np.column_stack(columns))
    )


def thin_curve(x: FloatArray, y: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest point of each of so many stretches, in order: what a plot of that width shows of a curve."""
    if len(x) <= 2 * bins:
        return x, y
    edges = np.linspace(0, len(x), bins + 1).astype(int)
    kept: list[int] = [0]
    for begin, end in itertools.pairwise(edges):
        kept += sorted({begin + int(np.argmin(y[begin:end])), begin + int(np.argmax(y[begin:end]))})
    kept.append(len(x) - 1)
    places = np.unique(kept)
    return x[places], y[places]
