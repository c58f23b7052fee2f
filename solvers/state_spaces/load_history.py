"""Loads over time in closed form: steps, ramps, sines, impulses and records, and what they are on
the steps of a time grid.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import ModelError

IndexArray = NDArray[np.intp]
SAME_VALUE = 1e-9  # of the largest value: jumps below it are roundoff
SAME_TIME = 1e-9  # of a time step: what is closer is one instant


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """One load over time: pieces ``value + slope (t - begin) + amplitude sin(omega (t - begin) +
    phase)``, zero between them.

    Attributes:
        begins: ``(p,)`` rising [s].
        ends: ``(p,)`` none beyond the next begin [s]; infinite for a load that stays.
        values: ``(p,)``.
        slopes: ``(p,)`` [1/s].
        amplitudes: ``(p,)`` of the sine.
        omegas: ``(p,)`` [rad/s].
        phases: ``(p,)`` [rad].
        impulses: Instants [s] and sizes.
        before: What acts from long before the time zero until it, in equilibrium.
    """

    begins: FloatArray
    ends: FloatArray
    values: FloatArray
    slopes: FloatArray
    amplitudes: FloatArray
    omegas: FloatArray
    phases: FloatArray
    impulses: tuple[tuple[float, float], ...] = ()
    before: float = 0.0

    @property
    def instants(self) -> FloatArray:
        """Return where the load jumps, bends, or strikes [s]."""
        struck = [time for time, _ in self.impulses]
        every = np.concatenate([self.begins, self.ends, struck])
        return np.asarray(np.unique(every[np.isfinite(every)]), dtype=float)

    @property
    def first(self) -> float:
        """Return when it begins to act, or to change [s]."""
        return float(self.instants.min(initial=np.inf))

    def is_constant_at(self, time: float) -> bool:
        """Return whether the load stands still at a time."""
        piece = int(np.searchsorted(self.begins, time, side="right")) - 1
        if piece < 0 or time > self.ends[piece]:
            return True
        return not (self.slopes[piece] or self.amplitudes[piece])


@dataclass(frozen=True, eq=False)
class _Sine:
    """Sinusoidal parts of loads on the steps of a grid: ``forward sin(omega s) + quadrature
    cos(omega s)`` at the time ``s`` after the begin of a step.

    Attributes:
        omega: [rad/s].
        forward: ``(n - 1, k)``.
        quadrature: ``(n - 1, k)``.
    """

    omega: float
    forward: FloatArray
    quadrature: FloatArray


@dataclass(frozen=True, eq=False)
class SteppedLoads:
    """Loads on the steps of a time grid that no load jumps or bends within.

    Attributes:
        times: ``(n,)`` rising [s].
        linear: ``(n - 1, 2, k)`` linear parts at the begin and the end of each step.
        sines: The sinusoidal parts, one per frequency.
        impulses: ``(n, k)`` at each time.
        sampled: ``(m,)`` which of the times are samples; the others are instants of loads.
    """

    times: FloatArray
    linear: FloatArray
    sines: tuple[_Sine, ...]
    impulses: FloatArray
    sampled: IndexArray

    @property
    def steps(self) -> FloatArray:
        """``(n - 1,)`` [s]."""
        return np.diff(self.times)

    def evaluate(self) -> tuple[FloatArray, FloatArray]:
        """Return loads and their rates, each ``(n - 1, 2, k)`` at begin and end of each step."""
        steps = self.steps[:, None]
        values = self.linear.copy()
        slope = (self.linear[:, 1] - self.linear[:, 0]) / steps
        rates = np.stack([slope, slope], axis=1)
        for sine in self.sines:
            for end, elapsed in ((0, np.zeros_like(steps)), (1, steps)):
                s, c = np.sin(sine.omega * elapsed), np.cos(sine.omega * elapsed)
                values[:, end] += sine.forward * s + sine.quadrature * c
                rates[:, end] += sine.omega * (sine.forward * c - sine.quadrature * s)
        return values, rates


def no_load() -> LoadHistory:
    """Return a load that never acts."""
    return _join_pieces([], [])


def step_load(size: float, begin: float = 0.0, end: float = np.inf) -> LoadHistory:
    """Return a constant load from one time to another [s]; without an end it stays."""
    return _join_pieces([begin], [end], values=size)


def ramp_load(size: float, begin: float, duration: float) -> LoadHistory:
    """Return a load that rises evenly while a time [s] lasts, and then stays."""
    end = begin + duration
    slopes = [size / duration, 0.0]
    return _join_pieces([begin, end], [end, np.inf], values=[0.0, size], slopes=slopes)


def half_sine_load(size: float, begin: float, duration: float) -> LoadHistory:
    """Return half a period of a sine, as long as a time [s]."""
    return _join_pieces([begin], [begin + duration], amplitudes=size, omegas=np.pi / duration)


def sine_load(size: float, begin: float, hz: float, cycles: float = np.inf) -> LoadHistory:
    """Return a sine from a time [s] on, for a number of cycles."""
    return _join_pieces([begin], [begin + cycles / hz], amplitudes=size, omegas=2.0 * np.pi * hz)


def impulse_load(size: float, at: float = 0.0) -> LoadHistory:
    """Return an impulse [N s, or N m s] at a time [s]."""
    return dataclasses.replace(no_load(), impulses=((at, size),))


def released_load(size: float, at: float = 0.0) -> LoadHistory:
    """Return a load that has acted for long, and is gone from a time [s] on."""
    return dataclasses.replace(_join_pieces([0.0], [at], values=size), before=size)


def recorded_load(times: FloatArray, values: FloatArray) -> LoadHistory:
    """Return a record, linear between its samples and zero outside.

    Args:
        times: ``(n,)`` rising [s].
        values: ``(n,)``.
    """
    slopes = np.diff(values) / np.diff(times)
    return _join_pieces(times[:-1], times[1:], values=values[:-1], slopes=slopes)


def _join_pieces(
    begins: ArrayLike,
    ends: ArrayLike,
    *,
    values: ArrayLike = 0.0,
    slopes: ArrayLike = 0.0,
    amplitudes: ArrayLike = 0.0,
    omegas: ArrayLike = 0.0,
    phases: ArrayLike = 0.0,
) -> LoadHistory:
    """Return pieces ``(p,)``; one value is that of all."""
    pieces = np.array(
        np.broadcast_arrays(begins, ends, values, slopes, amplitudes, omegas, phases), dtype=float
    )
    return LoadHistory(*pieces)


def differentiate_load(load: LoadHistory) -> LoadHistory:
    """Return the rate of a load over time; jumps are impulses.

    Raises:
        ModelError: It strikes, so that it has no rate.
    """
    if load.impulses:
        raise ModelError("has jumps that no mass can follow; let it rise by a ramp or a half_sine")
    spans = np.where(np.isfinite(load.ends), load.ends - load.begins, 0.0)
    first = load.values + load.amplitudes * np.sin(load.phases)
    last = load.values + load.slopes * spans
    last += load.amplitudes * np.sin(load.omegas * spans + load.phases)
    size = float(np.abs([first, last]).max(initial=abs(load.before)))
    impulses, level, until = [], load.before, 0.0
    for begin, end, value, after in zip(load.begins, load.ends, first, last, strict=True):
        if begin > until:
            impulses += [(until, -level)]
            level = 0.0
        impulses += [(begin, value - level)]
        level, until = after, end
    if np.isfinite(until):
        impulses += [(until, -level)]
    rate = _join_pieces(
        load.begins,
        load.ends,
        values=load.slopes,
        amplitudes=load.omegas * load.amplitudes,
        omegas=load.omegas,
        phases=load.phases + 0.5 * np.pi,
    )
    struck = tuple(
        (float(at), float(jump)) for at, jump in impulses if abs(jump) > SAME_VALUE * size
    )
    return dataclasses.replace(rate, impulses=struck)


def step_loads(loads: Sequence[LoadHistory], duration: float, sampling_hz: float) -> SteppedLoads:
    """Return the loads on a grid of even samples and of the instants at which one of them jumps or
    bends.

    Args:
        loads: ``k`` of them.
        duration: From zero [s].
        sampling_hz: Samples a second; the last one is the first at or after the duration.

    Raises:
        ModelError: There is not one step.
    """
    step = 1.0 / sampling_hz
    count = int(np.ceil(duration * sampling_hz - SAME_TIME))
    if count < 1:
        raise ModelError(f"{duration:g} s are less than one sample at {sampling_hz:g} Hz")
    samples = step * np.arange(count + 1)
    instants = [load.instants for load in loads]
    inner = np.unique(np.concatenate([np.zeros(0), *instants]))
    inner = inner[(inner > 0.0) & (inner < samples[-1])]
    # instants that are samples but for roundoff do not make steps of their own
    inner = inner[
        np.abs(inner / step - np.round(inner / step)) > SAME_TIME * np.maximum(1.0, inner / step)
    ]
    times = np.unique(np.concatenate([samples, inner]))
    return SteppedLoads(
        times,
        np.stack([_linear_part(load, times) for load in loads], axis=-1),
        _sines(loads, times),
        np.stack([_struck(load, times) for load in loads], axis=-1),
        np.asarray(np.searchsorted(times, samples), dtype=np.intp),
    )


def _active(load: LoadHistory, times: FloatArray) -> tuple[IndexArray, BoolArray]:
    """Return the piece that acts on each step, and whether one does."""
    middle = 0.5 * (times[1:] + times[:-1])
    piece = np.searchsorted(load.begins, middle, side="right") - 1
    acts = piece >= 0
    acts[acts] = middle[acts] < load.ends[piece[acts]]
    return np.maximum(piece, 0), acts


def _linear_part(load: LoadHistory, times: FloatArray) -> FloatArray:
    """Return the linear part ``(n - 1, 2)`` at both ends of each step."""
    ends = np.zeros((len(times) - 1, 2))
    if not len(load.begins):
        return ends
    piece, acts = _active(load, times)
    since = np.stack([times[:-1], times[1:]], axis=1) - load.begins[piece][:, None]
    values = load.values[piece][:, None] + load.slopes[piece][:, None] * since
    return np.where(acts[:, None], values, ends)


def _sines(loads: Sequence[LoadHistory], times: FloatArray) -> tuple[_Sine, ...]:
    omegas = sorted({float(omega) for load in loads for omega in load.omegas if omega})
    sines = []
    for omega in omegas:
        forward = np.zeros((len(times) - 1, len(loads)))
        quadrature = np.zeros_like(forward)
        for column, load in enumerate(loads):
            if omega not in load.omegas:
                continue
            piece, acts = _active(load, times)
            acts = acts & (load.omegas[piece] == omega)
            phase = omega * (times[:-1] - load.begins[piece]) + load.phases[piece]
            forward[:, column] = np.where(acts, load.amplitudes[piece] * np.cos(phase), 0.0)
            quadrature[:, column] = np.where(acts, load.amplitudes[piece] * np.sin(phase), 0.0)
        sines.append(_Sine(omega, forward, quadrature))
    return tuple(sines)


def _struck(load: LoadHistory, times: FloatArray) -> FloatArray:
    """Return the impulse ``(n,)`` at each time; those after the last are none."""
    impulses = np.zeros(len(times))
    for at, size in load.impulses:
        nearest = int(np.argmin(np.abs(times - at)))
        if at <= times[-1] + SAME_TIME:
            impulses[nearest] += size
    return impulses
