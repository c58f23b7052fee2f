"""Bounded least squares from several starts, with exact derivatives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm, qmc

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.pipeline.identification_cases import CaseModel, CaseState, solve_case
from headstock.pipeline.identification_residuals import Pairing, case_jacobian, case_residuals, follow_modes, pair_modes
from headstock.pipeline.identification_targets import FitSettings, Parameter
from headstock.solvers.errors import ConvergenceError

OUT_OF_REACH = 1e3  # residual of values with which the machine cannot be computed: the step is taken back
TOLERANCE = 1e-9
TEXTS = {
    -1: "the least-squares solver refused its input",
    0: "stopped at the limit of evaluations",
    1: "slope is zero",
    2: "the sum of squares no longer falls",
    3: "the parameters no longer change",
    4: "the sum of squares and the parameters no longer change",
}


@dataclass(frozen=True, eq=False)
class StartRecord:
    """How one start ended.

    Attributes:
        start: Coordinates it began at ``(p,)``.
        end: Coordinates it ended at ``(p,)``.
        cost: Half the sum of squares at the end, prior counted; inf where the start could not be computed.
        evaluations: Of the model.
        refused: Evaluations at values with which the machine could not be computed.
        converged: It met a tolerance.
        reason: Why it ended.
    """

    start: FloatArray
    end: FloatArray
    cost: float
    evaluations: int
    refused: int
    converged: bool
    reason: str


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Cases and parameters of a fit, in fitted coordinates: ln p or p over the width of its bounds."""

    cases: tuple[CaseModel, ...]
    parameters: tuple[Parameter, ...]
    settings: FitSettings

    def coordinates(self, values: Sequence[float]) -> FloatArray:
        """Coordinates of parameter values."""
        return np.array([np.log(v) if p.logarithmic else v / _width(p) for p, v in zip(self.parameters, values, strict=True)])

    def values(self, coordinates: FloatArray) -> dict[str, float]:
        """Parameter values by name, SI."""
        return {
            p.name: float(np.exp(x) if p.logarithmic else x * _width(p)) for p, x in zip(self.parameters, coordinates, strict=True)
        }

    def value_slopes(self, coordinates: FloatArray) -> FloatArray:
        """Derivative of each value by its coordinate ``(p,)``."""
        return np.array([np.exp(x) if p.logarithmic else _width(p) for p, x in zip(self.parameters, coordinates, strict=True)])

    @property
    def lower(self) -> FloatArray:
        """Lower bounds in coordinates."""
        return self.coordinates([parameter.lower for parameter in self.parameters])

    @property
    def upper(self) -> FloatArray:
        """Upper bounds in coordinates."""
        return self.coordinates([parameter.upper for parameter in self.parameters])

    @property
    def priors(self) -> tuple[FloatArray, FloatArray]:
        """Prior mean and standard deviation in coordinates; nan and inf where there is none."""
        means, sigmas = np.full(len(self.parameters), np.nan), np.full(len(self.parameters), np.inf)
        for index, parameter in enumerate(self.parameters):
            if parameter.prior is not None and parameter.prior_sigma is not None:
                means[index] = np.log(parameter.prior) if parameter.logarithmic else parameter.prior / _width(parameter)
                sigmas[index] = parameter.prior_sigma / (1.0 if parameter.logarithmic else _width(parameter))
        return means, sigmas


@dataclass(frozen=True, eq=False)
class FitPoint:
    """A task at one place of its coordinates: states, pairings and residuals of the data, prior left out."""

    coordinates: FloatArray
    states: tuple[CaseState, ...]
    pairings: tuple[Pairing, ...]
    residuals: FloatArray


@dataclass(eq=False)
class _Descent:
    """One start: what the least-squares solver calls, and what it has seen."""

    problem: FitProblem
    anchor: FitPoint | None = None
    latest: FitPoint | None = None
    refused: int = 0
    count: int = 0
    size: int = field(default=0)

    def residuals(self, coordinates: FloatArray) -> FloatArray:
        self.count += 1
        try:
            self.latest = evaluate(self.problem, coordinates, self.anchor)
        except HeadstockError:
            if self.size == 0:
                raise
            self.refused += 1
            return np.full(self.size, OUT_OF_REACH)
        if self.anchor is None:
            self.anchor = self.latest
        found = np.concatenate([self.latest.residuals, prior_residuals(self.problem, coordinates)])
        self.size = len(found)
        return found

    def jacobian(self, coordinates: FloatArray) -> FloatArray:
        """Called at accepted points only: from here on modes are followed from this one."""
        point = self.latest
        if point is None or not np.array_equal(point.coordinates, coordinates):
            point = evaluate(self.problem, coordinates, self.anchor)
        self.anchor = point
        return np.vstack([data_jacobian(self.problem, point), prior_jacobian(self.problem)])


