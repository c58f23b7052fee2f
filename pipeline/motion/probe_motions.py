"""Probes while a machine moves in time: displacement and stress from the states of the motion, with
their errors.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import ProbeMotion, ProbeTrace
from headstock.pipeline.answers.transient import TRUNCATION
from headstock.pipeline.motion.motion_forces import SteppedStates
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.stages.machine import DAMPING
from headstock.pipeline.stages.probes import CYCLE_SAFETY, watched_rows
from headstock.pipeline.stages.run_state import MachineParts
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.probes import PlacedProbe, place_probe
from headstock.reduction.estimates.mesh_errors import SILENT_SHARE
from headstock.reduction.estimates.static_errors import (
    MOVED,
    SEEN,
    STRESSED,
    moved_locally,
)
from headstock.solvers.linear.load_history import IndexArray
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.second_order import Channel
from headstock.solvers.stresses import largest_von_mises, von_mises_change
from headstock.solvers.watched_outputs import CHUNK, Extreme, Watch, WatchedOutputs, find_largest


@dataclass(frozen=True, eq=False)
class MovingModel:
    """A model of a machine under loads over time, and its motion.

    Attributes:
        space: With ``probe_outputs`` among its outputs.
    """

    space: StateSpace
    motion: SteppedStates


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a probe sees of a model.

    Attributes:
        whole: ``(9,)`` outputs of displacement and stress.
        late: ``(9,)`` the share in them of modes left out, which follow accelerations.
    """

    whole: WatchedOutputs
    late: WatchedOutputs


@dataclass(frozen=True, eq=False)
class _Peak:
    """The largest of values over a motion.

    Attributes:
        end: It is at the end of a step, not at the begin.
    """

    extreme: Extreme
    end: int
    step: int


def place_probes(
    parts: MachineParts, coupled: CoupledMachine | None, names: Sequence[str]
) -> dict[str, PlacedProbe]:
    """Probes of a machine in its free coordinates; none of a lumped mechanism.

    Raises:
        ModelError: A component was reduced without its probe.
    """
    if coupled is None:
        return {}
    machine = parts.scene.machine
    return {
        name: place_probe(coupled, machine, machine.probes[name], parts.plan.gravity)
        for name in names
    }


def trace_motion(
    probes: Mapping[str, PlacedProbe],
    own: MovingModel,
    others: Mapping[str, MovingModel],
    *,
    doubtful: Mapping[str, MovingModel],
    loads: Sequence[str],
    sampled: IndexArray,
    up_to_hz: float,
    left_out: tuple[str, ...],
) -> dict[str, ProbeMotion]:
    """Displacement and stress at probes over time, with their errors.

    The modes that a component leaves out follow the accelerations of its boundary as at rest, and
    loads inside it act at once. Viscous damping of the material adds to stresses.

    Args:
        others: Source of error to a model without it; empty where none was sought.
        doubtful: The same where modes without an estimate are as low as any may be.
        loads: The static load that each input is, whole; empty of others.
        sampled: ``(m,)`` which of the times are samples.
        up_to_hz: Modes up to here vibrate.
        left_out: What is not looked at.
    """
    found = {}
    for name, probe in probes.items():
        seen = _see(name, probe, own.space, loads)
        values = own.motion.at_times(seen.whole)[sampled]
        trace = ProbeTrace(name, values[:, :MOVED], values[:, MOVED:])
        mises, moved = _find_peaks(own.motion, seen.whole)
        motion = ProbeMotion(
            component=probe.component,
            trace=trace,
            von_mises=mises.extreme,
            stress=_at_peak(own.motion, seen.whole, mises)[MOVED:],
            displacement=moved.extreme,
            von_mises_error=Estimate(),
            displacement_error=Estimate(),
            singular=probe.singular,
        )
        if others:
            changed = {
                source: _compare(
                    (own.motion, seen.whole),
                    (other.motion, _see(name, probe, other.space, loads).whole),
                    always=source == TRUNCATION,
                )
                for source, other in others.items()
            }
            sizes = np.array([mises.extreme.value, moved.extreme.value])
            for source, other in doubtful.items():
                seen_there = _see(name, probe, other.space, loads).whole
                change = _compare(
                    (own.motion, seen.whole), (other.motion, seen_there), always=False
                )
                changed[source] = np.where(change <= SILENT_SHARE * sizes, change, np.nan)
            motion = _judge(
                motion,
                probe,
                name,
                own,
                seen,
                peaks=(mises, moved),
                changed=changed,
                loads=loads,
                up_to_hz=up_to_hz,
                left_out=left_out,
            )
        found[name] = motion
    return found


def probe_outputs(
    parts: MachineParts, probes: Mapping[str, PlacedProbe]
) -> dict[Channel, FloatArray]:
    """Output rows ``(n,)`` of what a motion in time is asked for at probes: what is seen, what its rate
    and its acceleration add, and what errors need.
    """
    rows = watched_rows(probes)
    for name, probe in probes.items():
        alpha, beta = _rayleigh(parts, probe.component)
        viscous = -alpha * probe.inertia
        viscous[MOVED:] += beta * probe.values[MOVED:]
        for number in range(SEEN):
            rows[name, f"viscous {number}"] = viscous[number]
            rows[name, f"late {number}"] = -probe.inertia[number]
    return rows


