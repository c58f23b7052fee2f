"""Rows of what drives and joints take while a machine moves."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from headstock.app.tables.probes import PROBE_MOTION_PEAKS
from headstock.app.tables.table import Cell, Column, Listing, PlainTable, tabulate
from headstock.pipeline.answers.motion_forces import DriveForceSummary, JointForceSummary
from headstock.pipeline.answers.path import FeedSummary
from headstock.pipeline.answers.transient import TransientSummary

type MotorRow = tuple[str, DriveForceSummary]
type JointForces = Mapping[str, JointForceSummary]
type JointRow = tuple[str, JointForces]

MOTOR_COLUMNS: tuple[Column[MotorRow], ...] = (
    Column(lambda row: row[0], "drive", "drive", "Drive"),
    Column(
        lambda row: row[1]["torque_nm"],
        "largest torque [N m]",
        ">torque N m",
        "Torque [N m]",
        error=lambda row: row[1]["torque_off_nm"],
    ),
    Column(lambda row: row[1]["torque_off_nm"], "± torque [N m]"),
    Column(lambda row: 1e3 * row[1]["torque_s"], "torque at [ms]", ">at ms", "at [ms]"),
    Column(
        lambda row: row[1]["position_error_um"],
        "largest position error [um]",
        ">position error µm",
        "Position error [µm]",
        error=lambda row: row[1]["position_error_off_um"],
    ),
    Column(lambda row: row[1]["position_error_off_um"], "± position error [um]"),
    Column(
        lambda row: 1e3 * row[1]["position_error_s"],
        "position error at [ms]",
        ">at ms ",
        "at [ms]",
    ),
)


def _largest(row: JointRow, unit: str) -> tuple[str, JointForceSummary] | None:
    own = [(name, found) for name, found in row[1].items() if found["unit"] == unit]
    return max(own, key=lambda item: abs(item[1]["force"]), default=None)


def _read(row: JointRow, unit: str, what: Literal["direction", "force", "force_s"]) -> Cell:
    largest = _largest(row, unit)
    if largest is None:
        return None
    if what == "direction":
        return largest[0]
    return largest[1][what] * (1e3 if what == "force_s" else 1.0)


def _find_error(row: JointRow, unit: str) -> float | None:
    largest = _largest(row, unit)
    return None if largest is None or not largest[1]["force"] else largest[1]["error"]


# the largest force and the largest moment of each joint; files have all directions
JOINT_FORCE_COLUMNS: tuple[Column[JointRow], ...] = (
    Column(lambda row: row[0], "", "joint", "Joint"),
    Column(lambda row: _read(row, "N", "direction"), "", "force in", "Force in"),
    Column(
        lambda row: _read(row, "N", "force"),
        "",
        ">N",
        "[N]",
        error=lambda row: _find_error(row, "N"),
    ),
    Column(lambda row: _read(row, "N", "force_s"), "", ">at ms", "at [ms]"),
    Column(lambda row: _read(row, "N m", "direction"), "", "moment about", "Moment about"),
    Column(
        lambda row: _read(row, "N m", "force"),
        "",
        ">N m",
        "[N m]",
        error=lambda row: _find_error(row, "N m"),
    ),
    Column(lambda row: _read(row, "N m", "force_s"), "", ">at ms ", "at [ms]"),
)


FORCE_COLUMNS = {  # as templates call them
    "probe_peaks_over_time": PROBE_MOTION_PEAKS,
    "motors": MOTOR_COLUMNS,
    "joint_forces": JOINT_FORCE_COLUMNS,
}


def list_force_tables(
    found: FeedSummary | TransientSummary, where: str, stress: str
) -> Iterator[Listing[Any]]:
    """Yield what probes, drives and joints took at most, as far as there are any.

    Args:
        where: Ends the titles: at which feed or in which pose.
        stress: Begins the title of probes.
    """
    if found["probes"]:
        yield Listing(f"{stress} at probes {where}", PROBE_MOTION_PEAKS, found["probes"].items())
    if found["drives"]:
        yield Listing(f"Motors {where}", MOTOR_COLUMNS, found["drives"].items())
    if found["joints"]:
        title = f"Largest forces of joints {where}"
        yield Listing(title, JOINT_FORCE_COLUMNS, found["joints"].items())


def tabulate_forces(
    found: FeedSummary | TransientSummary, stem: str, probes: str
) -> Iterator[PlainTable]:
    """Yield the same for files, joints with a row per direction.

    Args:
        stem: Ends the names of the files.
        probes: Begins the name of that of probes.
    """
    if found["drives"]:
        yield tabulate(f"motors_{stem}", MOTOR_COLUMNS, found["drives"].items())
    if found["probes"]:
        yield tabulate(f"{probes}_{stem}", PROBE_MOTION_PEAKS, found["probes"].items())
    if found["joints"]:
        yield PlainTable(
            f"joint_forces_{stem}",
            ("joint", "direction", "largest force on the first end", "±", "unit", "at [s]"),
            tuple(
                (joint, direction, force["force"], force["error"], force["unit"], force["force_s"])
                for joint, directions in found["joints"].items()
                for direction, force in directions.items()
            ),
        )
