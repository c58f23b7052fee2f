"""Floquet multipliers of a cut by collocation in the cut alone.

Unknown are the motions of the tip at Gauss nodes of the windows of a tooth period in which a tooth
cuts; between them the tip moves by its impulse response, pole by pole:

    y(t) = Phi(t) z(0) + int_0^t H(t - s) G(s) [y(s) - y(s - T)] ds + D G(t) [y(t) - y(t - T)]

with ``G`` of period ``T``, the time from tooth to tooth, which is the delay as well. Windows begin and
end where ``G`` has a corner: where the lower or the upper end of an edge enters or leaves the part.
Within a window all functions are smooth, so that multipliers converge exponentially with the number
of nodes (spectral collocation: Butcher and Bobrenkov 2011; Insperger and Stepan 2011, sec. 3, have
the independent method of :mod:`.stability`). Multipliers say whether the cut is stable: all below
one.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.milling.coefficients import CuttingCoefficients, Three
from headstock.solvers.milling.forces import EndMill, MillingCut, Sense, chip_stiffness
from headstock.solvers.milling.stability import ComplexArray, TipPoles, keep_poles
from headstock.solvers.milling.windows import Window, divide_period

FINER = 3  # nodes more in each window, where a limit is confirmed
EXTRA_POINTS = 3  # of quadrature, besides the nodes
NEGLIGIBLE = (
    3e-3  # of the inverse of a gain: receptance of all poles that move at once with the force
)
FAINT = 0.25  # of a loop gain that chatters: fast poles that stay below it follow the force at once
ABOVE = 2.0  # times the fastest pole that does not: from there on poles are fast
SLOWEST = 1e-9  # of the fastest pole: rates below it are those of motions that nothing holds
RANK = 1e-9  # of the largest motion: directions in which the tip does not move
SQUARINGS = 10  # of the matrix over a period, at most
FEWEST_SQUARINGS = 7  # before the first look at what is left
TIMES = 2  # that each power is applied
DOMINANT = 8  # multipliers that are left of it
RESIDUAL = 1e-5  # of the largest multiplier: where squaring ends
SMALL_MATRIX = 36  # rows up to which all eigenvalues take no longer


class Multiplier(NamedTuple):
    """The largest multiplier of a cut, and the pole whose motion makes the largest chip in it.

    Attributes:
        value: Complex, per tooth period.
        pole: Index of the pole.
    """

    value: complex
    pole: int


class Rule(NamedTuple):
    """Gauss nodes of a window ``[-1, 1]`` and integrals over Lagrange polynomials on them.

    Attributes:
        nodes: ``(n,)``.
        lags: ``(n, q)`` from each quadrature point before a node up to it.
        weights: ``(n, q, n)`` of each quadrature point times the polynomials there.
        to_end: ``(q,)`` from each quadrature point of the whole window to its end.
        whole: ``(q, n)`` weights of the whole window.
    """

    nodes: FloatArray
    lags: FloatArray
    weights: FloatArray
    to_end: FloatArray
    whole: FloatArray


@functools.lru_cache(maxsize=64)
def _gauss_rule(count: int) -> Rule:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    points, shares = np.polynomial.legendre.leggauss(count + EXTRA_POINTS)
    half = 0.5 * (nodes + 1.0)
    before = half[:, None] * (points + 1.0) - 1.0
    return Rule(
        nodes,
        half[:, None] * (1.0 - points),
        (half[:, None] * shares)[..., None] * _lagrange(nodes, weights, before),
        1.0 - points,
        shares[:, None] * _lagrange(nodes, weights, points),
    )


def _lagrange(nodes: FloatArray, weights: FloatArray, places: FloatArray) -> FloatArray:
    """``(..., n)`` Lagrange polynomials at places, by Legendre series (discrete orthogonality)."""
    degrees = np.arange(len(nodes))
    series = np.polynomial.legendre.legvander(nodes, len(nodes) - 1) * (degrees + 0.5)
    values = np.polynomial.legendre.legvander(places, len(nodes) - 1)
    return np.asarray(values @ (series * weights[:, None]).T)


@dataclass(frozen=True, eq=False)
class _Responses:
    """Of a tip over a tooth period, at ``N`` nodes of its windows.

    Attributes:
        times: ``(N,)`` of the nodes since the start [s].
        own: ``(N p, N r)`` motions at the nodes per force at the nodes.
        free: ``(N p, 2 q)`` per coordinates at the start.
        end: ``(2 q, 2 q)`` coordinates at the end per those at the start.
        forced: ``(2 q, N r)`` coordinates at the end per force at the nodes.
    """

    times: FloatArray
    own: FloatArray
    free: FloatArray
    end: FloatArray
    forced: FloatArray


@functools.lru_cache(maxsize=64)
def stiffest_gain(mill: EndMill, chip: Three, radial_depth: float, sense: Sense) -> float:
    """Largest stiffness of a thin cut within a tooth period, per depth [N/m^2].

    Args:
        mill: The tool.
        chip: Coefficients of the chip [N/m^2].
        radial_depth: At most the diameter [m].
        sense: Of milling.
    """
    thin = 1e-3 * mill.diameter
    coefficients = CuttingCoefficients(chip, (0.0, 0.0, 0.0), "")
    cut = MillingCut(mill, coefficients, 1.0, thin, radial_depth, sense=sense)
    times = np.linspace(0.0, cut.tooth_period, 96, endpoint=False, dtype=np.float64)
    gains = chip_stiffness(cut, times, np.array([thin]))[0]
    return float(np.linalg.norm(gains, axis=(1, 2)).max()) / thin


def _stiffest(cut: MillingCut) -> float:
    return stiffest_gain(cut.mill, cut.coefficients.chip, cut.radial_depth, cut.sense)


def safe_depth(tip: TipPoles, cut: MillingCut) -> float:
    """Depth below which no cut chatters at any speed [m]: the tip and twice the stiffness of the cut
    have a loop gain below one (small-gain theorem).

    Args:
        tip: Motions along and away, forces along all axes.
        cut: Tool, material and radial depth.
    """
    speeds = np.abs(tip.values)
    lines = 1j * np.maximum(speeds, SLOWEST * speeds.max(initial=0.0))
    shares = (1.0 / (lines[:, None] - each) for each in (tip.values, tip.values.conj()))
    both = (tip.outputs, tip.outputs.conj()), (tip.inputs, tip.inputs.conj())
    response = tip.static + 0.5 * sum(
        np.einsum("pq,fq,qr->fpr", outputs, share, inputs)
        for outputs, share, inputs in zip(both[0], shares, both[1], strict=True)
    )
    return 0.5 / (_stiffest(cut) * float(np.linalg.norm(response, 2, axis=(1, 2)).max()))


class PeriodicCut:
    """A tip and a cut at a speed of the spindle, at any depth.

    Args:
        tip: In coordinates of its own; motions along and away, forces along all axes.
        cut: Tool, material, radial depth and speed; its axial depth has no part in it.
    """

    def __init__(self, tip: TipPoles, cut: MillingCut) -> None:
        self.cut = cut
        left, size, right = scipy.linalg.svd(
            np.concatenate([tip.outputs.real, tip.outputs.imag, tip.static], axis=1),
            full_matrices=False,
        )
        del right
        # (p, k): where the tip moves
        self._axes: FloatArray = left[:, size > RANK * size.max(initial=0.0)]
        self._tip = TipPoles(
            tip.values, tip.inputs, self._axes.T @ tip.outputs, self._axes.T @ tip.static
        )
        peaks = np.linalg.norm(tip.inputs, axis=1) * np.linalg.norm(tip.outputs, axis=0)
        slowest = SLOWEST * np.abs(tip.values).max(initial=0.0)
        self._peaks = peaks / np.maximum(np.abs(tip.values.real), slowest)
        self._stiffest = _stiffest(cut)
        self._kept: dict[int, tuple[TipPoles, BoolArray, float]] = {}
        self._ready: dict[tuple[float, int, int], _Responses] = {}

    def _poles(self, depth: float) -> tuple[int, TipPoles, BoolArray, float]:
        """What matters up to the next power of two of a depth: its number, the poles with the static
        flexibility of all others, which they are, and the largest multiplier of the others.
        """
        level = int(np.ceil(np.log2(depth)))
        if level not in self._kept:
            tip, order = self._tip, np.argsort(self._peaks)
            small = np.zeros(len(order), dtype=bool)
            stiffest = self._stiffest * 2.0**level
            small[order] = np.cumsum(self._peaks[order]) * stiffest < NEGLIGIBLE
            small |= self._find_fast(2.0 * stiffest * self._peaks)
            rest = np.abs(np.exp(tip.values[small] * self.cut.tooth_period)).max(initial=0.0)
            self._kept[level] = keep_poles(tip, ~small), ~small, float(rest)
        return level, *self._kept[level]

    def _find_fast(self, gains: FloatArray) -> BoolArray:
        """``(q,)`` poles far above all that may chatter, none of which comes near it.

        Args:
            gains: ``(q,)`` of the loop of chip and tip at each pole; one chatters.
        """
        speeds, strong = np.abs(self._tip.values), gains >= FAINT
        if not strong.any():
            return strong
        return np.asarray(~strong & (speeds > ABOVE * speeds[strong].max()))

    def waves(self, depth: float) -> float:
        """Waves between two teeth of the fastest pole that matters in a cut of a depth."""
        _, tip, _, _ = self._poles(depth)
        return float(
            np.abs(tip.values.imag).max(initial=0.0) * self.cut.tooth_period / (2.0 * np.pi)
        )

    def rows(self, depth: float) -> int:
        """Rows of the matrix over a period at a depth: what a multiplier costs."""
        _, tip, _, _ = self._poles(depth)
        count = sum(window.nodes for window in self._windows(tip, depth, 0)[1])
        return count * self._axes.shape[1] + 2 * len(tip.values)

    def _windows(self, tip: TipPoles, depth: float, more: int) -> tuple[float, list[Window]]:
        """Start of the period [s], and its windows."""
        # in the cut the tip is as stiff as the machine and the cut together
        speeds = np.abs(tip.values)
        reach = np.linalg.norm(tip.inputs, axis=1) * np.linalg.norm(tip.outputs, axis=0)
        stiffest = self._stiffest * 2.0 ** np.ceil(np.log2(depth))
        fastest = np.sqrt(speeds * (speeds + stiffest * reach)).max(initial=0.0) / (2.0 * np.pi)
        return divide_period(self.cut, depth, float(fastest), more)

    def _respond(self, depth: float, more: int) -> tuple[_Responses, float]:
        """Responses at a depth, and the start of the period; straight teeth have one at all depths."""
        level, tip, _, _ = self._poles(depth)
        straight = self.cut.mill.helix == 0.0
        key = (0.0 if straight else depth, level, more)
        start, windows = self._windows(tip, depth, more)
        if key not in self._ready:
            if not straight:
                self._ready.clear()  # no depth comes twice
            self._ready[key] = _respond(tip, windows, self.cut.tooth_period)
        return self._ready[key], start

    def frequency(self, multiplier: Multiplier) -> float:
        """Angular frequency of chatter [rad/s]: of all that a multiplier may have the one nearest to
        its pole.
        """
        turn, period = 2.0 * np.pi, self.cut.tooth_period
        pole = float(abs(self._tip.values[multiplier.pole].imag))
        angle = float(np.angle(multiplier.value))
        waves = [round((pole * period - side * angle) / turn) for side in (1, -1)]
        found = [
            (turn * number + side * angle) / period
            for number, side in zip(waves, (1, -1), strict=True)
        ]
        return min((each for each in found if each >= 0.0), key=lambda each: abs(each - pole))

    def matrix(self, depth: float, more: int = 0) -> FloatArray:
        """Motions at the nodes and coordinates of the tip a period later per those before.

        Args:
            depth: Axial depth of cut [m].
            more: Nodes more in each window.
        """
        found, start = self._respond(depth, more)
        times = found.times
        if not len(times):
            return found.end
        gains = chip_stiffness(self.cut, start + times, np.array([depth]))[0] @ self._axes
        count, forces, axes = gains.shape
        # forces are gains times motions, node by node
        through, at_end = (
            (each.reshape(-1, count, 1, forces) @ gains).reshape(len(each), count * axes)
            for each in (found.own, found.forced)
        )
        solved = np.linalg.inv(np.eye(len(through)) - through)
        ahead, ends = solved @ found.free, at_end @ solved
        return np.block(
            [
                [np.eye(len(solved)) - solved, ahead],
                [-ends, found.end + at_end @ ahead],
            ]
        )

    def largest(self, depth: float, more: int = 0) -> Multiplier:
        """The largest multiplier of a cut; that of no cut where nothing moves.

        Args:
            depth: Axial depth of cut [m].
            more: Nodes more in each window.
        """
        matrix = self.matrix(depth, more)
        _, tip, kept, rest = self._poles(depth)
        if not len(matrix):
            return Multiplier(complex(rest), 0)
        value, vector = dominant_pair(matrix)
        if rest > abs(value):
            return Multiplier(complex(rest), int(np.flatnonzero(~kept)[0]))
        poles = len(tip.values)
        if not poles:
            return Multiplier(value, 0)
        size = np.linalg.norm(vector[-2 * poles :].reshape(2, poles), axis=0)
        # by the chip it makes: what hardly moves within a period meets its own wave
        chip = np.minimum(np.abs(tip.values) * self.cut.tooth_period, 2.0)
        moved = size * np.linalg.norm(tip.outputs, axis=0) * chip
        return Multiplier(value, int(np.flatnonzero(kept)[np.argmax(moved)]))


def _respond(tip: TipPoles, windows: list[Window], period: float) -> _Responses:
    poles, forces = tip.inputs.shape
    axes, count = len(tip.outputs), sum(window.nodes for window in windows)
    own = np.zeros((count, axes, count, forces))
    forced = np.zeros((poles, count, forces), dtype=complex)
    times = np.zeros(count)
    both = (tip.outputs.T[:, :, None] * tip.inputs[:, None, :]).reshape(poles, axes * forces)
    for span, begin, half, rule in _spread(windows):
        nodes = len(rule.nodes)
        times[span] = begin + half * (rule.nodes + 1.0)
        kernel = np.exp(tip.values[:, None] * (half * rule.lags.ravel()))
        kernels = (both.T @ kernel).real.reshape(axes * forces, *rule.lags.shape)
        within = half * (kernels.swapaxes(0, 1) @ rule.weights)  # (n, p r, n)
        own[span, :, span] = within.reshape(nodes, axes, forces, nodes).transpose(0, 1, 3, 2)
        moments = half * (np.exp(tip.values[:, None] * (half * rule.to_end)) @ rule.whole)
        pushed = moments[:, :, None] * tip.inputs[:, None, :]  # (q, n, r) at the end of the window
        forced[:, span] = np.exp(tip.values * (period - begin - 2.0 * half))[:, None, None] * pushed
        own[span, :, span] += np.eye(nodes)[:, None, :, None] * tip.static[:, None, :]
    for span, begin, half, _ in _spread(windows):
        if span.stop < count:
            later = times[span.stop :] - begin - 2.0 * half
            ahead = tip.outputs * np.exp(later[:, None, None] * tip.values)  # (l, p, q)
            moments = (
                forced[:, span] * np.exp(-tip.values * (period - begin - 2.0 * half))[:, None, None]
            )
            passed = ahead.reshape(-1, poles) @ moments.reshape(poles, -1)
            own[span.stop :, :, span] = passed.real.reshape(len(later), axes, -1, forces)
    moved = tip.outputs * np.exp(times[:, None, None] * tip.values)
    free = np.concatenate([moved.real, -moved.imag], axis=2).reshape(count * axes, -1)
    last = np.exp(tip.values * period)
    end = np.block(
        [[np.diag(last.real), np.diag(-last.imag)], [np.diag(last.imag), np.diag(last.real)]]
    )
    at_end = forced.reshape(poles, -1)
    return _Responses(
        times,
        own.reshape(count * axes, -1),
        free,
        end,
        np.concatenate([at_end.real, at_end.imag]),
    )


def _spread(
    windows: list[Window],
) -> Iterator[tuple[slice, float, float, Rule]]:
    """Places of the nodes of each window among all, its begin, half its length, and its rule."""
    first = 0
    for begin, end, nodes in windows:
        yield slice(first, first + nodes), begin, 0.5 * (end - begin), _gauss_rule(nodes)
        first += nodes


def dominant_pair(matrix: FloatArray) -> tuple[complex, ComplexArray]:
    """The largest eigenvalue and its vector: of the matrix on what a high power of it leaves of a few
    vectors, high enough for a small residual; of all eigenvalues where none is.

    Args:
        matrix: ``(n, n)``.
    """
    if len(matrix) <= SMALL_MATRIX:
        return _first_pair(matrix)
    power, space = matrix, _start_vectors(len(matrix))
    for squaring in range(SQUARINGS):
        power = power @ power
        power *= 1.0 / np.linalg.norm(power)
        if squaring + 1 < FEWEST_SQUARINGS:
            continue
        for _ in range(TIMES):
            space = power @ space
        space = np.linalg.qr(space)[0]
        moved = matrix @ space
        value, vector = _first_pair(space.T @ moved)
        if np.linalg.norm(moved @ vector - value * (space @ vector)) < RESIDUAL * abs(value):
            return value, space @ vector
    return _first_pair(matrix)


def _first_pair(matrix: FloatArray) -> tuple[complex, ComplexArray]:
    values, vectors = np.linalg.eig(matrix)
    first = int(np.argmax(np.abs(values)))
    return complex(values[first]), np.asarray(vectors[:, first], dtype=complex)


@functools.lru_cache(maxsize=64)
def _start_vectors(size: int) -> FloatArray:
    return np.random.default_rng(0).standard_normal((size, DOMINANT))
