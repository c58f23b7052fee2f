"""What drives, joints and probes take while a machine moves: the types, and how they read in
``summary.json`` and ``results.h5``.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Entry
from headstock.pipeline.answers.probes import MEGA, MICRO
from headstock.pipeline.numbers.estimates import Estimate, list_left_out, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.solvers.stresses import STRESS_NAMES, largest_von_mises
from headstock.solvers.watched_outputs import Extreme

# ``_off`` and ``error`` say how far a number may be off
PROBE_KEYS = """
    component singular peak_von_mises_mpa peak_von_mises_s peak_von_mises_error_mpa
    peak_von_mises_error_share.* peak_stress_mpa.* peak_displacement_um peak_displacement_s
    peak_displacement_error_um error_left_out[]"""
FORCE_KEYS = f"""
    drives.*(torque_nm torque_s torque_off_nm position_error_um position_error_s position_error_off_um)
    joints.*.*(unit force force_s error) probes.*({PROBE_KEYS})"""


@dataclass(frozen=True, eq=False)
class ProbeTrace:
    """What is tabled and drawn of a probe.

    Attributes:
        displacement: ``(n, 3)`` at the samples, machine axes [m].
        stress: ``(n, 6)`` xx yy zz xy xz yz [Pa].
    """

    name: str
    displacement: FloatArray
    stress: FloatArray

    @property
    def von_mises(self) -> FloatArray:
        """``(n,)`` [Pa]."""
        return largest_von_mises(self.stress)

    def fill(self, group: h5py.Group) -> None:
        """Write the curves."""
        group["displacement"], group["stress"] = self.displacement, self.stress


@dataclass(frozen=True, eq=False)
class ProbeMotion:
    """Response at a probe.

    Attributes:
        von_mises: The largest equivalent stress [Pa].
        stress: ``(6,)`` then [Pa].
        displacement: The largest size of the displacement [m].
        von_mises_error: Of the largest equivalent stress by the mesh around it [Pa].
        displacement_error: The same of the largest displacement [m].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    component: str
    trace: ProbeTrace
    von_mises: Extreme
    stress: FloatArray
    displacement: Extreme
    von_mises_error: Estimate
    displacement_error: Estimate
    singular: str = ""

    def thin(self, some: NDArray[np.intp]) -> "ProbeMotion":
        """With some of the samples."""
        own = self.trace
        trace = ProbeTrace(own.name, own.displacement[some], own.stress[some])
        return dataclasses.replace(self, trace=trace)

    def summarise(self, errors: Mapping[Key, Estimate] | None = None, **at: str) -> Entry:
        """Return it as it stands in ``summary.json``.

        Args:
            errors: ± of its numbers by all sources; None for what the mesh around it leaves out.
            at: Roles of their keys: feed and probe.
        """
        mises, moved = self.von_mises_error, self.displacement_error
        if errors is not None:
            mises = errors.get(make_key("peak_stress", **at), Estimate())
            moved = errors.get(make_key("peak_displacement", **at), Estimate())
        return {
            "component": self.component,
            "singular": self.singular,
            "peak_von_mises_mpa": MEGA * self.von_mises.value,
            "peak_von_mises_s": self.von_mises.time,
            "peak_von_mises_error_mpa": scale_total(mises, MEGA),
            "peak_von_mises_error_share": scale_shares(mises, MEGA),
            "peak_stress_mpa": {
                name: MEGA * float(value)
                for name, value in zip(STRESS_NAMES, self.stress, strict=True)
            },
            "peak_displacement_um": MICRO * self.displacement.value,
            "peak_displacement_s": self.displacement.time,
            "peak_displacement_error_um": scale_total(moved, MICRO),
            "error_left_out": list_left_out([mises, moved]),
        }


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
) -> dict[str, Entry]:
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
) -> dict[str, dict[str, Entry]]:
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
