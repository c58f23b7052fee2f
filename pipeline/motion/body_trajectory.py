"""Trajectories of bodies that may rotate: of a mechanism that guides its tool along a path, and of
axes some of which are rotary. The translational and angular accelerations of every body, in machine
axes, are channels.
"""

import functools
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import (
    NO_OFFSET,
    Machine,
    MachinePath,
    Pose,
    Sensor,
    free_axes,
    place_components,
)
from headstock.geometry.mechanisms.closures import evaluate_kinematics
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.pipeline.motion.contour_run import CORIOLIS, CachedFunction
from headstock.pipeline.motion.trajectory import (
    Curve,
    MotorTravel,
    MovedMachine,
    Trajectory,
    coupled_machine,
    find_ball_screws,
    follow_curve,
    gravity_vector,
)
from headstock.pipeline.stages.mechanism import LumpedPose
from headstock.pipeline.stages.run_state import MachineParts, PoseModel, RunState
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.path_loads import body_loads, body_travel
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.partitioning import velocity_maps
from headstock.solvers.milling.path_drives import MarkerMotion, move_markers
from headstock.solvers.motion.set_points import PathMotion
from headstock.solvers.second_order import Channel

AWAY = 0.5  # travel [m, rad] to either side over which the motion per travel is differenced
STEP = 0.01  # rotation of the fastest body between frames of finite differences [rad]
# central differences of fourth order
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0


