"""Probes while a machine goes along a trajectory: displacement beside the rigid travel and stress, of modes,
motors, forces on the tool and the accelerations of the rigid motion.
"""

import dataclasses
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.motion.motors import MovingMachine
from headstock.pipeline.motion.posed_machine import Further, Join
from headstock.pipeline.motion.probe_motions import (
    place_probes,
    probe_outputs,
    watch_probes,
)
from headstock.pipeline.motion.trajectory import Feedthrough, PosedErrors, Trajectory
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.probes import PlacedProbe, carry_probe, moved_inertia
from headstock.reduction.estimates.static_errors import MOVED, SEEN
from headstock.solvers.motion.alpha import apply_matrices
from headstock.solvers.motion.plant_motion import SampledHistory
from headstock.solvers.second_order import Channel, Index

RIDE = "travel"


def probe_channels(names: Collection[str]) -> tuple[Channel, ...]:
    """Outputs of probes: all values, then what rates and accelerations add, then where the rigid travel
    takes them.
    """
    return (*watch_probes(names).outputs, *_ride_channels(names))


def _ride_channels(names: Iterable[str]) -> tuple[Channel, ...]:
    """Outputs of where the rigid travel takes probes."""
    return tuple((name, f"{RIDE} {along}") for name in names for along in DIRECTIONS)


def probe_kinds(channels: Iterable[Channel], names: Collection[str]) -> dict[Channel, Channel]:
    """Return the kind of every output of probes: what splines along a trajectory miss of outputs of one kind
    is a share of the largest.
    """
    kinds = {}
    for name, kind in channels:
        if name in names:
            words, place = kind.split()
            still = place in DIRECTIONS or int(place) < MOVED
            kinds[name, kind] = (name, f"{words} {'displacement' if still else 'stress'}")
    return kinds


def join_probes(parts: MachineParts, trajectory: Trajectory) -> Join:
    """Give a machine along a trajectory the outputs of its probes; none where it has none."""

    def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
        machine, coupled = parts.scene.machine, model.coupled
        if coupled is None or not machine.probes:
            return {}, {}
        placed = place_probes(parts, coupled, tuple(machine.probes))
        travels, none = trajectory.travels(coupled), np.zeros(len(model.system.mass))
        rows, taken = probe_outputs(parts, placed), Feedthrough()
        for name, probe in placed.items():
            own = machine.probes[name]
            # what modes that the component leaves out add follows its acceleration at once
            late = -moved_inertia(coupled, own, travels[coupled.offsets[probe.component]])
            ridden = carry_probe(coupled, own, travels)[:MOVED]
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


def drive_bodies(machine: MovingMachine, history: SampledHistory) -> SampledHistory:
    """Add what motors accelerate to what acted on a machine."""
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
    """Return the outputs of ``p`` probes ``(n, 9 p)``, less what the weight does: as modes move, and as
    motors move the rigid machine.

    Args:
        history: What the machine did, without what motors accelerate.
        placed: Probes of the machine, anywhere along the trajectory.
    """
    values = drive_bodies(machine, history).observe(watch_probes(placed))
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
