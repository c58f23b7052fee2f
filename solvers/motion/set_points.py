"""Set points of a straight move: from rest to a feed and back to rest, along a path of given
length; and loads that act meanwhile, such as cutting forces.

A control without look-ahead filters the interpolated feed after the fact: one moving average over
the time constant makes linear ramps (constant acceleration), a second one limits the jerk, a
first-order lag makes exponential ramps. Source: Koren (1983), Computer Control of Manufacturing
Systems, chapter 5.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.solvers.second_order import Channel

RampKind = Literal["linear", "s_curve", "exponential"]
# time constants after which an exponential ramp counts as ended: 0.7 % of the feed are left
LAG_REACH = 5.0
SAME_INSTANT = 1e-9  # a break so near to a sample, as a share of the step, is the sample


@dataclass(frozen=True)
class Ramp:
    """Define how the feed is reached and left.

    Attributes:
        kind: ``linear``: constant acceleration; ``s_curve``: its jerk limited too; ``exponential``:
            a first-order lag.
        time_constant: Feed over acceleration, or the time constant of the lag [s].
        jerk_time: Acceleration over jerk, of an S-curve [s]; at most the time constant.
    """

    kind: RampKind
    time_constant: float
    jerk_time: float = 0.0

    @property
    def duration(self) -> float:
        """Return the duration of a ramp [s]."""
        if self.kind == "exponential":
            return LAG_REACH * self.time_constant
        return self.time_constant + (self.jerk_time if self.kind == "s_curve" else 0.0)


@dataclass(frozen=True)
class SetPoint:
    """Define a move.

    Attributes:
        distance: Length of the path [m]; [rad] where only rotary axes move.
        feed: Speed along it [m/s, rad/s].
        unit: Unit of the distance, ``m`` or ``rad``.
    """

    distance: float
    feed: float
    ramp: Ramp
    unit: str = "m"

    @property
    def name(self) -> str:
        """Feed as text: ``3000 mm/min`` or ``90 deg/min``."""
        return show_feed(self.feed, self.unit)

    @property
    def braking(self) -> float:
        """Return the time at which the second ramp begins [s]."""
        return self.distance / self.feed

    @property
    def duration(self) -> float:
        """Return the time at which the move ends [s]."""
        return self.braking + self.ramp.duration

    @property
    def zones(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Beginning and end of both ramps [s]."""
        return (0.0, self.ramp.duration), (self.braking, self.duration)


def show_feed(feed: float, unit: str) -> str:
    """Format a feed rate as controls show it: ``3000 mm/min``, or ``90 deg/min`` where the path is
    measured in ``rad``.
    """
    return f"{6e4 * feed:g} mm/min" if unit == "m" else f"{60.0 * math.degrees(feed):g} deg/min"


