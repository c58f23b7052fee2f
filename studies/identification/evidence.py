"""How much measurements speak for one model rather than for another one fitted to the same."""

from dataclasses import dataclass

import numpy as np

from headstock.studies.identification.identification import Identification


@dataclass(frozen=True)
class Evidence:
    """What ranks a model among others fitted to the same measurements.

    Attributes:
        misfit: Twice the negative logarithm of the likelihood at the fit, up to a constant.
        parameters: How many are free in the end: none at its bound.
        data: How many measurements are fitted; held-out ones do not count.
        log_evidence: Logarithm of the evidence by Laplace's method, up to the same constant for all
            models; None where data and priors leave a parameter open or one is at its bound.
    """

    misfit: float
    parameters: int
    data: int
    log_evidence: float | None

    @property
    def bic(self) -> float:
        """Bayesian information criterion; ten less is very strong evidence.

        Source: Schwarz (1978); Kass and Raftery (1995).
        """
        return self.misfit + self.parameters * float(np.log(self.data))


def weigh_evidence(found: Identification) -> Evidence:
    """Return the evidence of a fitted model.

    With errors from residuals their size is a free parameter of each kind, at its likeliest value.

    Source: MacKay (1992), Laplace's method.
    """
    fitted = found.point.fitted
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for item in fitted:
        squares[item.kind] = squares.get(item.kind, 0.0) + float(item.residuals @ item.residuals)
        counts[item.kind] = counts.get(item.kind, 0) + item.data
    stated = found.problem.settings.noise == "stated"
    misfit = 0.0
    for kind, square in squares.items():
        count = counts[kind]
        misfit += square if stated or not count else count * np.log(max(square / count, 1e-300))
    at_bound = [bool(item.at_bound) for item in found.parameters]
    return Evidence(
        misfit=float(misfit),
        parameters=at_bound.count(False),
        data=sum(counts.values()),
        log_evidence=None if any(at_bound) else _apply_laplace(found, float(misfit)),
    )


def _apply_laplace(found: Identification, misfit: float) -> float | None:
    """Return the logarithm of the evidence; None where a parameter is open."""
    problem, covariance = found.problem, found.statistics.covariance
    if not np.isfinite(covariance).all():
        return None
    means, sigmas = problem.priors
    known = np.isfinite(sigmas)
    distances = (found.point.coordinates[known] - means[known]) / sigmas[known]
    # a prior is a bell curve, or even between the bounds
    spans = np.where(known, np.sqrt(2.0 * np.pi) * sigmas, problem.upper - problem.lower)
    _, log_volume = np.linalg.slogdet(2.0 * np.pi * covariance)
    return float(-0.5 * (misfit + distances @ distances) + 0.5 * log_volume - np.log(spans).sum())
