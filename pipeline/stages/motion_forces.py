"""What drives and joints take while a machine moves: torques of motors, position errors and forces
of joints, from the states of its motion.
"""

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.pipeline.answers.motion_forces import DriveExtremes
from headstock.reduction.coupling.joint_forces import DAMPER, SPRING, JointForces
from headstock.solvers.control.drive_loops import ENCODER
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.linear.state_space import StateSpace
from headstock.solvers.linear.watched_outputs import Extreme, WatchedOutputs, watch_channels

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


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """What drives did, set points at rest.

    Attributes:
        extremes: By drive.
        torques: ``(n, d)`` of motors at every time [N m].
        position_errors: ``(n, d)`` [m].
    """

    extremes: dict[str, DriveExtremes]
    torques: FloatArray
    position_errors: FloatArray


def follow_drives(
    drives: Collection[Drive], space: StateSpace, motion: SteppedStates
) -> DriveHistory:
    """Torques of motors, those that their own inertia takes among them, and position errors, with
    set points at rest.

    Args:
        drives: Whose loops are closed.
        space: With forces and encoders of the drives as outputs.
        motion: Its states.
    """
    pitches = [drive.lead / (2.0 * math.pi) for drive in drives]
    torque = _scale(watch_channels(space, [(drive.name, FORCE) for drive in drives]), pitches)
    error = watch_channels(space, [(drive.name, ENCODER) for drive in drives])
    error = _scale(error, [-1.0] * len(drives))
    extremes = {
        drive.name: DriveExtremes(*found)
        for drive, *found in zip(
            drives, motion.find_extremes(torque), motion.find_extremes(error), strict=True
        )
    }
    return DriveHistory(extremes, motion.at_times(torque), motion.at_times(error))


def find_largest_forces(
    joints: Iterable[JointForces], space: StateSpace, motion: SteppedStates
) -> dict[str, dict[str, Extreme]]:
    """Largest force on the first end of every joint, by direction.

    Args:
        joints: Whose springs and dampers are outputs of the space.
        space: With them.
        motion: Its states.
    """
    found = {}
    for joint in joints:
        watched = watch_channels(space, joint.channels(SPRING), joint.channels(DAMPER))
        extremes = motion.find_extremes(watched)
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
