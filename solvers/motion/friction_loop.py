"""A closed loop with friction in its guides, its time steps, and their change along a path:
tabulated at positions, cubic between them.

Within a step of size h the loop ``x' = A x + B u - G f(V x + W u)`` is linear but for the friction
f. The input u is a polynomial through Gauss points, f a parabola through three nodes: one matrix
exponential then gives the step, however stiff the loop is, and only the forces at the nodes are
unknown. Nodes at 1/6, 2/3 and 1 are close to those of Radau IIA: a method of order four, A- and
L-stable, so that stiff friction is integrated without spurious oscillation. Nodes and all other
points at which a step is evaluated are multiples of a twelfth of it, so that powers of one
exponential give them all.

Source: Hochbruck and Ostermann (2010), Exponential integrators, section 2.3 (collocation); Van Loan
(1978), Computing integrals involving the matrix exponential.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop, force_channels, set_channels
from headstock.solvers.control.drive_trains import SLIDE, DriveTrain
from headstock.solvers.motion.friction import StackedFriction, stack_laws
from headstock.solvers.second_order import Channel, Positions

type InputRows = Mapping[Channel, FloatArray]
IntArray = NDArray[np.intp]
Given = Callable[[FloatArray], FloatArray]
ABOUT = 4  # tabulated positions around a position, for a cubic
REMEMBERED = 128  # steps of one size in a pose
PARTS = 12
FORCED, CHECKED = (2, 8, 12), (0, 5, 10)  # where friction is collocated, and where it is checked
NODES: FloatArray = np.arange(PARTS + 1, dtype=np.float64) / PARTS
# where inputs are evaluated, as shares of a step
GIVEN: FloatArray = np.asarray(0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0], dtype=np.float64)
LOOKED: FloatArray = np.array([0.01, 0.13, 0.36, 0.64, 0.87, 0.99])  # and where that is checked
_HALF = np.array([41.0, 216.0, 27.0, 272.0, 27.0, 216.0, 41.0]) / (140.0 * PARTS)
# closed Newton-Cotes of degree seven over each half of a step
WEIGHTS: FloatArray = np.concatenate([_HALF[:-1], [2.0 * _HALF[-1]], _HALF[1:]])


@dataclass(frozen=True, eq=False)
class FrictionLoop:
    """Describe the loop ``x' = A x + B S u - G f(V x + W u)``, ``y = C x + D u - H f``.

    The machine's states are ``(s p, p')`` of each mode, so that the work of a load per velocity
    equals its input row. Where states are deviations from a motion, ``W u`` is the guide speed of
    that motion, and works are those of the deviations.

    Attributes:
        loop: Closed loop, with the inputs and those of friction.
        slides: V ``(k, n)``: velocity in these guides.
        drag: G ``(n, k)``.
        feedthrough: H ``(p, k)``.
        acting: B ``(n, m)`` of all inputs but those of friction.
        spread: S ``(m, q)``: these inputs from the time-dependent input u.
        d: D ``(p, q)`` of the time-dependent input.
        pushing: ``(l, q)`` the loads as rows of the time-dependent input.
        reach: ``(l, m)`` motion at the point of each load, per state of the machine.
        weights: ``(m, m)`` of the machine's states in twice the energy.
        dampers: ``(m, m)`` power lost in dampers.
        guides: W ``(k, q)``.
    """

    loop: ClosedLoop
    law: StackedFriction
    slides: FloatArray
    drag: FloatArray
    feedthrough: FloatArray
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
        """Columns ``(n, q)`` of the time-dependent input."""
        return np.asarray(self.acting @ self.spread)

    def stored_energy(self, states: FloatArray) -> FloatArray:
        """Return kinetic and strain energy ``(...)`` [J]."""
        machine = states[..., : self.loop.plant_size]
        return np.asarray(0.5 * np.einsum("...i,...i", machine @ self.weights, machine))


def friction_channels(trains: tuple[DriveTrain, ...]) -> tuple[Channel, ...]:
    """Return the inputs of friction forces, with which a loop has to be closed."""
    return tuple((train.name, SLIDE) for train in trains if train.friction is not None)


def _other_inputs(loop: ClosedLoop) -> tuple[Channel, ...]:
    """Return the inputs of a closed loop except those of friction: set points, then loads."""
    channels = friction_channels(loop.trains)
    return tuple(channel for channel in loop.space.inputs if channel not in channels)


def spread_inputs(inputs: Sequence[Channel], given: InputRows) -> FloatArray:
    """Return the inputs ``(m, q)`` from the row ``(q,)`` of each in the time-dependent input;
    inputs without a row are zero.
    """
    none = np.zeros_like(next(iter(given.values())))
    return np.array([given.get(channel, none) for channel in inputs]).reshape(-1, len(none))


def make_friction_loop(
    loop: ClosedLoop, given: InputRows | None = None, guides: FloatArray | None = None
) -> FrictionLoop:
    """Build the matrices of a loop with friction from a closed loop.

    Args:
        loop: Closed loop with ``friction_channels`` of its drives among its inputs.
        given: Other inputs to their rows ``(q,)`` in the time-dependent input; None for these
            inputs themselves, in their order.
        guides: ``(k, q)`` speed of each guide per time-dependent input; None for guides at rest.

    Raises:
        ValueError: The loop is closed without these channels.
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
        feedthrough=space.d[:, friction_columns],
        acting=space.b[:, acting],
        spread=spread,
        d=space.d[:, acting] @ spread,
        pushing=spread_inputs(loads, given),
        reach=plant.b[:, plant.columns.of(loads)].T,
        weights=weights,
        dampers=dampers,
        guides=np.zeros((len(channels), spread.shape[1])) if guides is None else guides,
    )


