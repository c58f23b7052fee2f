"""Steps of a closed loop with friction, one after the other: forces at their nodes by Newton's method,
each step halved until friction is the parabola that it is taken for, and the works in them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgesv

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.motion.friction import evaluate_friction
from headstock.solvers.motion.friction_loop import (
    CHECKS,
    FORCED,
    GIVEN,
    LOOKED,
    LOOKS,
    WEIGHTS,
    FrictionLoop,
    FrictionStep,
    Given,
    LoopTrack,
    continue_forces,
    forget,
    make_friction_step,
    narrow_given,
)

CHUNK = 512  # steps whose works are found together
SAME_STEP = 1e-9
BENT = 1e-4  # what a polynomial through what is given may miss of it, for a step of full length
MOST_CUTS = 20
FEW_STEPS = 8  # of one size along a path: they are made in their own poses
EASY = 0.02  # share of the tolerance below which the next step may be twice as long
MOST_HALVINGS = 40
MOST_PASSES = 12
SETTLED = 0.02  # share of the tolerance that Newton's method may leave
MOST_RATIO = 4.0  # of the size of a step to that of the one before, whose friction it continues
WORKS = ("drives", "loads", "damping", "friction")


def cut_steps(
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


def find_rare_sizes(steps: FloatArray) -> BoolArray:
    """Find the steps of a size that hardly any other has."""
    _, which, counts = np.unique(
        np.round(steps / steps.max(), 9), return_inverse=True, return_counts=True
    )
    return np.asarray(counts[which] < FEW_STEPS)


@dataclass(frozen=True, eq=False)
class _Stack:
    """Steps of one size in ``p`` poses, between which they are mixed.

    Attributes:
        moved: ``(p r, c)`` of all, one below the other.
        pushed: ``(p, r, 3 k)``.
        missed: ``(p, n, 3 k)``.
        push: How far one newton of friction all over a step moves any state, of what is allowed.
        miss: The same of what it is off where it is checked.
    """

    steps: tuple[FrictionStep, ...]
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


class FrictionIntegrator:
    """Steps one after the other, each halved until friction is followed."""

    def __init__(self, track: LoopTrack, typical: FrictionLoop, allowed: FloatArray) -> None:
        """Steps of a loop, with errors that are allowed of each state ``(n,)``."""
        self._track, self._allowed = track, allowed
        self._laws, self._size, self._count = typical.law, typical.size, len(typical.law)
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
            acting = np.concatenate([state, now])
            attempt = self._attempt(mixtures[level], acting)
            if attempt is None:
                level, part = level + 1, 2 * part
                if level > MOST_HALVINGS:
                    raise ConvergenceError(
                        "friction does not settle in any step; give it a larger smoothing, or the machine some damping"
                    )
                continue
            state, forces, missed = attempt
            acting = np.concatenate([acting, forces])
            self._taken.append(_Taken(number, mixtures[level], acting))
            self._forces, self._last = forces.reshape(self._forces.shape), mixtures[level].size
            part += 1
            if level and part % 2 == 0 and missed < EASY:
                level, part = level - 1, part // 2
        self._level = level
        return state

    def _mix(
        self, size: float, near: tuple[int, FloatArray], lone: FrictionLoop | None
    ) -> _Mixture:
        """The step of a size about a position."""
        if lone is not None:
            return self._pile(make_friction_step(lone, size)).mix(np.ones(1))
        first, shares = near
        key = first, f"{size:.9e}"
        if key not in self._stacks:
            forget(self._stacks)
            places = range(first, first + len(shares))
            self._stacks[key] = self._pile(*(self._track.step(pose, size) for pose in places))
        return self._stacks[key].mix(shares)

    def _pile(self, *steps: FrictionStep) -> _Stack:
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
            friction_forces, slopes = evaluate_friction(self._laws, speeds)
            off = friction_forces[: len(FORCED)].ravel() - forces
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
        missed = friction_forces[len(FORCED) :] - CHECKS @ forces.reshape(self._forces.shape)
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
        works = np.zeros((count, len(WORKS)))
        alike: dict[int, list[_Taken]] = {}
        for taken in self._taken:
            alike.setdefault(id(taken.mixture.stack), []).append(taken)
        for group in alike.values():
            acting = np.array([taken.known for taken in group])
            shares = np.array([taken.mixture.shares for taken in group])
            numbers = np.array([taken.number for taken in group])
            steps = group[0].mixture.stack.steps
            np.add.at(works, numbers, self._find_works(steps, shares, acting))
        self.steps += len(self._taken)
        self._taken = []
        return works

    def _find_works(
        self, steps: Sequence[FrictionStep], shares: FloatArray, known: FloatArray
    ) -> FloatArray:
        """Works ``(m, 4)`` of steps that are mixtures of the same ones."""

        def view(name: str) -> FloatArray:
            """``(m, 13, r)``."""
            total: FloatArray = np.zeros((1, 1, 1))
            for number, step in enumerate(steps):
                rows = getattr(step.views, name)
                part = (known @ rows.reshape(-1, rows.shape[-1]).T).reshape(
                    len(known), *rows.shape[:2]
                )
                total = total + shares[:, number, None, None] * part
            return total

        sliding = view("sliding")
        friction_forces, _ = evaluate_friction(self._laws, sliding + view("guides"))
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
                (friction_forces * sliding).sum(axis=2) @ weights,
            ]
        )
