"""Deviations from a path as results: the types, and how they read in ``summary.json`` and
``results.h5``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, NotRequired, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.libraries import h5py
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.estimates import (
    CUTTING,
    DISCRETISATION,
    Estimate,
    combine_estimates,
    scale_shares,
)
from headstock.pipeline.answers.frf import split_channel
from headstock.pipeline.answers.motion_forces import (
    DriveExtremes,
    DriveForceSummary,
    JointForceSummary,
    summarise_drives,
    summarise_joints,
)
from headstock.pipeline.answers.probe_motions import (
    ProbeMotion,
    ProbeMotionSummary,
    ProbeTrace,
    parse_probe_trace,
)
from headstock.solvers.paths.response import CruiseFigures, PathDeviation, ZoneFigures
from headstock.solvers.paths.set_points import show_feed
from headstock.solvers.second_order import Channel, name_channel
from headstock.solvers.watched_outputs import Extreme

_PARTS = ("total", "quasi_static", "low_frequency", "dynamic")
SIZES = ("peak", "span", "ramp_peak", "ramp_span", "quasi_static", "dynamic", "rms")
ZONES = ("accelerating", "decelerating")
# What a resonance does after a ramp goes up and down as it shifts: changes by a source of error times
# this cover the true errors of 95 numbers in 100 (`validate axes-estimates`); ranges are whole widths
COVERING = 1.5
# ``peak_um`` or ``peak_urad`` and so on, ``settling_s`` without a value where it never settles
type ZoneSummary = dict[str, float | None]


class CruiseSummary(TypedDict):
    """An output at constant feed, where errors of guides act; ``um`` stands for urad, too."""

    begin_s: float
    end_s: float
    variation_um: float
    straightness_um: float
    period_s: float
    period_mm: NotRequired[float]  # as the feed
    period_deg: NotRequired[float]
    amplitude_um: float


class OutputSummary(TypedDict):
    """The entry of an output at one feed. ``errors``: how far the sizes may be off, by their names,
    of each zone; ``error_share``: that of its peak by source of error.
    """

    dof: list[str]
    accelerating: ZoneSummary
    decelerating: ZoneSummary
    cruising: NotRequired[CruiseSummary]
    errors: dict[str, ZoneSummary]
    error_share: dict[str, dict[str, float | None]]


class FeedSummary(TypedDict):
    """The entry of a feed."""

    name: str
    feed_mm_per_min: NotRequired[float]  # where a linear axis moves
    feed_deg_per_min: NotRequired[float]  # where only rotary axes do
    acceleration: float
    outputs: list[OutputSummary]
    drives: dict[str, DriveForceSummary]
    joints: dict[str, dict[str, JointForceSummary]]
    probes: dict[str, ProbeMotionSummary]


class FollowedSummary(TypedDict):
    """How the poses of a path were followed."""

    sampled_poses: int
    error: float
    rotation_error: float
    modes: int
    next_hz: float | None
    steps: int
    truncation: float
    effect: list[float]


class PathSummary(TypedDict):
    """The entry ``path``."""

    start: dict[str, float]
    end: dict[str, float]
    length: float
    unit: str
    ramp: str
    time_constant: float
    sampling_hz: float
    lowpass_hz: float | None
    filter: str
    damped: bool
    low_frequency_limit_hz: float
    low_frequency_modes: int
    drives: list[str]
    energy_error: dict[str, float]
    poses: FollowedSummary | None
    feeds: list[FeedSummary]
    error_left_out: list[str]


@dataclass(frozen=True, eq=False)
class PathCurves:
    """What is tabled and drawn of a move at one feed.

    Attributes:
        feed: [m/s, rad/s].
        zones: Beginning and end of both ramps [s].
        outputs: Where the deviation is.
        deviation: Sampled, as filtered.
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


