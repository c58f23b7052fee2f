"""Targets beside the model: of each kind a value, a distance in standard deviations and its
derivatives. A kind is added by one function here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.solvers.pairing.mode_pairing import Field
from headstock.solvers.second_order import ComplexArray
from headstock.studies.identification.cases import (
    AT_REST,
    CaseSlope,
    CaseState,
    shape_rows,
)
from headstock.studies.identification.pairings import Pairing
from headstock.studies.identification.targets import (
    ComplianceTarget,
    MeasuredDamping,
    ModeTarget,
    ResponseTarget,
    ShapeTarget,
)

# of a measured damping ratio: below, the model has none as far as its logarithm is concerned
LEAST_SHARE = 1e-4

type Slopes = Callable[[], FloatArray]


@dataclass(frozen=True)
class _TargetKind:
    """A kind of target: those of one kind share a noise factor.

    Attributes:
        unit: In tables and files; empty for a ratio.
        scale: Factor from SI to the unit.
    """

    unit: str
    scale: float


KINDS = {
    "frequency": _TargetKind("Hz", 1.0),
    "shape": _TargetKind("", 1.0),
    "damping": _TargetKind("%", 100.0),
    "compliance": _TargetKind("um/kN", UM_PER_KN),
    "response": _TargetKind("um/kN", UM_PER_KN),
    "limit": _TargetKind("Hz", 1.0),
}


@dataclass(frozen=True, eq=False)
class Observation:
    """A target beside the model at given parameter values.

    Attributes:
        kind: Name in ``KINDS``.
        wanted: Measured value, SI; for a shape its MAC of one.
        value: The same of the model.
        sigma: Relative standard deviation of the measurement.
        residuals: ``(r,)`` distances in standard deviations.
        find_slopes: Returns their derivatives ``(r, p)`` by the parameters' values.
        data: How many measurements it counts for: a shape one, a limit none.
        hold_out: Predicted, not fitted.
        mode: Index of its mode above the floor; None without.
    """

    kind: str
    name: str
    wanted: float
    value: float
    sigma: float
    residuals: FloatArray
    find_slopes: Slopes
    data: int = 1
    hold_out: bool = False
    mode: int | None = None


def list_observations(state: CaseState, pairing: Pairing) -> Iterator[Observation]:
    """Yield all targets of a case beside its state, held-out ones too.

    Args:
        pairing: Which mode each of its targets goes with.
    """
    case = state.model.case
    for target, mode in zip(case.modes, pairing, strict=True):
        yield _observe_frequency(state, target, mode)
        if target.shape is not None:
            yield _observe_shape(state, target, target.shape, mode)
        if target.damping is not None:
            yield _observe_damping(state, target, target.damping, mode)
    for compliance in case.compliances:
        yield _observe_compliance(state, compliance)
    for response in case.responses:
        yield _observe_response(state, response)
    if case.limit is not None:
        yield _observe_limit(state)


def _observe_frequency(state: CaseState, target: ModeTarget, mode: int) -> Observation:
    value = float(state.frequencies_hz[mode])
    scale = 2.0 * state.eigenvalues[mode] * target.sigma
    return Observation(
        kind="frequency",
        name=target.name,
        wanted=target.frequency_hz,
        value=value,
        sigma=target.sigma,
        residuals=np.array([np.log(value / target.frequency_hz) / target.sigma]),
        find_slopes=partial(_spread_slopes, state, lambda slope: slope.eigenvalues[mode] / scale),
        hold_out=target.hold_out,
        mode=mode,
    )


def _observe_shape(
    state: CaseState, target: ModeTarget, shape: ShapeTarget, mode: int
) -> Observation:
    """The distances are the part of the target at right angles to the mode, of a complex target to the
    damped mode: their squares sum up to ``1 - MAC``.
    """
    observed, wanted = shape_rows(state, shape) @ state.motion(mode, shape), shape.direction
    unit = observed / max(float(np.linalg.norm(observed)), np.finfo(float).tiny)
    gap = wanted - (unit.conj() @ wanted) * unit
    return Observation(
        kind="shape",
        name=target.name,
        wanted=1.0,
        value=float(np.abs(unit.conj() @ wanted) ** 2),
        sigma=shape.tolerance,
        residuals=_split_parts(gap / shape.tolerance, shape),
        find_slopes=partial(_slope_shape_gap, state, shape, mode),
        hold_out=target.hold_out,
        mode=mode,
    )


def _observe_damping(
    state: CaseState, target: ModeTarget, damping: MeasuredDamping, mode: int
) -> Observation:
    value = state.damped_mode(mode).ratio
    size = max(value, LEAST_SHARE * damping.ratio)
    scale = size * damping.sigma
    return Observation(
        kind="damping",
        name=target.name,
        wanted=damping.ratio,
        value=value,
        sigma=damping.sigma,
        residuals=np.array([np.log(size / damping.ratio) / damping.sigma]),
        find_slopes=partial(
            _spread_slopes, state, lambda slope: state.slope_damping(mode, slope) / scale
        ),
        hold_out=target.hold_out,
        mode=mode,
    )


def _observe_compliance(state: CaseState, target: ComplianceTarget) -> Observation:
    ends = (target.motion, target.force, AT_REST)
    value = float(state.receptances(*ends)[0].real)
    ratio = value / target.value
    if target.logarithmic:
        size = abs(ratio) if target.either_sign else max(ratio, np.finfo(float).tiny)
        gap, scale = np.log(size) / target.sigma, value * target.sigma
    else:
        gap, scale = (ratio - 1.0) / target.sigma, target.value * target.sigma
    return Observation(
        kind="compliance",
        name=target.name,
        wanted=target.value,
        value=abs(value) if target.either_sign else value,
        sigma=target.sigma,
        residuals=np.array([gap]),
        find_slopes=partial(
            _spread_slopes,
            state,
            lambda slope: float(state.slope_receptances(*ends, slope)[0].real) / scale,
        ),
        hold_out=target.hold_out,
    )


def _observe_response(state: CaseState, target: ResponseTarget) -> Observation:
    """The logarithms of the ratio of model and measurement, of sizes, then the phases between them; or
    where noise is known the real, then the imaginary parts of differences.

    Shown is the line with the largest measured size.
    """
    ends = (target.motion, target.force, target.frequencies_hz)
    values, measured = state.receptances(*ends), np.array(target.values)
    peak = int(np.argmax(np.abs(measured)))
    if target.deviations:
        gaps, scale = values - measured, np.array(target.deviations)
    else:
        gaps, scale = np.log(values / measured), target.sigma * np.ones(len(values))
    weights = 1.0 / (scale if target.deviations else scale * values)

    def read(slope: CaseSlope) -> FloatArray:
        changes = weights * state.slope_receptances(*ends, slope)
        return np.concatenate([changes.real, changes.imag])

    return Observation(
        kind="response",
        name=target.name,
        wanted=float(np.abs(measured[peak])),
        value=float(np.abs(values[peak])),
        sigma=target.sigma,
        residuals=np.concatenate([gaps.real / scale, gaps.imag / scale]),
        find_slopes=partial(_spread_slopes, state, read, 2 * len(values)),
        data=2 * len(values),
        hold_out=target.hold_out,
    )


def _observe_limit(state: CaseState) -> Observation:
    """The next mode above those allowed, by how far it misses the limit; nothing where it does not."""
    limit = state.model.case.limit
    if limit is None:
        raise AssertionError("a case without a limit is asked for it")
    next_one = limit.modes if limit.modes < len(state.frequencies_hz) else None
    value = np.inf if next_one is None else float(state.frequencies_hz[next_one])
    gap = max(0.0, float(np.log(limit.below_hz / value)) / limit.sigma)

    def read(slope: CaseSlope) -> float:
        if next_one is None or gap == 0.0:
            return 0.0
        return -float(
            slope.eigenvalues[next_one] / (2.0 * state.eigenvalues[next_one] * limit.sigma)
        )

    return Observation(
        kind="limit",
        name=f"{state.model.case.name} at most {limit.modes} modes",
        wanted=limit.below_hz,
        value=value,
        sigma=limit.sigma,
        residuals=np.array([gap]),
        find_slopes=partial(_spread_slopes, state, read),
        data=0,
    )


def _spread_slopes(
    state: CaseState, read: Callable[[CaseSlope], float | FloatArray], count: int = 1
) -> FloatArray:
    """Return derivatives by each parameter ``(count, p)``; zero where it touches nothing."""
    rows = np.zeros((count, len(state.model.parameters)))
    for index, slope in state.by_parameter.items():
        rows[:, index] = read(slope)
    return rows


def _split_parts(values: ComplexArray, shape: ShapeTarget) -> FloatArray:
    """Return real parts, and behind them imaginary ones of a complex shape."""
    parts = [values.real, values.imag] if shape.is_complex else [values.real]
    return np.concatenate(parts).astype(np.float64)


def _slope_shape_gap(state: CaseState, shape: ShapeTarget, mode: int) -> FloatArray:
    wanted, changes = shape.direction, slope_observed(state, shape, mode)
    observed = shape_rows(state, shape) @ state.motion(mode, shape)
    size = max(float(np.linalg.norm(observed)), np.finfo(float).tiny)
    unit = observed / size
    turns = (changes - np.outer(unit, unit.conj() @ changes)) / size
    gaps = -(np.outer(unit, turns.conj().T @ wanted) + (unit.conj() @ wanted) * turns)
    return np.asarray(_split_parts(gaps, shape) / shape.tolerance, dtype=np.float64)


def slope_observed(state: CaseState, shape: ShapeTarget, mode: int) -> FloatArray | ComplexArray:
    """Return the derivatives ``(k, p)`` of a mode's motions that a shape consists of, by the
    parameters' values.
    """
    slopes, motion = state.by_parameter, state.motion(mode, shape)
    if not slopes:
        return np.zeros((len(shape.entries), len(state.model.parameters)))
    moving = state.slope_motions(mode, shape, list(slopes.values()))
    size = len(shape.entries), len(state.model.parameters)
    changes: Field = np.zeros(size, dtype=moving.dtype)
    changes[:, list(slopes)] = shape_rows(state, shape) @ moving
    length = state.coupled.layout.length
    for index, slope in slopes.items():
        moved = slope.pieces.observers
        for row, (name, dof, _) in enumerate(shape.entries):
            if name in moved:
                changes[row, index] += (length if dof > 2 else 1.0) * (moved[name][dof] @ motion)
    return changes
