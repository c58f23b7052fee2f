"""Every fitted mode predicted from all the others: how well a fit knows what it was not shown."""

import functools

from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.identification.identification import (
    FitEnds,
    TargetOutcome,
    assess_ends,
    fit_targets,
)
from headstock.studies.identification.targets import TargetCase


def predict_each_mode(ends: FitEnds, *, comm: MPI.Comm) -> list[TargetOutcome]:
    """Leave out one mode after another, its shape and damping too, and fit the others; collective.

    Every fit begins where that of all modes began: a parameter that one mode alone determines must not
    keep what this mode made of it.

    Args:
        ends: The same on every rank.

    Returns:
        The frequency of each mode, predicted; the same on every rank.

    Raises:
        HeadstockError: One of the fits could not be computed.
    """
    targets = [target for model in ends.problem.cases for target in model.case.modes]
    predicted = []
    for name in (target.name for target in targets if not target.hold_out):
        hide = functools.partial(TargetCase.change_modes, names={name}, hold_out=True)
        found = fit_targets(ends.problem.change_cases(hide), comm=comm)
        predicted.append(make_on_root(comm, functools.partial(_find_outcome, found, name)))
    return predicted


def _find_outcome(ends: FitEnds, name: str) -> TargetOutcome:
    """Return the frequency of the mode of a name after a fit."""
    outcomes = assess_ends(ends, name).outcomes
    return next(item for item in outcomes if item.name == name and item.kind == "frequency")
