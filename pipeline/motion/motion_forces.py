"""Loads of drives and joints while a machine moves: motor torques, position errors and joint
forces, from the states of its motion.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.pipeline.answers.motion_forces import DriveExtremes, DriveHistory
from headstock.reduction.coupling.joint_forces import DAMPER, SPRING, JointForces
from headstock.solvers.control.drive_loops import ENCODER
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.solvers.watched_outputs import (
    Extreme,
    Watch,
    WatchedOutputs,
    find_largest,
)

ROUNDOFF = 1e-10  # of the largest force, or the largest moment


@dataclass(frozen=True, eq=False)
class SteppedStates:
    """Store a motion at the beginning and at the end of each of its steps, between which it may
    jump: ``N = 2 (n - 1)`` instants, all beginnings first.

    Attributes:
        times: ``(n,)`` of its grid [s].
        states: ``(N, s)``.
        acting: ``(N, m)`` inputs.
    """

    times: FloatArray
    states: FloatArray
    acting: FloatArray

    @property
    def instants(self) -> FloatArray:
        """Times ``(N,)`` [s]."""
        return np.concatenate([self.times[:-1], self.times[1:]])

    def observe(self, watched: WatchedOutputs) -> FloatArray:
        """Return the values ``(N, k)`` of outputs."""
        return watched.evaluate(self.states, self.acting)

    def at_times(self, values: FloatArray) -> FloatArray:
        """Select from values ``(N, k)`` those at every time ``(n, k)``, just after a jump."""
        return np.concatenate([values[: len(self.times) - 1], values[-1:]])


def follow_drives(
    drives: Collection[Drive], space: StateSpace, motion: SteppedStates
) -> DriveHistory:
    """Return torques of motors, including those for their own inertia, and position errors, with
    set points at rest.

    Args:
        drives: Drives whose loops are closed.
        space: With forces and encoders of the drives as outputs.
    """
    forces, read = (
        motion.observe(space.watch(Watch(tuple((drive.name, what) for drive in drives))))
        for what in (FORCE, ENCODER)
    )
    history = record_drives(drives, motion.instants, forces, -read)
    return DriveHistory(
        history.extremes,
        motion.at_times(history.torques),
        motion.at_times(history.position_errors),
    )


def record_drives(
    drives: Collection[Drive], times: FloatArray, forces: FloatArray, errors: FloatArray
) -> DriveHistory:
    """Return motor torques and position errors from forces known at times.

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
    """Return the forces of joints, springs with their dampers, as outputs."""
    joints = tuple(joints)
    springs = [channel for joint in joints for channel in joint.channels(SPRING)]
    dampers = [channel for joint in joints for channel in joint.channels(DAMPER)]
    return Watch(tuple(springs), dict(zip(springs, dampers, strict=True)))


def watch_drives(drives: Collection[Drive]) -> Watch:
    """Return the forces of drives, then the readings of their position controllers, as outputs."""
    return Watch(tuple((drive.name, what) for what in (FORCE, ENCODER) for drive in drives))


def largest_joint_forces(
    joints: Iterable[JointForces],
    times: FloatArray,
    observe: Callable[[JointForces], FloatArray],
) -> dict[str, dict[str, Extreme]]:
    """Return the largest force on the first end of every joint, by direction; zero where only rigid
    joints carry load.

    Args:
        times: ``(n,)`` [s].
        observe: Forces of a joint ``(n, d)`` then.
    """
    largest = {joint: find_largest(times, observe(joint)) for joint in joints}
    sizes = np.array([abs(force.value) for forces in largest.values() for force in forces])
    still = iter(find_roundoff([name for joint in largest for name in joint.directions], sizes))
    return {
        joint.name: {
            name: Extreme(0.0, 0.0) if next(still) else force
            for name, force in zip(joint.directions, forces, strict=True)
        }
        for joint, forces in largest.items()
    }


def find_roundoff(dofs: Sequence[str], sizes: FloatArray) -> BoolArray:
    """Find values ``(n,)`` that are roundoff relative to the largest of their kind: forces or
    moments, displacements or rotations.
    """
    turns = np.array([dof.startswith("r") for dof in dofs], dtype=np.bool_)
    straight, turned = (sizes[turns == kind].max(initial=0.0) for kind in (False, True))
    return sizes <= ROUNDOFF * np.where(turns, turned, straight)
