"""Bounded least squares from several starts, with exact derivatives; each start tries other
pairings of modes before it ends.

Where two modes change places, the k-th frequency has a kink: following it, a fit ends with one mode
pressed against another. In a model that is linear in the coordinates every mode keeps its identity
and lines may cross; searching that model from many places costs next to nothing. What looks better
there is tried on the machine itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm, qmc

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.store import default_store_root
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import match_frequencies
from headstock.solvers.ranks import make_on_root
from headstock.studies.identification.pairings import Pairing, shape_costs
from headstock.studies.identification.problem import (
    FitPlace,
    FitPoint,
    FitProblem,
    data_jacobian,
    evaluate,
    exchange_modes,
    prior_jacobian,
    prior_residuals,
)
from headstock.studies.points import Settle, compute_points

PLACES = 64
REACH = 1.0  # how far the search goes, in coordinates: a factor e
SWEEPS = 4
TRIALS = 4
PROMISING = 0.7  # of the sum of squares, by the linear model
# mean square of the residuals, in standard deviations, below which nothing better is looked for
MET = 1e-3
SEED = 5
OUT_OF_REACH = (
    1e3  # residual of values with which the machine cannot be computed: the step is taken back
)
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
class _LinearCase:
    """Frequencies of a case as straight lines over the coordinates.

    Attributes:
        logs: ``(m,)`` ln f.
        slopes: ``(m, p)``.
        wanted: ``(t,)`` ln f of the targets.
        sigmas: ``(t,)``.
        shape_costs: ``(t, m)``.
        rows: Row of the residuals for each target; -1 where it is held out.
        shape_rows: Rows of its shape; empty where it has none, or is held out.
        modes: Mode that each target is paired with at the point.
        fixed: Pairing of a case whose modes follow those of another one; None for others.
    """

    logs: FloatArray
    slopes: FloatArray
    wanted: FloatArray
    sigmas: FloatArray
    shape_costs: FloatArray
    rows: tuple[int, ...]
    shape_rows: tuple[slice, ...]
    modes: tuple[int, ...]
    fixed: Pairing | None


def _propose_exchanges(problem: FitProblem, point: FitPoint) -> list[tuple[Pairing, ...]]:
    """Pairings that the linear model holds for better than that of a point, most promising first;
    none where the data are met.
    """
    if point.residuals @ point.residuals <= MET * len(point.residuals):
        return []
    cases = _linearise(problem, point)
    residuals = np.concatenate([point.residuals, prior_residuals(problem, point.coordinates)])
    jacobian = np.vstack([data_jacobian(problem, point), prior_jacobian(problem)])
    costs: dict[tuple[Pairing, ...], float] = {}
    for start in _places(problem, point):
        move = start
        for _ in range(SWEEPS):
            pairings = tuple(_pair(case, move) for case in cases)
            move, cost = _solve(problem, point, cases, pairings, (residuals, jacobian))
        if pairings != point.pairings and cost < PROMISING * point.cost:
            costs[pairings] = min(cost, costs.get(pairings, np.inf))
    return sorted(costs, key=lambda pairings: costs[pairings])[:TRIALS]


def _linearise(problem: FitProblem, point: FitPoint) -> list[_LinearCase]:
    scale, start, cases = problem.value_slopes(point.coordinates), 0, []
    for state, pairing, observations in zip(
        point.states, point.pairings, point.observations, strict=True
    ):
        targets = state.model.case.modes
        slopes = np.zeros((len(state.eigenvalues), len(scale)))
        for index, slope in state.by_parameter.items():
            slopes[:, index] = slope.eigenvalues / (2.0 * state.eigenvalues) * scale[index]
        rows: list[int] = []
        shape_rows: list[slice] = []
        for item in observations:
            if item.kind == "frequency":
                rows.append(-1 if item.hold_out else start)
                shape_rows.append(slice(0))
            if item.kind == "shape" and not item.hold_out:
                shape_rows[-1] = slice(start, start + len(item.residuals))
            start += 0 if item.hold_out else len(item.residuals)
        cases.append(
            _LinearCase(
                logs=np.log(state.frequencies_hz),
                slopes=slopes,
                wanted=np.log([target.frequency_hz for target in targets]),
                sigmas=np.array([target.sigma for target in targets]),
                shape_costs=shape_costs(state),
                rows=tuple(rows),
                shape_rows=tuple(shape_rows),
                modes=pairing,
                fixed=pairing if state.model.case.like else None,
            )
        )
    return cases


def _places(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Moves ``(k, p)`` within reach and bounds to search from."""
    low = np.maximum(problem.lower - point.coordinates, -REACH)
    high = np.minimum(problem.upper - point.coordinates, REACH)
    shares = qmc.Sobol(len(low), rng=np.random.default_rng(SEED)).random(PLACES)
    return low + shares * (high - low)


