"""The drives of a coupled machine in its pose: their rows in the machine's coordinates, and the
machine with free motors.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.drives import AxisControl, Drive
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.geometry.mechanisms.exechon import LENGTHS, ToolMechanism
from headstock.reduction.coupling.channels import point_rows
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import DofLayout, motion_rows
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.solvers.control.drive_trains import (
    MOTOR,
    DriveTrain,
    count_coordinates,
    free_motors,
    is_rigid,
    thread_stiffness,
)
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import SecondOrderSystem

ANCHOR = 100.0  # stiffness of anchored motors over the weight of the machine [1/m]
ALONG = 1e-9  # how far an axis of a joint may be off its leg


class StackedJoints(NamedTuple):
    """Where the bodies and joints of a machine stand in a pose, rows those of the ``n_all`` stacked
    dofs.
    """

    layout: DofLayout
    springs: Mapping[str, PlacedJoint]


def _stack(coupled: CoupledMachine) -> StackedJoints:
    return StackedJoints(coupled.layout, {spring.name: spring for spring in coupled.fixed.springs})


def place_drives(
    coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]
) -> tuple[DriveTrain, ...]:
    """Return every drive in the pose in which a machine is coupled.

    Args:
        coupled: The machine coupled in a pose; legs that a motor moves without compliance are free
            to slide (:func:`free_legs`).
        machine: The same machine as described, with joints and axes.
        drives: Each names its joint and its controller.

    Raises:
        ModelError: A drive's joint holds or frees its axial motion, so that no screw is there to
            drive.
    """
    springs, placed = {spring.name: spring for spring in coupled.joint_springs}, _stack(coupled)
    drives = tuple(drives)
    stacked = [_find_slide(placed, machine, drive) for drive in drives]
    slides = [
        dataclasses.replace(
            slide, motion=slide.motion @ coupled.basis, scale=slide.scale @ coupled.basis
        )
        for slide in stacked
    ]
    masses = _moved_masses(coupled, machine, drives, slides)
    return tuple(
        _place_drive(
            machine,
            drive,
            springs[drive.joint],
            slide=slide,
            stator=_stator_row(placed, slide, drive) @ coupled.basis,
            moved_mass=mass,
        )
        for drive, slide, mass in zip(drives, slides, masses, strict=True)
    )


def stack_drives(
    placed: StackedJoints, machine: Machine, drives: Iterable[Drive]
) -> tuple[DriveTrain, ...]:
    """Return every drive in a pose, its rows those of the ``n_all`` stacked dofs; without what its
    motor accelerates. See ``place_drives``.
    """
    slides = ((drive, _find_slide(placed, machine, drive)) for drive in drives)
    return tuple(
        _place_drive(
            machine,
            drive,
            placed.springs[drive.joint],
            slide=slide,
            stator=_stator_row(placed, slide, drive),
            moved_mass=0.0,
        )
        for drive, slide in slides
    )


def find_linear_scales(
    coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]
) -> list[FloatArray]:
    """Find what the linear scale of each drive reads with locked motors ``(n,)``."""
    return list(scale_rows(coupled, machine, drives) @ coupled.basis)


def scale_rows(coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]) -> FloatArray:
    """Return the same as rows ``(d, n_all)`` of the stacked dofs."""
    placed = _stack(coupled)
    rows = [_find_slide(placed, machine, drive).scale for drive in drives]
    return np.array(rows).reshape(len(rows), coupled.layout.size)


def housing_rows(coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]) -> FloatArray:
    """Return the rows ``(d, n_all)`` of the stacked dofs of how the housings of the motors of axes
    turn about their screws, as travel.

    Args:
        drives: ``d`` of axes.
    """
    placed, rows = _stack(coupled), []
    for drive in drives:
        joint, spring = machine.joints[drive.joint], placed.springs[drive.joint]
        axis, slide = machine.axes[drive.axis], _find_slide(placed, machine, drive)
        along = spring.frame.rotation[:, slide.row % 3]
        sign = _travel_sign(joint, axis.moves, float(along @ axis.direction))
        turned = motion_rows(coupled.layout, joint.ends[1], spring.frame.origin)[3:]
        rows.append(sign * drive.lead / (2.0 * math.pi) * (along @ turned))
    return np.array(rows).reshape(len(rows), coupled.layout.size)


def free_driven(coupled: CoupledMachine, machine: Machine, drives: Iterable[Drive]) -> Machine:
    """Return a machine in which legs of its mechanism slide and rotary axes turn freely where a drive
    holds them rigidly.

    Raises:
        ModelError: A joint neither holds its leg along itself nor is a ball screw.
    """
    joints = dict(machine.joints)
    for drive in drives:
        joint = joints[drive.joint]
        if joint.kind == "ball_screw":
            continue
        slide = _find_slide(_stack(coupled), machine, drive)
        if slide.row not in joint.fixed:
            if drive.axis in machine.axes:
                continue
            raise ModelError(
                f"drive {drive.name}: its joint {drive.joint} neither holds the leg along itself nor is a ball screw; "
                f'write "rigid" for {DOF_NAMES[slide.row]}, or drive a joint of kind = "ball_screw"'
            )
        joints[drive.joint] = dataclasses.replace(
            joint, fixed=tuple(row for row in joint.fixed if row != slide.row)
        )
    return dataclasses.replace(machine, joints=joints)


def release_motors(coupled: CoupledMachine, trains: tuple[DriveTrain, ...]) -> CoupledMachine:
    """Return the same machine with its motors unlocked; a drive's joint then stretches by the nut's
    motion less the motor's, or the screw's where that turns by itself, and is as stiff as the
    thread.
    """
    springs = {spring.name: spring for spring in coupled.joint_springs}
    added = sum(map(count_coordinates, trains))
    return dataclasses.replace(
        coupled,
        system=free_motors(coupled.system, trains),
        basis=np.hstack([coupled.basis, np.zeros((len(coupled.basis), added))]),
        joint_springs=tuple(release_springs(springs, trains).values()),
        loads={
            name: np.concatenate([load, np.zeros(added)]) for name, load in coupled.loads.items()
        },
        errors=None,
        displaced=None,
    )


def release_springs(
    springs: Mapping[str, PlacedJoint], trains: Sequence[DriveTrain]
) -> dict[str, PlacedJoint]:
    """Return joints whose rows have the coordinates of unlocked motors behind their own; see
    ``release_motors``.
    """
    counts = [count_coordinates(train) for train in trains]
    released = {
        name: dataclasses.replace(spring, rows=np.pad(spring.rows, ((0, 0), (0, sum(counts)))))
        for name, spring in springs.items()
    }
    ends = np.cumsum(counts) - 1
    for train, last in zip(trains, ends, strict=True):
        if is_rigid(train):
            continue
        spring, size = springs[train.joint], len(train.stretch)
        rows, row = released[train.joint].rows.copy(), train.row
        rows[row, size + last] = -np.sign(_thread_row(spring, row) @ train.stretch)
        thread = spring.stiffness[row] / spring.stiffness[row, row]
        stiffer = (thread_stiffness(train) - train.stiffness) * np.outer(thread, thread)
        released[train.joint] = dataclasses.replace(
            spring,
            rows=rows,
            stiffness=spring.stiffness + stiffer,
            damping=spring.damping + train.beta * stiffer,
        )
    return released


def make_rigid_train(
    drive: Drive,
    *,
    slide: FloatArray,
    scale: FloatArray,
    stator: FloatArray,
    moved_mass: float,
    beta: float = 0.0,
) -> DriveTrain:
    """Return a drive whose motor moves what it drives without any compliance, but for its coupling.

    Args:
        slide: ``(n,)`` motion that it drives, free in the system.
        scale: ``(n,)`` what its linear scale reads.
        stator: ``(n,)`` turn of the motor's housing as travel.
        moved_mass: What the motor accelerates apart from itself and its screw [kg].
        beta: Viscous damping over stiffness of its coupling [s].
    """
    pitch = drive.lead / (2.0 * math.pi)
    return DriveTrain(
        name=drive.name,
        axis=drive.axis,
        joint=drive.joint,
        control=_feed_inertia(drive, moved_mass),
        stretch=slide,
        stiffness=math.inf,
        thread=math.inf,
        slide=slide,
        scale=scale,
        stator=stator,
        motor_mass=drive.motor_inertia / pitch**2,
        screw_mass=drive.screw_inertia / pitch**2,
        coupling=drive.coupling / pitch**2,
        friction=drive.friction,
        beta=beta,
    )


def anchor_motors(
    trains: Iterable[DriveTrain], masses: Iterable[float], gravity: Iterable[float]
) -> tuple[DriveTrain, ...]:
    """Return the drives whose motors are anchored while their loops are open, so that a machine
    whose weight counts in its stiffness does not fall.

    Args:
        masses: Of all bodies [kg].
        gravity: ``(3,)`` [m/s^2].
    """
    spring = ANCHOR * sum(masses) * math.hypot(*gravity)
    return tuple(dataclasses.replace(train, anchor=spring) for train in trains)


def find_weight_stiffness(
    system: SecondOrderSystem, trains: Iterable[DriveTrain], geometric: FloatArray
) -> FloatArray:
    """Find what weight and the anchors of motors add to a stiffness ``(n, n)`` [N/m].

    Args:
        system: From ``free_motors``, with anchors.
        geometric: ``(k, k)`` geometric stiffness in its first coordinates.
    """
    stiffness = np.zeros_like(system.stiffness)
    stiffness[: len(geometric), : len(geometric)] = geometric
    for train in trains:
        motor = system.outputs[train.name, MOTOR]
        stiffness += train.anchor * np.outer(motor, motor)
    return stiffness


def find_moved_mass(system: SecondOrderSystem, slides: FloatArray) -> FloatArray:
    """Find what each of several free motions accelerates [kg] ``(d,)`` while the others are locked
    and the machine follows as its springs ask.

    Args:
        system: In which these motions are free.
        slides: ``(d, n)`` motions.
    """
    count, size = slides.shape
    level = float(np.abs(system.stiffness).max()) or 1.0
    whole = np.zeros((size + count, size + count))
    whole[:size, :size] = system.stiffness
    whole[size:, :size], whole[:size, size:] = level * slides, level * slides.T
    right = np.zeros((size + count, count))
    right[size:] = level * np.eye(count)
    moved = np.linalg.solve(whole, right)[:size]
    return np.einsum("ik,ij,jk->k", moved, system.mass, moved)


@dataclass(frozen=True, eq=False)
class _Slide:
    """Motion of a drive across its joint, in the stacked dofs of the components or the machine's
    own coordinates.

    Attributes:
        row: Dof of the joint along the travel.
        sign: Turns the relative motion of the joint's ends, second less first, into travel.
        motion: ``(n,)`` travel.
        scale: ``(n,)`` what a linear scale reads of it.
        housing: End that carries the motor.
        thread: Sign of a turn of the housing about the joint's axis as travel; threads are
            right-handed.
    """

    row: int
    sign: float
    motion: FloatArray
    scale: FloatArray
    housing: JointEnd
    thread: float

    @property
    def turns(self) -> bool:
        """Return whether it is one of a rotary axis."""
        return self.row >= 3


def _moved_masses(
    coupled: CoupledMachine, machine: Machine, drives: Sequence[Drive], slides: Sequence[_Slide]
) -> list[float]:
    """Return what each motor accelerates apart from itself and its screw [kg, kg m^2]: all a linear
    axis carries, or what moves with a leg or turns with a rotary axis.
    """
    carried = coupled.layout.superelements
    linear = [
        drive.axis in machine.axes and not slide.turns
        for drive, slide in zip(drives, slides, strict=True)
    ]
    others = [
        slide.motion for slide, slides_along in zip(slides, linear, strict=True) if not slides_along
    ]
    of_others = iter(find_moved_mass(coupled.system, np.array(others)) if others else ())
    return [
        sum(carried[name].mass_kg for name in machine.axes[drive.axis].moves)
        if slides_along
        else float(next(of_others))
        for drive, slides_along in zip(drives, linear, strict=True)
    ]


def _stator_row(placed: StackedJoints, slide: _Slide, drive: Drive) -> FloatArray:
    """Return the turn ``(n_all,)`` of a motor's housing as travel."""
    frame = placed.springs[drive.joint].frame
    turned = motion_rows(placed.layout, slide.housing, frame.origin)[3:]
    pitch = drive.lead / (2.0 * math.pi)
    return slide.thread * pitch * (frame.rotation[:, slide.row % 3] @ turned)