@dataclass(frozen=True, eq=False)
class _StepViews:
    """Store the rows of which works in a step are computed, ``(13, r, p)`` at its twelfths, and its
    damping.

    Columns are the state before the step, the inputs and the friction at the nodes, as in
    :class:`FrictionStep`.

    Attributes:
        sliding: Speed in each guide by the states.
        reached: Motion at the point of each load.
        dampers: ``(p, p)`` energy lost in dampers in the step, as a quadratic form.
    """

    sliding: FloatArray
    guides: FloatArray
    drives: FloatArray
    motors: FloatArray
    reached: FloatArray
    loads: FloatArray
    dampers: FloatArray


@dataclass(frozen=True, eq=False)
class FrictionStep:
    """Store a step of one size.

    Attributes:
        size: Duration [s].
        moved: ``(n + 6 k, n + 5 q)`` the state after the step, then speeds in the guides where
            friction is collocated and where it is checked, from the state before it and the inputs.
        pushed: ``(n + 6 k, 3 k)`` the same from the friction at the nodes.
        missed: ``(n, 3 k)`` error of the state by errors of friction at the check points.
        softness: ``(k, k)`` decrease of speeds by constant unit friction over the step.
    """

    size: float
    moved: FloatArray
    pushed: FloatArray
    missed: FloatArray
    softness: FloatArray
    views: _StepViews


def make_friction_step(model: FrictionLoop, size: float) -> FrictionStep:
    """Return the step of a loop over ``size`` seconds."""
    n, k = model.size, len(model.law)
    growth, values, friction = _assemble_growth(model, size)
    part = scipy.linalg.expm(growth / PARTS)
    rows = _view_rows(model, friction, len(growth))
    first = np.concatenate(list(rows.values()))
    inside: FloatArray = np.empty((PARTS + 1, *first.shape))
    inside[0] = first
    for number in range(PARTS):
        inside[number + 1] = inside[number] @ part
    ends = np.cumsum([len(block) for block in rows.values()])[:-1]
    views = dict(zip(rows, np.split(inside @ values, ends, axis=1), strict=True))
    fourth = np.linalg.matrix_power(part, 4)
    end = (fourth[:n] @ fourth) @ fourth @ values
    inner = views["sliding"] + views["guides"]
    looked = np.concatenate([end, *inner[list(FORCED)], *inner[list(CHECKED)]])

    reach: FloatArray = np.empty((PARTS + 1, n, k))
    reach[PARTS] = -size * model.drag
    for number in range(PARTS, 0, -1):
        reach[number - 1] = part[:n, :n] @ reach[number]
    at_checked = _lagrange(NODES[[*FORCED, *CHECKED]], NODES)[:, len(FORCED) :]
    missed = np.einsum("j,jc,jnk->nck", WEIGHTS, at_checked, reach).reshape(n, -1)
    over = looked[n + 2 * k : n + 3 * k, friction:]
    speeds = views.pop("speeds")
    weighed = (model.dampers @ speeds) * (size * WEIGHTS[:, None, None])
    flat = (len(first[0]),)
    return FrictionStep(
        size=size,
        moved=np.ascontiguousarray(looked[:, :friction]),
        pushed=np.ascontiguousarray(looked[:, friction:]),
        missed=missed,
        softness=-over.reshape(k, len(FORCED), k).sum(axis=1),
        views=_StepViews(**views, dampers=speeds.reshape(-1, *flat).T @ weighed.reshape(-1, *flat)),
    )


