"""What data and priors say about fitted parameters: intervals, correlations, and directions that
the data cannot see.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

from headstock.geometry.frames import FloatArray

CONFIDENCE = 0.95
SEEN_SHARE = 0.5  # of the variance allowed beforehand that the data must take away
NAMED_SHARE = 0.25  # smallest entry of a direction that is named


@dataclass(frozen=True, eq=False)
class _UnidentifiableDirection:
    """A combination of parameters that the data do not fix.

    Attributes:
        entries: Parameter and its share of the direction, largest first; in units of what is
            allowed beforehand.
        spread: Standard deviation the data alone would leave, over what is allowed beforehand;
            above one the data say nothing.
    """

    entries: tuple[tuple[str, float], ...]
    spread: float

    def __str__(self) -> str:
        return " ".join(f"{share:+.2f} {name}" for name, share in self.entries)


@dataclass(frozen=True, eq=False)
class FitStatistics:
    """Spread of the fitted coordinates.

    Attributes:
        sigmas: Standard deviations with data and priors ``(p,)``; inf where neither says anything.
        quantile: Half-width of the interval over sigma.
        data_share: Share of the variance allowed beforehand (prior, else bounds) that the data take away
            ``(p,)``.
        correlations: ``(p, p)``.
        unidentifiable: Directions the data do not see.
        noise: Factor on the stated tolerances that the residuals ask for; None with too few of
            them.
        freedom: Degrees of freedom of the data, parameters that priors hold counted in part.
    """

    sigmas: FloatArray
    quantile: float
    data_share: FloatArray
    correlations: FloatArray
    unidentifiable: tuple[_UnidentifiableDirection, ...]
    noise: float | None
    freedom: float


def assess(
    names: Sequence[str],
    jacobian: FloatArray,
    residuals: FloatArray,
    prior_sigmas: FloatArray,
    widths: FloatArray,
    *,
    from_residuals: bool,
) -> FitStatistics:
    """Statistics of a linearised fit.

    Args:
        jacobian: ``(r, p)`` of the data's residuals in standard deviations, by the coordinates.
        residuals: ``(r,)``.
        prior_sigmas: ``(p,)`` in coordinates, inf without a prior.
        widths: ``(p,)`` distance of the bounds in coordinates.
        from_residuals: Take the size of the errors from the residuals, not from the stated
            tolerances.

    Source: Tarantola (2005), chapter 3 (linearised posterior); Belsley, Kuh and Welsch (1980) for
    scaled singular vectors.
    """
    precision = np.where(np.isfinite(prior_sigmas), 1.0 / prior_sigmas, 0.0) ** 2
    normal = jacobian.T @ jacobian
    # a parameter counts by the share that the data and not its prior gives
    by_data = np.trace(np.linalg.pinv(normal + np.diag(precision), hermitian=True) @ normal)
    freedom = float(len(jacobian) - by_data)
    noise = float(np.sqrt(residuals @ residuals / freedom)) if freedom >= 1.0 else None
    used = noise if from_residuals and noise is not None and noise > 0.0 else 1.0
    weighed = jacobian / used
    # before the data each parameter may lie anywhere in its prior, or evenly between its bounds
    allowed = np.where(np.isfinite(prior_sigmas), prior_sigmas, widths / np.sqrt(12.0))
    _, values, directions = np.linalg.svd(weighed * allowed)
    values = np.concatenate([values, np.zeros(len(names) - len(values))])
    posterior = _invert(weighed.T @ weighed + np.diag(precision), allowed)
    sigmas = np.sqrt(np.diag(posterior))
    proper = (directions.T / (values**2 + 1.0)) @ directions
    scale = np.where(np.isfinite(sigmas) & (sigmas > 0.0), sigmas, 1.0)
    return FitStatistics(
        sigmas=sigmas,
        quantile=float(
            t.ppf(0.5 + CONFIDENCE / 2.0, freedom)
            if from_residuals and noise is not None
            else norm.ppf(0.5 + CONFIDENCE / 2.0)
        ),
        data_share=np.asarray(1.0 - np.diag(proper)),
        correlations=np.nan_to_num(posterior / np.outer(scale, scale)),
        unidentifiable=tuple(
            _UnidentifiableDirection(
                _name_direction(names, directions[i]), float(1.0 / value) if value > 0.0 else np.inf
            )
            for i, value in enumerate(values)
            if value**2 / (1.0 + value**2) < SEEN_SHARE
        ),
        noise=noise,
        freedom=freedom,
    )


def _invert(information: FloatArray, allowed: FloatArray) -> FloatArray:
    """Inverse of an information matrix; infinite variances where nothing is known."""
    scaled = information * np.outer(allowed, allowed)
    values, vectors = np.linalg.eigh(scaled)
    determined = values > np.finfo(float).eps * len(values) * max(float(values[-1]), 1.0)
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    lost = np.einsum("ij,ij->i", vectors[:, ~determined], vectors[:, ~determined]) > 1e-9
    inverse[lost, lost] = np.inf
    return inverse * np.outer(allowed, allowed)


def _name_direction(names: Sequence[str], direction: FloatArray) -> tuple[tuple[str, float], ...]:
    order = np.argsort(-np.abs(direction))
    sign = np.sign(direction[order[0]])
    return tuple(
        (names[i], float(sign * direction[i])) for i in order if abs(direction[i]) >= NAMED_SHARE
    )
