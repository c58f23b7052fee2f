"""Motors of a machine along a trajectory: what they move of the rigid machine, and their loops closed around
its modes.

The modes are those with locked motors. A motor's coordinate is the travel of the rigid machine that
it brings about; both are coupled by the inertia of that travel, which is also the load by which
the rigid machine bends the modes.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used
from numpy.typing import NDArray

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import NO_OFFSET, Machine
from headstock.geometry.machine.tool_travel import find_tool_travel
from headstock.geometry.mechanisms.closures import evaluate_kinematics
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.pipeline.motion.contour_run import ContourDrives
from headstock.pipeline.motion.trajectory import (
    Feedthrough,
    Further,
    Join,
    PosedErrors,
    RigidTrajectory,
    axis_channels,
    body_channels,
    coupled_machine,
)
from headstock.pipeline.stages.mechanism import LumpedPose
from headstock.pipeline.stages.run_state import MachineParts, PoseModel, RunState
from headstock.reduction.coupling.drives import find_linear_scales, scale_rows
from headstock.reduction.coupling.error_travel import move_rows
from headstock.reduction.coupling.path_loads import momentum_rows
from headstock.scene.scene import SceneMechanism
from headstock.solvers.control.drive_trains import SCALE
from headstock.solvers.mechanisms.partitioning import velocity_maps
from headstock.solvers.milling.path_drives import move_markers
from headstock.solvers.milling.tool_path import ToolPath
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    ServoMotion,
    chunk_slices,
    close_motors,
    even_nodes,
    interpolate_nodes,
)
from headstock.solvers.motion.friction import CoordinateFriction, friction_force, stack_laws
from headstock.solvers.motion.plant import SampledMotion, SampledPlant
from headstock.solvers.motion.plant_motion import SampledHistory, TrajectoryLoads, follow_motion
from headstock.solvers.motion.set_points import PathMotion
from headstock.solvers.second_order import Channel, Index

FrictionSpeeds = Literal["set", "true"]

CLOSED = "the loops of the drives are closed along the contour; motor torques are those of their controllers"
AT_SET_SPEEDS = "friction acts as at the speeds of the set points"
AT_TRUE_SPEEDS = "friction acts as at the speeds of the motors"
STIFF_COUPLINGS = "couplings between motors and screws are taken as rigid along the contour"


def close_drives(
    free: LinearMotion,
    drives: Sequence[Drive],
    *,
    positions: FloatArray,
    speeds: FloatArray,
    accelerations: FloatArray,
    gravity: FloatArray,
    scales: FloatArray,
    friction: FrictionSpeeds,
    beside: FloatArray | None = None,
) -> ServoMotion:
    """Add motors to a machine along its trajectory and close their loops.

    Args:
        free: The machine; its last ``d`` coordinates are what the motors move, free and without the
            motors' inertia.
        drives: The ``d`` drives.
        positions: ``(n, d)`` set positions of axes or legs [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        gravity: ``(k, c + d)`` generalised weight at the nodes [N].
        scales: ``(k, d, c + d)`` what linear scales read per coordinate.
        friction: At which speeds it acts: those of the set points, which leaves the motion linear,
            or those of the motors.
        beside: ``(n, d)`` what scales read beside that; None for nothing.
    """
    size, count = free.mass.shape[-1], len(drives)
    motors = np.arange(size - count, size)
    middle = free.mass[len(free.mass) // 2]
    own = _rotor_masses(drives)
    mass = np.array(free.mass)
    mass[:, motors, motors] += own
    damping, load = np.array(free.damping), np.array(free.load)
    load[:, motors] -= own * accelerations
    coordinate_friction = None
    law = stack_laws([drive.friction for drive in drives])
    if friction == "set":
        load[:, motors] -= friction_force(law, speeds)
        # friction that grows with speed also damps deviations
        damping[:, motors, motors] += law.viscous
    elif any(drive.friction is not None for drive in drives):
        coordinate_friction = CoordinateFriction(motors, law, speeds)
    for drive, motor, places in zip(drives, motors, positions.T, strict=True):
        load[:, motor] += ripple_force(drive, np.asarray(places))
    controls = [
        dataclasses.replace(
            drive.control,
            acceleration_feed_forward=drive.acceleration_share
            * (float(middle[motor, motor]) + rotor),
        )
        for drive, motor, rotor in zip(drives, motors, own, strict=True)
    ]
    return close_motors(
        dataclasses.replace(
            free, mass=mass, damping=damping, load=load, friction=coordinate_friction
        ),
        controls,
        speeds=speeds,
        accelerations=accelerations,
        gravity=gravity,
        scales=scales,
        beside=beside,
    )


def controlled_drives(
    servo: ServoMotion, drives: Sequence[Drive], history: CompliantHistory
) -> ContourDrives:
    """Forces of screws on what they move, and torques of motors, which also turn themselves and
    overcome friction.

    Args:
        servo: The machine along its trajectory.
    """
    pushed = servo.forces(history)
    pulled, rates = history.acceleration[:, servo.motors], history.rate[:, servo.motors]
    inertia = _rotor_masses(drives) * (servo.accelerations + pulled)
    if servo.motion.friction is None:
        law = stack_laws([drive.friction for drive in drives])
        friction_forces = friction_force(law, servo.speeds) + law.viscous * rates
    else:
        friction_forces = servo.motion.friction.force(history.rate)
    leads = np.array([drive.lead for drive in drives])

    def forces(some: NDArray[np.intp]) -> FloatArray:
        return np.asarray((pushed - inertia - friction_forces)[some])

    def torques(some: NDArray[np.intp], _: FloatArray) -> FloatArray:
        return np.asarray(pushed[some] * (leads / (2.0 * math.pi)))

    return ContourDrives(tuple(drive.name for drive in drives), forces, torques)


def drive_assumptions(drives: Sequence[Drive], friction: FrictionSpeeds) -> tuple[str, ...]:
    """What is assumed of drives along a contour, in plain words."""
    found = [CLOSED]
    if any(drive.friction is not None for drive in drives):
        found.append(AT_SET_SPEEDS if friction == "set" else AT_TRUE_SPEEDS)
    if any(math.isfinite(drive.coupling) for drive in drives):
        found.append(STIFF_COUPLINGS)
    return tuple(found)


def _rotor_masses(drives: Sequence[Drive]) -> FloatArray:
    """Inertia of motor and screw as mass along the travel ``(d,)`` [kg]."""
    turns = np.array([2.0 * math.pi / drive.lead for drive in drives])
    own = np.array([drive.motor_inertia + drive.screw_inertia for drive in drives])
    return np.asarray(own * turns**2)


MOMENTUM = "momentum"  # along the travel that a motor brings about, as an output per speed


@dataclass(frozen=True, eq=False)
class MovedMachine:
    """What ``d`` motors move of the rigid machine at ``n`` times.

    Attributes:
        positions: ``(n, d)`` set positions [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        bodies: ``(n, b, d)`` acceleration in each channel of the rigid motion per that of each
            motor.
        mass: ``(n, d, d)`` [kg].
        outputs: ``(n, p, d)`` motion at outputs per travel of each motor.
        weight: ``(n, d)`` generalised weight [N].
        inertia: ``(n, d)`` what the rigid motion takes beside the weight [N].
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray
    bodies: FloatArray
    mass: FloatArray
    outputs: FloatArray
    weight: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class TrajectoryMotors:
    """Motors under control along a trajectory.

    Attributes:
        at: What they move at times ``(n,)``.
        bodies: Channels of the rigid motion that they move.
        outputs: Where what they move is known.
    """

    drives: tuple[Drive, ...]
    at: Callable[[FloatArray], MovedMachine]
    bodies: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    @property
    def scales(self) -> tuple[Channel, ...]:
        """What scales read."""
        return tuple((drive.name, SCALE) for drive in self.drives)

    @property
    def momenta(self) -> tuple[Channel, ...]:
        """Momenta along what motors move."""
        return tuple((drive.name, MOMENTUM) for drive in self.drives)

    def join(self, trajectory: RigidTrajectory) -> Join:
        """Give a machine along a trajectory what scales read with locked motors, and the momenta along the
        travels that motors bring about.
        """

        def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
            travels = self.at(np.array([where])).bodies[0]
            loads, drives, taken = trajectory.loads(model), self.drives, Feedthrough()
            pulled = np.array([loads[channel] for channel in self.bodies])
            rows = [*_scale_rows(model, drives), *(-travels.T @ pulled)]
            outputs = (*self.scales, *self.momenta)
            if model.coupled is not None and errors.moved is not None:
                read = scale_rows(model.coupled, model.parts.scene.machine, drives)
                bodies = trajectory.travels(model.coupled)[
                    :, Index(trajectory.bodies).of(self.bodies)
                ]
                carried = momentum_rows(model.coupled, bodies @ travels)
                moved = move_rows(np.vstack([read, carried]), errors.moved)
                taken |= {
                    (output, offset): float(value)
                    for output, own in zip(outputs, moved, strict=True)
                    for (offset, _), value in zip(trajectory.offsets, own, strict=True)
                }
            return dict(zip(outputs, rows, strict=True)), taken

        return join


def _scale_rows(model: PoseModel, drives: Sequence[Drive]) -> list[FloatArray]:
    """What the linear scale of each drive reads with locked motors ``(n,)``."""
    if not isinstance(model, LumpedPose):
        return find_linear_scales(coupled_machine(model), model.parts.scene.machine, drives)
    unit = np.eye(len(model.system.mass))
    # a scale reads the leg up to its joint at the platform, its spring along itself included
    return [unit[2 * LENGTHS.index(drive.axis) + 1] for drive in drives]


def plan_motors(
    state: RunState,
    path: ToolPath,
    outputs: Sequence[Channel],
    *,
    amounts: Callable[[FloatArray], FloatArray],
    direction: FloatArray | None = None,
) -> TrajectoryMotors | None:
    """The drives that move a machine along a trajectory; None without control.

    Args:
        outputs: Where motion is wanted: of the tool first, its three directions. Of axes there are
            no others.
        amounts: Accelerations ``(n, r)`` of the bodies in the channels of the trajectory at times.
        direction: ``(3,)`` of a mechanism's tool.
    """
    scene, parts = state.scene, state.parts
    if not scene.drives:
        return None
    if scene.mechanism is not None and direction is not None:
        drives = [drive for drive in scene.drives.values() if drive.axis in LENGTHS]
        return _leg_motors(
            parts, scene.mechanism, path, drives, amounts, direction=direction, outputs=outputs
        )
    return _axis_motors(parts, scene.machine, outputs, path)


def interpolate_motors(
    speeding: TrajectoryMotors,
    pulling: TrajectoryMotors,
    nodes: FloatArray,
    travel: Callable[[FloatArray], PathMotion],
) -> TrajectoryMotors:
    """Motors along a line, from what they move where it is travelled at a speed of one, and where it is
    accelerated by one: the former counts with the square of the speed.

    Args:
        speeding: Motors at unit speed, over positions of the line.
        pulling: The same at unit acceleration.
        nodes: ``(k,)`` positions between which both are interpolated.
        travel: Motion along the line at times.
    """
    fast, pulled = speeding.at(nodes), pulling.at(nodes)
    fields = [
        *dataclasses.astuple(fast),
        pulled.accelerations,
        pulled.inertia,
    ]
    laws = [scipy.interpolate.make_interp_spline(nodes, values, k=3) for values in fields]

    def at(times: FloatArray) -> MovedMachine:
        now = travel(times)
        v, a = now.speeds[:, None], now.accelerations[:, None]
        *own, by_pull, held = (np.asarray(law(now.positions)) for law in laws)
        found = MovedMachine(*own)
        return dataclasses.replace(
            found,
            speeds=found.speeds * v,
            accelerations=found.accelerations * v**2 + by_pull * a,
            inertia=found.inertia * v**2 + held * a,
        )

    return dataclasses.replace(speeding, at=at)


@dataclass(frozen=True, eq=False)
class DrivenTrajectory:
    """A machine along its trajectory with its motors.

    Attributes:
        trajectory: How the rigid machine follows its path, errors included.
        motors: Under control; None where they follow their set points.
        tool: Where forces act on the tool, and where it moves.
    """

    trajectory: RigidTrajectory
    motors: TrajectoryMotors | None
    tool: tuple[Channel, ...]

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Where something acts: on the tool, then along the trajectory."""
        return (*self.tool, *self.trajectory.acting.channels)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Outputs that close the loops of the motors."""
        return () if self.motors is None else (*self.motors.scales, *self.motors.momenta)

    @property
    def joins(self) -> tuple[Join, ...]:
        """What gives a machine these outputs."""
        return () if self.motors is None else (self.motors.join(self.trajectory),)

    def move(
        self,
        sampled: SampledMotion,
        times: FloatArray,
        loads: TrajectoryLoads,
        *,
        friction: FrictionSpeeds,
        node_spacing: float,
        load_spacing: float,
    ) -> "MovingMachine":
        """Return the linear system along the trajectory, its loops closed.

        Args:
            sampled: The machine with locked motors.
            times: ``(n,)`` even steps [s].
            loads: That act along the trajectory.
            node_spacing: Time between which matrices are linear [s].
            load_spacing: Time between which loads are linear [s].
        """
        motion = follow_motion(
            sampled, times, loads, self.tool, node_spacing=node_spacing, load_spacing=load_spacing
        )
        servo = None
        if self.motors is not None:
            servo = _close_loops(self, self.motors, sampled, motion, loads, friction, load_spacing)
            motion = servo.motion
        return MovingMachine(self, sampled.at(motion.nodes, "rows", "direct"), motion, servo)


@dataclass(frozen=True, eq=False)
class MovingMachine:
    """A machine as a linear system along its trajectory.

    Attributes:
        plant: The matrices of the machine at the nodes of the motion.
        motion: Of its modes, motors and controllers.
        servo: The loops of the motors; None where they follow their set points.
    """

    driven: DrivenTrajectory
    plant: SampledPlant
    motion: LinearMotion
    servo: ServoMotion | None

    def rows(self, outputs: Sequence[Channel]) -> FloatArray:
        """Return the motion ``(k, p, c)`` at outputs per coordinate at the nodes."""
        rows, motors = self.plant.rows_of(outputs), self.driven.motors
        if motors is not None:
            moved = motors.at(self.motion.nodes).outputs[:, Index(motors.outputs).of(outputs)]
            rows = np.concatenate([rows, moved], axis=2)
        states = self.motion.mass.shape[-1] - rows.shape[-1]
        return np.pad(rows, ((0, 0), (0, 0), (0, states)))

    def record(
        self, history: CompliantHistory, acting: Callable[[slice], FloatArray]
    ) -> SampledHistory:
        """Return what the machine did, for observers.

        Args:
            acting: Values ``(m, k)`` of its inputs in a part of the steps.
        """
        return SampledHistory(self.motion, history, self.plant, self.driven.inputs, acting)


def _close_loops(
    driven: DrivenTrajectory,
    motors: TrajectoryMotors,
    sampled: SampledMotion,
    motion: LinearMotion,
    loads: TrajectoryLoads,
    friction: FrictionSpeeds,
    load_spacing: float,
) -> ServoMotion:
    """Close the loops of all motors of a machine, from its motion with locked motors."""
    now = motors.at(motion.nodes)
    found = sampled.at(motion.nodes, "loads", "rows", "direct")
    modes, count = sampled.modes, len(motors.drives)
    kept, own = slice(0, modes), slice(modes, modes + count)
    # the load of an acceleration is what the travel's inertia takes of the modes
    coupling = -found.loads_of(motors.bodies) @ now.bodies
    mass = np.zeros((len(motion.nodes), modes + count, modes + count))
    mass[:, kept, kept], mass[:, own, own] = motion.mass, now.mass
    mass[:, kept, own], mass[:, own, kept] = coupling, np.swapaxes(coupling, 1, 2)
    extra = ((0, 0), (0, count), (0, count))
    load_nodes = even_nodes(motion.times, load_spacing)
    finer = [motors.at(load_nodes[part]) for part in chunk_slices(len(load_nodes))]

    def between(values: Sequence[FloatArray]) -> FloatArray:
        return interpolate_nodes(motion.times, load_nodes, np.concatenate(values))

    # offsets of joints that modes follow at once move what scales read and what motors accelerate
    follow = Index(loads.channels)
    offsets = driven.trajectory.offsets
    moving, pulling = ([pair[end] for pair in offsets] for end in (0, 1))
    moved, accelerated = (
        between([loads.at(load_nodes[part])[:, columns] for part in chunk_slices(len(load_nodes))])
        for columns in (follow.of(moving), follow.of(pulling))
    )
    pulled = between([each.weight - each.inertia for each in finer])
    pulled -= motion.apply(found.direct_of(motors.momenta, moving), accelerated)
    weight = np.concatenate([found.loads_of([loads.weight])[..., 0], now.weight], axis=1)
    unit = np.broadcast_to(np.eye(count), (len(motion.nodes), count, count))
    return close_drives(
        dataclasses.replace(
            motion,
            mass=mass,
            damping=np.pad(motion.damping, extra),
            stiffness=np.pad(motion.stiffness, extra),
            tool=np.concatenate(
                [motion.tool, now.outputs[:, Index(motors.outputs).of(driven.tool)]], axis=2
            ),
            load=np.concatenate([motion.load, pulled], axis=1),
        ),
        motors.drives,
        positions=between([each.positions for each in finer]),
        speeds=between([each.speeds for each in finer]),
        accelerations=between([each.accelerations for each in finer]),
        gravity=weight,
        scales=np.concatenate([found.rows_of(motors.scales), unit], axis=2),
        beside=motion.apply(found.direct_of(motors.scales, moving), moved),
        friction=friction,
    )


def _axis_motors(
    parts: MachineParts, machine: Machine, tool: Sequence[Channel], path: ToolPath
) -> TrajectoryMotors | None:
    """Motors of linear axes."""
    travel = find_tool_travel(machine, machine.points[tool[0][0]])
    drives = tuple(each for each in parts.scene.drives.values() if each.axis in travel.axes)
    if not drives:
        return None
    columns = [travel.axes.index(drive.axis) for drive in drives]
    axes = [machine.axes[drive.axis] for drive in drives]
    gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
    masses = {name: part.mass_kg for name, part in parts.superelements.items()}
    mass = np.array(
        [
            [
                float(one.direction @ other.direction)
                * sum(masses[name] for name in set(one.moves) & set(other.moves))
                for other in axes
            ]
            for one in axes
        ]
    )
    weight = np.array(
        [
            float(axis.direction @ gravity) * sum(masses[name] for name in axis.moves)
            for axis in axes
        ]
    )
    bodies = np.eye(len(travel.axes))[:, columns]
    moved = travel.directions[:, columns]

    def at(times: FloatArray) -> MovedMachine:
        points, count = path.at(times), len(times)
        positions, speeds, accelerations = (
            travel.axis_positions(values)[:, columns]
            for values in (points.position, points.velocity, points.acceleration)
        )
        return MovedMachine(
            positions,
            speeds,
            accelerations,
            bodies=np.broadcast_to(bodies, (count, *bodies.shape)),
            mass=np.broadcast_to(mass, (count, *mass.shape)),
            outputs=np.broadcast_to(moved, (count, *moved.shape)),
            weight=np.broadcast_to(weight, (count, len(weight))),
            inertia=accelerations @ mass,
        )

    return TrajectoryMotors(drives, at, axis_channels(travel.axes), tuple(tool))


def _leg_motors(
    parts: MachineParts,
    mechanism: SceneMechanism,
    path: ToolPath,
    drives: Sequence[Drive],
    amounts: Callable[[FloatArray], FloatArray],
    *,
    direction: FloatArray,
    outputs: Sequence[Channel],
) -> TrajectoryMotors | None:
    """Motors of the legs of a mechanism."""
    if not drives:
        return None
    mounted = mechanism.mounted
    known, turn = mounted.mechanism, mounted.mounting.rotation
    bodies = {name: marker for name, marker in mechanism.carries.items() if name in parts.reduced}
    gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
    legs = [known.driven.index(drive.axis) for drive in drives]

    def at(times: FloatArray) -> MovedMachine:
        moved = move_markers(mounted, times, path.at(times), direction)
        kinematics = evaluate_kinematics(known, moved.states)
        from_legs = velocity_maps(known, kinematics.closure_jacobian)[0][..., legs]
        pulled = amounts(times)
        count = len(drives)
        mass = np.zeros((len(times), count, count))
        weight, inertia = np.zeros((len(times), count)), np.zeros((len(times), count))
        travels = []

        def travel(name: str, local: FloatArray) -> tuple[FloatArray, FloatArray]:
            """Motion and turning ``(n, 3, d)`` of a place in a body."""
            place, own = known.markers.index(bodies[name]), parts.plan.components[name].placement
            arm = moved.rotations[:, place] @ (own.origin + own.rotation @ local)
            turning = kinematics.of_rotation[:, place] @ from_legs
            moving = kinematics.of_position[:, place] @ from_legs - skew_matrices(arm) @ turning
            return turn @ moving, turn @ turning

        def output_rows(channel: Channel) -> FloatArray:
            """Motion ``(n, d)`` at an output: of a point its tool's less its work's, or of an
            interface.
            """
            point, dof = parts.scene.machine.points.get(channel[0]), DOF_NAMES.index(channel[1])
            ends = [(JointEnd(*channel[0].split(".", 1)), 1.0, NO_OFFSET)]
            if point is not None:
                at_tool = point.carrier is point.tool
                ends = [
                    (point.tool, 1.0, point.offset if at_tool else NO_OFFSET),
                    (point.work, -1.0, NO_OFFSET if at_tool else point.offset),
                ]
            total = np.zeros((len(times), 6, count))
            for end, sign, offset in ends:
                if end.component in bodies and end.interface is not None:
                    local = (
                        parts.superelements[end.component].interface_position(end.interface)
                        + offset
                    )
                    total += sign * np.concatenate(travel(end.component, local), axis=1)
            return np.asarray(total[:, dof])

        for number, (name, marker) in enumerate(bodies.items()):
            place, body = known.markers.index(marker), parts.superelements[name]
            own = parts.plan.components[name].placement
            moving, turning = travel(name, body.center_of_mass)
            axes = turn @ moved.rotations[:, place] @ own.rotation
            tensor = axes @ body.inertia @ np.swapaxes(axes, -1, -2)
            straight, spin = np.split(pulled[:, 6 * number : 6 * number + 6, None], 2, axis=1)
            left, about = np.swapaxes(moving, 1, 2), np.swapaxes(turning, 1, 2)
            mass += body.mass_kg * (left @ moving) + about @ tensor @ turning
            weight += body.mass_kg * (left @ gravity)
            inertia += (body.mass_kg * (left @ straight) + about @ tensor @ spin)[..., 0]
            travels += [moving, turning]
        driven = np.arange(known.driven_slice.start, known.driven_slice.stop)[legs]
        return MovedMachine(
            positions=moved.states[:, driven],
            speeds=moved.rates[:, driven],
            accelerations=moved.growth[:, driven],
            bodies=np.concatenate(travels, axis=1),
            mass=mass,
            outputs=np.stack([output_rows(channel) for channel in outputs], axis=1),
            weight=weight,
            inertia=inertia,
        )

    return TrajectoryMotors(tuple(drives), at, body_channels(bodies), tuple(outputs))
