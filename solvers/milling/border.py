"""The border of stability over the speed of the spindle: the thinnest cut that chatters at every speed.

Depths are scanned upwards: at a few speeds from one on that is safe at all, at the others from below the
thinnest limit of these. Unstable islands are looked for where the growth of the largest multiplier has
a maximum between depths, and close below each limit. The border is enclosed by secants and confirmed
with more nodes. Where speeds are dense a limit is expected between those of the speeds on either side,
and confirmed there at once. A limit of a neighbouring speed is tried as well, so that an island that
one speed finds is followed to all others.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.collocation import FINER, Multiplier, PeriodicCut
from headstock.solvers.milling.windows import MOST_ROWS

PILOTS = 16  # speeds, at least, at which depths are scanned from a safe one on
THINNEST = 1e-6  # of the deepest cut: no thinner one is tried
SCAN_BEGIN = 0.5  # of the thinnest limit of these: from there on at all others
SCAN_FACTOR, DENSE_FACTOR = 1.12, 1.8  # from depth to depth of a scan, and where speeds are dense
DENSE = 0.12  # of a lobe: speeds that are nearer than that are dense
STAGGER = (0.0, 0.5, 0.25, 0.75)  # of that step, from speed to speed: neighbours look between
ISLANDS = (0.91, 0.965)  # of a limit: islands lie close below it
SAME = 0.01  # relative: a depth that was tried so near counts as one of these
NEAR = (1.03, 1.1, 1.3)  # of a limit that is expected: with the islands below it, they enclose it
INSIDE = 1.01  # of a limit beside it: in an island that a neighbour found
BELOW = 0.97  # of a limit beside it: an island that a neighbour found has to be thinner than that
SECANT_TOLERANCE = 1e-2  # relative: a secant step below it is the last one
DEPTH_TOLERANCE = 2e-4  # relative: where enclosing ends
FAR = 3e-2  # relative: by so much more nodes may move a limit at once
CLOSE = 1e-3  # relative: cuts so much thinner and deeper than a limit are stable and not
CONFIRMATIONS = 4  # of a limit with more nodes
MOST_REFINEMENTS = 3  # of the nodes
MOST_TRIALS = 200  # depths at a speed
NEUTRAL = 5e-7  # growth of a motion that neither grows nor decays
SMALLEST = 1e-12  # multiplier that has a logarithm
OWN_SHARE = 0.9  # of the growth at a stable depth: what is above is that of what chatters


@dataclass(frozen=True)
class Limit:
    """The thinnest cut that chatters at a speed.

    Attributes:
        depth: Axial depth [m]; the deepest that was looked for where none chatters; NaN where the
            speed was not evaluated.
        limited: Whether a cut chatters.
        error: It lies so near that depth [m].
        slope: Growth of what chatters over the relative depth, at the limit.
        omega: Angular frequency of chatter [rad/s]; NaN where there is none.
        waves: Whole waves between two teeth; -1 where there are none.
    """

    depth: float
    limited: bool = False
    error: float = 0.0
    slope: float = math.nan
    omega: float = math.nan
    waves: int = -1


NOT_EVALUATED = Limit(math.nan)


@dataclass(eq=False)
class _Speed:
    """Depths tried at a speed, and the growth of the largest multiplier at each."""

    cut: PeriodicCut
    more: int = 0
    tried: dict[float, float] = field(default_factory=dict)

    def growth(self, depth: float) -> float:
        """Logarithm of the largest multiplier: below zero where the cut is stable."""
        if depth not in self.tried:
            self.tried[depth] = _growth(self.cut.largest(depth, self.more))
        return self.tried[depth]

    def stable_below(self, depth: float) -> float:
        """The deepest stable cut that was tried below a depth, zero for none [m]."""
        return max(
            (tried for tried, growth in self.tried.items() if tried < depth and growth < 0.0),
            default=0.0,
        )

    def refine(self) -> None:
        """Take more nodes from now on."""
        self.more += FINER
        self.tried.clear()


def _growth(multiplier: Multiplier) -> float:
    """Logarithm of a multiplier, below zero for one that is one but for roundoff: a motion that
    nothing holds and that moves tool and wave alike.
    """
    return math.log(max(abs(multiplier.value), SMALLEST)) - NEUTRAL


def find_border(
    cuts: Sequence[PeriodicCut | None],
    expected: FloatArray,
    *,
    safe: float,
    deepest: float,
) -> list[Limit]:
    """The limit at every speed.

    Args:
        cuts: At speeds that rise; None where a speed is not evaluated.
        expected: ``(n,)`` depths near which limits are expected [m].
        safe: Depth that is stable at every speed [m].
        deepest: Depth up to which limits are looked for [m].
    """
    places = [index for index, cut in enumerate(cuts) if cut is not None]
    speeds = [_Speed(cut) for cut in cuts if cut is not None]
    near = expected[places]
    limits = [NOT_EVALUATED] * len(speeds)
    first = min(max(safe, THINNEST * deepest), deepest)
    factor = _choose_factor(speeds, safe)
    apart = 2 ** int(math.log2(max(1.0, len(speeds) / PILOTS)))
    for index in range(0, len(speeds), apart):
        begin = first * factor ** -STAGGER[index // apart % len(STAGGER)]
        limits[index] = _scan(speeds[index], begin, deepest, float(near[index]), factor)
    # a narrow lobe between these speeds is seen by one frequency
    depths = [deepest, *near, *(limit.depth for limit in limits)]
    first = max(first, SCAN_BEGIN * float(np.nanmin(depths)))
    while apart > 1:
        apart //= 2
        for index in range(apart, len(speeds), 2 * apart):
            begin = first * factor ** -STAGGER[index // apart % len(STAGGER)]
            hint = _expect(limits, near, index, apart) if factor == DENSE_FACTOR else math.nan
            limits[index] = _scan(
                speeds[index],
                begin,
                deepest,
                hint if math.isfinite(hint) else float(near[index]),
                factor,
                sure=math.isfinite(hint),
            )
    _follow_islands(speeds, limits, deepest)
    by_place = dict(zip(places, limits, strict=True))
    return [by_place.get(index, NOT_EVALUATED) for index in range(len(cuts))]


def _follow_islands(speeds: Sequence[_Speed], limits: list[Limit], deepest: float) -> None:
    """Try the limit of every speed at its neighbours, and theirs in turn where it chatters."""
    waiting = [index for index, limit in enumerate(limits) if limit.limited]
    while waiting:
        index = waiting.pop()
        for beside in (index - 1, index + 1):
            if not 0 <= beside < len(limits):
                continue
            speed, depth = speeds[beside], INSIDE * limits[index].depth
            if depth < BELOW * limits[beside].depth and speed.growth(depth) >= 0.0:
                limits[beside] = _enclose(speed, speed.stable_below(depth), depth, deepest)
                waiting.append(beside)


def _expect(limits: Sequence[Limit], near: FloatArray, place: int, apart: int) -> float:
    """Depth near which the limit of a speed is expected from those of the speeds on either side [m],
    by the ratio to those of one frequency; NaN where one of them has none.
    """
    beside = [place - apart, min(place + apart, len(limits) - 1)]
    if not all(limits[index].limited for index in beside):
        return math.nan
    depths = np.array([limits[index].depth for index in beside])
    ratio = float(near[place] * (depths / near[beside]).mean())
    return ratio if math.isfinite(ratio) else float(depths.mean())


def _scan(
    speed: _Speed, first: float, deepest: float, hint: float, factor: float, *, sure: bool = False
) -> Limit:
    """The thinnest limit at a speed, by depths rising from the first, each so many times the last.

    Args:
        first: Depth to begin with [m].
        deepest: Depth to end with [m].
        hint: Near which the limit is expected [m]; NaN for nowhere.
        sure: The limit is expected so near that it is confirmed there before it is enclosed.
    """
    near = [share * hint for share in (*ISLANDS, *NEAR) if share * hint < deepest]
    depths: list[float] = []
    depth = first
    for _ in range(MOST_TRIALS):
        if speed.cut.rows(depth) > MOST_ROWS:
            # deeper cuts wake modes that are too fast to be followed
            stable = bool(depths) and _confirmed_stable(speed, depths[-1])
            return Limit(depths[-1]) if stable else NOT_EVALUATED
        depths.append(depth)
        if speed.growth(depth) >= 0.0:
            limit = _enclose(speed, depths[-2] if len(depths) > 1 else 0.0, depth, deepest)
            return _look_below(speed, limit, deepest)
        if (top := _find_island(speed, depths)) is not None:
            return _enclose(speed, depths[-3], top, deepest)
        if depth >= deepest:
            break
        ahead = [hinted for hinted in near if depth < hinted < factor * depth]
        if sure and depth == ISLANDS[-1] * hint:
            limit = _confirm(speed, hint, (depth, NEAR[0] * hint))
            if limit is not NOT_EVALUATED:
                return _look_below(speed, limit, deepest)
        depth = min([*ahead, factor * depth, deepest])
    if not _confirmed_stable(speed, deepest):
        speed.refine()
        return _scan(speed, first, deepest, hint, factor)
    return Limit(deepest)


def _look_below(speed: _Speed, limit: Limit, deepest: float) -> Limit:
    """A limit, or an island close below it."""
    for share in ISLANDS:
        depth = share * limit.depth
        if any(abs(tried / depth - 1.0) < SAME for tried in speed.tried if depth > 0.0):
            continue
        if depth > 0.0 and speed.growth(depth) >= 0.0:
            return _enclose(speed, speed.stable_below(depth), depth, deepest)
    return limit


def _choose_factor(speeds: Sequence[_Speed], safe: float) -> float:
    """From depth to depth of a scan: neighbours that are only a small part of a lobe apart look
    between each other's depths.
    """
    apart = [
        before.cut.waves(safe) * abs(before.cut.cut.tooth_period / after.cut.cut.tooth_period - 1.0)
        for before, after in itertools.pairwise(speeds)
    ]
    return DENSE_FACTOR if apart and max(apart) < DENSE else SCAN_FACTOR


def _confirmed_stable(speed: _Speed, depth: float) -> bool:
    return speed.more > 0 or _growth(speed.cut.largest(depth, speed.more + FINER)) < 0.0


def _find_island(speed: _Speed, depths: Sequence[float]) -> float | None:
    """A depth that chatters between the last three, which do not: where a parabola through their
    growth rises above zero, or nearly.
    """
    if len(depths) < 3:
        return None
    places = np.log(depths[-3:])
    low, middle, high = (speed.growth(tried) for tried in depths[-3:])
    if not (middle > low and middle > high and middle > min(low, high) / 2.0):
        return None
    curve = np.polyfit(places - places[1], [low, middle, high], 2)
    top = depths[-2] * math.exp(-0.5 * curve[1] / curve[0])
    return top if speed.growth(top) >= 0.0 else None


def _enclose(speed: _Speed, low: float, high: float, deepest: float) -> Limit:
    """The limit between a stable depth, or none, and one that chatters; confirmed with more nodes."""
    for _ in range(MOST_REFINEMENTS):
        while low == 0.0:
            # it chatters at the first depth: down to where it does not
            if speed.growth(0.5 * high) < 0.0:
                low = 0.5 * high
            elif high < DEPTH_TOLERANCE * deepest * 1e-3:
                return Limit(0.0, limited=True)
            else:
                high *= 0.5
        for tolerance in (SECANT_TOLERANCE, DEPTH_TOLERANCE):
            # two multipliers that pass one close together mislead a long secant
            crossing = _find_crossing(speed, low, high, tolerance)
            limit = _confirm(speed, crossing, (low, high))
            if limit is not NOT_EVALUATED:
                return limit
        limit = _halve(speed, low, high)
        if limit is not NOT_EVALUATED:
            return limit
        speed.refine()
        low, high = low * (1.0 - FAR), high * (1.0 + FAR)
        while speed.growth(low) >= 0.0:
            low *= 1.0 - FAR
        while speed.growth(high) < 0.0 and high < deepest:
            high *= 1.0 + FAR
        if speed.growth(high) < 0.0:
            return Limit(deepest)
    return NOT_EVALUATED


def _confirm(speed: _Speed, depth: float, within: tuple[float, float]) -> Limit:
    """A crossing with more nodes: cuts close below it are stable, close above it they are not.

    Args:
        depth: Of the crossing [m].
        within: Depths between which it is, but for what more nodes change [m].
    """
    more = speed.more + FINER
    for _ in range(CONFIRMATIONS):
        ends = [(1.0 - CLOSE) * depth, (1.0 + CLOSE) * depth]
        multipliers = [speed.cut.largest(end, more) for end in ends]
        growths = [_growth(multiplier) for multiplier in multipliers]
        if growths[0] < 0.0 <= growths[1]:
            return _limit_between(speed, ends, multipliers)
        slope = 0.5 * (growths[1] - growths[0]) / CLOSE
        if slope <= 0.0:
            break
        left = 0.5 * sum(growths) / slope  # relative, to where both ends say the border is
        depth *= 1.0 - min(max(left, -FAR), FAR)
        if not (1.0 - FAR) * within[0] < depth < (1.0 + FAR) * within[1]:
            break
    return NOT_EVALUATED


def _halve(speed: _Speed, low: float, high: float) -> Limit:
    """A crossing with more nodes by halves, where another multiplier, which no cut excites, is nearly
    one.
    """
    more, ends = speed.more + FINER, [low, high]
    multipliers = [speed.cut.largest(end, more) for end in ends]
    while _growth(multipliers[0]) < 0.0 <= _growth(multipliers[1]):
        if ends[1] - ends[0] < 2.0 * CLOSE * ends[0]:
            return _limit_between(speed, ends, multipliers)
        middle = 0.5 * (ends[0] + ends[1])
        between = speed.cut.largest(middle, more)
        side = 0 if _growth(between) < 0.0 else 1
        ends[side], multipliers[side] = middle, between
    return NOT_EVALUATED


def _limit_between(speed: _Speed, ends: Sequence[float], found: Sequence[Multiplier]) -> Limit:
    """The limit between a stable depth and one that is not, close to each other."""
    low, high = map(_growth, found)
    omega = speed.cut.frequency(found[1])
    return Limit(
        ends[0] - low * (ends[1] - ends[0]) / (high - low),
        limited=True,
        error=0.5 * (ends[1] - ends[0]),
        slope=(high - low) / math.log(ends[1] / ends[0]),
        omega=omega,
        waves=int(omega * speed.cut.cut.tooth_period / (2.0 * math.pi)),
    )


def _find_crossing(speed: _Speed, low: float, high: float, tolerance: float) -> float:
    """Depth at which the growth passes zero: nearly a line, but where another multiplier, which no
    cut excites, is larger; depths of that one enclose the border only.

    Args:
        low: Depth that is stable [m].
        high: One that is not [m].
        tolerance: Relative step of a secant that is the last one.
    """
    growth = speed.growth
    idle = OWN_SHARE * growth(low)
    growing = [depth for depth in (low, high) if growth(depth) > idle]
    trial = 0.5 * (low + high)
    if len(growing) == 2:
        trial = low - growth(low) * (high - low) / (growth(high) - growth(low))
    while high - low > DEPTH_TOLERANCE * low:
        value = growth(trial)
        before = min(growing, key=lambda each: abs(each - trial))
        low, high = (trial, high) if value < 0.0 else (low, trial)
        ahead = 0.5 * (low + high)
        if value > idle and trial != before and value != growth(before):
            ahead = trial - value * (trial - before) / (value - growth(before))
            if low < ahead < high and abs(ahead - trial) < tolerance * trial:
                return ahead
            growing.append(trial)
        trial = ahead if low < ahead < high else 0.5 * (low + high)
    return 0.5 * (low + high)
