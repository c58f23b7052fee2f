"""A straight move of a machine's axes from one pose to another, and how every component travels in it."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Pose, place_components

TURN_TOLERANCE = 1e-12


@dataclass(frozen=True)
class MachinePath:
    """Axis positions [m] at both ends of a straight move; axes not named stand at zero.

    Attributes:
        start: Where it begins.
        end: Where it ends.
    """

    start: Pose
    end: Pose

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that move."""
        names = dict.fromkeys((*self.start.positions, *self.end.positions))
        return tuple(name for name in names if self.start.positions.get(name, 0.0) != self.end.positions.get(name, 0.0))

    @property
    def length(self) -> float:
        """Length of the way in the space of the axes [m]."""
        steps = [self.end.positions.get(name, 0.0) - self.start.positions.get(name, 0.0) for name in self.axes]
        return float(np.linalg.norm(steps))

    def pose_at(self, position: float) -> Pose:
        """The pose after so much of the way [m]."""
        share = position / self.length
        names = dict.fromkeys((*self.start.positions, *self.end.positions))
        places = {}
        for name in names:
            first, last = self.start.positions.get(name, 0.0), self.end.positions.get(name, 0.0)
            # the ends exactly, so that roundoff never leaves an axis' range
            places[name] = last if share >= 1.0 else (1.0 - share) * first + share * last
        return Pose(f"{1e3 * position:g} mm along the path", places)


def travel_directions(machine: Machine, path: MachinePath) -> dict[str, FloatArray]:
    """Velocity ``(3,)`` of every component that moves, machine frame, per unit speed along the path.

    Raises:
        ValueError: A component turns on the way, or an end lies outside an axis' limits.
    """
    before, after = place_components(machine, path.start), place_components(machine, path.end)
    found = {}
    for name, frame in after.items():
        if np.abs(frame.rotation - before[name].rotation).max() > TURN_TOLERANCE:
            raise ValueError(f"component {name!r} turns between both ends of the path; a path moves linear axes only")
        step = frame.origin - before[name].origin
        if step.any():
            found[name] = np.asarray(step / path.length)
    return found
