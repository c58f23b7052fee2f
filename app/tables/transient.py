"""Rows of loads over time."""

import math

from headstock.app.tables.probes import list_motion_columns
from headstock.app.tables.table import Cell, Column, PlainTable, show_percent, tabulate_curves
from headstock.pipeline.answers.path import (
    deviation_unit,
)
from headstock.pipeline.answers.transient import (
    MovedOutputSummary,
    TransientCurves,
    TransientSummary,
)
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.second_order import name_channel

type MovedRow = tuple[str, MovedOutputSummary]

MOVED_UNITS = {"um": "µm", "urad": "µrad"}


def list_moved(transient: TransientSummary) -> list[MovedRow]:
    """Outputs of a transient analysis by name."""
    return list(transient["outputs"].items())


def _settled(row: MovedRow) -> Cell:
    found = row[1]
    if found["settling_s"] is not None:
        return 1e3 * found["settling_s"]
    return "at rest" if found["peak"] == 0.0 else "never" if found["final"] is None else "later"


def _peak_error(row: MovedRow) -> float | None:
    """NaN where errors were looked at and one of them is not known."""
    found = row[1]
    if not found["peak"]:
        return None
    return math.nan if found["error"] is None and found["error_share"] else found["error"]


MOVED_COLUMNS: tuple[Column[MovedRow], ...] = (
    Column(lambda row: row[0], "at", "at", "At"),
    Column(lambda row: MOVED_UNITS[row[1]["unit"]], "unit", "in", "In"),
    Column(
        lambda row: row[1]["peak"],
        "peak",
        ">peak",
        "Peak",
        error=_peak_error,
    ),
    Column(lambda row: row[1]["error"], "± peak"),
    Column(lambda row: 1e3 * row[1]["peak_s"], "at [ms]", ">at ms", "at [ms]"),
    Column(lambda row: row[1]["start"], "from", report="From"),
    Column(lambda row: row[1]["final"], "final", ">final", "Comes to rest at"),
    Column(
        lambda row: row[1]["overshoot"], "overshoot", ">overshoot", "Overshoot", show=show_percent
    ),
    Column(_settled, "settled after [ms]", ">settled after ms", "Settled after [ms]"),
)


def transient_stem(curves: TransientCurves) -> str:
    """Name of a pose's files: ``transient_reference``."""
    return f"transient_{file_stem(curves.pose)}"


def tabulate_transient(curves: TransientCurves) -> PlainTable:
    """A row per sample: time, every load, the displacement of every output, stress and displacement at probes, and what
    drives under control do.
    """
    columns = [("time [s]", curves.times)]
    for number, (name, unit) in enumerate(zip(curves.loads, curves.units, strict=True)):
        if not unit.endswith(" s"):  # an impulse has no value at a time
            columns.append((f"{name} [{unit}]", curves.load_values[:, number]))
    for number, channel in enumerate(curves.outputs):
        unit, factor = deviation_unit(channel)
        moved = factor * curves.displacements[:, number]
        columns.append((f"{name_channel(channel)} [{unit}]", moved))
    return tabulate_curves(transient_stem(curves), [*columns, *list_motion_columns(curves)])
