"""A machine along its trajectory: how the rigid machine follows a path, and the compliant one in any of its
poses with what acts on it there. Contours and straight moves of a tool follow the same trajectories.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import Axis
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.machine.tool_travel import ToolTravel
from headstock.geometry.mechanisms.exechon import ToolMechanism
from headstock.pipeline.motion.contour_run import CORIOLIS
from headstock.pipeline.stages.machine import CoupledPose, damp_system, warn_of_no_damping
from headstock.pipeline.stages.mechanism import LumpedPose, build_lumped_model, place_pose
from headstock.pipeline.stages.run_state import MachineParts, PoseModel, RunState
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.coupling.error_travel import RATE
from headstock.reduction.coupling.joint_forces import SPRING, joint_outputs
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.reduction.coupling.path_loads import (
    POINT_ROWS,
    TurningBody,
    body_loads,
    body_travel,
    bound_gyroscopic_shift,
    inertia_load,
    rigid_travel,
    stack_modes,
    turn_with_bodies,
)
from headstock.scene.scene import SceneMechanism
from headstock.solvers.linear.modal_analysis import ModalResult, solve_lowest_modes
from headstock.solvers.milling.path_drives import move_markers
from headstock.solvers.milling.tool_path import PathPoints, ToolPath
from headstock.solvers.motion.plant import PosedModes
from headstock.solvers.motion.plant_motion import TrajectoryLoads
from headstock.solvers.second_order import Channel, SecondOrderSystem

GRAVITY_LOAD: Channel = ("gravity", "load")
FORCE = "force"
STACKED = 2.0  # times the highest frequency kept, up to which modes may be compared between poses
LEAST_SHIFT = 1e-9  # of a natural frequency: roundoff, as of bodies that are rigid
Amounts = Callable[[FloatArray], FloatArray]
Feedthrough = dict[tuple[Channel, Channel], float]
# further outputs of a machine at a place: rows, and what they have of inputs at once
Further = tuple[Mapping[Channel, FloatArray], Feedthrough]


@dataclass(frozen=True, eq=False)
class PosedErrors:
    """What a unit of each error does to a machine in a pose.

    Attributes:
        loads: Channel to its load ``(n,)``.
        relief: Outputs and channels to what a unit of the channel adds to the output at once: less
            force of joints whose springs do not push, and motion that fixed directions make.
        moved: ``(n_all, k)`` that motion of the stacked dofs, of a unit of each offset; None where
            only springs push.
    """

    loads: Mapping[Channel, FloatArray] = field(default_factory=dict)
    relief: Feedthrough = field(default_factory=dict)
    moved: FloatArray | None = None


Join = Callable[[float, PoseModel, PosedErrors], Further]


@dataclass(frozen=True, eq=False)
class RigidTrajectory:
    """How the rigid machine follows a path.

    Attributes:
        pose_at: The pose at a place of the trajectory: a time of a contour, a position of a straight move.
        loads: Load ``(n,)`` by its inertia in each of its channels, of a machine in a pose.
        amounts: Values ``(n, r)`` of all channels at times ``(n,)``.
        bodies: Channels of the rigid motion: accelerations.
        axis_motion: Speed and acceleration ``(n,)`` of an axis at times; None of a mechanism.
        leg_forces: Forces ``(n, d)`` that hold up and accelerate the legs of a mechanism themselves,
            between their drives and their screws, at times; None of axes.
        turning: Bodies that turn along the trajectory, whose speeds act.
        travels: Motion ``(n_all, b)`` of the stacked dofs per travel in each of the ``b`` channels of
            the rigid motion, of a machine of components in a pose.
        errors: What errors do, of a machine in a pose.
        offsets: Of the errors that motors under control feel at once, channels of the offset and of
            its acceleration.
    """

    pose_at: Callable[[float], Pose]
    loads: Callable[[PoseModel], dict[Channel, FloatArray]]
    amounts: Amounts
    bodies: tuple[Channel, ...]
    axis_motion: Callable[[str, FloatArray], tuple[FloatArray, FloatArray]] | None = None
    leg_forces: Amounts | None = None
    turning: tuple[str, ...] = ()
    travels: Callable[[CoupledMachine], FloatArray] = lambda coupled: np.zeros((0, 0))
    errors: Callable[[PoseModel], PosedErrors] = lambda model: PosedErrors()
    error_channels: tuple[Channel, ...] = ()
    offsets: tuple[tuple[Channel, Channel], ...] = ()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels."""
        return (*self.bodies, *self.error_channels)

    @property
    def acting(self) -> TrajectoryLoads:
        """What acts along the trajectory: weight, and the amounts of all channels."""
        return TrajectoryLoads((GRAVITY_LOAD, *self.channels), self._given, GRAVITY_LOAD)

    def _given(self, times: FloatArray) -> FloatArray:
        return np.concatenate([np.ones((len(times), 1)), self.amounts(times)], axis=1)


