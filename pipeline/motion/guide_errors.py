"""Errors of guides, screws and legs along a trajectory, as preload of their springs or as motion
imposed by rigid guides: the effect of a unit of each on a machine in a pose, and the size of each
along the trajectory.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.mechanisms.exechon import LEGS, LENGTHS, solve_pose
from headstock.pipeline.motion.posed_machine import model_builder
from headstock.pipeline.motion.probe_motions import probe_values
from headstock.pipeline.motion.trajectory import PosedErrors, TrajectoryErrors, coupled_machine
from headstock.pipeline.stages.lumped_machine import sample_leg_errors
from headstock.pipeline.stages.machine import DAMPING, damp_system
from headstock.pipeline.stages.mechanism import LumpedPose
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.error_travel import (
    ACCELERATION,
    ErrorTravel,
    check_offsets,
    find_offset_motions,
    plan_travel,
)
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS, has_errors
from headstock.reduction.coupling.joint_forces import SPRING
from headstock.reduction.motions.path_errors import pass_offsets
from headstock.scene.scene import SceneMechanism
from headstock.solvers.second_order import Channel

STEPS_PER_WAVE = 48
UNIT = 1e-6  # of offsets [m, rad]: loads of all channels are then of like size


def find_trajectory_errors(
    state: RunState, pose_at: Callable[[float], Pose], nodes: FloatArray
) -> TrajectoryErrors | None:
    """Find the errors of a machine along a trajectory; None where it has none.

    Args:
        nodes: ``(k,)`` even values of the trajectory's parameter, between which the arguments of
            errors are interpolated.

    Raises:
        ModelError: A rigid direction has an offset, or a position lies outside a table.
    """
    mechanism, machine = state.scene.mechanism, state.scene.machine
    poses = [pose_at(float(node)) for node in nodes]
    if state.scene.is_lumped and mechanism is not None:
        if not mechanism.leg_errors:
            return None
        return _leg_errors(mechanism, poses, nodes, driven=bool(state.scene.drives))
    if not has_errors(machine):
        return None
    travel = plan_travel(machine, state.parts.superelements, nodes, poses)
    if travel is None:
        return None
    offsets = _split_offsets(state, travel)
    if offsets.rigid:
        check_offsets(coupled_machine(model_builder(state)(poses[0])), travel)
    return TrajectoryErrors(
        channels=offsets.channels,
        act_on=offsets.act_on,
        offsets=lambda where: np.asarray(travel.sample(where) / UNIT),
        rated=offsets.rated,
        accelerated=offsets.accelerated,
        ends=(float(nodes[0]), float(nodes[-1])),
        shortest=travel.shortest,
    )


@dataclass(frozen=True, eq=False)
class _Offsets:
    """Describe offsets of joints of a machine of components.

    Attributes:
        travel: The ``k`` offsets along the trajectory.
        rigid: Those in directions that are fixed.
        rated: Those whose rates act: through dampers, or because all that moves with the joint is
            imposed to move with them.
        accelerated: Those whose accelerations act.
    """

    state: RunState
    travel: ErrorTravel
    rigid: tuple[int, ...]
    rated: tuple[int, ...]
    accelerated: tuple[int, ...]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of offsets, of rates that act and of accelerations that act."""
        travel = self.travel
        return (
            *travel.channels,
            *(travel.rates[number] for number in self.rated),
            *(travel.accelerations[number] for number in self.accelerated),
        )

    def act_on(self, model: PoseModel) -> PosedErrors:
        """Return the effect of a unit of each on a machine in a pose."""
        coupled, system, scene = coupled_machine(model), model.system, self.state.scene
        rated, accelerated = list(self.rated), list(self.accelerated)
        if rated:
            system = damp_system(scene, system, model.all_modes)
        motions = find_offset_motions(coupled, self.travel, system)
        columns = [motions.loads, motions.rates[:, rated], motions.accelerations[:, accelerated]]
        outputs = [(name, dof) for name, dof in coupled.system.outputs if dof in DOF_NAMES]
        probes = probe_values(scene.machine.probes)
        feedthrough = pass_offsets(coupled, self.travel, motions, outputs, model.joints, probes)
        return PosedErrors(
            loads=dict(zip(self.channels, UNIT * np.hstack(columns).T, strict=True)),
            feedthrough={
                (feedthrough.outputs[row], feedthrough.inputs[column]): UNIT * float(share)
                for (row, column), share in np.ndenumerate(feedthrough.shares)
                if share
            },
            moved=UNIT * motions.moved[:, accelerated] if self.rigid else None,
        )


def _split_offsets(state: RunState, travel: ErrorTravel) -> _Offsets:
    """Find which offsets act by their rates and accelerations, too."""
    joints, numbers = state.scene.machine.joints, range(len(travel.directions))
    rigid = [n for n, (name, dof) in enumerate(travel.directions) if dof in joints[name].fixed]
    damped = [n for n, (name, _) in enumerate(travel.directions) if np.any(joints[name].damping)]
    rated = sorted({*rigid, *damped}) if DAMPING in state.scene.effects else []
    # all that moves with a leg acts on motors under control and stiff springs by its inertia
    accelerated = numbers if state.scene.drives else rigid
    return _Offsets(state, travel, tuple(rigid), tuple(rated), tuple(accelerated))


def _leg_errors(
    mechanism: SceneMechanism, poses: list[Pose], nodes: FloatArray, *, driven: bool
) -> TrajectoryErrors:
    """Find the length errors of legs of a lumped mechanism, which only their axial springs resist.
    The inertia of all that moves with a leg acts directly on its motor where that is under control.
    """
    states = np.array([solve_pose(mechanism, pose.positions) for pose in poses])
    legs = tuple(mechanism.leg_errors)
    columns = [mechanism.mounted.mechanism.index(LENGTHS[leg]) for leg in legs]
    lengths = states[:, columns]
    law = scipy.interpolate.make_interp_spline(nodes, lengths, k=min(3, len(nodes) - 1))
    channels = tuple((GUIDE_ERRORS, LENGTHS[leg]) for leg in legs)
    accelerated = tuple(range(len(legs))) if driven else ()
    acceleration_channels = tuple((ACCELERATION, LENGTHS[legs[number]]) for number in accelerated)

    def act_on(model: PoseModel) -> PosedErrors:
        if not isinstance(model, LumpedPose):
            raise ValueError("errors of legs are those of a lumped mechanism")
        springs = UNIT * np.diag(model.placed.motions.stiffness)
        loads = {channel: springs[2 * leg + 1] for channel, leg in zip(channels, legs, strict=True)}
        return PosedErrors(
            loads=loads | dict.fromkeys(acceleration_channels, np.zeros(len(springs))),
            feedthrough={
                ((f"{LEGS[leg]} {SPRING}", "along"), channel): -float(loads[channel][2 * leg + 1])
                for channel, leg in zip(channels, legs, strict=True)
            },
        )

    speeds = np.abs(np.gradient(lengths, nodes, axis=0)).max(axis=0)
    periods = [
        wave.period / speed
        for speed, leg in zip(speeds, legs, strict=True)
        for wave in mechanism.leg_errors[leg].waves
        if speed > 0.0
    ]
    return TrajectoryErrors(
        channels=(*channels, *acceleration_channels),
        act_on=act_on,
        offsets=lambda places: np.asarray(
            sample_leg_errors(mechanism.leg_errors, law(places)) / UNIT
        ),
        rated=(),
        accelerated=accelerated,
        ends=(float(nodes[0]), float(nodes[-1])),
        shortest=float(min(periods, default=np.inf)),
    )