@dataclass(frozen=True, eq=False)
class PathMotion:
    """Store a move at instants.

    Attributes:
        positions: ``(n,)`` [m].
        speeds: ``(n,)`` [m/s].
        accelerations: ``(n,)`` [m/s^2]; where it jumps, that after the jump.
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray


def find_move_fault(move: SetPoint) -> str:
    """Explain why a move is too short for its feed; empty where it is not."""
    if move.braking >= move.ramp.duration * (1.0 - 1e-12):
        return ""
    least, fastest = move.feed * move.ramp.duration, move.distance / move.ramp.duration
    factor, word = (1e3, "mm") if move.unit == "m" else (math.degrees(1.0), "deg")
    return (
        f"a move of {factor * move.distance:g} {word} never reaches {move.name}: its ramp takes "
        f"{1e3 * move.ramp.duration:g} ms; make it at least {factor * least:g} {word} long, or the feed at most {show_feed(fastest, move.unit)}"
    )


def list_breaks(move: SetPoint) -> FloatArray:
    """List the instants ``(b,)`` at which the acceleration, or its slope, jumps [s]."""
    if move.ramp.kind == "exponential":
        return np.array([0.0, move.braking])
    return _acceleration_pieces(move)[0]


def sample_move(move: SetPoint, times: FloatArray) -> PathMotion:
    """Return position, speed and acceleration at instants [s]; at rest before and after."""
    if move.ramp.kind == "exponential":
        return _sample_lag(move, np.asarray(times, dtype=float))
    position, speed, acceleration = _laws(move)
    inside = np.clip(times, 0.0, move.duration)
    moving = (np.asarray(times) >= 0.0) & (np.asarray(times) < move.duration)
    return PathMotion(
        positions=np.asarray(position(inside)),
        speeds=np.where(moving, speed(inside), 0.0),
        accelerations=np.where(moving, acceleration(inside), 0.0),
    )


def average_accelerations(move: SetPoint, times: FloatArray, step: float) -> PathMotion:
    """Return position, speed and mean acceleration over a step ``step`` about instants, at rest
    before and after: where accelerations jump, as on linear ramps, time integration then preserves
    the impulse, and its error remains of second order.
    """
    now = sample_move(move, times)
    before, after = (sample_move(move, times + side * step).speeds for side in (-0.5, 0.5))
    return PathMotion(now.positions, now.speeds, np.asarray((after - before) / step))


def _step_accelerations(move: SetPoint, times: FloatArray) -> FloatArray:
    """Return the acceleration at the beginning and at the end of each step ``(n - 1, 2)``, as
    limits from inside it.

    No step may extend over a break. Within a step it is linear, but for exponential ramps, where
    the secant is taken.
    """
    times = np.asarray(times, dtype=float)
    inner = 1e-6 * np.diff(times)
    after = sample_move(move, times[:-1] + inner).accelerations
    before = sample_move(move, times[1:] - inner).accelerations
    # linear inside a step: values a millionth inside extrapolate to its ends
    slope = (before - after) * (1e-6 / (1.0 - 2e-6))
    return np.column_stack([after - slope, before + slope])


def _acceleration_pieces(move: SetPoint) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return breaks ``(b,)``, and acceleration at the ends of each piece ``(b - 1,)``."""
    ramp = move.ramp
    top = move.feed / ramp.time_constant
    if ramp.kind == "s_curve" and ramp.jerk_time > 0.0:
        edges = np.array([0.0, ramp.jerk_time, ramp.time_constant, ramp.duration])
        first, last = np.array([0.0, top, top]), np.array([top, top, 0.0])
    else:
        edges, first, last = np.array([0.0, ramp.time_constant]), np.array([top]), np.array([top])
    breaks = np.concatenate([edges, move.braking + edges])
    first, last = (np.concatenate([part, [0.0], -part]) for part in (first, last))
    kept = np.diff(breaks) > 1e-12 * move.duration
    return np.append(breaks[:-1][kept], breaks[-1]), first[kept], last[kept]


@functools.lru_cache(maxsize=16)
def _laws(move: SetPoint) -> "tuple[scipy.interpolate.PPoly, ...]":
    """Return position, speed and acceleration as functions of time."""
    breaks, first, last = _acceleration_pieces(move)
    spans = np.diff(breaks)
    cubic, square = (last - first) / (6.0 * spans), 0.5 * first
    speeds = np.concatenate([[0.0], np.cumsum(0.5 * (first + last) * spans)])[:-1]
    ways = speeds * spans + square * spans**2 + cubic * spans**3
    position = scipy.interpolate.PPoly(
        np.array([cubic, square, speeds, np.concatenate([[0.0], np.cumsum(ways)])[:-1]]), breaks
    )
    return position, position.derivative(1), position.derivative(2)


def _sample_lag(move: SetPoint, times: FloatArray) -> PathMotion:
    lag, feed = move.ramp.time_constant, move.feed
    parts = []
    for begin in (0.0, move.braking):
        since = np.maximum(times - begin, 0.0)
        rest = np.exp(-since / lag)
        parts.append(
            (
                feed * (since - lag * (1.0 - rest)),
                feed * (1.0 - rest),
                np.where(times >= begin, feed / lag * rest, 0.0),
            )
        )
    positions, speeds, accelerations = (
        first - second for first, second in zip(*parts, strict=True)
    )
    return PathMotion(positions, speeds, accelerations)


