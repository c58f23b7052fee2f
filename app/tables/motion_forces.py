"""Rows of what drives and joints take while a machine moves."""

from collections.abc import Mapping
from typing import Literal

from headstock.app.tables.table import Cell, Column, PlainTable
from headstock.pipeline.answers.motion_forces import DriveForceSummary, JointForceSummary

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


def tabulate_joint_forces(name: str, joints: Mapping[str, JointForces]) -> PlainTable:
    """A row per joint and direction."""
    return PlainTable(
        name,
        ("joint", "direction", "largest force on the first end", "±", "unit", "at [s]"),
        tuple(
            (joint, direction, found["force"], found["error"], found["unit"], found["force_s"])
            for joint, directions in joints.items()
            for direction, found in directions.items()
        ),
    )
