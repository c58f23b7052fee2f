"""Deviation from a path while its axes accelerate, in a constant pose, exact; its low-pass, and its
figures in each acceleration zone.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import scipy  # whose filters, a quarter of a second, are loaded where they are used
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    count_modes,
    keep_modes,
    to_modal_coordinates,
)
from headstock.solvers.linear.state_space import Feedthrough, StateSpace, modal_state_space
from headstock.solvers.linear.time_response import add_direct, solve_stepped_response
from headstock.solvers.paths.loads import (
    PathLoads,
    cut_times,
    load_channels,
    loads_at,
    refine_times,
    step_loads,
)
from headstock.solvers.paths.set_points import (
    SetPoint,
    list_breaks,
    sample_move,
    step_accelerations,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.watched_outputs import Watch, WatchedValues

SAME_INSTANT = 1e-9  # a break so near to a sample, as a share of the step, is the sample
FILTER_ORDER = 4
FilterKind = Literal["zero_phase", "causal"]
BAND = (
    0.05  # settled: the residual vibration stays below this share of its largest value in the zone
)
PADDING = 5.0  # rest before and after a record, in periods of the low-pass


@dataclass(frozen=True, eq=False)
class PathDeviation:
    """Deviation at the outputs, sampled; the three parts add up to the total.

    Attributes:
        times: ``(n,)`` [s].
        total: ``(n, n_outputs)`` [m, rad].
        quasi_static: ``(n, n_outputs)``: every mode that is faster than the ramp follows its load
            at once.
        low_frequency: ``(n, n_outputs)``: the slower modes, in which the machine sways on soft
            mounts as a whole.
        dynamic: ``(n, n_outputs)``: the residual vibration of the faster modes.
        watched: What else was asked for, such as forces.
    """

    times: FloatArray
    total: FloatArray
    quasi_static: FloatArray
    low_frequency: FloatArray
    dynamic: FloatArray
    watched: WatchedValues = field(default_factory=WatchedValues)

    def __add__(self, other: "PathDeviation") -> "PathDeviation":
        """Return two deviations of a linear machine together."""
        return PathDeviation(
            self.times,
            self.total + other.total,
            self.quasi_static + other.quasi_static,
            self.low_frequency + other.low_frequency,
            self.dynamic + other.dynamic,
            self.watched + other.watched,
        )


@dataclass(frozen=True)
class PathModel:
    """What a deviation is computed of.

    Attributes:
        source: Input of the acceleration along the path.
        outputs: Where the deviation is wanted.
        low_frequency_limit_hz: Modes below it do not follow a ramp [Hz].
        up_to_hz: Modes kept; those above follow at once. None keeps all.
        loads: On the machine; None for none.
        watched: Other outputs that are asked for as a whole.
    """

    source: Channel
    outputs: tuple[Channel, ...]
    low_frequency_limit_hz: float
    up_to_hz: float | None = None
    loads: PathLoads | None = None
    watched: Watch = field(default_factory=Watch)

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """All of them."""
        return (self.source, *load_channels(self.loads))


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Loads along a path that do not come from its acceleration.

    Attributes:
        channels: Where they act.
        at: Loads ``(n, k)`` at instants ``(n,)``.
        step: Longest time over which a load may be taken for straight [s].
        passed: What outputs have of them at once; None for nothing.
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray], FloatArray]
    step: float
    passed: Feedthrough | None = None

    def act_on(
        self,
        space: StateSpace,
        outputs: Sequence[Channel],
        watch: Watch,
        *,
        slow: NDArray[np.bool_],
        held: FloatArray,
        samples: FloatArray,
    ) -> PathDeviation:
        """Return what they do to a system between their channels and outputs; see
        :func:`respond_exactly`.
        """
        fine, parts = refine_times(samples, self.step)
        given = self.at(fine)
        return _respond_exactly(
            space,
            outputs,
            watch,
            slow=slow,
            held=held,
            times=fine,
            given=np.stack([given[:-1], given[1:]], axis=1),
            some=np.arange(0, len(fine), parts),
            now=given[::parts],
        )


def sample_times(move: SetPoint, sampling_hz: float, settle: float) -> FloatArray:
    """Evenly spaced instants ``(n,)`` [s] from the beginning of a move until its vibration has been
    followed for long enough.

    Args:
        sampling_hz: Samples per second [Hz].
        settle: Time after the end of the move [s].
    """
    return np.asarray(
        np.arange(int(np.ceil((move.duration + settle) * sampling_hz - SAME_INSTANT)) + 1)
        / sampling_hz,
        dtype=float,
    )


def step_times(move: SetPoint, samples: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """The samples and the breaks of a move together ``(m,)``, and which of them are samples
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