def _pair(case: _LinearCase, move: FloatArray) -> Pairing:
    if case.fixed is not None or not len(case.wanted):
        return case.fixed or ()
    logs = case.logs + case.slopes @ move
    return match_frequencies(logs, case.wanted, sigmas=case.sigmas, costs=case.shape_costs)


def _solve(
    problem: FitProblem,
    point: FitPoint,
    cases: list[_LinearCase],
    pairings: tuple[Pairing, ...],
    linear: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float]:
    """Best move under given pairings, kept within reach, and half the sum of squares left."""
    residuals, jacobian = linear[0].copy(), linear[1].copy()
    shapes = 0.0
    for case, pairing in zip(cases, pairings, strict=True):
        for target, (rows, mode) in enumerate(zip(case.shape_rows, pairing, strict=True)):
            if rows.stop and mode != case.modes[target]:
                # of another mode the shape is known here, and not how it changes
                residuals[rows], jacobian[rows] = 0.0, 0.0
                shapes += float(case.shape_costs[target, mode])
        for target, (row, mode) in enumerate(zip(case.rows, pairing, strict=True)):
            if row >= 0:
                residuals[row] = (case.logs[mode] - case.wanted[target]) / case.sigmas[target]
                jacobian[row] = case.slopes[mode] / case.sigmas[target]
    shorten = np.eye(jacobian.shape[1]) / REACH
    move = np.linalg.lstsq(
        np.vstack([jacobian, shorten]),
        -np.concatenate([residuals, np.zeros(len(shorten))]),
        rcond=None,
    )[0]
    move = np.clip(move, problem.lower - point.coordinates, problem.upper - point.coordinates)
    left = residuals + jacobian @ move
    return np.asarray(move), 0.5 * (float(left @ left) + shapes)


@dataclass(frozen=True, eq=False)
class StartRecord:
    """How one start ended.

    Attributes:
        start: Coordinates it began at ``(p,)``.
        end: Where it ended, when it has ended without the states there; None where the start could not be computed.
        refused: Evaluations at values with which the machine could not be computed.
        exchanges: How often another pairing of targets and modes led to a better end.
    """

    start: FloatArray
    end: FitPlace | None
    evaluations: int
    refused: int
    exchanges: int
    converged: bool
    reason: str

    def add(self, other: "StartRecord") -> "StartRecord":
        """Return it with the evaluations of another descent, too."""
        return replace(
            self,
            evaluations=self.evaluations + other.evaluations,
            refused=self.refused + other.refused,
        )

    @property
    def cost(self) -> float:
        """Half the sum of squares at the end, priors counted."""
        return np.inf if self.end is None else self.end.cost


@dataclass(eq=False)
class _Descent:
    """What the least-squares solver calls, and what it has seen.

    Attributes:
        follow: Follow modes from step to step, else pair them anew at each.
        settle: Called before each evaluation.
        anchor: Point from which modes are followed.
        latest: Point computed last.
        refused: Evaluations at values with which the machine could not be computed.
    """

    problem: FitProblem
    follow: bool
    settle: Settle
    anchor: FitPoint | None = None
    latest: FitPoint | None = None
    count: int = 0
    refused: int = 0

    def residuals(self, coordinates: FloatArray) -> FloatArray:
        self.count += 1
        self.settle()
        before = self.latest
        try:
            self.latest = evaluate(self.problem, coordinates, self.anchor)
        except HeadstockError:
            if before is None:
                raise
            self.refused += 1
            return np.full(
                len(before.residuals) + len(prior_residuals(self.problem, coordinates)),
                OUT_OF_REACH,
            )
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


