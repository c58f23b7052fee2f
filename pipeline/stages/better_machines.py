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
    BOTH_AT_ONCE,
    FINER_MESH,
    MORE_MODES,
    TRUE_FACES,
    Improvement,
    list_repeats,
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
    BOTH_AT_ONCE: f"{DISCRETISATION} and {REDUCTION}",
}
NOT_ASKED = "any error, as the scene says estimate = false"


@dataclass(frozen=True, eq=False)
class Repeated[Found]:
    """An analysis that was repeated.

    Attributes:
        better: What was found without each source of error.
        unknown: Components whose mesh shows nothing of its error.
        left_out: What is not looked at.
    """

    better: dict[Owner, Found]
    unknown: tuple[str, ...]
    left_out: tuple[str, ...]

    def estimate(
        self: "Repeated[tuple[Number, ...]]", base: Sequence[Number]
    ) -> dict[Key, Estimate]:
        """Return the ± of numbers whose analysis was repeated."""
        return estimate_changes(
            base, self.better, unknown=bool(self.unknown), left_out=self.left_out
        )


def repeat_without[Found](
    state: RunState,
    improvements: Sequence[Improvement],
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
    better: dict[Owner, Found] = {}
    for owner, machine in list_better_machines(state, improvements).items():
        try:
            better[owner] = solve(machine)
        except (ModelError, UnstableControlError, ConvergenceError, AccuracyError) as error:
            left_out.append(f"{' of '.join(filter(None, owner[::-1]))}: {error}")
    return Repeated(better, _find_silent_meshes(state), tuple(left_out))


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
    better, left_out = dict(found.better), list(found.left_out)
    for key in coefficients.ranges:
        try:
            better[key, CUTTING] = solve(coefficients.farther_end(key))
        except (ModelError, UnstableControlError, ConvergenceError, AccuracyError) as error:
            left_out.append(f"{key} of the {CUTTING}: {error}")
    return Repeated(better, found.unknown, tuple(left_out))


def list_better_machines(
    state: RunState, improvements: Sequence[Improvement]
) -> dict[Owner, RunState]:
    """The run with superelements without each source of error; no entry of one that changes nothing."""
    found = {}
    for own, names in list_repeats(state.parts.plan.components, improvements):
        better = {}
        for name in names:
            part = state.reduced[name]
            improved = own.improve(part.superelement)
            if improved is not part.superelement:
                better[name] = dataclasses.replace(part, superelement=improved)
        if better:
            replaced = dataclasses.replace(state, reduced={**state.reduced, **better})
            found[names[0] if own.apart else "", SOURCES[own]] = silence(replaced)
    return found


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
