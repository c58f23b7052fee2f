"""Faults of channels of a test: turned, swapped, renumbered, reversed, dead and badly scaled ones, found by
how much better measured shapes fit computed ones under each hypothesis.

A hypothesis writes measured rows in place of others, with signs. Every column has a free factor, so the
misfit is that of orthogonal residuals, each over its expected noise; what a hypothesis gains has to be far
more than noise can give, and most of the misfit of the rows it touches.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product
from typing import Literal

import numpy as np
import scipy.optimize
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

type _Sensors = list[list[int]]
type _Moves = Iterator[tuple[list[int], list[int], list[int]]]  # rows, sources, signs

LEAST_NOISE = 0.05  # of a motion: models agree no better with channels
LEAST_GAIN = 40.0  # in variances of the noise
LEFT = 0.5  # of the misfit of the rows of a hypothesis may remain
DEAD = 0.1  # of the expected motion, or less
SCALED = 1.5  # times too large or too small, or more
MOST_FAULTS = 20
AS_GOOD = 0.8  # of the largest gain: then both hypotheses are named
LEFT_OUT = 0.2  # of the sensors may be faulty where shapes are paired
AT_LEAST = 0.2  # of the squares of a computed shape stay with the others
SURE = 0.6  # MAC without them of a pair
TINY = float(np.finfo(float).tiny)
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
    every = [list(sensor) for sensor in sensors]
    hypotheses = [_hypotheses(every, kind) for kind in _KINDS]
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
        best = max(candidates, key=lambda fault: fault.gain)
        # of two that explain the same, the one that concerns fewer channels
        best = min(
            (
                fault
                for fault in candidates
                if fault.gain >= 0.98 * best.gain and _shares(fault, best)
            ),
            key=lambda fault: (len(fault.rows), -fault.gain),
        )
        rivals = sorted(
            (
                fault
                for fault in candidates
                if fault is not best and fault.gain >= AS_GOOD * best.gain and _shares(fault, best)
            ),
            key=lambda fault: -fault.gain,
        )
        faults.append(replace(best, rivals=tuple(rivals[:2])))
        concerned.update(best.rows)
        if best.kind in ("dead", "scaled"):
            data[list(best.rows)] = np.nan
        else:
            signs = np.array(best.signs)[:, None]
            data[list(best.rows)] = signs * data[list(best.sources)]
    return sorted(faults, key=lambda fault: -fault.gain)


def pair_despite_faults(
    measured: Field, computed: Field, sensors: Sequence[Sequence[int]]
) -> tuple[IntArray, IntArray]:
    """Pair shapes whose MAC is high without the few sensors that agree least: one that is turned may
    move most of all.

    Args:
        measured: ``(c, k)``.
        computed: ``(c, m)``.
        sensors: Channels of each.

    Returns:
        Columns of the measured and of the computed shapes, pair by pair.
    """
    products = np.array([measured[rows].T @ computed[rows].conj() for rows in map(list, sensors)])
    first = np.array([(np.abs(measured[rows]) ** 2).sum(axis=0) for rows in map(list, sensors)])
    second = np.array([(np.abs(computed[rows]) ** 2).sum(axis=0) for rows in map(list, sensors)])
    # what each sensor adds, for each pair of shapes ``(s, k, m)``
    one = np.broadcast_to(first[:, :, None], products.shape).copy()
    other = np.broadcast_to(second[:, None, :], products.shape).copy()
    least = AT_LEAST * other.sum(axis=0)
    for _ in range(max(1, round(LEFT_OUT * len(sensors)))):
        rest = [sizes.sum(axis=0) - sizes for sizes in (products, one, other)]
        allowed = rest[2] > least
        mac = np.where(allowed, np.abs(rest[0]) ** 2 / (rest[1] * rest[2] + TINY), 0.0)
        worst = np.argmax(mac, axis=0)[None]
        taken = np.take_along_axis(allowed, worst, axis=0)
        for sizes in (products, one, other):
            kept = np.take_along_axis(sizes, worst, axis=0)
            np.put_along_axis(sizes, worst, np.where(taken, 0.0, kept), axis=0)
    sums = [sizes.sum(axis=0) for sizes in (products, one, other)]
    mac = np.abs(sums[0]) ** 2 / (sums[1] * sums[2] + TINY)
    rows, columns = scipy.optimize.linear_sum_assignment(-mac)
    sure = mac[rows, columns] >= SURE
    return rows[sure], columns[sure]


def _shares(one: ChannelFault, other: ChannelFault) -> bool:
    return bool(set(one.rows) & set(other.rows))


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


def _reversed(sensors: _Sensors) -> _Moves:
    for sensor in sensors:
        for row in sensor:
            yield [row], [row], [-1]
        # two or three axes: a sensor turned by half a revolution, or one on the other side
        for count in range(2, len(sensor) + 1):
            for rows in combinations(sensor, count):
                yield list(rows), list(rows), [-1] * count


def _exchanged(sensors: _Sensors) -> _Moves:
    for sensor in sensors:
        for first, second in combinations(sensor, 2):
            yield [first, second], [second, first], [1, 1]


def _turned(sensors: _Sensors) -> _Moves:
    """Axes in another order and with other signs: turned by a quarter or third of a revolution, or
    against a hand.
    """
    for sensor in sensors:
        for order in permutations(range(len(sensor))):
            for signs in product((1, -1), repeat=len(sensor)):
                moved = [at for at, source in enumerate(order) if at != source]
                exchange = len(moved) == 2 and all(sign == 1 for sign in signs)
                if moved and not exchange:
                    yield sensor, [sensor[source] for source in order], list(signs)


def _swapped_sensors(sensors: _Sensors) -> _Moves:
    for one, other in combinations(sensors, 2):
        if len(one) == len(other) > 1:
            yield [*one, *other], [*other, *one], [1] * (2 * len(one))


def _swapped_channels(sensors: _Sensors) -> _Moves:
    for one, other in combinations(sensors, 2):
        for first, second in zip(one, other, strict=False):
            yield [first, second], [second, first], [1, 1]


def _shifted(sensors: _Sensors) -> _Moves:
    """Sensors of a range of numbers, each under the number of the next or of the one before."""
    for start, stop in combinations(range(len(sensors) + 1), 2):
        among = sensors[start:stop]
        if len(among) < 3 or len({len(sensor) for sensor in among}) > 1:
            continue
        rows = [row for sensor in among for row in sensor]
        for way in (1, -1):
            turned = [*among[way:], *among[:way]]
            yield rows, [row for sensor in turned for row in sensor], [1] * len(rows)


_KINDS: dict[Kind, Callable[[_Sensors], _Moves]] = {
    "reversed": _reversed,
    "exchanged": _exchanged,
    "turned": _turned,
    "swapped sensors": _swapped_sensors,
    "swapped channels": _swapped_channels,
    "shifted": _shifted,
}


def _hypotheses(sensors: _Sensors, kind: Kind) -> _Hypotheses:
    """All hypotheses of a kind; shorter ones are filled with rows that stay."""
    every = list(_KINDS[kind](sensors))
    width = max((len(rows) for rows, _, _ in every), default=1)
    filled = np.zeros((3, len(every), width), dtype=int)
    filled[2] = 1
    for index, parts in enumerate(every):
        for target, part in zip(filled[:, index], parts, strict=True):
            target[: len(part)] = part
    return _Hypotheses(kind, *filled)
