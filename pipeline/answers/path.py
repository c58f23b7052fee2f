"""Deviations from a path as results: the types, and how they read in ``summary.json`` and
``results.h5``.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
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
from headstock.pipeline.numbers.estimates import Estimate, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Number, Series, make_key
from headstock.solvers.motion.deviation import CruiseFigures, PathDeviation, ZoneFigures
from headstock.solvers.motion.set_points import show_feed
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.watched_outputs import Extreme

_PARTS = ("total", "quasi_static", "low_frequency", "dynamic")
SIZES = ("peak", "span", "ramp_peak", "ramp_span", "quasi_static", "dynamic", "rms")
ZONES = ("accelerating", "decelerating")
CRUISE = ("variation", "straightness", "amplitude")
# ``peak_um`` or ``peak_urad`` and so on, ``settling_s`` without a value where it never settles
type ZoneSummary = dict[str, float | None]


@dataclass(frozen=True, eq=False)
class PathCurves:
    """What is tabled and drawn of a move at one feed.

    Attributes:
        feed: [m/s, rad/s].
        zones: Beginning and end of both ramps [s].
        frozen: ``(n, n_outputs)`` deviation if the pose stayed that of the middle, as filtered.
        positions: ``(n,)`` set point along the path [m, rad].
        accelerations: ``(n,)`` of the set point [m/s^2, rad/s^2].
        drives: Names of the drives under control.
        torques: ``(n, d)`` of their motors, not filtered [N m].
        position_errors: ``(n, d)`` set less measured position, not filtered [m].
        probes: Displacement and stress at probes, not filtered, in the pose of the middle.
        unit: Of positions, ``m`` or ``rad``.
    """

    feed: float
    zones: tuple[tuple[float, float], tuple[float, float]]
    outputs: tuple[Channel, ...]
    deviation: PathDeviation
    frozen: FloatArray
    positions: FloatArray
    accelerations: FloatArray
    drives: tuple[str, ...]
    torques: FloatArray
    position_errors: FloatArray
    probes: tuple[ProbeTrace, ...] = ()
    unit: str = "m"

    @property
    def name(self) -> str:
        """``3000 mm/min`` or ``90 deg/min``."""
        return show_feed(self.feed, self.unit)


@dataclass(frozen=True, eq=False)
class PathRun:
    """A move at one feed.

    Attributes:
        curves: What is tabled and drawn.
        figures: Of every output, in both zones.
        frozen_figures: The same if the pose stayed that of the middle.
        drives: What each drive under control did at most.
        joints: Largest force on the first end of each joint, by direction, in joint axes.
        probes: What each probe saw at most, in the pose of the middle.
        cruises: Of every output at constant feed; empty without errors of guides.
    """

    curves: PathCurves
    figures: tuple[tuple[ZoneFigures, ZoneFigures], ...]
    frozen_figures: tuple[tuple[ZoneFigures, ZoneFigures], ...]
    drives: dict[str, DriveExtremes]
    joints: dict[str, dict[str, Extreme]]
    probes: dict[str, ProbeMotion]
    cruises: tuple[CruiseFigures | None, ...] = ()


@dataclass(frozen=True)
class FollowedPoses:
    """How the poses of a path were followed.

    Attributes:
        sampled_poses: Poses in which the machine was coupled.
        error: Largest error of what was interpolated between all but the last of them; 1/16 of it
            between all.
        rotation_error: What carrying modes along without the last of them would have turned them by
            [rad].
        modes: How many were followed.
        next_hz: Lowest frequency of a mode that was not [Hz]; None where all were.
        steps: Places between which the steps in time are interpolated.
        truncation: Largest difference that leaving out higher modes makes in the middle pose, over
            the largest deviation.
        effect: Largest difference from the deviation in the frozen pose, one per feed [m, rad].
    """

    sampled_poses: int
    error: float
    rotation_error: float
    modes: int
    next_hz: float | None
    steps: int
    truncation: float
    effect: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class PathResult(Answer):
    """A path analysis.

    Attributes:
        start: Axis positions where it begins [m].
        end: Axis positions where it ends [m].
        length: Of the way [m, rad].
        ramp: How the feed is reached.
        time_constant: [s].
        lowpass_hz: Of the filter; None without one.
        low_frequency_limit_hz: Modes below count as rigid-body (low-frequency) response.
        low_frequency_modes: How many these are.
        poses: How the poses were followed; None where that of the middle was enough.
        runs: One per feed.
        unit: Of the way, ``m``, or ``rad`` where only rotary axes move.
        drives: Drives under control; empty where motors follow their set points.
        energy_error: By feed, error of the energy balance relative to its largest part; where
            friction acts.
        left_out: What is not in the ± of its numbers.
    """

    start: dict[str, float]
    end: dict[str, float]
    length: float
    ramp: str
    time_constant: float
    sampling_hz: float
    lowpass_hz: float | None
    filter: str
    damped: bool
    low_frequency_limit_hz: float
    low_frequency_modes: int
    poses: FollowedPoses | None
    runs: tuple[PathRun, ...]
    left_out: tuple[str, ...] = ()
    unit: str = "m"
    drives: tuple[str, ...] = ()
    energy_error: dict[str, float] = field(default_factory=dict)
    units: ClassVar[dict[str, str]] = {
        r"path/.*/(inputs|outputs|drives)": "",
        r"path/.*/torques": "N m",
        r"path/.*/probes/.*/displacement": "m",
        r"path/.*/probes/.*/stress": "Pa",
        r"path/.*/position_errors": "m",
        r"path/.*/times": "s",
        r"path/.*/positions": "m",
        r"path/.*/accelerations": "m/s^2",
        r"path/.*": "SI: m or rad, by outputs",
    }
    entry: ClassVar[str] = "path"
    keys: ClassVar[
        str
    ] = f"""path(start.* end.* length unit ramp time_constant sampling_hz lowpass_hz
        filter damped low_frequency_limit_hz low_frequency_modes drives[] energy_error.* poses.*.**
        feeds[](name feed_mm_per_min feed_deg_per_min acceleration
        outputs[](dof[] accelerating.* decelerating.* cruising(begin_s end_s variation_um straightness_um
        period_s period_mm period_deg amplitude_um) errors.*.* error_share.*.*) {FORCE_KEYS})
        error_left_out[])"""

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``; the curves are in ``results.h5`` and ``tables/``."""
        return {
            "start": self.start,
            "end": self.end,
            "length": self.length,
            "unit": self.unit,
            "ramp": self.ramp,
            "time_constant": self.time_constant,
            "sampling_hz": self.sampling_hz,
            "lowpass_hz": self.lowpass_hz,
            "filter": self.filter,
            "damped": self.damped,
            "low_frequency_limit_hz": self.low_frequency_limit_hz,
            "low_frequency_modes": self.low_frequency_modes,
            "drives": list(self.drives),
            "energy_error": self.energy_error,
            "poses": None if self.poses is None else asdict(self.poses),
            "feeds": [_summarise_run(self, place) for place in range(len(self.runs))],
            "error_left_out": list(self.left_out),
        }

    def find_error(self, run: PathRun, channel: Channel, zone: str, figure: str) -> Estimate:
        """Return ± of a figure of an output in a zone."""
        at = {"feed": run.curves.name, "zone": zone, "output": name_channel(channel)}
        return self.error_of(make_key("path_deviation", figure=figure, **at))

    def list_numbers(self) -> Iterator[Number]:
        """Yield deviations of each zone, torques, forces and extremes at probes of every feed."""
        for number in list_run_numbers(self.runs):
            yield replace(number, error=self.errors.get(number.key))

    def list_series(self) -> Iterator[Series]:
        """Yield the deviation of every output over time."""
        for run in self.runs:
            deviation = run.curves.deviation
            for number, channel in enumerate(run.curves.outputs):
                yield Series(
                    f"deviation(feed={run.curves.name},output={name_channel(channel)})",
                    {"time [s]": deviation.times},
                    deviation.total[:, number],
                    _unit_of(channel),
                )

    def fill(self, file: "h5py.File") -> None:
        """Write the curves of every feed, in the order of the scene."""
        feeds = file.create_group("path", track_order=True)
        for run in self.runs:
            _fill_path(feeds.create_group(run.curves.name.replace("/", " per ")), run.curves)


