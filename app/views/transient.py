"""Motion under loads over time, and what drives, joints and probes take."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from headstock.app.drawings.path import draw_transient
from headstock.app.tables.probes import (
    FORCE_COLUMNS,
    Forces,
    gather_forces,
    list_force_tables,
    list_motion_columns,
    tabulate_forces,
)
from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    NumbersRow,
    PlainTable,
    show_percent,
    tabulate,
    tabulate_curves,
)
from headstock.app.texts.bounded_values import transient_words
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.path import deviation_unit
from headstock.pipeline.answers.transient import TransientAnswer, TransientCurves
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.state_spaces.transient import TransientFigures

MOVED_UNITS = {"um": "µm", "urad": "µrad"}


@dataclass(frozen=True, eq=False)
class _MovedRow(NumbersRow):
    """How an output of a transient analysis moved."""

    channel: Channel
    figures: TransientFigures


def _list_moved(found: TransientAnswer) -> list[_MovedRow]:
    """Outputs of a transient analysis."""
    numbers, curves = found.index_numbers(), found.curves
    return [
        _MovedRow(numbers, {"pose": curves.pose, "output": name_channel(channel)}, channel, figures)
        for channel, figures in zip(curves.outputs, found.figures, strict=True)
    ]


def _settled(row: _MovedRow) -> Cell:
    found = row.figures
    if found.settling is not None:
        return 1e3 * found.settling
    return "at rest" if found.peak == 0.0 else "never" if found.final is None else "later"


def _peak_error(row: _MovedRow) -> float | None:
    """NaN where errors were looked at and one of them is not known."""
    peak = row.find("time_deviation", figure="peak")
    if peak is None or not peak.value or peak.error is None or not peak.error.shares:
        return None
    error = row.error("time_deviation", figure="peak")
    return math.nan if error is None else error


def _moved(figure: str, file: str, screen: str, report: str) -> Column[_MovedRow]:
    return Column(
        lambda row: row.value("time_deviation", figure=figure),
        file,
        screen,
        report,
        error=_peak_error if figure == "peak" else None,
    )


MOVED_COLUMNS: tuple[Column[_MovedRow], ...] = (
    Column(lambda row: name_channel(row.channel), "at", "at", "At"),
    Column(lambda row: MOVED_UNITS[deviation_unit(row.channel)[0]], "unit", "in", "In"),
    _moved("peak", "peak", ">peak", "Peak"),
    Column(lambda row: row.error("time_deviation", figure="peak"), "± peak"),
    Column(lambda row: 1e3 * row.figures.peak_time, "at [ms]", ">at ms", "at [ms]"),
    _moved("start", "from", "", "From"),
    _moved("final", "final", ">final", "Comes to rest at"),
    Column(
        lambda row: row.figures.overshoot, "overshoot", ">overshoot", "Overshoot", show=show_percent
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


def _list_forces(found: TransientAnswer) -> Forces:
    return gather_forces(found, found, pose=found.curves.pose)


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for found in run.find(TransientAnswer):
        stem = file_stem(found.curves.pose)
        yield tabulate(f"peaks_{stem}", MOVED_COLUMNS, _list_moved(found))
        yield from tabulate_forces(_list_forces(found), stem, "probes_over_time")


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for found in run.find(TransientAnswer):
        pose = found.curves.pose
        controlled = ", drives under control" if found.motors == "controlled" else ""
        yield Listing(
            f"Motion in {1e3 * found.duration:g} ms in pose {pose}, {found.modes} modes up to {found.up_to_hz:g} Hz{controlled}",
            MOVED_COLUMNS,
            _list_moved(found),
        )
        yield from (f"  {words}" for words in transient_words(found))
        forces = _list_forces(found)
        yield from list_force_tables(forces, f"in pose {pose}", "Largest stress over time")


def _write_section(run: Results) -> Section:
    names = {
        "answers": run.find(TransientAnswer),
        "columns": {
            "moved": MOVED_COLUMNS,
            **FORCE_COLUMNS,
        },
        "draw_transient": draw_transient,
        "list_forces": _list_forces,
        "list_moved": _list_moved,
        "transient_stem": _transient_stem,
        "transient_words": transient_words,
        "zip": zip,
    }
    return Section("transient", "Motion over time", template="views/transient.html", names=names)


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: (
        _tabulate_transient(each.curves) for each in run.find(TransientAnswer)
    ),
    terminal=_list_parts,
    section=_write_section,
)
