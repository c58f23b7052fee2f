"""Closed-loop poles and margins of drives under control."""

from collections.abc import Iterator
from typing import Literal

from headstock.app.drawings.figures import draw_poles
from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    PlainTable,
    plain_column,
    show_percent,
    tabulate,
)
from headstock.app.texts.bounded_values import show_damping
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.control import (
    UM,
    ClosedLoopDrive,
    ClosedLoopPole,
    ControlAnswer,
    GuardAnswer,
    GuardBand,
)
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.solvers.control.sampled_loops import SamplingDifference

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


BAND_COLUMNS: tuple[Column[GuardBand], ...] = (
    plain_column(lambda band: band.drive, "drive", "drive", "Drive"),
    Column(lambda band: band.mode, "mode", ">mode", "Mode"),
    Column(lambda band: band.poses, "poses", ">poses", "Poses"),
    Column(lambda band: band.lowest_hz, "lowest [Hz]", ">lowest Hz", "Lowest [Hz]"),
    Column(lambda band: band.highest_hz, "highest [Hz]", ">highest Hz", "Highest [Hz]"),
    Column(lambda band: band.from_hz, "from [Hz]", ">from, with ±", "From, with ± [Hz]"),
    Column(lambda band: band.to_hz, "to [Hz]", ">to, with ±", "To, with ± [Hz]"),
    Column(lambda band: band.without_error, "poses without ±", ">without ±", "Without ±"),
    Column(
        lambda band: band.damping_ratio, "damping ratio", ">damping", "Damping", show=show_damping
    ),
    Column(lambda band: band.height, "height over rigid machine", ">height", "Height", digits=3),
    plain_column(lambda band: band.name, "motion", "motion", "Motion"),
)


def _show_notch(band: GuardBand) -> str:
    middle = 0.5 * (band.from_hz + band.to_hz)
    width = max(0.5 * (band.to_hz - band.from_hz) / middle, band.damping_ratio)
    return f'{band.drive}: filters = [{{ notch = "{middle:.4g} Hz", damping = {width:.2g} }}]'


def _list_notches(answer: GuardAnswer) -> list[str]:
    """Return a notch for the highest resonance of each drive."""
    return [_show_notch(band) for band in answer.bands if band.mode == 1]


def _tabulate_guards(answer: GuardAnswer) -> PlainTable:
    """Return a row per mode and pose, with the positions of axes in m or rad."""
    axes = list(dict.fromkeys(axis for guard in answer.guards for axis in guard.positions))
    headings = (
        *("drive", "mode", "pose", "frequency [Hz]", "± [Hz]", "damping ratio"),
        *("height over rigid machine", "motion", *(f"{axis} [m or rad]" for axis in axes)),
    )
    rows = [
        (
            *(guard.drive, guard.mode, guard.pose, guard.frequency_hz),
            *(answer.error_of(answer.guard_key(guard)).total, guard.damping_ratio),
            *(guard.height, guard.name),
            *(guard.positions.get(axis, 0.0) for axis in axes),
        )
        for guard in answer.guards
    ]
    return PlainTable("guard_frequencies", headings, tuple(rows))


def _list_drives(control: ControlAnswer) -> list[DriveRow]:
    return [(drive, not control.verdict) for drive in control.drives]


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for control in run.find(ControlAnswer):
        yield tabulate(
            f"poles_{file_stem(control.pose)}", POLE_COLUMNS, enumerate(control.poles, 1)
        )
    for answer in run.find(GuardAnswer):
        yield tabulate("guard_bands", BAND_COLUMNS, answer.bands)
        yield _tabulate_guards(answer)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for control in run.find(ControlAnswer):
        title = f"Closed-loop poles in pose {control.pose} up to {control.up_to_hz:g} Hz"
        yield Listing(title, POLE_COLUMNS, enumerate(control.poles, 1))
        title = f"Drives in pose {control.pose}, lag at {60e3 * control.speed:g} mm/min"
        yield Listing(title, DRIVE_COLUMNS, _list_drives(control))
        if control.sampled is not None:
            yield f"  {_describe_sampling(control.sampled)}"
            yield ""
    for answer in run.find(GuardAnswer):
        yield Listing(_title(answer), BAND_COLUMNS, answer.bands)
        yield from (f"  {words}" for words in _list_notches(answer))
        yield ""


def _describe_sampling(sampled: SamplingDifference) -> str:
    """Say how far continuous loops stand from sampled ones."""
    return (
        f"Controllers with a step: poles of the sampled loops differ from these by at most {show_percent(sampled.share)}"
        f" up to {sampled.up_to_hz:.4g} Hz, most at {sampled.hz:.4g} Hz; paths, contours and loads over time use these"
    )


def _title(answer: GuardAnswer) -> str:
    over = f"sweep {answer.over}" if answer.over else "the poses"
    missing = f", {len(answer.left_out)} of which it does not reach" if answer.left_out else ""
    return f"Modes to guard over {over}{missing}, followed by their shapes, motors free"


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
            "band_columns": BAND_COLUMNS,
            "followed": run.find(GuardAnswer),
            "guard_title": _title,
            "list_notches": _list_notches,
            "describe_sampling": _describe_sampling,
            "draw_poles": draw_poles,
            "enumerate": enumerate,
            "list_drives": _list_drives,
        },
    ),
)
