"""Bounded least squares from several starts, with exact derivatives; each start tries other pairings of modes before it ends."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm, qmc

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.studies.identification.identification_exchanges import propose_exchanges
from headstock.studies.identification.identification_problem import (
    FitPoint,
    FitProblem,
    data_jacobian,
    evaluate,
    exchange_modes,
    prior_jacobian,
    prior_residuals,
)

OUT_OF_REACH = 1e3  # residual of values with which the machine cannot be computed: the step is taken back
TOLERANCE = 1e-7
TRIAL_STEPS = 12  # evaluations after which an exchange must have paid
ROUNDS = 6  # of exchanges of modes per start
WORTHWHILE = 0.99  # an exchange is kept when it brings the sum of squares below this share
TEXTS = {
    -1: "the least-squares solver refused its input",
    0: "limit of evaluations reached",
    1: "slope is zero",
    2: "sum of squares settled",
    3: "parameters settled",
    4: "sum of squares and parameters settled",
}


@dataclass(frozen=True, eq=False)
class StartRecord:
    """How one start ended.

    Attributes:
        start: Coordinates it began at ``(p,)``.
        end: Where it ended; None where the start could not be computed.
        evaluations: Of the model.
        refused: Evaluations at values with which the machine could not be computed.
        exchanges: How often another pairing of targets and modes led to a better end.
        converged: It met a tolerance.
        reason: Why it ended.
    """

    start: FloatArray
    end: FitPoint | None
    evaluations: int
    refused: int
    exchanges: int
    converged: bool
    reason: str

    @property
    def cost(self) -> float:
        """Half the sum of squares at the end, priors counted."""
        return np.inf if self.end is None else self.end.cost


@dataclass(eq=False)
class _Descent:
    """What the least-squares solver calls, and what it has seen.

    Attributes:
        problem: To be solved.
        follow: Follow modes from step to step, else pair them anew at each.
        anchor: Point from which modes are followed.
        latest: Point computed last.
        count: Evaluations.
        refused: Evaluations at values with which the machine could not be computed.
    """

    problem: FitProblem
    follow: bool
    anchor: FitPoint | None = None
    latest: FitPoint | None = None
    count: int = 0
    refused: int = 0

    def residuals(self, coordinates: FloatArray) -> FloatArray:
        self.count += 1
        known = self.latest
        try:
            self.latest = evaluate(self.problem, coordinates, self.anchor)
        except HeadstockError:
            if known is None:
                raise
            self.refused += 1
            return np.full(len(known.residuals) + len(prior_residuals(self.problem, coordinates)), OUT_OF_REACH)
        if self.follow and self.anchor is None:
            self.anchor = self.latest
        return np.concatenate([self.latest.residuals, prior_residuals(self.problem, coordinates)])

    def jacobian(self, coordinates: FloatArray) -> FloatArray:
        """Called at accepted points only: modes that are followed are followed from here on."""
        point = self.point_at(coordinates)
        if self.follow:
            self.anchor = point
        return np.vstack([data_jacobian(self.problem, point), prior_jacobian(self.problem)])

    def point_at(self, coordinates: FloatArray) -> FitPoint:
        """The point there, as it is known or computed again."""
        if self.latest is not None and np.array_equal(self.latest.coordinates, coordinates):
            return self.latest
        return evaluate(self.problem, coordinates, self.anchor)


def fit(problem: FitProblem, observer: Callable[[StartRecord], None] = lambda record: None) -> tuple[StartRecord, ...]:
    """Run every start.

    Args:
        problem: To be solved.
        observer: Told of each start as it ends.

    Raises:
        ConvergenceError: No start could be computed.
    """
    records: list[StartRecord] = []
    for start in spread_starts(problem):
        records.append(_run_start(problem, start))
        observer(records[-1])
    if all(record.end is None for record in records):
        raise ConvergenceError(f"none of {len(records)} start(s) could be computed: {records[0].reason}")
    return tuple(records)


def spread_starts(problem: FitProblem) -> list[FloatArray]:
    """The start values first, then a Sobol sequence: within the prior where there is one, else evenly between the bounds.

    Source: Sobol (1967), scrambled after Owen (1998).
    """
    settings, count = problem.settings, len(problem.parameters)
    starts = [problem.coordinates([parameter.start for parameter in problem.parameters])]
    if settings.starts == 1:
        return starts
    sampler = qmc.Sobol(count, rng=np.random.default_rng(settings.seed))
    shares = sampler.random_base2(int(np.ceil(np.log2(settings.starts))))[: settings.starts - 1]
    lower, upper = problem.lower, problem.upper
    means, sigmas = problem.priors
    held = np.isfinite(sigmas)
    for share in shares:
        place = lower + share * (upper - lower)
        low, high = (norm.cdf((bound[held] - means[held]) / sigmas[held]) for bound in (lower, upper))
        place[held] = means[held] + sigmas[held] * norm.ppf(low + share[held] * (high - low))
        starts.append(np.clip(place, lower, upper))
    return starts


def _run_start(problem: FitProblem, start: FloatArray) -> StartRecord:
    """One start: down to the nearest minimum, then on wherever another pairing of modes leads to a lower one."""
    try:
        record = _descend(problem, start, None)
    except HeadstockError as error:
        return StartRecord(start, None, 1, 0, 0, converged=False, reason=str(error))
    for _ in range(ROUNDS if problem.settings.pairing == "best" else 0):
        better, tried, refused = _try_exchanges(problem, record)
        record = _count(record, better or record, tried, refused)
        if better is None:
            break
    return record


def _try_exchanges(problem: FitProblem, record: StartRecord) -> tuple[StartRecord | None, int, int]:
    """The first exchange of modes that leads to a lower end, and what trying cost."""
    tried = refused = 0
    point = record.end
    if point is None:
        return None, 0, 0
    for pairings in propose_exchanges(problem, point):
        try:
            followed = _descend(problem, point.coordinates, exchange_modes(problem, point, pairings), at_most=TRIAL_STEPS)
        except HeadstockError:
            refused += 1
            continue
        tried, refused = tried + followed.evaluations, refused + followed.refused
        if followed.end is not None and followed.cost < WORTHWHILE * record.cost:
            found = _descend(problem, followed.end.coordinates, None)
            return found, tried + found.evaluations, refused + found.refused
    return None, tried, refused


def _count(before: StartRecord, after: StartRecord, tried: int, refused: int) -> StartRecord:
    """The later record with what both took."""
    return StartRecord(
        start=before.start,
        end=after.end,
        evaluations=before.evaluations + tried,
        refused=before.refused + refused,
        exchanges=before.exchanges + (after is not before),
        converged=after.converged,
        reason=after.reason,
    )


def _descend(problem: FitProblem, start: FloatArray, anchor: FitPoint | None, *, at_most: int | None = None) -> StartRecord:
    """Least squares from one place; from an anchor on its modes are followed."""
    descent = _Descent(problem, follow=anchor is not None or problem.settings.pairing == "track", anchor=anchor)
    found = least_squares(
        descent.residuals,
        np.clip(start, problem.lower, problem.upper),
        jac=descent.jacobian,
        bounds=(problem.lower, problem.upper),
        method=problem.settings.method,
        x_scale="jac",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=TOLERANCE,
        max_nfev=at_most or problem.settings.evaluations,
    )
    reason = TEXTS.get(found.status, str(found.message))
    end = descent.point_at(found.x)
    return StartRecord(start, end, descent.count, descent.refused, 0, converged=found.status > 0, reason=reason)
