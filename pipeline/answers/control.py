"""Loops of drives closed around the machine, as results: poles, and the figures of each drive."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.margins import LoopMargins
from headstock.solvers.control.sampled_loops import SamplingDifference

UM = 1e6
MARGIN_UNITS = {
    "gain": "1",
    "gain_hz": "Hz",
    "phase_deg": "deg",
    "phase_hz": "Hz",
    "sensitivity": "1",
    "bandwidth_hz": "Hz",
    "resonance": "1",
}
MARGINS = (  # as ``LoopMargins`` has them
    *("gain", "gain_hz", "lowest_gain", "phase_deg", "phase_hz", "sensitivity", "sensitivity_hz"),
    *("bandwidth_hz", "resonance"),
)


@dataclass(frozen=True)
class ClosedLoopPole:
    """A pole of the closed loops.

    Attributes:
        pole: [rad/s].
        frequency_hz: Of its oscillation [Hz]; zero without any.
        damping_ratio: Negative where it grows.
    """

    pole: complex
    frequency_hz: float
    damping_ratio: float
    drive: str
    name: str

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        return {
            "frequency_hz": self.frequency_hz,
            "damping_ratio": self.damping_ratio,
            "real": self.pole.real,
            "imag": self.pole.imag,
            "drive": self.drive,
            "name": self.name,
        }


@dataclass(frozen=True)
class GuardFrequency:
    """A natural frequency that the motor of a drive excites and measures, to be kept out of its loop.

    Attributes:
        mode: Among those of its drive, followed over all poses, from the highest resonance down.
        positions: Of each axis in the pose [m, rad].
        frequency_hz: With the motors free [Hz].
        damping_ratio: Of the mode, without control.
        height: Of the resonance over the response of the rigid machine [-]; None without damping.
        name: What moves: the mode named by its energies where its resonance is highest.
    """

    drive: str
    mode: int
    pose: str
    positions: Mapping[str, float]
    frequency_hz: float
    damping_ratio: float
    height: float | None
    name: str


@dataclass(frozen=True)
class GuardBand:
    """A mode that a drive has to keep out of its loop, over all poses in which it is.

    Attributes:
        poses: How many.
        without_error: In how many of them no ± is known.
        from_hz: The lowest frequency less its ± [Hz].
        to_hz: The highest one and its ± [Hz].
        damping_ratio: The largest.
        height: The largest; None without damping.
    """

    drive: str
    mode: int
    poses: int
    without_error: int
    lowest_hz: float
    highest_hz: float
    from_hz: float
    to_hz: float
    damping_ratio: float
    height: float | None
    name: str


@dataclass(frozen=True, eq=False)
class GuardAnswer(Answer):
    """Frequencies to guard, modes followed from pose to pose.

    Attributes:
        over: Name of the sweep; empty for the poses of the analysis.
        guards: Of one mode of a drive together, the highest resonance of a drive first.
        left_out: Poses that the machine does not reach.
    """

    over: str
    guards: tuple[GuardFrequency, ...]
    left_out: tuple[str, ...] = ()
    entry: ClassVar[str] = "guards"
    keys: ClassVar[str] = """guards(over left_out[] bands[](drive mode poses without_error lowest_hz
        highest_hz from_hz to_hz damping_ratio height name))"""

    def guard_key(self, guard: GuardFrequency) -> Key:
        """Return the key of a frequency to guard."""
        return make_key("guard_frequency", pose=guard.pose, drive=guard.drive, mode=guard.mode)

    @property
    def bands(self) -> list[GuardBand]:
        """Return a band for each mode."""
        modes = dict.fromkeys((guard.drive, guard.mode) for guard in self.guards)
        return [
            self._find_band([one for one in self.guards if (one.drive, one.mode) == mode])
            for mode in modes
        ]

    def _find_band(self, guards: Sequence[GuardFrequency]) -> GuardBand:
        hz = [guard.frequency_hz for guard in guards]
        errors = [self.error_of(self.guard_key(guard)).total for guard in guards]
        heights = [guard.height for guard in guards if guard.height is not None]
        return GuardBand(
            guards[0].drive,
            guards[0].mode,
            len(guards),
            errors.count(None),
            min(hz),
            max(hz),
            min(one - (error or 0.0) for one, error in zip(hz, errors, strict=True)),
            max(one + (error or 0.0) for one, error in zip(hz, errors, strict=True)),
            max(guard.damping_ratio for guard in guards),
            max(heights) if len(heights) == len(guards) else None,
            guards[0].name,
        )

    def list_numbers(self) -> Iterator[Number]:
        """Yield every frequency, and the ends of each band with ±."""
        for guard in self.guards:
            key = self.guard_key(guard)
            yield Number(key, guard.frequency_hz, "Hz", self.errors.get(key))
        for band in self.bands:
            for figure, hz in (("from", band.from_hz), ("to", band.to_hz)):
                key = make_key("guard_band", drive=band.drive, mode=band.mode, figure=figure)
                yield Number(key, hz, "Hz")

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``: a row per mode; those of each pose are in the table."""
        bands = [dataclasses.asdict(band) for band in self.bands]
        return {"over": self.over, "left_out": list(self.left_out), "bands": bands}