def _place_drive(
    machine: Machine,
    drive: Drive,
    spring: PlacedJoint,
    *,
    slide: _Slide,
    stator: FloatArray,
    moved_mass: float,
) -> DriveTrain:
    joint = machine.joints[drive.joint]
    pitch = drive.lead / (2.0 * math.pi)
    rigid = make_rigid_train(
        drive,
        slide=slide.motion,
        scale=slide.scale,
        stator=stator,
        moved_mass=moved_mass,
        beta=machine.rayleigh.beta,
    )
    rigid = dataclasses.replace(rigid, row=slide.row)
    if joint.kind != "ball_screw" and not slide.turns:
        return rigid
    row, stiffness = slide.row, float(spring.stiffness[slide.row, slide.row])
    if slide.turns and row not in spring.fixed and stiffness == 0.0:
        return rigid
    if row in spring.fixed or not stiffness > 0.0:
        raise ModelError(
            f"drive {drive.name}: its joint {drive.joint} has no axial stiffness through which a motor could push; "
            'write stiffness = { axial = "100 N/um" }'
        )
    # a coupling of the joint's own is part of its stiffness already
    coupling = math.inf if joint.screw is None else joint.screw.coupling
    return dataclasses.replace(
        rigid,
        stretch=slide.sign * _thread_row(spring, row),
        stiffness=stiffness,
        thread=1.0 / (1.0 / stiffness - pitch**2 / coupling),
        damping=float(joint.damping[row, row]),
        loss=joint.loss_factor * stiffness,
        coupling=min(coupling, drive.coupling) / pitch**2,
    )


