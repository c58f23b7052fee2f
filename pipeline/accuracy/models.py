"""The choice among rigid, segmented and elastic bodies: the cheapest that keep every number within
a stated accuracy, compared with the machine of finite elements, whose own error is known.
"""

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from headstock.geometry.parts.components import Component, with_loaded_areas
from headstock.geometry.parts.prismatic_bars import prismatic_bar
from headstock.pipeline.accuracy.followed import (
    FOLLOWED,
    ComparedMachine,
    MachineFamily,
    follow_numbers,
    list_followed,
)
from headstock.pipeline.accuracy.quantities import Quantity, choose_greedily
from headstock.pipeline.accuracy.rounds import describe_settings
from headstock.pipeline.accuracy.settings import group_equals
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
    component_sensors,
)
from headstock.pipeline.storage.part_files import describe_solid
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.components.sensors import carry_masses
from headstock.solvers.errors import ModelError

SEGMENT_COUNTS = (4, 8, 16)
RIGID_SECONDS = 1e-3
WORTHWHILE = 0.9  # of the error with fewer segments
Choice = Mapping[str, int]  # body to the index of its model among the candidates


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Describe a model of a body.

    Attributes:
        make: Returns its superelement.
        seconds: Processor time that it costs in a run with an empty store [s].
    """

    component: Component
    make: Callable[[], ReducedComponent]
    seconds: float

    @cached_property
    def reduced(self) -> ReducedComponent:
        """Return its superelement, made when it is first needed.

        Raises:
            ModelError: A load or an interface that this model cannot have.
        """
        return self.make()

    @property
    def words(self) -> str:
        """Name it in the words of a scene."""
        return describe_settings(self.component)


@dataclass(frozen=True, eq=False)
class ModelChoice:
    """Store the bodies of a machine after the choice.

    Attributes:
        worst: The number with the largest relative error.
        errors: Key of each number to its relative error.
    """

    components: dict[str, Component]
    bodies: dict[str, BodyChoice]
    worst: str
    error: float
    errors: Mapping[Key, float]


@dataclass(eq=False)
class _Bodies:
    """Group equal bodies, which change together so that they share one superelement.

    Attributes:
        candidates: Models in order of cost, the cheapest first; the last is the one of the round.
        model: Index of the present one among the candidates.
        alone: Index of a model to the change of each number by these bodies alone.
    """

    names: tuple[str, ...]
    candidates: list[_Candidate]
    model: int = 0
    alone: dict[int, Mapping[Key, float]] = field(default_factory=dict)

    @property
    def finest(self) -> int:
        """Index of the finite elements or polynomials of the round."""
        return len(self.candidates) - 1

    def take(self, model: int) -> Choice:
        """Return the choice of a model for all of them."""
        return dict.fromkeys(self.names, model)

    def refine(self, worst: Key) -> None:
        """Take the next better model; where finer segments did not improve a number, more segments
        are skipped.
        """
        left = abs(self.alone[self.model][worst])
        before = abs(self.alone.get(self.model - 1, {}).get(worst, np.inf))
        idle = self.model > 1 and left > WORTHWHILE * before
        self.model = self.finest if idle else self.model + 1

    def describe(self, names: Mapping[Key, str]) -> BodyChoice:
        """Report the chosen model, the reason, and cost and benefit of the next better one."""

        def largest(model: int) -> tuple[str, float]:
            changes = self.alone[model]
            key = max(changes, key=lambda key: abs(changes[key]))
            return names[key], abs(changes[key])

        chosen, last = self.candidates[self.model], self.candidates[-1]
        if self.model == self.finest:
            tried = max(model for model in self.alone if model < self.model)
            number, size = largest(tried)
            change = (
                f"lacks {number}" if math.isinf(size) else f"changes {number} by {show_share(size)}"
            )
            return BodyChoice(chosen.words, f"as {self.candidates[tried].words} it {change}", "")
        number, size = largest(self.model)
        # all models are compared with finite elements
        return BodyChoice(
            chosen.words,
            f"leaves out {show_share(size)} of {number} at most",
            f"{last.words}: nothing left out, {last.seconds:.2g} CPU s in place of {chosen.seconds:.2g}",
        )


def choose_models(
    state: RunState, selectable: Sequence[str], quantities: Sequence[Quantity], accuracy: float
) -> ModelChoice:
    """Choose the cheapest models of bodies within an accuracy of every number; on rank 0.

    It starts with the cheapest model of every body. The body that alone changes the number with the
    largest error most gets the next better model, until the estimated errors are within the
    accuracy; then the machine is coupled and compared as a whole, and the search continues where it
    is not.

    Args:
        state: State of a round whose numbers are within the accuracy, with finite elements or
            polynomials for the selectable bodies.
        quantities: Its numbers with the errors that count.
        accuracy: Relative error allowed.
    """
    search = _ModelSearch(state, selectable, quantities, accuracy)
    search.drop_hopeless()

    def worst_number() -> tuple[float, Key]:
        worst = max(search.estimate_errors(), key=lambda key: search.errors[key])
        return search.errors[worst], worst

    worst = choose_greedily(
        worst_number,
        accuracy,
        options=lambda worst: search.simple,
        gain=lambda bodies, worst: abs(bodies.alone[bodies.model][worst]),
        take=_Bodies.refine,
    )
    names = {quantity.key: quantity.name for quantity in quantities}
    bodies = {name: group.describe(names) for group in search.groups for name in group.names}
    return ModelChoice(
        search.choose_components(), bodies, names[worst], search.errors[worst], search.errors
    )


def _add_change(error: float, two_sided: float, change: float) -> float:
    """Return the error of a number with other models of bodies.

    Modes left out, and uncorrected meshes, make a machine too stiff and never too soft (Rayleigh
    and Ritz), so the true machine is softer by no more than their error. A change that makes a
    number softer by less lies within this range and adds nothing; one that makes it stiffer is
    added in full.

    Args:
        error: Error of a number with finite elements or polynomials.
        two_sided: Part of it that may have either sign.
        change: Relative increase of compliance of the number by the models; negative where stiffer.
    """
    return error - change if change <= 0.0 else max(error, change + two_sided)


class _ModelSearch:
    """Search models of bodies, compared with the machine of finite elements.

    Attributes:
        errors: Key of each number to its error with the present models, as estimated last.
    """

    def __init__(
        self,
        state: RunState,
        selectable: Sequence[str],
        quantities: Sequence[Quantity],
        accuracy: float,
    ) -> None:
        self._state, self._quantities, self._accuracy = state, quantities, accuracy
        parts = {name: state.scene.machine.components[name] for name in selectable}
        loaded = {name for name, part in parts.items() if component_loads(state, part)}
        self.groups = [
            _Bodies(tuple(group), _list_candidates(state, group[0]))
            for group in group_equals(parts, apart=loaded)
        ]
        self.errors = {quantity.key: quantity.error for quantity in quantities}
        self._family = MachineFamily(state.parts)
        self._candidates = {name: group.candidates for group in self.groups for name in group.names}
        # of equal bodies one superelement serves all, each under its own name
        self._named: dict[tuple[str, int], ReducedComponent] = {}

    @property
    def simple(self) -> list[_Bodies]:
        """Groups that have a better model."""
        return [group for group in self.groups if group.model < group.finest]

    def drop_hopeless(self) -> None:
        """Take the finest model of bodies whose best simple model is not accurate enough."""
        for group in self.groups:
            best = group.finest - 1
            group.alone[best] = self._change(group.take(best))
            if max(self._total(group.alone[best]).values()) > self._accuracy:
                group.model = group.finest

    def estimate_errors(self) -> dict[Key, float]:
        """Estimate the error of each number from the changes by single bodies; and where that is
        within the accuracy, from the machine as a whole.
        """
        simple = self.simple
        for group in simple:
            if group.model not in group.alone:
                group.alone[group.model] = self._change(group.take(group.model))
        self.errors = self._total(
            {key: sum(group.alone[group.model][key] for group in simple) for key in self.errors}
        )
        if len(simple) > 1 and max(self.errors.values()) <= self._accuracy:
            self.errors = self._total(self._change(self._present))
        return self.errors

    def choose_components(self) -> dict[str, Component]:
        """Return all components with the chosen models."""
        components = dict(self._state.scene.machine.components)
        for name, model in self._present.items():
            chosen = self._candidates[name][model].component
            components[name] = dataclasses.replace(
                components[name], fidelity=chosen.fidelity, segments=chosen.segments
            )
        return components

    @property
    def _present(self) -> Choice:
        return {name: group.model for group in self.groups for name in group.names}

    def _total(self, changes: Mapping[Key, float]) -> dict[Key, float]:
        return {
            quantity.key: _add_change(quantity.error, quantity.two_sided, changes[quantity.key])
            for quantity in self._quantities
        }

    def _change(self, choice: Choice) -> Mapping[Key, float]:
        """Return how much softer some bodies make each number, relative to it; inf for a mode that
        loses its shape, and where the machine can no longer move.
        """
        try:
            machine = self._family.change(self._replace_bodies(choice))
            return self._compare(machine)
        except ModelError:
            return dict.fromkeys(self.errors, np.inf)

    def _compare(self, machine: ComparedMachine) -> dict[Key, float]:
        changes: dict[Key, float] = {}
        for answer in self._state.answers:
            if not isinstance(answer, FOLLOWED):
                continue
            base = list_followed(answer)
            moved = follow_numbers(answer, self._family.base, machine)
            move = compare_numbers(base, moved.numbers)
            for number in base:
                # a mode among them that finite elements do not have is as wrong as one that lacks
                if moved.missing or number.key in move.lost:
                    changes[number.key] = np.inf
                    continue
                share = move.difference[number.key] / number.value
                changes[number.key] = -share if number.key.kind == FREQUENCY else share
        return changes

    def _replace_bodies(self, choice: Choice) -> MachineParts:
        state = self._state
        components, reduced = dict(state.plan.components), dict(state.reduced)
        for name, model in choice.items():
            picked, part = self._candidates[name][model], components[name]
            components[name] = dataclasses.replace(
                picked.component, name=name, placement=part.placement
            )
            if (name, model) not in self._named:
                element = dataclasses.replace(picked.reduced.superelement, name=name)
                self._named[name, model] = ReducedComponent(element)
            reduced[name] = self._named[name, model]
        plan = dataclasses.replace(state.plan, components=components)
        return MachineParts(state.scene, plan, reduced)


def _list_candidates(state: RunState, name: str) -> list[_Candidate]:
    """List models of a body in order of cost; the last is the one of the round."""
    part = state.scene.machine.components[name]
    loads = component_loads(state, part)
    properties = describe_solid(with_loaded_areas(part, loads), state.store, state.warn)
    sensors = component_sensors(state, part)

    def make(simple: Component) -> ReducedComponent:
        reduce = reduce_rigid if simple.fidelity == "rigid" else reduce_segmented
        return ReducedComponent(carry_masses(reduce(simple, properties, loads, sensors), sensors))

    price = sum(
        stage.estimated_seconds or 0.0 for stage in state.plan.stages if stage.component == name
    )
    candidates = []
    for models in _simpler(part):
        found = [_Candidate(one, partial(make, one), seconds) for one, seconds in models]
        # what the best of a kind cannot have none of them can
        with contextlib.suppress(ModelError):
            _ = found[-1].reduced
            candidates += found
    return [*candidates, _Candidate(part, lambda: state.reduced[name], price)]


def _simpler(part: Component) -> Iterator[list[tuple[Component, float]]]:
    """Yield models of a body by kind, in order of cost, with the processor time of each [s]."""
    yield [(dataclasses.replace(part, fidelity="rigid"), RIGID_SECONDS)]
    try:
        prismatic_bar(part.solid, part.segments.along)
    except ValueError:
        return
    rows = [dataclasses.replace(part.segments, count=count) for count in SEGMENT_COUNTS]
    yield [
        (dataclasses.replace(part, fidelity="segmented", segments=row), STAGE_SECONDS["segment"])
        for row in rows
    ]
