"""The drives of a coupled machine in its pose: their rows in the machine's coordinates, and the
machine with free motors.
"""

import dataclasses
import math
from collections.abc import Iterable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import motion_rows
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.solvers.control.drive_trains import DriveTrain, count_coordinates, free_motors
from headstock.solvers.errors import ModelError


def place_drives(
    coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]
) -> tuple[DriveTrain, ...]:
    """Every drive in the pose in which a machine is coupled.

    Args:
        coupled: The machine coupled in a pose.
        machine: The same machine as described, with joints and axes.
        drives: Each names its joint and its controller.

    Raises:
        ModelError: A drive's joint holds or frees its axial motion, so that no screw is there to
            drive.
    """
    springs = {spring.name: spring for spring in coupled.joint_springs}
    return tuple(_place_drive(coupled, machine, drive, springs[drive.joint]) for drive in drives)


def release_motors(coupled: CoupledMachine, trains: tuple[DriveTrain, ...]) -> CoupledMachine:
    """The same machine with its motors let go; a drive's joint then stretches by the nut's motion
    less the motor's.
    """
    size = len(coupled.system.mass)
    counts = [count_coordinates(train) for train in trains]
    added = sum(counts)
    springs = {spring.name: _pad_spring(spring, added) for spring in coupled.joint_springs}
    ends = np.cumsum(counts) - 1
    for train, last in zip(trains, ends, strict=True):
        spring = springs[train.joint]
        rows = spring.rows.copy()
        rows[0, size + last] = -np.sign(_thread_row(spring)[:size] @ train.stretch)
        springs[train.joint] = dataclasses.replace(spring, rows=rows)
    return dataclasses.replace(
        coupled,
        system=free_motors(coupled.system, trains),
        basis=np.hstack([coupled.basis, np.zeros((len(coupled.basis), added))]),
        joint_springs=tuple(springs.values()),
        loads={
            name: np.concatenate([load, np.zeros(added)]) for name, load in coupled.loads.items()
        },
        errors=None,
    )


def _place_drive(
    coupled: CoupledMachine, machine: Machine, drive: Drive, spring: PlacedJoint
) -> DriveTrain:
    joint, axis = machine.joints[drive.joint], machine.axes[drive.axis]
    stiffness = float(spring.stiffness[0, 0])
    if 0 in spring.fixed or not stiffness > 0.0:
        raise ModelError(
            f"drive {drive.name}: its joint {drive.joint} has no axial stiffness through which a motor could push; "
            'write stiffness = { axial = "100 N/um" }'
        )
    sign = _travel_sign(joint, axis.moves, float(spring.frame.rotation[:, 0] @ axis.direction))
    pitch = drive.lead / (2.0 * math.pi)
    housing = motion_rows(coupled.layout, joint.ends[1], spring.frame.origin)[3:]
    slide = sign * spring.rows[0]
    # a coupling of the joint's own is part of its stiffness already
    own = math.inf if joint.screw is None else joint.screw.coupling
    return DriveTrain(
        name=drive.name,
        axis=drive.axis,
        joint=drive.joint,
        control=dataclasses.replace(
            drive.control,
            acceleration_feed_forward=drive.acceleration_share
            * _axis_inertia(coupled, drive, axis.moves, pitch),
        ),
        stretch=sign * _thread_row(spring),
        stiffness=stiffness,
        thread=1.0 / (1.0 / stiffness - (pitch**2 / own if math.isfinite(own) else 0.0)),
        slide=slide,
        scale=slide
        if drive.scale is None
        else _scale_row(coupled, machine, drive.scale, drive.axis),
        stator=sign * pitch * (spring.frame.rotation[:, 0] @ housing @ coupled.basis),
        motor_mass=drive.motor_inertia / pitch**2,
        damping=float(joint.damping[0, 0]),
        beta=machine.rayleigh.beta,
        loss=joint.loss_factor * stiffness,
        screw_mass=drive.screw_inertia / pitch**2,
        coupling=min(own, drive.coupling) / pitch**2,
        friction=drive.friction,
        cycle=drive.cycle,
    )


def _thread_row(spring: PlacedJoint) -> FloatArray:
    """Motion that stretches a screw: along it, less what turns of the nut do along the thread."""
    return np.asarray(spring.stiffness[0] / spring.stiffness[0, 0] @ spring.rows)


def _travel_sign(joint: Joint, moves: tuple[str, ...], along: float) -> float:
    """Sign that turns the relative motion of the joint's ends, second less first, into travel of
    the axis.
    """
    second_moves = joint.ends[1].component in moves
    return float(np.sign(along)) * (1.0 if second_moves else -1.0)


def _axis_inertia(
    coupled: CoupledMachine, drive: Drive, moves: tuple[str, ...], pitch: float
) -> float:
    """What the motor accelerates [kg]: everything the axis carries, its own inertia and the
    screw's.
    """
    carried = sum(coupled.layout.superelements[name].mass_kg for name in moves)
    return carried + (drive.motor_inertia + drive.screw_inertia) / pitch**2


def _scale_row(coupled: CoupledMachine, machine: Machine, point: str, axis: str) -> FloatArray:
    """Motion along an axis at a point; where the axis carries the work, its travel is that of work
    against tool.
    """
    direction = machine.axes[axis].direction
    row = sum(
        (float(direction[i]) * coupled.system.outputs[point, name] for i, name in enumerate("xyz")),
        np.zeros(1),
    )
    carries_tool = machine.points[point].tool.component in machine.axes[axis].moves
    return np.asarray(row if carries_tool else -row)


def _pad_spring(spring: PlacedJoint, added: int) -> PlacedJoint:
    return dataclasses.replace(spring, rows=np.hstack([spring.rows, np.zeros((6, added))]))
