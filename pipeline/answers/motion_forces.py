"""What drives and joints take while a machine moves: the types, and how they read in
``summary.json``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.estimates import Estimate
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.solvers.watched_outputs import Extreme


class DriveForceSummary(TypedDict):
    """The entry of a drive: largest torque of its motor, and largest set less measured position;
    ``_off`` how far they may be off.
    """

    torque_nm: float
    torque_s: float
    torque_off_nm: float | None
    position_error_um: float
    position_error_s: float
    position_error_off_um: float | None


class JointForceSummary(TypedDict):
    """The entry of a direction of a joint: its largest force, or moment, on the first end, and how
    far it may be off.
    """

    unit: str
    force: float
    force_s: float
    error: float | None


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


def summarise_drives(
    drives: Mapping[str, DriveExtremes],
    torques: Mapping[str, Estimate],
    followed: Mapping[str, Estimate],
) -> dict[str, DriveForceSummary]:
    """Drives by name as they stand in ``summary.json``.

    Args:
        drives: What they did.
        torques: How far their torques may be off [N m]; none where nobody says.
        followed: The same of their position errors [m].
    """
    return {
        name: {
            "torque_nm": found.torque.value,
            "torque_s": found.torque.time,
            "torque_off_nm": torques.get(name, Estimate()).total,
            "position_error_um": 1e6 * found.position_error.value,
            "position_error_s": found.position_error.time,
            "position_error_off_um": None
            if (off := followed.get(name, Estimate()).total) is None
            else 1e6 * off,
        }
        for name, found in drives.items()
    }


def summarise_joints(
    joints: Mapping[str, Mapping[str, Extreme]],
    errors: Mapping[str, Mapping[str, Estimate]],
) -> dict[str, dict[str, JointForceSummary]]:
    """Joints by name, and their directions, as they stand in ``summary.json``.

    Args:
        joints: Their forces.
        errors: How far these may be off [N, N m]; none where nobody says.
    """
    return {
        name: {
            direction: {
                "unit": "N m" if direction.startswith("r") else "N",
                "force": found.value,
                "force_s": found.time,
                "error": errors.get(name, {}).get(direction, Estimate()).total,
            }
            for direction, found in directions.items()
        }
        for name, directions in joints.items()
    }
