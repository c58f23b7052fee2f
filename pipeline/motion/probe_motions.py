"""Probes while a machine moves, under loads over time or along a trajectory: displacement and
stress from the states of the motion, with their errors. Along a trajectory they are relative to the
rigid motion and contain modes, motors, forces on the tool and rigid accelerations.
"""

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.motion_forces import ProbeMotion, ProbeTrace
from headstock.pipeline.answers.transient import TRUNCATION
from headstock.pipeline.motion.motion_forces import SteppedStates
from headstock.pipeline.motion.motors import MovingMachine
from headstock.pipeline.motion.posed_machine import Further, Join
from headstock.pipeline.motion.trajectory import Feedthrough, PosedErrors, Trajectory
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.stages.probes import CYCLE_SAFETY, rayleigh_damping, watched_rows
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.probes import PlacedProbe, carry_probe, moved_inertia, place_probe
from headstock.reduction.estimates.mesh_errors import SILENT_SHARE
from headstock.reduction.estimates.static_errors import (
    MOVED,
    SEEN,
    STRESSED,
    moved_locally,
)
from headstock.solvers.motion.alpha import apply_matrices
from headstock.solvers.motion.plant_motion import SampledHistory
from headstock.solvers.second_order import Channel, Index
from headstock.solvers.state_spaces.load_history import IndexArray
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.stresses import largest_von_mises, von_mises_change
from headstock.solvers.watched_outputs import Extreme, Watch, WatchedOutputs

RIDE = "travel"


@dataclass(frozen=True, eq=False)
class MovingModel:
    """Store a model of a machine under loads over time, and its motion.

    Attributes:
        space: With ``probe_outputs`` among its outputs.
    """

    space: StateSpace
    motion: SteppedStates


