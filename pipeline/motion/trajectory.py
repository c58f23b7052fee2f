"""Trajectories of a machine and laws along them: positions and accelerations of its rigid bodies,
and the rigid motion that its motors cause.

A trajectory ``x(s)`` is a position over a parameter ``s``: the time of a contour, the position
along a line. A law ``s(t)`` says when: at a speed ``v`` and an acceleration ``a`` of ``s`` the
acceleration of the rigid machine is ``x'' v^2 + x' a``. Contours and straight moves of a tool share
their trajectories.
"""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy  # whose interpolation, a third of a second, is loaded where it is used

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import Axis
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.machine.tool_travel import ToolTravel
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.error_travel import follow_offsets
from headstock.reduction.coupling.path_loads import inertia_load, rigid_travel
from headstock.solvers.milling.tool_path import PathPoints
from headstock.solvers.motion.plant_motion import TrajectoryLoads
from headstock.solvers.motion.set_points import PathMotion
from headstock.solvers.second_order import Channel

GRAVITY_LOAD: Channel = ("gravity", "load")
RATE_SHARE = 1e-5  # step of the finite differences of offsets, over the length of a trajectory
Law = Callable[[FloatArray], PathMotion]
Feedthrough = dict[tuple[Channel, Channel], float]


@dataclass(frozen=True, eq=False)
class MovedMachine:
    """Store the rigid motion that ``d`` motors cause, at ``n`` instants.

    Attributes:
        positions: ``(n, d)`` set positions [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        bodies: ``(n, b, d)`` acceleration in each channel of the rigid motion per that of each
            motor.
        mass: ``(n, d, d)`` generalised mass of that motion [kg].
        outputs: ``(n, p, d)`` motion at outputs per travel of each motor.
        weight: ``(n, d)`` generalised weight [N].
        inertia: ``(n, d)`` generalised inertial force of the rigid motion [N].
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray
    bodies: FloatArray
    mass: FloatArray
    outputs: FloatArray
    weight: FloatArray
    inertia: FloatArray


MotorTravel = Callable[[PathMotion], MovedMachine]


class Trajectory(ABC):
    """Describe the rigid machine over a parameter."""

    @property
    @abstractmethod
    def bodies(self) -> tuple[Channel, ...]:
        """Channels of the accelerations of bodies."""

    @property
    def turning(self) -> tuple[str, ...]:
        """Bodies that rotate along it, with velocity terms."""
        return ()

    @property
    @abstractmethod
    def drives(self) -> tuple[Drive, ...]:
        """Drives of the scene that move the machine along the trajectory."""

    @abstractmethod
    def pose(self, where: float) -> Pose:
        """Return the pose at a value of the parameter."""

    @abstractmethod
    def accelerate(self, motion: PathMotion) -> FloatArray:
        """Return the accelerations ``(n, b)`` in all channels during a motion along it."""

    @abstractmethod
    def loads(self, model: PoseModel) -> dict[Channel, FloatArray]:
        """Return the inertial load ``(n,)`` of a posed machine per acceleration in each channel."""

    @abstractmethod
    def travels(self, coupled: CoupledMachine) -> FloatArray:
        """Return the motion ``(n_all, b)`` of the stacked dofs per travel in each channel."""

    @abstractmethod
    def move_motors(self, drives: Sequence[Drive], outputs: Sequence[Channel]) -> MotorTravel:
        """Return the rigid motion that motors cause, during a motion along the trajectory.

        Args:
            outputs: Outputs at which motion is wanted: points or interfaces.
        """

    def turn_rates(self, motion: PathMotion) -> dict[str, float]:
        """Return the largest rotation rate of each rotating body [rad/s]."""
        return {}


class Curve(Protocol):
    """Describe the path of a tool over a parameter."""

    def at(self, where: FloatArray, /) -> PathPoints:
        """Return points at ``(n,)`` values of the parameter, and their two derivatives."""


def follow_curve(path: Curve, motion: PathMotion) -> PathPoints:
    """Return positions, velocities and accelerations of a motion along a path."""
    points = path.at(motion.positions)
    speeds, accelerations = motion.speeds[:, None], motion.accelerations[:, None]
    return PathPoints(
        points.position,
        points.velocity * speeds,
        points.acceleration * speeds**2 + points.velocity * accelerations,
    )


def follow_time(times: FloatArray) -> PathMotion:
    """Return the law ``s = t``, of trajectories over time."""
    return PathMotion(times, np.ones(len(times)), np.zeros(len(times)))


@dataclass(frozen=True, eq=False)
class AxesTrajectory(Trajectory):
    """Describe linear axes that travel along a path over time."""

    parts: MachineParts
    travel: ToolTravel
    path: Curve

    @property
    def bodies(self) -> tuple[Channel, ...]:
        """Accelerations of axes."""
        return tuple((name, "acceleration") for name in self.travel.axes)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of these axes."""
        drives = self.parts.scene.drives.values()
        return tuple(drive for drive in drives if drive.axis in self.travel.axes)

    def pose(self, where: float) -> Pose:
        """Return the pose at a time [s]."""
        point = self.path.at(np.array([where])).position
        positions = self.travel.axis_positions(point)[0].tolist()
        return Pose(f"t = {where:.4g} s", dict(zip(self.travel.axes, positions, strict=True)))

    def accelerate(self, motion: PathMotion) -> FloatArray:
        """Return the accelerations of axes."""
        return self.travel.axis_positions(follow_curve(self.path, motion).acceleration)

    def axis_motion(self, name: str, motion: PathMotion) -> tuple[FloatArray, FloatArray]:
        """Return speed and acceleration ``(n,)`` of an axis; zero of one that does not move along
        the trajectory.
        """
        if name not in self.travel.axes:
            return np.zeros(len(motion.positions)), np.zeros(len(motion.positions))
        number, points = self.travel.axes.index(name), follow_curve(self.path, motion)
        return (
            self.travel.axis_positions(points.velocity)[:, number],
            self.travel.axis_positions(points.acceleration)[:, number],
        )

    def _directions(self, name: str) -> dict[str, FloatArray]:
        axis = self.parts.scene.machine.axes[name]
        return dict.fromkeys(axis.moves, axis.direction)

    def loads(self, model: PoseModel) -> dict[Channel, FloatArray]:
        """Return the inertial loads of axes."""
        coupled = coupled_machine(model)
        return {
            channel: inertia_load(coupled, self._directions(channel[0])) for channel in self.bodies
        }

    def travels(self, coupled: CoupledMachine) -> FloatArray:
        """Return the motion per travel of axes."""
        columns = [rigid_travel(coupled, self._directions(name)) for name in self.travel.axes]
        return np.column_stack(columns)

    def move_motors(self, drives: Sequence[Drive], outputs: Sequence[Channel]) -> MotorTravel:
        """Return the rigid motion that motors cause; the outputs are the directions of the tool."""
        travel, machine = self.travel, self.parts.scene.machine
        columns = [travel.axes.index(drive.axis) for drive in drives]
        axes = [machine.axes[drive.axis] for drive in drives]
        masses = {name: part.mass_kg for name, part in self.parts.superelements.items()}
        gravity = gravity_vector(self.parts)

        def weigh(names: Iterable[str]) -> float:
            return sum(masses[name] for name in names)

        mass = np.array(
            [
                [
                    float(one.direction @ other.direction)
                    * weigh(set(one.moves) & set(other.moves))
                    for other in axes
                ]
                for one in axes
            ]
        )
        weight = np.array([float(axis.direction @ gravity) * weigh(axis.moves) for axis in axes])
        bodies, tool = np.eye(len(travel.axes))[:, columns], travel.directions[:, columns]

        def at(motion: PathMotion) -> MovedMachine:
            points, count = follow_curve(self.path, motion), len(motion.positions)
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
                outputs=np.broadcast_to(tool, (count, *tool.shape)),
                weight=np.broadcast_to(weight, (count, len(weight))),
                inertia=accelerations @ mass,
            )

        return at


