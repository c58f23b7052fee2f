"""Faults of channels of a test: turned, swapped, renumbered, reversed, dead and badly scaled ones, found by
how much better measured shapes fit computed ones under each hypothesis.

A hypothesis writes measured rows in place of others, with signs. Every column has a free factor, so the
misfit is that of orthogonal residuals, each over its expected noise; what a hypothesis gains has to be far
more than noise can give, and most of the misfit of the rows it touches.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import Field
from headstock.solvers.second_order import ComplexArray

IntArray = NDArray[np.int64]
Kind = Literal[
    "reversed",
    "exchanged",
    "turned",
    "swapped sensors",
    "swapped channels",
    "shifted",
    "dead",
    "scaled",
]

# rows, sources, signs
type _Move = tuple[Kind, Sequence[int], Sequence[int], Sequence[int]]

LEAST_NOISE = 0.05  # of a motion: models agree no better with channels
LEAST_GAIN = 40.0  # in variances of the noise
LEFT = 0.5  # of the misfit of the rows of a hypothesis may remain
DEAD = 0.1  # of the expected motion, or less
SCALED = 1.5  # times too large or too small, or more
MOST_FAULTS = 20
AS_MUCH = 0.98  # of the largest gain: as large
AS_GOOD = 0.8  # of the largest gain: then both hypotheses are named
_CHUNK = 1 << 18  # entries of rows by columns at once


@dataclass(frozen=True, eq=False)
class ChannelFault:
    """A hypothesis that explains measured shapes far better.

    Attributes:
        rows: Channels that it concerns.
        sources: Channels under whose names their motion was recorded.
        signs: With which sign, 1 or -1.
        factor: Measured over expected motion of a dead or badly scaled channel; 1 for others.
        gain: Misfit that it takes away, in variances of the noise.
        mac: Mean MAC of the columns before and after.
        rivals: Other hypotheses on these channels that explain nearly as much.
    """

    kind: Kind
    rows: tuple[int, ...]
    sources: tuple[int, ...]
    signs: tuple[int, ...]
    gain: float
    mac: tuple[float, float]
    factor: float = 1.0
    rivals: tuple["ChannelFault", ...] = ()


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """Hypotheses of one kind, as rows, sources and signs ``(h, r)``."""

    kind: Kind
    rows: IntArray
    sources: IntArray
    signs: IntArray


def find_channel_faults(
    measured: Field, computed: Field, sensors: Sequence[Sequence[int]]
) -> list[ChannelFault]:
    """Find faults of channels, the one that explains most first.

    Args:
        measured: ``(c, k)`` shapes, or responses at a frequency each; nan where nothing was measured.
        computed: ``(c, k)`` of the same columns.
        sensors: Channels of each sensor, in the order of their axes; sensors in the order of their
            numbers.

    Returns:
        Faults of different channels; none where the data fit, or fit nothing.
    """
    data = np.array(measured, dtype=complex)
    hypotheses = _list_hypotheses(sensors)
    faults: list[ChannelFault] = []
    concerned: set[int] = set()
    while len(faults) < MOST_FAULTS:
        fit = _Fit.of(data, computed)
        candidates = [
            fault
            for fault in (*(f for each in hypotheses for f in fit.test(each)), *fit.test_factors())
            if not concerned.intersection(fault.rows)
        ]
        if not candidates:
            break
        best = _choose(candidates)
        faults.append(best)
        concerned.update(best.rows)
        if best.kind in ("dead", "scaled"):
            data[list(best.rows)] = np.nan
        else:
            signs = np.array(best.signs)[:, None]
            data[list(best.rows)] = signs * data[list(best.sources)]
    return sorted(faults, key=lambda fault: -fault.gain)


def _choose(candidates: Sequence[ChannelFault]) -> ChannelFault:
    """Return the hypothesis that explains most, with those on its channels that explain nearly as much;
    of two that explain the same the one that concerns fewer channels.
    """

    def shares(one: ChannelFault, other: ChannelFault) -> bool:
        return bool(set(one.rows) & set(other.rows))

    most = max(candidates, key=lambda fault: fault.gain)
    best = min(
        (one for one in candidates if one.gain >= AS_MUCH * most.gain and shares(one, most)),
        key=lambda fault: (len(fault.rows), -fault.gain),
    )
    rivals = [
        one
        for one in candidates
        if one is not best and one.gain >= AS_GOOD * best.gain and shares(one, best)
    ]
    rivals.sort(key=lambda fault: -fault.gain)
    return replace(best, rivals=tuple(rivals[:2]))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Measured columns, each fitted by its computed one.

    Attributes:
        data: ``(c, k)``, 0 where nothing was measured.
        model: ``(c, k)`` computed.
        weights: ``(c, k)`` one over variances of the noise; 0 where nothing was measured.
        square: ``(k,)`` weighted squares of the computed columns.
        product: ``(k,)`` weighted products of both.
    """

    data: ComplexArray
    model: ComplexArray
    weights: FloatArray
    square: FloatArray
    product: ComplexArray

    @classmethod
    def of(cls, measured: Field, computed: Field) -> "_Fit":
        """Estimate noise from what most channels leave, and fit with it."""
        known = np.isfinite(measured)
        data, model = np.where(known, measured, 0.0), np.where(known, computed, 0.0) + 0j
        weights = known.astype(float)
        for _ in range(2):
            square = (weights * np.abs(model) ** 2).sum(axis=0)
            product_ = (weights * model.conj() * data).sum(axis=0)
            expected = product_ / np.where(square > 0.0, square, 1.0) * model
            # the median of a squared complex normal is log 2 times its mean
            spread = np.nanmedian(np.where(known, np.abs(data - expected) ** 2, np.nan), axis=0)
            noise = spread / np.log(2.0) + (LEAST_NOISE * np.abs(expected)) ** 2
            sizes = (np.abs(data) ** 2).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
            noise += LEAST_NOISE**2 * sizes
            weights = known / np.where(noise > 0.0, noise, 1.0)
        square = (weights * np.abs(model) ** 2).sum(axis=0)
        product_ = (weights * model.conj() * data).sum(axis=0)
        return cls(data, model, weights, np.where(square > 0.0, square, 1.0), product_)

    @property
    def factors(self) -> ComplexArray:
        """``(k,)`` measured per computed column."""
        return self.product / self.square

    def mac(self, data: ComplexArray) -> float:
        """Mean MAC of columns with the computed ones."""
        known = self.weights > 0.0
        model = np.where(known, self.model, 0.0)
        sizes = (np.abs(data) ** 2).sum(axis=0) * (np.abs(model) ** 2).sum(axis=0)
        products = np.abs((model.conj() * data).sum(axis=0)) ** 2
        return float(np.mean(products / np.where(sizes > 0.0, sizes, 1.0)))

    def test(self, hypotheses: _Hypotheses) -> Iterator[ChannelFault]:
        """Hypotheses that explain far more than noise could."""
        count, width = hypotheses.rows.shape
        step = max(1, _CHUNK // max(1, width * self.data.shape[1]))
        for start in range(0, count, step):
            part = slice(start, start + step)
            rows, sources, signs = (
                hypotheses.rows[part],
                hypotheses.sources[part],
                hypotheses.signs[part],
            )
            gain, share = self._gains(rows, sources, signs)
            for index in np.flatnonzero((gain >= LEAST_GAIN) & (share <= LEFT)):
                moved = (rows[index] != sources[index]) | (signs[index] != 1)
                yield self._fault(
                    hypotheses.kind,
                    rows[index][moved],
                    sources[index][moved],
                    signs[index][moved],
                    float(gain[index]),
                )

    def _gains(
        self, rows: IntArray, sources: IntArray, signs: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Misfit that hypotheses take away ``(h,)``, and the share that they leave of that of their
        rows.
        """
        weights, model = self.weights[rows], self.model[rows]
        before, after = self.data[rows], signs[..., None] * self.data[sources]
        products = self.product + (weights * model.conj() * (after - before)).sum(axis=1)
        squares = (weights * (np.abs(after) ** 2 - np.abs(before) ** 2)).sum(axis=1)
        fitted = (np.abs(products) ** 2 - np.abs(self.product) ** 2) / self.square
        gain = (fitted - squares).sum(axis=1)
        touched = ((rows != sources) | (signs != 1))[..., None] * weights
        left = np.abs(after - (products / self.square)[:, None] * model) ** 2
        there = np.abs(before - self.factors * model) ** 2
        misfit = (touched * there).sum(axis=(1, 2))
        return gain, (touched * left).sum(axis=(1, 2)) / np.where(misfit > 0.0, misfit, 1.0)

    def test_factors(self) -> Iterator[ChannelFault]:
        """Channels that move far less or more than they should, in every column alike."""
        own = self.weights * np.abs(self.model) ** 2
        # factors of columns without the channel itself
        others = (self.product - self.weights * self.model.conj() * self.data) / np.where(
            self.square - own > 0.0, self.square - own, 1.0
        )
        expected = others * self.model
        sizes = (self.weights * np.abs(expected) ** 2).sum(axis=1)
        products = (self.weights * expected.conj() * self.data).sum(axis=1).real
        factors = products / np.where(sizes > 0.0, sizes, 1.0)
        misfit = (self.weights * np.abs(self.data - expected) ** 2).sum(axis=1)
        left = (self.weights * np.abs(self.data - factors[:, None] * expected) ** 2).sum(axis=1)
        gain = misfit - left
        strange = (np.abs(factors) <= DEAD) | (factors >= SCALED) | (factors * SCALED <= 1.0)
        possible = strange & (factors > -DEAD) & (gain >= LEAST_GAIN) & (left <= LEFT * misfit)
        for row in np.flatnonzero(possible):
            kind: Kind = "dead" if factors[row] <= DEAD else "scaled"
            index = np.array([row])
            fault = self._fault(kind, index, index, np.array([1]), float(gain[row]))
            yield replace(fault, factor=float(factors[row]))

    def _fault(
        self, kind: Kind, rows: IntArray, sources: IntArray, signs: IntArray, gain: float
    ) -> ChannelFault:
        data = self.data.copy()
        if kind in ("dead", "scaled"):
            data[rows] = (self.factors * self.model)[rows]
        else:
            data[rows] = signs[:, None] * self.data[sources]
        return ChannelFault(
            kind,
            tuple(map(int, rows)),
            tuple(map(int, sources)),
            tuple(map(int, signs)),
            gain,
            (self.mac(self.data), self.mac(data)),
        )


def _turn(sensor: Sequence[int]) -> Iterator[_Move]:
    """Yield axes in another order and with other signs: turned by a quarter or third of a revolution, or
    against a hand; two or three reversed: by half a revolution, or on the other side.
    """
    signs = list(product((1, -1), repeat=len(sensor)))
    for order, turned in product(permutations(sensor), signs):
        moved = sum(row != source for row, source in zip(sensor, order, strict=True))
        if moved == 0 and -1 in turned:
            yield "reversed", sensor, order, turned
        elif moved:
            exchange = moved == 2 and -1 not in turned
            yield "exchanged" if exchange else "turned", sensor, order, turned


def _list_moves(sensors: Sequence[Sequence[int]]) -> Iterator[_Move]:
    """Yield every hypothesis."""
    for sensor in sensors:
        yield from _turn(sensor)
    for one, other in combinations(sensors, 2):
        if len(one) == len(other) > 1:
            yield "swapped sensors", [*one, *other], [*other, *one], [1] * (2 * len(one))
        for first, second in zip(one, other, strict=False):
            yield "swapped channels", [first, second], [second, first], [1, 1]
    # sensors of a range of numbers, each under the number of the next or of the one before
    for start, stop in combinations(range(len(sensors) + 1), 2):
        among = sensors[start:stop]
        if len(among) < 3 or len({len(sensor) for sensor in among}) > 1:
            continue
        rows = [row for sensor in among for row in sensor]
        for step in (1, -1):
            shifted = [*among[step:], *among[:step]]
            yield "shifted", rows, [row for sensor in shifted for row in sensor], [1] * len(rows)


def _list_hypotheses(sensors: Sequence[Sequence[int]]) -> list[_Hypotheses]:
    """Return all hypotheses by kind; shorter ones are filled with rows that stay."""
    by_kind: defaultdict[Kind, list[_Move]] = defaultdict(list)
    for move in _list_moves(sensors):
        by_kind[move[0]].append(move)
    hypotheses = []
    for kind in get_args(Kind):
        moves = by_kind[kind]
        width = max((len(move[1]) for move in moves), default=1)
        filled = np.zeros((3, len(moves), width), dtype=int)
        filled[2] = 1
        for index, (_, *parts) in enumerate(moves):
            for target, part in zip(filled[:, index], parts, strict=True):
                target[: len(part)] = part
        hypotheses.append(_Hypotheses(kind, *filled))
    return hypotheses
