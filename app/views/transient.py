"""Motion under loads over time, and what drives, joints and probes take."""

from collections.abc import Iterator

from headstock.app.drawings.transient import draw_transient
from headstock.app.tables.motion_forces import (
    JOINT_FORCE_COLUMNS,
    MOTOR_COLUMNS,
    tabulate_joint_forces,
)
from headstock.app.tables.probes import PROBE_MOTION_PEAKS
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.tables.transient import (
    MOVED_COLUMNS,
    list_moved,
    tabulate_transient,
    transient_stem,
)
from headstock.app.texts.bounded_values import transient_words
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.pipeline.answers.transient import TransientCurves
from headstock.pipeline.results.mode_files import file_stem


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, transient in run.summary["transient"].items():
        stem = file_stem(pose)
        yield tabulate(f"peaks_{stem}", MOVED_COLUMNS, list_moved(transient))
        if transient["drives"]:
            yield tabulate(f"motors_{stem}", MOTOR_COLUMNS, transient["drives"].items())
        if transient["probes"]:
            name = f"probes_over_time_{stem}"
            yield tabulate(name, PROBE_MOTION_PEAKS, transient["probes"].items())
        if transient["joints"]:
            yield tabulate_joint_forces(f"joint_forces_{stem}", transient["joints"])


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for pose, transient in run.summary["transient"].items():
        controlled = ", drives under control" if transient["motors"] == "controlled" else ""
        yield Listing(
            f"Motion in {1e3 * transient['duration_s']:g} ms in pose {pose}, {transient['modes']} modes up to {transient['up_to_hz']:g} Hz{controlled}",
            MOVED_COLUMNS,
            list_moved(transient),
        )
        yield from (f"  {words}" for words in transient_words(transient))
        if transient["probes"]:
            title = f"Largest stress over time at probes in pose {pose}"
            yield Listing(title, PROBE_MOTION_PEAKS, transient["probes"].items())
        if transient["drives"]:
            yield Listing(f"Motors in pose {pose}", MOTOR_COLUMNS, transient["drives"].items())
        if transient["joints"]:
            title = f"Largest forces of joints in pose {pose}"
            yield Listing(title, JOINT_FORCE_COLUMNS, transient["joints"].items())


def _write_section(run: FinishedRun) -> Section | None:
    histories = run.find_curves(TransientCurves)
    names = {
        "histories": {history.pose: history for history in histories},
        "columns": {
            "moved": MOVED_COLUMNS,
            "probe_peaks_over_time": PROBE_MOTION_PEAKS,
            "motors": MOTOR_COLUMNS,
            "joint_forces": JOINT_FORCE_COLUMNS,
        },
        "draw_transient": draw_transient,
        "list_moved": list_moved,
        "transient_stem": transient_stem,
        "transient_words": transient_words,
    }
    section = Section("transient", "Motion over time", template="views/transient.html", names=names)
    return section if histories else None


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: map(tabulate_transient, run.find_curves(TransientCurves)),
    terminal=_list_parts,
    section=_write_section,
)
