"""Deviation from a straight path at every feed, and what drives, joints and probes take."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from headstock.app.drawings.path import draw_path, draw_path_drives
from headstock.app.tables.probes import (
    FORCE_COLUMNS,
    list_force_tables,
    list_motion_columns,
    tabulate_forces,
)
from headstock.app.tables.table import (
    Column,
    Listing,
    PlainTable,
    show_deviation,
    tabulate_curves,
)
from headstock.app.texts.bounded_values import NO_BOUND, largest_parts, show_parts
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.geometry.machine.machine import SCENE_UNITS, show_position
from headstock.pipeline.answers.path import (
    CruiseSummary,
    FeedSummary,
    PathCurves,
    PathResult,
    PathSummary,
    ZoneSummary,
    deviation_unit,
)
from headstock.solvers.second_order import name_channel

PART_NAMES = {
    "total": "deviation",
    "quasi_static": "quasi-static",
    "low_frequency": "low-frequency",
    "dynamic": "residual vibration",
}


class _ZoneRow(NamedTuple):
    """What a path analysis says of an output while a ramp lasts; sizes in µm or µrad."""

    run: FeedSummary
    channel: list[str]
    zone: str
    found: ZoneSummary
    errors: ZoneSummary
    parts: Mapping[str, float | None]  # of ± of its peak, by source

    def error(self, name: str) -> float | None:
        """Return the error of one of its sizes; None where nobody says, or it is zero."""
        key = f"{name}_{deviation_unit((self.channel[0], self.channel[1]))[0]}"
        return _known_error(self.found[key], self.errors, key)

    def size(self, name: str) -> float | None:
        """One of its sizes, by its name without the unit."""
        return self.found[f"{name}_{deviation_unit((self.channel[0], self.channel[1]))[0]}"]


def _list_zones(path: PathSummary, output: int | None = None) -> list[_ZoneRow]:
    """Every feed, output and ramp of a path analysis; of one output where its number is given."""
    return [
        _ZoneRow(run, shown["dof"], zone, found, shown["errors"][zone], shown["error_share"][zone])
        for run in path["feeds"]
        for number, shown in enumerate(run["outputs"])
        if output in (None, number)
        for zone, found in (
            ("accelerating", shown["accelerating"]),
            ("decelerating", shown["decelerating"]),
        )
    ]


def _known_error(
    value: float | None, errors: Mapping[str, float | None], name: str
) -> float | None:
    """How far a number may be off, NaN for ``± ?``; None where nothing is known of any, or the number
    is roundoff.
    """
    if value is None or show_deviation(value) == "0" or all(e is None for e in errors.values()):
        return None
    error = errors.get(name)
    return math.nan if error is None else error


def _sized(name: str, report: str, screen: str = "") -> Column[_ZoneRow]:
    return Column(
        lambda row: row.size(name),
        screen=screen,
        report=report,
        error=lambda row: row.error(name),
    )


ZONE_COLUMNS: tuple[Column[_ZoneRow], ...] = (
    Column(lambda row: row.run["name"], screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    Column(lambda row: row.zone, screen="<zone", report="Zone"),
    Column(lambda row: row.run["acceleration"], report="Acceleration [m/s², rad/s²]", digits=3),
    _sized("peak", "Peak", ">peak"),
    Column(lambda row: row.found["peak_s"], screen=">at s", report="at [s]"),
    _sized("span", "Peak to peak", ">span"),
    _sized("quasi_static", "Quasi-static", ">static"),
    _sized("dynamic", PART_NAMES["dynamic"].capitalize(), ">vibration"),
    _sized("rms", "rms"),
    Column(
        lambda row: row.found["settling_s"],
        screen=">settles",
        report="below 5 % after [s]",
        digits=3,
        missing="never",
    ),
    Column(lambda row: row.size("frozen_peak"), screen=">frozen pose", report="Peak, frozen pose"),
)


class _CruiseRow(NamedTuple):
    """An output of a path at constant feed."""

    run: FeedSummary
    channel: Sequence[str]
    found: CruiseSummary
    errors: ZoneSummary


def _list_cruises(path: PathSummary, output: int | None = None) -> list[_CruiseRow]:
    """Every feed and output of a path on which errors of guides act; of one output where its number
    is given.
    """
    return [
        _CruiseRow(run, shown["dof"], shown["cruising"], shown["errors"]["cruising"])
        for run in path["feeds"]
        for number, shown in enumerate(run["outputs"])
        if output in (None, number) and "cruising" in shown
    ]


def _varied(
    name: Literal["variation_um", "straightness_um", "amplitude_um"], report: str, screen: str
) -> Column[_CruiseRow]:
    return Column(
        lambda row: row.found[name],
        screen=screen,
        report=report,
        show=show_deviation,
        error=lambda row: _known_error(row.found[name], row.errors, name),
    )


CRUISE_COLUMNS: tuple[Column[_CruiseRow], ...] = (
    Column(lambda row: row.run["name"], screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    _varied("variation_um", "Variation", ">variation"),
    _varied("straightness_um", "Straightness", ">straightness"),
    _varied("amplitude_um", "Strongest wave", ">wave of"),
    Column(lambda row: row.found["period_s"], screen=">period s", report="Period [s]", digits=3),
    Column(
        lambda row: row.found.get("period_mm", row.found.get("period_deg")),
        screen=">mm, deg",
        report="Period [mm, deg]",
        digits=3,
    ),
)


def _path_error_words(path: PathSummary) -> list[str]:
    """Where the errors of a path come from, and what is not in them."""
    largest, unknown = largest_parts(
        (row.size("peak") or 0.0, row.parts) for row in _list_zones(path)
    )
    words = []
    if largest:
        words.append(f"± of a peak, from {show_parts(largest)}; in the pose of the middle")
    if unknown:
        words.append(f"{NO_BOUND} : nothing is known of {', '.join(unknown)}")
    if path["error_left_out"]:
        begin = "not in ±" if largest else f"{NO_BOUND} : nothing is known of"
        words.append(f"{begin}{':' if largest else ''} {'; '.join(path['error_left_out'])}")
    return words


def _path_stem(feed: str) -> str:
    """Name of the files of a feed such as ``3000 mm/min``: ``path_3000``."""
    return f"path_{feed.partition(' ')[0]}".replace(".", "_").replace("+", "")


def _tabulate_path(curves: PathCurves) -> PlainTable:
    """Tabulate a row per sample: time, set point, the deviation of every output with its parts, and what drives
    under control do.
    """
    found = curves.deviation
    factor, shown = SCENE_UNITS[curves.unit]
    columns = [
        ("time [s]", found.times),
        (f"position [{shown}]", factor * curves.positions),
        (f"acceleration [{curves.unit}/s^2]", curves.accelerations),
    ]
    for number, channel in enumerate(curves.outputs):
        unit, factor = deviation_unit(channel)
        where = f"{name_channel(channel)} [{unit}]"
        for part, words in PART_NAMES.items():
            columns.append((f"{words} {where}", factor * getattr(found, part)[:, number]))
        frozen = factor * curves.frozen[:, number]
        columns.append((f"deviation in the pose of the middle {where}", frozen))
    return tabulate_curves(_path_stem(curves.name), [*columns, *list_motion_columns(curves)])


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for feed in run.summary["path"]["feeds"]:
        yield from tabulate_forces(feed, _path_stem(feed["name"]), "probes")


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    path = run.summary["path"]
    yield Listing(_title(path), ZONE_COLUMNS, _list_zones(path))
    if cruises := _list_cruises(path):
        title = "At constant feed, with errors of guides [µm or µrad]"
        yield Listing(title, CRUISE_COLUMNS, cruises)
    yield from (f"  {words}" for words in _path_error_words(path))
    yield ""
    for feed in path["feeds"]:
        yield from list_force_tables(feed, f"at {feed['name']}", "Largest stress")


def _title(path: PathSummary) -> str:
    moved = ", ".join(
        axis for axis, place in path["end"].items() if place != path["start"].get(axis, 0.0)
    )
    low_pass = "" if path["lowpass_hz"] is None else f", below {path['lowpass_hz']:g} Hz"
    return f"Deviation while {moved} moves {show_position(path['length'], path['unit'])}{low_pass} [µm or µrad, s]"


def _list_curves(run: FinishedRun) -> list[PathCurves]:
    return [feed.curves for path in run.find_answers(PathResult) for feed in path.runs]


def _write_section(run: FinishedRun) -> Section | None:
    paths = _list_curves(run)
    names = {
        "paths": paths,
        "path_stems": [_path_stem(feed.name) for feed in paths],
        "columns": {
            "zones": ZONE_COLUMNS,
            "cruises": CRUISE_COLUMNS,
            **FORCE_COLUMNS,
        },
        "draw_path": draw_path,
        "draw_path_drives": draw_path_drives,
        "list_zones": _list_zones,
        "list_cruises": _list_cruises,
        "path_error_words": _path_error_words,
    }
    section = Section(
        "path", "Deviation from the path", "Path", template="views/path.html", names=names
    )
    return section if paths else None


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: map(_tabulate_path, _list_curves(run)),
    terminal=_list_parts,
    section=_write_section,
)
