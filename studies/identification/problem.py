"""A fit as a function of its coordinates: weighed residuals of data and priors, and their exact
derivatives.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.studies.identification.cases import CaseModel, CaseState, solve_case
from headstock.studies.identification.observations import Observation, list_observations
from headstock.studies.identification.pairings import Pairing, follow_modes, pair_targets
from headstock.studies.identification.targets import FitTable, Parameter, TargetCase


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Cases and parameters of a fit, in fitted coordinates: ln p or p over its bounds' width."""

    cases: tuple[CaseModel, ...]
    parameters: tuple[Parameter, ...]
    settings: FitTable

    def change_cases(self, change: Callable[[TargetCase], TargetCase]) -> "FitProblem":
        """Return the problem with other targets."""
        models = (replace(model, case=change(model.case)) for model in self.cases)
        return replace(self, cases=tuple(models))

    def coordinates(self, values: Sequence[float]) -> FloatArray:
        """Coordinates of parameter values."""
        return np.array([p.locate(v) for p, v in zip(self.parameters, values, strict=True)])

    def values(self, coordinates: FloatArray) -> dict[str, float]:
        """Parameter values by name, SI."""
        return {p.name: p.value(x) for p, x in zip(self.parameters, coordinates, strict=True)}

    def value_slopes(self, coordinates: FloatArray) -> FloatArray:
        """Derivative of each value by its coordinate ``(p,)``."""
        values = self.values(coordinates)
        return np.array([values[p.name] if p.logarithmic else p.width for p in self.parameters])

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
                means[index] = parameter.locate(parameter.prior)
                scale = 1.0 if parameter.logarithmic else parameter.width
                sigmas[index] = parameter.prior_sigma / scale
        return means, sigmas


@dataclass(frozen=True, eq=False)
class FitPlace:
    """Where a fit stands.

    Attributes:
        coordinates: Where ``(p,)``.
        cost: Half the sum of squares of data and priors.
    """

    coordinates: FloatArray
    pairings: tuple[Pairing, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class FitPoint(FitPlace):
    """A fit at one place of its coordinates.

    Attributes:
        observations: Of each case all targets, held-out ones too.
        residuals: Of the data ``(r,)``: those of the observations that are not held out.
    """

    states: tuple[CaseState, ...]
    observations: tuple[tuple[Observation, ...], ...]
    residuals: FloatArray

    @property
    def fitted(self) -> list[Observation]:
        """Observations of all cases that are not held out."""
        return [item for case in self.observations for item in case if not item.hold_out]

    @property
    def place(self) -> FitPlace:
        """The point without what is computed there: some numbers instead of many megabytes."""
        return FitPlace(self.coordinates, self.pairings, self.cost)


def evaluate(
    problem: FitProblem, coordinates: FloatArray, anchor: FitPoint | None = None
) -> FitPoint:
    """Compute every case and pair its modes.

    Args:
        anchor: An earlier point whose modes are followed; None for the cheapest pairing.

    Raises:
        HeadstockError: A machine cannot be built or computed there.
    """
    values = problem.values(coordinates)
    states = tuple(solve_case(model, values) for model in problem.cases)
    if anchor is not None:
        pairs = zip(anchor.states, anchor.pairings, states, strict=True)
        pairings = tuple(follow_modes(before, pairing, state) for before, pairing, state in pairs)
    else:
        pairings = _pair_anew(states)
    return _make_point(problem, np.array(coordinates), states, pairings)


def _pair_anew(states: Sequence[CaseState]) -> tuple[Pairing, ...]:
    """Return the cheapest pairing of each case; a modified machine follows the modes of another case."""
    cases = [state.model.case for state in states]
    places = {case.name: number for number, case in enumerate(cases)}
    pairings = [
        () if case.like else pair_targets(state) for case, state in zip(cases, states, strict=True)
    ]
    for number, case in enumerate(cases):
        if case.like is not None:
            base = places[case.like]
            labels = [target.label for target in cases[base].modes]
            modes = [pairings[base][labels.index(target.label)] for target in case.modes]
            pairings[number] = follow_modes(states[base], tuple(modes), states[number])
    return tuple(pairings)


def exchange_modes(problem: FitProblem, point: FitPoint, pairings: tuple[Pairing, ...]) -> FitPoint:
    """The same values with targets compared to other modes.

    Args:
        point: Values with the states of all cases.
        pairings: For each case, which mode each target goes with.
    """
    return _make_point(problem, point.coordinates, point.states, pairings)


def data_jacobian(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Return derivatives ``(r, p)`` of the residuals of the data by the coordinates."""
    return stack_slopes(problem, point, point.fitted)


def stack_slopes(
    problem: FitProblem, point: FitPoint, observations: Sequence[Observation]
) -> FloatArray:
    """Return derivatives ``(r, p)`` of the residuals of observations by the coordinates."""
    rows = [item.find_slopes() for item in observations]
    by_values = np.vstack([np.zeros((0, len(problem.parameters))), *rows])
    return by_values * problem.value_slopes(point.coordinates)


def prior_residuals(problem: FitProblem, coordinates: FloatArray) -> FloatArray:
    """Distances from the priors in standard deviations, for parameters that have one."""
    means, sigmas = problem.priors
    with_prior = np.isfinite(sigmas)
    return (coordinates[with_prior] - means[with_prior]) / sigmas[with_prior]


def prior_jacobian(problem: FitProblem) -> FloatArray:
    """Derivatives of ``prior_residuals``."""
    _, sigmas = problem.priors
    with_prior = np.isfinite(sigmas)
    return np.eye(len(sigmas))[with_prior] / sigmas[with_prior][:, None]


def _make_point(
    problem: FitProblem,
    coordinates: FloatArray,
    states: tuple[CaseState, ...],
    pairings: tuple[Pairing, ...],
) -> FitPoint:
    pairs = zip(states, pairings, strict=True)
    observations = tuple(tuple(list_observations(*pair)) for pair in pairs)
    values = [item.residuals for case in observations for item in case if not item.hold_out]
    residuals = np.concatenate([np.zeros(0), *values])
    priors = prior_residuals(problem, coordinates)
    return FitPoint(
        coordinates=coordinates,
        pairings=pairings,
        cost=0.5 * float(residuals @ residuals + priors @ priors),
        states=states,
        observations=observations,
        residuals=residuals,
    )
