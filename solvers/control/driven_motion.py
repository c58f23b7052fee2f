"""A machine under control in time, with friction in its guides, and where the energy went.

Steps are exact but for friction (``rubbing_steps``). They are as long as what is given and the natural
modes allow, and are halved where friction changes faster than its parabola follows.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgesv

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop
from headstock.solvers.control.friction_loop import (
    RubbingLoop,
    make_rubbing_loop,
    rub,
)
from headstock.solvers.control.rubbing_steps import (
    CHECKS,
    FORCED,
    GIVEN,
    LOOKED,
    LOOKS,
    WEIGHTS,
    RubbingStep,
    continue_forces,
    make_rubbing_step,
    narrow_given,
)
from headstock.solvers.errors import ConvergenceError

TOLERANCE = 1e-10  # error of a step by friction, as a share of the size of each kind of state
EASY = 0.02  # share of the tolerance below which the next step may be twice as long
MOST_HALVINGS = 40
MOST_PASSES = 12
SETTLED = 0.02  # share of the tolerance that Newton's method may leave
ANGLE = 8.0  # of the fastest natural mode in a step [rad]: works are integrated inside it
PROBES = 2000
ABOUT = 4  # places about a position, between which a cubic is laid
REMEMBERED = 128  # steps of one size in a pose
CHUNK = 512  # steps whose works are found together
SAME_STEP = 1e-9
BENT = 1e-4  # what a polynomial through what is given may miss of it, for a step of full length
MOST_CUTS = 20
FEW_STEPS = 8  # of one size along a path: they are made in their own poses
MOST_RATIO = 4.0  # of the size of a step to that of the one before, whose friction it continues

IntArray = NDArray[np.intp]
Given = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energies over time ``(n,)`` [J], counted from the start.

    Attributes:
        stored: Kinetic and strain energy of the machine.
        drives: Work of the drive forces.
        loads: Work of the loads.
        damping: Lost in dampers.
        friction: Lost in the guides.
        pose: Work of a change of pose.
    """

    stored: FloatArray
    drives: FloatArray
    loads: FloatArray
    damping: FloatArray
    friction: FloatArray
    pose: FloatArray

    @property
    def error(self) -> float:
        """Largest energy that is missing, over the largest that is stored, was put in or lost."""
        missing = (
            self.stored
            - self.stored[0]
            - self.drives
            - self.loads
            - self.pose
            + self.damping
            + self.friction
        )
        every = (
            self.stored,
            self.drives,
            self.loads,
            self.damping,
            self.friction,
            self.pose,
        )
        size = max(float(np.abs(part).max()) for part in every)
        return float(np.abs(missing).max()) / size if size > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """What a controlled machine did.

    Attributes:
        times: ``(n,)`` [s].
        left: ``(n, m)`` states just before each time.
        right: ``(n, m)`` and just after it: an impulse is between them.
        outputs: ``(n, p)`` of the closed loop, just after each time.
        friction: ``(n, k)`` force against the motion there [N].
        energy: Where it went.
        steps: How many were taken.
    """

    times: FloatArray
    left: FloatArray
    right: FloatArray
    outputs: FloatArray
    friction: FloatArray
    energy: EnergyBalance
    steps: int


@dataclass(frozen=True, eq=False)
class Outset:
    """How a motion begins that does not begin from rest, and what strikes it on its way.

    Attributes:
        state: ``(m,)`` before the first time.
        jumps: ``(n, m)`` of the state at each time, by impulses.
        sizes: ``(p, m)`` states as large as those to be expected.
    """

    state: FloatArray
    jumps: FloatArray
    sizes: FloatArray


