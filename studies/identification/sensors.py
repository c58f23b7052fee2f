"""What one further sensor would show of the measured modes: what it adds to the parameters, and
which of several models it speaks for.

A sensor is read along with a reference point, in whose three directions the modes are measured too:
a mode's shape is known up to a factor only.
"""

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.reduction.coupling.slopes import ObservedDof
from headstock.studies.identification.cases import CaseState, make_case, shape_rows, solve_case
from headstock.studies.identification.identification import Identification
from headstock.studies.identification.observations import slope_observed
from headstock.studies.identification.targets import VECTOR_TOLERANCE, ShapeTarget

MOST_PLACES = 60
UNSEEN = 1e-6  # motion of a mode over the largest of all channels and modes
DIRECTIONS = DOF_NAMES[:3]


@dataclass(frozen=True, eq=False)
class SensorView:
    """A reference point, and one more sensor, on the modes that meet targets.

    Attributes:
        name: Sensor and direction; the reference point alone.
        units: Motions of the modes ``(m, k)``, each of length one.
        slopes: Their derivatives ``(m, k, p)`` by the coordinates.
    """

    name: str
    units: FloatArray
    slopes: FloatArray


@dataclass(frozen=True)
class RankedSensor:
    """What a further sensor is expected to say.

    Attributes:
        name: Sensor and direction; the reference point alone.
        bits: Expected gain of information on all parameters: one bit halves a volume.
        spread: Standard deviation of the weakest combination of parameters with it, over what it is
            without it.
        log_evidence: By model, the best but one first: expected logarithm of the ratio of evidence
            between the best one and it, whichever is true; empty without rivals.
        mode: Target at which the best two differ most; empty without rivals.
    """

    name: str
    bits: float
    spread: float
    log_evidence: dict[str, float]
    mode: str
    is_reference: bool = False


def list_channels(states: Sequence[CaseState]) -> list[ObservedDof]:
    """Return the directions of sensors, points and interfaces that every case has; those of the
    reference point are the first three, and none where no place has three.
    """
    counts = Counter(end for state in states for end in state.coupled.system.outputs)
    ends = [
        ObservedDof(name, DIRECTIONS.index(dof))
        for (name, dof), count in counts.items()
        if count == len(states) and dof in DIRECTIONS
    ]
    names = Counter(end.observer for end in ends)
    whole = [name for name, count in names.items() if count == len(DIRECTIONS)]
    if not whole:
        return []
    machine = states[0].model.parametric.scene.machine
    reference = next((name for name in whole if name in machine.points), whole[0])
    # a point of the tool before sensors, and these before interfaces
    order = sorted(names, key=lambda name: (name != reference, name not in machine.sensors))
    return [end for name in order[:MOST_PLACES] for end in ends if end.observer == name]


def _list_views(found: Identification, channels: Sequence[ObservedDof]) -> Iterator[SensorView]:
    """Yield what the reference point shows alone, then with each further channel.

    Args:
        channels: From ``list_channels``.
    """
    entries = tuple((name, dof, 1.0) for name, dof in channels)
    shape = ShapeTarget(entries, VECTOR_TOLERANCE, described=False)
    scale = found.problem.value_slopes(found.point.coordinates)
    motions, slopes = list[FloatArray](), list[FloatArray]()
    for state, pairing in zip(found.point.states, found.point.pairings, strict=True):
        model, case = state.model, state.model.case
        modes = tuple(dataclasses.replace(target, shape=shape) for target in case.modes)
        watched = dataclasses.replace(case, modes=modes, compliances=(), responses=(), limit=None)
        seen = solve_case(
            make_case(watched, model.parametric, model.pose, model.parameters), state.values
        )
        rows = shape_rows(seen, shape)
        for mode in pairing:
            motions.append(rows @ seen.motions[:, mode])
            slopes.append(np.real(slope_observed(seen, shape, mode)) * scale)
    reference = channels[0].observer
    for last in (None, *range(3, len(channels))):
        chosen = [0, 1, 2] if last is None else [0, 1, 2, last]
        motion, slope = np.array(motions)[:, chosen], np.array(slopes)[:, chosen]
        sizes = np.linalg.norm(motion, axis=1, keepdims=True)
        # a mode that does not move there shows nothing
        sizes[sizes <= UNSEEN * np.max(np.abs(motions))] = np.inf
        units = motion / sizes
        along = np.einsum("mk,mkp->mp", units, slope)
        turns = (slope - units[:, :, None] * along[:, None]) / sizes[:, :, None]
        name = (
            reference
            if last is None
            else f"{channels[last].observer} {DOF_NAMES[channels[last].dof]}"
        )
        yield SensorView(name, units, turns)


def rank_sensors(
    found: Identification, models: Mapping[str, Identification]
) -> tuple[RankedSensor, ...]:
    """Return what each further sensor would say about parameters, and about models of the same
    targets: the best first, of models that which distinguishes the best two.

    Each model could still be adapted to what the sensor shows as far as the other measurements
    leave it open.

    Args:
        found: Whose parameters they would determine.
        models: By name, the one with the largest evidence first; empty without rivals.

    Source: Lindley (1956) for the gain; Box and Hill (1967) for models, whose covariances are taken
    for equal in size.
    """
    names = [target.name for model in found.problem.cases for target in model.case.modes]
    channels = list_channels(
        [state for one in (found, *models.values()) for state in one.point.states]
    )
    if not channels or not names:
        return ()
    views = {name: list(_list_views(one, channels)) for name, one in models.items()}
    best, *others = [*models] or [""]
    ranked = []
    for number, view in enumerate(_list_views(found, channels)):
        logs, mode = dict[str, float](), ""
        for name in others:
            pair = views[best][number], views[name][number]
            logs[name] = min(_weigh_gap(*pair, models[name]), _weigh_gap(*pair[::-1], models[best]))
            alike = np.einsum("mk,mk->m", pair[0].units, pair[1].units) ** 2
            mode = mode or names[int(np.argmin(alike))]
        rows = np.asarray(view.slopes.reshape(-1, view.slopes.shape[2]) / VECTOR_TOLERANCE)
        ranked.append(
            RankedSensor(view.name, *found.statistics.weigh(rows), logs, mode, number == 0)
        )
    return tuple(
        sorted(ranked, key=lambda one: (*(-log for log in one.log_evidence.values()), -one.bits))
    )


def _weigh_gap(true: SensorView, other: SensorView, fitted: Identification) -> float:
    """Return the expected logarithm of the evidence against a model, where another one is true.

    Args:
        fitted: The model that is not true, seen in ``other``.
    """
    share = np.einsum("mk,mk->m", true.units, other.units)
    gap = true.units - share[:, None] * other.units
    turned = np.einsum("mk,mkp->mp", true.units, other.slopes)
    slopes = -(share[:, None, None] * other.slopes + other.units[:, :, None] * turned[:, None])
    rows = slopes.reshape(gap.size, -1) / VECTOR_TOLERANCE
    spread = np.eye(gap.size) + rows @ fitted.statistics.bounded_covariance @ rows.T
    weighed = gap.ravel() / VECTOR_TOLERANCE
    return 0.5 * float(weighed @ np.linalg.solve(spread, weighed))
