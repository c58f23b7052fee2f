"""Deviation from a straight path at every feed, and what drives, joints and probes take."""

from collections.abc import Iterator

from headstock.app.drawings.path import draw_path
from headstock.app.drawings.transient import draw_path_drives
from headstock.app.tables.motion_forces import (
    JOINT_FORCE_COLUMNS,
    MOTOR_COLUMNS,
    tabulate_joint_forces,
)
from headstock.app.tables.path import (
    CRUISE_COLUMNS,
    ZONE_COLUMNS,
    list_cruises,
    list_zones,
    path_error_words,
    path_stem,
    tabulate_path,
)
from headstock.app.tables.probes import PROBE_MOTION_PEAKS
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.path import PathCurves, PathSummary


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for feed in run.summary["path"]["feeds"]:
        stem = path_stem(feed["name"])
        if feed["drives"]:
            yield tabulate(f"motors_{stem}", MOTOR_COLUMNS, feed["drives"].items())
        if feed["probes"]:
            yield tabulate(f"probes_{stem}", PROBE_MOTION_PEAKS, feed["probes"].items())
        if feed["joints"]:
            yield tabulate_joint_forces(f"joint_forces_{stem}", feed["joints"])


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    path = run.summary["path"]
    yield Listing(_title(path), ZONE_COLUMNS, list_zones(path))
    if cruises := list_cruises(path):
        title = "At constant feed, with errors of guides [µm or µrad]"
        yield Listing(title, CRUISE_COLUMNS, cruises)
    yield from (f"  {words}" for words in path_error_words(path))
    yield ""
    for feed in path["feeds"]:
        name = f"at {feed['name']}"
        if feed["probes"]:
            title = f"Largest stress at probes {name}"
            yield Listing(title, PROBE_MOTION_PEAKS, feed["probes"].items())
        if feed["drives"]:
            yield Listing(f"Motors {name}", MOTOR_COLUMNS, feed["drives"].items())
        if feed["joints"]:
            title = f"Largest forces of joints {name}"
            yield Listing(title, JOINT_FORCE_COLUMNS, feed["joints"].items())


def _title(path: PathSummary) -> str:
    moved = ", ".join(
        axis for axis, place in path["end"].items() if place != path["start"].get(axis, 0.0)
    )
    low_pass = "" if path["lowpass_hz"] is None else f", below {path['lowpass_hz']:g} Hz"
    return f"Deviation while {moved} moves {show_position(path['length'], path['unit'])}{low_pass} [µm or µrad, s]"


def _write_section(run: FinishedRun) -> Section | None:
    paths = run.find_curves(PathCurves)
    names = {
        "paths": paths,
        "path_stems": [path_stem(feed.name) for feed in paths],
        "columns": {
            "zones": ZONE_COLUMNS,
            "cruises": CRUISE_COLUMNS,
            "probe_peaks_over_time": PROBE_MOTION_PEAKS,
            "motors": MOTOR_COLUMNS,
            "joint_forces": JOINT_FORCE_COLUMNS,
        },
        "draw_path": draw_path,
        "draw_path_drives": draw_path_drives,
        "list_zones": list_zones,
        "list_cruises": list_cruises,
        "path_error_words": path_error_words,
    }
    section = Section(
        "path", "Deviation from the path", "Path", template="views/path.html", names=names
    )
    return section if paths else None


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: map(tabulate_path, run.find_curves(PathCurves)),
    terminal=_list_parts,
    section=_write_section,
)