@dataclass(frozen=True, eq=False)
class ClosedLoopDrive:
    """A drive in its closed loop.

    Attributes:
        train: Of motor, screw and table.
        velocity_lag: Behind a set point of constant speed [m].
    """

    train: DriveTrain
    margins: LoopMargins
    velocity_lag: float

    @property
    def motor_mass(self) -> float:
        """Of motor and screw, as the table feels it [kg]."""
        return self.train.motor_mass + self.train.screw_mass

    def summarise(self, *, stable: bool) -> Entry:
        """As it stands in ``summary.json``; ``stable`` says that lag and margins mean something."""
        train, control = self.train, self.train.control
        return {
            "axis": train.axis,
            "encoder": control.encoder,
            "kv_per_s": control.position_gain,
            "velocity_gain_n_s_per_m": control.velocity_gain,
            "dead_time_s": control.dead_time,
            "motor_mass_kg": self.motor_mass,
            "velocity_lag_um": self.velocity_lag * UM if stable else None,
            "margins": {name: getattr(self.margins, name) for name in MARGINS} if stable else None,
        }


@dataclass(frozen=True, eq=False)
class ControlAnswer(Answer):
    """Closed loops in a pose.

    Attributes:
        up_to_hz: Poles are listed up to here [Hz].
        speed: Of the set point that axes lag behind [m/s].
        verdict: Why the loops are unstable, in plain words; empty when they are not.
        sampled: How far the poles are from those of the sampled loops; None of continuous controllers.
    """

    pose: str
    up_to_hz: float
    speed: float
    poles: tuple[ClosedLoopPole, ...]
    drives: tuple[ClosedLoopDrive, ...]
    verdict: str = ""
    sampled: SamplingDifference | None = None
    entry: ClassVar[str] = "control"
    keys: ClassVar[str] = """control.*(up_to_hz speed_m_per_s stable verdict
        poles[](frequency_hz damping_ratio real imag drive name)
        drives.*(axis encoder kv_per_s velocity_gain_n_s_per_m dead_time_s motor_mass_kg
        velocity_lag_um margins.*)
        sampled.(share hz up_to_hz stable))"""

    def list_numbers(self) -> Iterator[Number]:
        """Yield the poles and, of stable loops, lag and margins of each drive."""
        for number, pole in enumerate(self.poles, 1):
            at: dict[str, str | int] = {"pose": self.pose, "pole": number}
            yield Number(make_key("pole_frequency", **at), pole.frequency_hz, "Hz")
            yield Number(make_key("pole_damping", **at), pole.damping_ratio, "1")
        for drive in () if self.verdict else self.drives:
            at = {"pose": self.pose, "drive": drive.train.name}
            unit = "rad" if drive.train.rotary else "m"
            yield Number(make_key("velocity_lag", **at), drive.velocity_lag, unit)
            for figure, unit in MARGIN_UNITS.items():
                if (value := getattr(drive.margins, figure)) is not None:
                    yield Number(make_key("loop_margin", figure=figure, **at), value, unit)

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        summary: Entry = {
            "up_to_hz": self.up_to_hz,
            "speed_m_per_s": self.speed,
            "stable": not self.verdict,
            "poles": [pole.summarise() for pole in self.poles],
            "drives": {
                drive.train.name: drive.summarise(stable=not self.verdict) for drive in self.drives
            },
        }
        if self.sampled is not None:
            summary["sampled"] = dataclasses.asdict(self.sampled)
        if self.verdict:
            summary["verdict"] = self.verdict
        return summary