def has_coriolis(state: RunState) -> bool:
    """Whether the speeds of a mechanism accelerate it: its bodies turn, those of linear axes do not."""
    return CORIOLIS in state.scene.effects and state.scene.mechanism is not None


def find_screws(machine: Machine) -> dict[str, tuple[str, Axis | None]]:
    """Ball screws that drive a machine: name of the drive to its joint and axis; those of a
    mechanism have the name of their joint.
    """
    found: dict[str, tuple[str, Axis | None]] = {}
    for axis in machine.axes.values():
        for name in axis.joints:
            if machine.joints[name].kind == "ball_screw" and axis.kind == "linear":
                found.setdefault(axis.name, (name, axis))
    if machine.mechanism is not None:
        taken = {joint for joint, _ in found.values()}
        found |= {
            name: (name, None)
            for name, joint in machine.joints.items()
            if joint.kind == "ball_screw" and name not in taken
        }
    return found


def axes_trajectory(machine: Machine, travel: ToolTravel, path: ToolPath) -> RigidTrajectory:
    """Linear axes that follow a path."""
    channels = axis_channels(travel.axes)
    directions = {
        name: dict.fromkeys(machine.axes[name].moves, machine.axes[name].direction)
        for name in travel.axes
    }

    def pose_at(time: float) -> Pose:
        places = travel.axis_positions(path.at(np.array([time])).position)[0]
        return Pose(f"t = {time:.4g} s", dict(zip(travel.axes, places.tolist(), strict=True)))

    def amounts(times: FloatArray) -> FloatArray:
        return travel.axis_positions(path.at(times).acceleration)

    def axis_motion(name: str, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        number, points = travel.axes.index(name), path.at(times)
        return (
            travel.axis_positions(points.velocity)[:, number],
            travel.axis_positions(points.acceleration)[:, number],
        )

    return RigidTrajectory(
        pose_at,
        lambda model: {
            channel: inertia_load(coupled_machine(model), directions[channel[0]])
            for channel in channels
        },
        amounts,
        channels,
        axis_motion,
        travels=lambda coupled: np.column_stack(
            [rigid_travel(coupled, directions[name]) for name, _ in channels]
        ),
    )


def mechanism_trajectory(
    state: RunState,
    mechanism: SceneMechanism,
    path: ToolPath,
    *,
    pose_at: Callable[[float], Pose],
    direction: FloatArray,
) -> RigidTrajectory:
    """A mechanism that leads its tool along a path without turning it.

    Args:
        mechanism: Of the scene, lumped or of components.
        direction: ``(3,)`` of the tool, machine frame.
    """
    parts, mounted = state.parts, mechanism.mounted
    carried = {name: marker for name, marker in mechanism.carries.items() if name in parts.reduced}
    channels = body_channels(carried)
    screws = find_screws(state.scene.machine)

    def amounts(times: FloatArray) -> FloatArray:
        moved = move_bodies(
            mechanism,
            parts,
            times,
            path.at(times),
            direction,
            velocity_terms=has_coriolis(state),
        )
        return np.concatenate(list(moved.values()), axis=1)

    def leg_forces(times: FloatArray) -> FloatArray:
        moved, pulled = move_markers(mounted, times, path.at(times), direction), amounts(times)
        gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
        found, names = np.zeros((len(times), len(screws))), list(carried)
        for number, (joint, _) in enumerate(screws.values()):
            leg = state.scene.machine.joints[joint].ends[0].component
            if leg not in carried:
                continue
            rotation = moved.rotations[:, mounted.mechanism.markers.index(carried[leg])]
            axis = state.scene.machine.joints[joint].rotation[:, 0]
            along = rotation @ axis @ mounted.mounting.rotation.T
            center = pulled[:, 6 * names.index(leg) : 6 * names.index(leg) + 3]
            weight = parts.superelements[leg].mass_kg
            found[:, number] = weight * ((center - gravity) * along).sum(axis=1)
        return found

    return RigidTrajectory(
        pose_at,
        lambda model: load_bodies(model, tuple(carried)),
        amounts,
        channels,
        leg_forces=leg_forces,
        turning=tuple(carried) if has_coriolis(state) else (),
        travels=lambda coupled: travel_bodies(coupled, tuple(carried)),
    )


def axis_channels(axes: Iterable[str]) -> tuple[Channel, ...]:
    """Accelerations of axes."""
    return tuple((name, "acceleration") for name in axes)


def body_channels(names: Iterable[str]) -> tuple[Channel, ...]:
    """Accelerations of bodies along and about the machine's axes."""
    return tuple((name, f"acceleration {dof}") for name in names for dof in DOF_NAMES)


def load_bodies(model: PoseModel, names: Iterable[str]) -> dict[Channel, FloatArray]:
    """Loads ``(n,)`` per unit acceleration in each of these channels, of a machine in a pose."""
    found: dict[Channel, FloatArray] = {}
    for name in names:
        own = (
            model.body_loads(name)
            if isinstance(model, LumpedPose)
            else body_loads(coupled_machine(model), name)
        )
        found |= dict(zip(body_channels([name]), own.T, strict=True))
    return found


def travel_bodies(coupled: CoupledMachine, names: Iterable[str]) -> FloatArray:
    """Motion ``(n_all, r)`` of the stacked dofs per travel in each of these channels."""
    columns = []
    for name in names:
        moved = np.zeros((coupled.layout.size, len(DOF_NAMES)))
        moved[coupled.offsets[name]] = body_travel(coupled, name)
        columns.append(moved)
    return np.hstack(columns)


def machine_along(
    state: RunState, trajectory: RigidTrajectory, up_to_hz: float, joins: Sequence[Join] = ()
) -> Callable[[float], PosedModes]:
    """The machine at a place of the trajectory: damped as the scene says, with every channel.

    Args:
        joins: What gives the machine at a place further outputs.
    """
    model_at, undamped = model_builder(state), False

    def place(where: float) -> PosedModes:
        nonlocal undamped
        model = model_at(trajectory.pose_at(where))
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
        errors, loads = trajectory.errors(model), trajectory.loads(model)
        system = dataclasses.replace(
            system,
            inputs={**system.inputs, GRAVITY_LOAD: weight, **loads, **errors.loads},
            outputs={**system.outputs, **joint_outputs(model.joints)},
        )
        posed = dataclasses.replace(_stack(model, system, modes), feedthrough=errors.relief)
        for join in joins:
            posed = posed.join(*join(where, model, errors))
        if not trajectory.turning:
            return posed
        return turn_with_bodies(posed, _turning_bodies(model, trajectory.turning))

    return place


def model_builder(state: RunState) -> Callable[[Pose], PoseModel]:
    """What puts the machine of a scene, lumped or of components, into a pose."""
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


def report_gyroscopic_forces(
    state: RunState,
    place: Callable[[], PoseModel],
    times: FloatArray,
    points: PathPoints,
    direction: FloatArray | None,
    *,
    least: float = LEAST_SHIFT,
) -> tuple[str, ...]:
    """What is said of gyroscopic forces on the deformation of bodies that a mechanism turns, which
    are not all there; nothing where bodies do not deform or speeds do not act.

    Args:
        place: Makes the machine in a pose along the trajectory.
        times: ``(n,)`` [s].
        points: The path of the tool then.
        direction: ``(3,)`` of the tool, machine frame; None of axes.
        least: Share of a natural frequency below which nothing is said.
    """
    mechanism = state.scene.mechanism
    if mechanism is None or direction is None or not has_coriolis(state):
        return ()
    model = place()
    if model.coupled is None:
        return ()
    mounted = mechanism.mounted
    moved = move_markers(mounted, times, points, direction)
    turned = {
        name: float(np.linalg.norm(moved.omega[:, place], axis=1).max())
        for name, marker in mechanism.carries.items()
        if name in state.parts.reduced
        for place in [mounted.mechanism.markers.index(marker)]
    }
    return report_gyroscopic_shift(model, turned, least=least)


def report_gyroscopic_shift(
    model: PoseModel, turned: Mapping[str, float], *, least: float
) -> tuple[str, ...]:
    """What is said of gyroscopic forces on the deformation of bodies that turn at some speeds
    [rad/s]; nothing where they move natural frequencies by less than a share.
    """
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


def coupled_machine(model: PoseModel) -> CoupledMachine:
    """The machine of superelements of a model.

    Raises:
        ValueError: It is a lumped mechanism.
    """
    if model.coupled is None:
        raise ValueError("a lumped mechanism has no superelements")
    return model.coupled


def _find_modes(model: PoseModel, up_to_hz: float) -> ModalResult:
    """The modes of a machine up to a frequency; all where there are none, or few as of a lumped one."""
    if isinstance(model, LumpedPose):
        return model.all_modes
    found = solve_lowest_modes(model.system, up_to_hz=up_to_hz)
    return found if len(found.frequencies_hz) else model.all_modes


def _stack(model: PoseModel, system: SecondOrderSystem, modes: ModalResult) -> PosedModes:
    if isinstance(model, LumpedPose):
        return model.stack_modes(system)
    return stack_modes(system, modes, coupled_machine(model))


def shared_rows(trajectory: RigidTrajectory, state: RunState, better: RunState) -> NDArray[np.intp]:
    """Rows among the motions of a machine whose components have further modal dofs that are those
    of the machine without these.
    """
    own, other = (
        {name: len(part.labels) for name, part in each.parts.superelements.items()}
        for each in (state, better)
    )
    # each body that turns has its dofs once more, and those of its points
    blocks = [(own[name], other[name]) for name in own]
    for name in trajectory.turning:
        blocks += [(own[name], other[name]), (POINT_ROWS, POINT_ROWS)]
    starts = np.cumsum([0, *(size for _, size in blocks)])
    return np.concatenate(
        [start + np.arange(size) for start, (size, _) in zip(starts, blocks, strict=False)]
    )


def _turning_bodies(model: PoseModel, names: Sequence[str]) -> list[TurningBody]:
    """Bodies that a mechanism turns as it carries them."""
    found = []
    for name in names:
        body = model.parts.superelements[name]
        if isinstance(model, LumpedPose):
            travel, mass = np.eye(6), model.body_masses[name]
        else:
            coupled = coupled_machine(model)
            travel, mass = body_travel(coupled, name), coupled.matrices.masses[name]
        found.append(
            TurningBody(
                rows=model.offsets[name],
                travel=travel,
                mass=mass,
                rotation=model.placements[name].rotation,
                kilograms=body.mass_kg,
                inertia=body.inertia,
            )
        )
    return found


def join_screws(screws: Mapping[str, tuple[str, Axis | None]]) -> Join:
    """Give a machine the forces with which screws push their nuts, along the axis [N]."""

    def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
        joints = {joint.name: joint for joint in coupled_machine(model).joint_springs}
        rows, taken = dict[Channel, FloatArray](), Feedthrough()
        for name, (joint, axis) in screws.items():
            spring = joints[joint]
            sign = _screw_sign(spring, axis)
            rows[name, FORCE] = sign * (spring.stiffness @ spring.rows)[0]
            taken |= {
                ((name, FORCE), given): sign * size
                for (output, given), size in errors.relief.items()
                # the rates act through dampers, which are no part of it
                if output == (f"{joint} {SPRING}", DOF_NAMES[0]) and given[0] != RATE
            }
        return rows, taken

    return join


def _screw_sign(screw: PlacedJoint, axis: Axis | None) -> float:
    """Whether a screw pushes along its axis or against it."""
    return 1.0 if axis is None else float(np.sign(screw.frame.rotation[:, 0] @ axis.direction))


def move_bodies(
    mechanism: ToolMechanism,
    parts: MachineParts,
    times: FloatArray,
    path: PathPoints,
    direction: FloatArray,
    *,
    velocity_terms: bool,
) -> dict[str, FloatArray]:
    """Acceleration of each body that is carried ``(n, 6)``, machine axes: of its centre of mass, and
    about it as fast as Euler's moment of its turning asks for.

    Args:
        times: ``(n,)`` [s].
        path: Of the tool point then.
        direction: ``(3,)`` of the tool, machine frame.
        velocity_terms: Whether bodies are accelerated by speeds, too.

    Raises:
        PoseError: The path cannot be followed.
    """
    mounted, found = mechanism.mounted, {}
    moved = move_markers(mounted, times, path, direction, velocity_terms=velocity_terms)
    turn = mounted.mounting.rotation
    for name, marker in mechanism.carries.items():
        if name not in parts.reduced:
            continue
        place = mounted.mechanism.markers.index(marker)
        body, own = parts.superelements[name], parts.plan.components[name].placement
        rotation = moved.rotations[:, place]
        arm = rotation @ (own.origin + own.rotation @ body.center_of_mass)
        omega, alpha = moved.omega[:, place], moved.alpha[:, place]
        # Euler's moment of a body that turns: as if it were accelerated faster
        axes = rotation @ own.rotation
        inertia = axes @ body.inertia @ np.swapaxes(axes, -1, -2)
        moment = np.cross(omega, (inertia @ omega[..., None])[..., 0])
        spin = alpha + np.linalg.solve(inertia, moment[..., None])[..., 0]
        center = (
            moved.acceleration[:, place]
            + np.cross(alpha, arm)
            + np.cross(omega, np.cross(omega, arm))
        )
        found[name] = np.concatenate([center @ turn.T, spin @ turn.T], axis=1)
    return found
