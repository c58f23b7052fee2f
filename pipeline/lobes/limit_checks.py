"""Limits of stability checked and found by Floquet multipliers."""

import functools
import zlib
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.answers.lobes import HZ, LimitCheck
from headstock.scene.requests import LobesRequest
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.full_discretisation import (
    StepResponse,
    largest_multiplier,
    node_gains,
    scan_limit_depth,
    step_response,
    steps_per_period,
)
from headstock.solvers.milling.lobes import LobeDiagram
from headstock.solvers.milling.stability import TipDynamics, TipPoles

BELOW, ABOVE = 0.95, 1.05  # of the limit: where it is checked
ISLANDS = (0.45, 0.7)  # and, but in samples of a sweep: unstable islands may lie there
BEST_SPEEDS = 3
WORTHWHILE = 1.2  # times the lowest limit: a speed is worth choosing
SEED = 18
FINEST_CHATTER = 1.5  # of the frequency of chatter: what the steps of a check resolve


@dataclass(frozen=True, eq=False)
class Trials:
    """Cuts tried at speeds of a diagram."""

    request: LobesRequest
    tip: TipDynamics | TipPoles
    diagram: LobeDiagram

    def multiplier(self, place: int, depths: Collection[float] = ()) -> Callable[[float], float]:
        """Of a depth of cut [m] at a speed; depths that are known to be tried take less time."""
        request, speed = self.request, float(self.diagram.speeds[place])
        cut = MillingCut(
            request.mill, request.coefficients, speed, request.deepest, request.radial_depth
        )
        chatter = float(self.diagram.chatter[place])
        hz = HZ * chatter if np.isfinite(chatter) else request.reach_hz
        steps = steps_per_period(FINEST_CHATTER * hz, cut.tooth_period)
        usual = ABOVE * float(self.diagram.depths[place])
        planned = {usual, *depths}
        ready = dict(zip(planned, node_gains(cut, steps, planned), strict=True))
        stiffest = float(np.linalg.norm(ready[usual], axis=(1, 2)).max())

        @functools.cache
        def respond(share: float) -> StepResponse:
            """With the poles that matter up to a share of the usual depth."""
            return step_response(self.tip, cut.tooth_period, steps, stiffest=share * stiffest)

        @functools.cache
        def size(depth: float) -> float:
            share = max(1.0, 2.0 ** np.ceil(np.log2(depth / usual)))
            gains = ready[depth] if depth in ready else node_gains(cut, steps, [depth])[0]
            return largest_multiplier(respond(share), gains)

        return size

    def check(self, place: int, islands: tuple[float, ...] = ()) -> tuple[LimitCheck, float]:
        """A limit tried below and above, and at shares of it where unstable islands may lie; and the
        limit depth [m], by bisection between what was tried where that fails.
        """
        depth = float(self.diagram.depths[place])
        stable, unstable = [share * depth for share in (*islands, BELOW)], ABOVE * depth
        multiplier = self.multiplier(place, stable)
        check = LimitCheck(
            place,
            depth,
            below=max(map(multiplier, stable)),
            above=multiplier(unstable),
            limited=bool(self.diagram.waves[place] >= 0),
        )
        if check.confirmed:
            return check, depth
        deepest = self.request.deepest
        return check, scan_limit_depth(multiplier, depth, deepest, (*stable, unstable))

    def limit(self, place: int) -> float:
        """Limit depth at a speed by bisection [m]."""
        return scan_limit_depth(
            self.multiplier(place), float(self.diagram.depths[place]), self.request.deepest
        )


def choose_speeds(request: LobesRequest, pose: Pose, diagram: LobeDiagram) -> list[int]:
    """A seeded sample of the speeds that have a limit, at least one, and the lowest limit."""
    limited = np.flatnonzero(diagram.waves >= 0)
    if not len(limited):
        return []
    if request.checked >= 1.0:
        return [int(place) for place in limited]
    place = repr(sorted(pose.positions.items())).encode()
    draw = np.random.default_rng([SEED, zlib.crc32(place)])
    count = max(1, round(request.checked * len(limited)))
    chosen = draw.choice(limited, size=count, replace=False)
    return sorted({int(np.argmin(diagram.depths)), *map(int, chosen)})


def best_speeds(depths: FloatArray) -> tuple[int, ...]:
    """The deepest of the limits that no neighbour exceeds, the deepest first; of equal ones in a row
    the middle.
    """
    starts = np.flatnonzero(np.concatenate([[True], depths[1:] != depths[:-1]]))
    ends = np.concatenate([starts[1:], [len(depths)]]) - 1
    level = depths[starts]
    before, after = np.concatenate([[-np.inf], level[:-1]]), np.concatenate([level[1:], [-np.inf]])
    tops = np.flatnonzero((level > before) & (level > after) & (level > WORTHWHILE * depths.min()))
    order = sorted(tops, key=lambda top: -level[top])[:BEST_SPEEDS]
    return tuple(int((starts[top] + ends[top]) // 2) for top in order)
