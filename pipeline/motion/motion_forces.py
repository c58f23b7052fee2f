"""What drives and joints take while a machine moves: torques of motors, position errors and forces
of joints, from the states of its motion.
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
    """A motion at the begin and at the end of each of its steps, between which it may jump: ``N = 2 (n - 1)``
    instants, all begins first.

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
        """``(N,)`` [s]."""
        return np.concatenate([self.times[:-1], self.times[1:]])

    def observe(self, watched: WatchedOutputs) -> FloatArray:
        """Return the values ``(N, k)`` of outputs."""
        return watched.evaluate(self.states, self.acting)

    def at_times(self, values: FloatArray) -> FloatArray:
        """Return those of values ``(N, k)`` at every time ``(n, k)``, just after what happens there."""
        return np.concatenate([values[: len(self.times) - 1], values[-1:]])


def follow_drives(
    drives: Collection[Drive], space: StateSpace, motion: SteppedStates
) -> DriveHistory:
    """Return torques of motors, those that their own inertia takes among them, and position errors, with
    set points at rest.

    Args:
        drives: Whose loops are closed.
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
    """Return torques of motors and position errors that are known at times.

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
    """Springs of joints, with their dampers, as outputs."""
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
    """Return the largest force on the first end of every joint, by direction; zero of springs where rigid
    joints hold everything.

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
    """Find values ``(n,)`` that are roundoff of the largest of their kind: forces or moments, displacements
    or rotations.
    """
    turns = np.array([dof.startswith("r") for dof in dofs], dtype=np.bool_)
    straight, turned = (sizes[turns == kind].max(initial=0.0) for kind in (False, True))
    return np.asarray(sizes <= ROUNDOFF * np.where(turns, turned, straight))
