"""Probes while a machine goes along a way: displacement beside the rigid travel and stress, of modes,
motors, forces on the tool and the accelerations of the rigid motion.
"""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.contours.ways import RigidWay
from headstock.pipeline.stages.probe_motions import (
    place_probes,
    probe_outputs,
    watch_probes,
)
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.probes import PlacedProbe, carry_probe, moved_inertia
from headstock.reduction.estimates.probe_errors import MOVED, SEEN
from headstock.solvers.paths.linear_motion import CompliantHistory, LinearMotion, chunk_slices
from headstock.solvers.paths.sampled_motion import TOOL
from headstock.solvers.paths.varying_system import PosedModes, SampledPlant
from headstock.solvers.second_order import Channel

RIDE = "travel"


def probe_channels(names: Collection[str]) -> tuple[Channel, ...]:
    """Outputs of probes: all values, then what rates and accelerations add, then where the rigid travel
    takes them.
    """
    watch = watch_probes(names)
    rides = ((name, f"{RIDE} {along}") for name in names for along in DIRECTIONS)
    return (*watch.channels, *watch.rates.values(), *watch.accelerations.values(), *rides)


def alike_channels(channels: Sequence[Channel], names: Collection[str]) -> tuple[int, ...]:
    """Numbers of outputs, the same for those of a probe that are of one kind: what splines along a way
    miss of them is a share of the largest.
    """
    known: dict[tuple[str, str], int] = {}
    numbers = []
    for name, kind in channels:
        if name in names:
            words, place = kind.split()
            still = place in DIRECTIONS or int(place) < MOVED
            kind = f"{words} {'displacement' if still else 'stress'}"
        numbers.append(known.setdefault((name, kind), len(known)))
    return tuple(numbers)


def join_probes(
    parts: MachineParts, model: PoseModel, way: RigidWay, posed: PosedModes
) -> PosedModes:
    """A machine in a pose of a way with the outputs of its probes; as it is where it has none."""
    machine, coupled = parts.scene.machine, model.coupled
    if coupled is None or not machine.probes:
        return posed
    placed = place_probes(parts, coupled, tuple(machine.probes))
    travels, none = way.travels(coupled), np.zeros(len(posed.system.mass))
    rows, taken = probe_outputs(parts, placed), dict[tuple[Channel, Channel], float]()
    for name, probe in placed.items():
        own = machine.probes[name]
        # what modes that the component leaves out add follows its acceleration at once
        late = -moved_inertia(coupled, own, travels[coupled.offsets[probe.component]])
        ridden = carry_probe(coupled, own, travels)[:MOVED]
        kinds = [f"values {number}" for number in range(SEEN)]
        kinds += [f"{RIDE} {along}" for along in DIRECTIONS]
        rows |= {(name, kind): none for kind in kinds[SEEN:]}
        taken |= {
            ((name, kind), channel): float(value)
            for kind, values in zip(kinds, np.vstack([late, ridden]), strict=True)
            for channel, value in zip(way.channels, values, strict=False)
            if value
        }
    return dataclasses.replace(
        posed,
        system=dataclasses.replace(posed.system, outputs={**posed.system.outputs, **rows}),
        feedthrough={**posed.feedthrough, **taken},
    )


def follow_probes(
    placed: Mapping[str, PlacedProbe],
    *,
    motion: LinearMotion,
    history: CompliantHistory,
    found: SampledPlant,
    first: int,
    acting: Callable[[slice], FloatArray],
    led: FloatArray | None,
    further: int = 0,
) -> FloatArray:
    """What ``p`` probes see ``(n, 9 p)`` beside what they see of the weight, and further outputs.

    Args:
        placed: Probes of the machine, anywhere on the way.
        motion: The machine.
        history: Of its coordinates: modes, then motors.
        found: Matrices at the nodes of the motion.
        first: The first of ``probe_channels`` among the outputs.
        acting: Of some instants ``(n, 3 + r)`` forces on the tool, and what the way gives after gravity.
        led: ``(k, b, d)`` travel in the first channels of the way per travel of each motor, at the
            nodes; None where motors follow their set points.
        further: How many outputs after those of the probes are wanted, too, of modes and what acts.
    """
    size, modes = SEEN * len(placed), found.rows.shape[2]
    if not placed:
        return np.zeros((len(motion.times), 0))
    count = len(probe_channels(placed))
    whole = slice(first, first + count + further)
    values, rates, accelerations = (slice(kind * size, (kind + 1) * size) for kind in range(3))
    rides, others = slice(accelerations.stop, count), slice(count, None)
    # of what acts, gravity stands between the tool and the way
    beyond = np.delete(found.direct[:, whole], TOOL.stop, axis=2)
    leads = np.zeros((len(motion.nodes), 0, 0)) if led is None else led
    bodies, motors = (
        slice(TOOL.stop, TOOL.stop + leads.shape[1]),
        slice(modes, modes + leads.shape[2]),
    )
    seen = np.empty((len(motion.times), size + further))
    for part in chunk_slices(len(motion.times)):
        rows, direct, travels = (
            motion.between(each, part) for each in (found.rows[:, whole], beyond, leads)
        )
        moved = history.compliant[part] - motion.between(motion.gravity_deflection, part)
        pulled = acting(part)
        pulled[:, bodies] += _apply(travels, history.acceleration[part, motors])
        own = _apply(rows[:, values], moved[:, :modes])
        own += _apply(rows[:, rates], history.rate[part, :modes])
        own += _apply(rows[:, accelerations], history.acceleration[part, :modes])
        own += _apply(direct[:, values], pulled)
        ridden = _apply(direct[:, rides, bodies], _apply(travels, moved[:, motors]))
        own.reshape(-1, len(placed), SEEN)[:, :, :MOVED] += ridden.reshape(-1, len(placed), MOVED)
        beside = _apply(rows[:, others], moved[:, :modes]) + _apply(direct[:, others], pulled)
        seen[part] = np.concatenate([own, beside], axis=1)
    return seen


def _apply(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """``(n, p)`` products of matrices ``(n, p, c)`` with vectors ``(n, c)``."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
