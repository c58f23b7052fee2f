"""Floquet multipliers of a cut by collocation in the cut alone.

Unknown are the motions of the tip at Gauss nodes of the windows of a tooth period in which a tooth
cuts; between them the tip moves by its impulse response, pole by pole:

    y(t) = Phi(t) z(0) + int_0^t H(t - s) G(s) [y(s) - y(s - T)] ds + D G(t) [y(t) - y(t - T)]

with ``G`` of period ``T``, the time from tooth to tooth, which is the delay as well. Windows begin and
end where ``G`` has a corner: where the lower or the upper end of an edge enters or leaves the part.
Within a window all functions are smooth, so that multipliers converge exponentially with the number
of nodes (spectral collocation: Butcher and Bobrenkov 2011; Insperger and Stepan 2011, sec. 3, have
semi-discretisation as an independent method). Multipliers say whether the cut is stable: all below
one.
"""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.milling.coefficients import CuttingCoefficients, Three
from headstock.solvers.milling.forces import EndMill, MillingCut, Sense, chip_stiffness
from headstock.solvers.milling.tip_poles import ComplexArray, TipPoles, keep_poles
from headstock.solvers.milling.windows import Window, divide_period

FINER = 3  # nodes more in each window, where a limit is confirmed
EXTRA_POINTS = 8  # of quadrature, besides the nodes
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
CHEAP_ROWS = 70  # of a matrix whose squaring takes as long as to apply it a few times
SMALL_MATRIX = 36  # rows up to which all eigenvalues take no longer


class Multiplier(NamedTuple):
    """The largest multiplier of a cut, and the pole whose motion makes the largest chip in it.

    Attributes:
        value: Complex, per tooth period.
    """

    value: complex
    pole: int


class _Rule(NamedTuple):
    """Gauss nodes of a window ``[-1, 1]`` and integrals over Lagrange polynomials on them.

    Attributes:
        nodes: ``(n,)``.
        lags: ``(q,)`` from points of quadrature to the end of the window, at which an impulse response
            is known.
        whole: ``(q, n)`` of that response times the polynomials over the whole window.
        parts: ``(q, n n)`` of it times the polynomials up to each node.
    """

    nodes: FloatArray
    lags: FloatArray
    whole: FloatArray
    parts: FloatArray


@functools.lru_cache(maxsize=64)
def _gauss_rule(count: int) -> _Rule:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    points, shares = np.polynomial.legendre.leggauss(count + EXTRA_POINTS)
    half = 0.5 * (nodes[:, None] + 1.0)
    before = half * (points + 1.0) - 1.0
    through = (half * shares)[..., None] * _lagrange(nodes, weights, before)
    # from each point before a node up to it, as a place among the points
    response = _lagrange(points, shares, 1.0 - half * (1.0 - points))
    parts = np.einsum("ijk,ijq->qik", through, response)
    return _Rule(
        nodes,
        1.0 - points,
        shares[:, None] * _lagrange(nodes, weights, points),
        parts.reshape(len(points), -1),
    )


def _lagrange(nodes: FloatArray, weights: FloatArray, places: FloatArray) -> FloatArray:
    """``(..., n)`` Lagrange polynomials at places, by Legendre series (discrete orthogonality)."""
    degrees = np.arange(len(nodes))
    series = np.polynomial.legendre.legvander(nodes, len(nodes) - 1) * (degrees + 0.5)
    values = np.polynomial.legendre.legvander(places, len(nodes) - 1)
    return values @ (series * weights[:, None]).T


@dataclass(frozen=True, eq=False)
class _PeriodResponse:
    """Of a tip over the windows of a tooth period with ``N`` nodes at which it moves along ``k`` axes.

    Coordinates of the tip ``2 q`` are real parts of all poles, then imaginary parts. Motions are those
    since the last tooth, and responses to them per depth of cut.

    Attributes:
        free: ``(k, N, 2 q)`` motions at the nodes per coordinates at the end of the window before.
        forced: Of each window with ``n`` nodes, ``(k n, k n)`` per motions in the window [1/m].
        turns: ``(w + 1, 2 q, 2 q)`` coordinates at the end of each window, and of the period, per those
            at the end before.
        pushed: ``(2 q, k, N)`` coordinates at the end of a window per motions in it.
    """

    spans: list[slice]
    free: FloatArray
    forced: list[FloatArray]
    turns: FloatArray
    pushed: FloatArray