def interpolate_trajectory(
    trajectory: Trajectory, nodes: FloatArray
) -> Callable[[PathMotion], FloatArray]:
    """Return the accelerations along a trajectory, interpolated between nodes ``(k,)``: those at
    unit speed, to be scaled by the square of the speed, and those at unit acceleration.
    """
    fast, accelerated = _interpolate(
        nodes, [trajectory.accelerate(now) for now in _unit_laws(nodes)]
    )

    def accelerate(motion: PathMotion) -> FloatArray:
        squares = fast(motion.positions) * motion.speeds[:, None] ** 2
        return squares + accelerated(motion.positions) * motion.accelerations[:, None]

    return accelerate


def interpolate_motors(moved: MotorTravel, nodes: FloatArray) -> MotorTravel:
    """Return the rigid motion that motors cause along a trajectory, interpolated likewise."""
    fast, accelerated = (moved(now) for now in _unit_laws(nodes))
    laws = _interpolate(
        nodes, [*dataclasses.astuple(fast), accelerated.accelerations, accelerated.inertia]
    )

    def at(motion: PathMotion) -> MovedMachine:
        v, a = motion.speeds[:, None], motion.accelerations[:, None]
        *fields, by_pull, inertia = (np.asarray(law(motion.positions)) for law in laws)
        unit = MovedMachine(*fields)
        return dataclasses.replace(
            unit,
            speeds=unit.speeds * v,
            accelerations=unit.accelerations * v**2 + by_pull * a,
            inertia=unit.inertia * v**2 + inertia * a,
        )

    return at


def _unit_laws(nodes: FloatArray) -> tuple[PathMotion, PathMotion]:
    """Return motions of unit speed and of unit acceleration at the nodes."""
    one, none = np.ones(len(nodes)), np.zeros(len(nodes))
    return PathMotion(nodes, one, none), PathMotion(nodes, none, one)


