"""Motors and screws as coordinates of their own: a machine whose axes are free to move, pushed by
drive forces.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import AxisControl, GuideFriction
from headstock.solvers.second_order import ANGLES, Channel, SecondOrderSystem

FORCE, MOTOR, SCALE, SLIDE = "force", "motor", "scale", "slide"
COMMAND = "command"  # a set point of an axis with its speed and acceleration
COMMANDS = (COMMAND, "command_angle")
DRIVE_CHANNELS = (FORCE, MOTOR, SCALE, COMMAND, *ANGLES)  # in place of a direction, in responses
# channels of rotary axes in frequency responses, named by their units
ROTARY_CHANNELS = dict(zip(ANGLES, (FORCE, MOTOR, SCALE, COMMAND), strict=True))


@dataclass(frozen=True, eq=False)
class DriveTrain:
    """A drive in a pose. Every turn is expressed along the axis: motor angle times lead / (2 pi).

    Attributes:
        row: Dof of the joint along the travel, 3 and above of a rotary axis, whose forces are torques,
            travels angles [rad] and masses inertias.
        name: Name of the drive; its channels are ``(name, "force")``, ``(name, "motor")``, ``(name,
            "scale")``, ``(name, "slide")``.
        stretch: ``(n,)`` motion of the nut along the axis, as the thread sees it, with the motor
            locked.
        stiffness: Of that, as it is in the system with the motor locked [N/m]; infinite where the
            motor moves the nut without any compliance: the system is then one in which the nut is
            free to move.
        thread: The same without the coupling, where that has a part in it [N/m].
        slide: ``(n,)`` motion along the axis across the guide; also what the joint's damper sees.
        scale: ``(n,)`` motion that the linear scale reads.
        stator: ``(n,)`` turn of the motor's housing about the screw.
        motor_mass: Motor inertia over the square of lead / (2 pi) [kg].
        damping: Of the joint along the axis [N s/m].
        loss: Imaginary part of the joint's complex stiffness [N/m].
        beta: Viscous damping over stiffness of its springs [s].
        screw_mass: Screw inertia likewise [kg].
        coupling: Stiffness between motor and screw likewise [N/m]; infinite where it is rigid.
    """

    name: str
    axis: str
    joint: str
    control: AxisControl
    stretch: FloatArray
    stiffness: float
    thread: float
    slide: FloatArray
    scale: FloatArray
    stator: FloatArray
    motor_mass: float
    damping: float = 0.0
    loss: float = 0.0
    beta: float = 0.0
    anchor: float = 0.0
    screw_mass: float = 0.0
    coupling: float = math.inf
    friction: GuideFriction | None = None
    row: int = 0

    @property
    def rotary(self) -> bool:
        """Return whether its axis turns."""
        return self.row >= 3


def free_motors(system: SecondOrderSystem, trains: Sequence[DriveTrain]) -> SecondOrderSystem:
    """The system with the motors let go: a coordinate for each motor, and one for each screw that
    turns by itself.

    A coordinate is the relative turn of rotor and housing, so that a drive force on it is a torque
    between both. A screw turns by itself where its inertia counts and its coupling gives way; a
    coupling without such a screw is in series with the thread. A motor that moves the nut without
    any compliance has no coordinate of its own: it turns as the nut moves.

    Args:
        system: Symmetric, with the springs of the drives in it as they are with the motors locked.
        trains: One for each motor; rows as long as the system.

    Source: Altintas, Verl, Brecher, Uriarte and Pritschow (2011), section 3.
    """
    total = len(system.mass) + sum(map(count_coordinates, trains))
    mass, stiffness = _pad(system.mass, total), _pad(system.stiffness, total)
    damping = None if system.damping is None else _pad(system.damping, total)
    hysteretic = None if system.hysteretic is None else _pad(system.hysteretic, total)
    inputs = {channel: _pad(row, total) for channel, row in system.inputs.items()}
    outputs = {channel: _pad(row, total) for channel, row in system.outputs.items()}
    labels = list(system.labels)
    for train, turns in zip(trains, find_turns(trains, total), strict=True):
        motor, screw = turns.motor, turns.screw
        stretch, stator = _pad(train.stretch, total), _pad(train.stator, total)
        slide, scale = _pad(train.slide, total), _pad(train.scale, total)
        freed = np.zeros((total, total))
        if turns.apart:
            freed += train.coupling * np.outer(motor - screw, motor - screw)
        if not is_rigid(train):
            locked, spring = train.stiffness, thread_stiffness(train)
            freed += _join(stretch, screw, spring) + (spring - locked) * np.outer(stretch, stretch)
            if damping is not None:
                damping += _join(slide, screw, train.damping)
            if hysteretic is not None:
                loss = train.loss * spring / locked
                hysteretic += _join(stretch, screw, loss)
                hysteretic += (loss - train.loss) * np.outer(stretch, stretch)
        stiffness += freed + train.anchor * np.outer(motor, motor)
        if damping is not None:
            damping += train.beta * freed
        mass += train.motor_mass * np.outer(motor + stator, motor + stator)
        if train.screw_mass:
            mass += train.screw_mass * np.outer(screw + stator, screw + stator)
        inputs |= {(train.name, FORCE): motor, (train.name, SLIDE): slide}
        outputs |= {
            (train.name, MOTOR): motor,
            (train.name, SCALE): scale,
            (train.name, SLIDE): slide,
        }
        labels += [f"{train.name} motor", f"{train.name} screw"][: count_coordinates(train)]
    return SecondOrderSystem(mass, damping, stiffness, inputs, outputs, tuple(labels), hysteretic)


class Turns(NamedTuple):
    """How motor and screw of a drive turn against the motor's housing, as travel along the axis.

    Attributes:
        motor: ``(n,)``.
        screw: ``(n,)``.
        apart: Whether a coupling lets both turn by themselves.
    """

    motor: FloatArray
    screw: FloatArray
    apart: bool


def find_turns(trains: Sequence[DriveTrain], total: int) -> list[Turns]:
    """Turns of every drive in a system with free motors.

    Args:
        trains: As the motors were let go.
        total: Coordinates ``n`` of that system, those of motors and screws at its end.
    """
    turns = []
    start = total - sum(map(count_coordinates, trains))
    for train in trains:
        count = count_coordinates(train)
        coordinates = [*np.eye(total)[start : start + count]]
        if is_rigid(train):
            coordinates.append(_pad(train.slide, total))
        turns.append(Turns(coordinates[0], coordinates[-1], len(coordinates) == 2))
        start += count
    return turns


def measured_channel(train: DriveTrain) -> Channel:
    """Return what the position controller of a drive measures."""
    return train.name, train.control.encoder


def is_rigid(train: DriveTrain) -> bool:
    """Return whether the nut follows the screw without any compliance."""
    return math.isinf(train.stiffness)


def count_coordinates(train: DriveTrain) -> int:
    """Count the coordinates that a drive brings."""
    if is_rigid(train):
        return 1 if math.isfinite(train.coupling) else 0
    return 2 if _turns_alone(train) else 1


def _turns_alone(train: DriveTrain) -> bool:
    return train.screw_mass > 0.0 and math.isfinite(train.coupling)


def thread_stiffness(train: DriveTrain) -> float:
    """Between the nut and what turns the thread: a coupling without a screw is in series."""
    if _turns_alone(train) or not math.isfinite(train.coupling):
        return train.thread
    return 1.0 / (1.0 / train.thread + 1.0 / train.coupling)


def _join(row: FloatArray, coordinate: FloatArray, stiffness: float) -> FloatArray:
    """What ``k (row q)^2`` lacks of ``k (row q - x)^2``."""
    cross = np.outer(row, coordinate)
    return stiffness * (np.outer(coordinate, coordinate) - cross - cross.T)


def _pad(values: FloatArray, total: int) -> FloatArray:
    """Return a row or a square matrix with zeros for further coordinates."""
    return np.pad(values, (0, total - len(values)))