@dataclass(frozen=True, eq=False)
class PathWorth:
    """What a path is worth: the same runs of machines without a source of error, all in the pose of
    the middle.

    Attributes:
        base: Runs of the machine, one per feed.
        better: Source of error, and the component alone that has it, to runs without it, an empty name
            for all components; cutting coefficients and the key of one, to runs at an end of its range.
        unknown: Components with a mesh whose errors nothing shows.
        left_out: What is not looked at.
    """

    base: tuple[PathRun, ...]
    better: Mapping[tuple[str, str], tuple[PathRun, ...]]
    unknown: tuple[str, ...]
    left_out: tuple[str, ...]

    def judge(
        self, number: int, read: Callable[[PathRun], Mapping[str, float | None]]
    ) -> dict[str, Estimate]:
        """How far numbers of a run may be off, by their names.

        Args:
            number: Of the run.
            read: What a run says of them; None for what has no number.
        """
        found = {}
        others = {owner: read(runs[number]) for owner, runs in self.better.items()}
        for name, own in read(self.base[number]).items():
            parts = [
                Estimate(
                    {source: size},
                    self.left_out,
                    {} if size is None or not owner else {source: {owner: size}},
                )
                for (source, owner), other in others.items()
                for size in [_measure_change(own, other[name], source)]
            ]
            if self.unknown:
                parts.append(Estimate({DISCRETISATION: None}))
            found[name] = combine_estimates([*parts, Estimate({}, self.left_out)])
        return found


def _measure_change(own: float | None, changed: float | None, source: str) -> float | None:
    """What stands behind the ± of a number's size; None where one of them is missing."""
    covering = 1.0 if source == CUTTING else COVERING
    return None if own is None or changed is None else covering * abs(abs(changed) - abs(own))


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

    def summarise(self) -> FollowedSummary:
        """As it stands in ``summary.json``."""
        return {
            "sampled_poses": self.sampled_poses,
            "error": self.error,
            "rotation_error": self.rotation_error,
            "modes": self.modes,
            "next_hz": self.next_hz,
            "steps": self.steps,
            "truncation": self.truncation,
            "effect": list(self.effect),
        }


