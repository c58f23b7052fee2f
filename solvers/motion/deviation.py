"""Deviation from a path in its parts, its low-pass, and its figures in each acceleration zone."""

import dataclasses
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.solvers.motion.set_points import (
    SetPoint,
)
from headstock.solvers.watched_outputs import WatchedValues

FILTER_ORDER = 4
FilterKind = Literal["zero_phase", "causal"]
# settled: the residual vibration remains below this share of its largest value in the zone
BAND = 0.05
PADDING = 5.0  # rest before and after a record, in periods of the low-pass
LEAST_WAVES = 2.0  # least number of periods of a sinusoid that counts as periodic
FINER = 16  # number of evaluated frequencies per frequency resolution


@dataclass(frozen=True, eq=False)
class PathDeviation:
    """Store a sampled deviation at outputs; the three parts add up to the total.

    Attributes:
        times: ``(n,)`` [s].
        total: ``(n, n_outputs)`` [m, rad].
        quasi_static: ``(n, n_outputs)``: static response of every mode that is faster than the
            ramp.
        low_frequency: ``(n, n_outputs)``: response of the slower modes, such as rigid-body motion
            on soft mounts.
        dynamic: ``(n, n_outputs)``: the residual vibration of the faster modes.
        watched: Other outputs that were watched, such as forces.
    """

    times: FloatArray
    total: FloatArray
    quasi_static: FloatArray
    low_frequency: FloatArray
    dynamic: FloatArray
    watched: WatchedValues = field(default_factory=WatchedValues)

    def with_total(self, total: FloatArray, watched: WatchedValues) -> "PathDeviation":
        """Return the deviation with another total; the difference counts as dynamic."""
        dynamic = total - self.quasi_static - self.low_frequency
        return dataclasses.replace(self, total=total, dynamic=dynamic, watched=watched)

    def __add__(self, other: "PathDeviation") -> "PathDeviation":
        """Return the superposition of two deviations of a linear machine."""
        return PathDeviation(
            self.times,
            self.total + other.total,
            self.quasi_static + other.quasi_static,
            self.low_frequency + other.low_frequency,
            self.dynamic + other.dynamic,
            self.watched + other.watched,
        )


@dataclass(frozen=True)
class LowPass:
    """Define a Butterworth low-pass of fourth order.

    Attributes:
        frequency_hz: Cut-off frequency, where one pass halves the power [Hz].
        kind: ``zero_phase``: forwards and backwards, no delay and twice the order; ``causal``:
            once, as an instrument does.
    """

    frequency_hz: float
    kind: FilterKind = "zero_phase"


@dataclass(frozen=True)
class ZoneFigures:
    """Store figures of one output in a zone: the ramp, and the residual vibration after it.

    Attributes:
        begin: Begin of the ramp [s].
        ramp_end: End of the ramp [s].
        end: End of the evaluated residual vibration [s].
        peak: Largest deviation, with its sign [m, rad].
        peak_time: Time of the peak [s].
        span: Largest less smallest deviation.
        ramp_peak: Largest deviation during the ramp, with its sign.
        ramp_span: Largest less smallest during the ramp.
        quasi_static: Largest quasi-static part, with its sign.
        dynamic: Largest residual vibration.
        rms: Root mean square of the deviation over the zone.
        settling: Time after the ramp until the residual vibration stays below a share of its
            largest value [s]; None when it does not.
    """

    begin: float
    ramp_end: float
    end: float
    peak: float
    peak_time: float
    span: float
    ramp_peak: float
    ramp_span: float
    quasi_static: float
    dynamic: float
    rms: float
    settling: float | None


def filter_deviation(found: PathDeviation, low_pass: LowPass | None) -> PathDeviation:
    """Filter the deviation and its parts by a low-pass; the parts still add up. The machine is at
    rest before the record begins.
    """
    if low_pass is None:
        return found
    rate = 1.0 / float(found.times[1] - found.times[0])
    sections = scipy.signal.butter(FILTER_ORDER, low_pass.frequency_hz, fs=rate, output="sos")
    padding = int(np.ceil(PADDING * rate / low_pass.frequency_hz))

    def apply(values: FloatArray) -> FloatArray:
        rest = np.zeros((padding, values.shape[1]))
        padded = np.vstack([rest, values, np.repeat(values[-1:], padding, axis=0)])
        run = (
            scipy.signal.sosfilt
            if low_pass.kind == "causal"
            else lambda *args, axis: scipy.signal.sosfiltfilt(*args, axis=axis, padtype=None)
        )
        return run(sections, padded, axis=0)[padding:-padding]

    parts = [apply(part) for part in (found.quasi_static, found.low_frequency, found.dynamic)]
    return dataclasses.replace(
        found,
        total=np.sum(parts, axis=0),
        quasi_static=parts[0],
        low_frequency=parts[1],
        dynamic=parts[2],
    )