@dataclass(frozen=True, eq=False)
class _PolesInCut:
    """What matters of a tip in cuts up to a depth.

    Attributes:
        tip: Poles that matter and the static flexibility of all others, motions along ``axes``.
        kept: ``(q,)`` which of all poles they are.
        products: ``(k r, q)`` of outputs and inputs.
        axes: ``(2, k)`` columns along which the tip moves.
        fastest: Angular frequency that nodes have to follow [rad/s]: in the cut the tip is as stiff as
            the machine and the cut together.
        slowest_decay: Largest real part of the poles left out [1/s]; minus infinity for none.
    """

    tip: TipPoles
    kept: BoolArray
    products: ComplexArray
    axes: FloatArray
    fastest: float
    slowest_decay: float


GAIN_TIMES, MOST_GAIN_TIMES = 96, 100_000  # of a tooth period


@functools.lru_cache(maxsize=64)
def stiffest_gain(mill: EndMill, chip: Three, radial_depth: float, sense: Sense) -> float:
    """Largest stiffness of a thin cut within a tooth period, per depth [N/m^2].

    Args:
        chip: Coefficients of the chip [N/m^2].
        radial_depth: At most the diameter [m].
    """
    thin = 1e-3 * mill.diameter
    coefficients = CuttingCoefficients(chip, (0.0, 0.0, 0.0), "")
    cut = MillingCut(mill, coefficients, 1.0, thin, radial_depth, sense=sense)
    # a thin cut lasts a small part of the period, which several of the times must meet
    arc = float(np.arccos(1.0 - 2.0 * min(radial_depth / mill.diameter, 1.0)))
    count = int(np.clip(8.0 * 2.0 * np.pi / (mill.teeth * arc), GAIN_TIMES, MOST_GAIN_TIMES))
    times = np.linspace(0.0, cut.tooth_period, count, endpoint=False, dtype=np.float64)
    gains = chip_stiffness(cut, times, thin)
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
    shares = (1.0 / (lines[:, None] - values) for values in (tip.values, tip.values.conj()))
    both = (tip.outputs, tip.outputs.conj()), (tip.inputs, tip.inputs.conj())
    response = tip.static + 0.5 * sum(
        np.einsum("pq,fq,qr->fpr", outputs, share, inputs)
        for outputs, share, inputs in zip(both[0], shares, both[1], strict=True)
    )
    return 0.5 / (_stiffest(cut) * float(np.linalg.norm(response, 2, axis=(1, 2)).max()))


@functools.lru_cache(maxsize=16)
def _moving_axes(tip: TipPoles) -> FloatArray:
    """``(2, k)`` columns along which a tip moves."""
    left, size, _ = scipy.linalg.svd(
        np.concatenate([tip.outputs.real, tip.outputs.imag, tip.static], axis=1),
        full_matrices=False,
    )
    return left[:, size > RANK * size.max(initial=0.0)]


@functools.lru_cache(maxsize=256)
def _choose_poles(tip: TipPoles, stiffest: float) -> _PolesInCut:
    """Poles of a tip that matter in a cut, the same at all speeds.

    Args:
        tip: Motions along and away, forces along all axes.
        stiffest: The largest stiffness of the cut [N/m].
    """
    axes = _moving_axes(tip)
    tip = TipPoles(tip.values, tip.inputs, axes.T @ tip.outputs, axes.T @ tip.static)
    speeds = np.abs(tip.values)
    reach = np.linalg.norm(tip.inputs, axis=1) * np.linalg.norm(tip.outputs, axis=0)
    peaks = reach / np.maximum(np.abs(tip.values.real), SLOWEST * speeds.max(initial=0.0))
    order = np.argsort(peaks)
    small = np.zeros(len(order), dtype=bool)
    small[order] = np.cumsum(peaks[order]) * stiffest < NEGLIGIBLE
    # far above all that may chatter, and none of them comes near it
    strong = 2.0 * stiffest * peaks >= FAINT
    if strong.any():
        small |= ~strong & (speeds > ABOVE * speeds[strong].max())
    own, kept = speeds[~small], keep_poles(tip, ~small)
    products = kept.outputs[:, None, :] * kept.inputs.T[None, :, :]
    return _PolesInCut(
        kept,
        ~small,
        products.reshape(-1, len(own)),
        axes,
        float(np.sqrt(own * (own + stiffest * reach[~small])).max(initial=0.0)),
        float(tip.values.real[small].max(initial=-math.inf)),
    )


