"""What data and priors say about fitted parameters: intervals, correlations, and directions that
the data cannot see.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from headstock.geometry.frames import FloatArray

CONFIDENCE = 0.95
NAMED_SHARE = 0.25  # smallest entry of a direction that is named


@dataclass(frozen=True, eq=False)
class Combination:
    """A combination of parameters, and how far the data determine it.

    Attributes:
        entries: Parameter and its share of the direction, largest first; in units of what is
            allowed beforehand.
        spread: Standard deviation the data alone would leave, over what is allowed beforehand;
            above one the combination is unidentifiable.
    """

    entries: tuple[tuple[str, float], ...]
    spread: float

    def __str__(self) -> str:
        return " ".join(f"{share:+.2f} {name}" for name, share in self.entries)


@dataclass(frozen=True, eq=False)
class DataGroup:
    """Residuals that are one measurement, or count for nothing.

    Attributes:
        kind: Measurements of one kind share a noise factor.
        rows: Where its residuals stand.
        data: How many measurements they count for; 0 for a limit.
    """

    kind: str
    rows: slice
    data: int = 1


@dataclass(frozen=True)
class _Noise:
    """Size of the errors of one kind of measurement, or of all.

    Attributes:
        factor: On the stated tolerances; None with less than one degree of freedom.
        freedom: Measurements less the parameters that they determine.
    """

    factor: float | None
    freedom: float


@dataclass(frozen=True, eq=False)
class FitStatistics:
    """Spread of the fitted coordinates.

    Attributes:
        covariance: Of the coordinates with data and priors ``(p, p)``; inf on the diagonal where
            neither says anything, zero where a parameter is at its bound.
        quantiles: Half-width of each interval over its standard deviation ``(p,)``.
        data_share: Share of the variance allowed beforehand (prior, else bounds) that the data take away
            ``(p,)``.
        correlations: ``(p, p)``.
        combinations: Independent combinations of the parameters, the best determined first.
        bounded_covariance: The same where parameters without a prior spread evenly between their
            bounds, none at its bound fixed ``(p, p)``.
        allowed: Standard deviations before the data ``(p,)``: of priors, or between bounds.
        noise: Of all measurements together; degrees of freedom count in part for parameters that
            priors hold.
        noise_by_kind: The same of each kind.
        used_factors: Factors on the stated tolerances of each kind that the intervals hold for.
    """

    covariance: FloatArray
    quantiles: FloatArray
    data_share: FloatArray
    correlations: FloatArray
    combinations: tuple[Combination, ...]
    bounded_covariance: FloatArray
    allowed: FloatArray
    noise: _Noise
    noise_by_kind: dict[str, _Noise]
    used_factors: dict[str, float]

    @property
    def unidentifiable(self) -> tuple[Combination, ...]:
        """Combinations of which the data take away less than half of the variance."""
        return tuple(item for item in self.combinations if item.spread > 1.0)

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations of the coordinates ``(p,)``."""
        return np.sqrt(np.diag(self.covariance))

    def spread(self, slopes: FloatArray) -> float:
        """Return half of the 95 % interval of a number with derivatives ``(r, p)`` by the
        coordinates, of ``r`` values the root mean square; nan where it follows what is open.
        """
        felt = np.any(slopes != 0.0, axis=0)
        if not np.isfinite(self.sigmas[felt]).all():
            return np.nan
        reach = slopes[:, felt] * self.quantiles[felt]
        spread = np.einsum("rp,pq,rq->r", reach, self.covariance[np.ix_(felt, felt)], reach)
        return float(np.sqrt(np.mean(spread))) if felt.any() else 0.0

    def list_moves(self) -> FloatArray:
        """Return independent changes ``(m, p)`` of the coordinates by half of a 95 % interval, whose
        squares sum up to those of the intervals; open parameters do not move.
        """
        known = np.isfinite(self.sigmas)
        reach = np.where(known, self.quantiles, 0.0)
        covariance = np.where(np.outer(known, known), self.covariance, 0.0)
        sizes = np.sqrt(np.diag(covariance))
        scale = np.where(sizes > 0.0, sizes, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        kept = values > np.finfo(float).eps * len(values)
        return (vectors[:, kept] * np.sqrt(values[kept])).T * scale * reach

    def weigh(self, rows: FloatArray) -> tuple[float, float]:
        """Return what a further measurement would add: the expected gain of information on all
        parameters in bits, and the standard deviation of the weakest combination with it over that
        without it.

        Args:
            rows: ``(r, p)`` its derivatives over its standard deviations by the coordinates.
        """
        covariance = self.bounded_covariance
        weakest = np.linalg.eigh(covariance / np.outer(self.allowed, self.allowed))[1][:, -1]
        direction = weakest / self.allowed
        weighed = rows @ covariance
        inner = np.eye(len(rows)) + weighed @ rows.T
        after = covariance - weighed.T @ np.linalg.solve(inner, weighed)
        share = float((direction @ after @ direction) / (direction @ covariance @ direction))
        bits = 0.5 * float(np.linalg.slogdet(inner)[1]) / np.log(2.0)
        return bits, float(np.sqrt(max(share, 0.0)))

    def scatter(self, kind: str, sigma: float) -> float:
        """Return the standard deviation that measurements of a kind have, relative: as stated, or as
        their residuals show it.
        """
        return self.used_factors.get(kind, 1.0) * sigma


def assess(
    names: Sequence[str],
    jacobian: FloatArray,
    residuals: FloatArray,
    prior_sigmas: FloatArray,
    widths: FloatArray,
    *,
    from_residuals: bool,
    groups: Sequence[DataGroup] | None = None,
    at_bound: NDArray[np.bool_] | None = None,
) -> FitStatistics:
    """Return the statistics of a linearised fit that weighed its data by the stated tolerances.

    Args:
        jacobian: ``(r, p)`` of the data's residuals in standard deviations, by the coordinates.
        residuals: ``(r,)``.
        prior_sigmas: ``(p,)`` in coordinates, inf without a prior.
        widths: ``(p,)`` distance of the bounds in coordinates.
        from_residuals: Take the size of the errors of each kind from its residuals, not from the
            stated tolerances.
        groups: Measurements; None where each residual is one and all are of one kind.
        at_bound: Parameters that a bound holds ``(p,)``: the others are known as if these were fixed.

    Source: Tarantola (2005), chapter 3 (linearised posterior); White (1980) for errors of another
    size than the weights; Welch (1947) for degrees of freedom of sums of variances; Belsley, Kuh and
    Welsch (1980) for scaled singular vectors.
    """
    groups = groups or [DataGroup("", slice(row, row + 1)) for row in range(len(jacobian))]
    free = np.ones(len(names), dtype=bool) if at_bound is None else ~at_bound
    precision = np.where(np.isfinite(prior_sigmas), 1.0 / prior_sigmas, 0.0) ** 2
    # before the data each parameter may lie anywhere in its prior, or evenly between its bounds
    allowed = np.where(np.isfinite(prior_sigmas), prior_sigmas, widths / np.sqrt(12.0))
    acting = jacobian * free
    inverse, open_ = _invert(
        (acting.T @ acting)[np.ix_(free, free)] + np.diag(precision[free]), allowed[free]
    )
    gain = np.zeros((len(names), len(jacobian)))
    gain[free] = inverse @ acting[:, free].T
    noise, by_kind = _find_noise(groups, residuals, np.einsum("rp,pr->r", acting, gain))
    used = {kind: (item.factor or noise.factor or 1.0) for kind, item in by_kind.items()}
    used = used if from_residuals else dict.fromkeys(used, 1.0)
    factors = np.ones(len(jacobian))
    for group in groups:
        factors[group.rows] = used.get(group.kind, 1.0)
    covariance = np.zeros((len(names), len(names)))
    by_prior = inverse @ (precision[free][:, None] * inverse)
    covariance[np.ix_(free, free)] = by_prior
    covariance += (gain * factors**2) @ gain.T
    lost = np.flatnonzero(free)[open_]
    covariance[lost, lost] = np.inf
    weighed = jacobian / factors[:, None]
    # of a triangle, as there may be many more measurements than parameters
    _, values, directions = np.linalg.svd(np.linalg.qr(weighed * allowed, mode="r"))
    values = np.concatenate([values, np.zeros(len(names) - len(values))])
    proper = (directions.T / (values**2 + 1.0)) @ directions
    sigmas = np.sqrt(np.diag(covariance))
    scale = np.where(np.isfinite(sigmas) & (sigmas > 0.0), sigmas, 1.0)
    return FitStatistics(
        covariance=covariance,
        quantiles=_find_quantiles(groups, gain * factors, by_kind, noise, covariance)
        if from_residuals
        else np.full(len(names), norm.ppf(0.5 + CONFIDENCE / 2.0)),
        data_share=1.0 - np.diag(proper),
        correlations=np.nan_to_num(covariance / np.outer(scale, scale)),
        combinations=tuple(
            Combination(_name_direction(names, row), float(1.0 / value) if value > 0.0 else np.inf)
            for row, value in zip(directions, values, strict=True)
        ),
        bounded_covariance=proper * np.outer(allowed, allowed),
        allowed=allowed,
        noise=noise,
        noise_by_kind=by_kind,
        used_factors=used,
    )


def _find_noise(
    groups: Sequence[DataGroup], residuals: FloatArray, leverages: FloatArray
) -> tuple[_Noise, dict[str, _Noise]]:
    """Return the size of the errors of all measurements, and of those of each kind.

    Args:
        leverages: ``(r,)`` share of each residual that the parameters take up.
    """

    def find(chosen: Sequence[DataGroup]) -> _Noise:
        square, freedom = 0.0, 0.0
        for group in chosen:
            square += float(residuals[group.rows] @ residuals[group.rows])
            # several residuals of one measurement cannot determine more than it
            freedom += group.data - min(group.data, float(leverages[group.rows].sum()))
        return _Noise(float(np.sqrt(square / freedom)) if freedom >= 1.0 else None, freedom)

    counted = [group for group in groups if group.data]
    kinds = dict.fromkeys(group.kind for group in counted)
    return find(counted), {
        kind: find([group for group in counted if group.kind == kind]) for kind in kinds
    }


def _find_quantiles(
    groups: Sequence[DataGroup],
    gain: FloatArray,
    by_kind: dict[str, _Noise],
    noise: _Noise,
    covariance: FloatArray,
) -> FloatArray:
    """Return half-widths of intervals over standard deviations ``(p,)``: of Student's t, with the
    degrees of freedom of a sum of estimated variances.

    Args:
        gain: ``(p, r)`` error of each coordinate per error of each measurement of one sigma.
    """
    uncertain = np.zeros(len(gain))
    for kind, item in by_kind.items():
        share = np.zeros(len(gain))
        for group in groups:
            share += np.sum(gain[:, group.rows] ** 2, axis=1) if group.kind == kind else 0.0
        freedom = item.freedom if item.factor is not None else noise.freedom
        uncertain += share**2 / max(freedom, 1.0)
    variances = np.diag(covariance)
    usable = np.isfinite(variances) & (uncertain > 0.0)
    freedoms = np.full(len(gain), np.inf)
    freedoms[usable] = variances[usable] ** 2 / uncertain[usable]
    return np.where(
        np.isfinite(freedoms),
        t.ppf(0.5 + CONFIDENCE / 2.0, np.where(np.isfinite(freedoms), freedoms, 1.0)),
        norm.ppf(0.5 + CONFIDENCE / 2.0),
    )


def _invert(information: FloatArray, allowed: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the inverse of an information matrix where it is determined, and the parameters about
    which something is not known at all.
    """
    if not len(allowed):
        return information, np.zeros(0, dtype=np.intp)
    scaled = information * np.outer(allowed, allowed)
    values, vectors = np.linalg.eigh(scaled)
    determined = values > np.finfo(float).eps * len(values) * max(float(values[-1]), 1.0)
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    lost = np.einsum("ij,ij->i", vectors[:, ~determined], vectors[:, ~determined]) > 1e-9
    return inverse * np.outer(allowed, allowed), np.flatnonzero(lost)


def _name_direction(names: Sequence[str], direction: FloatArray) -> tuple[tuple[str, float], ...]:
    order = np.argsort(-np.abs(direction))
    sign = np.sign(direction[order[0]])
    return tuple(
        (names[i], float(sign * direction[i])) for i in order if abs(direction[i]) >= NAMED_SHARE
    )
