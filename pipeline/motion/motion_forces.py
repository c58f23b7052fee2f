"""What drives and joints take while a machine moves: torques of motors, position errors and forces
of joints, from the states of its motion.
"""

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.pipeline.answers.motion_forces import DriveExtremes, DriveHistory
from headstock.reduction.coupling.joint_forces import DAMPER, SPRING, JointForces
from headstock.solvers.control.drive_loops import ENCODER
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.watched_outputs import (
    Extreme,
    Watch,
    WatchedOutputs,
    find_largest,
)

ROUNDOFF = 1e-10  # of the largest force, or the largest moment


@dataclass(frozen=True, eq=False)
class SteppedStates:
    """A motion at the steps of its grid.

    Attributes:
        times: ``(n,)`` [s].
        states: ``(n - 1, s)`` at the begin of each step, and at its end.
        acting: ``(n - 1, m)`` inputs likewise.
    """

    times: FloatArray
    states: tuple[FloatArray, FloatArray]
    acting: tuple[FloatArray, FloatArray]

    def at_times(self, watched: WatchedOutputs) -> FloatArray:
        """Values ``(n, k)`` at every time, just after what happens there."""
        return np.concatenate(
            [
                watched.evaluate(self.states[0], self.acting[0]),
                watched.evaluate(self.states[1][-1:], self.acting[1][-1:]),
            ]
        )

    def find_extremes(self, watched: WatchedOutputs) -> tuple[Extreme, ...]:
        """The largest values."""
        return watched.find_extremes(self.times, self.states, self.acting)


def follow_drives(
    drives: Collection[Drive], space: StateSpace, motion: SteppedStates
) -> DriveHistory:
    """Torques of motors, those that their own inertia takes among them, and position errors, with
    set points at rest.

    Args:
        drives: Whose loops are closed.
        space: With forces and encoders of the drives as outputs.
    """
    pitches = [drive.lead / (2.0 * math.pi) for drive in drives]
    torque, error = (
        space.watch(Watch(tuple((drive.name, what) for drive in drives)))
        for what in (FORCE, ENCODER)
    )
    torque = _scale(torque, pitches)
    error = _scale(error, [-1.0] * len(drives))
    extremes = {
        drive.name: DriveExtremes(*found)
        for drive, *found in zip(
            drives, motion.find_extremes(torque), motion.find_extremes(error), strict=True
        )
    }
    return DriveHistory(extremes, motion.at_times(torque), motion.at_times(error))


def record_drives(
    drives: Collection[Drive], times: FloatArray, forces: FloatArray, errors: FloatArray
) -> DriveHistory:
    """The same of what is known at times.

    Args:
        drives: ``d`` under control.
        times: ``(n,)`` [s].
        forces: ``(n, d)`` of the drives along their axes [N].
        errors: ``(n, d)`` position errors [m].
    """
    torques = forces * [drive.lead / (2.0 * math.pi) for drive in drives]
    names = [drive.name for drive in drives]
    largest = zip(names, find_largest(times, torques), find_largest(times, errors), strict=True)
    return DriveHistory({name: DriveExtremes(*both) for name, *both in largest}, torques, errors)


def watch_joints(joints: Iterable[JointForces]) -> Watch:
    """Springs of joints, with their dampers."""
    joints = tuple(joints)
    springs = [channel for joint in joints for channel in joint.channels(SPRING)]
    dampers = [channel for joint in joints for channel in joint.channels(DAMPER)]
    return Watch(tuple(springs), dict(zip(springs, dampers, strict=True)))


def watch_drives(drives: Collection[Drive]) -> Watch:
    """Forces of drives, then what their position controllers read."""
    return Watch(tuple((drive.name, what) for what in (FORCE, ENCODER) for drive in drives))


def largest_joint_forces(
    joints: Iterable[JointForces],
    times: FloatArray,
    observe: Callable[[JointForces], FloatArray],
) -> dict[str, dict[str, Extreme]]:
    """Return the largest force on the first end of every joint, by direction.

    Args:
        times: ``(n,)`` [s].
        observe: Forces of a joint ``(n, d)`` then.
    """
    found = {
        joint.name: dict(zip(joint.directions, find_largest(times, observe(joint)), strict=True))
        for joint in joints
    }
    return _leave_out_roundoff(found)


def find_largest_forces(
    joints: Iterable[JointForces], space: StateSpace, motion: SteppedStates
) -> dict[str, dict[str, Extreme]]:
    """Largest force on the first end of every joint, by direction.

    Args:
        joints: Whose springs and dampers are outputs of the space.
    """
    found = {}
    for joint in joints:
        extremes = motion.find_extremes(space.watch(watch_joints([joint])))
        found[joint.name] = dict(zip(joint.directions, extremes, strict=True))
    return _leave_out_roundoff(found)


def _leave_out_roundoff(
    joints: dict[str, dict[str, Extreme]],
) -> dict[str, dict[str, Extreme]]:
    """Forces of springs beside which rigid joints hold everything are zero."""
    every = [item for directions in joints.values() for item in directions.items()]
    largest = {
        turns: max(
            (abs(f.value) for name, f in every if name.startswith("r") == turns), default=0.0
        )
        for turns in (False, True)
    }
    return {
        joint: {
            name: Extreme(0.0, 0.0)
            if abs(force.value) <= ROUNDOFF * largest[name.startswith("r")]
            else force
            for name, force in directions.items()
        }
        for joint, directions in joints.items()
    }


def _scale(watched: WatchedOutputs, factors: list[float]) -> WatchedOutputs:
    each = np.array(factors)[:, None]
    return WatchedOutputs(each * watched.states, each * watched.inputs)
