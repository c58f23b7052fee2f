"""A closed loop with friction in its guides."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop, set_channels
from headstock.solvers.control.drive_trains import SLIDE, DriveTrain
from headstock.solvers.control.friction import StackedFriction, stack_laws
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class FrictionLoop:
    """``x' = A x + B S u - G f(V x + W u)``, ``y = C x + D u - H f``.

    The machine's states are ``(s p, p')`` of each mode, so that a load enters as its work per
    velocity. Where they are deviations from a motion, ``W u`` is the speed of that motion, and works
    are those done on the deviations.

    Attributes:
        loop: Closed, with the loads that are given and those of friction among its inputs.
        law: Of the guides that evaluate_friction.
        slides: V ``(k, n)``: velocity in these guides.
        drag: G ``(n, k)``.
        passed: H ``(p, k)``.
        acting: B ``(n, m)`` of all inputs but those of friction.
        spread: S ``(m, q)``: these inputs of what is given over time.
        d: D ``(p, q)`` of what is given.
        pushing: ``(l, q)`` the loads among what is given.
        reach: ``(l, m)`` motion, per state of the machine, that each of these pushes along.
        weights: ``(m, m)`` of the machine's states in twice the energy.
        dampers: ``(m, m)`` power lost in dampers.
        guides: W ``(k, q)``.
    """

    loop: ClosedLoop
    law: StackedFriction
    slides: FloatArray
    drag: FloatArray
    passed: FloatArray
    acting: FloatArray
    spread: FloatArray
    d: FloatArray
    pushing: FloatArray
    reach: FloatArray
    weights: FloatArray
    dampers: FloatArray
    guides: FloatArray

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.loop.space.a)

    @functools.cached_property
    def b(self) -> FloatArray:
        """Columns ``(n, q)`` of what is given over time."""
        return np.asarray(self.acting @ self.spread)

    def stored_energy(self, states: FloatArray) -> FloatArray:
        """Kinetic and strain energy ``(...)`` [J]."""
        machine = states[..., : self.loop.plant_size]
        return np.asarray(0.5 * np.einsum("...i,...i", machine @ self.weights, machine))


def friction_channels(trains: tuple[DriveTrain, ...]) -> tuple[Channel, ...]:
    """Inputs where friction acts, with which a loop is to be closed."""
    return tuple((train.name, SLIDE) for train in trains if train.friction is not None)


type Given = Mapping[Channel, FloatArray]


def _other_inputs(loop: ClosedLoop) -> tuple[Channel, ...]:
    """Inputs of a closed loop but those of friction: set points, then loads."""
    channels = friction_channels(loop.trains)
    return tuple(channel for channel in loop.space.inputs if channel not in channels)


def spread_inputs(inputs: Sequence[Channel], given: Given) -> FloatArray:
    """Return the inputs ``(m, q)`` of what is given over time, from the row ``(q,)`` of each; inputs
    without a row are zero.
    """
    none = np.zeros_like(next(iter(given.values())))
    return np.array([given.get(channel, none) for channel in inputs]).reshape(-1, len(none))


def make_friction_loop(
    loop: ClosedLoop, given: Given | None = None, guides: FloatArray | None = None
) -> FrictionLoop:
    """Take a closed loop apart.

    Args:
        loop: With ``friction_channels`` of its drives among its inputs.
        given: Other inputs to their rows ``(q,)`` of what is given over time; None for these
            themselves, in their order.
        guides: ``(k, q)`` speed of each guide that what is given says; None for guides at rest.

    Raises:
        ValueError: It is closed without them.
    """
    space, plant = loop.space, loop.plant
    channels, others = friction_channels(loop.trains), _other_inputs(loop)
    if not set(channels) <= set(space.inputs):
        raise ValueError(
            f"a loop with friction is closed with {channels} among its inputs, not {space.inputs}"
        )
    if given is None:
        given = dict(zip(others, np.eye(len(others)), strict=True))
    spread, acting = spread_inputs(others, given), space.columns.of(others)
    sets = set_channels(loop.trains)
    loads = [channel for channel in others if channel not in sets]
    friction_columns = space.columns.of(channels)
    first, second = np.arange(0, loop.plant_size, 2), np.arange(1, loop.plant_size, 2)
    weights = np.eye(loop.plant_size)
    # a mode's states are (s p, p') with (s p)' = s p' and p'' = -K / s (s p)
    weights[np.ix_(first, first)] = (
        -plant.a[np.ix_(second, first)] / plant.a[first, second][:, None]
    )
    dampers = np.zeros((loop.plant_size, loop.plant_size))
    dampers[np.ix_(second, second)] = -plant.a[np.ix_(second, second)]
    slides = np.zeros((len(channels), len(space.a)))
    slides[:, : loop.plant_size] = plant.c[plant.rows.of(channels)] @ plant.a
    return FrictionLoop(
        loop=loop,
        law=stack_laws([train.friction for train in loop.trains if train.friction is not None]),
        slides=slides,
        drag=space.b[:, friction_columns],
        passed=space.d[:, friction_columns],
        acting=space.b[:, acting],
        spread=spread,
        d=space.d[:, acting] @ spread,
        pushing=spread_inputs(loads, given),
        reach=plant.b[:, plant.columns.of(loads)].T,
        weights=weights,
        dampers=dampers,
        guides=np.zeros((len(channels), spread.shape[1])) if guides is None else guides,
    )
