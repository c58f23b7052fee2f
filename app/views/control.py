"""Closed-loop poles and margins of drives under control."""

from collections.abc import Iterator

from headstock.app.drawings.figures import draw_poles
from headstock.app.tables.control import DRIVE_COLUMNS, POLE_COLUMNS
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.pipeline.results.mode_files import file_stem


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, control in run.summary["control"].items():
        yield tabulate(f"poles_{file_stem(pose)}", POLE_COLUMNS, enumerate(control["poles"], 1))


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for pose, control in run.summary["control"].items():
        up_to, speed = control["up_to_hz"], 60e3 * control["speed_m_per_s"]
        title = f"Closed-loop poles in pose {pose} up to {up_to:g} Hz"
        yield Listing(title, POLE_COLUMNS, enumerate(control["poles"], 1))
        title = f"Drives in pose {pose}, lag at {speed:g} mm/min"
        yield Listing(title, DRIVE_COLUMNS, control["drives"].items())


def _write_section(_: FinishedRun) -> Section:
    names = {
        "columns": {"drives": DRIVE_COLUMNS, "poles": POLE_COLUMNS},
        "draw_poles": draw_poles,
        "enumerate": enumerate,
    }
    return Section("control", "Control", template="views/control.html", names=names)


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