class PeriodicCut:
    """A tip and a cut at a speed of the spindle, at any depth.

    Args:
        tip: In coordinates of its own; motions along and away, forces along all axes.
        cut: Tool, material, radial depth and speed; its axial depth has no part in it.
    """

    def __init__(self, tip: TipPoles, cut: MillingCut) -> None:
        self.cut = cut
        self._tip = tip
        self._stiffest = _stiffest(cut)
        self._respond_straight = functools.lru_cache(maxsize=4)(self._respond_at)

    def _poles(self, depth: float) -> _PolesInCut:
        """What matters up to the next power of two of a depth."""
        return _choose_poles(self._tip, self._stiffest * 2.0 ** math.ceil(math.log2(depth)))

    def _windows(self, depth: float, more: int) -> tuple[float, tuple[Window, ...]]:
        """Start of the period [s], and its windows."""
        return divide_period(self.cut, depth, self._poles(depth).fastest / (2.0 * np.pi), more)

    def waves(self, depth: float) -> float:
        """Waves between two teeth of the fastest pole that matters in a cut of a depth."""
        values = self._poles(depth).tip.values
        return float(np.abs(values.imag).max(initial=0.0)) * self.cut.tooth_period / (2.0 * np.pi)

    def rows(self, depth: float) -> int:
        """Rows of the matrix over a period at a depth: what a multiplier costs."""
        poles = self._poles(depth)
        count = sum(window.nodes for window in self._windows(depth, 0)[1])
        return count * poles.axes.shape[1] + 2 * len(poles.tip.values)

    def _respond(self, depth: float, more: int) -> _PeriodResponse:
        """Responses at a depth; straight teeth have one at all depths."""
        ready = self._poles(depth), *self._windows(depth, more)
        if self.cut.mill.helix != 0.0:
            return self._respond_at(*ready, depth)
        return self._respond_straight(*ready)

    def _respond_at(
        self, poles: _PolesInCut, start: float, windows: tuple[Window, ...], depth: float = 1.0
    ) -> _PeriodResponse:
        return _respond_in_period(poles, self.cut, start, windows, depth)

    def frequency(self, multiplier: Multiplier) -> float:
        """Angular frequency of chatter [rad/s]: of all that a multiplier may have the one nearest to
        its pole.
        """
        turn, period = 2.0 * np.pi, self.cut.tooth_period
        pole = float(abs(self._tip.values[multiplier.pole].imag))
        angle = float(np.angle(multiplier.value))
        waves = [round((pole * period - side * angle) / turn) for side in (1, -1)]
        candidates = [
            (turn * number + side * angle) / period
            for number, side in zip(waves, (1, -1), strict=True)
        ]
        return min(
            (omega for omega in candidates if omega >= 0.0), key=lambda omega: abs(omega - pole)
        )

    def matrix(self, depth: float, more: int = 0) -> FloatArray:
        """Coordinates of the tip and motions at the nodes a period later per those before.

        Args:
            depth: Axial depth of cut [m].
        """
        response = self._respond(depth, more)
        axes, count, coordinates = response.free.shape
        size = coordinates + axes * count
        whole, state = np.zeros((size, size)), np.zeros((coordinates, size))
        state[:, :coordinates] = _identity(coordinates)
        last = coordinates
        for span, forced, turn in zip(
            response.spans, response.forced, response.turns[:-1], strict=True
        ):
            # before this window only what is in state[:, :last] has moved
            some, before = slice(last, last + len(forced)), state[:, :last]
            identity = _identity(len(forced))
            solved = np.linalg.inv(identity - depth * forced)
            moved = solved @ response.free[:, span].reshape(len(forced), -1)
            pushed = depth * response.pushed[:, :, span].reshape(-1, len(forced))
            whole[some, :last] = moved @ before
            whole[some, some] = identity - solved
            state[:, :last] = (turn + pushed @ moved) @ before
            state[:, some] = -pushed @ solved
            last = some.stop
        whole[:coordinates] = response.turns[-1] @ state
        return whole

    def largest(self, depth: float, more: int = 0) -> Multiplier:
        """The largest multiplier of a cut; that of no cut where nothing moves.

        Args:
            depth: Axial depth of cut [m].
        """
        matrix, poles = self.matrix(depth, more), self._poles(depth)
        rest = complex(math.exp(poles.slowest_decay * self.cut.tooth_period))
        if not len(matrix):
            return Multiplier(rest, 0)
        value, vector = _dominant_pair(matrix)
        if rest.real > abs(value):
            return Multiplier(rest, int(np.flatnonzero(~poles.kept)[0]))
        tip = poles.tip
        if not len(tip.values):
            return Multiplier(value, 0)
        size = np.linalg.norm(vector[: 2 * len(tip.values)].reshape(2, -1), axis=0)
        # by the chip it makes: what hardly moves within a period meets its own wave
        chip = np.minimum(np.abs(tip.values) * self.cut.tooth_period, 2.0)
        moved = size * np.linalg.norm(tip.outputs, axis=0) * chip
        return Multiplier(value, int(np.flatnonzero(poles.kept)[np.argmax(moved)]))


