"""Drives under control along a contour, of any machine: motors with their inertia and friction, their
loops closed, and what they do.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.pipeline.contours.contour_run import ContourDrives
from headstock.solvers.control.friction import CoordinateFriction, friction_force, stack_laws
from headstock.solvers.paths.linear_motion import CompliantHistory, LinearMotion
from headstock.solvers.paths.servo_motion import ServoMotion, close_motors

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