def watch_probes(names: Iterable[str]) -> Watch:
    """Displacement and stress at probes: 9 numbers each."""
    channels = [(name, number) for name in names for number in range(SEEN)]
    return Watch(
        tuple((name, f"values {number}") for name, number in channels),
        {(name, f"values {number}"): (name, f"viscous {number}") for name, number in channels},
        {(name, f"values {number}"): (name, f"late {number}") for name, number in channels},
    )


def probe_values(names: Iterable[str]) -> dict[str, tuple[Channel, ...]]:
    """Displacement and stress at each of some probes."""
    return {name: watch_probes([name]).channels for name in names}


def watch_path_probes(probes: Mapping[str, PlacedProbe]) -> Watch:
    """The same, then what recovery changes in the stresses of all of them."""
    return watch_probes(probes).join(Watch(smoothing_channels(probes)))


def smoothing_channels(probes: Mapping[str, PlacedProbe]) -> tuple[Channel, ...]:
    """What recovery changes in the stresses at probes and around, where that is known."""
    return tuple(
        (name, f"smoothing {number}")
        for name, probe in probes.items()
        if probe.smoothing is not None
        for number in range(STRESSED * len(probe.smoothing))
    )


def read_probes(
    probes: Mapping[str, PlacedProbe],
    times: FloatArray,
    seen: FloatArray,
    smoothed: FloatArray | None = None,
) -> dict[str, ProbeMotion]:
    """What probes saw at times; of their errors what recovery changes when they saw most, where that is
    given.

    Args:
        probes: ``p`` of them.
        times: ``(n,)`` [s].
        seen: ``(n, 9 p)`` displacement and stress of each.
        smoothed: ``(n, s)`` values of ``smoothing_channels``; None for nothing.
    """
    found, first = {}, 0
    for (name, probe), own in zip(
        probes.items(), np.split(seen, max(len(probes), 1), axis=1), strict=False
    ):
        mises, moved = find_largest(times, _size(own).T)
        stress, errors = own[int(np.searchsorted(times, mises.time)), MOVED:], [Estimate()] * 2
        if smoothed is not None:
            last = first + STRESSED * (0 if probe.smoothing is None else len(probe.smoothing))
            changes = [
                smoothed[int(np.searchsorted(times, peak.time)), first:last].reshape(-1, STRESSED)
                for peak in (mises, moved)
            ]
            sizes = (
                (None, None)
                if probe.smoothing is None
                else _change_locally(probe, stress, *changes)
            )
            errors, first = [Estimate({DISCRETISATION: size}) for size in sizes], last
        found[name] = ProbeMotion(
            component=probe.component,
            trace=ProbeTrace(name, own[:, :MOVED], own[:, MOVED:]),
            von_mises=mises,
            stress=stress,
            displacement=moved,
            von_mises_error=errors[0],
            displacement_error=errors[1],
            singular=probe.singular,
        )
    return found


def _change_locally(
    probe: PlacedProbe, stress: FloatArray, stressed: FloatArray, moved: FloatArray
) -> tuple[float | None, float]:
    """What the mesh around a probe may change beside what it changes in the motion of the machine: in
    the equivalent stress and in the displacement, when they are largest.

    Args:
        stress: ``(6,)`` when it is largest.
        stressed: ``(s, 6)`` what recovery changes then.
        moved: ``(s, 6)`` the same when the displacement is largest.
    """
    changed = float(np.linalg.norm(von_mises_change(stress, CYCLE_SAFETY * stressed)))
    return None if probe.singular else changed, float(moved_locally(probe.strain_reach, moved))


def _see(name: str, probe: PlacedProbe, space: StateSpace, loads: Sequence[str]) -> _Seen:
    own = watch_probes([name])
    whole, early = space.watch(own), space.watch(Watch(own.channels, own.rates))
    late = WatchedOutputs(whole.states - early.states, whole.inputs - early.inputs)
    inputs = whole.inputs.copy()
    for column, load in enumerate(loads):
        if load in probe.loads:
            inputs[:, column] += probe.loads[load].values
    return _Seen(WatchedOutputs(whole.states, inputs), late)


def _rayleigh(parts: MachineParts, component: str) -> tuple[float, float]:
    """Coefficients of mass and stiffness [1/s, s] of a component; zero without the effect damping."""
    if DAMPING not in parts.scene.effects:
        return 0.0, 0.0
    every = parts.scene.machine.rayleigh
    own = parts.scene.machine.components[component].rayleigh
    return every.alpha + own.alpha, every.beta + own.beta


