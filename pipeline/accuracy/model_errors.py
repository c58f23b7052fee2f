"""The stage that estimates the error of rigid and segmented bodies: coarse finite elements, kept in
the store, replace them, and the small coupled machines are compared.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.components import Component
from headstock.pipeline.accuracy.followed import (
    FOLLOWED,
    ComparedMachine,
    Followed,
    MachineFamily,
    follow_numbers,
    list_followed,
    put_errors,
)
from headstock.pipeline.accuracy.rounds import describe_settings, replace_components
from headstock.pipeline.accuracy.search_records import ModelComparison
from headstock.pipeline.accuracy.settings import (
    COARSE_ACCURACY,
    MODE_MARGIN,
    group_equals,
    start_component,
)
from headstock.pipeline.answers.accuracy import BodyModel, ModelErrorsAnswer
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.numbers.changes import Moved, compare_numbers, to_errors
from headstock.pipeline.numbers.estimates import MODEL, Estimate, show_share
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import is_simple, plan_scene
from headstock.pipeline.stages.frf import estimate_response_errors, prepare_response
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    ReducedComponent,
    RunState,
)
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.reduction.estimates.model_errors import split_change
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.ranks import SharedFailure

# up to where modes of the finite elements are kept: steps by this factor, so that a frequency that
# moves a little finds them in the store
MODE_STEP = 2.0


@dataclass(frozen=True, eq=False)
class RefinedBodies:
    """Store coarse finite elements of bodies that are rigid or segmented in the machine.

    Attributes:
        parts: The machine with all of them; complete on rank 0.
        components: Body to its component with the settings of its mesh.
        failures: Body that cannot be meshed, to the reason.
    """

    parts: MachineParts
    components: Mapping[str, Component]
    failures: Mapping[str, str]


def run_models_stage(state: RunState, stage: Stage) -> Outcome:
    """Compare every number with that of the machine whose rigid and segmented bodies are coarse
    finite elements; collective.

    The change becomes a part of the ± of frequencies, compliances and responses, in addition to
    that by meshes and reductions of the finite elements.
    """
    names = [name for name, part in state.plan.components.items() if is_simple(part)]
    refined = _make_refined_bodies(state, names)
    return repeat_comparison(state, compare_models(state, refined)) if state.is_root else Outcome()


def repeat_comparison(state: RunState, known: ModelComparison) -> Outcome:
    """Replace the numbers of a run by those of a stored comparison of the same scene; on rank 0."""
    numbers = iter(known.numbers)
    state.answers[:] = [
        next(numbers) if isinstance(answer, FOLLOWED) else answer for answer in state.answers
    ]
    return Outcome(detail=known.detail, answers=(known.changes,), warnings=known.warnings)


def compare_models(state: RunState, refined: RefinedBodies) -> ModelComparison:
    """Return the numbers of a run with the changes by refined bodies in their ±; on rank 0."""
    comparison = _Comparison(state, refined)
    answers = [
        comparison.revise(answer) for answer in state.answers if isinstance(answer, FOLLOWED)
    ]
    bodies = {
        name: BodyModel(state.plan.components[name].fidelity, describe_settings(part))
        for name, part in refined.components.items()
    }
    missing, failures = comparison.missing, dict(refined.failures)
    sizes = [abs(change) for change in comparison.changes.values() if change is not None]
    return ModelComparison(
        tuple(answers),
        ModelErrorsAnswer(bodies, comparison.changes, comparison.single, tuple(missing), failures),
        f"elastic bodies in place of {', '.join(refined.components)} change numbers by up to "
        f"{show_share(max(sizes, default=0.0))}",
        (
            *(
                f"the machine of rigid and segmented bodies lacks {words}, which elastic ones show"
                for words in missing
            ),
            *(
                f"what the model of {name} leaves out is not known: {why}"
                for name, why in failures.items()
            ),
        ),
    )


class _Comparison:
    """Compare the machine of a run with those with refined bodies, all of them and each alone.

    Attributes:
        changes: Key of each number to its change by all of them; None where it has no partner.
        single: Body to the changes by it alone.
        missing: Modes that the machine of the run lacks, in plain words.
    """

    def __init__(self, state: RunState, refined: RefinedBodies) -> None:
        self._several = len(state.plan.poses) > 1
        self._family = MachineFamily(state.parts)
        self._together = self._family.change(refined.parts)
        self._alone = {
            name: self._family.change(_replace_body(state.parts, refined, name))
            for name in refined.components
        }
        self.changes: dict[Key, float | None] = {}
        self.single: dict[str, dict[Key, float | None]] = {name: {} for name in self._alone}
        self.missing: list[str] = []

    def revise(self, answer: Followed) -> Answer:
        """Return an answer with the changes by refined bodies in its ±."""
        base, family = list_followed(answer), self._family
        moved = follow_numbers(answer, family.base, self._together, with_errors=True)
        if isinstance(answer, PoseModes) and moved.missing:
            words = _name_missing(self._together, answer, moved.missing, several=self._several)
            self.missing.append(words)
        move = compare_numbers(base, moved.numbers)
        moves = {
            name: compare_numbers(base, follow_numbers(answer, family.base, machine).numbers)
            for name, machine in self._alone.items()
        }
        for number in base:
            self.changes[number.key] = _relative(move, number)
            for name, single in moves.items():
                self.single[name][number.key] = _relative(single, number)
        errors = _replace_errors(base, move, moves)
        if isinstance(answer, PoseResponse):
            answer, largest = _compare_lines(self._together, answer)
            self.changes[make_key("response_line", pose=answer.curves.pose)] = largest
        return put_errors(answer, errors, MODEL, "replace")


def _replace_body(parts: MachineParts, refined: RefinedBodies, name: str) -> MachineParts:
    """Return the machine with one refined body."""
    components = {**parts.plan.components, name: refined.components[name]}
    return MachineParts(
        parts.scene,
        dataclasses.replace(parts.plan, components=components),
        {**parts.reduced, name: refined.parts.reduced[name]},
    )


def _name_missing(
    machine: ComparedMachine, answer: PoseModes, missing: Sequence[int], *, several: bool
) -> str:
    """Name the modes of the machine with refined bodies that the other lacks, in plain words."""
    pose, count = answer.pose.name, answer.below + len(answer.frequencies_hz)
    modes = machine.watch(pose, count).modes
    names = machine.at(pose).name_modes(keep_lowest(modes, count=max(missing) + 1)).names
    listed = [f"{modes.frequencies_hz[index]:.4g} Hz ({names[index]})" for index in missing]
    place = f" in pose {pose}" if several else ""
    return f"{'a mode' if len(listed) == 1 else 'modes'} near {', '.join(listed)}{place}"


def _replace_errors(
    base: Sequence[Number], move: Moved, singles: Mapping[str, Moved]
) -> dict[Key, Estimate]:
    """Return the ± of numbers: the changes by refined bodies, and the ± of the machine that has
    them.

    Args:
        move: Changes by all refined bodies.
        singles: Body to the changes by it alone.
    """

    def split(key: Key, size: float) -> dict[str, float]:
        alone = {name: single.difference.get(key, np.nan) for name, single in singles.items()}
        return split_change(size, alone)

    return to_errors(base, {("", MODEL): move}, join="replace", split=split)


def _relative(move: Moved, number: Number) -> float | None:
    """Return a number's change over the number; None where it has no partner."""
    return None if number.key in move.lost else move.difference[number.key] / number.value


