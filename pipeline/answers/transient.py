"""Motion under loads over time as results: the types, and how they read in ``summary.json`` and
``results.h5``.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.answers.motion_forces import (
    FORCE_KEYS,
    DriveExtremes,
    ProbeMotion,
    ProbeTrace,
    list_forces,
    summarise_drives,
    summarise_joints,
)
from headstock.pipeline.answers.path import deviation_unit
from headstock.pipeline.numbers.estimates import Estimate, list_left_out, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, Series, make_key
from headstock.pipeline.storage.json_texts import check_finite
from headstock.scene.scene import Motors
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.state_spaces.transient import EnergyBalance, TransientFigures
from headstock.solvers.watched_outputs import Extreme

TRUNCATION = "modes above the range"


@dataclass(frozen=True, eq=False)
class TransientCurves:
    """What is tabled and drawn of a pose.

    Attributes:
        times: ``(n,)`` of the samples [s].
        displacements: ``(n, n_outputs)`` [m, rad].
        load_values: ``(n, n_loads)`` forces, moments, or factors of static loads; impulses are not
            in them.
        drives: Names of the drives under control.
        torques: ``(n, d)`` of their motors [N m].
        position_errors: ``(n, d)`` set less measured position [m].
    """

    pose: str
    outputs: tuple[Channel, ...]
    times: FloatArray
    displacements: FloatArray
    loads: tuple[str, ...]
    units: tuple[str, ...]
    load_values: FloatArray
    drives: tuple[str, ...]
    torques: FloatArray
    position_errors: FloatArray
    probes: tuple[ProbeTrace, ...] = ()


@dataclass(frozen=True, eq=False)
class TransientAnswer(Answer):
    """Motion in a pose.

    Attributes:
        curves: What is tabled and drawn.
        acts_on: What each load acts on, in words.
        sizes: Largest value of each load, impulses among them.
        duration: [s].
        up_to_hz: Modes up to here vibrate.
        modes: How many these are.
        settled: Share of its way within which an output has settled.
        energy: Its balance; None of a system without modes, and under control where nothing rubs.
        motors: Locked, or under control.
        drives: What each drive under control did at most.
        joints: Largest force on the first end of each joint, by direction, in joint axes.
        probes: What each probe saw at most.
    """

    curves: TransientCurves
    figures: tuple[TransientFigures, ...]
    acts_on: tuple[str, ...]
    shapes: tuple[str, ...]
    sizes: tuple[float, ...]
    duration: float
    sampling_hz: float
    up_to_hz: float
    modes: int
    settled: float
    damped: bool
    energy: EnergyBalance | None
    motors: Motors
    drives: dict[str, DriveExtremes]
    joints: dict[str, dict[str, Extreme]]
    probes: dict[str, ProbeMotion]
    units: ClassVar[dict[str, str]] = {
        r"transient/.*/(outputs|loads|units|drives)": "",
        r"transient/.*/times": "s",
        r"transient/.*/displacements": "SI: m or rad, by outputs",
        r"transient/.*/probes/.*/displacement": "m",
        r"transient/.*/probes/.*/stress": "Pa",
        r"transient/.*/load_values": "SI: by units",
        r"transient/.*/torques": "N m",
        r"transient/.*/position_errors": "m",
    }
    entry: ClassVar[str] = "transient"
    keys: ClassVar[
        str
    ] = f"""transient.*(duration_s sampling_hz up_to_hz modes settled_within damped
        motors loads.*.* outputs.*(dof[] unit peak peak_s start final overshoot settling_s error
        error_share.*) energy.* error_left_out[] {FORCE_KEYS})"""

    @property
    def place(self) -> str:
        """Its pose or point."""
        return self.curves.pose

    def list_numbers(self) -> Iterator[Number]:
        """Yield figures of every output, then what drives, joints and probes took at most."""
        pose = self.curves.pose
        for channel, figures in zip(self.curves.outputs, self.figures, strict=True):
            at = {"pose": pose, "output": name_channel(channel)}
            unit = "rad" if channel[1].startswith("r") else "m"
            for figure in ("peak", "start", "final"):
                if (value := getattr(figures, figure)) is not None:
                    key = make_key("time_deviation", figure=figure, **at)
                    yield Number(key, value, unit, self.errors.get(key))
            settling = np.nan if figures.settling is None else figures.settling
            yield Number(make_key("settling_time", **at), settling, "s")
        yield from list_forces(self.drives, self.joints, self.probes, pose=pose)

    def list_series(self) -> Iterator[Series]:
        """Yield the motion of every output over time."""
        curves = self.curves
        for number, channel in enumerate(curves.outputs):
            yield Series(
                f"displacement(pose={curves.pose},output={name_channel(channel)})",
                {"time [s]": curves.times},
                curves.displacements[:, number],
                "rad" if channel[1].startswith("r") else "m",
            )

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``; the curves are in ``results.h5`` and ``tables/``.

        Raises:
            AccuracyError: A displacement is not a finite number.
        """
        pose = self.curves.pose
        check_finite(f"transient analysis in pose {pose}", self.curves.displacements.ravel())
        return {
            "duration_s": self.duration,
            "sampling_hz": self.sampling_hz,
            "up_to_hz": self.up_to_hz,
            "modes": self.modes,
            "settled_within": self.settled,
            "damped": self.damped,
            "motors": self.motors,
            "loads": {
                name: {"acts_on": on, "shape": shape, "unit": unit, "largest": size}
                for name, on, shape, unit, size in zip(
                    self.curves.loads,
                    self.acts_on,
                    self.shapes,
                    self.curves.units,
                    self.sizes,
                    strict=True,
                )
            },
            "outputs": {
                name_channel(channel): _summarise_output(
                    channel, figures, self.error_of(peak_key(pose, channel))
                )
                for channel, figures in zip(self.curves.outputs, self.figures, strict=True)
            },
            "energy": None
            if self.energy is None
            else {**asdict(self.energy), "error": self.energy.error},
            "error_left_out": list_left_out(self.errors.values()),
            "drives": summarise_drives(self.drives, {}, pose=pose),
            "joints": summarise_joints(self.joints, {}, pose=pose),
            "probes": {name: probe.summarise() for name, probe in self.probes.items()},
        }

    def fill(self, file: "h5py.File") -> None:
        """Write the curves."""
        group, curves = file.create_group(f"transient/{self.curves.pose}"), self.curves
        for name, texts in (
            ("outputs", [name_channel(channel) for channel in curves.outputs]),
            ("loads", list(curves.loads)),
            ("units", list(curves.units)),
            ("drives", list(curves.drives)),
        ):
            group[name] = np.char.encode(np.array(texts, dtype=str), "utf-8")
        group["times"], group["displacements"] = curves.times, curves.displacements
        group["load_values"] = curves.load_values
        group["torques"], group["position_errors"] = curves.torques, curves.position_errors
        for probe in curves.probes:
            probe.fill(group.create_group(f"probes/{probe.name}"))


def peak_key(pose: str, channel: Channel) -> Key:
    """Return the key of the peak of an output."""
    return make_key("time_deviation", pose=pose, output=name_channel(channel), figure="peak")


def _summarise_output(channel: Channel, figures: TransientFigures, error: Estimate) -> Entry:
    unit, factor = deviation_unit(channel)
    return {
        "dof": list(channel),
        "unit": unit,
        "peak": factor * figures.peak,
        "peak_s": figures.peak_time,
        "start": factor * figures.start,
        "final": None if figures.final is None else factor * figures.final,
        "overshoot": figures.overshoot,
        "settling_s": figures.settling,
        "error": scale_total(error, factor),
        "error_share": scale_shares(error, factor),
    }
