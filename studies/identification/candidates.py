"""Further measurements, and added masses, that would determine what the data of a fit leave open."""

import dataclasses
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.reduction.coupling.slopes import ObservedDof, slope_modes
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import slope_squares
from headstock.solvers.linear.symmetric_modes import solve_symmetric_modes
from headstock.studies.identification.cases import CaseState, make_case, solve_case
from headstock.studies.identification.identification import Identification
from headstock.studies.identification.observations import list_observations
from headstock.studies.identification.sensors import DIRECTIONS, list_channels
from headstock.studies.identification.targets import ComplianceTarget

# standard deviations that are taken for granted, relative
FREQUENCY_SIGMA, COMPLIANCE_SIGMA = 0.01, 0.05
MASS_SHARE = 0.02  # of the machine, added at one place
SHOWN = 8
LEAST_BITS = 0.1


@dataclass(frozen=True)
class Candidate:
    """A measurement that was not made.

    Attributes:
        name: In plain words.
        bits: Expected gain of information on all parameters: one bit halves a volume.
        spread: Standard deviation of the weakest combination of parameters with it, over what it is
            without it.
    """

    name: str
    bits: float
    spread: float


def suggest_measurements(found: Identification) -> tuple[Candidate, ...]:
    """Return the measurements with the largest gain of information, the best first.

    The gain is that of the linearised fit, in which parameters spread evenly between their bounds
    where they have no prior.

    Source: Lindley (1956); Chaloner and Verdinelli (1995), Bayesian experimental design.
    """
    candidates = [
        Candidate(name, *found.statistics.weigh(rows)) for name, rows in _list_candidates(found)
    ]
    candidates.sort(key=lambda item: (-item.bits, item.name))
    return tuple(item for item in candidates[:SHOWN] if item.bits >= LEAST_BITS)


def _list_candidates(found: Identification) -> Iterator[tuple[str, FloatArray]]:
    """Yield measurements and their derivatives ``(r, p)`` over their standard deviations by the
    coordinates.
    """
    scale = found.problem.value_slopes(found.point.coordinates)
    for number, state in enumerate(found.point.states):
        case = state.model.case
        paired = found.point.pairings[number]
        highest = max((mode + 1 for mode in paired), default=0)
        for mode in range(min(len(state.eigenvalues), highest + 3)):
            if mode not in paired:
                row = _slope_logs(state, state.eigenvalues, state.shapes)[[mode]]
                name = f"{case.name}: frequency of mode {mode + 1} ({state.frequencies_hz[mode]:.4g} Hz)"
                yield name, row / FREQUENCY_SIGMA * scale
        places = _list_whole_places(state)
        yield from _list_compliances(state, places, scale)
        if highest:
            for place in places:
                rows = _slope_with_mass(state, place, highest)
                yield (
                    f"{case.name}: frequencies with a mass at {place}",
                    rows / FREQUENCY_SIGMA * scale,
                )


def _list_whole_places(state: CaseState) -> list[str]:
    """Return the places where all three translations are known."""
    counts = Counter(end.observer for end in list_channels([state]))
    return [name for name, count in counts.items() if count == len(DIRECTIONS)]


def _list_compliances(
    state: CaseState, places: list[str], scale: FloatArray
) -> Iterator[tuple[str, FloatArray]]:
    """Yield compliances of places that are no targets; none of a machine that moves freely."""
    case = state.model.case
    known = {(target.motion, target.force) for target in case.compliances}
    ends = [ObservedDof(place, dof) for place in places for dof in range(3)]
    targets = tuple(
        ComplianceTarget(
            f"{case.name}: compliance of {end.observer} in {DOF_NAMES[end.dof]}",
            end,
            end,
            value=1.0,
            sigma=COMPLIANCE_SIGMA,
        )
        for end in ends
        if (end, end) not in known
    )
    asked = dataclasses.replace(case, modes=(), compliances=targets, responses=(), limit=None)
    model = state.model
    measured = make_case(asked, model.parametric, model.pose, model.parameters)
    try:
        observations = list(list_observations(solve_case(measured, state.values), ()))
    except ModelError:
        return
    for item in observations:
        yield item.name, item.find_slopes() * scale


def _slope_with_mass(state: CaseState, place: str, count: int) -> FloatArray:
    """Return the derivatives ``(count, p)`` of the logarithms of frequencies with a mass at a place."""
    system = state.coupled.system
    superelements = state.coupled.layout.superelements.values()
    added = MASS_SHARE * sum(part.mass_kg for part in superelements)
    rows = np.array([system.outputs[place, dof] for dof in DIRECTIONS])
    wanted = state.below + count
    pairs = solve_symmetric_modes(
        system.stiffness, system.mass + added * rows.T @ rows, wanted=wanted
    )
    kept = slice(state.below, wanted)
    return _slope_logs(state, pairs.eigenvalues[kept], pairs.shapes[:, kept])


def _slope_logs(state: CaseState, eigenvalues: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the derivatives ``(m, p)`` of the logarithms of frequencies by the parameters' values."""
    slopes = np.zeros((len(eigenvalues), len(state.model.parameters)))
    for index, slope in state.by_parameter.items():
        modes = slope_modes(state.slopes, slope.pieces, eigenvalues, shapes)
        slopes[:, index] = slope_squares(shapes, modes.forces) / (2.0 * eigenvalues)
    return slopes