def _compare_lines(
    machine: ComparedMachine, answer: PoseResponse
) -> tuple[PoseResponse, float | None]:
    """Return a response with the changes by refined bodies in the ± of its lines, and the largest
    such change over the largest entry of its line.
    """
    curves, model = answer.curves, machine.at(answer.curves.pose)
    prepared = prepare_response(model)
    response = evaluate_frf(prepared, curves.frequencies_hz)
    estimate = estimate_response_errors(
        model.parts, prepared.direct.system, model.coupled, model.all_modes, response
    )
    change = np.abs(response.receptance - curves.receptance)
    largest = np.abs(curves.receptance).max(axis=(1, 2))
    shares = change.max(axis=(1, 2)) / np.where(largest > 0.0, largest, np.inf)
    # the most negative real part would be that of another machine
    depths = {
        answer.figure_key(figures.channel): Estimate({MODEL: None}) for figures in answer.figures
    }
    found = dataclasses.replace(
        answer,
        curves=dataclasses.replace(curves, error_share={MODEL: change, **estimate.shares}),
        error_left_out=estimate.left_out,
    ).with_errors(depths, "replace")
    return found, float(np.nanmax(shares)) if np.isfinite(shares).any() else None


def _make_refined_bodies(state: RunState, names: Iterable[str]) -> RefinedBodies:
    """Reduce coarse finite elements of some bodies of a run; collective. Equal bodies share one
    superelement, and the store keeps it.

    Args:
        state: State of the run, after its analyses, which define the frequency range of modes.
        names: Names of rigid and segmented components.
    """
    modes_to = _modes_to(state)
    started = {
        name: start_component(
            dataclasses.replace(state.scene.machine.components[name], fidelity="elastic"),
            COARSE_ACCURACY,
            modes_to,
        )
        for name in names
    }
    failures: dict[str, str] = {}
    reduced: dict[str, ReducedComponent] = dict(state.reduced)
    components: dict[str, Component] = dict(state.plan.components)
    for group in group_equals(started):
        scene = replace_components(
            state.scene,
            {**state.scene.machine.components, **{name: started[name] for name in group}},
        )
        try:
            plan = plan_scene(dataclasses.replace(scene, model_errors=False))
            other = dataclasses.replace(
                state, scene=scene, plan=plan, meshes={}, reduced=dict(state.reduced)
            )
            make_superelements(other, only=group)
        except (HeadstockError, SharedFailure) as error:
            # the other bodies are still compared; only rank 0 reports the reason
            failures |= dict.fromkeys(group, str(error))
            continue
        for name in group:
            components[name] = plan.components[name]
            if state.is_root:
                reduced[name] = other.reduced[name]
    made = {
        name: part for name, part in components.items() if name in started and name not in failures
    }
    plan = dataclasses.replace(state.plan, components=components)
    return RefinedBodies(MachineParts(state.scene, plan, reduced), made, failures)


def _modes_to(state: RunState) -> float | None:
    """Return the frequency up to which modes of finite elements are kept [Hz]; None where no
    analysis is dynamic.
    """
    highest = [
        float(answer.frequencies_hz[-1])
        for answer in state.answers
        if isinstance(answer, PoseModes) and len(answer.frequencies_hz)
    ]
    highest += [
        float(answer.curves.frequencies_hz[-1])
        for answer in state.answers
        if isinstance(answer, PoseResponse)
    ]
    if not highest:
        return None
    return float(MODE_STEP ** math.ceil(math.log(MODE_MARGIN * max(highest), MODE_STEP)))