def sample_times(move: SetPoint, sampling_hz: float, settle: float) -> FloatArray:
    """Return evenly spaced instants ``(n,)`` [s] from the beginning of a move to a settling time
    after its end.

    Args:
        sampling_hz: Samples per second [Hz].
        settle: Time after the end of the move [s].
    """
    return np.asarray(
        np.arange(int(np.ceil((move.duration + settle) * sampling_hz - SAME_INSTANT)) + 1)
        / sampling_hz,
        dtype=float,
    )


def _step_times(move: SetPoint, samples: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the samples and the breaks of a move together ``(m,)``, and the indices of the samples
    ``(n,)``.
    """
    breaks = list_breaks(move)
    tolerance = SAME_INSTANT * float(samples[1] - samples[0])
    nearest = np.abs(
        samples[
            np.clip(np.searchsorted(samples, breaks), 1, len(samples) - 1) - np.array([[0], [1]])
        ]
        - breaks
    ).min(axis=0)
    times = np.sort(
        np.concatenate([samples, breaks[(nearest > tolerance) & (breaks < samples[-1])]])
    )
    return times, np.searchsorted(times, samples)


@dataclass(frozen=True, eq=False)
class PathLoads:
    """Describe loads on a machine along a path.

    Attributes:
        at: Returns loads ``(n, n_loads)`` at instants and at the speeds along the path there.
        step: Longest time over which a load may be approximated as linear [s].
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray, FloatArray], FloatArray]
    step: float


def cut_times(samples: FloatArray, loads: PathLoads | None) -> tuple[FloatArray, int]:
    """Return instants between which loads are linear, and the number of steps per sample.

    Args:
        samples: ``(n,)`` evenly spaced [s].
        loads: Loads; None where there are none.
    """
    return refine_times(samples, longest_step(loads))


def refine_times(samples: FloatArray, longest: float) -> tuple[FloatArray, int]:
    """Return instants ``(n,)`` at most so far apart, and the number of steps per sample."""
    parts = max(1, math.ceil((samples[1] - samples[0]) / longest))
    fine = np.linspace(samples[0], samples[-1], parts * (len(samples) - 1) + 1)
    return np.asarray(fine, dtype=float), parts


def load_channels(loads: PathLoads | None) -> tuple[Channel, ...]:
    """Return the input channels of loads."""
    return () if loads is None else loads.channels


def longest_step(loads: PathLoads | None) -> float:
    """Return the longest time over which loads may be approximated as linear [s]."""
    return math.inf if loads is None else loads.step


def _loads_at(loads: PathLoads | None, times: FloatArray, speeds: FloatArray) -> FloatArray:
    """Return loads ``(n, n_loads)`` at instants and speeds along the path, or no column."""
    return np.zeros((len(times), 0)) if loads is None else loads.at(times, speeds)


def path_inputs(loads: PathLoads | None, move: SetPoint, times: FloatArray) -> FloatArray:
    """Return position, speed and acceleration along the path, then loads ``(n, 3 + k)``."""
    now = sample_move(move, times)
    motion = [now.positions, now.speeds, now.accelerations]
    return np.column_stack([*motion, _loads_at(loads, times, now.speeds)])


@dataclass(frozen=True, eq=False)
class SteppedInputs:
    """Store inputs on steps over which they are linear.

    Attributes:
        times: ``(n,)`` samples, and further instants between them [s].
        ends: ``(n - 1, 2, k)`` at the begin and the end of each step.
        now: ``(n_samples, k)`` at the samples.
    """

    times: FloatArray
    wanted: NDArray[np.intp]
    ends: FloatArray
    now: FloatArray


def step_move(loads: PathLoads | None, move: SetPoint, samples: FloatArray) -> SteppedInputs:
    """Return path acceleration, then loads, in steps that end at every break of a move.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].
    """
    fine, parts = cut_times(samples, loads)
    times, places = _step_times(move, fine)
    acting = _loads_at(loads, times, sample_move(move, times).speeds)
    ends = np.stack([acting[:-1], acting[1:]], axis=1)
    ends = np.concatenate([_step_accelerations(move, times)[:, :, None], ends], axis=2)
    return SteppedInputs(times, places[::parts], ends, path_inputs(loads, move, samples)[:, 2:])