def fit(
    problem: FitProblem,
    observer: Callable[[StartRecord], None] = lambda record: None,
    *,
    comm: MPI.Comm | None = None,
) -> tuple[StartRecord, ...]:
    """Run every start, each on one rank; collective.

    Args:
        problem: To be solved; the same on every rank.
        observer: Called on rank 0 with each start as it ends.
        comm: Ranks that share the starts; None for this one alone.

    Returns:
        One record per start, in order; empty on other ranks.

    Raises:
        ConvergenceError: No start could be computed; on several ranks the cause of a
            ``SharedFailure``.
    """
    comm = comm or MPI.COMM_SELF
    starts = _spread_starts(problem)
    records = compute_points(
        starts,
        lambda start, alone, settle: _run_start(problem, start, settle),
        comm=comm,
        folder=default_store_root(),
        observer=lambda start, record: observer(record),
    )

    def require_end() -> None:
        if all(record.end is None for record in records):
            raise ConvergenceError(
                f"none of {len(records)} start(s) could be computed: {records[0].reason}"
            )

    make_on_root(comm, require_end)
    return tuple(records)


def _spread_starts(problem: FitProblem) -> list[FloatArray]:
    """The start values first, then a Sobol sequence: within the prior where there is one, else
    evenly between the bounds.

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
    with_prior = np.isfinite(sigmas)
    for share in shares:
        start = lower + share * (upper - lower)
        low, high = (
            norm.cdf((bound[with_prior] - means[with_prior]) / sigmas[with_prior])
            for bound in (lower, upper)
        )
        start[with_prior] = means[with_prior] + sigmas[with_prior] * norm.ppf(
            low + share[with_prior] * (high - low)
        )
        starts.append(np.clip(start, lower, upper))
    return starts


def _run_start(problem: FitProblem, start: FloatArray, settle: Settle) -> StartRecord:
    """One start: down to the nearest minimum, then on wherever another pairing of modes leads to a
    lower one.
    """
    try:
        record = _descend(problem, start, None, settle)
    except HeadstockError as error:
        return StartRecord(start, None, 1, 0, 0, converged=False, reason=str(error))
    for _ in range(ROUNDS if problem.settings.pairing == "best" else 0):
        before, record = record, _try_exchanges(problem, record, settle)
        if record.end is before.end:
            break
    return replace(record, end=record.end.place) if isinstance(record.end, FitPoint) else record


def _try_exchanges(problem: FitProblem, record: StartRecord, settle: Settle) -> StartRecord:
    """Return the record with what trying exchanges of modes took, and with the end of the first that
    leads lower, where one does.
    """
    point = record.end
    if not isinstance(point, FitPoint):
        return record
    for pairings in _propose_exchanges(problem, point):
        exchanged = exchange_modes(problem, point, pairings)
        try:
            followed = _descend(problem, point.coordinates, exchanged, settle, at_most=TRIAL_STEPS)
        except HeadstockError:
            record = replace(record, refused=record.refused + 1)
            continue
        record = record.add(followed)
        if followed.end is not None and followed.cost < WORTHWHILE * record.cost:
            lower = _descend(problem, followed.end.coordinates, None, settle)
            return replace(
                record.add(lower),
                end=lower.end,
                exchanges=record.exchanges + 1,
                converged=lower.converged,
                reason=lower.reason,
            )
    return record


def _descend(
    problem: FitProblem,
    start: FloatArray,
    anchor: FitPoint | None,
    settle: Settle,
    *,
    at_most: int | None = None,
) -> StartRecord:
    """Least squares from one place; from an anchor on its modes are followed."""
    descent = _Descent(
        problem,
        follow=anchor is not None or problem.settings.pairing == "track",
        settle=settle,
        anchor=anchor,
    )
    solution = least_squares(
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
    reason = TEXTS.get(solution.status, str(solution.message))
    end = descent.point_at(solution.x)
    return StartRecord(
        start, end, descent.count, descent.refused, 0, converged=solution.status > 0, reason=reason
    )
