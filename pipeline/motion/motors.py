"""Motors of a machine along a trajectory: the rigid motion that they cause, and their loops closed
around the modes of the machine.

The modes are those with locked motors. The coordinate of a motor is the travel of the rigid machine
that it causes. Motors and modes are coupled by the inertia of that travel, which is also the load
by which rigid acceleration excites the modes.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.pipeline.motion.contour_run import ContourDrives
from headstock.pipeline.motion.posed_machine import Further, Join
from headstock.pipeline.motion.trajectory import (
    Feedthrough,
    FollowedTrajectory,
    MotorTravel,
    PosedErrors,
    Trajectory,
    coupled_machine,
    follow_time,
)
from headstock.pipeline.stages.mechanism import LumpedPose
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.coupling.drives import find_linear_scales, scale_rows
from headstock.reduction.coupling.error_travel import move_rows
from headstock.reduction.coupling.path_loads import find_momenta
from headstock.solvers.control.drive_trains import SCALE
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
from headstock.solvers.second_order import Channel, Index

FrictionSpeeds = Literal["set", "true"]

CLOSED = "the loops of the drives are closed along the contour; motor torques are those of their controllers"
AT_SET_SPEEDS = "friction acts as at the speeds of the set points"
AT_TRUE_SPEEDS = "friction acts as at the speeds of the motors"
MOMENTUM = "momentum"  # along the travel of a motor, as an output per speed
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
    fixed_readings: FloatArray | None = None,
) -> ServoMotion:
    """Add motors to a machine along its trajectory and close their loops.

    Args:
        free: The machine; its last ``d`` coordinates are the travels of the motors, free and
            without the motors' inertia.
        drives: The ``d`` drives.
        positions: ``(n, d)`` set positions of axes or legs [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        gravity: ``(k, c + d)`` generalised weight at the nodes [N].
        scales: ``(k, d, c + d)`` what linear scales read per coordinate.
        friction: The speeds at which friction is evaluated: those of the set points, which keeps
            the motion linear, or those of the motors.
        fixed_readings: ``(n, d)`` readings of scales that do not depend on coordinates; None for none.
    """
    size, count = free.mass.shape[-1], len(drives)
    motors = np.arange(size - count, size)
    middle = free.mass[len(free.mass) // 2]
    rotors = _rotor_masses(drives)
    mass = np.array(free.mass)
    mass[:, motors, motors] += rotors
    damping, load = np.array(free.damping), np.array(free.load)
    load[:, motors] -= rotors * accelerations
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
        for drive, motor, rotor in zip(drives, motors, rotors, strict=True)
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
        fixed_readings=fixed_readings,
    )


def controlled_drives(
    servo: ServoMotion, drives: Sequence[Drive], history: CompliantHistory
) -> ContourDrives:
    """Return the forces of screws on the bodies they move, and the torques of motors, which include
    their own inertia and friction.

    Args:
        servo: The machine along its trajectory.
    """
    drive_forces = servo.forces(history)
    motor_accelerations = history.acceleration[:, servo.motors]
    rates = history.rate[:, servo.motors]
    inertia = _rotor_masses(drives) * (servo.accelerations + motor_accelerations)
    if servo.motion.friction is None:
        law = stack_laws([drive.friction for drive in drives])
        friction_forces = friction_force(law, servo.speeds) + law.viscous * rates
    else:
        friction_forces = servo.motion.friction.force(history.rate)
    leads = np.array([drive.lead for drive in drives])

    def forces(some: NDArray[np.intp]) -> FloatArray:
        return (drive_forces - inertia - friction_forces)[some]

    def torques(some: NDArray[np.intp], _: FloatArray) -> FloatArray:
        return drive_forces[some] * (leads / (2.0 * math.pi))

    return ContourDrives(tuple(drive.name for drive in drives), forces, torques)


def drive_assumptions(drives: Sequence[Drive], friction: FrictionSpeeds) -> tuple[str, ...]:
    """List what is assumed of drives along a contour."""
    assumed = [CLOSED]
    if any(drive.friction is not None for drive in drives):
        assumed.append(AT_SET_SPEEDS if friction == "set" else AT_TRUE_SPEEDS)
    if any(math.isfinite(drive.coupling) for drive in drives):
        assumed.append(STIFF_COUPLINGS)
    return tuple(assumed)


def _rotor_masses(drives: Sequence[Drive]) -> FloatArray:
    """Return the inertia of motor and screw as a mass along the travel ``(d,)`` [kg]."""
    turns = np.array([2.0 * math.pi / drive.lead for drive in drives])
    inertia = np.array([drive.motor_inertia + drive.screw_inertia for drive in drives])
    return inertia * turns**2


@dataclass(frozen=True, eq=False)
class TrajectoryMotors:
    """Describe motors under control along a trajectory.

    Attributes:
        at: Returns the rigid motion that they cause, during a motion along the trajectory.
        bodies: Channels of the rigid motion that they move.
    """

    drives: tuple[Drive, ...]
    at: MotorTravel
    bodies: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    @property
    def scales(self) -> tuple[Channel, ...]:
        """Channels of the readings of linear scales."""
        return tuple((drive.name, SCALE) for drive in self.drives)

    @property
    def momenta(self) -> tuple[Channel, ...]:
        """Channels of the momenta along the travels of the motors."""
        return tuple((drive.name, MOMENTUM) for drive in self.drives)

    def join(self, followed: FollowedTrajectory) -> Join:
        """Add to a machine along a trajectory the readings of scales with locked motors, and the
        momenta along the travels of the motors.
        """
        trajectory = followed.trajectory

        def join(where: float, model: PoseModel, errors: PosedErrors) -> Further:
            travels = self.at(follow_time(np.array([where]))).bodies[0]
            loads, drives, direct = trajectory.loads(model), self.drives, Feedthrough()
            inertial_loads = np.array([loads[channel] for channel in self.bodies])
            rows = [*_scale_rows(model, drives), *(-travels.T @ inertial_loads)]
            outputs = (*self.scales, *self.momenta)
            if model.coupled is not None and followed.errors and errors.moved is not None:
                read = scale_rows(model.coupled, model.parts.scene.machine, drives)
                bodies = trajectory.travels(model.coupled)[
                    :, Index(trajectory.bodies).of(self.bodies)
                ]
                carried = find_momenta(model.coupled, bodies @ travels).T
                moved = move_rows(np.vstack([read, carried]), errors.moved)
                direct |= {
                    (output, offset): float(value)
                    for output, row in zip(outputs, moved, strict=True)
                    for (offset, _), value in zip(followed.errors.inertial, row, strict=True)
                }
            return dict(zip(outputs, rows, strict=True)), direct

        return join


def _scale_rows(model: PoseModel, drives: Sequence[Drive]) -> list[FloatArray]:
    """Return the output row ``(n,)`` of the linear scale of each drive with locked motors."""
    if not isinstance(model, LumpedPose):
        return find_linear_scales(coupled_machine(model), model.parts.scene.machine, drives)
    unit = np.eye(len(model.system.mass))
    # a scale reads the leg up to its joint at the platform, its axial spring included
    return [unit[2 * LENGTHS.index(drive.axis) + 1] for drive in drives]


def plan_motors(
    trajectory: Trajectory,
    outputs: Sequence[Channel],
    adapt: Callable[[MotorTravel], MotorTravel] = lambda travel: travel,
) -> TrajectoryMotors | None:
    """Return the motors that move a machine along a trajectory; None without control.

    Args:
        outputs: Outputs: first the three directions of the tool, the only ones of linear axes.
        adapt: Wraps the function of the motors' rigid motion, to cache or interpolate it.
    """
    drives = trajectory.drives
    if not drives:
        return None
    travel = adapt(trajectory.move_motors(drives, outputs))
    return TrajectoryMotors(drives, travel, trajectory.bodies, tuple(outputs))


@dataclass(frozen=True, eq=False)
class DrivenTrajectory:
    """Describe a machine along its trajectory with its motors.

    Attributes:
        followed: The trajectory of the rigid machine, guide errors included.
        motors: Motors under control; None where motors follow their set points exactly.
        tool: Channels of forces on the tool, and of its motion.
    """

    followed: FollowedTrajectory
    motors: TrajectoryMotors | None
    tool: tuple[Channel, ...]

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Channels of forces on the tool, then of the loads along the trajectory."""
        return (*self.tool, *self.followed.acting.channels)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Outputs that close the loops of the motors."""
        return () if self.motors is None else (*self.motors.scales, *self.motors.momenta)

    @property
    def joins(self) -> tuple[Join, ...]:
        """Functions that add these outputs to a machine."""
        return () if self.motors is None else (self.motors.join(self.followed),)

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
    """Describe a machine as a linear system along its trajectory.

    Attributes:
        plant: The matrices of the machine at the nodes of the motion.
        motion: Linear model in coordinates of modes, motors and controllers.
        servo: The closed loops of the motors; None where motors follow their set points exactly.
    """

    driven: DrivenTrajectory
    plant: SampledPlant
    motion: LinearMotion
    servo: ServoMotion | None

    def rows(self, outputs: Sequence[Channel]) -> FloatArray:
        """Return the output rows ``(k, p, c)`` per coordinate at the nodes."""
        rows, motors = self.plant.rows_of(outputs), self.driven.motors
        if motors is not None:
            now = motors.at(self.driven.followed.law(self.motion.nodes))
            moved = now.outputs[:, Index(motors.outputs).of(outputs)]
            rows = np.concatenate([rows, moved], axis=2)
        states = self.motion.mass.shape[-1] - rows.shape[-1]
        return np.pad(rows, ((0, 0), (0, 0), (0, states)))

    def record(
        self, history: CompliantHistory, acting: Callable[[slice], FloatArray]
    ) -> SampledHistory:
        """Return the history of the machine, for observers.

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
    """Close the loops of all motors of a machine, given its linear model with locked motors."""
    law, errors = driven.followed.law, driven.followed.errors
    now = motors.at(law(motion.nodes))
    plant = sampled.at(motion.nodes, "loads", "rows", "direct")
    modes, count = sampled.modes, len(motors.drives)
    kept, rotors = slice(0, modes), slice(modes, modes + count)
    # the inertia of a travel couples motors and modes: minus the load per acceleration
    coupling = -plant.loads_of(motors.bodies) @ now.bodies
    mass = np.zeros((len(motion.nodes), modes + count, modes + count))
    mass[:, kept, kept], mass[:, rotors, rotors] = motion.mass, now.mass
    mass[:, kept, rotors], mass[:, rotors, kept] = coupling, np.swapaxes(coupling, 1, 2)
    extra = ((0, 0), (0, count), (0, count))
    load_nodes = even_nodes(motion.times, load_spacing)
    finer = [motors.at(law(load_nodes[part])) for part in chunk_slices(len(load_nodes))]

    def between(values: Sequence[FloatArray]) -> FloatArray:
        return interpolate_nodes(motion.times, load_nodes, np.concatenate(values))

    # offsets of joints act directly on modes, readings of scales and bodies that motors accelerate
    columns_of, inertial = Index(loads.channels), () if errors is None else errors.inertial
    moving, accelerating = ([pair[end] for pair in inertial] for end in (0, 1))
    offsets, offset_accelerations = (
        between([loads.at(load_nodes[part])[:, columns] for part in chunk_slices(len(load_nodes))])
        for columns in (columns_of.of(moving), columns_of.of(accelerating))
    )
    motor_loads = between([rigid.weight - rigid.inertia for rigid in finer])
    motor_loads -= motion.apply(plant.direct_of(motors.momenta, moving), offset_accelerations)
    weight = np.concatenate([plant.loads_of([loads.weight])[..., 0], now.weight], axis=1)
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
            load=np.concatenate([motion.load, motor_loads], axis=1),
        ),
        motors.drives,
        positions=between([rigid.positions for rigid in finer]),
        speeds=between([rigid.speeds for rigid in finer]),
        accelerations=between([rigid.accelerations for rigid in finer]),
        gravity=weight,
        scales=np.concatenate([plant.rows_of(motors.scales), unit], axis=2),
        fixed_readings=motion.apply(plant.direct_of(motors.scales, moving), offsets),
        friction=friction,
    )
