"""Closed-loop poles and margins of drives under control."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from headstock.app.drawings.figures import draw_poles
from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    PlainTable,
    bound_column,
    plain_column,
    tabulate,
)
from headstock.app.texts.bounded_values import show_damping
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.control import (
    UM,
    ClosedLoopDrive,
    ClosedLoopPole,
    ControlAnswer,
    GuardFrequency,
)
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results

type DriveRow = tuple[ClosedLoopDrive, bool]  # lag and margins mean something in stable loops only


def _decay(row: tuple[int, ClosedLoopPole]) -> Cell:
    real = row[1].pole.real
    return "grows" if real > 0.0 else "never" if real == 0.0 else -1e3 / real


POLE_COLUMNS: tuple[Column[tuple[int, ClosedLoopPole]], ...] = (
    Column(lambda row: row[0], screen=">no.", report="No."),
    Column(
        lambda row: row[1].frequency_hz,
        file="frequency [Hz]",
        screen=">Hz",
        report="Hz",
        show=lambda hz: f"{hz:.3f}" if hz else "0",
    ),
    Column(
        lambda row: row[1].damping_ratio,
        "damping ratio",
        ">damping",
        "Damping",
        show=show_damping,
    ),
    Column(_decay, screen=">decays in ms"),
    Column(lambda row: row[1].pole.real, "real [rad/s]"),
    Column(lambda row: row[1].pole.imag, "imaginary [rad/s]"),
    Column(lambda row: row[1].drive, "drive", "drive", "Drive"),
    Column(lambda row: row[1].name, "motion", "motion", "Motion"),
)


def _margin(
    key: Literal["bandwidth_hz", "gain", "phase_deg", "sensitivity"], screen: str, report: str
) -> Column[DriveRow]:
    return Column(
        lambda row: getattr(row[0].margins, key) if row[1] else None,
        screen=screen,
        report=report,
    )


DRIVE_COLUMNS: tuple[Column[DriveRow], ...] = (
    Column(lambda row: row[0].train.name, screen="drive", report="Drive"),
    Column(lambda row: row[0].train.control.encoder, screen="encoder", report="Position from"),
    Column(lambda row: row[0].train.control.position_gain, screen=">kv 1/s", report="kv [1/s]"),
    Column(lambda row: row[0].train.control.velocity_gain, screen=">kp N s/m", report="kp [N s/m]"),
    Column(lambda row: row[0].motor_mass, screen=">motor kg"),
    Column(lambda row: 1e3 * row[0].train.control.dead_time, report="Dead time [ms]", digits=3),
    Column(
        lambda row: row[0].velocity_lag * UM if row[1] else None,
        screen=">lag µm",
        report="Lag [µm]",
    ),
    _margin("bandwidth_hz", ">bandwidth Hz", "Bandwidth [Hz]"),
    _margin("gain", ">gain margin", "Gain margin"),
    _margin("phase_deg", ">phase margin °", "Phase margin [°]"),
    _margin("sensitivity", ">max |S|", "Largest |S|"),
)


type GuardRow = tuple[ControlAnswer, GuardFrequency]


def _guard_error(row: GuardRow) -> float | None:
    return row[0].error_of(row[0].guard_key(row[1])).total


GUARD_COLUMNS: tuple[Column[GuardRow], ...] = (
    plain_column(lambda row: row[1].drive, "drive", "drive", "Drive"),
    plain_column(lambda row: row[0].pose, "pose", "pose", "Pose"),
    *bound_column(
        lambda row: row[1].frequency_hz,
        _guard_error,
        "frequency [Hz]",
        ">Hz",
        "Frequency [Hz]",
        error_file="± [Hz]",
    ),
    Column(
        lambda row: row[1].damping_ratio,
        "damping ratio",
        ">damping",
        "Damping",
        show=show_damping,
    ),
    Column(lambda row: row[1].height, "height over rigid machine", ">height", "Height", digits=3),
    plain_column(lambda row: row[1].name, "motion", "motion", "Motion"),
)


def _list_guards(run: Results) -> list[GuardRow]:
    """Return the frequencies to guard in every pose, drive by drive."""
    rows = [(answer, guard) for answer in run.find(ControlAnswer) for guard in answer.guards]
    return sorted(rows, key=lambda row: row[1].drive)


def _tabulate_guards(rows: list[GuardRow]) -> PlainTable:
    """Return the same for files, with the position of every axis in m or rad."""
    table = tabulate("guard_frequencies", GUARD_COLUMNS, rows)
    axes = list(dict.fromkeys(axis for answer, _ in rows for axis in answer.positions))
    headings = (*table.headings, *(f"{axis} [m or rad]" for axis in axes))
    places = [tuple(answer.positions.get(axis, 0.0) for axis in axes) for answer, _ in rows]
    lines = zip(table.rows, places, strict=True)
    return PlainTable(table.name, headings, tuple((*row, *place) for row, place in lines))


def _find_bands(rows: list[GuardRow]) -> list[str]:
    """Say of each drive how far its highest resonance moves over the poses, and a notch for it."""
    drives = dict.fromkeys(guard.drive for _, guard in rows)
    highest = [row for row in rows if row[1].number == 1]
    return [
        _describe_band(drive, [row for row in highest if row[1].drive == drive]) for drive in drives
    ]


def _describe_band(drive: str, rows: list[GuardRow]) -> str:
    hz = np.array([row[1].frequency_hz for row in rows])
    errors = [_guard_error(row) for row in rows]
    bounds = np.array([error or 0.0 for error in errors])
    low, high = float((hz - bounds).min()), float((hz + bounds).max())
    middle = 0.5 * (low + high)
    width = max(0.5 * (high - low) / middle, *(row[1].damping_ratio for row in rows))
    words = ", without ± where none is known" if None in errors else ""
    return (
        f"  {drive}: {hz.min():.4g} to {hz.max():.4g} Hz in {len(rows)} poses, {low:.4g} to {high:.4g} Hz with ±{words};"
        f' filters = [{{ notch = "{middle:.4g} Hz", damping = {width:.2g} }}]'
    )


def _list_drives(control: ControlAnswer) -> list[DriveRow]:
    return [(drive, not control.verdict) for drive in control.drives]


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for control in run.find(ControlAnswer):
        yield tabulate(
            f"poles_{file_stem(control.pose)}", POLE_COLUMNS, enumerate(control.poles, 1)
        )
    if rows := _list_guards(run):
        yield _tabulate_guards(rows)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for control in run.find(ControlAnswer):
        title = f"Closed-loop poles in pose {control.pose} up to {control.up_to_hz:g} Hz"
        yield Listing(title, POLE_COLUMNS, enumerate(control.poles, 1))
        title = f"Drives in pose {control.pose}, lag at {60e3 * control.speed:g} mm/min"
        yield Listing(title, DRIVE_COLUMNS, _list_drives(control))
    if rows := _list_guards(run):
        yield Listing("Frequencies to guard, motors free", GUARD_COLUMNS, rows)
        yield from _find_bands(rows)
        yield ""


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=lambda run: Section(
        "control",
        "Control",
        template="views/control.html",
        names={
            "answers": run.find(ControlAnswer),
            "drive_columns": DRIVE_COLUMNS,
            "pole_columns": POLE_COLUMNS,
            "guard_columns": GUARD_COLUMNS,
            "guards": _list_guards(run),
            "bands": _find_bands(_list_guards(run)),
            "draw_poles": draw_poles,
            "enumerate": enumerate,
            "list_drives": _list_drives,
        },
    ),
)