@dataclass(frozen=True, eq=False)
class LoopTrack:
    """A loop that may change along a path; between known places its matrices are cubics.

    Attributes:
        places: ``(p,)`` rising, one or at least four [m].
        loop_at: The loop at a place.
        positions: Where it is at times ``(n,)`` [m].
        rows: Which of its outputs are wanted; None for all.
    """

    places: FloatArray
    loop_at: Callable[[float], RubbingLoop]
    positions: Given
    rows: Sequence[int] | None = None
    _loops: dict[int, RubbingLoop] = field(default_factory=dict)
    _steps: dict[tuple[int, str], RubbingStep] = field(default_factory=dict)

    @property
    def still(self) -> bool:
        """Nothing changes."""
        return len(self.places) == 1

    def loop(self, number: int) -> RubbingLoop:
        """The loop at one of the places."""
        if number not in self._loops:
            self._loops[number] = self.loop_at(float(self.places[number]))
        return self._loops[number]

    def step(self, number: int, size: float) -> RubbingStep:
        """Its step there."""
        key = number, f"{size:.9e}"
        if key not in self._steps:
            forget(self._steps)
            self._steps[key] = make_rubbing_step(self.loop(number), size)
        return self._steps[key]

    def near(self, positions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Places about positions, see :func:`near_places`."""
        if self.still:
            return np.zeros(len(positions), dtype=np.intp), np.ones((len(positions), 1))
        return near_places(self.places, positions)

    def blend(
        self, positions: FloatArray, find: Callable[[RubbingLoop, slice | IntArray], FloatArray]
    ) -> FloatArray:
        """What loops say ``(n, ...)`` at positions ``(n,)``.

        Args:
            positions: Where [m].
            find: What a loop says, of those of the positions that are named.
        """
        if self.still:
            return find(self.loop(0), slice(None))
        firsts, shares = self.near(positions)
        parts, places = [], []
        for first in np.unique(firsts):
            which = np.flatnonzero(firsts == first)
            own = [find(self.loop(int(first) + column), which) for column in range(ABOUT)]
            parts.append(np.einsum("np,pn...->n...", shares[which], np.array(own)))
            places.append(which)
        return np.asarray(np.concatenate(parts)[np.argsort(np.concatenate(places))])


def near_places(places: FloatArray, positions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Places about positions ``(n,)``: the first of each, and the share ``(n, 4)`` that it and the next
    ones have in a cubic through them.
    """
    left = np.searchsorted(places, positions, side="right") - 1
    firsts = np.clip(left - 1, 0, len(places) - ABOUT)
    known = places[firsts[:, None] + np.arange(ABOUT)]
    shares = np.ones((len(positions), ABOUT))
    for own in range(ABOUT):
        for other in set(range(ABOUT)) - {own}:
            to_other = positions - known[:, other]
            shares[:, own] *= to_other / (known[:, own] - known[:, other])
    return firsts, shares


def forget[K, V](known: dict[K, V]) -> None:
    """Drop what has been known longest where that is much."""
    if len(known) >= REMEMBERED:
        del known[next(iter(known))]


def still_track(model: RubbingLoop) -> LoopTrack:
    """The track of a loop that does not change."""
    return LoopTrack(np.zeros(1), lambda place: model, np.zeros_like)


def solve_motion(
    loop: ClosedLoop,
    given: Given,
    times: FloatArray,
    *,
    spread: FloatArray | None = None,
    breaks: FloatArray | None = None,
    longest: float = np.inf,
    tolerance: float = TOLERANCE,
) -> DrivenMotion:
    """Motion from rest under set points and loads, with the friction of every drive that has one.

    Args:
        loop: Closed with the given loads, then ``friction_channels`` of its drives, as inputs.
        given: What is given ``(n, q)`` at times ``(n,)``.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        spread: ``(m, q)`` set points, then loads, of what is given; None for these themselves.
        breaks: Instants at which what is given jumps or kinks: no step reaches over one.
        longest: Over which what is given is a polynomial of degree four [s].
        tolerance: Of a step.

    Raises:
        ConvergenceError: Friction does not settle.
    """
    track = still_track(make_rubbing_loop(loop, spread))
    return integrate_motion(
        track, given, times, breaks=breaks, longest=longest, tolerance=tolerance
    )


def integrate_motion(
    track: LoopTrack,
    given: Given,
    times: FloatArray,
    *,
    breaks: FloatArray | None = None,
    outset: Outset | None = None,
    longest: float = np.inf,
    tolerance: float = TOLERANCE,
) -> DrivenMotion:
    """The same of a loop that may change along a path, and from any state.

    A step is that of the pose at its middle. Works are integrated inside every step, that of friction
    by its law, so that their balance tells what the parabolas miss.

    Args:
        track: The loop.
        given: What is given ``(n, q)`` at times ``(n,)``.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        breaks: Instants at which what is given jumps or kinks: no step reaches over one.
        outset: How it begins; None for rest.
        longest: Over which what is given is a polynomial of degree four [s].
        tolerance: Of a step.

    Raises:
        ConvergenceError: Friction does not settle.
    """
    times = np.asarray(times, dtype=float)
    typical = track.loop(len(track.places) // 2)
    if outset is None:
        sizes = _coarse_states(typical, given, times)
        outset = Outset(np.zeros(typical.size), np.zeros((len(times), typical.size)), sizes)
    allowed = tolerance * _state_scale(typical, outset.sizes, float(times[-1] - times[0]))
    grid = _cut_steps(times, breaks, given, min(longest, ANGLE / _fastest_mode(typical)))
    wanted = np.searchsorted(grid, times)
    kept = {int(place): number for number, place in enumerate(wanted)}
    left = np.empty((len(times), typical.size))
    right = np.empty_like(left) if outset.jumps.any() else left
    works, posed = np.zeros((len(grid), len(WORKS))), np.zeros(len(grid))
    steps, march = np.diff(grid), _March(track, typical, allowed)
    few = _rare_sizes(steps) & (not track.still)
    state = outset.state
    for start in range(0, len(steps), CHUNK):
        part = slice(start, min(start + CHUNK, len(steps)))
        inside = grid[part, None] + steps[part, None] * GIVEN
        forced = given(inside.ravel()).reshape(len(inside), -1)
        middles = track.positions(0.5 * (grid[part] + grid[part.start + 1 : part.stop + 1]))
        firsts, shares = track.near(middles)
        begun, ended = (np.empty((len(inside), typical.size)) for _ in range(2))
        for number in range(len(inside)):
            if part.start + number in kept:
                place = kept[part.start + number]
                left[place] = state
                state = right[place] = state + outset.jumps[place]
            begun[number] = state
            state = ended[number] = march.advance(
                number,
                state,
                forced[number],
                size=float(steps[part.start + number]),
                near=(int(firsts[number]), shares[number]),
                alone=float(middles[number]) if few[part.start + number] else None,
            )
        works[part.start + 1 : part.stop + 1] = march.collect_works(len(inside))
        if not track.still:
            ends = grid[part.start + 1 : part.stop + 1]
            posed[part.start + 1 : part.stop + 1] = (
                _stored(track, middles, begun)
                - _stored(track, track.positions(grid[part]), begun)
                + _stored(track, track.positions(ends), ended)
                - _stored(track, middles, ended)
            )
    left[-1] = state
    right[-1] = state + outset.jumps[-1]
    positions = track.positions(times)
    stored = _stored(track, positions, right)
    # what impulses add is work of the loads; works count from just after the first time
    struck = np.cumsum(
        np.where(np.arange(len(times)) > 0, stored - _stored(track, positions, left), 0.0)
    )
    drives, loads, damping, friction = np.cumsum(works, axis=0)[wanted].T
    rubbed, outputs = _observe(track, positions, right, given(times))
    return DrivenMotion(
        times=times,
        left=left,
        right=right,
        outputs=outputs,
        friction=rubbed,
        energy=EnergyBalance(
            stored, drives, loads + struck, damping, friction, np.cumsum(posed)[wanted]
        ),
        steps=march.steps,
    )


WORKS = ("drives", "loads", "damping", "friction")


@dataclass(frozen=True, eq=False)
class _Stack:
    """Steps of one size in ``p`` poses, between which they are mixed.

    Attributes:
        steps: In these poses.
        moved: ``(p r, c)`` of all, one below the other.
        pushed: ``(p, r, 3 k)``.
        missed: ``(p, n, 3 k)``.
        push: How far one newton of friction all over a step moves any state, of what is allowed.
        miss: The same of what it is off where it is checked.
    """

    steps: tuple[RubbingStep, ...]
    moved: FloatArray
    pushed: FloatArray
    missed: FloatArray
    push: float
    miss: float

    def mix(self, shares: FloatArray) -> "_Mixture":
        """A pose among these, by the share ``(p,)`` of each."""
        pushed = self.pushed[0] if len(shares) == 1 else np.tensordot(shares, self.pushed, 1)
        return _Mixture(self, shares, np.asarray(pushed))


@dataclass(frozen=True, eq=False)
class _Mixture:
    """A step in a pose, with what friction does in it ``(r, 3 k)``."""

    stack: _Stack
    shares: FloatArray
    pushed: FloatArray

    @property
    def size(self) -> float:
        """[s]."""
        return self.stack.steps[0].size

    def move(self, known: FloatArray) -> FloatArray:
        """Motion ``(r,)`` without friction, of the state before and what is given ``(c,)``."""
        moved = self.stack.moved @ known
        return moved if len(self.shares) == 1 else self.shares @ moved.reshape(len(self.shares), -1)

    def miss(self, off: FloatArray) -> FloatArray:
        """Error ``(n,)`` of the state where friction is off by ``(3 k,)`` where it is checked."""
        return np.asarray(self.shares @ (self.stack.missed @ off))


@dataclass(frozen=True, eq=False)
class _Taken:
    """A step that was taken, in one of those of the grid: from which state, given and friction."""

    number: int
    mixture: _Mixture
    known: FloatArray


class _March:
    """Steps one after the other, each halved until friction is followed."""

    def __init__(self, track: LoopTrack, typical: RubbingLoop, allowed: FloatArray) -> None:
        """Steps of a loop, with errors that are allowed of each state ``(n,)``."""
        self._track, self._allowed = track, allowed
        self._laws, self._size, self._count = typical.stacked, typical.size, len(typical.laws)
        self._level, self._last = 0, math.inf
        self._forces: FloatArray = np.zeros((len(FORCED), self._count))
        self._unit: FloatArray = np.eye(len(FORCED) * self._count)
        self._stacks: dict[tuple[int, str], _Stack] = {}
        self._taken: list[_Taken] = []
        self.steps = 0

    def advance(
        self,
        number: int,
        state: FloatArray,
        given: FloatArray,
        *,
        size: float,
        near: tuple[int, FloatArray],
        alone: float | None,
    ) -> FloatArray:
        """The state after a step of the grid.

        Args:
            number: Of the step.
            state: Before it.
            given: ``(5 q,)`` in it.
            size: Of it [s].
            near: First place about its middle, and the share of it and the next ones.
            alone: Its middle, where its matrices are made in its own pose [m]; None elsewhere.

        Raises:
            ConvergenceError: Friction does not settle.
        """
        level, part = max(self._level - 1, 0), 0
        mixtures: dict[int, _Mixture] = {}
        lone = None if alone is None else self._track.loop_at(alone)
        while part < 2**level:
            if level not in mixtures:
                mixtures[level] = self._mix(0.5**level * size, near, lone)
            now = given
            if level:
                now = (narrow_given(level, part) @ given.reshape(len(GIVEN), -1)).ravel()
            known = np.concatenate([state, now])
            found = self._attempt(mixtures[level], known)
            if found is None:
                level, part = level + 1, 2 * part
                if level > MOST_HALVINGS:
                    raise ConvergenceError(
                        "friction does not settle in any step; give it a larger smoothing, or the machine some damping"
                    )
                continue
            state, forces, missed = found
            known = np.concatenate([known, forces])
            self._taken.append(_Taken(number, mixtures[level], known))
            self._forces, self._last = forces.reshape(self._forces.shape), mixtures[level].size
            part += 1
            if level and part % 2 == 0 and missed < EASY:
                level, part = level - 1, part // 2
        self._level = level
        return state

    def _mix(self, size: float, near: tuple[int, FloatArray], lone: RubbingLoop | None) -> _Mixture:
        """The step of a size about a position."""
        if lone is not None:
            return self._pile(make_rubbing_step(lone, size)).mix(np.ones(1))
        first, shares = near
        key = first, f"{size:.9e}"
        if key not in self._stacks:
            forget(self._stacks)
            places = range(first, first + len(shares))
            self._stacks[key] = self._pile(*(self._track.step(place, size) for place in places))
        return self._stacks[key].mix(shares)

    def _pile(self, *steps: RubbingStep) -> _Stack:
        pushed, missed = (
            np.stack(parts)
            for parts in ([step.pushed for step in steps], [step.missed for step in steps])
        )
        push, miss = (
            float((np.abs(part).sum(axis=1) / self._allowed).max(initial=0.0))
            for part in (pushed[0, : self._size], missed[0])
        )
        moved = np.concatenate([step.moved for step in steps])
        return _Stack(steps, moved, pushed, missed, push, miss)

    def _attempt(
        self, step: _Mixture, known: FloatArray
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """State and friction ``(3 k,)`` after a step, and its error of what is allowed; None where that
        is too large.
        """
        free, pushed, stack = step.move(known), step.pushed, step.stack
        if not self._count:
            return free, np.zeros(0), 0.0
        ratio = min(step.size / self._last, MOST_RATIO)
        forces = (continue_forces(round(ratio, 6)) @ self._forces).ravel()
        inner = pushed[self._size : self._size + len(forces)]
        for _ in range(MOST_PASSES):
            moved = free + pushed @ forces
            speeds = moved[self._size :].reshape(-1, self._count)
            rubbed, slopes = rub(self._laws, speeds)
            off = rubbed[: len(FORCED)].ravel() - forces
            if np.abs(off).max() * stack.push <= SETTLED:
                break
            # forces that the law has at the speeds to which they lead, by Newton's method
            steep = slopes[: len(FORCED)].reshape(-1, 1)
            change = dgesv(self._unit - steep * inner, off)[2]
            forces = forces + change
            if np.abs(change).max() * stack.push <= SETTLED:
                moved = moved + pushed @ change
                break
        else:
            return None
        missed = rubbed[len(FORCED) :] - CHECKS @ forces.reshape(self._forces.shape)
        error = float(np.abs(missed).max()) * stack.miss
        if error > EASY:
            error = float((np.abs(step.miss(missed.ravel())) / self._allowed).max())
        if error > 1.0:
            # a stiff law makes much of little speeds; what is off is what it would be if they gave way
            soft = slopes[len(FORCED) :, :, None] * stack.steps[0].softness
            eased = np.linalg.solve(np.eye(self._count) + soft, missed[:, :, None])
            error = float((np.abs(step.miss(np.ravel(eased))) / self._allowed).max())
        return None if error > 1.0 else (moved[: self._size], forces, error)

    def collect_works(self, count: int) -> FloatArray:
        """Works ``(count, 4)`` in the steps of the grid since it was last asked."""
        found = np.zeros((count, len(WORKS)))
        alike: dict[int, list[_Taken]] = {}
        for taken in self._taken:
            alike.setdefault(id(taken.mixture.stack), []).append(taken)
        for group in alike.values():
            known = np.array([taken.known for taken in group])
            shares = np.array([taken.mixture.shares for taken in group])
            numbers = np.array([taken.number for taken in group])
            steps = group[0].mixture.stack.steps
            np.add.at(found, numbers, self._find_works(steps, shares, known))
        self.steps += len(self._taken)
        self._taken = []
        return found

    def _find_works(
        self, steps: Sequence[RubbingStep], shares: FloatArray, known: FloatArray
    ) -> FloatArray:
        """Works ``(m, 4)`` of steps that are mixtures of the same ones."""

        def view(name: str) -> FloatArray:
            """``(m, 13, r)``."""
            total: FloatArray = np.zeros((1, 1, 1))
            for number, step in enumerate(steps):
                rows = getattr(step.views, name)
                seen = (known @ rows.reshape(-1, rows.shape[-1]).T).reshape(
                    len(known), *rows.shape[:2]
                )
                total = total + shares[:, number, None, None] * seen
            return total

        sliding = view("sliding")
        rubbed, _ = rub(self._laws, sliding + view("guides"))
        damped = sum(
            shares[:, number] * np.einsum("mi,mi->m", known @ step.views.dampers, known)
            for number, step in enumerate(steps)
        )
        weights = steps[0].size * WEIGHTS
        return np.column_stack(
            [
                (view("drives") * view("motors")).sum(axis=2) @ weights,
                (view("reached") * view("loads")).sum(axis=2) @ weights,
                damped,
                (rubbed * sliding).sum(axis=2) @ weights,
            ]
        )


def _cut_steps(
    times: FloatArray, breaks: FloatArray | None, given: Given, longest: float
) -> FloatArray:
    """Steps that end at times and breaks, none longer than asked, and shorter where what is given is
    not the polynomial that it is taken for.
    """
    inner = np.zeros(0) if breaks is None else breaks[(breaks > times[0]) & (breaks < times[-1])]
    nearest = np.abs(inner[:, None] - times).min(axis=1, initial=np.inf)
    inner = inner[nearest > SAME_STEP * (times[-1] - times[0])]
    stops = np.unique(np.concatenate([times, inner]))
    parts = np.maximum(1, np.ceil(np.diff(stops) / longest - SAME_STEP)).astype(np.intp)
    begins, offsets = np.repeat(np.arange(len(parts)), parts), np.cumsum(parts) - parts
    within = (np.arange(parts.sum()) - np.repeat(offsets, parts)) / np.repeat(parts, parts)
    grid = np.append(stops[begins] + within * np.diff(stops)[begins], stops[-1])
    sizes = np.zeros(1)
    added, looked = [grid], np.column_stack([grid[:-1], np.diff(grid)])
    for halving in range(MOST_CUTS):
        missed = np.zeros(len(looked))
        for start in range(0, len(looked), CHUNK):
            begin, size = looked[start : start + CHUNK].T[:, :, None]
            places = np.concatenate([GIVEN, LOOKED])
            values = given((begin + size * places).ravel()).reshape(len(begin), len(places), -1)
            sizes = np.maximum(sizes, np.abs(values).max(axis=(0, 1)))
            off = values[:, len(GIVEN) :] - LOOKS @ values[:, : len(GIVEN)]
            share = np.abs(off) / np.where(sizes > 0.0, sizes, 1.0)
            missed[start : start + CHUNK] = share.max(axis=(1, 2), initial=0.0)
        # what is off acts while the step lasts
        halves = looked[0.5**halving * missed > BENT] * np.array([1.0, 0.5])
        if not len(halves):
            break
        looked = np.concatenate([halves, halves @ np.array([[1.0, 0.0], [1.0, 1.0]])])
        added.append(halves.sum(axis=1))
    return np.sort(np.concatenate(added))


def _rare_sizes(steps: FloatArray) -> BoolArray:
    """Which steps have a size that hardly any other has."""
    _, which, counts = np.unique(
        np.round(steps / steps.max(), 9), return_inverse=True, return_counts=True
    )
    return np.asarray(counts[which] < FEW_STEPS)


def _stored(track: LoopTrack, positions: FloatArray, states: FloatArray) -> FloatArray:
    """Stored energy ``(n,)`` of states in their poses."""
    return track.blend(positions, lambda model, which: model.stored_energy(states[which]))


def _observe(
    track: LoopTrack, positions: FloatArray, states: FloatArray, given: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Friction ``(n, k)`` and outputs ``(n, p)``."""
    rubbed = track.loop(0).friction(
        track.blend(
            positions,
            lambda model, which: states[which] @ model.slides.T + given[which] @ model.guides.T,
        )
    )

    def outputs(model: RubbingLoop, which: slice | IntArray) -> FloatArray:
        space, rows = model.loop.space, slice(None) if track.rows is None else track.rows
        return np.asarray(
            states[which] @ space.c[rows].T
            + given[which] @ (space.d[rows, : model.given] @ model.spread).T
            - rubbed[which] @ space.d[rows, model.given :].T
        )

    return rubbed, track.blend(positions, outputs)


def _fastest_mode(model: RubbingLoop) -> float:
    """Of the machine with free motors [rad/s]."""
    return float(np.abs(np.linalg.eigvals(model.loop.plant.a).imag).max(initial=1e-9))


def _coarse_states(model: RubbingLoop, given: Given, times: FloatArray) -> FloatArray:
    """States ``(p, m)`` of a coarse linear run from rest without friction."""
    instants = np.linspace(times[0], times[-1], PROBES)
    step = float(instants[1] - instants[0])
    # implicit Euler: rough and never unstable; only sizes are wanted
    solve = np.linalg.inv(np.eye(model.size) - step * model.loop.space.a)
    pushes = step * given(instants) @ (model.loop.space.b[:, : model.given] @ model.spread).T
    state: FloatArray = np.zeros(model.size)
    states = np.zeros((PROBES, model.size))
    for number, push in enumerate(pushes):
        state = solve @ (state + push)
        states[number] = state
    return states


def _state_scale(model: RubbingLoop, states: FloatArray, duration: float) -> FloatArray:
    """How large each kind of state gets ``(m,)``, from states ``(p, m)`` as large."""
    machine = model.loop.plant_size
    dry = sum(max(law.coulomb, law.breakaway) for law in model.laws)
    energy = float(model.stored_energy(states).max(initial=0.0))
    slid = float(np.abs(states @ model.slides.T).max(initial=0.0))
    energy = max(energy, dry * slid * duration, 1e-12)
    scale: FloatArray = np.full(model.size, np.sqrt(2.0 * energy))
    scale[machine:] = max(float(np.abs(states[:, machine:]).max(initial=0.0)), dry, 1e-6)
    return scale
