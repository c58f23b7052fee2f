"""A fit as a function of its coordinates: weighed residuals of data and priors, and their exact
derivatives.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import assign_modes, match_frequencies
from headstock.studies.identification.cases import (
    CaseModel,
    CaseSlope,
    CaseState,
    slope_motions,
    solve_case,
)
from headstock.studies.identification.targets import (
    ComplianceTarget,
    FitTable,
    Parameter,
    ShapeTarget,
)

OTHER_NUMBER = 1e12  # cost of a mode of another number than the one that a target names


@dataclass(frozen=True)
class Pairing:
    """Which mode of a case meets which target: index into modes above the floor, one per target."""

    modes: tuple[int, ...]


def _pair_targets(state: CaseState) -> Pairing:
    """The pairing of targets and modes that leaves the smallest sum of squares in frequencies and
    shapes.

    Held-out targets take part: they are distinguished by what is known of them, and add nothing to
    the fit.
    """
    targets = state.model.case.modes
    if not targets:
        return Pairing(())
    wanted = np.log([target.frequency_hz for target in targets])
    sigmas = np.array([target.sigma for target in targets])
    return Pairing(
        match_frequencies(
            np.log(state.frequencies_hz), wanted, sigmas=sigmas, costs=shape_costs(state)
        )
    )


def shape_costs(state: CaseState) -> FloatArray:
    """Return what each target ``(t, m)`` would pay for the shape of each mode, and for another number than its
    own.
    """
    cost = np.zeros((len(state.model.case.modes), len(state.frequencies_hz)))
    for row, target in enumerate(state.model.case.modes):
        if target.shape is not None:
            cost[row] = (1.0 - compare_shape(state, target.shape)) / target.shape.tolerance**2
        if target.number is not None:
            others = np.arange(cost.shape[1]) != target.number - 1 - state.below
            cost[row, others] += OTHER_NUMBER
    return cost


def _follow_modes(before: CaseState, pairing: Pairing, state: CaseState) -> Pairing:
    """The same modes after a step, found by MAC in the norm of the mass matrix of the earlier
    state.

    Args:
        before: The case at the earlier values.
        pairing: Which of its modes each target goes with.
        state: The case after the step.
    """
    if not pairing.modes:
        return pairing
    weighed = before.slopes.mass_times(before.motions[:, list(pairing.modes)])
    products = (weighed.T @ state.motions) ** 2
    sizes = np.einsum("ij,ij->j", state.motions, before.slopes.mass_times(state.motions))
    pairs = assign_modes(np.asarray(products / sizes), np.zeros(1), mac_threshold=0.0)
    return Pairing(tuple(pair.second for pair in pairs))


def compare_shape(state: CaseState, shape: ShapeTarget) -> FloatArray:
    """MAC ``(m,)`` of a target shape with every mode.

    Source: Allemang and Brown (1982).
    """
    observed, wanted = _seen_shapes(state, shape)
    sizes = np.maximum(np.einsum("ij,ij->j", observed, observed), np.finfo(float).tiny)
    return (wanted @ observed) ** 2 / sizes


@dataclass(frozen=True, eq=False)
class _Block:
    """Residuals over their standard deviations that belong together.

    Attributes:
        values: ``(r,)``.
        find_slopes: Returns their derivatives ``(r, p)`` by the parameters' values.
    """

    values: FloatArray
    find_slopes: Callable[[], FloatArray]
    frequency: bool = False


def _list_blocks(state: CaseState, pairing: Pairing) -> Iterator[_Block]:
    """Yield the residuals of a case: of each frequency and its shape, each compliance, the limit on
    modes; held-out ones left out.
    """
    case = state.model.case
    for target, mode in zip(case.modes, pairing.modes, strict=True):
        if target.hold_out:
            continue
        gap = np.log(state.frequencies_hz[mode] / target.frequency_hz) / target.sigma
        scale = 2.0 * state.eigenvalues[mode] * target.sigma
        slopes = partial(_spread_slopes, state, _read_eigenvalue(mode), scale)
        yield _Block(np.array([gap]), slopes, frequency=True)
        if (shape := target.shape) is not None:
            yield _Block(
                _shape_gap(state, shape, mode), partial(_shape_gap_slopes, state, shape, mode)
            )
    for number, compliance in enumerate(case.compliances):
        if not compliance.hold_out:
            value = float(state.compliances[number])
            scale = (value if compliance.logarithmic else compliance.value) * compliance.sigma
            slopes = partial(_spread_slopes, state, _read_compliance(number), scale)
            yield _Block(np.array([compliance_gap(compliance, value)]), slopes)
    if case.limit is not None:
        gap = max(0.0, _limit_gap(state) / case.limit.sigma)
        yield _Block(np.array([gap]), partial(_limit_slopes, state))


def mode_rows(state: CaseState, pairing: Pairing) -> tuple[tuple[int | None, ...], int]:
    """Return the row of each frequency among the residuals of a case (None where it is held out), and
    how many residuals there are.
    """
    blocks = list(_list_blocks(state, pairing))
    ends = np.cumsum([0, *(len(block.values) for block in blocks)])
    rows = iter(int(end) for block, end in zip(blocks, ends[:-1], strict=True) if block.frequency)
    held_out = [target.hold_out for target in state.model.case.modes]
    return tuple(None if held else next(rows) for held in held_out), int(ends[-1])


def _read_eigenvalue(mode: int) -> Callable[[CaseSlope], float]:
    return lambda slope: float(slope.eigenvalues[mode])


def _read_compliance(number: int) -> Callable[[CaseSlope], float]:
    return lambda slope: float(slope.compliances[number])


def _spread_slopes(
    state: CaseState, read: Callable[[CaseSlope], float], scale: float
) -> FloatArray:
    """Return a derivative by each parameter over a scale, ``(1, p)``; zero where it touches nothing."""
    row = np.zeros((1, len(state.model.parameters)))
    for index, slope in state.by_parameter.items():
        row[0, index] = read(slope) / scale
    return row


def compliance_gap(target: ComplianceTarget, value: float) -> float:
    """Return the distance of a compliance from its target in standard deviations."""
    if target.logarithmic:
        ratio = value / target.value
        return float(
            np.log(abs(ratio) if target.either_sign else max(ratio, np.finfo(float).tiny))
            / target.sigma
        )
    return (value / target.value - 1.0) / target.sigma


def _seen_shapes(state: CaseState, shape: ShapeTarget) -> tuple[FloatArray, FloatArray]:
    """What each mode does where the target looks ``(k, m)``, and the target ``(k,)`` with length
    one.
    """
    rows = _shape_rows(state, shape)
    wanted = np.array([value for _, _, value in shape.entries])
    return rows @ state.motions, wanted / np.linalg.norm(wanted)


def _shape_rows(state: CaseState, shape: ShapeTarget) -> FloatArray:
    observers, length = state.slopes.pieces.observers, state.coupled.layout.length
    return np.array(
        [observers[name][dof] * (length if dof > 2 else 1.0) for name, dof, _ in shape.entries]
    )


def _shape_gap(state: CaseState, shape: ShapeTarget, mode: int) -> FloatArray:
    """Part of the target at right angles to the mode ``(k,)``: its square is ``1 - MAC``."""
    observed, wanted = _seen_shapes(state, shape)
    unit = observed[:, mode] / max(float(np.linalg.norm(observed[:, mode])), np.finfo(float).tiny)
    return (wanted - (wanted @ unit) * unit) / shape.tolerance


def _shape_gap_slopes(state: CaseState, shape: ShapeTarget, mode: int) -> FloatArray:
    slopes, count = state.by_parameter, len(state.model.parameters)
    observed, wanted = _seen_shapes(state, shape)
    size = max(float(np.linalg.norm(observed[:, mode])), np.finfo(float).tiny)
    unit = observed[:, mode] / size
    result = np.zeros((len(wanted), count))
    changes = _shape_rows(state, shape) @ slope_motions(state, mode, list(slopes.values()))
    length = state.coupled.layout.length
    for column, (index, slope) in enumerate(slopes.items()):
        change = changes[:, column]
        moved = slope.pieces.observers
        for row, (name, dof, _) in enumerate(shape.entries):
            if name in moved:
                change[row] += (length if dof > 2 else 1.0) * (
                    moved[name][dof] @ state.motions[:, mode]
                )
        turn = (change - (unit @ change) * unit) / size
        result[:, index] = -((wanted @ turn) * unit + (wanted @ unit) * turn) / shape.tolerance
    return result


def _limit_gap(state: CaseState) -> float:
    limit = state.model.case.limit
    if limit is None or len(state.frequencies_hz) <= limit.modes:
        return -np.inf
    return float(np.log(limit.below_hz / state.frequencies_hz[limit.modes]))


def _limit_slopes(state: CaseState) -> FloatArray:
    limit = state.model.case.limit
    if limit is None or not _limit_gap(state) > 0.0:
        return np.zeros((1, len(state.model.parameters)))
    scale = -2.0 * state.eigenvalues[limit.modes] * limit.sigma
    return _spread_slopes(state, _read_eigenvalue(limit.modes), scale)


@dataclass(frozen=True, eq=False)
class FitProblem:
    """Cases and parameters of a fit, in fitted coordinates: ln p or p over its bounds' width."""

    cases: tuple[CaseModel, ...]
    parameters: tuple[Parameter, ...]
    settings: FitTable

    def coordinates(self, values: Sequence[float]) -> FloatArray:
        """Coordinates of parameter values."""
        return np.array([_locate(p, v) for p, v in zip(self.parameters, values, strict=True)])

    def values(self, coordinates: FloatArray) -> dict[str, float]:
        """Parameter values by name, SI."""
        return {
            p.name: float(np.exp(x) if p.logarithmic else x * _width(p))
            for p, x in zip(self.parameters, coordinates, strict=True)
        }

    def value_slopes(self, coordinates: FloatArray) -> FloatArray:
        """Derivative of each value by its coordinate ``(p,)``."""
        return np.array(
            [
                np.exp(x) if p.logarithmic else _width(p)
                for p, x in zip(self.parameters, coordinates, strict=True)
            ]
        )

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
                means[index] = _locate(parameter, parameter.prior)
                sigmas[index] = parameter.prior_sigma / (
                    1.0 if parameter.logarithmic else _width(parameter)
                )
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
        residuals: Of the data ``(r,)``.
    """

    states: tuple[CaseState, ...]
    residuals: FloatArray

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
        pairings = tuple(_follow_modes(before, pairing, state) for before, pairing, state in pairs)
    else:
        pairings = tuple(_pair_targets(state) for state in states)
    return _make_point(problem, np.array(coordinates), states, pairings)


def exchange_modes(problem: FitProblem, point: FitPoint, pairings: tuple[Pairing, ...]) -> FitPoint:
    """The same values with targets compared to other modes.

    Args:
        point: Values with the states of all cases.
        pairings: For each case, which mode each target goes with.
    """
    return _make_point(problem, point.coordinates, point.states, pairings)


def data_jacobian(problem: FitProblem, point: FitPoint) -> FloatArray:
    """Return derivatives ``(r, p)`` of the residuals of the data by the coordinates."""
    pairs = zip(point.states, point.pairings, strict=True)
    rows = [block.find_slopes() for pair in pairs for block in _list_blocks(*pair)]
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
    values = [block.values for pair in pairs for block in _list_blocks(*pair)]
    residuals = np.concatenate([np.zeros(0), *values])
    priors = prior_residuals(problem, coordinates)
    return FitPoint(
        coordinates=coordinates,
        pairings=pairings,
        cost=0.5 * float(residuals @ residuals + priors @ priors),
        states=states,
        residuals=residuals,
    )


def _width(parameter: Parameter) -> float:
    return parameter.upper - parameter.lower


def _locate(parameter: Parameter, value: float) -> float:
    """Return the coordinate of a value."""
    return float(np.log(value)) if parameter.logarithmic else value / _width(parameter)
