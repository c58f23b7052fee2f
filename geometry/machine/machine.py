"""The machine: components, joints, points and axes, where everything is in a pose, and straight
moves between poses.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, compose_frames, rotation_about
from headstock.geometry.machine.guide_errors import AxisErrors
from headstock.geometry.machine.joints import Axis, Joint, JointEnd
from headstock.geometry.mechanisms.exechon import (
    TOOL_AXES,
    TOOL_POINT,
    ToolMechanism,
    place_carriers,
)
from headstock.geometry.parts.components import Component, Load, RayleighDamping, Support

# positions of axes as scenes write them: SI unit to factor and unit
SCENE_UNITS = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "deg")}
TURN_TOLERANCE = 1e-12
NO_OFFSET = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Point:
    """A named point at which results are wanted: the motion of ``tool`` relative to ``work``.

    Attributes:
        work: Interface of the workpiece, or ground.
        offset: Where the point is, from the origin of its ``carrier`` in the axes of that component
            [m]: a rigid extension without mass.
    """

    name: str
    tool: JointEnd
    work: JointEnd
    offset: tuple[float, float, float] = NO_OFFSET

    @property
    def carrier(self) -> JointEnd:
        """The end that the point moves with: the tool, or the work where the tool is ground."""
        return self.work if self.tool.component is None else self.tool


@dataclass(frozen=True)
class Probe:
    """A place on a component where displacement and stress under the static loads are wanted.

    Attributes:
        position: In the component's own frame [m].
    """

    name: str
    component: str
    position: tuple[float, float, float]


@dataclass(frozen=True)
class Sensor(Probe):
    """A place on a component whose motion is measured, where a force may act, and which may have mass.

    Attributes:
        directions: Dof (``x``, ``y``, ``z``) to the unit vector along which it is measured; what was
            not measured is left out. A point mass has none.
        fixed_axes: The vectors keep to the machine; otherwise they turn with the component.
        mass: Of what is mounted there [kg].
        reach: Largest distance from the component's surface [m]; beyond it the place is refused.
        is_loaded: A force or a point mass acts there, whose static response is to be exact.
    """

    directions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    fixed_axes: bool = True
    mass: float = 0.0
    reach: float = 1e-3
    is_loaded: bool = False

    def turn_directions(self, rotation: FloatArray) -> FloatArray:
        """Return the unit vectors ``(k, 3)`` of its dofs along machine axes.

        Args:
            rotation: ``(3, 3)`` of its component in the machine.
        """
        vectors: FloatArray = np.array(list(self.directions.values()), dtype=float).reshape(-1, 3)
        return vectors if self.fixed_axes else vectors @ rotation.T


@dataclass(frozen=True)
class JointDisplacement:
    """A displacement that a joint is given: its ground moves and takes along what is joined to it;
    without ground, its second end moves relative to the first.

    Attributes:
        motion: Translation of the joint's point and rotation about it, machine axes [m, rad].
    """

    name: str
    joint: str
    motion: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Pose:
    """Axis positions [m, rad] by axis name; axes not named stand at zero."""

    name: str
    positions: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Machine:
    """A machine as data, SI units, no numerics.

    Attributes:
        components: By name, placed at zero axis positions.
        axes: By name, in the order in which the scene lists them.
        gravity: Acceleration of gravity in the machine frame [m/s^2].
        gravity_stiffening: Whether small motions include the geometric stiffness due to gravity.
        base_motions: Acceleration of the ground by name of the load, machine axes [m/s^2].
        rayleigh: Viscous damping by mass and stiffness of everything, springs of joints included.
        sensors: Sensors and point masses by name.
        mechanism: The closed-loop mechanism that carries components, if any: their placements, and
            points and axes of joints whose leading end is one of them, are given in the frame of
            the marker that carries them.
    """

    name: str
    components: dict[str, Component]
    joints: dict[str, Joint] = field(default_factory=dict)
    points: dict[str, Point] = field(default_factory=dict)
    axes: dict[str, Axis] = field(default_factory=dict)
    supports: dict[str, Support] = field(default_factory=dict)
    loads: dict[str, Load] = field(default_factory=dict)
    displacements: dict[str, JointDisplacement] = field(default_factory=dict)
    base_motions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    probes: dict[str, Probe] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)
    gravity_stiffening: bool = False
    rayleigh: RayleighDamping = field(default_factory=RayleighDamping)
    mechanism: ToolMechanism | None = None


def place_components(machine: Machine, pose: Pose) -> dict[str, Frame]:
    """Return the frame of every component in the machine frame when the axes stand at a pose.

    Axes act in chains: an axis that carries another axis' base carries its direction with it, so
    axes are applied from the one that carries most components to the one that carries least. A
    mechanism closes its loops first.

    Raises:
        ValueError: The pose names an unknown axis or leaves an axis' limits.
        PoseError: The mechanism cannot take the pose.
    """
    mechanism = machine.mechanism
    for name, position in pose.positions.items():
        if mechanism is not None and name in TOOL_AXES:
            continue
        if name not in machine.axes:
            raise ValueError(
                f"pose {pose.name!r} names axis {name!r}; axes: {sorted(machine.axes)}"
            )
        low, high = machine.axes[name].limits
        if fault := find_limit_fault(
            name, position, low=low, high=high, unit=position_units(machine)[name]
        ):
            raise ValueError(f"pose {pose.name!r}: {fault}")
    frames = {name: component.placement for name, component in machine.components.items()}
    carriers = {} if mechanism is None else place_carriers(mechanism, pose.positions)
    frames |= {
        name: compose_frames(carrier, frames[name])
        for name, carrier in carriers.items()
        if name in frames
    }
    # innermost first: a motion given at zero position is then carried along by the motions of the
    # axes below it
    for axis in sorted(machine.axes.values(), key=lambda axis: len(axis.moves)):
        motion = axis_motion(axis, pose.positions.get(axis.name, 0.0))
        for name in axis.moves:
            frames[name] = compose_frames(motion, frames[name])
    return frames


class _Axis(Protocol):
    @property
    def kind(self) -> str: ...


class _Axes(Protocol):
    """A machine, or the scene it is built of."""

    @property
    def axes(self) -> Mapping[str, _Axis]: ...
    @property
    def mechanism(self) -> object: ...


def position_units(machine: _Axes) -> dict[str, str]:
    """Return the unit of each axis's position, ``m`` or ``rad``; those of the tool, too, where a
    mechanism carries it.
    """
    units = {name: "m" if axis.kind == "linear" else "rad" for name, axis in machine.axes.items()}
    if machine.mechanism is not None:
        units |= {name: "m" if name in TOOL_POINT else "rad" for name in TOOL_AXES}
    return units


def show_position(position: float, unit: str = "m") -> str:
    """Return a length or position as scenes write it: ``30 mm``, ``12.5 deg``; ``unit`` is ``m`` or
    ``rad``.
    """
    factor, word = SCENE_UNITS[unit]
    return f"{round(factor * position, 9) + 0.0:g} {word}"


def find_limit_fault(axis: str, position: float, *, low: float, high: float, unit: str) -> str:
    """Find why an axis cannot stand at a position; empty where it can.

    Args:
        position: Where it is to stand [m, rad].
        low: Lowest position [m, rad].
        high: Highest position [m, rad].
        unit: ``m`` or ``rad``.
    """
    if low <= position <= high:
        return ""
    places = [show_position(value, unit) for value in (position, low, high)]
    return f"{places[0]} is outside the limits of axis {axis}: {places[1]} to {places[2]}"


def axis_motion(axis: Axis, position: float) -> Frame:
    """Return the rigid motion of an axis from zero to a position, as a frame in the machine
    frame.
    """
    if axis.kind == "linear":
        return Frame(position * axis.direction)
    rotation = rotation_about(axis.direction, position)
    return Frame(axis.center - rotation @ axis.center, rotation)


def free_axes(machine: Machine) -> Machine:
    """Return the same machine with axes that have no limits."""
    axes = {
        name: dataclasses.replace(axis, limits=(-math.inf, math.inf))
        for name, axis in machine.axes.items()
    }
    return dataclasses.replace(machine, axes=axes)


def orient_machine(machine: Machine, frame: Frame) -> Machine:
    """Return the same machine set up in another orientation and place: every frame, axis and joint
    is carried along; gravity is not.
    """
    rotation = frame.rotation

    def carry_point(point: FloatArray) -> FloatArray:
        return frame.origin + rotation @ point

    def carry_vectors[Numbers: tuple[float, ...]](numbers: Numbers) -> Numbers:
        vectors = np.reshape(numbers, (-1, 3)) @ rotation.T
        return cast(Numbers, tuple(vectors.ravel().tolist()))

    components = {
        name: dataclasses.replace(component, placement=compose_frames(frame, component.placement))
        for name, component in machine.components.items()
    }
    joints = {
        name: dataclasses.replace(
            joint,
            rotation=rotation @ joint.rotation,
            second_axis=None if joint.second_axis is None else rotation @ joint.second_axis,
            point=None if joint.point is None else carry_point(joint.point),
            errors=None
            if joint.errors is None
            else dataclasses.replace(joint.errors, origin=carry_point(joint.errors.origin)),
        )
        for name, joint in machine.joints.items()
    }
    axes = {
        name: dataclasses.replace(
            axis,
            direction=rotation @ axis.direction,
            center=carry_point(axis.center),
            errors=None if axis.errors is None else _orient_errors(axis.errors, frame),
        )
        for name, axis in machine.axes.items()
    }
    loads = {
        name: dataclasses.replace(load, vector=carry_vectors(load.vector))
        for name, load in machine.loads.items()
    }
    displacements = {
        name: dataclasses.replace(given, motion=carry_vectors(given.motion))
        for name, given in machine.displacements.items()
    }
    return dataclasses.replace(
        machine,
        components=components,
        joints=joints,
        axes=axes,
        loads=loads,
        displacements=displacements,
        base_motions={name: carry_vectors(given) for name, given in machine.base_motions.items()},
    )


def _orient_errors(errors: AxisErrors, frame: Frame) -> AxisErrors:
    return dataclasses.replace(
        errors,
        point=None if errors.point is None else frame.origin + frame.rotation @ errors.point,
        rotation=frame.rotation @ errors.rotation,
    )


@dataclass(frozen=True)
class MachinePath:
    """Axis positions at both ends of a move in which every axis has a constant share; axes not named
    stand at zero.

    Attributes:
        rotary: Axes whose positions are angles.
    """

    start: Pose
    end: Pose
    rotary: frozenset[str] = frozenset()

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that move."""
        names = dict.fromkeys((*self.start.positions, *self.end.positions))
        return tuple(
            name
            for name in names
            if self.start.positions.get(name, 0.0) != self.end.positions.get(name, 0.0)
        )

    @property
    def turning(self) -> tuple[str, ...]:
        """Names of the rotary axes that move."""
        return tuple(name for name in self.axes if name in self.rotary)

    @property
    def unit(self) -> str:
        """Of places along it: ``m`` where a linear axis moves, else ``rad``."""
        return "rad" if self.turning and len(self.turning) == len(self.axes) else "m"

    @property
    def length(self) -> float:
        """Length of the path in the space of the linear axes [m], or of the rotary ones where no
        linear axis moves [rad].

        Source: Kramer, Proctor and Messina (2000), The NIST RS274/NGC interpreter, section 2.1.2.5,
        for the feed rate along it.
        """
        steps = [
            self.end.positions.get(name, 0.0) - self.start.positions.get(name, 0.0)
            for name in self.axes
            if self.unit == "rad" or name not in self.rotary
        ]
        return float(np.linalg.norm(steps))

    def pose_at(self, position: float) -> Pose:
        """Return the pose after a length of the path [m]."""
        share = position / self.length
        names = dict.fromkeys((*self.start.positions, *self.end.positions))
        places = {}
        for name in names:
            first, last = self.start.positions.get(name, 0.0), self.end.positions.get(name, 0.0)
            # the ends exactly, so that roundoff never leaves an axis' range
            places[name] = last if share >= 1.0 else (1.0 - share) * first + share * last
        return Pose(f"{show_position(position, self.unit)} along the path", places)


def travel_directions(machine: Machine, path: MachinePath) -> dict[str, FloatArray]:
    """Return the velocity ``(3,)`` of every component that moves, machine frame, per unit speed
    along the path.

    Raises:
        ValueError: A component turns along the path, or an end lies outside an axis' limits.
    """
    before, after = place_components(machine, path.start), place_components(machine, path.end)
    velocities = {}
    for name, frame in after.items():
        if np.abs(frame.rotation - before[name].rotation).max() > TURN_TOLERANCE:
            raise ValueError(
                f"component {name!r} turns between both ends of the path, so it has no one direction"
            )
        step = frame.origin - before[name].origin
        if step.any():
            velocities[name] = np.asarray(step / path.length)
    return velocities
