"""Poles chosen and refined from frequency responses: candidates of all orders, clusters of them, and a
modal model that keeps only what the responses show.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # whose distributions are loaded where they are used
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.modal_fitting.candidates import OrderPoles, find_candidates
from headstock.solvers.modal_fitting.modal_model import (
    ModalModel,
    RefinedPoles,
    WeightedResponses,
    build_model,
    fit_shapes,
    pole_covariances,
    refine,
)
from headstock.solvers.modal_fitting.noise import (
    noise_from_neighbours,
    noise_from_residuals,
    separate_deviations,
)
from headstock.solvers.modal_fitting.remaining import strongest_pole
from headstock.solvers.modal_fitting.stabilisation import (
    PoleCluster,
    cluster_poles,
    damping_ratios,
)
from headstock.solvers.second_order import ComplexArray

BAND_RATIO = 4.0  # highest over lowest frequency of a band in which one model is sought
BAND_LINES = 120  # fewer make no band of their own
OVERLAP = 0.15  # of a band's width, on both sides
OUTSIDE = 0.05  # of the width of all lines: modes this far outside of them are fitted, too
FAR, OVERDAMPED = (
    4.0,
    0.4,
)  # factor of frequency, damping ratio: no support of the model within the band
CHANCE = 1e-6  # that noise alone makes a mode, over all lines
SEARCHES, ROUNDS = 2, 12  # of candidates from what is left: by models of all orders, one by one
REWEIGHTED = 2  # times that weights are taken from what a fit leaves
SPLIT = 0.5  # of a pole's rate, to both sides
CLOSE = 1.0  # of the sum of two poles' rates: poles that are nearer may be one


@dataclass(frozen=True, eq=False)
class PoleFit:
    """Modes that frequency responses show.

    Attributes:
        model: ``k`` modes by rising frequency.
        covariances: ``(k, 2, 2)`` of the real and imaginary part of each pole [1/s^2].
        clusters: The candidates they were refined from.
        steps: Poles of all orders, one list per band.
    """

    model: ModalModel
    covariances: FloatArray
    clusters: tuple[PoleCluster, ...]
    steps: tuple[tuple[OrderPoles, ...], ...]


def fit_poles(
    frequencies_hz: FloatArray,
    values: ComplexArray,
    *,
    order: int,
    deviations: FloatArray | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> PoleFit:
    """Choose and refine the modes that responses show.

    Args:
        frequencies_hz: ``(l,)`` lines, increasing and positive.
        values: ``(l, m, f)``; nan throughout a pair that was not measured.
        order: Highest order of the rational models.
        deviations: ``(l, m, f)`` standard deviations of values, where they are known.
        progress: Receives what is done.
    """
    squares = noise_from_neighbours(values) if deviations is None else deviations**2
    data = _weigh(frequencies_hz, values, squares)
    if deviations is None:
        squares = noise_from_neighbours(values, disturbed=True)
    empty = np.zeros(0, dtype=np.complex128)
    chosen = _Chosen(fit_shapes(data, empty, np.zeros((values.shape[2], 0), complex)), ())
    first_steps: list[tuple[OrderPoles, ...]] = []
    for number in range(ROUNDS):
        count = len(chosen.clusters)
        progress(f"candidates, round {number + 1}: {count} modes so far")
        rest = values - build_model(data, chosen.fit).evaluate(frequencies_hz)
        left = dataclasses.replace(data, values=rest)
        clusters: list[PoleCluster] = []
        if number < SEARCHES:
            steps, clusters = _search(left, order=order // (1 + number))
            first_steps = first_steps or steps
        clusters = clusters or [strongest_pole(left)]
        candidates = _keep_shown(data, _join(data, chosen, clusters))
        if len(candidates.clusters) > count:
            fit = refine(data, candidates.fit.poles, candidates.fit.participations)
            candidates = _simplify(data, _Chosen(fit, candidates.clusters))
        if len(candidates.clusters) > count:
            chosen = candidates
            data = _reweigh(data, chosen.fit, squares, known=deviations is not None)
        elif number >= SEARCHES:
            candidates = _split(data, chosen, clusters[0].pole)
            if len(candidates.clusters) == count:
                break
            chosen = candidates
            data = _reweigh(data, chosen.fit, squares, known=deviations is not None)
    for _ in range(REWEIGHTED):
        data = _reweigh(data, chosen.fit, squares, known=deviations is not None)
        fit = refine(data, chosen.fit.poles, chosen.fit.participations)
        chosen = _simplify(data, _Chosen(fit, chosen.clusters))
    chosen = chosen.pick(np.argsort(np.abs(chosen.fit.poles)))
    return PoleFit(
        build_model(data, chosen.fit),
        pole_covariances(data, chosen.fit),
        chosen.clusters,
        tuple(first_steps),
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Modes chosen so far, and the candidate each came from."""

    fit: RefinedPoles
    clusters: tuple[PoleCluster, ...]

    def pick(self, kept: NDArray[np.int64]) -> "_Chosen":
        """Return some of them, as they are."""
        fit = dataclasses.replace(
            self.fit,
            poles=self.fit.poles[kept],
            participations=self.fit.participations[:, kept],
            gains=self.fit.gains[kept],
        )
        return _Chosen(fit, tuple(self.clusters[number] for number in kept))


