"""Every fitted mode predicted from all the others: how well a fit knows what it was not shown."""

import functools
import time
from collections.abc import Callable

from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.identification.identification import (
    FitEnds,
    TargetOutcome,
    assess_ends,
    fit_targets,
)
from headstock.studies.identification.targets import TargetCase


def predict_each_mode(
    ends: FitEnds, observer: Callable[[int, int, str, float], None], *, comm: MPI.Comm
) -> list[TargetOutcome]:
    """Leave out one mode after another, its shape and damping too, and fit the others; collective.

    Every fit begins where that of all modes began: a parameter that one mode alone determines must not
    keep what this mode made of it.

    Args:
        ends: The same on every rank.
        observer: Called on rank 0 as each fit ends: its number from 1, how many there are, the mode
            that it left out, and the time since the first began [s].

    Returns:
        The frequency of each mode, predicted; the same on every rank.

    Raises:
        HeadstockError: One of the fits could not be computed.
    """
    targets = [target for model in ends.problem.cases for target in model.case.modes]
    predicted = []
    names = [target.name for target in targets if not target.hold_out]
    begin = time.perf_counter()
    for number, name in enumerate(names, 1):
        hide = functools.partial(TargetCase.change_modes, names={name}, hold_out=True)
        found = fit_targets(ends.problem.change_cases(hide), comm=comm)
        predicted.append(make_on_root(comm, functools.partial(_find_outcome, found, name)))
        if comm.rank == 0:
            observer(number, len(names), name, time.perf_counter() - begin)
    return predicted


def _find_outcome(ends: FitEnds, name: str) -> TargetOutcome:
    """Return the frequency of the mode of a name after a fit."""
    outcomes = assess_ends(ends, name).outcomes
    return next(item for item in outcomes if item.name == name and item.kind == "frequency")