def solve_path(
    system: SecondOrderSystem, model: PathModel, move: SetPoint, samples: FloatArray
) -> PathDeviation:
    """Deviation of a system over a move; no error but that of the model, whatever the sampling.

    Args:
        system: Symmetric, with the source among its inputs.
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    outputs = (*model.outputs, *model.watched.outputs)
    coordinates = _find_coordinates(system, model.inputs, outputs)
    if model.up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, model.up_to_hz))
    fine, parts = cut_times(samples, model.loads)
    times, places = step_times(move, fine)
    given = np.concatenate(
        [step_accelerations(move, times)[:, :, None], step_loads(model.loads, move, times)], axis=2
    )
    space = modal_state_space(coordinates, model.inputs, outputs)
    held = _static_share(coordinates, space, model.outputs, model.low_frequency_limit_hz)
    # of what loads do nothing counts as quasi-static
    held[:, space.columns.of(load_channels(model.loads))] = 0.0
    return _respond_exactly(
        space,
        model.outputs,
        model.watched,
        slow=coordinates.omega < 2.0 * np.pi * model.low_frequency_limit_hz,
        held=held,
        times=times,
        given=given,
        some=places[::parts],
        now=act_at(model, move, samples),
    )


def _find_coordinates(
    system: SecondOrderSystem, inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> ModalCoordinates:
    """Return the modes of a system in time.

    Raises:
        ModelError: A channel is unknown, a damper acts on a dof without mass, or a matrix is not
            symmetric.
    """
    found = to_modal_coordinates(equivalent_viscous(system), inputs, outputs)
    if found is None:
        raise ModelError(
            "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
        )
    return found


def _respond_exactly(
    space: StateSpace,
    outputs: Sequence[Channel],
    watch: Watch,
    *,
    slow: NDArray[np.bool_],
    held: FloatArray,
    times: FloatArray,
    given: FloatArray,
    some: NDArray[np.intp],
    now: FloatArray,
) -> PathDeviation:
    """Return the motion of a system from rest under loads that are straight between times, without
    any error of integration.

    Args:
        outputs: Where the deviation is wanted.
        slow: ``(m,)`` modes of low frequency: two states each; none of a system without modes.
        held: ``(n_outputs, k)`` what inputs hold statically, without the slow modes.
        times: ``(n,)`` rising, from zero [s].
        given: ``(n - 1, 2, k)`` inputs at the beginning and at the end of each step.
        now: ``(n_samples, k)`` inputs there.
    """
    rows, watched = space.rows.of(outputs), space.watch(watch)
    shown, count = space.c[rows], len(outputs)
    below = np.where(np.repeat(slow, 2), shown, 0.0) if len(slow) else np.zeros_like(shown)
    c = np.vstack([shown, below, watched.states])
    states = dataclasses.replace(
        space, c=c, d=np.zeros((len(c), len(space.inputs))), inputs=(), outputs=()
    )
    moved = solve_stepped_response(states, times, given).outputs[some]
    total, low_frequency = moved[:, :count], moved[:, count : 2 * count]
    total, values = total + now @ space.d[rows].T, moved[:, 2 * count :]
    add_direct(values, now, watched.inputs)
    quasi_static = now @ held.T
    return PathDeviation(
        times[some],
        total,
        quasi_static,
        low_frequency,
        total - quasi_static - low_frequency,
        WatchedValues(watch.channels, values),
    )


def solve_loads(
    system: SecondOrderSystem,
    outputs: Sequence[Channel],
    loads: Disturbance,
    *,
    samples: FloatArray,
    low_frequency_limit_hz: float,
    watch: Watch,
) -> PathDeviation:
    """Deviation of a system at rest under loads along a path that do not come from its acceleration,
    such as errors of guides as they are passed, exact for loads that are straight between fine steps.

    Args:
        system: Symmetric, with the channels of the loads among its inputs.
        outputs: Where the deviation is wanted.
        loads: They begin at zero.
        samples: ``(n,)`` evenly spaced, from zero [s].
        low_frequency_limit_hz: Modes below count as low-frequency response [Hz].
        watch: What else is wanted of it.

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    wanted = (*outputs, *watch.outputs)
    coordinates = _find_coordinates(system, loads.channels, wanted)
    space = modal_state_space(coordinates, loads.channels, wanted).pass_on(loads.passed)
    share = _static_share(coordinates, space, outputs, low_frequency_limit_hz)
    slow = coordinates.omega < 2.0 * np.pi * low_frequency_limit_hz
    return loads.act_on(space, outputs, watch, slow=slow, held=share, samples=samples)


