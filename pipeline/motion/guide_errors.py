"""Errors of guides, screws and legs along a trajectory, as preload of their springs or as motion of what
rigid guides hold: what a machine in a pose feels of a unit of each, and how large each is along the trajectory.
"""

from collections.abc import Callable

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
    check_offsets,
    find_offset_motions,
    plan_travel,
)
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS, has_errors
from headstock.reduction.coupling.joint_forces import SPRING
from headstock.reduction.motions.path_errors import pass_offsets
from headstock.scene.scene import SceneMechanism

STEPS_PER_WAVE = 48
UNIT = 1e-6  # of offsets [m, rad]: loads of all channels are then of like size


def find_trajectory_errors(
    state: RunState, pose_at: Callable[[float], Pose], nodes: FloatArray
) -> TrajectoryErrors | None:
    """Errors of a machine along a trajectory; None where it has none.

    Args:
        nodes: ``(k,)`` even places between which what errors are read by is interpolated.

    Raises:
        ModelError: A rigid direction has an offset, or a place lies outside a table.
    """
    mechanism, machine = state.scene.mechanism, state.scene.machine
    poses = [pose_at(float(node)) for node in nodes]
    ends = (float(nodes[0]), float(nodes[-1]))
    if state.scene.is_lumped and mechanism is not None:
        if not mechanism.leg_errors:
            return None
        return _leg_errors(mechanism, poses, nodes, driven=bool(state.scene.drives))
    if not has_errors(machine):
        return None
    travel = plan_travel(machine, state.parts.superelements, nodes, poses)
    if travel is None:
        return None
    fixed = {name: joint.fixed for name, joint in machine.joints.items()}
    numbers = range(len(travel.directions))
    rigid = [n for n in numbers if travel.directions[n][1] in fixed[travel.directions[n][0]]]
    if rigid:
        check_offsets(coupled_machine(model_builder(state)(poses[0])), travel)
    # motors under control feel the inertia of all that follows at once, springs that are stiff, too
    accelerated = list(numbers) if state.scene.drives else rigid
    damped = {name for name, joint in machine.joints.items() if np.any(joint.damping)}
    rated = [
        number
        for number in numbers
        if DAMPING in state.scene.effects
        and (number in rigid or travel.directions[number][0] in damped)
    ]
    channels = (
        *travel.channels,
        *(travel.rates[number] for number in rated),
        *(travel.accelerations[number] for number in accelerated),
    )

    def act_on(model: PoseModel) -> PosedErrors:
        coupled, system = coupled_machine(model), model.system
        if rated:
            system = damp_system(state.scene, system, model.all_modes)
        found = find_offset_motions(coupled, travel, system)
        columns = [found.loads, found.rates[:, rated], found.accelerations[:, accelerated]]
        outputs = [(name, dof) for name, dof in coupled.system.outputs if dof in DOF_NAMES]
        passed = pass_offsets(
            coupled, travel, found, outputs, model.joints, probe_values(machine.probes)
        )
        return PosedErrors(
            loads=dict(zip(channels, UNIT * np.hstack(columns).T, strict=True)),
            feedthrough={
                (passed.outputs[row], passed.inputs[column]): UNIT * float(share)
                for (row, column), share in np.ndenumerate(passed.shares)
                if share
            },
            moved=UNIT * found.moved[:, accelerated] if rigid else None,
        )

    return TrajectoryErrors(
        channels=channels,
        act_on=act_on,
        offsets=lambda places: np.asarray(travel.sample(places) / UNIT),
        rated=tuple(rated),
        accelerated=tuple(accelerated),
        ends=ends,
        shortest=travel.shortest,
    )


def _leg_errors(
    mechanism: SceneMechanism, poses: list[Pose], nodes: FloatArray, *, driven: bool
) -> TrajectoryErrors:
    """Legs of a lumped mechanism that are longer than commanded: nothing but their springs along
    themselves resists. Driven ones feel the inertia of what follows at once.
    """
    states = np.array([solve_pose(mechanism, pose.positions) for pose in poses])
    legs = tuple(mechanism.leg_errors)
    columns = [mechanism.mounted.mechanism.index(LENGTHS[leg]) for leg in legs]
    lengths = states[:, columns]
    law = scipy.interpolate.make_interp_spline(nodes, lengths, k=min(3, len(nodes) - 1))
    channels = tuple((GUIDE_ERRORS, LENGTHS[leg]) for leg in legs)
    accelerated = tuple(range(len(legs))) if driven else ()
    pulling = tuple((ACCELERATION, LENGTHS[legs[number]]) for number in accelerated)

    def act_on(model: PoseModel) -> PosedErrors:
        if not isinstance(model, LumpedPose):
            raise ValueError("errors of legs are those of a lumped mechanism")
        pushed = UNIT * np.diag(model.placed.motions.stiffness)
        loads = {channel: pushed[2 * leg + 1] for channel, leg in zip(channels, legs, strict=True)}
        return PosedErrors(
            loads=loads | dict.fromkeys(pulling, np.zeros(len(pushed))),
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
        channels=(*channels, *pulling),
        act_on=act_on,
        offsets=lambda places: np.asarray(
            sample_leg_errors(mechanism.leg_errors, law(places)) / UNIT
        ),
        rated=(),
        accelerated=accelerated,
        ends=(float(nodes[0]), float(nodes[-1])),
        shortest=float(min(periods, default=np.inf)),
    )
