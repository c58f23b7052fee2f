"""Friction in guides (Coulomb, Stribeck, viscous; smooth through zero velocity): its law, and its
forces on coordinates of a system with otherwise linear steps.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction
from headstock.solvers.errors import ConvergenceError

MOST_PASSES = 60
SETTLED = 1e-13  # of the speeds at hand, or of the smoothing
type FrictionLaw = GuideFriction | StackedFriction


@dataclass(frozen=True, eq=False)
class StackedFriction:
    """Store laws of ``d`` guides as arrays ``(d,)``; see :class:`GuideFriction`."""

    coulomb: FloatArray
    breakaway: FloatArray
    stribeck_speed: FloatArray
    viscous: FloatArray
    smoothing: FloatArray

    def __len__(self) -> int:
        """Return the number of guides."""
        return len(self.coulomb)


def stack_laws(laws: Sequence[GuideFriction | None]) -> StackedFriction:
    """Return the laws of several guides as one; zero for a guide without friction."""
    names = [law_field.name for law_field in dataclasses.fields(StackedFriction)]
    filled = [law or GuideFriction() for law in laws]
    return StackedFriction(*(np.array([getattr(law, name) for law in filled]) for name in names))


def friction_force(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Return the force against the motion [N]; of several guides at speeds ``(..., d)``."""
    return evaluate_friction(law, velocity)[0]


def friction_slope(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Return the derivative of the force by velocity [N s/m]; negative where it falls."""
    return evaluate_friction(law, velocity)[1]


def evaluate_friction(law: FrictionLaw, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the force against the motion [N] and its derivative by velocity [N s/m].

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit (1994), A survey of models, section 2.1
    (Stribeck curve with a Gaussian);
        the sign of the velocity is smoothed to a tanh.
    """
    bend, fast = np.tanh(velocity / law.smoothing), velocity / law.stribeck_speed
    more = (law.breakaway - law.coulomb) * np.exp(-(fast**2))
    level = law.coulomb + more
    falling = (-2.0 / law.stribeck_speed) * fast * more * bend
    return (
        np.asarray(level * bend + law.viscous * velocity),
        np.asarray(falling + level * (1.0 - bend**2) / law.smoothing + law.viscous),
    )


@dataclass(frozen=True, eq=False)
class CoordinateFriction:
    """Describe friction on ``d`` coordinates.

    Attributes:
        coordinates: ``(d,)`` indices of the coordinates.
        speeds: ``(n, d)`` set speeds at ``n`` steps, to which the rates of the coordinates are
            added [m/s].
    """

    coordinates: NDArray[np.intp]
    law: StackedFriction
    speeds: FloatArray

    def force(self, rates: FloatArray) -> FloatArray:
        """Return the forces ``(n, d)`` against the motion at rates ``(n, c)`` [N]."""
        return friction_force(self.law, self.speeds + rates[:, self.coordinates])

    def settle(self, step: int, free: FloatArray, gain: FloatArray) -> FloatArray:
        """Solve for the friction forces ``(d,)`` on the coordinates at a step [N].

        Args:
            free: ``(d,)`` speeds of the coordinates at its end without these forces [m/s].
            gain: ``(d, d)`` speed per force on them [m/s/N].

        Raises:
            ConvergenceError: Newton's method does not settle.
        """
        target = self.speeds[step] + free
        scale = np.abs(target).max() + self.law.smoothing.max()
        now = target
        friction_forces, slopes = evaluate_friction(self.law, now)
        off = now + gain @ friction_forces - target
        for _ in range(MOST_PASSES):
            if np.abs(off).max() <= SETTLED * scale:
                return -friction_forces
            change = np.linalg.solve(np.eye(len(now)) + gain * slopes, -off)
            share, missed = 1.0, np.abs(off).max()
            while True:
                # the law is curved within its smoothing: steps that overshoot are halved
                trial = now + share * change
                friction_forces, slopes = evaluate_friction(self.law, trial)
                off = trial + gain @ friction_forces - target
                if np.abs(off).max() < missed or share < 1e-3:
                    break
                share *= 0.5
            now = trial
        raise ConvergenceError(
            f"friction at step {step} of the motion does not settle; give it a larger smoothing"
        )
