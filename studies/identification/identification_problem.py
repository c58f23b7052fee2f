"""A fit as a function of its coordinates: residuals of data and priors, and their exact derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.studies.identification.cases import CaseModel, CaseState, solve_case
from headstock.studies.identification.problem import Pairing, case_jacobian, case_residuals, follow_modes, pair_modes
from headstock.studies.identification.targets import FitSettings, Parameter


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
    """A fit at one place of its coordinates.

    Attributes:
        coordinates: Where ``(p,)``.
        states: Of each case.
        pairings: Of each case.
        residuals: Of the data ``(r,)``.
        cost: Half the sum of squares of data and priors.
    """

    coordinates: FloatArray
    states: tuple[CaseState, ...]
    pairings: tuple[Pairing, ...]
    residuals: FloatArray
    cost: float


def evaluate(problem: FitProblem, coordinates: FloatArray, anchor: FitPoint | None = None) -> FitPoint:
    """Compute every case and pair its modes.

    Args:
        problem: Cases and parameters.
        coordinates: Where.
        anchor: An earlier point whose modes are followed; None for the cheapest pairing.

    Raises:
        HeadstockError: A machine cannot be built or computed there.
    """
    values = problem.values(coordinates)
    states = tuple(solve_case(model, values) for model in problem.cases)
    if anchor is not None:
        pairings = tuple(follow_modes(*item) for item in zip(anchor.states, anchor.pairings, states, strict=True))
    else:
        pairings = tuple(pair_modes(state) for state in states)
    return _make_point(problem, np.array(coordinates), states, pairings)


def exchange_modes(problem: FitProblem, point: FitPoint, pairings: tuple[Pairing, ...]) -> FitPoint:
    """The same point with other pairings."""
    return _make_point(problem, point.coordinates, point.states, pairings)


def data_jacobian(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Derivatives ``(r, p)`` of the residuals of the data by the coordinates."""
    blocks = [case_jacobian(state, pairing) for state, pairing in zip(point.states, point.pairings, strict=True)]
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


def _make_point(
    problem: FitProblem, coordinates: FloatArray, states: tuple[CaseState, ...], pairings: tuple[Pairing, ...]
) -> FitPoint:
    residuals = np.concatenate([case_residuals(state, pairing) for state, pairing in zip(states, pairings, strict=True)])
    priors = prior_residuals(problem, coordinates)
    return FitPoint(coordinates, states, pairings, residuals, 0.5 * float(residuals @ residuals + priors @ priors))


def _width(parameter: Parameter) -> float:
    return parameter.upper - parameter.lower