def measure_zones(
    deviation: PathDeviation, raw: PathDeviation, move: SetPoint, output: int, residual_time: float
) -> tuple[ZoneFigures, ZoneFigures]:
    """Measure one output in both zones; a zone ends before the next one begins, or a given time
    after its ramp.

    Args:
        raw: The deviation before the filter, which would round the corners of the quasi-static part
            and spread residual vibration from one zone into another.
        residual_time: Time after a ramp in which its residual vibration is evaluated [s].
    """
    (_, first_end), (second, _) = move.zones
    limits = max(second, first_end), float(deviation.times[-1])
    one, other = (
        _measure(deviation, raw, output, _Zone(begin, end, min(end + residual_time, limit), limit))
        for (begin, end), limit in zip(move.zones, limits, strict=True)
    )
    return one, other


@dataclass(frozen=True)
class CruiseFigures:
    """Store figures of one output at constant feed: straightness and periodic part.

    Attributes:
        begin: End of the residual vibration of the first ramp [s].
        end: Begin of the second ramp [s].
        variation: Largest less smallest deviation [m, rad].
        straightness: Largest less smallest distance from the least-squares line.
        period: Period of the strongest sinusoid that fits at least twice [s].
        distance: Wavelength of this sinusoid along the path [m].
        amplitude: Amplitude of this sinusoid [m, rad].
    """

    begin: float
    end: float
    variation: float
    straightness: float
    period: float
    distance: float
    amplitude: float


def measure_cruise(
    found: PathDeviation, move: SetPoint, output: int, residual_time: float
) -> CruiseFigures | None:
    """Measure one output at constant feed; None where that is too short.

    Args:
        residual_time: Time after the ramp that is excluded for its residual vibration [s].

    Source: the strongest sinusoid by the least-squares spectrum of the values about their line
    (Lomb 1976).
    """
    begin, end = move.zones[0][1] + residual_time, move.zones[1][0]
    inside = (found.times >= begin) & (found.times <= end)
    times, values = found.times[inside], found.total[inside, output]
    if len(times) < FINER:
        return None
    arms = times - times.mean()
    rest = values - values.mean() - arms * float(arms @ values) / float(arms @ arms)
    span = float(times[-1] - times[0])
    # a fine grid of frequencies: the transform of zero-padded values
    size = FINER * len(rest)
    spectrum = np.abs(np.fft.rfft(rest * np.hanning(len(rest)), size))
    frequencies = np.fft.rfftfreq(size, span / (len(times) - 1))
    periodic = frequencies >= LEAST_WAVES / span
    best = float(frequencies[periodic][int(np.argmax(spectrum[periodic]))])
    angles = 2.0 * np.pi * best * arms
    waves = np.column_stack([np.ones_like(arms), arms, np.cos(angles), np.sin(angles)])
    fitted = np.linalg.lstsq(waves, values)[0]
    return CruiseFigures(
        begin,
        end,
        variation=float(np.ptp(values)),
        straightness=float(np.ptp(rest)),
        period=1.0 / best,
        distance=move.feed / best,
        amplitude=float(np.hypot(fitted[2], fitted[3])),
    )


class _Zone(NamedTuple):
    """Store times of a ramp [s]: its begin and end, until when its figures are measured, and until
    when no other ramp acts.
    """

    begin: float
    ramp_end: float
    end: float
    limit: float


def _measure(found: PathDeviation, raw: PathDeviation, output: int, zone: _Zone) -> ZoneFigures:
    begin, ramp_end, end = zone.begin, zone.ramp_end, zone.end
    slack = 1e-9 * float(found.times[1] - found.times[0])

    def within(start: float, stop: float) -> slice:
        return slice(*np.searchsorted(found.times, [start - slack, stop + slack]))

    whole, ramp = within(begin, end), within(begin, ramp_end)
    values = found.total[whole, output]
    largest = int(np.argmax(np.abs(values)))
    return ZoneFigures(
        begin,
        ramp_end,
        end,
        peak=float(values[largest]),
        peak_time=float(found.times[whole][largest]),
        span=float(np.ptp(values)),
        ramp_peak=_largest(found.total[ramp, output]),
        ramp_span=float(np.ptp(found.total[ramp, output])),
        quasi_static=_largest(raw.quasi_static[within(begin, ramp_end - 2.0 * slack), output]),
        dynamic=float(np.abs(found.dynamic[whole, output]).max()),
        rms=float(np.sqrt(np.mean(values**2))),
        settling=_settle(raw, output, zone),
    )


def _settle(raw: PathDeviation, output: int, zone: _Zone) -> float | None:
    """Return the time after a ramp from which the residual vibration stays small until the next
    ramp or the end; None when it does not.
    """
    first, ended, last = np.searchsorted(raw.times, [zone.begin, zone.ramp_end, zone.limit - 1e-9])
    residual = np.abs(raw.dynamic[first:last, output])
    loud = np.flatnonzero(residual > BAND * residual.max(initial=0.0))
    if not len(loud) or first + loud[-1] < ended:
        return 0.0
    following = first + int(loud[-1]) + 1
    return None if following >= last else float(raw.times[following] - zone.ramp_end)


def _largest(values: FloatArray) -> float:
    return float(values[int(np.argmax(np.abs(values)))])