def list_run_numbers(runs: Iterable[PathRun]) -> Iterator[Number]:
    """Yield the numbers of runs; those at probes with what the mesh around them leaves out in ±."""
    for run in runs:
        feed = run.curves.name
        for index, (channel, zones) in enumerate(zip(run.curves.outputs, run.figures, strict=True)):
            at = {"feed": feed, "output": name_channel(channel)}
            cruise = run.cruises[index] if run.cruises else None
            for zone, figures in zip(ZONES, zones, strict=True):
                for size in SIZES:
                    key = make_key("path_deviation", zone=zone, figure=size, **at)
                    yield Number(key, getattr(figures, size), _unit_of(channel))
                settling = math.nan if figures.settling is None else figures.settling
                yield Number(make_key("settling_time", zone=zone, **at), settling, "s")
            for size in () if cruise is None else CRUISE:
                key = make_key("path_deviation", zone="cruising", figure=size, **at)
                yield Number(key, getattr(cruise, size), _unit_of(channel))
        yield from list_forces(run.drives, run.joints, run.probes, feed=feed)


def _summarise_run(answer: PathResult, place: int) -> Entry:
    run = answer.runs[place]
    feed = run.curves.name
    summary: Entry = {
        "name": feed,
        "acceleration": float(np.abs(run.curves.accelerations).max()),
        "outputs": [_summarise_output(answer, run, number) for number in range(len(run.figures))],
        "drives": summarise_drives(run.drives, answer.errors, feed=feed),
        "joints": summarise_joints(run.joints, answer.errors, feed=feed),
        "probes": {
            name: probe.summarise(answer.errors, feed=feed, probe=name)
            for name, probe in run.probes.items()
        },
    }
    if run.curves.unit == "m":
        summary["feed_mm_per_min"] = 6e4 * run.curves.feed
    else:
        summary["feed_deg_per_min"] = 60.0 * math.degrees(run.curves.feed)
    return summary