@dataclass(frozen=True, eq=False)
class _DriveMotion:
    """Store set points of ``d`` drives and the rigid motion they cause, at ``n`` instants.

    Attributes:
        positions: ``(n, d)`` set positions [m].
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        rotation: Orientation ``(n, 3, 3)`` of the body.
        travel: Motion ``(n, 6, d)`` of a point of the body, in the body's own axes, per travel of
            each drive.
    """

    positions: FloatArray
    speeds: FloatArray
    accelerations: FloatArray
    rotation: Callable[[str], FloatArray]
    travel: Callable[[str, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class BodyTrajectory(Trajectory):
    """Describe how bodies of a machine move along a trajectory."""

    parts: MachineParts

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the bodies that move."""

    @abstractmethod
    def drive(self, drives: Sequence[Drive], motion: PathMotion) -> _DriveMotion:
        """Return the set points of drives and the motion they cause along the trajectory."""

    @property
    def bodies(self) -> tuple[Channel, ...]:
        """Channels: translational and angular accelerations of bodies, in machine axes."""
        return tuple((name, f"acceleration {dof}") for name in self.names for dof in DOF_NAMES)

    def loads(self, model: PoseModel) -> dict[Channel, FloatArray]:
        """Return the inertial load per acceleration of each body."""
        columns = [
            model.body_loads(name)
            if isinstance(model, LumpedPose)
            else body_loads(coupled_machine(model), name)
            for name in self.names
        ]
        return dict(zip(self.bodies, np.hstack(columns).T, strict=True))

    def travels(self, coupled: CoupledMachine) -> FloatArray:
        """Return the motion of the machine's dofs per travel of each body."""
        columns = []
        for name in self.names:
            moved = np.zeros((coupled.layout.size, len(DOF_NAMES)))
            moved[coupled.offsets[name]] = body_travel(coupled, name)
            columns.append(moved)
        return np.hstack(columns)

    def move_motors(self, drives: Sequence[Drive], outputs: Sequence[Channel]) -> MotorTravel:
        """Return the rigid motion of bodies that each motor causes."""
        parts, gravity = self.parts, gravity_vector(self.parts)

        def at(motion: PathMotion) -> MovedMachine:
            moved, rigid = self.drive(drives, motion), self.accelerate(motion)
            count = len(drives)
            mass = np.zeros((len(rigid), count, count))
            weight, inertia = np.zeros((len(rigid), count)), np.zeros((len(rigid), count))
            travels = []
            for number, name in enumerate(self.names):
                body, rotation = parts.superelements[name], moved.rotation(name)
                travel = moved.travel(name, body.center_of_mass)
                tensor = rotation @ body.inertia @ np.swapaxes(rotation, -1, -2)
                # forces and moments (n, 6, d) per acceleration of each motor
                weighed = np.concatenate([body.mass_kg * travel[:, :3], tensor @ travel[:, 3:]], 1)
                mass += np.swapaxes(travel, 1, 2) @ weighed
                weight += np.swapaxes(weighed[:, :3], 1, 2) @ gravity
                body_accelerations = rigid[:, 6 * number : 6 * number + 6, None]
                inertia += (np.swapaxes(weighed, 1, 2) @ body_accelerations)[..., 0]
                travels.append(travel)
            return MovedMachine(
                positions=moved.positions,
                speeds=moved.speeds,
                accelerations=moved.accelerations,
                bodies=np.concatenate(travels, axis=1),
                mass=mass,
                outputs=np.stack([self._move_output(each, moved) for each in outputs], axis=1),
                weight=weight,
                inertia=inertia,
            )

        return at

    def _move_output(self, channel: Channel, moved: _DriveMotion) -> FloatArray:
        """Return the motion ``(n, d)`` at an output per travel of each motor: of a tool point
        relative to its workpiece, of a sensor, or of an interface.
        """
        name, dof = channel
        sensor = self.parts.scene.machine.sensors.get(name)
        if sensor is not None:
            return self._move_sensor(sensor, dof, moved)
        point = self.parts.scene.machine.points.get(name)
        ends = [(JointEnd(*name.split(".", 1)), 1.0, NO_OFFSET)]
        if point is not None:
            at_tool = point.carrier is point.tool
            ends = [
                (point.tool, 1.0, point.offset if at_tool else NO_OFFSET),
                (point.work, -1.0, NO_OFFSET if at_tool else point.offset),
            ]
        total = np.zeros((*moved.positions.shape[:1], 6, moved.positions.shape[1]))
        for end, sign, offset in ends:
            if end.component in self.names and end.interface is not None:
                body = self.parts.superelements[end.component]
                local = body.interface_position(end.interface) + offset
                total += sign * moved.travel(end.component, local)
        return total[:, DOF_NAMES.index(dof)]

    def _move_sensor(self, sensor: Sensor, dof: str, moved: _DriveMotion) -> FloatArray:
        if sensor.component not in self.names:
            return np.zeros(moved.positions.shape)
        travel = moved.travel(sensor.component, np.array(sensor.position))
        direction = np.tile(sensor.directions[dof], (len(travel), 1))
        if not sensor.fixed_axes:
            direction = np.einsum("nij,nj->ni", moved.rotation(sensor.component), direction)
        return np.einsum("ni,nid->nd", direction, travel[:, :3])


@dataclass(frozen=True, eq=False)
class MechanismTrajectory(BodyTrajectory):
    """Describe a mechanism that moves its tool along a path at constant orientation.

    Attributes:
        path: Path of the tool point over the parameter.
        direction: Direction ``(3,)`` of the tool, machine frame.
        coriolis: Velocity terms act as well: the bodies rotate, unlike those of linear axes.
    """

    mechanism: SceneMechanism
    path: Curve
    direction: FloatArray
    pose_at: Callable[[float], Pose]
    coriolis: bool

    @functools.cached_property
    def _markers(self) -> dict[str, int]:
        """Number of the marker of each moving body."""
        markers = self.mechanism.mounted.mechanism.markers
        return {
            name: markers.index(marker)
            for name, marker in self.mechanism.carries.items()
            if name in self.parts.reduced
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies that the mechanism moves."""
        return tuple(self._markers)

    @property
    def turning(self) -> tuple[str, ...]:
        """All moving bodies where velocity terms act, else none."""
        return self.names if self.coriolis else ()

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of legs."""
        drives = self.parts.scene.drives.values()
        return tuple(drive for drive in drives if drive.axis in LENGTHS)

    def pose(self, where: float) -> Pose:
        """Return the pose at a value of the parameter."""
        return self.pose_at(where)

    def _follow(self, motion: PathMotion, *, velocity_terms: bool = True) -> MarkerMotion:
        return move_markers(
            self.mechanism.mounted,
            motion.positions,
            follow_curve(self.path, motion),
            self.direction,
            velocity_terms=velocity_terms,
        )

    def turn_rates(self, motion: PathMotion) -> dict[str, float]:
        """Return the largest rotation rates of bodies, where velocity terms act."""
        if not self.coriolis:
            return {}
        omega = self._follow(motion).omega
        return {
            name: float(np.linalg.norm(omega[:, marker], axis=1).max())
            for name, marker in self._markers.items()
        }

    def accelerate(self, motion: PathMotion) -> FloatArray:
        """Return the accelerations of bodies: of their centres of mass, and angular accelerations
        that include the gyroscopic moment of Euler's equations.

        Raises:
            PoseError: The mechanism cannot follow the path.
        """
        moved = self._follow(motion, velocity_terms=self.coriolis)
        turn, columns = self.mechanism.mounted.mounting.rotation, []
        for name, marker in self._markers.items():
            body = self.parts.superelements[name]
            placement = self.parts.plan.components[name].placement
            rotation = moved.rotations[:, marker]
            arm = rotation @ (placement.origin + placement.rotation @ body.center_of_mass)
            omega, alpha = moved.omega[:, marker], moved.alpha[:, marker]
            # gyroscopic moment of Euler's equations, as an angular acceleration
            axes = rotation @ placement.rotation
            inertia = axes @ body.inertia @ np.swapaxes(axes, -1, -2)
            moment = np.cross(omega, (inertia @ omega[..., None])[..., 0])
            spin = alpha + np.linalg.solve(inertia, moment[..., None])[..., 0]
            center = (
                moved.acceleration[:, marker]
                + np.cross(alpha, arm)
                + np.cross(omega, np.cross(omega, arm))
            )
            columns += [center @ turn.T, spin @ turn.T]
        return np.concatenate(columns, axis=1)

    @functools.cached_property
    def leg_forces(self) -> CachedFunction[PathMotion, FloatArray]:
        """Return the forces ``(n, d)`` between drives and screws that carry and accelerate the legs
        themselves during a motion.
        """
        return CachedFunction(self._find_leg_forces)

    def _find_leg_forces(self, motion: PathMotion) -> FloatArray:
        moved, accelerations = self._follow(motion), self.accelerate(motion)
        joints, gravity = self.parts.scene.machine.joints, gravity_vector(self.parts)
        screws = find_ball_screws(self.parts.scene.machine)
        forces = np.zeros((len(motion.positions), len(screws)))
        for number, (joint, _) in enumerate(screws.values()):
            leg = joints[joint].ends[0].component
            if leg not in self._markers:
                continue
            rotation = moved.rotations[:, self._markers[leg]]
            axis = joints[joint].rotation[:, 0]
            along = rotation @ axis @ self.mechanism.mounted.mounting.rotation.T
            first = 6 * self.names.index(leg)
            center = accelerations[:, first : first + 3]
            weight = self.parts.superelements[leg].mass_kg
            forces[:, number] = weight * ((center - gravity) * along).sum(axis=1)
        return forces

    def drive(self, drives: Sequence[Drive], motion: PathMotion) -> _DriveMotion:
        """Return the set points of leg motors and the motion they cause."""
        mounted, moved = self.mechanism.mounted, self._follow(motion)
        chains, turn = mounted.mechanism, mounted.mounting.rotation
        legs = [chains.driven.index(drive.axis) for drive in drives]
        kinematics = evaluate_kinematics(chains, moved.states)
        from_legs = velocity_maps(chains, kinematics.closure_jacobian)[0][..., legs]

        def travel(name: str, local: FloatArray) -> FloatArray:
            marker, placement = self._markers[name], self.parts.plan.components[name].placement
            arm = moved.rotations[:, marker] @ (placement.origin + placement.rotation @ local)
            turning = kinematics.of_rotation[:, marker] @ from_legs
            moving = kinematics.of_position[:, marker] @ from_legs - skew_matrices(arm) @ turning
            return np.concatenate([turn @ moving, turn @ turning], axis=1)

        def rotation(name: str) -> FloatArray:
            home = self.parts.plan.components[name].placement.rotation
            return turn @ moved.rotations[:, self._markers[name]] @ home

        driven = np.arange(chains.driven_slice.start, chains.driven_slice.stop)[legs]
        return _DriveMotion(
            positions=moved.states[:, driven],
            speeds=moved.rates[:, driven],
            accelerations=moved.growth[:, driven],
            rotation=rotation,
            travel=travel,
        )


def has_coriolis(state: RunState) -> bool:
    """Return True where velocity terms act, in a mechanism whose bodies rotate."""
    return CORIOLIS in state.scene.effects and state.scene.mechanism is not None


@dataclass(frozen=True, eq=False)
class RotaryTrajectory(BodyTrajectory):
    """Describe axes that move along a path of the machine, some of them rotary.

    A body at ``c(s)`` with the orientation ``R(s)`` has the acceleration ``c'' v^2 + c' a`` and the
    angular acceleration ``alpha = w' v^2 + w a``, ``[w] = R' R^T``: tangential (Euler), centripetal
    and Coriolis terms of all axes together. The gyroscopic moment ``w x I w v^2`` counts as further
    angular acceleration. Motors of linear axes are modelled; those of rotary axes are ideal.
    """

    path: MachinePath

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies that any axis moves."""
        moved = {name for axis in self.parts.scene.machine.axes.values() for name in axis.moves}
        return tuple(name for name in self.parts.superelements if name in moved)

    @functools.cached_property
    def rotation_speeds(self) -> dict[str, float]:
        """Largest rotation speed of each body on the rotary axes, per speed along the path."""
        axes, (start, end) = self.parts.scene.machine.axes, (self.path.start, self.path.end)
        shares = {
            axis: abs(end.positions.get(axis, 0.0) - start.positions.get(axis, 0.0))
            / self.path.length
            for axis in self.path.turning
        }
        names = dict.fromkeys(name for axis in shares for name in axes[axis].moves)
        return {
            name: sum(share for axis, share in shares.items() if name in axes[axis].moves)
            for name in names
        }

    @property
    def turning(self) -> tuple[str, ...]:
        """Names of the bodies on rotary axes."""
        return tuple(name for name in self.names if name in self.rotation_speeds)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Names of all drives."""
        return tuple(self.parts.scene.drives.values())

    def pose(self, where: float) -> Pose:
        """Return the pose at a position."""
        return self.path.pose_at(where)

    def turn_rates(self, motion: PathMotion) -> dict[str, float]:
        """Return the largest rotation rates of bodies."""
        fastest = float(np.abs(motion.speeds).max())
        return {name: fastest * speed for name, speed in self.rotation_speeds.items()}

    @functools.cached_property
    def _step(self) -> float:
        """Parameter step of the finite differences of frames."""
        return STEP / max(self.rotation_speeds.values())

    @functools.cached_property
    def _machine(self) -> Machine:
        return free_axes(self.parts.scene.machine)

    def place(
        self, position: float, further: Mapping[str, float] = MappingProxyType({})
    ) -> dict[str, Frame]:
        """Return the frames of all components at a position; the path is continued beyond its ends.

        Args:
            further: Travel of axes beyond that.
        """
        first, last = self.path.start.positions, self.path.end.positions
        share = position / self.path.length
        positions = {
            axis: first.get(axis, 0.0)
            + share * (last.get(axis, 0.0) - first.get(axis, 0.0))
            + further.get(axis, 0.0)
            for axis in {**first, **last, **further}
        }
        return place_components(self._machine, Pose("on the path", positions))

    def place_around(self, position: float) -> list[dict[str, Frame]]:
        """Return the frames at five positions, for central differences at the middle one."""
        return [self.place(position + self._step * side) for side in range(-2, 3)]

    def accelerate(self, motion: PathMotion) -> FloatArray:
        """Return the accelerations of bodies."""
        rows = []
        for position, speed, path_acceleration in zip(
            motion.positions, motion.speeds, motion.accelerations, strict=True
        ):
            around = self.place_around(float(position))
            rows.append(
                [
                    _accelerate_body(
                        self.parts.superelements[name],
                        [frames[name] for frames in around],
                        self._step,
                        float(speed),
                        float(path_acceleration),
                    )
                    for name in self.names
                ]
            )
        return np.array(rows).reshape(len(rows), -1)

    def drive(self, drives: Sequence[Drive], motion: PathMotion) -> _DriveMotion:
        """Return the set points of motors and the motion they cause."""
        first, last = (
            np.array([end.positions.get(drive.axis, 0.0) for drive in drives])
            for end in (self.path.start, self.path.end)
        )
        shares = (last - first) / self.path.length
        here = [self.place(float(position)) for position in motion.positions]
        axes = self.parts.scene.machine.axes
        turning = [axes[drive.axis].kind == "rotary" for drive in drives]
        apart = [
            [
                [self.place(float(position), {drive.axis: side * AWAY}) for side in (-1.0, 1.0)]
                for drive in drives
            ]
            for position in motion.positions
        ]

        def travel(name: str, point: FloatArray) -> FloatArray:
            # exact: a turn by -h and by h moves a point by 2 sin(h) times its motion per turn
            moving = np.zeros((len(apart), 6, len(drives)))
            for at, sides in enumerate(apart):
                for column, (back, ahead) in enumerate(sides):
                    first, last = back[name], ahead[name]
                    moved = last.origin - first.origin + (last.rotation - first.rotation) @ point
                    reach = 2.0 * (math.sin(AWAY) if turning[column] else AWAY)
                    moving[at, :3, column] = moved / reach
                    turned = _axial(last.rotation @ first.rotation.T) / math.sin(2.0 * AWAY)
                    moving[at, 3:, column] = turned if turning[column] else 0.0
            return moving

        return _DriveMotion(
            positions=first + motion.positions[:, None] * shares,
            speeds=motion.speeds[:, None] * shares,
            accelerations=motion.accelerations[:, None] * shares,
            rotation=lambda name: np.array([frames[name].rotation for frames in here]),
            travel=travel,
        )

    def feed(
        self, point: str, up: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the travel ``(n, 3)`` of a tool relative to its workpiece per travel along the
        path, and the direction ``(n, 3)`` of the tool axis, in machine axes, at positions.

        Args:
            up: Direction ``(3,)`` of the tool axis with all axes at zero.
        """
        machine, still = self.parts.scene.machine, Frame(np.zeros(3), np.eye(3))
        named = machine.points[point]
        tool, work, carrier = named.tool, named.work, named.carrier
        home = machine.components[tool.component].placement if tool.component else still
        local: FloatArray = np.asarray(named.offset)
        if carrier.component and carrier.interface:
            body = self.parts.superelements[carrier.component]
            local = body.interface_position(carrier.interface) + local
        travels, ups = [], []
        for position in positions:
            around = self.place_around(float(position))
            tools, works = (
                [still if end.component is None else frames[end.component] for frames in around]
                for end in (tool, work)
            )
            carriers = tools if tool.component else [works[2]] * len(works)
            # position of the tool in the axes of its workpiece
            points = np.array(
                [
                    base.rotation.T @ (frame.origin + frame.rotation @ local - base.origin)
                    for frame, base in zip(carriers, works, strict=True)
                ]
            )
            travels.append(works[2].rotation @ (FIRST @ points) / self._step)
            ups.append(tools[2].rotation @ home.rotation.T @ up)
        return np.array(travels), np.array(ups)


def _accelerate_body(
    body: Superelement, frames: list[Frame], step: float, speed: float, acceleration: float
) -> FloatArray:
    """Return the acceleration ``(6,)`` of a body in the middle of five frames of its path, of its
    centre of mass and about it.
    """
    turns = np.array([frame.rotation for frame in frames])
    centers = np.array([frame.origin + frame.rotation @ body.center_of_mass for frame in frames])
    turn, turned = turns[2], np.tensordot(FIRST, turns, 1) / step
    twice = np.tensordot(SECOND, turns, 1) / step**2
    omega = _axial(turned @ turn.T)
    alpha = _axial(twice @ turn.T) * speed**2 + omega * acceleration
    inertia = turn @ body.inertia @ turn.T
    moment = np.cross(omega, inertia @ omega) * speed**2
    # a point mass without inertia needs no moment
    spin = alpha + np.linalg.lstsq(inertia, moment)[0]
    center = (SECOND @ centers) / step**2 * speed**2 + (FIRST @ centers) / step * acceleration
    return np.concatenate([center, spin])


def _axial(matrix: FloatArray) -> FloatArray:
    """Return the axial vector of the antisymmetric part of a matrix."""
    odd = 0.5 * (matrix - matrix.T)
    return np.array([odd[2, 1], odd[0, 2], odd[1, 0]])
