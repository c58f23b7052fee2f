"""What drives and joints take while a machine moves: the types, and how they read in
``summary.json``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.solvers.watched_outputs import Extreme


class DriveForceSummary(TypedDict):
    """The entry of a drive: largest torque of its motor, and largest set less measured position."""

    torque_nm: float
    torque_s: float
    position_error_um: float
    position_error_s: float


class JointForceSummary(TypedDict):
    """The entry of a direction of a joint: its largest force, or moment, on the first end."""

    unit: str
    force: float
    force_s: float


@dataclass(frozen=True)
class DriveExtremes:
    """What a drive did at most.

    Attributes:
        torque: Of its motor [N m].
        position_error: Set less measured position [m].
    """

    torque: Extreme
    position_error: Extreme


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """What drives under control did.

    Attributes:
        extremes: By drive.
        torques: ``(n, d)`` of motors at every time [N m].
        position_errors: ``(n, d)`` [m].
    """

    extremes: dict[str, DriveExtremes]
    torques: FloatArray
    position_errors: FloatArray


@dataclass(frozen=True, eq=False)
class PathForces:
    """What drives and joints took along a path.

    Attributes:
        drives: Under control.
        joints: Largest force on the first end of each joint, by direction, in joint axes.
        probes: Displacement and stress at probes.
    """

    drives: DriveHistory
    joints: dict[str, dict[str, Extreme]]
    probes: dict[str, ProbeMotion] = field(default_factory=dict)


def summarise_drives(drives: Mapping[str, DriveExtremes]) -> dict[str, DriveForceSummary]:
    """Drives by name as they stand in ``summary.json``."""
    return {
        name: {
            "torque_nm": found.torque.value,
            "torque_s": found.torque.time,
            "position_error_um": 1e6 * found.position_error.value,
            "position_error_s": found.position_error.time,
        }
        for name, found in drives.items()
    }


def summarise_joints(
    joints: Mapping[str, Mapping[str, Extreme]],
) -> dict[str, dict[str, JointForceSummary]]:
    """Joints by name, and their directions, as they stand in ``summary.json``."""
    return {
        name: {
            direction: {
                "unit": "N m" if direction.startswith("r") else "N",
                "force": found.value,
                "force_s": found.time,
            }
            for direction, found in directions.items()
        }
        for name, directions in joints.items()
    }
