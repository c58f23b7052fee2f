"""Time steps of a closed loop with friction: forces at their nodes by Newton's method, each step
halved until a parabola represents the friction in it, and the works in them.
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
BENT = 1e-4  # tolerance of the polynomial through the inputs, for a step of full length
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
    """Return steps that end at times and breaks, none longer than asked, and shorter where the
    inputs are not represented by a polynomial.
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
        # the error acts over the duration of the step
        halves = looked[0.5**halving * missed > BENT] * np.array([1.0, 0.5])
        if not len(halves):
            break
        looked = np.concatenate([halves, halves @ np.array([[1.0, 0.0], [1.0, 1.0]])])
        added.append(halves.sum(axis=1))
    return np.sort(np.concatenate(added))


def find_rare_sizes(steps: FloatArray) -> BoolArray:
    """Find the steps whose size hardly any other step has."""
    _, which, counts = np.unique(
        np.round(steps / steps.max(), 9), return_inverse=True, return_counts=True
    )
    return counts[which] < FEW_STEPS


@dataclass(frozen=True, eq=False)
class _StepStack:
    """Store steps of one size in ``p`` poses, to be interpolated.

    Attributes:
        moved: ``(p r, c)`` of all poses, one below the other.
        pushed: ``(p, r, 3 k)``.
        missed: ``(p, n, 3 k)``.
        push: Largest change of any state by 1 N of friction over a step, over the error allowed.
        miss: Largest error of any state by 1 N of error in friction, likewise.
    """

    steps: tuple[FrictionStep, ...]
    moved: FloatArray
    pushed: FloatArray
    missed: FloatArray
    push: float
    miss: float

    def mix(self, shares: FloatArray) -> "_InterpolatedStep":
        """Interpolate a pose among these, by the share ``(p,)`` of each."""
        pushed = self.pushed[0] if len(shares) == 1 else np.tensordot(shares, self.pushed, 1)
        return _InterpolatedStep(self, shares, np.asarray(pushed))


@dataclass(frozen=True, eq=False)
class _InterpolatedStep:
    """Store a step in an interpolated pose, with its response to friction ``(r, 3 k)``."""

    stack: _StepStack
    shares: FloatArray
    pushed: FloatArray

    @property
    def size(self) -> float:
        """Duration [s]."""
        return self.stack.steps[0].size

    def move(self, known: FloatArray) -> FloatArray:
        """Return the motion ``(r,)`` without friction, from state and inputs ``(c,)``."""
        moved = self.stack.moved @ known
        return moved if len(self.shares) == 1 else self.shares @ moved.reshape(len(self.shares), -1)

    def miss(self, off: FloatArray) -> FloatArray:
        """Return the error ``(n,)`` of the state by friction errors ``(3 k,)`` at checks."""
        return self.shares @ (self.stack.missed @ off)


@dataclass(frozen=True, eq=False)
class _AcceptedStep:
    """Store an accepted step: its number in the grid, its matrices, and its initial state, inputs
    and friction.
    """

    number: int
    interpolated: _InterpolatedStep
    known: FloatArray


class FrictionIntegrator:
    """Integrate a closed loop with friction, each step halved until its friction is resolved."""

    def __init__(self, track: LoopTrack, typical: FrictionLoop, allowed: FloatArray) -> None:
        """Prepare the integration of a loop, with allowed errors ``(n,)`` of its states."""
        self._track, self._allowed = track, allowed
        self._laws, self._size, self._count = typical.law, typical.size, len(typical.law)
        self._level, self._last = 0, math.inf
        self._forces: FloatArray = np.zeros((len(FORCED), self._count))
        self._unit: FloatArray = np.eye(len(FORCED) * self._count)
        self._stacks: dict[tuple[int, str], _StepStack] = {}
        self._taken: list[_AcceptedStep] = []
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
        """Return the state after a step of the grid.

        Args:
            given: Inputs ``(5 q,)`` in the step.
            near: First tabulated pose around its middle, and the shares of it and the next ones.
            alone: Position of its middle, where its matrices are not interpolated [m]; None
                elsewhere.

        Raises:
            ConvergenceError: Friction does not settle.
        """
        level, part = max(self._level - 1, 0), 0
        mixtures: dict[int, _InterpolatedStep] = {}
        lone = None if alone is None else self._track.loop_at(alone)
        while part < 2**level:
            if level not in mixtures:
                mixtures[level] = self._interpolate_step(0.5**level * size, near, lone)
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
            self._taken.append(_AcceptedStep(number, mixtures[level], acting))
            self._forces, self._last = forces.reshape(self._forces.shape), mixtures[level].size
            part += 1
            if level and part % 2 == 0 and missed < EASY:
                level, part = level - 1, part // 2
        self._level = level
        return state

    def _interpolate_step(
        self, size: float, near: tuple[int, FloatArray], lone: FrictionLoop | None
    ) -> _InterpolatedStep:
        """Return the step of a size at a position."""
        if lone is not None:
            return self._stack_steps(make_friction_step(lone, size)).mix(np.ones(1))
        first, shares = near
        key = first, f"{size:.9e}"
        if key not in self._stacks:
            forget(self._stacks)
            places = range(first, first + len(shares))
            self._stacks[key] = self._stack_steps(
                *(self._track.step(pose, size) for pose in places)
            )
        return self._stacks[key].mix(shares)

    def _stack_steps(self, *steps: FrictionStep) -> _StepStack:
        pushed, missed = (
            np.stack(parts)
            for parts in ([step.pushed for step in steps], [step.missed for step in steps])
        )
        push, miss = (
            float((np.abs(part).sum(axis=1) / self._allowed).max(initial=0.0))
            for part in (pushed[0, : self._size], missed[0])
        )
        moved = np.concatenate([step.moved for step in steps])
        return _StepStack(steps, moved, pushed, missed, push, miss)

    def _attempt(
        self, step: _InterpolatedStep, known: FloatArray
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Return state and friction ``(3 k,)`` after a step, and its error over the allowed one;
        None where that is too large.
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
            # Newton's method: forces equal the law at the speeds that they cause
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
            # a stiff law amplifies small speed errors, which forces reduce by their feedback on speeds
            soft = slopes[len(FORCED) :, :, None] * stack.steps[0].softness
            eased = np.linalg.solve(np.eye(self._count) + soft, missed[:, :, None])
            error = float((np.abs(step.miss(np.ravel(eased))) / self._allowed).max())
        return None if error > 1.0 else (moved[: self._size], forces, error)

    def collect_works(self, count: int) -> FloatArray:
        """Return the works ``(count, 4)`` in the steps of the grid since the last call."""
        works = np.zeros((count, len(WORKS)))
        alike: dict[int, list[_AcceptedStep]] = {}
        for taken in self._taken:
            alike.setdefault(id(taken.interpolated.stack), []).append(taken)
        for group in alike.values():
            acting = np.array([taken.known for taken in group])
            shares = np.array([taken.interpolated.shares for taken in group])
            numbers = np.array([taken.number for taken in group])
            steps = group[0].interpolated.stack.steps
            np.add.at(works, numbers, self._find_works(steps, shares, acting))
        self.steps += len(self._taken)
        self._taken = []
        return works

    def _find_works(
        self, steps: Sequence[FrictionStep], shares: FloatArray, known: FloatArray
    ) -> FloatArray:
        """Return the works ``(m, 4)`` of steps interpolated from the same ones."""

        def view(name: str) -> FloatArray:
            """Return the values ``(m, 13, r)`` of some rows."""
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