def _assemble_growth(model: FrictionLoop, size: float) -> tuple[FloatArray, FloatArray, int]:
    """Return the matrix whose exponential is a step of states, inputs and friction, the matrix from
    nodal values to its variables, and the index of the first friction variable.

    Polynomials are represented by their derivatives, each of which is the rate of the one
    before.
    """
    n, q, k = model.size, model.b.shape[1], len(model.law)
    friction = n + len(GIVEN) * q
    whole = friction + len(FORCED) * k
    growth, values = np.zeros((whole, whole)), np.eye(whole)
    growth[:n, :n] = size * model.loop.space.a
    growth[:n, n : n + q] = size * model.acting @ model.spread
    growth[:n, friction : friction + k] = -size * model.drag
    growth[n : friction - q, n + q : friction] = np.eye(friction - q - n)
    growth[friction : whole - k, friction + k :] = np.eye(whole - k - friction)
    values[n:friction, n:friction] = np.kron(_derivatives(GIVEN), np.eye(q))
    values[friction:, friction:] = np.kron(_derivatives(NODES[list(FORCED)]), np.eye(k))
    return growth, values, friction


def _view_rows(model: FrictionLoop, friction: int, whole: int) -> dict[str, FloatArray]:
    """Return the rows ``(r, whole)`` of which works are computed, by the fields of
    :class:`_StepViews`, and of the machine's states.
    """
    space, machine = model.loop.space, slice(0, model.loop.plant_size)
    forces = space.rows.of(force_channels(model.loop.trains))
    states, given = slice(0, model.size), slice(model.size, model.size + model.b.shape[1])
    parts: dict[str, list[tuple[slice, FloatArray]]] = {
        "sliding": [(states, model.slides)],
        "guides": [(given, model.guides)],
        "drives": [
            (states, space.c[forces]),
            (given, model.d[forces]),
            (slice(friction, friction + len(model.law)), -model.feedthrough[forces]),
        ],
        "motors": [(states, model.loop.rates)],
        "reached": [(machine, model.reach)],
        "loads": [(given, model.pushing)],
        "speeds": [(machine, np.eye(model.loop.plant_size))],
    }
    rows: dict[str, FloatArray] = {
        name: np.zeros((len(blocks[0][1]), whole)) for name, blocks in parts.items()
    }
    for name, blocks in parts.items():
        for columns, block in blocks:
            rows[name][:, columns] = block
    return rows


def _derivatives(nodes: FloatArray) -> FloatArray:
    """Return the derivatives ``(m, m)`` at zero of a polynomial by its nodal values ``(m,)``."""
    factorials = np.array([math.factorial(order) for order in range(len(nodes))], dtype=float)
    return np.asarray(np.linalg.inv(np.vander(nodes, increasing=True) / factorials))


def _lagrange(nodes: FloatArray, places: FloatArray) -> FloatArray:
    """Return the Lagrange polynomials of nodes at places ``(p, m)``."""
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    return np.asarray(np.vander(places, len(nodes), increasing=True) @ inverse)


LOOKS: FloatArray = _lagrange(GIVEN, LOOKED)


