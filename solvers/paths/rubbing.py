"""Friction on some coordinates of a linear system along a path, at the speeds that they have.

A step of the system is linear but for these few forces: their coordinates' speeds at its end are
found by Newton's method, the others follow.
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction
from headstock.solvers.control.friction_loop import (
    StackedFriction,
    friction_force,
    friction_slope,
    stack_laws,
)
from headstock.solvers.errors import ConvergenceError

MOST_PASSES = 60
SETTLED = 1e-13  # of the speeds at hand, or of the smoothing


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Friction on ``d`` coordinates.

    Attributes:
        coordinates: ``(d,)`` which.
        laws: Of each.
        speeds: ``(n, d)`` at ``n`` steps, what the speed of each is beside that of the system [m/s].
    """

    coordinates: NDArray[np.intp]
    laws: tuple[GuideFriction, ...]
    speeds: FloatArray

    @functools.cached_property
    def _stacked(self) -> StackedFriction:
        return stack_laws(self.laws)

    def force(self, speeds: FloatArray) -> FloatArray:
        """Forces ``(..., d)`` against motions at speeds ``(..., d)`` [N]."""
        return friction_force(self._stacked, speeds)

    def settle(self, step: int, free: FloatArray, gain: FloatArray) -> FloatArray:
        """Forces ``(d,)`` that act on the coordinates at a step [N].

        Args:
            step: Its number.
            free: ``(d,)`` speeds of the coordinates at its end without these forces [m/s].
            gain: ``(d, d)`` speed per force on them [m/s/N].

        Raises:
            ConvergenceError: Newton's method does not settle.
        """
        target = self.speeds[step] + free
        scale = np.abs(target).max() + self._stacked.smoothing.max()
        now = target
        rubbed = self.force(now)
        off = now + gain @ rubbed - target
        for _ in range(MOST_PASSES):
            if np.abs(off).max() <= SETTLED * scale:
                return np.asarray(-rubbed)
            slopes = friction_slope(self._stacked, now)
            change = np.linalg.solve(np.eye(len(now)) + gain * slopes, -off)
            share, missed = 1.0, np.abs(off).max()
            while True:
                # the law bends within its smoothing: what overshoots is halved
                trial = now + share * change
                rubbed = self.force(trial)
                off = trial + gain @ rubbed - target
                if np.abs(off).max() < missed or share < 1e-3:
                    break
                share *= 0.5
            now = trial
        raise ConvergenceError(
            f"friction at step {step} of the motion does not settle; give it a larger smoothing"
        )
