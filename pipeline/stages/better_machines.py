"""The machine of a run without one source of error, as far as its estimates say: an analysis that is
repeated with it tells how far its numbers may be off.
"""

import dataclasses
from collections.abc import Callable, Mapping

from headstock.pipeline.answers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    REDUCTION,
)
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.reduction.estimates.better_elements import (
    with_finer_mesh,
    with_modes_left_out,
    with_true_faces,
)
from headstock.reduction.superelement import Superelement

NOT_ASKED = "any error, as the scene says estimate = false"
Sources = Mapping[str, Callable[[Superelement], Superelement]]
Owner = tuple[str, str]  # source of error, and the component alone that has it; empty for all
# by source of error, what a superelement is without it
EACH: Sources = {
    DISCRETISATION: with_finer_mesh,
    CURVED_FACES: with_true_faces,
    REDUCTION: with_modes_left_out,
}
# of long analyses: meshes and reductions both make a machine too stiff
ONCE: Sources = {
    f"{DISCRETISATION} and {REDUCTION}": lambda part: with_modes_left_out(with_finer_mesh(part)),
    CURVED_FACES: with_true_faces,
}


def list_better_machines(state: RunState, sources: Sources) -> dict[str, RunState]:
    """By source of error, the run with superelements without it; no entry of a source that changes
    nothing.

    Args:
        state: Of the run.
        sources: What is looked at.
    """
    found = {}
    for source, improve in sources.items():
        better = _improve(state, improve)
        if better:
            found[source] = _replace(state, better)
    return found


def list_single_machines(state: RunState) -> dict[Owner, RunState]:
    """The same of each source, and of meshes one component at a time: what two of them change may
    cancel by chance.
    """
    found: dict[Owner, RunState] = {}
    for source, improve in EACH.items():
        better = _improve(state, improve)
        if source == DISCRETISATION:
            found |= {(source, name): _replace(state, {name: own}) for name, own in better.items()}
        elif better:
            found[source, ""] = _replace(state, better)
    return found


def _improve(
    state: RunState, improve: Callable[[Superelement], Superelement]
) -> dict[str, ReducedComponent]:
    """Components that are others without a source of error."""
    better = {
        name: dataclasses.replace(part, superelement=improve(part.superelement))
        for name, part in state.reduced.items()
    }
    return {
        name: part
        for name, part in better.items()
        if part.superelement is not state.reduced[name].superelement
    }


def _replace(state: RunState, better: Mapping[str, ReducedComponent]) -> RunState:
    return silence(dataclasses.replace(state, reduced={**state.reduced, **better}))


def find_silent_meshes(state: RunState) -> tuple[str, ...]:
    """Components whose mesh shows nothing of its error."""
    return tuple(
        name
        for name, part in state.parts.superelements.items()
        if part.errors.missing_energy is not None and not part.errors.missing_energy.any()
    )


def silence(state: RunState) -> RunState:
    """The run for a solution beside its own, whose warnings are not told."""
    return dataclasses.replace(state, warnings=[], failures=[], energy_errors={})
