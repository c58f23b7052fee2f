"""Errors of guides, screws and legs along a way, as preload of their springs: what a machine in a
pose feels of a unit of each, and how large each is on the way.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.mechanisms.exechon import LEGS, LENGTHS
from headstock.geometry.mechanisms.tool_mechanism import solve_pose
from headstock.pipeline.contours.ways import Feedthrough, RigidWay
from headstock.pipeline.stages.lumped_machine import sample_leg_errors
from headstock.pipeline.stages.machine import DAMPING
from headstock.pipeline.stages.mechanism import LumpedPose
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.error_travel import offset_loads, offset_rate_loads, plan_travel
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS, has_errors
from headstock.reduction.coupling.joint_forces import SPRING
from headstock.scene.scene import SceneMechanism
from headstock.solvers.second_order import Channel

STEPS_PER_WAVE = 48
UNIT = 1e-6  # of offsets [m, rad]: loads of all channels are then of like size
BESIDE = 1e-5  # of the way between its ends, over which rates are differenced


@dataclass(frozen=True, eq=False)
class WayErrors:
    """Errors along a way.

    Attributes:
        channels: One per offset, then one per rate that acts through a damper.
        loads: What a unit of each does to a machine in a pose.
        relief: What a unit of each takes off the forces of joints there.
        offsets: ``(n, k)`` at places ``(n,)`` of the way, in units.
        rated: ``(r,)`` offsets whose rates act, too.
        ends: Of the way.
        shortest: Shortest part of the way over which a wave repeats.
    """

    channels: tuple[Channel, ...]
    loads: Callable[[PoseModel], dict[Channel, FloatArray]]
    relief: Callable[[PoseModel], Feedthrough]
    offsets: Callable[[FloatArray], FloatArray]
    rated: tuple[int, ...]
    ends: tuple[float, float]
    shortest: float

    def join(
        self,
        way: RigidWay,
        motion: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    ) -> RigidWay:
        """A way with these errors.

        Args:
            way: Of the rigid machine.
            motion: Places ``(n,)`` of the way at times, and their rates.
        """

        def amounts(times: FloatArray) -> FloatArray:
            places, rates = motion(times)
            here = np.clip(places, *self.ends)
            step = BESIDE * (self.ends[1] - self.ends[0])
            low, high = np.clip(here - step, *self.ends), np.clip(here + step, *self.ends)
            change = (self.offsets(high) - self.offsets(low)) / (high - low)[:, None]
            own = [self.offsets(here), (change * rates[:, None])[:, list(self.rated)]]
            return np.concatenate([way.amounts(times), *own], axis=1)

        return dataclasses.replace(
            way,
            loads=lambda model: way.loads(model) | self.loads(model),
            amounts=amounts,
            channels=(*way.channels, *self.channels),
            relief=self.relief,
        )


def find_way_errors(
    state: RunState, pose_at: Callable[[float], Pose], nodes: FloatArray
) -> WayErrors | None:
    """Errors of a machine along a way; None where it has none.

    Args:
        state: Of the run.
        pose_at: The pose at a place of the way.
        nodes: ``(k,)`` even places between which what errors are read by is interpolated.

    Raises:
        ModelError: A rigid direction has an offset, or a place lies outside a table.
    """
    mechanism, machine = state.scene.mechanism, state.scene.machine
    poses = [pose_at(float(node)) for node in nodes]
    ends = (float(nodes[0]), float(nodes[-1]))
    if state.scene.is_lumped and mechanism is not None:
        return _leg_errors(mechanism, poses, nodes) if mechanism.leg_errors else None
    if not has_errors(machine):
        return None
    travel = plan_travel(machine, state.parts.superelements, nodes, poses)
    if travel is None:
        return None
    damped = {name for name, joint in machine.joints.items() if np.any(joint.damping)}
    rated = [number for number, (name, _) in enumerate(travel.directions) if name in damped]
    channels = (*travel.channels, *(travel.rates[number] for number in rated))

    def loads(model: PoseModel) -> dict[Channel, FloatArray]:
        springs = () if model.coupled is None else model.coupled.joint_springs
        own = offset_loads(springs, travel.directions)
        passed = offset_rate_loads(springs, travel.directions)[:, rated]
        return dict(zip(channels, UNIT * np.hstack([own, passed]).T, strict=True))

    def relief(model: PoseModel) -> Feedthrough:
        springs = () if model.coupled is None else model.coupled.joint_springs
        by_name = {spring.name: spring for spring in springs}
        taken = [(each, by_name[each[0]].stiffness) for each in travel.directions]
        if DAMPING in state.scene.effects:
            passed = [travel.directions[number] for number in rated]
            taken += [(each, by_name[each[0]].damping) for each in passed]
        return {
            ((f"{joint} {SPRING}", DOF_NAMES[row]), channel): -UNIT * float(matrix[row, dof])
            for channel, ((joint, dof), matrix) in zip(channels, taken, strict=False)
            for row in range(len(DOF_NAMES))
        }

    return WayErrors(
        channels=channels,
        loads=loads,
        relief=relief,
        offsets=lambda places: np.asarray(travel.sample(places) / UNIT),
        rated=tuple(rated),
        ends=ends,
        shortest=travel.shortest,
    )


def _leg_errors(mechanism: SceneMechanism, poses: list[Pose], nodes: FloatArray) -> WayErrors:
    """Legs of a lumped mechanism that are longer than commanded: nothing but their springs along
    themselves resists.
    """
    states = np.array([solve_pose(mechanism, pose.positions) for pose in poses])
    legs = tuple(mechanism.leg_errors)
    columns = [mechanism.mounted.mechanism.index(LENGTHS[leg]) for leg in legs]
    lengths = states[:, columns]
    law = scipy.interpolate.make_interp_spline(nodes, lengths, k=min(3, len(nodes) - 1))
    channels = tuple((GUIDE_ERRORS, LENGTHS[leg]) for leg in legs)

    def loads(model: PoseModel) -> dict[Channel, FloatArray]:
        if not isinstance(model, LumpedPose):
            raise ValueError("errors of legs are those of a lumped mechanism")
        pushed = UNIT * np.diag(model.placed.motions.stiffness)
        return {channel: pushed[2 * leg + 1] for channel, leg in zip(channels, legs, strict=True)}

    def relief(model: PoseModel) -> Feedthrough:
        return {
            ((f"{LEGS[leg]} {SPRING}", "along"), channel): -float(pushed[2 * leg + 1])
            for leg, (channel, pushed) in zip(legs, loads(model).items(), strict=True)
        }

    speeds = np.abs(np.gradient(lengths, nodes, axis=0)).max(axis=0)
    periods = [
        wave.period / speed
        for speed, leg in zip(speeds, legs, strict=True)
        for wave in mechanism.leg_errors[leg].waves
        if speed > 0.0
    ]
    return WayErrors(
        channels=channels,
        loads=loads,
        relief=relief,
        offsets=lambda places: np.asarray(
            sample_leg_errors(mechanism.leg_errors, law(places)) / UNIT
        ),
        rated=(),
        ends=(float(nodes[0]), float(nodes[-1])),
        shortest=float(min(periods, default=np.inf)),
    )