def _interpolate(
    nodes: FloatArray, fields: Sequence[FloatArray]
) -> "list[scipy.interpolate.BSpline]":
    return [scipy.interpolate.make_interp_spline(nodes, values, k=3) for values in fields]


@dataclass(frozen=True, eq=False)
class PosedErrors:
    """Store the effect of a unit of each error on a machine in a pose.

    Attributes:
        loads: Channel to its load ``(n,)``.
        feedthrough: Output and channel to the direct contribution of a unit of the channel to the
            output: the force of a joint relieved by its offset, and motion imposed in fixed
            directions.
        moved: ``(n_all, k)`` motion of the stacked dofs imposed by a unit of each offset; None
            where offsets act through springs only.
    """

    loads: Mapping[Channel, FloatArray] = field(default_factory=dict)
    feedthrough: Feedthrough = field(default_factory=dict)
    moved: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class TrajectoryErrors:
    """Describe errors of guides, screws and legs along a trajectory.

    Attributes:
        channels: One per offset, then one per rate and one per acceleration that act.
        act_on: Returns the effect of a unit of each on a machine in a pose.
        offsets: ``(n, k)`` at values ``(n,)`` of the parameter, in units.
        rated: ``(r,)`` offsets whose rates act, too.
        accelerated: ``(a,)`` offsets whose accelerations act, too.
        shortest: Shortest wavelength of the errors along the trajectory.
    """

    channels: tuple[Channel, ...]
    act_on: Callable[[PoseModel], PosedErrors]
    offsets: Callable[[FloatArray], FloatArray]
    rated: tuple[int, ...]
    accelerated: tuple[int, ...]
    ends: tuple[float, float]
    shortest: float

    @property
    def inertial(self) -> tuple[tuple[Channel, Channel], ...]:
        """Channels of offsets whose accelerations act, each with that of the acceleration."""
        last = self.channels[len(self.channels) - len(self.accelerated) :]
        return tuple(zip((self.channels[number] for number in self.accelerated), last, strict=True))

    def follow(self, motion: PathMotion) -> FloatArray:
        """Return the values ``(n, k)`` of all channels during a motion along the trajectory."""
        step = RATE_SHARE * (self.ends[1] - self.ends[0])
        offsets, rates, growth = follow_offsets(self.offsets, motion, self.ends, step)
        return np.concatenate(
            [offsets, rates[:, list(self.rated)], growth[:, list(self.accelerated)]], axis=1
        )


@dataclass(frozen=True, eq=False)
class FollowedTrajectory:
    """Describe a trajectory that a machine follows by a law, with the errors along it.

    Attributes:
        accelerate: Accelerations ``(n, b)`` of the rigid machine during a motion along it.
    """

    trajectory: Trajectory
    law: Law
    accelerate: Callable[[PathMotion], FloatArray]
    errors: TrajectoryErrors | None = None

    @property
    def acting(self) -> TrajectoryLoads:
        """Channels of loads along the trajectory: gravity, then accelerations and errors."""
        errors = () if self.errors is None else self.errors.channels
        channels = (GRAVITY_LOAD, *self.trajectory.bodies, *errors)
        return TrajectoryLoads(channels, self._act, GRAVITY_LOAD)

    def _act(self, times: FloatArray) -> FloatArray:
        motion = self.law(times)
        errors = [] if self.errors is None else [self.errors.follow(motion)]
        weight = np.ones((len(times), 1))
        return np.concatenate([weight, self.accelerate(motion), *errors], axis=1)

    def act_on(self, model: PoseModel) -> PosedErrors:
        """Return the effect of unit errors on a machine in a pose."""
        return PosedErrors() if self.errors is None else self.errors.act_on(model)


def coupled_machine(model: PoseModel) -> CoupledMachine:
    """Return the machine of superelements of a model.

    Raises:
        ValueError: The model is a lumped mechanism.
    """
    if model.coupled is None:
        raise ValueError("a lumped mechanism has no superelements")
    return model.coupled


def gravity_vector(parts: MachineParts) -> FloatArray:
    """Return the acceleration of gravity ``(3,)`` [m/s^2], machine frame; zero without gravity."""
    return np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)


def find_ball_screws(machine: Machine) -> dict[str, tuple[str, Axis | None]]:
    """Find the ball screws that drive a machine: name of the drive to its joint and axis; those of
    a mechanism have the name of their joint.
    """
    screws: dict[str, tuple[str, Axis | None]] = {}
    for axis in machine.axes.values():
        for name in axis.joints:
            if machine.joints[name].kind == "ball_screw" and axis.kind == "linear":
                screws.setdefault(axis.name, (name, axis))
    if machine.mechanism is not None:
        taken = {joint for joint, _ in screws.values()}
        screws |= {
            name: (name, None)
            for name, joint in machine.joints.items()
            if joint.kind == "ball_screw" and name not in taken
        }
    return screws
