"""A closed loop with friction that may change along a path: known at places, cubic between them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.friction_loop import FrictionLoop
from headstock.solvers.control.friction_steps import FrictionStep, make_friction_step
from headstock.solvers.second_order import Positions

IntArray = NDArray[np.intp]
Given = Callable[[FloatArray], FloatArray]
ABOUT = 4  # places about a position, between which a cubic is laid
REMEMBERED = 128  # steps of one size in a pose


@dataclass(frozen=True, eq=False)
class LoopTrack:
    """A loop that may change along a path; between known places its matrices are cubics.

    Attributes:
        places: ``(p,)`` rising, one or at least four [m].
        positions: Where it is at times ``(n,)`` [m].
        rows: Which of its outputs are wanted; None for all.
    """

    places: FloatArray
    loop_at: Callable[[float], FrictionLoop]
    positions: Given
    rows: Positions | None = None
    _loops: dict[int, FrictionLoop] = field(default_factory=dict)
    _steps: dict[tuple[int, str], FrictionStep] = field(default_factory=dict)

    @property
    def still(self) -> bool:
        """Nothing changes."""
        return len(self.places) == 1

    def loop(self, number: int) -> FrictionLoop:
        """The loop at one of the places."""
        if number not in self._loops:
            self._loops[number] = self.loop_at(float(self.places[number]))
        return self._loops[number]

    def step(self, number: int, size: float) -> FrictionStep:
        """Its step there."""
        key = number, f"{size:.9e}"
        if key not in self._steps:
            forget(self._steps)
            self._steps[key] = make_friction_step(self.loop(number), size)
        return self._steps[key]

    def near(self, positions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Places about positions ``(n,)``: the first of each, and the share ``(n, 4)`` that it and the
        next ones have in a cubic through them.
        """
        if self.still:
            return np.zeros(len(positions), dtype=np.intp), np.ones((len(positions), 1))
        left = np.searchsorted(self.places, positions, side="right") - 1
        firsts = np.clip(left - 1, 0, len(self.places) - ABOUT)
        known = self.places[firsts[:, None] + np.arange(ABOUT)]
        shares = np.ones((len(positions), ABOUT))
        for own in range(ABOUT):
            for other in set(range(ABOUT)) - {own}:
                to_other = positions - known[:, other]
                shares[:, own] *= to_other / (known[:, own] - known[:, other])
        return firsts, shares

    def blend(
        self, positions: FloatArray, find: Callable[[FrictionLoop, slice | IntArray], FloatArray]
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


def forget[K, V](known: dict[K, V]) -> None:
    """Drop what has been known longest where that is much."""
    if len(known) >= REMEMBERED:
        del known[next(iter(known))]


def still_track(model: FrictionLoop) -> LoopTrack:
    """The track of a loop that does not change."""
    return LoopTrack(np.zeros(1), lambda place: model, np.zeros_like)