def place_probes(
    parts: MachineParts, coupled: CoupledMachine | None, names: Sequence[str]
) -> dict[str, PlacedProbe]:
    """Return the probes of a machine in its free coordinates; none of a lumped mechanism.

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


@dataclass(frozen=True, eq=False)
class _Observed:
    """Store the outputs of a probe in one model.

    Attributes:
        late: ``(9,)`` outputs of the residual flexibility, which follow accelerations.
        values: ``(N, 9)`` displacement and stress.
    """

    model: MovingModel
    late: WatchedOutputs
    values: FloatArray


def trace_motion(
    probes: Mapping[str, PlacedProbe],
    model: MovingModel,
    others: Mapping[str, MovingModel],
    *,
    doubtful: Mapping[str, MovingModel],
    loads: Sequence[str],
    sampled: IndexArray,
    up_to_hz: float,
    left_out: tuple[str, ...],
) -> dict[str, ProbeMotion]:
    """Return displacement and stress at probes over time, with their errors.

    The modes that a component leaves out respond quasi-statically to the accelerations of its
    boundary, and loads inside it act directly. Viscous damping of the material adds to stresses.

    Args:
        others: Source of error to a model without it; empty where none was sought.
        doubtful: The same with modes without an estimate as low as any may be.
        loads: Name of the static load that each input scales; empty for other inputs.
        sampled: ``(m,)`` indices of the instants that are samples.
        up_to_hz: Highest frequency of modes with inertia [Hz].
        left_out: Sources of error that are not estimated.
    """
    motions = {}
    for name, probe in probes.items():
        observed = _observe(name, probe, model, loads)
        samples = model.motion.at_times(observed.values)[sampled]
        motion, rows = _describe(name, probe, model.motion.instants, observed.values, samples)
        if others:
            sizes = _size(observed.values)
            changed = {}
            for source, other in others.items():
                there = _size(_observe(name, probe, other, loads).values)
                # the error of a peak is less than the motion of the fast modes
                changed[source] = (
                    np.abs(sizes - there).max(axis=1)
                    if source == TRUNCATION
                    else np.abs(sizes.max(axis=1) - there.max(axis=1))
                )
            for source, other in doubtful.items():
                there = _size(_observe(name, probe, other, loads).values)
                change = np.abs(sizes.max(axis=1) - there.max(axis=1))
                silent = change <= SILENT_SHARE * sizes.max(axis=1)
                changed[source] = np.where(silent, change, np.nan)
            motion = _estimate_errors(
                motion, probe, observed, rows, changed, loads, up_to_hz=up_to_hz, left_out=left_out
            )
        motions[name] = motion
    return motions


def _describe(
    name: str,
    probe: PlacedProbe,
    instants: FloatArray,
    values: FloatArray,
    samples: FloatArray,
) -> tuple[ProbeMotion, NDArray[np.intp]]:
    """Return the motion at a probe without errors, and the two instants of its largest equivalent
    stress and its largest displacement.

    Args:
        instants: ``(N,)`` [s].
        values: ``(N, 9)`` displacement and stress then.
        samples: ``(m, 9)`` values to be tabulated.
    """
    sizes = _size(values)
    rows = sizes.argmax(axis=1)
    mises, moved = (
        Extreme(float(size[row]), float(instants[row]))
        for size, row in zip(sizes, rows, strict=True)
    )
    motion = ProbeMotion(
        component=probe.component,
        trace=ProbeTrace(name, samples[:, :MOVED], samples[:, MOVED:]),
        von_mises=mises,
        stress=values[rows[0], MOVED:],
        displacement=moved,
        von_mises_error=Estimate(),
        displacement_error=Estimate(),
        singular=probe.singular,
    )
    return motion, rows


def probe_outputs(
    parts: MachineParts, probes: Mapping[str, PlacedProbe]
) -> dict[Channel, FloatArray]:
    """Return output rows ``(n,)`` for probes of a motion in time: displacement and stress,
    contributions of rates and accelerations, and those that error estimates need.
    """
    rows = watched_rows(probes)
    for name, probe in probes.items():
        alpha, beta = rayleigh_damping(parts, probe.component)
        viscous = -alpha * probe.inertia
        viscous[MOVED:] += beta * probe.values[MOVED:]
        for number in range(SEEN):
            rows[name, f"viscous {number}"] = viscous[number]
            rows[name, f"late {number}"] = -probe.inertia[number]
    return rows


def watch_probes(names: Iterable[str]) -> Watch:
    """Return displacement and stress at probes as outputs: 9 numbers each."""
    channels = [(name, number) for name in names for number in range(SEEN)]
    return Watch(
        tuple((name, f"values {number}") for name, number in channels),
        {(name, f"values {number}"): (name, f"viscous {number}") for name, number in channels},
        {(name, f"values {number}"): (name, f"late {number}") for name, number in channels},
    )


def probe_values(names: Iterable[str]) -> dict[str, tuple[Channel, ...]]:
    """Return the channels of displacement and stress at each of some probes."""
    return {name: watch_probes([name]).channels for name in names}


def smoothing_channels(probes: Mapping[str, PlacedProbe]) -> tuple[Channel, ...]:
    """Return the channels of the stress changes by recovery at probes and around, where known."""
    return tuple(
        (name, f"smoothing {number}")
        for name, probe in probes.items()
        if probe.smoothing is not None
        for number in range(STRESSED * len(probe.smoothing))
    )


def read_probes(
    probes: Mapping[str, PlacedProbe],
    times: FloatArray,
    observed: FloatArray,
    smoothed: FloatArray | None = None,
) -> dict[str, ProbeMotion]:
    """Return the motions of probes at times; with the stress changes by recovery at their peaks,
    where given.

    Args:
        probes: ``p`` of them.
        times: ``(n,)`` [s].
        observed: ``(n, 9 p)`` displacement and stress of each.
        smoothed: ``(n, s)`` values of ``smoothing_channels``; None for nothing.
    """
    motions, first = {}, 0
    parts = np.split(observed, max(len(probes), 1), axis=1)
    for (name, probe), values in zip(probes.items(), parts, strict=False):
        motion, rows = _describe(name, probe, times, values, values)
        if smoothed is not None:
            sizes: tuple[float | None, float | None] = (None, None)
            if probe.smoothing is not None:
                last = first + STRESSED * len(probe.smoothing)
                changes = (smoothed[row, first:last].reshape(-1, STRESSED) for row in rows)
                sizes, first = _change_locally(probe, motion.stress, *changes), last
            mises, moved = (Estimate({DISCRETISATION: size}) for size in sizes)
            motion = dataclasses.replace(motion, von_mises_error=mises, displacement_error=moved)
        motions[name] = motion
    return motions


def _change_locally(
    probe: PlacedProbe, stress: FloatArray, stressed: FloatArray, moved: FloatArray
) -> tuple[float | None, float]:
    """Estimate errors of the mesh around a probe that add to those of the machine's motion: of the
    equivalent stress and of the displacement, when they are largest.

    Args:
        stress: ``(6,)`` when it is largest.
        stressed: ``(s, 6)`` stress changes by recovery then.
        moved: ``(s, 6)`` the same when the displacement is largest.
    """
    changed = float(np.linalg.norm(von_mises_change(stress, CYCLE_SAFETY * stressed)))
    return None if probe.singular else changed, float(moved_locally(probe.strain_reach, moved))


def _observe(name: str, probe: PlacedProbe, model: MovingModel, loads: Sequence[str]) -> _Observed:
    watch = watch_probes([name])
    whole, early = model.space.watch(watch), model.space.watch(Watch(watch.channels, watch.rates))
    late = WatchedOutputs(whole.states - early.states, whole.inputs - early.inputs)
    inputs = whole.inputs.copy()
    for column, load in enumerate(loads):
        if load in probe.loads:
            inputs[:, column] += probe.loads[load].values
    return _Observed(model, late, model.motion.observe(WatchedOutputs(whole.states, inputs)))


def _size(values: FloatArray) -> FloatArray:
    """Return the equivalent stress and the size of the displacement ``(2, n)`` of outputs."""
    moved = np.linalg.norm(values[:, :MOVED], axis=1)
    return np.stack([largest_von_mises(values[:, MOVED:]), moved])


def _estimate_errors(
    motion: ProbeMotion,
    probe: PlacedProbe,
    own: _Observed,
    rows: NDArray[np.intp],
    changed: Mapping[str, FloatArray],
    loads: Sequence[str],
    *,
    up_to_hz: float,
    left_out: tuple[str, ...],
) -> ProbeMotion:
    """Estimate the errors of both peaks: differences in other models, stress changes by recovery,
    and the dynamic part of the modes left out at the highest frequency that is resolved.

    Args:
        rows: Instants of the largest equivalent stress and of the largest displacement.
        changed: Source of error to the change ``(2,)`` of both peaks; NaN where it is unknown.
    """
    reach = (2.0 * np.pi * up_to_hz) ** 2 / probe.limit
    beyond = reach / (1.0 - reach) if reach < 1.0 else None
    # the quasi-static part of these modes is largest with the acceleration, not at the peak
    late = _size(own.model.motion.observe(own.late)).max(axis=1)
    local: list[float | None] = [None, None]
    if probe.missing is not None and probe.smoothing is not None:
        stressed, moved = (
            _read_rows(own, motion.trace.name, "smoothing", probe, row, loads).reshape(-1, STRESSED)
            for row in rows
        )
        missing = _read_rows(own, motion.trace.name, "missing", probe, rows[1], loads)[:MOVED]
        local[0], within = _change_locally(probe, motion.stress, stressed, moved)
        local[1] = probe.mesh_safety * float(np.linalg.norm(missing)) + within
    estimates = []
    for kind in (0, 1):
        shares: dict[str, float | None] = {
            source: None if np.isnan(change[kind]) else float(change[kind])
            for source, change in changed.items()
        }
        for source, size in (
            (DISCRETISATION, local[kind]),
            (REDUCTION, None if beyond is None else beyond * float(late[kind])),
        ):
            others = shares.get(source, 0.0)
            shares[source] = None if size is None or others is None else others + size
        estimates.append(Estimate(shares, left_out))
    return dataclasses.replace(
        motion, von_mises_error=estimates[0], displacement_error=estimates[1]
    )


def _read_rows(
    own: _Observed, name: str, kind: str, probe: PlacedProbe, row: np.intp, loads: Sequence[str]
) -> FloatArray:
    """Return the rows of a kind at an instant, with loads inside the component."""
    space, motion = own.model.space, own.model.motion
    channels = [one for one in space.outputs if one[0] == name and one[1].startswith(f"{kind} ")]
    acting = motion.acting[row]
    values = space.watch(Watch(tuple(channels))).evaluate(motion.states[row], acting)
    for column, load in enumerate(loads):
        inside = None if load not in probe.loads else getattr(probe.loads[load], kind)
        if inside is not None:
            values = values + acting[column] * inside.ravel()
    return values


def probe_channels(names: Collection[str]) -> tuple[Channel, ...]:
    """Return the output channels of probes: all values, then contributions of rates and
    accelerations, then displacements by rigid motion.
    """
    return (*watch_probes(names).outputs, *_ride_channels(names))


def _ride_channels(names: Iterable[str]) -> tuple[Channel, ...]:
    """Return the output channels of the displacements of probes by rigid motion."""
    return tuple((name, f"{RIDE} {along}") for name in names for along in DIRECTIONS)


def probe_kinds(channels: Iterable[Channel], names: Collection[str]) -> dict[Channel, Channel]:
    """Return the kind of every probe output: the misfit of splines along a trajectory is relative
    to the largest output of a kind.
    """
    kinds = {}
    for name, kind in channels:
        if name in names:
            words, number = kind.split()
            still = number in DIRECTIONS or int(number) < MOVED
            kinds[name, kind] = (name, f"{words} {'displacement' if still else 'stress'}")
    return kinds


def join_probes(parts: MachineParts, trajectory: Trajectory) -> Join:
    """Return a function that adds the outputs of probes to a machine along a trajectory; none where
    it has no probes.
    """

    def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
        machine, coupled = parts.scene.machine, model.coupled
        if coupled is None or not machine.probes:
            return {}, {}
        placed = place_probes(parts, coupled, tuple(machine.probes))
        travels, none = trajectory.travels(coupled), np.zeros(len(model.system.mass))
        rows, taken = probe_outputs(parts, placed), Feedthrough()
        for name, probe in placed.items():
            named = machine.probes[name]
            # the modes that the component leaves out respond quasi-statically to its acceleration
            late = -moved_inertia(coupled, named, travels[coupled.offsets[probe.component]])
            ridden = carry_probe(coupled, named, travels)[:MOVED]
            rides = _ride_channels([name])
            rows |= dict.fromkeys(rides, none)
            outputs = [*watch_probes([name]).channels, *rides]
            taken |= {
                (output, channel): float(value)
                for output, values in zip(outputs, np.vstack([late, ridden]), strict=True)
                for channel, value in zip(trajectory.bodies, values, strict=True)
                if value
            }
        return rows, taken

    return join


def add_motor_accelerations(machine: MovingMachine, history: SampledHistory) -> SampledHistory:
    """Add the accelerations of bodies by motors to the inputs that acted on a machine."""
    motors, servo = machine.driven.motors, machine.servo
    if motors is None or servo is None:
        return history
    motion, columns = history.motion, Index(history.inputs).of(motors.bodies)
    travels = motors.at(machine.driven.followed.law(motion.nodes)).bodies

    def acting(part: slice) -> FloatArray:
        values = np.array(history.acting(part))
        values[:, columns] += apply_matrices(
            motion.between(travels, part), history.history.acceleration[part, servo.motors]
        )
        return values

    return dataclasses.replace(history, acting=acting)


def observe_probes(
    machine: MovingMachine, history: SampledHistory, placed: Mapping[str, PlacedProbe]
) -> FloatArray:
    """Return the outputs of ``p`` probes ``(n, 9 p)``, by modes and by motors that move the rigid
    machine, less those under gravity.

    Args:
        history: History of the machine, without the accelerations of bodies by motors.
        placed: Probes of the machine, anywhere along the trajectory.
    """
    values = add_motor_accelerations(machine, history).observe(watch_probes(placed))
    motors, servo, motion = machine.driven.motors, machine.servo, history.motion
    if motors is None or servo is None or not placed:
        return values
    travels = motors.at(machine.driven.followed.law(motion.nodes)).bodies
    deviating = (history.history.compliant - motion.deflect())[:, servo.motors]
    rides = history.plant.direct_of(_ride_channels(placed), motors.bodies)
    ridden = motion.apply(rides, motion.apply(travels, deviating))
    moved = values.reshape(-1, len(placed), SEEN)[:, :, :MOVED]
    moved += ridden.reshape(-1, len(placed), MOVED)
    return values
