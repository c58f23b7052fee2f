"""The machine of a run without one source of error, as far as its estimates say: an analysis that is
repeated with it tells how far its numbers may be off.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from headstock.pipeline.numbers.changes import (
    Change,
    Tried,
    estimate_changes,
    list_refused,
    try_changes,
)
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
from headstock.solvers.milling.forces import MillingCut

SOURCES = {
    FINER_MESH: DISCRETISATION,
    TRUE_FACES: CURVED_FACES,
    MORE_MODES: REDUCTION,
    FINER_WITH_MORE_MODES: f"{DISCRETISATION} and {REDUCTION}",
}
NOT_ASKED = "any error, as the scene says estimate = false"


REFUSED = (ModelError, UnstableControlError, ConvergenceError, AccuracyError)


@dataclass(frozen=True, eq=False)
class Repeated:
    """An analysis that was repeated.

    Attributes:
        tried: Numbers without each source of error, or why there are none.
        unknown: Components whose mesh shows nothing of its error.
        untried: What is not looked at.
    """

    tried: tuple[Tried, ...] = ()
    unknown: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()

    @property
    def sources(self) -> tuple[str, ...]:
        """Sources of error without which there are numbers."""
        owners = [change.owner for change in self.tried if isinstance(change.outcome, tuple)]
        return tuple(dict.fromkeys(source for _, source in owners))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Texts of what ± leaves out."""
        return (*self.untried, *list_refused(self.tried))

    def estimate(self, base: Sequence[Number]) -> dict[Key, Estimate]:
        """Return the ± of numbers whose analysis was repeated."""
        return estimate_changes(base, self.tried, unknown=bool(self.unknown), left_out=self.untried)


def repeat_with_refined(
    state: RunState,
    refinements: Sequence[Refinement],
    solve: Callable[[RunState, MillingCut | None], Iterable[Number]],
    cut: MillingCut | None,
    *,
    asked: bool,
) -> Repeated:
    """Repeat an analysis on the machine without each source of error, and at the farther end of each range
    of its cutting coefficients.

    Args:
        solve: The analysis of a machine with a cut.
        cut: The one whose coefficients have ranges; None where none is evaluated.
        asked: The scene asks for errors.
    """
    at_ends: list[Tried] = []
    if cut is not None and asked:

        def widen(base: MillingCut, key: str) -> MillingCut:
            return dataclasses.replace(base, coefficients=base.coefficients.farther_end(key))

        changes = [
            Change((key, CUTTING), functools.partial(widen, key=key))
            for key in cut.coefficients.ranges
        ]
        silent = silence(state)
        at_ends = try_changes(cut, changes, lambda other: solve(silent, other), refused=REFUSED)
    if state.scene.is_lumped:
        return Repeated(tuple(at_ends), untried=LUMPED.left_out)
    if not asked:
        return Repeated(untried=(NOT_ASKED,))
    tried = try_changes(
        state,
        list_refined_models(state, refinements),
        lambda machine: solve(machine, cut),
        refused=REFUSED,
    )
    left_out = name_what_is_left_out(state.parts).left_out
    return Repeated(
        (*tried, *at_ends),
        tuple(
            name
            for name, part in state.parts.superelements.items()
            if part.errors.missing_energy is not None and not part.errors.missing_energy.any()
        ),
        left_out,
    )


def list_refined_models(
    state: RunState, refinements: Sequence[Refinement]
) -> list[Change[RunState]]:
    """Return changes of a run to superelements without each source of error."""
    return [
        Change(
            (names[0] if refinement.apart else "", SOURCES[refinement]),
            functools.partial(_refine, refinement=refinement, names=names),
        )
        for refinement, names in list_refinements(state.parts.plan.components, refinements)
    ]


def _refine(state: RunState, *, refinement: Refinement, names: Iterable[str]) -> RunState | None:
    parts = {name: state.reduced[name] for name in names}
    better = {name: refinement.refine(part.superelement) for name, part in parts.items()}
    changed = {
        name: dataclasses.replace(part, superelement=better[name])
        for name, part in parts.items()
        if better[name] is not part.superelement
    }
    if not changed:
        return None
    return silence(dataclasses.replace(state, reduced={**state.reduced, **changed}))


def silence(state: RunState) -> RunState:
    """Return the run for a solution whose warnings are not reported."""
    return dataclasses.replace(state, warnings=[], failures=[], energy_errors={})
