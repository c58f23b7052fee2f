"""Deviation from a straight path at every feed, and what drives, joints and probes take."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from headstock.app.drawings.path import draw_path, draw_path_drives
from headstock.app.tables.probes import (
    FORCE_COLUMNS,
    Forces,
    gather_forces,
    list_force_tables,
    list_motion_columns,
    tabulate_forces,
)
from headstock.app.tables.table import (
    Column,
    Listing,
    NumbersRow,
    PlainTable,
    show_deviation,
    tabulate_curves,
)
from headstock.app.texts.bounded_values import NO_BOUND, largest_parts, left_out_words, show_parts
from headstock.app.views.view import Section, TerminalPart, View
from headstock.geometry.machine.machine import SCENE_UNITS, show_position
from headstock.pipeline.answers.path import (
    CRUISE,
    SIZES,
    ZONES,
    PathCurves,
    PathResult,
    PathRun,
    deviation_unit,
)
from headstock.pipeline.results.results import Results
from headstock.solvers.motion.deviation import CruiseFigures, ZoneFigures
from headstock.solvers.second_order import Channel, name_channel

PART_NAMES = {
    "total": "deviation",
    "quasi_static": "quasi-static",
    "low_frequency": "low-frequency",
    "dynamic": "residual vibration",
}


@dataclass(frozen=True, eq=False)
class _ZoneRow[Figures](NumbersRow):
    """What a path analysis says of an output while a ramp lasts, or at constant feed."""

    run: PathRun
    channel: Channel
    zone: str
    figures: Figures
    frozen: Figures  # if the pose stayed that of the middle

    def shown(self, figure: str) -> float | None:
        """Return one of its figures in the unit that is shown."""
        return self.value("path_deviation", figure=figure)

    def bound(self, figure: str) -> float | None:
        """± of a figure, NaN for ``± ?``; None where nothing is known of any, or the figure is roundoff."""
        value = self.shown(figure)
        errors = {
            each: self.error("path_deviation", figure=each)
            for each in (CRUISE if self.zone == "cruising" else SIZES)
        }
        if (
            value is None
            or show_deviation(value) == "0"
            or all(error is None for error in errors.values())
        ):
            return None
        total = errors[figure]
        return math.nan if total is None else total


type _RampRow = _ZoneRow[ZoneFigures]
type _CruiseRow = _ZoneRow[CruiseFigures]


def _roles(run: PathRun, channel: Channel, zone: str) -> dict[str, str | int]:
    return {"feed": run.curves.name, "zone": zone, "output": name_channel(channel)}


def _list_zones(found: PathResult, output: int | None = None) -> list[_RampRow]:
    """Every feed, output and ramp of a path analysis; of one output where its number is given."""
    numbers = found.index_numbers()
    return [
        _ZoneRow(numbers, _roles(run, channel, zone), run, channel, zone, both[ramp], frozen[ramp])
        for run in found.runs
        for number, (channel, both, frozen) in enumerate(
            zip(run.curves.outputs, run.figures, run.frozen_figures, strict=True)
        )
        if output in (None, number)
        for ramp, zone in enumerate(ZONES)
    ]


def _sized(name: str, report: str, screen: str = "") -> Column[_RampRow]:
    return Column(
        lambda row: row.shown(name),
        screen=screen,
        report=report,
        error=lambda row: row.bound(name),
    )


ZONE_COLUMNS: tuple[Column[_RampRow], ...] = (
    Column(lambda row: row.run.curves.name, screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    Column(lambda row: row.zone, screen="<zone", report="Zone"),
    Column(
        lambda row: float(np.abs(row.run.curves.accelerations).max()),
        report="Acceleration [m/s², rad/s²]",
        digits=3,
    ),
    _sized("peak", "Peak", ">peak"),
    Column(lambda row: row.figures.peak_time, screen=">at s", report="at [s]"),
    _sized("span", "Peak to peak", ">span"),
    _sized("quasi_static", "Quasi-static", ">static"),
    _sized("dynamic", PART_NAMES["dynamic"].capitalize(), ">vibration"),
    _sized("rms", "rms"),
    Column(
        lambda row: row.figures.settling,
        screen=">settles",
        report="below 5 % after [s]",
        digits=3,
        missing="never",
    ),
    Column(
        lambda row: deviation_unit(row.channel)[1] * row.frozen.peak,
        screen=">frozen pose",
        report="Peak, frozen pose",
    ),
)


def _list_cruises(found: PathResult, output: int | None = None) -> list[_CruiseRow]:
    """Every feed and output of a path on which errors of guides act; of one output where its number
    is given.
    """
    numbers, zone = found.index_numbers(), "cruising"
    return [
        _ZoneRow(numbers, _roles(run, channel, zone), run, channel, zone, cruise, cruise)
        for run in found.runs
        for number, (channel, cruise) in enumerate(
            zip(run.curves.outputs, run.cruises, strict=False)
        )
        if output in (None, number) and cruise is not None
    ]


def _varied(name: str, report: str, screen: str) -> Column[_CruiseRow]:
    return Column(
        lambda row: row.shown(name),
        screen=screen,
        report=report,
        show=show_deviation,
        error=lambda row: row.bound(name),
    )


CRUISE_COLUMNS: tuple[Column[_CruiseRow], ...] = (
    Column(lambda row: row.run.curves.name, screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    _varied("variation", "Variation", ">variation"),
    _varied("straightness", "Straightness", ">straightness"),
    _varied("amplitude", "Strongest wave", ">wave of"),
    Column(lambda row: row.figures.period, screen=">period s", report="Period [s]", digits=3),
    Column(
        lambda row: SCENE_UNITS[row.run.curves.unit][0] * row.figures.distance,
        screen=">mm, deg",
        report="Period [mm, deg]",
        digits=3,
    ),
)


def _path_error_words(found: PathResult) -> list[str]:
    """Where the errors of a path come from, and what is not in them."""
    largest, unknown = largest_parts(
        (row.figures.peak, found.find_error(row.run, row.channel, row.zone, "peak").shares)
        for row in _list_zones(found)
    )
    words = []
    if largest:
        words.append(f"± of a peak, from {show_parts(largest)}; in the pose of the middle")
    if unknown:
        words.append(f"{NO_BOUND} : nothing is known of {', '.join(unknown)}")
    return words + left_out_words(found.left_out, known=bool(largest))


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


def _list_forces(found: PathResult, run: PathRun) -> Forces:
    return gather_forces(found, run, feed=run.curves.name)


def _list_tables(run: Results) -> Iterator[PlainTable]:
    path = run.find(PathResult)[-1]
    for feed in path.runs:
        yield from tabulate_forces(_list_forces(path, feed), _path_stem(feed.curves.name), "probes")


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    path = run.find(PathResult)[-1]
    yield Listing(_title(path), ZONE_COLUMNS, _list_zones(path))
    if cruises := _list_cruises(path):
        title = "At constant feed, with errors of guides [µm or µrad]"
        yield Listing(title, CRUISE_COLUMNS, cruises)
    yield from (f"  {words}" for words in _path_error_words(path))
    yield ""
    for feed in path.runs:
        forces = _list_forces(path, feed)
        yield from list_force_tables(forces, f"at {feed.curves.name}", "Largest stress")


def _list_moved(path: PathResult) -> list[str]:
    """Return the axes that move."""
    return [axis for axis, end in path.end.items() if end != path.start.get(axis, 0.0)]


def _title(path: PathResult) -> str:
    moved = ", ".join(_list_moved(path))
    low_pass = "" if path.lowpass_hz is None else f", below {path.lowpass_hz:g} Hz"
    return f"Deviation while {moved} moves {show_position(path.length, path.unit)}{low_pass} [µm or µrad, s]"


def _write_section(run: Results) -> Section:
    path = run.find(PathResult)[-1]
    curves = [feed.curves for feed in path.runs]
    names = {
        "path": path,
        "moved": _list_moved(path),
        "curves": curves,
        "stems": [_path_stem(each.name) for each in curves],
        "forces": [_list_forces(path, feed) for feed in path.runs],
        "columns": {
            "zones": ZONE_COLUMNS,
            "cruises": CRUISE_COLUMNS,
            **FORCE_COLUMNS,
        },
        "draw_path": draw_path,
        "draw_path_drives": draw_path_drives,
        "list_zones": _list_zones,
        "list_cruises": _list_cruises,
        "error_words": _path_error_words(path),
        "zip": zip,
    }
    return Section(
        "path", "Deviation from the path", "Path", template="views/path.html", names=names
    )


VIEW = View(
    tables=_list_tables,
    long_tables=lambda run: (_tabulate_path(each.curves) for each in run.find(PathResult)[-1].runs),
    terminal=_list_parts,
    section=_write_section,
)