def _find_peaks(motion: SteppedStates, seen: WatchedOutputs) -> tuple[_Peak, _Peak]:
    """The largest equivalent stress, and the largest size of the displacement."""
    peaks = [_Peak(Extreme(-1.0, 0.0), 0, 0)] * 2
    for end in (0, 1):
        for start in range(0, len(motion.times) - 1, CHUNK):
            part = slice(start, start + CHUNK)
            values = seen.evaluate(motion.states[end][part], motion.acting[end][part])
            for kind, size in enumerate(_size(values)):
                row = int(np.argmax(size))
                if size[row] > peaks[kind].extreme.value:
                    extreme = Extreme(float(size[row]), float(motion.times[start + row + end]))
                    peaks[kind] = _Peak(extreme, end, start + row)
    return peaks[0], peaks[1]


def _size(values: FloatArray) -> FloatArray:
    """Equivalent stress, and size of the displacement ``(2, n)``, of what is seen ``(n, 9)``."""
    moved = np.linalg.norm(values[:, :MOVED], axis=1)
    return np.stack([largest_von_mises(values[:, MOVED:]), moved])


def _compare(
    first: tuple[SteppedStates, WatchedOutputs],
    second: tuple[SteppedStates, WatchedOutputs],
    *,
    always: bool,
) -> FloatArray:
    """How far two models of a probe are apart ``(2,)``: their peaks, or at any time.

    Args:
        first: A motion and what a probe sees of it.
        second: The same of another model, on the same steps.
        always: At any time: fast modes move peaks by less than they move.
    """
    if not always:
        peaks = zip(_find_peaks(*first), _find_peaks(*second), strict=True)
        return np.array([abs(ours.extreme.value - own.extreme.value) for ours, own in peaks])
    found = np.zeros(2)
    for end in (0, 1):
        for start in range(0, len(first[0].times) - 1, CHUNK):
            part = slice(start, start + CHUNK)
            ours, theirs = (
                _size(seen.evaluate(motion.states[end][part], motion.acting[end][part]))
                for motion, seen in (first, second)
            )
            found = np.maximum(found, np.abs(ours - theirs).max(axis=1))
    return np.asarray(found)


def _at_peak(motion: SteppedStates, seen: WatchedOutputs, peak: _Peak) -> FloatArray:
    """Values ``(k,)`` of outputs when a peak occurs."""
    return seen.evaluate(motion.states[peak.end][peak.step], motion.acting[peak.end][peak.step])


def _judge(
    motion: ProbeMotion,
    probe: PlacedProbe,
    name: str,
    own: MovingModel,
    seen: _Seen,
    *,
    peaks: tuple[_Peak, _Peak],
    changed: Mapping[str, FloatArray],
    loads: Sequence[str],
    up_to_hz: float,
    left_out: tuple[str, ...],
) -> ProbeMotion:
    """The errors of both peaks: what they change by in other models, what recovery changes in the
    stress, and what the modes that the component leaves out do beyond their static share at the
    highest frequency that vibrates.
    """
    shares: list[dict[str, float | None]] = [
        {
            source: None if np.isnan(change[kind]) else float(change[kind])
            for source, change in changed.items()
        }
        for kind in (0, 1)
    ]
    reach = (2.0 * np.pi * up_to_hz) ** 2 / probe.limit
    beyond = reach / (1.0 - reach) if reach < 1.0 else None
    # what these modes hold is largest elsewhere than the peak, where accelerations are
    late = [peak.extreme.value for peak in _find_peaks(own.motion, seen.late)]
    local: list[float | None] = [None, None]
    if probe.missing is not None and probe.smoothing is not None:
        stressed, moved = (
            _read_rows(own, name, "smoothing", probe, peak, loads).reshape(-1, STRESSED)
            for peak in peaks
        )
        missing = _read_rows(own, name, "missing", probe, peaks[1], loads)[:MOVED]
        local[0], within = _change_locally(probe, motion.stress, stressed, moved)
        local[1] = probe.mesh_safety * float(np.linalg.norm(missing)) + within
    for kind in (0, 1):
        for source, size in (
            (DISCRETISATION, local[kind]),
            (REDUCTION, None if beyond is None else beyond * late[kind]),
        ):
            known = shares[kind].get(source, 0.0)
            shares[kind][source] = None if size is None or known is None else known + size
    return dataclasses.replace(
        motion,
        von_mises_error=Estimate(shares[0], left_out),
        displacement_error=Estimate(shares[1], left_out),
    )


def _read_rows(
    own: MovingModel,
    name: str,
    kind: str,
    probe: PlacedProbe,
    peak: _Peak,
    loads: Sequence[str],
) -> FloatArray:
    """Rows of a kind when a peak occurs, with loads inside the component."""
    channels = [
        one for one in own.space.outputs if one[0] == name and one[1].startswith(f"{kind} ")
    ]
    values = _at_peak(own.motion, own.space.watch(Watch(tuple(channels))), peak)
    acting = own.motion.acting[peak.end][peak.step]
    for column, load in enumerate(loads):
        inside = None if load not in probe.loads else getattr(probe.loads[load], kind)
        if inside is not None:
            values = values + acting[column] * inside.ravel()
    return values
