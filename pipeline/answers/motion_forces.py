"""What drives and joints take while a machine moves: the types, and how they read in
``summary.json``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypedDict

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.numbers.estimates import Estimate, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, make_key
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
        joints: Largest force on the first end of each joint, by direction, in joint axes.
    """

    drives: DriveHistory
    joints: dict[str, dict[str, Extreme]]
    probes: dict[str, ProbeMotion] = field(default_factory=dict)


def list_forces(
    drives: Mapping[str, DriveExtremes],
    joints: Mapping[str, Mapping[str, Extreme]],
    probes: Mapping[str, ProbeMotion],
    **at: str,
) -> Iterator[Number]:
    """Yield torques, position errors, joint forces and extremes at probes, without ±.

    Args:
        probes: By name; with what their own meshes leave out in ±.
        at: Roles of the keys: pose or feed.
    """
    for name, own in drives.items():
        yield Number(make_key("motor_torque", drive=name, **at), own.torque.value, "N m")
        key = make_key("position_error", drive=name, **at)
        yield Number(key, own.position_error.value, "m")
    for name, directions in joints.items():
        for direction, force in directions.items():
            unit = "N m" if direction.startswith("r") else "N"
            key = make_key("joint_force", joint=name, direction=direction, **at)
            yield Number(key, force.value, unit)
    for name, probe in probes.items():
        key = make_key("peak_stress", probe=name, **at)
        yield Number(key, probe.von_mises.value, "Pa", probe.von_mises_error)
        key = make_key("peak_displacement", probe=name, **at)
        yield Number(key, probe.displacement.value, "m", probe.displacement_error)


def summarise_drives(
    drives: Mapping[str, DriveExtremes], errors: Mapping[Key, Estimate], **at: str
) -> dict[str, DriveForceSummary]:
    """Return drives by name as they stand in ``summary.json``.

    Args:
        drives: What they did.
        at: Roles of their keys: pose or feed.
    """

    def find_total(kind: str, name: str, factor: float = 1.0) -> float | None:
        return scale_total(errors.get(make_key(kind, drive=name, **at)), factor)

    return {
        name: {
            "torque_nm": found.torque.value,
            "torque_s": found.torque.time,
            "torque_off_nm": find_total("motor_torque", name),
            "position_error_um": 1e6 * found.position_error.value,
            "position_error_s": found.position_error.time,
            "position_error_off_um": find_total("position_error", name, 1e6),
        }
        for name, found in drives.items()
    }


def summarise_joints(
    joints: Mapping[str, Mapping[str, Extreme]], errors: Mapping[Key, Estimate], **at: str
) -> dict[str, dict[str, JointForceSummary]]:
    """Return joints by name, and their directions, as they stand in ``summary.json``.

    Args:
        errors: ± of numbers [N, N m].
        at: Roles of their keys: pose or feed.
    """
    return {
        name: {
            direction: {
                "unit": "N m" if direction.startswith("r") else "N",
                "force": found.value,
                "force_s": found.time,
                "error": scale_total(
                    errors.get(make_key("joint_force", joint=name, direction=direction, **at))
                ),
            }
            for direction, found in directions.items()
        }
        for name, directions in joints.items()
    }
