"""The stage that says what rigid and segmented bodies leave out: coarse finite elements are put in
their place, kept in the store, and the small coupled machines are compared.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component
from headstock.pipeline.accuracy.remembered import NUMBERS, Judged
from headstock.pipeline.accuracy.response_changes import follow_numbers
from headstock.pipeline.accuracy.rounds import describe_settings, replace_components
from headstock.pipeline.accuracy.settings import (
    COARSE_ACCURACY,
    MODE_MARGIN,
    are_equal,
    start_component,
)
from headstock.pipeline.answers.accuracy import BodyModel, ModelErrorsAnswer, NumberChange
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.estimates import MODEL, Estimate, show_share
from headstock.pipeline.answers.frf import PoseResponse, ResponseNumber
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.planning.planner import is_simple, plan_scene
from headstock.pipeline.stages.frf import (
    estimate_response_errors,
    judge_numbers,
    prepare_response,
)
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import (
    MachineParts,
    Outcome,
    ReducedComponent,
    RunState,
)
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.reduction.estimates.model_errors import (
    WatchedModes,
    compare_modes,
    split_change,
    watch_modes,
)
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
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
    better = make_better_bodies(state, names)
    return repeat_judgement(state, compare_models(state, better)) if state.is_root else Outcome()


def repeat_judgement(state: RunState, known: Judged) -> Outcome:
    """Put what a comparison of the same scene has found in place of the numbers of a run; on rank
    0.
    """
    numbers = iter(known.numbers)
    state.answers[:] = [
        next(numbers) if isinstance(answer, NUMBERS) else answer for answer in state.answers
    ]
    return Outcome(detail=known.detail, answers=(known.changes,), warnings=known.warnings)


def compare_models(state: RunState, better: BetterBodies) -> Judged:
    """The numbers that a run found with the changes that better bodies make in their ±; on rank
    0.
    """
    machines = _Machines(state.parts, better)
    changes: dict[str, NumberChange] = {}
    missing: list[str] = []
    several = len(state.plan.poses) > 1
    numbers: list[Answer] = []
    for answer in state.answers:
        if isinstance(answer, PoseModes):
            numbers.append(_judge_modes(machines, answer, changes, missing, several=several))
        elif isinstance(answer, StaticAnswer):
            numbers.append(_judge_compliances(machines, answer, changes, several=several))
        elif isinstance(answer, PoseResponse):
            numbers.append(_judge_response(machines, answer, changes, several=several))
    found = ModelErrorsAnswer(
        {
            name: BodyModel(state.plan.components[name].fidelity, describe_settings(part))
            for name, part in better.components.items()
        },
        changes,
        tuple(missing),
        dict(better.failures),
    )
    known = [abs(change.together) for change in changes.values() if change.together is not None]
    warnings = [
        f"the machine of rigid and segmented bodies lacks {words}, which elastic ones show"
        for words in missing
    ]
    warnings += [
        f"what the model of {name} leaves out is not known: {why}"
        for name, why in better.failures.items()
    ]
    return Judged(
        tuple(numbers),
        found,
        f"elastic bodies in place of {', '.join(better.components)} change numbers by up to "
        f"{show_share(max(known, default=0.0))}",
        tuple(warnings),
    )


def make_better_bodies(state: RunState, names: Iterable[str]) -> BetterBodies:
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


@dataclass(frozen=True, eq=False)
class _PosedMachines:
    """The machine in a pose, with all better bodies, and with each of them alone."""

    plain: CoupledPose
    better: CoupledPose
    singles: Mapping[str, CoupledPose]


@dataclass(eq=False)
class _Machines:
    """The machine and those with better bodies in every pose, coupled once each."""

    parts: MachineParts
    bodies: BetterBodies
    posed: dict[str, _PosedMachines] = field(default_factory=dict)

    def at(self, pose: Pose) -> _PosedMachines:
        """In a pose."""
        if pose.name not in self.posed:
            self.posed[pose.name] = _PosedMachines(
                couple_pose(self.parts, pose),
                couple_pose(self.bodies.parts, pose),
                {name: couple_pose(self._with(name), pose) for name in self.bodies.components},
            )
        return self.posed[pose.name]

    def _with(self, name: str) -> MachineParts:
        """The machine with one better body."""
        components = {**self.parts.plan.components, name: self.bodies.components[name]}
        return MachineParts(
            self.parts.scene,
            dataclasses.replace(self.parts.plan, components=components),
            {**self.parts.reduced, name: self.bodies.parts.reduced[name]},
        )

    @cached_property
    def places(self) -> dict[str, BodyPlaces]:
        """Points that stand for the mass of each body."""
        return {name: choose_places(part) for name, part in self.parts.superelements.items()}

    @cached_property
    def _motions(self) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """How those points move with the dofs of each body, as it is and as finite elements."""
        own, better = (
            {
                name: place_motion(elements[name], chosen.points)
                for name, chosen in self.places.items()
                if name in wanted
            }
            for elements, wanted in (
                (self.parts.superelements, self.parts.superelements),
                (self.bodies.parts.superelements, self.bodies.components),
            )
        )
        return own, better

    def watch(self, model: CoupledPose, names: Iterable[str], count: int) -> WatchedModes:
        """Modes of a model in which some bodies are finite elements."""
        own, better = self._motions
        motions = {**own, **{name: better[name] for name in names}}
        return watch_modes(model.coupled, self.places, motions, count=count)


def _judge_modes(
    machines: _Machines,
    answer: PoseModes,
    changes: dict[str, NumberChange],
    missing: list[str],
    *,
    several: bool,
) -> PoseModes:
    """Modes with what the models of bodies leave out in their ±; adds to the changes and to the
    words about modes that are missing.
    """
    count, posed = answer.below + len(answer.frequencies_hz), machines.at(answer.pose)
    place = f" in pose {answer.pose.name}" if several else ""
    plain = machines.watch(posed.plain, (), count)
    better = machines.watch(posed.better, machines.bodies.components, count)
    together = compare_modes(plain, better, count=count)
    # a body that alone is replaced may leave a mode without a partner
    alone = {
        name: compare_modes(plain, machines.watch(model, [name], count), count=count).changes_hz
        for name, model in posed.singles.items()
    }
    last = max((*together.partners, *together.missing), default=-1) + 1
    kept = keep_lowest(better.modes, count=max(1, last))
    known = posed.better.estimate_mode_errors(kept)
    errors = list(answer.errors)
    damped, ratios = list(answer.damped_error_hz), list(answer.damping_error)
    for mode in range(answer.rigid_count, len(answer.frequencies_hz)):
        number = answer.below + mode
        hz, change = float(answer.frequencies_hz[mode]), float(together.changes_hz[number])
        singles = {name: float(found[number]) for name, found in alone.items()}
        changes[f"frequency {number + 1}{place}"] = _relative(change, singles, hz)
        if np.isnan(change):
            errors[mode] = Estimate({MODEL: None}, known[0].left_out)
        else:
            errors[mode] = _add_model(known[together.partners[number]], change, singles)
        if mode < len(damped):
            own = damped[mode]
            damped[mode] = None if own is None or np.isnan(change) else own + abs(change)
        if mode < len(ratios) and ratios[mode]:
            # a first-order estimate says nothing of a damping ratio with other bodies
            ratios[mode] = None
    if together.missing:
        names = posed.better.name_modes(kept).names
        each = [
            f"{better.modes.frequencies_hz[index]:.4g} Hz ({names[index]})"
            for index in together.missing
        ]
        missing.append(f"{'a mode' if len(each) == 1 else 'modes'} near {', '.join(each)}{place}")
    return dataclasses.replace(
        answer,
        errors=tuple(errors),
        damped_error_hz=tuple(damped),
        damping_error=tuple(ratios),
    )


def _judge_compliances(
    machines: _Machines,
    answer: StaticAnswer,
    changes: dict[str, NumberChange],
    *,
    several: bool,
) -> StaticAnswer:
    """Compliances with what the models of bodies leave out in their ±; adds to the changes."""
    posed = machines.at(machines.parts.plan.poses[answer.pose])
    place = f" in pose {answer.pose}" if several else ""
    points: dict[str, PointCompliance] = {}
    for name, point in answer.points.items():
        better = posed.better.solve_point(name).answer
        alone = {
            body: np.diag(model.solve_point(name).answer.compliance)
            for body, model in posed.singles.items()
        }
        errors = {}
        for axis, direction in enumerate(DIRECTIONS):
            value = float(point.compliance[axis, axis])
            change = float(better.compliance[axis, axis]) - value
            singles = {body: float(found[axis]) - value for body, found in alone.items()}
            if np.isnan(change) or value <= 0.0:
                errors[direction] = point.errors.get(direction, Estimate())
                continue
            changes[f"{direction} compliance at {name}{place}"] = _relative(change, singles, value)
            errors[direction] = _add_model(better.errors[direction], change, singles)
        points[name] = dataclasses.replace(point, errors=errors)
    return dataclasses.replace(answer, points=points)


def _judge_response(
    machines: _Machines,
    answer: PoseResponse,
    changes: dict[str, NumberChange],
    *,
    several: bool,
) -> PoseResponse:
    """A response with what the models of bodies leave out in the ± of its lines and peaks; adds
    their changes, of lines the largest, over the largest entry of its line.
    """
    curves = answer.curves
    posed = machines.at(machines.parts.plan.poses[curves.pose])
    model = posed.better
    prepared = prepare_response(model)
    response = evaluate_frf(prepared, curves.frequencies_hz)
    estimate = estimate_response_errors(
        model.parts, prepared.direct.system, model.coupled, model.all_modes, response
    )
    change = np.abs(response.receptance - curves.receptance)
    largest = np.abs(curves.receptance).max(axis=(1, 2))
    shares = change.max(axis=(1, 2)) / np.where(largest > 0.0, largest, np.inf)
    place = f" in pose {curves.pose}" if several else ""
    changes[f"a line of the frequency response{place}"] = NumberChange(
        float(np.nanmax(shares)) if np.isfinite(shares).any() else None
    )
    numbers = _judge_numbers(machines, posed, answer.numbers, changes, place)
    return dataclasses.replace(
        answer,
        curves=dataclasses.replace(curves, error_share={MODEL: change, **estimate.shares}),
        # the change of their depth is that of another machine
        figures=tuple(
            dataclasses.replace(
                own, most_negative_real_error=None, most_negative_real_error_share={}
            )
            for own in answer.figures
        ),
        error_left_out=estimate.left_out,
        numbers=numbers,
    )


def _judge_numbers(
    machines: _Machines,
    posed: _PosedMachines,
    numbers: Sequence[ResponseNumber],
    changes: dict[str, NumberChange],
    place: str,
) -> tuple[ResponseNumber, ...]:
    """Peaks and levels with what the models of bodies leave out in their ±; adds to the changes."""
    if not numbers:
        return ()
    count = max((own.mode for own in numbers), default=-1) + 1
    plain = machines.watch(posed.plain, (), count)

    def follow(model: CoupledPose, names: Iterable[str]) -> tuple[ResponseNumber, ...]:
        return follow_numbers(numbers, model, plain, machines.watch(model, names, count))

    moved = follow(posed.better, machines.bodies.components)
    alone = {name: follow(model, [name]) for name, model in posed.singles.items()}
    known = iter(judge_numbers(posed.better, [own for own in moved if np.isfinite(own.size)]))
    found = []
    for index, (number, other) in enumerate(zip(numbers, moved, strict=True)):
        change = other.size - number.size
        singles = {name: own[index].size - number.size for name, own in alone.items()}
        changes[f"{number.name}{place}"] = _relative(change, singles, number.size)
        error = (
            Estimate({MODEL: None})
            if np.isnan(change)
            else _add_model(next(known).error, change, singles)
        )
        found.append(dataclasses.replace(number, error=error))
    return tuple(found)


def _add_model(better: Estimate, change: float, singles: Mapping[str, float]) -> Estimate:
    """The estimate of a number from that of the same number with better bodies, and the change that
    these make.
    """
    return Estimate(
        {MODEL: abs(change), **better.shares},
        better.left_out,
        {MODEL: split_change(abs(change), singles), **better.parts},
    )


def _relative(change: float, singles: Mapping[str, float], value: float) -> NumberChange:
    return NumberChange(
        None if np.isnan(change) else change / value,
        {name: None if np.isnan(single) else single / value for name, single in singles.items()},
    )
