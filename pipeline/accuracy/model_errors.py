"""The stage that says what rigid and segmented bodies leave out: coarse finite elements are put in
their place, kept in the store, and the small coupled machines are compared.
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
    MachineFamily,
    follow_numbers,
    list_damping_errors,
    list_followed,
)
from headstock.pipeline.accuracy.rounds import describe_settings, replace_components
from headstock.pipeline.accuracy.search_records import Judged
from headstock.pipeline.accuracy.settings import (
    COARSE_ACCURACY,
    MODE_MARGIN,
    are_equal,
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
class BetterBodies:
    """Coarse finite elements of bodies that are rigid or segmented in the machine.

    Attributes:
        parts: The machine with all of them in place; complete on rank 0.
        components: Body to its component with the settings of its mesh.
        failures: Body that cannot be meshed to the reason.
    """

    parts: MachineParts
    components: Mapping[str, Component]
    failures: Mapping[str, str]


def run_models_stage(state: RunState, stage: Stage) -> Outcome:
    """Compare every number with that of the machine whose rigid and segmented bodies are coarse
    finite elements; collective.

    Frequencies, compliances and responses get the change as a part of their ±, beside what meshes
    and reductions of the finite elements leave out.
    """
    names = [name for name, part in state.plan.components.items() if is_simple(part)]
    better = _make_better_bodies(state, names)
    return repeat_judgement(state, compare_models(state, better)) if state.is_root else Outcome()


def repeat_judgement(state: RunState, known: Judged) -> Outcome:
    """Put what a comparison of the same scene has found in place of the numbers of a run; on rank
    0.
    """
    numbers = iter(known.numbers)
    state.answers[:] = [
        next(numbers) if isinstance(answer, FOLLOWED) else answer for answer in state.answers
    ]
    return Outcome(detail=known.detail, answers=(known.changes,), warnings=known.warnings)


def compare_models(state: RunState, better: BetterBodies) -> Judged:
    """Return the numbers that a run found with the changes that better bodies make in their ±; on rank
    0.
    """
    family = MachineFamily(state.parts)
    together = family.change(better.parts)
    alone = {
        name: family.change(_replace_body(state.parts, better, name)) for name in better.components
    }
    several = len(state.plan.poses) > 1
    changes: dict[Key, float | None] = {}
    single: dict[str, dict[Key, float | None]] = {name: {} for name in alone}
    missing: list[str] = []
    answers: list[Answer] = []
    for answer in state.answers:
        if not isinstance(answer, FOLLOWED):
            continue
        base = list_followed(answer)
        moved = follow_numbers(answer, family.base, together, with_errors=True)
        if isinstance(answer, PoseModes) and moved.missing:
            missing.append(_name_missing(together, answer, moved.missing, several=several))
        move = compare_numbers(base, moved.numbers)
        moves = {
            name: compare_numbers(base, follow_numbers(answer, family.base, machine).numbers)
            for name, machine in alone.items()
        }
        for number in base:
            changes[number.key] = _relative(move, number)
            for name, own in moves.items():
                single[name][number.key] = _relative(own, number)
        errors = _replace_errors(base, move, moves)
        if isinstance(answer, PoseModes):
            damping = list_damping_errors(answer, errors, MODEL)
            answers.append(answer.with_errors(damping, "add").with_errors(errors, "replace"))
        elif isinstance(answer, PoseResponse):
            lines, largest = _compare_lines(together, answer)
            changes[make_key("response_line", pose=answer.curves.pose)] = largest
            answers.append(lines.with_errors(errors, "replace"))
        else:
            answers.append(answer.with_errors(errors, "replace"))
    found = ModelErrorsAnswer(
        {
            name: BodyModel(state.plan.components[name].fidelity, describe_settings(part))
            for name, part in better.components.items()
        },
        changes,
        single,
        tuple(missing),
        dict(better.failures),
    )
    known = [abs(change) for change in changes.values() if change is not None]
    warnings = [
        f"the machine of rigid and segmented bodies lacks {words}, which elastic ones show"
        for words in missing
    ]
    warnings += [
        f"what the model of {name} leaves out is not known: {why}"
        for name, why in better.failures.items()
    ]
    return Judged(
        tuple(answers),
        found,
        f"elastic bodies in place of {', '.join(better.components)} change numbers by up to "
        f"{show_share(max(known, default=0.0))}",
        tuple(warnings),
    )


def _replace_body(parts: MachineParts, better: BetterBodies, name: str) -> MachineParts:
    """Return the machine with one better body."""
    components = {**parts.plan.components, name: better.components[name]}
    return MachineParts(
        parts.scene,
        dataclasses.replace(parts.plan, components=components),
        {**parts.reduced, name: better.parts.reduced[name]},
    )


def _name_missing(
    machine: ComparedMachine, answer: PoseModes, missing: Sequence[int], *, several: bool
) -> str:
    """Return modes of the machine with better bodies that the other lacks, in plain words."""
    pose, count = answer.pose.name, answer.below + len(answer.frequencies_hz)
    modes = machine.watch(pose, count).modes
    names = machine.at(pose).name_modes(keep_lowest(modes, count=max(missing) + 1)).names
    listed = [f"{modes.frequencies_hz[index]:.4g} Hz ({names[index]})" for index in missing]
    place = f" in pose {pose}" if several else ""
    return f"{'a mode' if len(listed) == 1 else 'modes'} near {', '.join(listed)}{place}"


def _replace_errors(
    base: Sequence[Number], move: Moved, singles: Mapping[str, Moved]
) -> dict[Key, Estimate]:
    """Return the ± of numbers: what better bodies change, and the ± of the machine that has them.

    Args:
        move: What all better bodies change.
        singles: Body to what it alone changes.
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
    """Return a response with what better bodies change in the ± of its lines, and the largest such
    change over the largest entry of its line.
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
    # the depth of the real part would be that of another machine
    depths = {
        answer.figure_key(figures.channel): Estimate({MODEL: None}) for figures in answer.figures
    }
    found = dataclasses.replace(
        answer,
        curves=dataclasses.replace(curves, error_share={MODEL: change, **estimate.shares}),
        error_left_out=estimate.left_out,
    ).with_errors(depths, "replace")
    return found, float(np.nanmax(shares)) if np.isfinite(shares).any() else None


def _make_better_bodies(state: RunState, names: Iterable[str]) -> BetterBodies:
    """Superelements of coarse finite elements for some bodies of a run; collective. Equal bodies
    share one, and the store keeps them.

    Args:
        state: Of the run, after its analyses: they say up to where modes are kept.
        names: Of rigid and segmented components.
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
    for group in _group_equals(started):
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
            # the other bodies still tell something; only rank 0 reports the reason
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
    return BetterBodies(MachineParts(state.scene, plan, reduced), made, failures)


def _group_equals(parts: Mapping[str, Component]) -> list[list[str]]:
    groups: list[list[str]] = []
    for name, part in parts.items():
        same = [group for group in groups if are_equal(parts[group[0]], part)]
        if same:
            same[0].append(name)
        else:
            groups.append([name])
    return groups


def _modes_to(state: RunState) -> float | None:
    """Up to where modes of finite elements are kept [Hz]; None where no analysis is dynamic."""
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
