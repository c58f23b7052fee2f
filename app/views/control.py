"""Closed-loop poles and margins of drives under control."""

from collections.abc import Iterator
from typing import Literal

from headstock.app.drawings.figures import draw_poles
from headstock.app.tables.table import Cell, Column, Listing, PlainTable, tabulate
from headstock.app.texts.bounded_values import show_damping
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.pipeline.answers.control import DriveSummary, PoleSummary
from headstock.pipeline.results.mode_files import file_stem


def _decay(row: tuple[int, PoleSummary]) -> Cell:
    real = row[1]["real"]
    return "grows" if real > 0.0 else "never" if real == 0.0 else -1e3 / real


POLE_COLUMNS: tuple[Column[tuple[int, PoleSummary]], ...] = (
    Column(lambda row: row[0], screen=">no.", report="No."),
    Column(
        lambda row: row[1]["frequency_hz"],
        file="frequency [Hz]",
        screen=">Hz",
        report="Hz",
        show=lambda hz: f"{hz:.3f}" if hz else "0",
    ),
    Column(
        lambda row: row[1]["damping_ratio"],
        "damping ratio",
        ">damping",
        "Damping",
        show=show_damping,
    ),
    Column(_decay, screen=">decays in ms"),
    Column(lambda row: row[1]["real"], "real [rad/s]"),
    Column(lambda row: row[1]["imag"], "imaginary [rad/s]"),
    Column(lambda row: row[1]["drive"], "drive", "drive", "Drive"),
    Column(lambda row: row[1]["name"], "motion", "motion", "Motion"),
)


def _margin(
    key: Literal["bandwidth_hz", "gain", "phase_deg", "sensitivity"], screen: str, report: str
) -> Column[tuple[str, DriveSummary]]:
    return Column(
        lambda row: row[1]["margins"][key] if row[1]["margins"] else None,
        screen=screen,
        report=report,
    )


DRIVE_COLUMNS: tuple[Column[tuple[str, DriveSummary]], ...] = (
    Column(lambda row: row[0], screen="drive", report="Drive"),
    Column(lambda row: row[1]["encoder"], screen="encoder", report="Position from"),
    Column(lambda row: row[1]["kv_per_s"], screen=">kv 1/s", report="kv [1/s]"),
    Column(lambda row: row[1]["velocity_gain_n_s_per_m"], screen=">kp N s/m", report="kp [N s/m]"),
    Column(lambda row: row[1]["motor_mass_kg"], screen=">motor kg"),
    Column(lambda row: 1e3 * row[1]["dead_time_s"], report="Dead time [ms]", digits=3),
    Column(lambda row: row[1]["velocity_lag_um"], screen=">lag µm", report="Lag [µm]"),
    _margin("bandwidth_hz", ">bandwidth Hz", "Bandwidth [Hz]"),
    _margin("gain", ">gain margin", "Gain margin"),
    _margin("phase_deg", ">phase margin °", "Phase margin [°]"),
    _margin("sensitivity", ">max |S|", "Largest |S|"),
)


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


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=Section(
        "control",
        "Control",
        template="views/control.html",
        names={
            "columns": {"drives": DRIVE_COLUMNS, "poles": POLE_COLUMNS},
            "draw_poles": draw_poles,
            "enumerate": enumerate,
        },
    ),
)