def _find_slide(placed: StackedJoints, machine: Machine, drive: Drive) -> _Slide:
    """Find what a drive moves, in the stacked dofs."""
    joint, spring = machine.joints[drive.joint], placed.springs[drive.joint]
    if machine.mechanism is not None and drive.axis not in machine.axes:
        return _find_leg_slide(placed, machine, machine.mechanism, drive, spring)
    axis = machine.axes[drive.axis]
    shares = spring.frame.rotation.T @ axis.direction
    row = 3 + int(np.argmax(np.abs(shares))) if axis.kind == "rotary" else 0
    if row and abs(shares[row - 3]) < 1.0 - ALONG:
        raise ModelError(
            f"drive {drive.name}: no axis of its joint {drive.joint} lies along axis {drive.axis}; give the joint an axis along it"
        )
    sign = _travel_sign(joint, axis.moves, float(shares[row % 3]))
    motion = sign * spring.rows[row]
    return _Slide(
        row=row,
        sign=sign,
        motion=motion,
        scale=motion
        if drive.scale is None
        else _scale_row(placed.layout, machine, drive.scale, drive.axis),
        housing=joint.ends[1],
        thread=sign,
    )


def _find_leg_slide(
    placed: StackedJoints,
    machine: Machine,
    mechanism: ToolMechanism,
    drive: Drive,
    spring: PlacedJoint,
) -> _Slide:
    """Find the slide of a leg that grows; its motor stands on the part that does not slide, and a
    linear scale reads the length up to the joint of the platform.
    """
    joint, leg = machine.joints[drive.joint], LENGTHS.index(drive.axis) + 1
    standing, sliding = (
        next(end for end in joint.ends if mechanism.carries.get(end.component or "") == marker)
        for marker in (f"leg_{leg}", f"tip_{leg}")
    )
    name = standing.component or ""
    carrier = (
        placed.layout.placements[name].rotation @ machine.components[name].placement.rotation.T
    )
    along = carrier[:, 2]
    shares = spring.frame.rotation.T @ along
    row = int(np.argmax(np.abs(shares)))
    if abs(shares[row]) < 1.0 - ALONG:
        raise ModelError(
            f"drive {drive.name}: no axis of its joint {drive.joint} lies along {drive.axis}; give the joint the axes of its leg"
        )
    sign = float(np.sign(shares[row])) * (1.0 if joint.ends[1] is sliding else -1.0)
    motion = sign * spring.rows[row]
    return _Slide(
        row=row,
        sign=sign,
        motion=motion,
        scale=_length_row(placed, machine, mechanism, leg, standing, spring.frame.origin) @ along,
        housing=standing,
        # a right-hand screw that turns with its housing pulls the nut back
        thread=-float(np.sign(shares[row])),
    )