CHECKS: FloatArray = _lagrange(NODES[list(FORCED)], NODES[list(CHECKED)])


@functools.lru_cache(maxsize=64)
def continue_forces(ratio: float) -> FloatArray:
    """Return the matrix ``(3, 3)`` that extrapolates friction at the nodes from the step before, by
    its parabola.

    Args:
        ratio: Size of the step over that of the one before.
    """
    nodes = NODES[list(FORCED)]
    return _lagrange(nodes, 1.0 + ratio * nodes)


@functools.lru_cache(maxsize=4096)
def narrow_given(level: int, number: int) -> FloatArray:
    """Return the matrix ``(5, 5)`` from the inputs of a step to those of one of its ``2**level``
    equal parts.
    """
    return _lagrange(GIVEN, (number + GIVEN) * 0.5**level)


@dataclass(frozen=True, eq=False)
class LoopTrack:
    """Describe a loop that may change along a path: cubics between tabulated positions.

    Attributes:
        places: ``(p,)`` tabulated positions, rising, one or at least four [m].
        positions: Returns positions at times ``(n,)`` [m].
        rows: Indices of the outputs that are wanted; None for all.
    """

    places: FloatArray
    loop_at: Callable[[float], FrictionLoop]
    positions: Given
    rows: Positions | None = None
    _loops: dict[int, FrictionLoop] = field(default_factory=dict)
    _steps: dict[tuple[int, str], FrictionStep] = field(default_factory=dict)

    @property
    def still(self) -> bool:
        """True where the loop does not change."""
        return len(self.places) == 1

    def loop(self, number: int) -> FrictionLoop:
        """Return the loop at one of the tabulated positions."""
        if number not in self._loops:
            self._loops[number] = self.loop_at(float(self.places[number]))
        return self._loops[number]

    def step(self, number: int, size: float) -> FrictionStep:
        """Return the step of a size at one of the tabulated positions."""
        key = number, f"{size:.9e}"
        if key not in self._steps:
            forget(self._steps)
            self._steps[key] = make_friction_step(self.loop(number), size)
        return self._steps[key]

    def near(self, positions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the tabulated positions around positions ``(n,)``: the first of each, and the
        shares ``(n, 4)`` of it and the next ones in a cubic through them.
        """
        if self.still:
            return np.zeros(len(positions), dtype=np.intp), np.ones((len(positions), 1))
        left = np.searchsorted(self.places, positions, side="right") - 1
        firsts = np.clip(left - 1, 0, len(self.places) - ABOUT)
        neighbours = self.places[firsts[:, None] + np.arange(ABOUT)]
        shares = np.ones((len(positions), ABOUT))
        for column in range(ABOUT):
            for other in set(range(ABOUT)) - {column}:
                to_other = positions - neighbours[:, other]
                shares[:, column] *= to_other / (neighbours[:, column] - neighbours[:, other])
        return firsts, shares

    def blend(
        self, positions: FloatArray, find: Callable[[FrictionLoop, slice | IntArray], FloatArray]
    ) -> FloatArray:
        """Return values ``(n, ...)`` of loops, interpolated to positions ``(n,)``.

        Args:
            positions: Positions [m].
            find: Returns the values of a loop at the positions with given indices.
        """
        if self.still:
            return find(self.loop(0), slice(None))
        firsts, shares = self.near(positions)
        parts, places = [], []
        for first in np.unique(firsts):
            which = np.flatnonzero(firsts == first)
            values = [find(self.loop(int(first) + column), which) for column in range(ABOUT)]
            parts.append(np.einsum("np,pn...->n...", shares[which], np.array(values)))
            places.append(which)
        return np.asarray(np.concatenate(parts)[np.argsort(np.concatenate(places))])


def forget[K, V](memory: dict[K, V]) -> None:
    """Drop the oldest entries of a cache that is too large."""
    if len(memory) >= REMEMBERED:
        del memory[next(iter(memory))]


def still_track(model: FrictionLoop) -> LoopTrack:
    """Return the track of a loop that does not change."""
    return LoopTrack(np.zeros(1), lambda place: model, np.zeros_like)
