"""A straight move of a tool as a path in time."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.tool_path import PathPoints
from headstock.solvers.motion.set_points import PathMotion, SetPoint, sample_move


@dataclass(frozen=True, eq=False)
class StraightPath:
    """A move along a line.

    Accelerations are means over the time of a step, from the speeds at its ends: where they jump,
    as on linear ramps, steps in time then keep the impulse, and their error stays of second order.

    Attributes:
        start: ``(3,)`` where it begins [m].
        along: ``(3,)`` motion of the tool per travel along the path.
        step: In time [s].
    """

    start: FloatArray
    along: FloatArray
    move: SetPoint
    step: float

    def travel(self, times: FloatArray) -> PathMotion:
        """Position, speed and mean acceleration along the line at times ``(n,)``; at rest before and
        after.
        """
        now = sample_move(self.move, times)
        before, after = (
            sample_move(self.move, times + side * self.step).speeds for side in (-0.5, 0.5)
        )
        pulls = np.asarray((after - before) / self.step)
        return PathMotion(now.positions, now.speeds, pulls)

    @property
    def span(self) -> tuple[float, float]:
        """Start and end [s]."""
        return 0.0, self.move.duration

    def at(self, times: FloatArray) -> PathPoints:
        """Positions, velocities and accelerations at times ``(n,)``; at rest before and after."""
        now = self.travel(times)
        return PathPoints(
            self.start + now.positions[:, None] * self.along,
            now.speeds[:, None] * self.along,
            now.accelerations[:, None] * self.along,
        )

    def velocity(self, times: FloatArray) -> FloatArray:
        """``(n, 3)`` velocities alone."""
        return np.asarray(sample_move(self.move, times).speeds[:, None] * self.along)


@dataclass(frozen=True, eq=False)
class UnitTravel:
    """A line at constant speed and acceleration wherever it is, over its position in place of time.

    Attributes:
        start: ``(3,)`` where it begins [m].
        along: ``(3,)`` motion of the tool per travel along the path.
        speed: Along it [m/s].
        acceleration: Along it [m/s^2].
        span: Positions at which it begins and ends [m].
    """

    start: FloatArray
    along: FloatArray
    speed: float
    acceleration: float
    span: tuple[float, float]

    def at(self, times: FloatArray) -> PathPoints:
        """Positions, velocities and accelerations at positions ``(n,)`` of the line."""
        still = np.zeros((len(times), 3))
        return PathPoints(
            self.start + times[:, None] * self.along,
            still + self.speed * self.along,
            still + self.acceleration * self.along,
        )

    def velocity(self, times: FloatArray) -> FloatArray:
        """``(n, 3)`` velocities alone."""
        return self.at(times).velocity
