"""The choice among rigid, segmented and elastic bodies: the cheapest that keep every number within
what is asked, held beside the machine of finite elements whose own error is known.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.parts.components import Component, with_loaded_areas
from headstock.geometry.parts.prismatic_bars import prismatic_bar
from headstock.pipeline.accuracy.followed import (
    FOLLOWED,
    MachineFamily,
    follow_numbers,
    list_followed,
)
from headstock.pipeline.accuracy.quantities import Quantity
from headstock.pipeline.accuracy.rounds import describe_settings
from headstock.pipeline.accuracy.settings import are_equal
from headstock.pipeline.answers.accuracy import BodyChoice
from headstock.pipeline.answers.modal import FREQUENCY
from headstock.pipeline.numbers.changes import compare_numbers
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.planning.budgets import STAGE_SECONDS
from headstock.pipeline.stages.run_state import (
    MachineParts,
    ReducedComponent,
    RunState,
    component_loads,
)
from headstock.pipeline.storage.part_files import describe_solid
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.solvers.errors import ModelError

SEGMENT_COUNTS = (4, 8, 16)
RIGID_SECONDS = 1e-3
WORTHWHILE = 0.9  # of what a coarser cut leaves out
Choice = Mapping[str, int]  # body to the place of its model among the candidates


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model of a body: its component, its superelement, and the processor time that a run pays for
    it from an empty store [s].
    """

    component: Component
    reduced: ReducedComponent
    seconds: float

    @property
    def words(self) -> str:
        """What it is, in the words of a scene."""
        return describe_settings(self.component)


@dataclass(frozen=True, eq=False)
class ModelChoice:
    """The bodies of a machine after the choice.

    Attributes:
        bodies: What is said of each body.
        worst: The number that is furthest off.
        errors: Key of each number to by how much of it that may be off.
    """

    components: dict[str, Component]
    bodies: dict[str, BodyChoice]
    worst: str
    error: float
    errors: Mapping[Key, float]


def choose_models(
    state: RunState, ours: Sequence[str], quantities: Sequence[Quantity], accuracy: float
) -> ModelChoice:
    """The cheapest models of bodies with which every number stays within an accuracy. On rank 0.

    It starts with the cheapest model of every body and takes the next better one of the body that
    alone changes most of the number furthest off; the machine that seems good enough is coupled and
    compared as a whole, and the search goes on from there where it is not.


    Args:
        state: Of a round whose numbers are within the accuracy, with finite elements or polynomials
            for the bodies that are ours to choose.
        quantities: Its numbers with the errors that count.
        accuracy: Relative error allowed.
    """
    # equal bodies change together, so that one superelement serves them
    groups = {group[0]: group for group in _group_equals(state, ours)}
    bodies = {
        other: candidates
        for name, group in groups.items()
        for candidates in [_list_candidates(state, name)]
        for other in group
    }
    finest = {name: len(bodies[name]) - 1 for name in groups}
    trials = _Trials(state, bodies)
    errors = {quantity.key: quantity.error for quantity in quantities}
    doubts = {quantity.key: quantity.doubt for quantity in quantities}
    alone: dict[tuple[str, int], Mapping[Key, float]] = {}

    def changes(choice: Choice) -> Mapping[Key, float]:
        try:
            return trials.changes(choice)
        except ModelError:
            # nothing is left that could move
            return dict.fromkeys(errors, np.inf)

    def total(key: Key, change: float) -> float:
        return add_change(errors[key], doubts[key], change)

    choice = dict.fromkeys(groups, 0)
    for name in groups:
        # where the best of the simple models does not do, none does
        best = finest[name] - 1
        alone[name, best] = changes(dict.fromkeys(groups[name], best))
        if max(total(key, alone[name, best][key]) for key in errors) > accuracy:
            choice[name] = finest[name]
    while True:
        simple = [name for name, place in choice.items() if place < finest[name]]
        for name in simple:
            if (name, choice[name]) not in alone:
                alone[name, choice[name]] = changes(dict.fromkeys(groups[name], choice[name]))
        sums = {
            key: total(key, sum(alone[name, choice[name]][key] for name in simple))
            for key in errors
        }
        whole = {other: choice[name] for name, group in groups.items() for other in group}
        if len(simple) > 1 and max(sums.values()) <= accuracy:
            together = changes(whole)
            sums = {key: total(key, together[key]) for key in errors}
        worst = max(sums, key=lambda key: sums[key])
        if sums[worst] <= accuracy or not simple:
            break
        name = max(simple, key=lambda body: abs(alone[body, choice[body]][worst]))
        before = abs(alone.get((name, choice[name] - 1), {}).get(worst, np.inf))
        idle = choice[name] > 1 and abs(alone[name, choice[name]][worst]) > WORTHWHILE * before
        # where a finer cut into segments brought nothing, the next will not either
        choice[name] = finest[name] if idle else choice[name] + 1
    names = {quantity.key: quantity.name for quantity in quantities}
    told = {
        other: _tell(bodies[name], choice[name], name, alone, names)
        for name, group in groups.items()
        for other in group
    }
    components = dict(state.scene.machine.components)
    for name, place in whole.items():
        model = bodies[name][place].component
        components[name] = dataclasses.replace(
            components[name], fidelity=model.fidelity, segments=model.segments
        )
    return ModelChoice(components, told, names[worst], sums[worst], sums)