@dataclass(frozen=True, eq=False)
class PathResult(Answer):
    """A path analysis.

    Attributes:
        start: Axis positions where it begins [m].
        end: Axis positions where it ends [m].
        length: Of the way [m, rad].
        ramp: How the feed is reached.
        time_constant: [s].
        sampling_hz: Samples a second.
        lowpass_hz: Of the filter; None without one.
        filter: Its kind.
        damped: Any damping is on.
        low_frequency_limit_hz: Modes below count as rigid-body (low-frequency) response.
        low_frequency_modes: How many these are.
        poses: How the poses were followed; None where that of the middle was enough.
        runs: One per feed.
        unit: Of the way, ``m``, or ``rad`` where only rotary axes move.
        drives: Drives under control; empty where motors follow their set points.
        energy_error: By feed, error of the energy balance relative to its largest part; where
            friction acts.
        worth: How far the numbers may be off.
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
    worth: PathWorth
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

    def summarise(self) -> PathSummary:
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
            "poses": None if self.poses is None else self.poses.summarise(),
            "feeds": [_summarise_run(self, place) for place in range(len(self.runs))],
            "error_left_out": list(self.worth.left_out),
        }

    def judge_probe(self, place: int, name: str) -> ProbeMotion:
        """What a probe saw on a run, with its errors."""
        changes = self.worth.judge(place, partial(_read_probe, name=name))
        return self.runs[place].probes[name].judge(changes)

    def fill(self, file: "h5py.File") -> None:
        """Write the curves of every feed, in the order of the scene."""
        feeds = file.create_group("path", track_order=True)
        for run in self.runs:
            fill_path(feeds.create_group(run.curves.name.replace("/", " per ")), run.curves)


def _summarise_run(answer: PathResult, place: int) -> FeedSummary:
    run, worth = answer.runs[place], answer.worth
    torques = worth.judge(
        place, lambda each: {name: own.torque.value for name, own in each.drives.items()}
    )
    followed = worth.judge(
        place, lambda each: {name: own.position_error.value for name, own in each.drives.items()}
    )
    summary: FeedSummary = {
        "name": run.curves.name,
        "acceleration": float(np.abs(run.curves.accelerations).max()),
        "outputs": [
            _summarise_output(run, number, worth, place) for number in range(len(run.figures))
        ],
        "drives": summarise_drives(run.drives, torques, followed),
        "joints": summarise_joints(
            run.joints,
            {joint: worth.judge(place, partial(_read_forces, joint=joint)) for joint in run.joints},
        ),
        "probes": {name: answer.judge_probe(place, name).summarise() for name in run.probes},
    }
    if run.curves.unit == "m":
        summary["feed_mm_per_min"] = 6e4 * run.curves.feed
    else:
        summary["feed_deg_per_min"] = 60.0 * math.degrees(run.curves.feed)
    return summary


def _read_forces(run: PathRun, joint: str) -> dict[str, float | None]:
    return {direction: force.value for direction, force in run.joints[joint].items()}


def _read_probe(run: PathRun, name: str) -> dict[str, float | None]:
    return run.probes[name].sizes


def _read_sizes(run: PathRun, output: int, zone: int) -> dict[str, float | None]:
    return {size: getattr(run.figures[output][zone], size) for size in SIZES}


def _summarise_output(run: PathRun, number: int, worth: PathWorth, place: int) -> OutputSummary:
    channel, zones, frozen = (
        run.curves.outputs[number],
        run.figures[number],
        run.frozen_figures[number],
    )
    unit, factor = deviation_unit(channel)
    judged = {
        name: worth.judge(place, partial(_read_sizes, output=number, zone=zone))
        for zone, name in enumerate(ZONES)
    }
    summary: OutputSummary = {
        "dof": list(channel),
        "accelerating": _summarise_zone(channel, zones[0], frozen[0]),
        "decelerating": _summarise_zone(channel, zones[1], frozen[1]),
        "errors": {
            zone: {f"{size}_{unit}": _scale(error, factor) for size, error in errors.items()}
            for zone, errors in judged.items()
        },
        "error_share": {
            zone: scale_shares(errors["peak"], factor) for zone, errors in judged.items()
        },
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
        found = worth.judge(place, lambda each: _read_cruise(each, number))
        summary["errors"]["cruising"] = {
            f"{name}_um": _scale(error, 1e6) for name, error in found.items()
        }
    return summary


def _read_cruise(run: PathRun, number: int) -> dict[str, float | None]:
    cruise = run.cruises[number] if run.cruises else None
    return {
        name: None if cruise is None else getattr(cruise, name)
        for name in ("variation", "straightness", "amplitude")
    }


def _scale(error: Estimate, factor: float) -> float | None:
    return None if error.total is None else factor * error.total


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


def fill_path(group: h5py.Group, curves: PathCurves) -> None:
    """Write the curves of one feed, in SI."""
    group.attrs["feed"], group.attrs["zones"] = curves.feed, np.array(curves.zones)
    group.attrs["unit"] = curves.unit
    group["outputs"] = np.char.encode(
        np.array([name_channel(channel) for channel in curves.outputs]), "utf-8"
    )
    group["times"], group["positions"], group["accelerations"] = (
        curves.deviation.times,
        curves.positions,
        curves.accelerations,
    )
    for name in _PARTS:
        group[name] = getattr(curves.deviation, name)
    group["frozen"] = curves.frozen
    group["drives"] = np.char.encode(np.array(curves.drives, dtype=str), "utf-8")
    group["torques"], group["position_errors"] = curves.torques, curves.position_errors
    for probe in curves.probes:
        probe.fill(group.create_group(f"probes/{probe.name}"))


def parse_path(group: h5py.Group) -> PathCurves:
    """Read what ``fill_path`` wrote.

    Raises:
        KeyError: A part is missing.
    """
    first, second = (
        (float(begin), float(end)) for begin, end in np.asarray(group.attrs["zones"], dtype=float)
    )
    deviation = PathDeviation(times=group["times"][:], **{name: group[name][:] for name in _PARTS})
    return PathCurves(
        feed=float(group.attrs["feed"]),
        unit=str(group.attrs["unit"]),
        zones=(first, second),
        outputs=tuple(split_channel(text.decode()) for text in group["outputs"][:]),
        deviation=deviation,
        frozen=group["frozen"][:],
        positions=group["positions"][:],
        accelerations=group["accelerations"][:],
        drives=tuple(text.decode() for text in group["drives"][:]),
        torques=group["torques"][:],
        position_errors=group["position_errors"][:],
        probes=tuple(parse_probe_trace(name, own) for name, own in group.get("probes", {}).items()),
    )
