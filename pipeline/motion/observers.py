"""Probes while a machine goes along a trajectory: displacement beside the rigid travel and stress, of modes,
motors, forces on the tool and the accelerations of the rigid motion.
"""

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.motion.motors import MovingMachine
from headstock.pipeline.motion.probe_motions import (
    place_probes,
    probe_outputs,
    watch_probes,
)
from headstock.pipeline.motion.trajectory import (
    Feedthrough,
    Further,
    Join,
    PosedErrors,
    RigidTrajectory,
)
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


def join_probes(parts: MachineParts, trajectory: RigidTrajectory) -> Join:
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


@dataclass(frozen=True, eq=False)
class DrivenBodies:
    """The rigid machine as its motors deviate.

    Attributes:
        seen: What the machine did, what motors accelerate among what acted on it.
        bodies: Channels of the rigid motion that motors move.
        travels: ``(n, b)`` in these channels, beside those by the weight.
    """

    seen: SampledHistory
    bodies: tuple[Channel, ...] = ()
    travels: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def follow_probes(self, placed: Mapping[str, PlacedProbe]) -> FloatArray:
        """Return what ``p`` probes see ``(n, 9 p)`` beside what they see of the weight.

        Args:
            placed: Probes of the machine, anywhere along the trajectory.
        """
        found = self.seen.observe(watch_probes(placed))
        if self.bodies and placed:
            rides = self.seen.plant.direct_of(_ride_channels(placed), self.bodies)
            ridden = self.seen.motion.apply(rides, self.travels)
            moved = found.reshape(-1, len(placed), SEEN)[:, :, :MOVED]
            moved += ridden.reshape(-1, len(placed), MOVED)
        return found


def drive_bodies(machine: MovingMachine, seen: SampledHistory) -> DrivenBodies:
    """Add what motors move to what a machine did."""
    motors, servo = machine.driven.motors, machine.servo
    if motors is None or servo is None:
        return DrivenBodies(seen)
    places = servo.motors
    motion, history = seen.motion, seen.history
    travels = motors.at(motion.nodes).bodies
    columns = Index(seen.inputs).of(motors.bodies)

    def acting(part: slice) -> FloatArray:
        values = np.array(seen.acting(part))
        values[:, columns] += apply_matrices(
            motion.between(travels, part), history.acceleration[part, places]
        )
        return values

    deviating = history.compliant[:, places] - motion.deflect()[:, places]
    return DrivenBodies(
        dataclasses.replace(seen, acting=acting),
        motors.bodies,
        motion.apply(travels, deviating),
    )