def add_change(error: float, two_sided: float, change: float) -> float:
    """The error of a number with other models of bodies.

    Modes left out, and meshes that nothing corrects, make a machine too stiff and never too soft
    (Rayleigh and Ritz), so the truth is softer by no more than their error. What makes the number softer by less lies between
    both and adds nothing; what makes it stiffer adds all.

    Args:
        error: Of the number with finite elements or polynomials.
        two_sided: What of it may have either sign.
        change: How much softer the models make the number, over it; below zero stiffer.
    """
    return error - change if change <= 0.0 else max(error, change + two_sided)


def _group_equals(state: RunState, ours: Sequence[str]) -> list[list[str]]:
    """Bodies that are ours to choose, equal ones together where no load tells them apart."""
    groups: list[list[str]] = []
    for name in ours:
        part = state.scene.machine.components[name]
        same = [
            group
            for group in groups
            if are_equal(state.scene.machine.components[group[0]], part)
            and not component_loads(state, part)
            and not component_loads(state, state.scene.machine.components[group[0]])
        ]
        if same:
            same[0].append(name)
        else:
            groups.append([name])
    return groups


def _list_candidates(state: RunState, name: str) -> list[Candidate]:
    """Models of a body from the cheapest on; the last is the one of the round."""
    part = state.scene.machine.components[name]
    loads = component_loads(state, part)
    properties = describe_solid(with_loaded_areas(part, loads), state.store, state.warn)
    found = []
    for simple, seconds in _simpler(part):
        reduce = reduce_rigid if simple.fidelity == "rigid" else reduce_segmented
        try:
            found.append(
                Candidate(simple, ReducedComponent(reduce(simple, properties, loads)), seconds)
            )
        except ModelError:
            # a load or an interface that this model cannot have
            continue
    price = sum(
        stage.estimated_seconds or 0.0 for stage in state.plan.stages if stage.component == name
    )
    return [*found, Candidate(part, state.reduced[name], price)]


def _simpler(part: Component) -> Iterator[tuple[Component, float]]:
    yield dataclasses.replace(part, fidelity="rigid"), RIGID_SECONDS
    try:
        prismatic_bar(part.solid, part.segments.along)
    except ValueError:
        return
    for count in SEGMENT_COUNTS:
        segments = dataclasses.replace(part.segments, count=count)
        cut = dataclasses.replace(part, fidelity="segmented", segments=segments)
        yield cut, STAGE_SECONDS["segment"]


def _tell(
    candidates: Sequence[Candidate],
    place: int,
    name: str,
    alone: Mapping[tuple[str, int], Mapping[Key, float]],
    names: Mapping[Key, str],
) -> BodyChoice:
    """What is chosen, why, and what the next better model would cost and bring."""
    own = candidates[place]

    def most(at: int) -> tuple[str, float]:
        changes = alone[name, at]
        key = max(changes, key=lambda each: abs(changes[each]))
        return names[key], abs(changes[key])

    last = candidates[-1]
    if place == len(candidates) - 1:
        tried = max(at for at in range(place) if (name, at) in alone)
        number, size = most(tried)
        change = (
            f"lacks {number}" if math.isinf(size) else f"changes {number} by {show_share(size)}"
        )
        return BodyChoice(own.words, f"as {candidates[tried].words} it {change}", "")
    number, size = most(place)
    # finite elements are what all models are compared with
    return BodyChoice(
        own.words,
        f"leaves out {show_share(size)} of {number} at most",
        f"{last.words}: nothing left out, {last.seconds:.2g} CPU s in place of {own.seconds:.2g}",
    )


class _Trials:
    """The machine of finite elements, and what other models of bodies change of its numbers."""

    def __init__(self, state: RunState, bodies: Mapping[str, Sequence[Candidate]]) -> None:
        self._state, self._bodies = state, bodies
        self._family = MachineFamily(state.parts)
        # of equal bodies one superelement serves all, each under its own name
        self._named: dict[tuple[str, int], ReducedComponent] = {}

    def changes(self, choice: Choice) -> dict[Key, float]:
        """Return how much softer some bodies make each number, over it; inf for a mode that no longer has
        its shape.
        """
        machine = self._family.change(self._replace_bodies(choice))
        found: dict[Key, float] = {}
        for answer in self._state.answers:
            if not isinstance(answer, FOLLOWED):
                continue
            base = list_followed(answer)
            moved = follow_numbers(answer, self._family.base, machine)
            move = compare_numbers(base, moved.numbers)
            for number in base:
                # a mode among them that finite elements do not have is as wrong as one that lacks
                if moved.missing or number.key in move.lost:
                    found[number.key] = np.inf
                    continue
                share = move.difference[number.key] / number.value
                found[number.key] = -share if number.key.kind == FREQUENCY else share
        return found

    def _replace_bodies(self, choice: Choice) -> MachineParts:
        state = self._state
        components, reduced = dict(state.plan.components), dict(state.reduced)
        for name, place in choice.items():
            picked, part = self._bodies[name][place], components[name]
            components[name] = dataclasses.replace(
                picked.component, name=name, placement=part.placement
            )
            if (name, place) not in self._named:
                element = dataclasses.replace(picked.reduced.superelement, name=name)
                self._named[name, place] = ReducedComponent(element)
            reduced[name] = self._named[name, place]
        plan = dataclasses.replace(state.plan, components=components)
        return MachineParts(state.scene, plan, reduced)