def _respond_in_period(
    poles: _PolesInCut, cut: MillingCut, start: float, windows: tuple[Window, ...], depth: float
) -> _PeriodResponse:
    """Responses of a tip over a tooth period.

    Args:
        cut: Tool, material and speed.
        start: Of the period [s].
        depth: Axial depth for which the windows are [m].
    """
    tip = poles.tip
    axes, forces = tip.static.shape
    begins, ends, halves = (
        np.array([(own.begin, own.end, 0.5 * (own.end - own.begin)) for own in windows])
        .reshape(-1, 3)
        .T
    )
    rules = [_gauss_rule(window.nodes) for window in windows]
    counts = [window.nodes for window in windows]
    nodes, lags = (np.concatenate([[], *(rule[part] for rule in rules)]) for part in (0, 1))
    at = np.repeat(begins, counts) + np.repeat(halves, counts) * (1.0 + nodes)
    gains = chip_stiffness(cut, start + at, depth) @ (poles.axes / depth)
    gains = np.ascontiguousarray(gains.transpose(1, 2, 0))  # (r, k, N)
    before = np.concatenate([[0.0], ends])
    weights = np.repeat(halves, [count + EXTRA_POINTS for count in counts])
    instants = np.concatenate(
        [
            at - np.repeat(before[:-1], counts),
            np.diff(before, append=cut.tooth_period),
            weights * lags,
        ]
    )
    factors = np.exp(np.multiply.outer(tip.values, instants))
    moved, turns, response = np.split(factors, [len(at), len(at) + len(before)], axis=1)
    response = weights * response
    kernel = (poles.products @ response).real  # (k r, points)
    moments, spans, forced = np.empty_like(moved), [], []
    for rule, end, point in zip(
        rules, np.cumsum(counts), np.cumsum([len(rule.lags) for rule in rules]), strict=True
    ):
        span, points = slice(end - len(rule.nodes), end), slice(point - len(rule.lags), point)
        moments[:, span] = response[:, points] @ rule.whole
        within = kernel[:, points] @ rule.parts  # (k r, n n)
        within[:, :: len(rule.nodes) + 1] += tip.static.reshape(-1, 1)
        within = within.reshape(axes, forces, len(rule.nodes), -1)
        through = np.einsum("krij,rlj->kilj", within, gains[:, :, span])
        forced.append(through.reshape(axes * len(rule.nodes), -1))
        spans.append(span)
    free = tip.outputs[:, None] * moved.T
    pushed = (tip.inputs @ gains.reshape(forces, -1)).reshape(-1, axes, len(at))
    pushed = pushed * moments[:, None]
    return _PeriodResponse(
        spans,
        np.concatenate([free.real, -free.imag], axis=2),
        forced,
        _multiply(turns.T),
        np.concatenate([pushed.real, pushed.imag]),
    )


@functools.lru_cache(maxsize=64)
def _identity(size: int) -> FloatArray:
    return np.eye(size)


def _multiply(factors: ComplexArray) -> FloatArray:
    """``(w, 2 q, 2 q)`` that multiply coordinates by complex factors ``(w, q)``."""
    count = factors.shape[1]
    matrices = np.zeros((len(factors), 2, count, 2, count))
    diagonal = np.arange(count)
    matrices[:, 0, diagonal, 0, diagonal] = matrices[:, 1, diagonal, 1, diagonal] = factors.real
    matrices[:, 1, diagonal, 0, diagonal] = factors.imag
    matrices[:, 0, diagonal, 1, diagonal] = -factors.imag
    return matrices.reshape(len(factors), 2 * count, -1)


def _dominant_pair(matrix: FloatArray) -> tuple[complex, ComplexArray]:
    """The largest eigenvalue and its vector: of the matrix on what a high power of it leaves of a few
    vectors, high enough for a small residual; of all eigenvalues where none is.

    Args:
        matrix: ``(n, n)``.
    """
    if len(matrix) <= SMALL_MATRIX:
        return _first_pair(matrix)
    # single precision is enough to find the space of a few vectors, not their values
    power, space = matrix.astype(np.float32), _start_vectors(len(matrix))
    # a squaring of many rows takes longer than to apply what is there twice as often
    spared = max(0, round(math.log2(len(matrix) / CHEAP_ROWS)))
    for squaring in range(SQUARINGS - spared):
        power = power @ power
        power *= 1.0 / np.linalg.norm(power)
        if squaring + 1 + spared < FEWEST_SQUARINGS:
            continue
        for _ in range(TIMES * 2**spared):
            space = power @ space
            space *= 1.0 / np.linalg.norm(space)
        space = np.linalg.qr(matrix @ space)[0]
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
    return np.random.default_rng(0).standard_normal((size, DOMINANT)).astype(np.float32)
