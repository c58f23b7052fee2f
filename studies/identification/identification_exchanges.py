"""Other pairings of targets and modes that may lead a fit out of a wrong minimum, found on its linearised model.

Where two modes change places, the k-th frequency has a kink: following it, a fit ends with one mode pressed against another. In
a model that is linear in the coordinates every mode keeps its identity and lines may cross; searching that model from many places
costs next to nothing. What looks better there is tried on the machine itself.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import qmc

from headstock.geometry.frames import FloatArray
from headstock.studies.identification.identification_problem import (
    FitPoint,
    FitProblem,
    data_jacobian,
    prior_jacobian,
    prior_residuals,
)
from headstock.studies.identification.problem import Pairing, mode_rows, shape_costs

PLACES = 64
REACH = 1.0  # how far the search goes, in coordinates: a factor e
SWEEPS = 4
TRIALS = 4
PROMISING = 0.7  # of the sum of squares, by the linear model
MET = 1e-3  # mean square of the residuals, in standard deviations, below which nothing better is looked for
SEED = 5


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
    """

    logs: FloatArray
    slopes: FloatArray
    wanted: FloatArray
    sigmas: FloatArray
    shape_costs: FloatArray
    rows: tuple[int, ...]


def propose_exchanges(problem: FitProblem, point: FitPoint) -> list[tuple[Pairing, ...]]:
    """Pairings that the linear model holds for better than that of a point, most promising first; none where the data are met."""
    if point.residuals @ point.residuals <= MET * len(point.residuals):
        return []
    cases = _linearise(problem, point)
    residuals = np.concatenate([point.residuals, prior_residuals(problem, point.coordinates)])
    jacobian = np.vstack([data_jacobian(problem, point), prior_jacobian(problem)])
    found: dict[tuple[Pairing, ...], float] = {}
    for place in _places(problem, point):
        move = place
        for _ in range(SWEEPS):
            pairings = tuple(_pair(case, move) for case in cases)
            move, cost = _solve(problem, point, cases, pairings, (residuals, jacobian))
        if pairings != point.pairings and cost < PROMISING * point.cost:
            found[pairings] = min(cost, found.get(pairings, np.inf))
    return sorted(found, key=lambda pairings: found[pairings])[:TRIALS]


def _linearise(problem: FitProblem, point: FitPoint) -> list[_LinearCase]:
    scale, start, cases = problem.value_slopes(point.coordinates), 0, []
    for state in point.states:
        targets = state.model.case.modes
        slopes = np.zeros((len(state.squares), len(scale)))
        for index, slope in state.by_parameter.items():
            slopes[:, index] = slope.squares / (2.0 * state.squares) * scale[index]
        rows, size = mode_rows(state)
        cases.append(
            _LinearCase(
                logs=np.log(state.frequencies_hz),
                slopes=slopes,
                wanted=np.log([target.frequency_hz for target in targets]),
                sigmas=np.array([target.sigma for target in targets]),
                shape_costs=shape_costs(state),
                rows=tuple(-1 if row is None else start + row for row in rows),
            )
        )
        start += size
    return cases


def _places(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Moves ``(k, p)`` within reach and bounds to search from."""
    low = np.maximum(problem.lower - point.coordinates, -REACH)
    high = np.minimum(problem.upper - point.coordinates, REACH)
    shares = qmc.Sobol(len(low), rng=np.random.default_rng(SEED)).random(PLACES)
    return np.asarray(low + shares * (high - low))


def _pair(case: _LinearCase, move: FloatArray) -> Pairing:
    if not len(case.wanted):
        return Pairing(())
    gaps = (case.logs + case.slopes @ move)[None, :] - case.wanted[:, None]
    cost = (gaps / case.sigmas[:, None]) ** 2 + case.shape_costs
    return Pairing(tuple(int(column) for column in linear_sum_assignment(cost)[1]))


def _solve(
    problem: FitProblem,
    point: FitPoint,
    cases: list[_LinearCase],
    pairings: tuple[Pairing, ...],
    linear: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float]:
    """The best move under given pairings, held within reach, and half the sum of squares it leaves."""
    residuals, jacobian = linear[0].copy(), linear[1].copy()
    for case, pairing in zip(cases, pairings, strict=True):
        for target, (row, mode) in enumerate(zip(case.rows, pairing.modes, strict=True)):
            if row >= 0:
                residuals[row] = (case.logs[mode] - case.wanted[target]) / case.sigmas[target]
                jacobian[row] = case.slopes[mode] / case.sigmas[target]
    held = np.eye(jacobian.shape[1]) / REACH
    move = np.linalg.lstsq(np.vstack([jacobian, held]), -np.concatenate([residuals, np.zeros(len(held))]), rcond=None)[0]
    move = np.clip(move, problem.lower - point.coordinates, problem.upper - point.coordinates)
    left = residuals + jacobian @ move
    return np.asarray(move), 0.5 * float(left @ left)
