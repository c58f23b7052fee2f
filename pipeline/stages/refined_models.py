"""The machine of a run without one source of error, as far as its estimates say: an analysis that is
repeated with it tells how far its numbers may be off.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from headstock.pipeline.numbers.changes import Owner, estimate_changes
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    CUTTING,
    DISCRETISATION,
    REDUCTION,
    Estimate,
)
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.stages.estimates import name_what_is_left_out
from headstock.pipeline.stages.mechanism import LUMPED
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.estimates.corrected_elements import (
    FINER_MESH,
    FINER_WITH_MORE_MODES,
    MORE_MODES,
    TRUE_FACES,
    Refinement,
    list_refinements,
)
from headstock.solvers.errors import (
    AccuracyError,
    ConvergenceError,
    ModelError,
    UnstableControlError,
)
from headstock.solvers.milling.coefficients import CuttingCoefficients

SOURCES = {
    FINER_MESH: DISCRETISATION,
    TRUE_FACES: CURVED_FACES,
    MORE_MODES: REDUCTION,
    FINER_WITH_MORE_MODES: f"{DISCRETISATION} and {REDUCTION}",
}
NOT_ASKED = "any error, as the scene says estimate = false"


@dataclass(frozen=True, eq=False)
class Repeated[Found]:
    """An analysis that was repeated.

    Attributes:
        refined: What was found without each source of error.
        unknown: Components whose mesh shows nothing of its error.
        left_out: What is not looked at.
    """

    refined: dict[Owner, Found]
    unknown: tuple[str, ...]
    left_out: tuple[str, ...]

    def estimate(
        self: "Repeated[tuple[Number, ...]]", base: Sequence[Number]
    ) -> dict[Key, Estimate]:
        """Return the ± of numbers whose analysis was repeated."""
        return estimate_changes(
            base, self.refined, unknown=bool(self.unknown), left_out=self.left_out
        )


def repeat_with_refined[Found](
    state: RunState,
    refinements: Sequence[Refinement],
    solve: Callable[[RunState], Found],
    *,
    asked: bool,
) -> Repeated[Found]:
    """An analysis once more on the machine without each source of error.

    Args:
        asked: The scene asks for errors.
    """
    if state.scene.is_lumped:
        return Repeated({}, (), LUMPED.left_out)
    if not asked:
        return Repeated({}, (), (NOT_ASKED,))
    left_out = list(name_what_is_left_out(state.parts).left_out)
    refined: dict[Owner, Found] = {}
    for owner, machine in list_refined_models(state, refinements).items():
        try:
            refined[owner] = solve(machine)
        except (ModelError, UnstableControlError, ConvergenceError, AccuracyError) as error:
            left_out.append(f"{' of '.join(filter(None, owner[::-1]))}: {error}")
    return Repeated(refined, _find_silent_meshes(state), tuple(left_out))


def repeat_at_ends[Found](
    coefficients: CuttingCoefficients,
    solve: Callable[[CuttingCoefficients], Found],
    found: Repeated[Found],
) -> Repeated[Found]:
    """What was repeated, with an analysis once more at the farther end of each range of the cutting
    coefficients.

    Args:
        solve: The analysis with other coefficients.
        found: What was repeated before.
    """
    refined, left_out = dict(found.refined), list(found.left_out)
    for key in coefficients.ranges:
        try:
            refined[key, CUTTING] = solve(coefficients.farther_end(key))
        except (ModelError, UnstableControlError, ConvergenceError, AccuracyError) as error:
            left_out.append(f"{key} of the {CUTTING}: {error}")
    return Repeated(refined, found.unknown, tuple(left_out))


def list_refined_models(
    state: RunState, refinements: Sequence[Refinement]
) -> dict[Owner, RunState]:
    """The run with superelements without each source of error; no entry of one that changes nothing."""
    models = {}
    for refinement, names in list_refinements(state.parts.plan.components, refinements):
        refined = {}
        for name in names:
            part = state.reduced[name]
            changed = refinement.refine(part.superelement)
            if changed is not part.superelement:
                refined[name] = dataclasses.replace(part, superelement=changed)
        if refined:
            replaced = dataclasses.replace(state, reduced={**state.reduced, **refined})
            models[names[0] if refinement.apart else "", SOURCES[refinement]] = silence(replaced)
    return models


def _find_silent_meshes(state: RunState) -> tuple[str, ...]:
    """Components whose mesh shows nothing of its error."""
    return tuple(
        name
        for name, part in state.parts.superelements.items()
        if part.errors.missing_energy is not None and not part.errors.missing_energy.any()
    )


def silence(state: RunState) -> RunState:
    """The run for a solution beside its own, whose warnings are not told."""
    return dataclasses.replace(state, warnings=[], failures=[], energy_errors={})