def _summarise_output(answer: PathResult, run: PathRun, number: int) -> Entry:
    channel = run.curves.outputs[number]
    zones = run.figures[number]
    frozen = run.frozen_figures[number]
    unit, factor = deviation_unit(channel)

    def find_error(zone: str, figure: str) -> Estimate:
        return answer.find_error(run, channel, zone, figure)

    summary: Entry = {
        "dof": list(channel),
        "accelerating": _summarise_zone(channel, zones[0], frozen[0]),
        "decelerating": _summarise_zone(channel, zones[1], frozen[1]),
        "errors": {
            zone: {f"{size}_{unit}": scale_total(find_error(zone, size), factor) for size in SIZES}
            for zone in ZONES
        },
        "error_share": {zone: scale_shares(find_error(zone, "peak"), factor) for zone in ZONES},
    }
    cruise = run.cruises[number] if run.cruises else None
    if cruise is not None:
        summary["cruising"] = {
            "begin_s": cruise.begin,
            "end_s": cruise.end,
            "variation_um": 1e6 * cruise.variation,
            "straightness_um": 1e6 * cruise.straightness,
            "period_s": cruise.period,
            "amplitude_um": 1e6 * cruise.amplitude,
        }
        if run.curves.unit == "m":
            summary["cruising"]["period_mm"] = 1e3 * cruise.distance
        else:
            summary["cruising"]["period_deg"] = math.degrees(cruise.distance)
        summary["errors"]["cruising"] = {
            f"{size}_um": scale_total(find_error("cruising", size), 1e6) for size in CRUISE
        }
    return summary


def _unit_of(channel: Channel) -> str:
    """Return the SI unit of a deviation."""
    return "rad" if channel[1].startswith("r") else "m"


def deviation_unit(channel: Channel) -> tuple[str, float]:
    """Unit in which a deviation is shown, and the factor from SI to it."""
    return ("urad" if channel[1].startswith("r") else "um"), 1e6


def _summarise_zone(channel: Channel, zone: ZoneFigures, frozen: ZoneFigures) -> ZoneSummary:
    unit, factor = deviation_unit(channel)
    times = {
        "begin_s": zone.begin,
        "ramp_end_s": zone.ramp_end,
        "end_s": zone.end,
        "peak_s": zone.peak_time,
    }
    found = (
        times
        | {f"{name}_{unit}": factor * getattr(zone, name) for name in SIZES}
        | {"settling_s": zone.settling}
    )
    return found | {f"frozen_peak_{unit}": factor * frozen.peak}


def _fill_path(group: h5py.Group, curves: PathCurves) -> None:
    """Write the curves of one feed, in SI."""
    group.attrs["feed"], group.attrs["zones"] = curves.feed, np.array(curves.zones)
    group.attrs["unit"] = curves.unit
    group["outputs"] = np.char.encode(
        np.array([name_channel(channel) for channel in curves.outputs]), "utf-8"
    )
    group["times"] = curves.deviation.times
    group["positions"] = curves.positions
    group["accelerations"] = curves.accelerations
    for name in _PARTS:
        group[name] = getattr(curves.deviation, name)
    group["frozen"] = curves.frozen
    group["drives"] = np.char.encode(np.array(curves.drives, dtype=str), "utf-8")
    group["torques"], group["position_errors"] = curves.torques, curves.position_errors
    for probe in curves.probes:
        probe.fill(group.create_group(f"probes/{probe.name}"))
