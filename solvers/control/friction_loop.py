"""A closed loop with friction in its guides (Coulomb, Stribeck, viscous; smooth through zero
velocity); the work of each force is a state.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import GuideFriction
from headstock.solvers.control.drive_loops import ClosedLoop, set_channels
from headstock.solvers.control.drive_trains import SLIDE, DriveTrain
from headstock.solvers.second_order import Channel

WORKS = 5  # of the drives, of the loads, lost in dampers, lost in friction, of the change of pose
LOADS = 1  # which of them is that of the loads


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
    """Force against the motion [N]; of several guides at speeds ``(..., d)``.

    Source: Armstrong-Helouvry, Dupont and Canudas de Wit (1994), A survey of models, section 2.1
    (Stribeck curve with a Gaussian);
        the sign of the velocity is smoothed to a tanh.
    """
    return np.asarray(
        _level(law, velocity) * np.tanh(velocity / law.smoothing) + law.viscous * velocity
    )


def friction_slope(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Derivative of the force by the velocity [N s/m]; negative where friction falls with speed."""
    bend = np.tanh(velocity / law.smoothing)
    falling = -2.0 * velocity / law.stribeck_speed**2 * (_level(law, velocity) - law.coulomb)
    return np.asarray(
        falling * bend + _level(law, velocity) * (1.0 - bend**2) / law.smoothing + law.viscous
    )


def _level(law: FrictionLaw, velocity: FloatArray) -> FloatArray:
    """Size of the dry part [N]."""
    return np.asarray(
        law.coulomb
        + (law.breakaway - law.coulomb) * np.exp(-((velocity / law.stribeck_speed) ** 2))
    )


@dataclass(frozen=True, eq=False)
class RubbingLoop:
    """``x' = A x + B u - G f(V x + w)``, and five works.

    The machine's states are ``(s p, p')`` of each mode, so that a load enters as its work per
    velocity. Where they are deviations from a motion, ``w`` is the speed of that motion, and works
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
        guides: w ``(k,)`` [m/s].
        weight_rates: ``(m, m)`` how fast the weights change along the path [1/s].
    """

    loop: ClosedLoop
    laws: tuple[GuideFriction, ...]
    slides: FloatArray
    drag: FloatArray
    given: int
    sets: int
    weights: FloatArray
    dampers: FloatArray
    guides: FloatArray
    weight_rates: FloatArray

    @property
    def size(self) -> int:
        """Number of states without the works."""
        return len(self.loop.space.a)

    def friction(self, speeds: FloatArray) -> FloatArray:
        """Forces ``(..., k)`` against the motion [N]."""
        forces = np.zeros_like(speeds)
        for number, law in enumerate(self.laws):
            forces[..., number] = friction_force(law, speeds[..., number])
        return forces

    def drive_forces(self, states: FloatArray, given: FloatArray, rubbed: FloatArray) -> FloatArray:
        """``(..., n_drives)``, with friction ``(..., k)``, which moves what controllers see at once by
        the modes that are left out [N].
        """
        count, space = len(self.loop.trains), self.loop.space
        acting = np.concatenate([given, -rubbed], axis=-1)
        return np.asarray(states @ space.c[-count:].T + acting @ space.d[-count:].T)

    def stored_energy(self, states: FloatArray) -> FloatArray:
        """Kinetic and strain energy ``(...)`` [J]."""
        machine = states[..., : self.loop.plant_size]
        return np.asarray(0.5 * np.einsum("...i,...i", machine @ self.weights, machine))

    def rate(self, full: FloatArray, given: FloatArray) -> FloatArray:
        """Derivative of states and works ``(n + 5,)``."""
        state, space = full[: self.size], self.loop.space
        speeds = self.slides @ state
        rubbed = self.friction(speeds + self.guides)
        machine = state[: self.loop.plant_size]
        works = (
            self.drive_forces(state, given, rubbed) @ (self.loop.rates @ state),
            machine @ self._load_column(given),
            machine @ self.dampers @ machine,
            rubbed @ speeds,
            0.5 * (machine @ self.weight_rates @ machine),
        )
        return np.concatenate(
            [space.a @ state + space.b[:, : self.given] @ given - self.drag @ rubbed, works]
        )

    def jacobian(self, full: FloatArray, given: FloatArray) -> FloatArray:
        """``(n + 5, n + 5)``."""
        state, space, count = full[: self.size], self.loop.space, len(self.loop.trains)
        machine = slice(0, self.loop.plant_size)
        speeds = self.slides @ state
        rubbing = speeds + self.guides
        slopes = np.array(
            [float(friction_slope(law, rubbing[i])) for i, law in enumerate(self.laws)]
        )
        found = np.zeros((len(full), len(full)))
        # works appear in no rate, so their columns are zero. Their rates are products of states:
        # force times speed by the product rule, damper power as a quadratic form, friction as its
        # law times speed
        inner, works = found[: self.size, : self.size], found[self.size :, : self.size]
        inner[:] = space.a - (self.drag * slopes) @ self.slides
        rates, rubbed = self.loop.rates, self.friction(rubbing)
        pushes = space.c[-count:] - (space.d[-count:, self.given :] * slopes) @ self.slides
        works[0] = self.drive_forces(state, given, rubbed) @ rates + (rates @ state) @ pushes
        works[1, machine] = self._load_column(given)
        works[2, machine] = 2.0 * self.dampers @ state[machine]
        works[3] = (rubbed + slopes * speeds) @ self.slides
        works[4, machine] = self.weight_rates @ state[machine]
        return found

    def _load_column(self, given: FloatArray) -> FloatArray:
        """What the loads do to the machine's states ``(m,)``."""
        count = len(self.loop.trains)
        return np.asarray(
            self.loop.plant.b[:, count : count + self.given - self.sets] @ given[self.sets :]
        )


def friction_channels(trains: tuple[DriveTrain, ...]) -> tuple[Channel, ...]:
    """Inputs where friction acts: the last ones a loop is to be closed with."""
    return tuple((train.name, SLIDE) for train in trains if train.friction is not None)


def make_rubbing_loop(loop: ClosedLoop) -> RubbingLoop:
    """Take a closed loop apart.

    Args:
        loop: Its last inputs are ``friction_channels`` of its drives.

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
        guides=np.zeros(len(channels)),
        weight_rates=np.zeros_like(weights),
    )
