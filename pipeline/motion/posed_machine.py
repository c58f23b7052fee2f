"""A machine in the poses of its trajectory: coupled and damped, with its loads and outputs; and a
bound of the gyroscopic effects on its deformation.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import Axis
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.motion.trajectory import (
    GRAVITY_LOAD,
    Feedthrough,
    FollowedTrajectory,
    PosedErrors,
    Trajectory,
    coupled_machine,
)
from headstock.pipeline.stages.machine import CoupledPose, damp_system, warn_of_no_damping
from headstock.pipeline.stages.mechanism import LumpedPose, build_lumped_model, place_pose
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.coupling.error_travel import RATE
from headstock.reduction.coupling.joint_forces import SPRING, joint_outputs
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.reduction.coupling.path_loads import (
    POINT_ROWS,
    TurningBody,
    body_travel,
    bound_gyroscopic_shift,
    stack_modes,
    turn_with_bodies,
)
from headstock.solvers.linear.modal_analysis import ModalResult, solve_lowest_modes
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.second_order import Channel, SecondOrderSystem

FORCE = "force"
STACKED = 2.0  # modes are compared between poses up to this multiple of the highest frequency kept
LEAST_SHIFT = 1e-9  # of a natural frequency: roundoff, as of bodies that are rigid
# further outputs of a machine in a pose: rows, and their direct feedthrough of inputs
Further = tuple[Mapping[Channel, FloatArray], Feedthrough]
# gives further outputs to a machine at a value of the parameter of its trajectory
Join = Callable[[float, PoseModel, PosedErrors], Further]


def build_along(
    state: RunState, followed: FollowedTrajectory, up_to_hz: float, joins: Sequence[Join] = ()
) -> Callable[[float], PosedModes]:
    """Return a function that builds the machine at a value of the trajectory's parameter: damped as
    the scene says, with every channel.

    Args:
        joins: Functions that add further outputs to the machine.
    """
    trajectory, model_at, undamped = followed.trajectory, model_builder(state), False

    def build(where: float) -> PosedModes:
        nonlocal undamped
        model = model_at(trajectory.pose(where))
        for message in warn_of_no_damping(state.scene, model.system):
            state.warn(message)
        modes = _find_modes(model, STACKED * up_to_hz)
        system = damp_system(state.scene, model.system, modes)
        if system.damping is None and system.hysteretic is None and not undamped:
            undamped = True
            state.warn(
                'nothing damps motion along the path: write [effects] damping = { modal = "2 %" }'
            )
        weight = model.loads.get("gravity", np.zeros(len(system.mass)))
        errors, loads = followed.act_on(model), trajectory.loads(model)
        system = dataclasses.replace(
            system,
            inputs={**system.inputs, GRAVITY_LOAD: weight, **loads, **errors.loads},
            outputs={**system.outputs, **joint_outputs(model.joints)},
        )
        posed = dataclasses.replace(_stack(model, system, modes), feedthrough=errors.feedthrough)
        for join in joins:
            posed = posed.join(*join(where, model, errors))
        if not trajectory.turning:
            return posed
        return turn_with_bodies(posed, _turning_bodies(model, trajectory.turning))

    return build


def model_builder(state: RunState) -> Callable[[Pose], PoseModel]:
    """Return a function that builds the machine of a scene, lumped or of components, in a pose."""
    parts, memo = state.parts, CouplingMemo()
    if state.scene.is_lumped:
        lumped = build_lumped_model(parts, parts.superelements)
        return lambda pose: place_pose(parts, pose, lumped, parts.superelements)

    def build(pose: Pose) -> CoupledPose:
        coupled = couple(
            parts.superelements,
            state.scene.machine,
            pose,
            gravity=parts.plan.gravity,
            memo=memo,
        )
        for message in coupled.warnings:
            state.warn(message)
        return CoupledPose(parts, pose, coupled)

    return build


def report_gyroscopic_shift(
    model: PoseModel, turned: Mapping[str, float], least: float = LEAST_SHIFT
) -> tuple[str, ...]:
    """Report that gyroscopic forces on the deformation of rotating bodies are only partly modelled,
    at given speeds [rad/s]; nothing where they shift natural frequencies by less than a share.
    """
    if model.coupled is None or not turned:
        return ()
    share = bound_gyroscopic_shift(
        _stack(model, model.system, model.all_modes),
        _turning_bodies(model, tuple(turned)),
        tuple(turned.values()),
    )
    if share < least:
        return ()
    return (
        f"gyroscopic forces on what deforms within bodies that turn (at {max(turned.values()):.2g} rad/s and less) count in part only; all of"
        f" them would move natural frequencies by {100.0 * share:.1g} % at most",
    )


def _find_modes(model: PoseModel, up_to_hz: float) -> ModalResult:
    """Return the modes of a machine up to a frequency; all where none lies below it, or of a lumped
    machine.
    """
    if isinstance(model, LumpedPose):
        return model.all_modes
    modes = solve_lowest_modes(model.system, up_to_hz=up_to_hz)
    return modes if len(modes.frequencies_hz) else model.all_modes


def _stack(model: PoseModel, system: SecondOrderSystem, modes: ModalResult) -> PosedModes:
    if isinstance(model, LumpedPose):
        return model.stack_modes(system)
    return stack_modes(system, modes, coupled_machine(model))


def shared_rows(trajectory: Trajectory, state: RunState, better: RunState) -> NDArray[np.intp]:
    """Return the rows of a machine's motions that exist also without the further modal dofs of its
    refined components.
    """
    fewer, more = (
        {name: len(part.labels) for name, part in run.parts.superelements.items()}
        for run in (state, better)
    )
    # each rotating body has its dofs a second time, and those of its points
    blocks = [(fewer[name], more[name]) for name in fewer]
    for name in trajectory.turning:
        blocks += [(fewer[name], more[name]), (POINT_ROWS, POINT_ROWS)]
    starts = np.cumsum([0, *(size for _, size in blocks)])
    return np.concatenate(
        [start + np.arange(size) for start, (size, _) in zip(starts, blocks, strict=False)]
    )


def _turning_bodies(model: PoseModel, names: Sequence[str]) -> list[TurningBody]:
    """List the bodies that a mechanism rotates, with their travel, mass and inertia."""
    bodies = []
    for name in names:
        body = model.parts.superelements[name]
        if isinstance(model, LumpedPose):
            travel, mass = np.eye(6), model.body_masses[name]
        else:
            coupled = coupled_machine(model)
            travel, mass = body_travel(coupled, name), coupled.matrices.masses[name]
        bodies.append(
            TurningBody(
                rows=model.offsets[name],
                travel=travel,
                mass=mass,
                rotation=model.placements[name].rotation,
                kilograms=body.mass_kg,
                inertia=body.inertia,
            )
        )
    return bodies


def join_screws(screws: Mapping[str, tuple[str, Axis | None]]) -> Join:
    """Return a function that adds the axial forces of screws on their nuts to a machine [N]."""

    def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
        joints = {joint.name: joint for joint in coupled_machine(model).joint_springs}
        rows, taken = dict[Channel, FloatArray](), Feedthrough()
        for name, (joint, axis) in screws.items():
            spring = joints[joint]
            sign = _screw_sign(spring, axis)
            rows[name, FORCE] = sign * (spring.stiffness @ spring.rows)[0]
            taken |= {
                ((name, FORCE), given): sign * size
                for (output, given), size in errors.feedthrough.items()
                # the rates act through dampers, which are no part of it
                if output == (f"{joint} {SPRING}", DOF_NAMES[0]) and given[0] != RATE
            }
        return rows, taken

    return join


def _screw_sign(screw: PlacedJoint, axis: Axis | None) -> float:
    """Return 1 where a screw pushes along its axis, -1 where against it."""
    return 1.0 if axis is None else float(np.sign(screw.frame.rotation[:, 0] @ axis.direction))
