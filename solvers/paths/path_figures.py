"""What a sampled deviation says: low-pass as in a measurement, and figures of each acceleration zone."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from headstock.geometry.frames import FloatArray
from headstock.solvers.paths.response import PathDeviation
from headstock.solvers.paths.set_points import SetPoint

FILTER_ORDER = 4
FilterKind = Literal["zero_phase", "causal"]
BAND = 0.05  # settled: the ringing stays below this share of its largest value in the zone
PADDING = 5.0  # rest before and after a record, in periods of the low-pass


@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass of fourth order.

    Attributes:
        frequency_hz: Where it halves the power once through [Hz].
        kind: ``zero_phase``: forwards and backwards, no delay and twice the order; ``causal``: once, as an instrument does.
    """

    frequency_hz: float
    kind: FilterKind = "zero_phase"


@dataclass(frozen=True)
class ZoneFigures:
    """One output in one acceleration zone: the ramp, and the ringing down after it.

    Attributes:
        begin: Of the ramp [s].
        ramp_end: Its end [s].
        end: Where the ringing down is no longer looked at [s].
        peak: Largest deviation, with its sign [m, rad].
        peak_time: When [s].
        span: Largest less smallest deviation.
        ramp_peak: Largest deviation during the ramp, with its sign.
        ramp_span: Largest less smallest during the ramp.
        quasi_static: Largest quasi-static part, with its sign.
        dynamic: Largest size of the ringing.
        rms: Of the deviation over the zone.
        settling: How long after the ramp the ringing stays below a share of its largest value [s]; None when it does not.
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
    """The deviation and its parts through a low-pass; the parts still add up. The machine rests before the record begins."""
    if low_pass is None:
        return found
    rate = 1.0 / float(found.times[1] - found.times[0])
    sections = butter(FILTER_ORDER, low_pass.frequency_hz, fs=rate, output="sos")
    padding = int(np.ceil(PADDING * rate / low_pass.frequency_hz))

    def apply(values: FloatArray) -> FloatArray:
        rest = np.zeros((padding, values.shape[1]))
        padded = np.vstack([rest, values, np.repeat(values[-1:], padding, axis=0)])
        run = sosfilt if low_pass.kind == "causal" else lambda *args, axis: sosfiltfilt(*args, axis=axis, padtype=None)
        return np.asarray(run(sections, padded, axis=0)[padding:-padding])

    parts = [apply(part) for part in (found.quasi_static, found.sway, found.dynamic)]
    return dataclasses.replace(found, total=np.sum(parts, axis=0), quasi_static=parts[0], sway=parts[1], dynamic=parts[2])


def measure_zones(
    found: PathDeviation, raw: PathDeviation, move: SetPoint, output: int, ring_down: float
) -> tuple[ZoneFigures, ZoneFigures]:
    """Figures of one output in both zones; a zone ends before the next one begins, or so long after its ramp.

    Args:
        found: As filtered.
        raw: Before the filter, which would round the corners of the quasi-static part and carry ringing from one zone into another.
        move: The set point.
        output: Number of the output.
        ring_down: How long after a ramp its ringing is looked at [s].
    """
    (first, first_end), (second, second_end) = move.zones
    last, ahead = float(found.times[-1]), max(second, first_end)
    zones = (
        (first, first_end, min(first_end + ring_down, ahead), ahead),
        (second, second_end, min(second_end + ring_down, last), last),
    )
    early, late = (_measure(found, raw, output, zone) for zone in zones)
    return early, late


def _measure(found: PathDeviation, raw: PathDeviation, output: int, zone: tuple[float, float, float, float]) -> ZoneFigures:
    begin, ramp_end, end, limit = zone
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
        settling=_settle(raw, output, (begin, ramp_end, limit)),
    )


def _settle(raw: PathDeviation, output: int, zone: tuple[float, float, float]) -> float | None:
    """Time after a ramp from which the ringing stays small until the next ramp or the end; None when it does not."""
    begin, ramp_end, limit = zone
    first, ended, last = np.searchsorted(raw.times, [begin, ramp_end, limit - 1e-9])
    ringing = np.abs(raw.dynamic[first:last, output])
    loud = np.flatnonzero(ringing > BAND * ringing.max(initial=0.0))
    if not len(loud) or first + loud[-1] < ended:
        return 0.0
    following = first + int(loud[-1]) + 1
    return None if following >= last else float(raw.times[following] - ramp_end)


def _largest(values: FloatArray) -> float:
    return float(values[int(np.argmax(np.abs(values)))])