def _length_row(
    placed: StackedJoints,
    machine: Machine,
    mechanism: ToolMechanism,
    leg: int,
    standing: JointEnd,
    base: FloatArray,
) -> FloatArray:
    """Return the motion ``(n_all, 3)`` of a leg's joint at the platform against the leg's base."""
    for joint in machine.joints.values():
        carried = {mechanism.carries.get(end.component or ""): end for end in joint.ends}
        if f"tip_{leg}" in carried and "platform" in carried:
            tip = placed.springs[joint.name].frame.origin
            rows = motion_rows(placed.layout, carried["platform"], tip)[:3]
            rows = rows - motion_rows(placed.layout, standing, base)[:3]
            return rows.T
    raise ModelError(
        f"leg {leg}: no joint between its tip and the platform, so a scale has no length to read; join them"
    )


def _thread_row(spring: PlacedJoint, row: int) -> FloatArray:
    """Return the motion that stretches a screw or twists a gear: along it, less what turns of the nut
    do.
    """
    return spring.stiffness[row] / spring.stiffness[row, row] @ spring.rows


def _travel_sign(joint: Joint, moves: tuple[str, ...], along: float) -> float:
    """Return the sign that turns the relative motion of the joint's ends, second less first, into
    travel of the axis.
    """
    second_moves = joint.ends[1].component in moves
    return float(np.sign(along)) * (1.0 if second_moves else -1.0)


def _feed_inertia(drive: Drive, moved_mass: float) -> AxisControl:
    """Return the controller with its acceleration feed-forward [kg]: what the motor moves, its own
    inertia and the screw's.
    """
    pitch = drive.lead / (2.0 * math.pi)
    whole = moved_mass + (drive.motor_inertia + drive.screw_inertia) / pitch**2
    return dataclasses.replace(
        drive.control, acceleration_feed_forward=drive.acceleration_share * whole
    )


def _scale_row(layout: DofLayout, machine: Machine, point: str, axis: str) -> FloatArray:
    """Return the motion along an axis at a point; where the axis carries the work, its travel is
    that of work against tool.
    """
    carrier = machine.axes[axis]
    row = carrier.direction @ point_rows(layout, machine.points[point])[:3]
    carries_tool = machine.points[point].tool.component in carrier.moves
    return row if carries_tool else -row
