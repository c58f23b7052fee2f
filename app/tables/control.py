"""Rows of poles and drives under control."""

from typing import Literal

from headstock.app.tables.table import Cell, Column
from headstock.app.texts.bounded_values import show_damping
from headstock.pipeline.answers.control import DriveSummary, PoleSummary


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