def solve_loop_loads(
    loop: StateSpace,
    outputs: Sequence[Channel],
    loads: Disturbance,
    *,
    samples: FloatArray,
    watch: Watch,
) -> PathDeviation:
    """The same of a stable closed loop that holds its set points; its quasi-static part is what it
    holds under constant loads.
    """
    columns, rows = loop.columns.of(loads.channels), loop.rows.of(outputs)
    b, d = loop.b[:, columns], loop.d[:, columns]
    space = dataclasses.replace(loop, b=b, d=d, inputs=loads.channels).pass_on(loads.passed)
    held = space.d[rows] - loop.c[rows] @ np.linalg.solve(loop.a, b)
    none = np.zeros(0, dtype=np.bool_)
    return loads.act_on(space, outputs, watch, slow=none, held=held, samples=samples)


def act_at(model: PathModel, move: SetPoint, times: FloatArray) -> FloatArray:
    """Acceleration along the path, and loads ``(n, 1 + n_loads)`` at instants."""
    motion = sample_move(move, times)
    return np.column_stack([motion.accelerations, loads_at(model.loads, times, motion.speeds)])


def _static_share(
    coordinates: ModalCoordinates,
    space: StateSpace,
    outputs: Sequence[Channel],
    low_frequency_limit_hz: float,
) -> FloatArray:
    """Deviation per unit of each input ``(n_outputs, k)`` if all but the low-frequency modes respond
    quasi-statically, and what outputs have at once.
    """
    rows = space.rows.of(outputs)
    fast = coordinates.omega >= 2.0 * np.pi * low_frequency_limit_hz
    moved = coordinates.outputs[rows][:, fast] / coordinates.eigenvalues[fast]
    return np.asarray(moved @ coordinates.inputs[fast] + space.d[rows])


def slow_modes(frequencies_hz: Sequence[float] | FloatArray, low_frequency_limit_hz: float) -> int:
    """How many modes lie below the limit."""
    return int(np.count_nonzero(np.asarray(frequencies_hz) < low_frequency_limit_hz))


