"""Motion under loads over time, and what drives, joints and probes take."""

import math
from collections.abc import Iterator

from headstock.app.drawings.path import draw_transient
from headstock.app.tables.probes import (
    FORCE_COLUMNS,
    list_force_tables,
    list_motion_columns,
    tabulate_forces,
)
from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    PlainTable,
    show_percent,
    tabulate,
    tabulate_curves,
)
from headstock.app.texts.bounded_values import transient_words
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.pipeline.answers.path import deviation_unit
from headstock.pipeline.answers.transient import (
    MovedOutputSummary,
    TransientAnswer,
    TransientCurves,
    TransientSummary,
)
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.second_order import name_channel

type MovedRow = tuple[str, MovedOutputSummary]

MOVED_UNITS = {"um": "µm", "urad": "µrad"}


def _list_moved(transient: TransientSummary) -> list[MovedRow]:
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


def _transient_stem(curves: TransientCurves) -> str:
    """Name of a pose's files: ``transient_reference``."""
    return f"transient_{file_stem(curves.pose)}"


def _tabulate_transient(curves: TransientCurves) -> PlainTable:
    """Tabulate a row per sample: time, every load, the displacement of every output, stress and displacement at probes, and what
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
    return tabulate_curves(_transient_stem(curves), [*columns, *list_motion_columns(curves)])


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, transient in run.summary["transient"].items():
        stem = file_stem(pose)
        yield tabulate(f"peaks_{stem}", MOVED_COLUMNS, _list_moved(transient))
        yield from tabulate_forces(transient, stem, "probes_over_time")


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for pose, transient in run.summary["transient"].items():
        controlled = ", drives under control" if transient["motors"] == "controlled" else ""
        yield Listing(
            f"Motion in {1e3 * transient['duration_s']:g} ms in pose {pose}, {transient['modes']} modes up to {transient['up_to_hz']:g} Hz{controlled}",
            MOVED_COLUMNS,
            _list_moved(transient),
        )
        yield from (f"  {words}" for words in transient_words(transient))
        yield from list_force_tables(transient, f"in pose {pose}", "Largest stress over time")


def _list_curves(run: FinishedRun) -> list[TransientCurves]:
    return [history.curves for history in run.find_answers(TransientAnswer)]


def _write_section(run: FinishedRun) -> Section | None:
    histories = _list_curves(run)
    names = {
        "histories": {history.pose: history for history in histories},
        "columns": {
            "moved": MOVED_COLUMNS,
            **FORCE_COLUMNS,
        },
        "draw_transient": draw_transient,
        "list_moved": _list_moved,
        "transient_stem": _transient_stem,
        "transient_words": transient_words,
    }
    section = Section("transient", "Motion over time", template="views/transient.html", names=names)
    return section if histories else None


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: map(_tabulate_transient, _list_curves(run)),
    terminal=_list_parts,
    section=_write_section,
)