def _split_bands(frequencies_hz: FloatArray) -> list[tuple[int, int]]:
    """Return first and last but one line of bands, each over no more than a factor of frequency, as
    the width of a resonance grows with it; few where there are few lines.
    """
    low, high = float(frequencies_hz[0]), float(frequencies_hz[-1])
    ends = [len(frequencies_hz)]
    while ends[-1] > 0:
        edge = float(frequencies_hz[ends[-1] - 1]) / BAND_RATIO
        begin = int(np.searchsorted(frequencies_hz, edge))
        begin = min(begin, ends[-1] - BAND_LINES)
        ends.append(begin if begin >= BAND_LINES and low < high else 0)
    return [(begin, end) for end, begin in itertools.pairwise(ends)][::-1]


def _search(
    data: WeightedResponses, *, order: int
) -> tuple[list[tuple[OrderPoles, ...]], list[PoleCluster]]:
    """Find candidates band by band: poles of all orders, clusters."""
    hz = data.frequencies_hz
    complete = data.measured.all(axis=1)
    whole = hz[-1] - hz[0]
    all_steps, clusters = [], []
    for begin, end in _split_bands(hz):
        margin = OVERLAP * (hz[end - 1] - hz[begin])
        lines = (hz >= hz[begin] - margin) & (hz <= hz[end - 1] + margin)
        steps = find_candidates(
            hz[lines], data.weighted[lines][:, complete], order=min(order, int(lines.sum()) // 3)
        )
        low = hz[begin] if begin else hz[0] - OUTSIDE * whole
        high = hz[end] if end < len(hz) else hz[-1] + OUTSIDE * whole
        clusters += cluster_poles(steps, from_hz=float(low), to_hz=float(high))
        all_steps.append(tuple(steps))
    return all_steps, clusters


def _join(data: WeightedResponses, chosen: _Chosen, clusters: Sequence[PoleCluster]) -> _Chosen:
    """Add candidates to the modes chosen so far."""
    poles = np.array([cluster.pole for cluster in clusters], dtype=np.complex128)
    vectors = [cluster.participation[:, None] for cluster in clusters]
    fit = fit_shapes(
        data,
        np.concatenate([chosen.fit.poles, poles]),
        np.concatenate([chosen.fit.participations, *vectors], axis=1),
    )
    return _Chosen(fit, (*chosen.clusters, *clusters))


def _split(data: WeightedResponses, chosen: _Chosen, pole: complex) -> _Chosen:
    """Try two modes in place of the one nearest to a pole that alone shows too little: one mode may stand
    between two, where neither shows.
    """
    if not chosen.clusters:
        return chosen
    fit = chosen.fit
    near = int(np.argmin(np.abs(fit.poles - pole)))
    apart = 1j * SPLIT * abs(fit.poles[near].real)
    poles = np.append(fit.poles, fit.poles[near] + apart)
    poles[near] -= apart
    vectors = np.column_stack([fit.participations, fit.participations[:, near]])
    tried = _Chosen(refine(data, poles, vectors), (*chosen.clusters, chosen.clusters[near]))
    tried = _simplify(data, tried)
    return tried if len(tried.clusters) > len(chosen.clusters) else chosen


def _reweigh(
    data: WeightedResponses, fit: RefinedPoles, squares: FloatArray, *, known: bool
) -> WeightedResponses:
    """Return responses with weights from what a fit leaves of them, unless noise is known.

    Args:
        squares: ``(l, m, f)`` of noise as neighbouring lines have it. A mode that is missing makes the
            one estimate too large, a mode that is narrow the other: the smaller counts.
    """
    if known:
        return data
    model = build_model(data, fit).evaluate(data.frequencies_hz)
    rest = noise_from_residuals(data.values - model, model)
    return _weigh(data.frequencies_hz, data.values, np.minimum(rest, squares))


def _weigh(
    frequencies_hz: FloatArray, values: ComplexArray, squares: FloatArray
) -> WeightedResponses:
    lines, motions, forces = (
        np.asarray(1.0 / each, dtype=np.float64) for each in separate_deviations(squares, values)
    )
    return WeightedResponses(frequencies_hz, values, lines, motions, forces)


def _least_gain(data: WeightedResponses, fit: RefinedPoles) -> float:
    """Return how much of the sum of squares a mode must take away: noise alone hardly does."""
    motions, forces = data.measured.shape
    chance = CHANCE / len(data.frequencies_hz)
    variance = max(1.0, fit.squares / data.freedom(len(fit.poles)))
    return variance * float(scipy.special.chdtri(2.0 * (motions + forces), chance))


def _keep_shown(data: WeightedResponses, chosen: _Chosen) -> _Chosen:
    """Leave out modes that take no more away than noise does, the least first, and what is no
    resonance near the lines.
    """
    hz = np.abs(chosen.fit.poles) / (2.0 * np.pi)
    near = (hz > data.frequencies_hz[0] / FAR) & (hz < data.frequencies_hz[-1] * FAR)
    kept = np.flatnonzero(near & (damping_ratios(chosen.fit.poles) < OVERDAMPED))
    if len(kept) < len(hz):
        fit = fit_shapes(data, chosen.fit.poles[kept], chosen.fit.participations[:, kept])
        chosen = _Chosen(fit, chosen.pick(kept).clusters)
    while chosen.clusters:
        fit = chosen.fit
        weakest = int(np.argmin(fit.gains))
        if fit.gains[weakest] > _least_gain(data, fit):
            break
        kept = np.delete(np.arange(len(fit.poles)), weakest)
        fit = fit_shapes(data, fit.poles[kept], fit.participations[:, kept])
        chosen = _Chosen(fit, chosen.pick(kept).clusters)
    return chosen


def _simplify(data: WeightedResponses, chosen: _Chosen) -> _Chosen:
    """Leave out what is not shown, and one of two close modes where the other does as well; refine
    what stays.
    """
    while True:
        count = len(chosen.clusters)
        chosen = _keep_shown(data, chosen)
        if len(chosen.clusters) < count:
            fit = refine(data, chosen.fit.poles, chosen.fit.participations)
            chosen = _Chosen(fit, chosen.clusters)
        else:
            chosen = _join_close(data, chosen)
        if len(chosen.clusters) == count:
            return chosen


def _join_close(data: WeightedResponses, chosen: _Chosen) -> _Chosen:
    """Leave out one of two close modes where the other, refined alone, does as well."""
    fit = chosen.fit
    rates = np.abs(fit.poles.real)
    distances = np.abs(fit.poles[:, None] - fit.poles) / (rates[:, None] + rates)
    for first, second in np.argwhere(np.triu(distances < CLOSE, 1)):
        dropped = int(first if fit.gains[first] < fit.gains[second] else second)
        kept = np.delete(np.arange(len(fit.poles)), dropped)
        tried = refine(data, fit.poles[kept], fit.participations[:, kept])
        if tried.squares - fit.squares < _least_gain(data, fit):
            return _Chosen(tried, chosen.pick(kept).clusters)
    return chosen
