"""Natural modes as results: the type, and how it reads in ``summary.json`` and ``results.h5``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Pose
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.estimates import Estimate, list_left_out, scale_parts
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.storage.json_texts import check_finite

type ModeKind = Literal["frequency", "damping_ratio", "damped_frequency"]
FREQUENCY: ModeKind = "frequency"
DAMPING_RATIO: ModeKind = "damping_ratio"
DAMPED_FREQUENCY: ModeKind = "damped_frequency"


@dataclass(frozen=True, eq=False)
class PoseModes(Answer):
    """Natural modes of vibration in one pose.

    Attributes:
        frequencies_hz: ``(m,)``, rigid-body modes first.
        rigid_count: How many of them are rigid-body modes.
        damping_ratio: Of each; None without damping.
        damped_hz: Frequency of the damped oscillation [Hz]; zero where it is overdamped, None
            without damping.
        energy_share: Per mode, share of the strain energy per component or joint.
        kinetic_share: Per mode, share of the kinetic energy per component.
        shapes: ``(n, m)`` mass-normalised, over the dofs of all superelements in the order of
            ``labels``.
        pose_units: Axis to the unit of its position, ``m`` or ``rad``.
        placements: Frame of each component in the machine in this pose.
        spread_hz: Lowest and highest frequency of each mode with every interface averaging and
            rigid [Hz]; None where it has no partner, empty where none was requested.
        below: How many modes lie below the window of frequencies, rigid-body modes among them; the
            first one listed is number ``below + 1``.
        damping_from: What the damping ratios add up from; empty without damping.
        sensors: Names of sensors and point masses.
        sensor_shapes: ``(m, s, 3)`` motion of the shapes there along machine axes; None without.
    """

    pose: Pose
    frequencies_hz: FloatArray
    rigid_count: int
    damping_ratio: tuple[float | None, ...]
    mode_names: tuple[str, ...]
    energy_share: tuple[dict[str, float], ...]
    kinetic_share: tuple[dict[str, float], ...]
    shapes: FloatArray
    damped_hz: tuple[float | None, ...] = ()
    pose_units: dict[str, str] = field(default_factory=dict)
    placements: dict[str, Frame] = field(default_factory=dict)
    spread_hz: tuple[tuple[float, float] | None, ...] = ()
    below: int = 0
    damping_from: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    sensor_shapes: FloatArray | None = None
    units: ClassVar[dict[str, str]] = {
        r"modal/.*/names": "",
        r"modal/.*/frequencies_hz": "Hz",
        r"modal/.*/shapes": "SI: m or rad per sqrt(kg), by labels",
        r"modal/.*/sensors": "",
        r"modal/.*/sensor_shapes": "SI: m per sqrt(kg), modes x sensors x machine axes",
        r"modal/.*/origin": "m",
        r"modal/.*/rotation": "1",
    }
    entry: ClassVar[str] = "modal"
    keys: ClassVar[str] = """modal[](pose_name pose.* pose_units.* frequencies_hz[] rigid_count
        error_hz[] error_share[].* error_parts[].*.* error_left_out[] damping_ratio[] damping_error[]
        damped_hz[] damped_error_hz[] mode_names[] energy_share[].* kinetic_share[].*
        interface_spread_hz[][] modes_below damping_from[])"""

    @classmethod
    def gather(cls, answers: Sequence[Self]) -> dict[str, object]:
        """Return the modes of every pose as a list."""
        return {"modal": [answer.summarise() for answer in answers]}

    def key(self, kind: ModeKind, index: int) -> Key:
        """Return the key of a number of a mode, by its index in the arrays."""
        return make_key(kind, pose=self.pose.name, mode=self.below + index + 1)

    def list_errors(self, kind: ModeKind = "frequency") -> tuple[Estimate, ...]:
        """Return the ± of a number of every mode; an overdamped frequency is zero for certain."""
        count = range(len(self.frequencies_hz))
        return tuple(self.error_of(self.key(kind, index)) for index in count)

    @property
    def error_hz(self) -> tuple[float | None, ...]:
        """± of each frequency, all sources together; None where there is no estimate."""
        return tuple(error.total for error in self.list_errors())

    def list_numbers(self) -> Iterator[Number]:
        """Yield frequencies and, with damping, ratios and damped frequencies, rigid-body modes first."""
        for index, hz in enumerate(self.frequencies_hz):
            for kind, unit, value in (
                (FREQUENCY, "Hz", float(hz)),
                (DAMPING_RATIO, "1", self.damping_ratio[index]),
                (DAMPED_FREQUENCY, "Hz", self.damped_hz[index] if self.damped_hz else None),
            ):
                if value is not None:
                    key = self.key(kind, index)
                    yield Number(key, value, unit, self.errors.get(key))

    def summarise(self) -> Entry:
        """As they stand in ``summary.json``.

        Raises:
            AccuracyError: A frequency is not a finite number.
        """
        errors = self.list_errors()
        summary: Entry = {
            "pose_name": self.pose.name,
            "pose": dict(self.pose.positions),
            "pose_units": {
                axis: self.pose_units[axis]
                for axis in self.pose.positions
                if axis in self.pose_units
            },
            "frequencies_hz": check_finite(
                f"modal analysis in pose {self.pose.name}", self.frequencies_hz
            ),
            "rigid_count": self.rigid_count,
            "error_hz": list(self.error_hz),
            "error_share": [dict(error.shares) for error in errors],
            "error_parts": [scale_parts(error) for error in errors],
            "error_left_out": list_left_out(errors),
            "damping_ratio": list(self.damping_ratio),
            "damping_error": [error.total for error in self.list_errors(DAMPING_RATIO)],
            "damped_hz": list(self.damped_hz),
            "damped_error_hz": [error.total for error in self.list_errors(DAMPED_FREQUENCY)],
            "mode_names": list(self.mode_names),
            "energy_share": list(self.energy_share),
            "kinetic_share": list(self.kinetic_share),
        }
        if self.spread_hz:
            summary["interface_spread_hz"] = list(self.spread_hz)
        if self.below:
            summary["modes_below"] = self.below
        if self.damping_from:
            summary["damping_from"] = list(self.damping_from)
        return summary

    def fill(self, file: "h5py.File") -> None:
        """Write frequencies, shapes and where the components are."""
        group = file.create_group(f"modal/{self.pose.name}")
        group["frequencies_hz"] = check_finite("natural frequencies", self.frequencies_hz)
        group["shapes"] = self.shapes
        group.attrs["rigid_count"], group.attrs["below"] = self.rigid_count, self.below
        group["names"] = np.char.encode(np.array(self.mode_names, dtype=str), "utf-8")
        if self.sensor_shapes is not None:
            group["sensor_shapes"] = self.sensor_shapes
            group["sensors"] = np.char.encode(np.array(self.sensors, dtype=str), "utf-8")
        pose, units = group.create_group("pose"), group.create_group("pose_units")
        for axis, position in self.pose.positions.items():
            pose.attrs[axis] = position
            units.attrs[axis] = self.pose_units.get(axis, "")
        for name, frame in self.placements.items():
            group[f"placements/{name}/origin"] = frame.origin
            group[f"placements/{name}/rotation"] = frame.rotation