def evaluate(problem: FitProblem, coordinates: FloatArray, anchor: FitPoint | None = None) -> FitPoint:
    """Compute every case and pair its modes.

    Args:
        problem: Cases and parameters.
        coordinates: Where.
        anchor: An earlier point whose pairing is followed where the settings say ``track``.

    Raises:
        HeadstockError: A machine cannot be built or computed there.
    """
    values = problem.values(coordinates)
    states = tuple(solve_case(model, values) for model in problem.cases)
    if anchor is not None and problem.settings.pairing == "track":
        pairings = tuple(follow_modes(*item) for item in zip(anchor.states, anchor.pairings, states, strict=True))
    else:
        pairings = tuple(pair_modes(state) for state in states)
    residuals = [case_residuals(state, pairing) for state, pairing in zip(states, pairings, strict=True)]
    return FitPoint(np.array(coordinates), states, pairings, np.concatenate(residuals))


def data_jacobian(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Derivatives ``(r, p)`` of the residuals of the data by the coordinates."""
    blocks = [
        case_jacobian(state, pairing, problem.parameters) for state, pairing in zip(point.states, point.pairings, strict=True)
    ]
    return np.vstack(blocks) * problem.value_slopes(point.coordinates)


def prior_residuals(problem: FitProblem, coordinates: FloatArray) -> FloatArray:
    """Distances from the priors in standard deviations, for parameters that have one."""
    means, sigmas = problem.priors
    held = np.isfinite(sigmas)
    return np.asarray((coordinates[held] - means[held]) / sigmas[held])


def prior_jacobian(problem: FitProblem) -> FloatArray:
    """Derivatives of ``prior_residuals``."""
    _, sigmas = problem.priors
    held = np.isfinite(sigmas)
    return np.asarray(np.eye(len(sigmas))[held] / sigmas[held][:, None])


def fit(
    problem: FitProblem, observer: Callable[[StartRecord], None] = lambda record: None
) -> tuple[FitPoint, tuple[StartRecord, ...]]:
    """Run every start and keep the best.

    Raises:
        ConvergenceError: No start could be computed.
    """
    records: list[StartRecord] = []
    for start in spread_starts(problem):
        records.append(_descend(problem, start))
        observer(records[-1])
    best = min(records, key=lambda record: record.cost)
    if not np.isfinite(best.cost):
        raise ConvergenceError(f"none of {len(records)} start(s) could be computed: {records[0].reason}")
    return evaluate(problem, best.end, _anchor(problem, best)), tuple(records)


def spread_starts(problem: FitProblem) -> list[FloatArray]:
    """The start values first, then a Sobol sequence: within the prior where there is one, else evenly between the bounds.

    Source: Sobol (1967), scrambled after Owen (1998).
    """
    settings, count = problem.settings, len(problem.parameters)
    starts = [problem.coordinates([parameter.start for parameter in problem.parameters])]
    if settings.starts == 1:
        return starts
    sampler = qmc.Sobol(count, rng=np.random.default_rng(settings.seed))
    shares = sampler.random(2 ** int(np.ceil(np.log2(settings.starts))))[: settings.starts - 1]
    lower, upper = problem.lower, problem.upper
    means, sigmas = problem.priors
    for share in shares:
        place = lower + share * (upper - lower)
        held = np.isfinite(sigmas)
        low, high = (norm.cdf((bound[held] - means[held]) / sigmas[held]) for bound in (lower, upper))
        place[held] = means[held] + sigmas[held] * norm.ppf(low + share[held] * (high - low))
        starts.append(np.clip(place, lower, upper))
    return starts


def _descend(problem: FitProblem, start: FloatArray) -> StartRecord:
    descent = _Descent(problem)
    try:
        found = least_squares(
            descent.residuals,
            start,
            jac=descent.jacobian,
            bounds=(problem.lower, problem.upper),
            method=problem.settings.method,
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=problem.settings.evaluations,
        )
    except HeadstockError as error:
        return StartRecord(start, start, np.inf, descent.count, descent.refused, converged=False, reason=str(error))
    reason = TEXTS.get(found.status, found.message)
    return StartRecord(start, found.x, float(found.cost), descent.count, descent.refused, converged=found.status > 0, reason=reason)


def _anchor(problem: FitProblem, record: StartRecord) -> FitPoint | None:
    """Where a start that followed its modes began."""
    return evaluate(problem, record.start) if problem.settings.pairing == "track" else None


def _width(parameter: Parameter) -> float:
    return parameter.upper - parameter.lower