@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass of fourth order.

    Attributes:
        frequency_hz: Where it halves the power once through [Hz].
        kind: ``zero_phase``: forwards and backwards, no delay and twice the order; ``causal``:
            once, as an instrument does.
    """

    frequency_hz: float
    kind: FilterKind = "zero_phase"


@dataclass(frozen=True)
class ZoneFigures:
    """One output in one acceleration zone: the ramp, and the residual vibration after it.

    Attributes:
        begin: Of the ramp [s].
        ramp_end: Its end [s].
        end: Where the residual vibration is no longer looked at [s].
        peak: Largest deviation, with its sign [m, rad].
        peak_time: When [s].
        span: Largest less smallest deviation.
        ramp_peak: Largest deviation during the ramp, with its sign.
        ramp_span: Largest less smallest during the ramp.
        quasi_static: Largest quasi-static part, with its sign.
        dynamic: Largest residual vibration.
        rms: Of the deviation over the zone.
        settling: How long after the ramp the residual vibration stays below a share of its largest
            value [s]; None when it does not.
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
    """The deviation and its parts through a low-pass; the parts still add up. The machine rests
    before the record begins.
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
        return np.asarray(run(sections, padded, axis=0)[padding:-padding])

    parts = [apply(part) for part in (found.quasi_static, found.low_frequency, found.dynamic)]
    return dataclasses.replace(
        found,
        total=np.sum(parts, axis=0),
        quasi_static=parts[0],
        low_frequency=parts[1],
        dynamic=parts[2],
    )


def measure_zones(
    found: PathDeviation, raw: PathDeviation, move: SetPoint, output: int, residual_time: float
) -> tuple[ZoneFigures, ZoneFigures]:
    """Figures of one output in both zones; a zone ends before the next one begins, or so long after
    its ramp.

    Args:
        raw: Before the filter, which would round the corners of the quasi-static part and carry
            residual vibration from one zone into another.
        residual_time: How long after a ramp its residual vibration is looked at [s].
    """
    (first, first_end), (second, second_end) = move.zones
    last, ahead = float(found.times[-1]), max(second, first_end)
    return (
        _measure(
            found,
            raw,
            output,
            _Zone(first, first_end, min(first_end + residual_time, ahead), ahead),
        ),
        _measure(
            found,
            raw,
            output,
            _Zone(second, second_end, min(second_end + residual_time, last), last),
        ),
    )


@dataclass(frozen=True)
class CruiseFigures:
    """One output while the feed is constant: how straight the line is, and what repeats in it.

    Attributes:
        begin: When the residual vibration of the first ramp is no longer looked at [s].
        end: When the second ramp begins [s].
        variation: Largest less smallest deviation [m, rad].
        straightness: The same about the least-squares line.
        period: Of the strongest wave that fits at least twice [s].
        distance: The same along the path [m].
        amplitude: Of this wave [m, rad].
    """

    begin: float
    end: float
    variation: float
    straightness: float
    period: float
    distance: float
    amplitude: float


LEAST_WAVES = 2.0  # of the time looked at, so that a wave counts as periodic
FINER = 16  # frequencies looked at per one that the time tells apart


def measure_cruise(
    found: PathDeviation, move: SetPoint, output: int, residual_time: float
) -> CruiseFigures | None:
    """Figures of one output at constant feed; None where that is too short to tell.

    Args:
        residual_time: How long after the ramp its residual vibration is left out [s].

    Source: the strongest wave by the least-squares spectrum of the values about their line (Lomb
    1976).
    """
    begin, end = move.zones[0][1] + residual_time, move.zones[1][0]
    inside = (found.times >= begin) & (found.times <= end)
    times, values = found.times[inside], found.total[inside, output]
    if len(times) < FINER:
        return None
    arms = times - times.mean()
    rest = values - values.mean() - arms * float(arms @ values) / float(arms @ arms)
    span = float(times[-1] - times[0])
    # a fine grid of frequencies: the transform of the values with zeros behind them
    size = FINER * len(rest)
    spectrum = np.abs(np.fft.rfft(rest * np.hanning(len(rest)), size))
    frequencies = np.fft.rfftfreq(size, span / (len(times) - 1))
    known = frequencies >= LEAST_WAVES / span
    best = float(frequencies[known][int(np.argmax(spectrum[known]))])
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
    """Times of a ramp [s]: its begin and end, up to when its figures count, and until when nothing
    else moves the machine.
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
    """Time after a ramp from which the residual vibration stays small until the next ramp or the end; None
    when it does not.
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
