"""A closed loop with friction in its guides (Coulomb, Stribeck, viscous; smooth through zero
velocity).
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction
from headstock.solvers.control.drive_loops import ClosedLoop, set_channels
from headstock.solvers.control.drive_trains import SLIDE, DriveTrain
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class StackedFriction:
    """Laws of ``d`` guides as arrays ``(d,)``; see :class:`GuideFriction`."""

    coulomb: FloatArray
    breakaway: FloatArray
    stribeck_speed: FloatArray
    viscous: FloatArray
    smoothing: FloatArray


def stack_laws(laws: Sequence[GuideFriction]) -> StackedFriction:
    """Laws of several guides, to be evaluated together."""
    names = [each.name for each in dataclasses.fields(StackedFriction)]
    return StackedFriction(*(np.array([getattr(law, name) for law in laws]) for name in names))


type FrictionLaw = GuideFriction | StackedFriction


def friction_force(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Force against the motion [N]; of several guides at speeds ``(..., d)``."""
    return rub(law, velocity)[0]


def friction_slope(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Derivative of the force by the velocity [N s/m]; negative where friction falls with speed."""
    return rub(law, velocity)[1]


def rub(law: FrictionLaw, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Force against the motion [N] and its derivative by the velocity [N s/m], likewise.

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
class RubbingLoop:
    """``x' = A x + B S u - G f(V x + W u)``.

    The machine's states are ``(s p, p')`` of each mode, so that a load enters as its work per
    velocity. Where they are deviations from a motion, ``W u`` is the speed of that motion, and works
    are those done on the deviations.

    Attributes:
        loop: Closed, with the loads that are given and then those of friction as inputs.
        laws: Of each guide that rubs.
        slides: V ``(k, n)``: velocity in these guides.
        drag: G ``(n, k)``.
        given: How many inputs are given: set points, then loads.
        sets: How many of these are set points.
        weights: ``(m, m)`` of the machine's states in twice the energy.
        dampers: ``(m, m)`` power lost in dampers.
        spread: S ``(given, q)``: these inputs of what is given over time.
        guides: W ``(k, q)``.
    """

    loop: ClosedLoop
    laws: tuple[GuideFriction, ...]
    slides: FloatArray
    drag: FloatArray
    given: int
    sets: int
    weights: FloatArray
    dampers: FloatArray
    spread: FloatArray
    guides: FloatArray

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.loop.space.a)

    @functools.cached_property
    def stacked(self) -> StackedFriction:
        """The laws of all guides."""
        return stack_laws(self.laws)

    def friction(self, speeds: FloatArray) -> FloatArray:
        """Forces ``(..., k)`` against the motion [N]."""
        return friction_force(self.stacked, speeds)

    def stored_energy(self, states: FloatArray) -> FloatArray:
        """Kinetic and strain energy ``(...)`` [J]."""
        machine = states[..., : self.loop.plant_size]
        return np.asarray(0.5 * np.einsum("...i,...i", machine @ self.weights, machine))


def friction_channels(trains: tuple[DriveTrain, ...]) -> tuple[Channel, ...]:
    """Inputs where friction acts: the last ones a loop is to be closed with."""
    return tuple((train.name, SLIDE) for train in trains if train.friction is not None)


def make_rubbing_loop(
    loop: ClosedLoop, spread: FloatArray | None = None, guides: FloatArray | None = None
) -> RubbingLoop:
    """Take a closed loop apart.

    Args:
        loop: Its last inputs are ``friction_channels`` of its drives.
        spread: ``(m, q)`` its other inputs of what is given over time; None for these themselves.
        guides: ``(k, q)`` speed of each guide that what is given says; None for guides at rest.

    Raises:
        ValueError: They are not.
    """
    space, plant = loop.space, loop.plant
    channels = friction_channels(loop.trains)
    given = len(space.inputs) - len(channels)
    if space.inputs[given:] != channels:
        raise ValueError(
            f"a loop with friction is closed with {channels} as its last inputs, not {space.inputs[given:]}"
        )
    rows = [space.outputs.index(channel) for channel in channels]
    first, second = np.arange(0, loop.plant_size, 2), np.arange(1, loop.plant_size, 2)
    weights = np.eye(loop.plant_size)
    # a mode's states are (s p, p') with (s p)' = s p' and p'' = -K / s (s p)
    weights[np.ix_(first, first)] = (
        -plant.a[np.ix_(second, first)] / plant.a[first, second][:, None]
    )
    spread = np.eye(given) if spread is None else spread
    dampers = np.zeros((loop.plant_size, loop.plant_size))
    dampers[np.ix_(second, second)] = -plant.a[np.ix_(second, second)]
    slides = np.zeros((len(channels), len(space.a)))
    slides[:, : loop.plant_size] = (
        plant.c[[plant.outputs.index(channel) for channel in channels]] @ plant.a if rows else 0.0
    )
    return RubbingLoop(
        loop=loop,
        laws=tuple(train.friction for train in loop.trains if train.friction is not None),
        slides=slides,
        drag=space.b[:, given:],
        given=given,
        sets=len(set_channels(loop.trains)),
        weights=weights,
        dampers=dampers,
        spread=spread,
        guides=np.zeros((len(channels), spread.shape[1])) if guides is None else guides,
    )
