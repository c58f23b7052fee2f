"""Probes while the tool of a mechanism goes along a line: displacement and stress in the pose of the
middle, of modes, motors and the accelerations of the rigid motion.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.contours.way_motors import WayMotors
from headstock.pipeline.stages.probe_motions import (
    place_probes,
    probe_outputs,
    read_probes,
    watch_probes,
)
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.path_loads import body_travel
from headstock.reduction.coupling.probes import PlacedProbe, moved_inertia
from headstock.solvers.paths.linear_motion import CompliantHistory, LinearMotion, interpolate_nodes
from headstock.solvers.paths.sampled_motion import TOOL
from headstock.solvers.paths.varying_system import PosedModes, SampledPlant
from headstock.solvers.second_order import Channel

KINDS = ("values", "viscous", "late")


@dataclass(frozen=True, eq=False)
class LineProbes:
    """Probes of a machine in a pose.

    Attributes:
        placed: By name.
        rows: Channel to its output row ``(n,)`` in the coordinates of the machine.
        late: Of each probe in a body that is carried, what the modes left out add ``(9, 6)`` per acceleration of its component as
            a rigid body, along and about machine axes.
        arms: ``(3,)`` of each, from its component's centre of mass, machine axes [m].
    """

    placed: Mapping[str, PlacedProbe]
    rows: Mapping[Channel, FloatArray]
    late: Mapping[str, FloatArray]
    arms: Mapping[str, FloatArray]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Outputs: all values, then what rates and accelerations add."""
        watch = watch_probes(self.placed)
        return (*watch.channels, *watch.rates.values(), *watch.accelerations.values())

    def join(self, posed: PosedModes) -> PosedModes:
        """A machine with these outputs."""
        outputs = {**posed.system.outputs, **self.rows}
        return dataclasses.replace(posed, system=dataclasses.replace(posed.system, outputs=outputs))


def find_probes(parts: MachineParts, model: PoseModel) -> LineProbes:
    """Probes of a machine in a pose; none of a lumped mechanism."""
    machine, mechanism, coupled = parts.scene.machine, parts.scene.mechanism, model.coupled
    carried = (
        {name for axis in machine.axes.values() for name in axis.moves}
        if mechanism is None
        else {*mechanism.carries}
    )
    placed = place_probes(parts, coupled, tuple(machine.probes))
    late, arms = {}, {}
    for name, probe in placed.items():
        body, own = parts.superelements[probe.component], machine.probes[name]
        if coupled is not None and probe.component in carried:
            travel = body_travel(coupled, probe.component)
            late[name] = -moved_inertia(coupled, own, travel)
        placement = model.placements[probe.component]
        arms[name] = placement.rotation @ (np.array(own.position) - body.center_of_mass)
    return LineProbes(placed, probe_outputs(parts, placed), late, arms)


def follow_probes(
    probes: LineProbes,
    motion: LinearMotion,
    history: CompliantHistory,
    found: SampledPlant,
    *,
    first: int,
    acting: FloatArray,
    channels: Sequence[Channel],
    motors: WayMotors | None,
    shown: slice,
) -> dict[str, ProbeMotion]:
    """What probes see beside what they see of the weight, from the beginning.

    Args:
        probes: Whose channels are outputs.
        motion: The machine.
        history: Of its coordinates: modes, then motors.
        found: Matrices at the nodes of the motion.
        first: The first of these outputs.
        acting: ``(n, 3 + r)`` forces on the tool, and what the way gives after gravity.
        channels: ``r`` of the way.
        motors: Under control; None where they follow their set points.
        shown: Which instants.
    """
    if not probes.placed:
        return {}
    values, rates, accelerations = (
        slice(first + kind * size, first + (kind + 1) * size)
        for size in [len(probes.channels) // len(KINDS)]
        for kind in range(len(KINDS))
    )
    weight = interpolate_nodes(motion.times, motion.nodes, motion.gravity_deflection)
    modes = found.rows.shape[2]
    kept, own = slice(0, modes), slice(modes, None)
    moved = history.compliant - weight
    # of what acts, gravity stands between the tool and the way
    beyond = np.delete(found.direct[:, values], TOOL.stop, axis=2)
    seen = motion.apply(found.rows[:, values], moved[:, kept])
    seen += motion.apply(found.rows[:, rates], history.rate[:, kept])
    seen += motion.apply(found.rows[:, accelerations], history.acceleration[:, kept])
    seen += motion.apply(beyond, acting)
    travels = None if motors is None else motors.at(motion.nodes).channels
    for probe, part in zip(probes.placed, np.split(seen, len(probes.placed), axis=1), strict=True):
        start = (probes.placed[probe].component, "acceleration x")
        if probe not in probes.late or start not in channels:
            continue  # its component stands still
        place = channels.index(start)
        body = slice(place, place + 6)
        pulled = acting[:, TOOL.stop :][:, body]
        if travels is not None:
            led = slice(0, travels.shape[2])
            pulled = pulled + motion.apply(travels[:, body], history.acceleration[:, own][:, led])
            ridden = motion.apply(travels[:, body], moved[:, own][:, led])
            part[:, :3] += ridden[:, :3] - ridden[:, 3:] @ skew_matrices(probes.arms[probe]).T
        part += pulled @ probes.late[probe].T
    return read_probes(probes.placed, motion.times[shown], (seen - seen[0])[shown])
