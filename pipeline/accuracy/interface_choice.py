"""The choice of interfaces of rigid joints between elastic bodies for a stated accuracy: which
remain rigid or average, and which get deformation shapes, how many and in which form.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.parts.components import Component, CouplingKind, Interface
from headstock.pipeline.accuracy.interface_errors import (
    COMPARED_SHAPES,
    STRONG,
    WEAK,
    estimate_interfaces,
    make_shaped_machines,
)
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.answers.accuracy import InterfaceErrorsAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.planning.interfaces import GluedJoint, find_glued_joints
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.estimates import compliance_kind_errors, frequency_kind_errors
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.scene import Scene
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root

# tried one after the other; 24 is the number of `auto` without an accuracy
TRIED_SHAPES = (12, 24, 40, 60, 90)
# Processor time [s] that trials of shapes may take: the next one starts where it is likely to end
# within that. Its cost is about that of the shapes it is compared with, one solve each: three parts
# of 71 000 dofs took 31, 34, 25 and 58 s.
TRIAL_SECONDS = 120.0
INTERFACE_SHARE = 0.25  # share of the accuracy for every joint; the rest is for meshes and modes
# the half-space under an interface predicts the change by its kind within a factor of three
DOUBT_MARGIN = 5.0
FORMS: dict[CouplingKind, str] = {STRONG: "strong", WEAK: "weak"}


@dataclass(frozen=True)
class ShapeChoice:
    """Store the choice for a joint whose interfaces depend on the accuracy.

    Attributes:
        shapes: Largest number of shapes of each interface; 0 where they remain as they are.
        number: The number of the scene with the largest error by the joint; empty where it is
            unknown.
        reason: Why that error is above the share allowed for the joint; empty where it is not.
        kind: Form of the shapes; None for the form in the scene.
        other: Error with the other form; None where it was not tried.
        unknown: Why the error of interfaces that remain as they are is unknown.
    """

    joint: GluedJoint
    shapes: int
    number: str = ""
    share: float = 0.0
    reason: str = ""
    kind: CouplingKind | None = None
    other: float | None = None
    unknown: str = ""

    def measured_by(self, errors: InterfaceErrorsAnswer) -> "ShapeChoice":
        """Return the choice with the number that has the largest error by its joint."""
        number, share = errors.largest(self.joint.name)
        reason = errors.left_out.get(self.joint.name, "")
        words = "" if number is None else number.describe()
        return dataclasses.replace(self, number=words, share=share, reason=reason)

    def __str__(self) -> str:
        if self.unknown:
            return f"six motions of each at {self.joint} as written: {self.unknown}"
        words = (
            f"{self.shapes} deformation shapes at {self.joint}"
            if self.shapes
            else f"six motions of each are enough at {self.joint}"
        )
        words += f": {self.number} off by {show_share(self.share)}" if self.number else ""
        if self.kind is None or self.other is None:
            return words
        return f"{words}; {FORMS[self.kind]} form, the other one {show_share(self.other)}"


def choose_shapes(
    scene: Scene, start: Scene, accuracy: float, run_round: Callable[[Scene], RunState]
) -> list[ShapeChoice]:
    """Choose the fewest shapes of every selectable joint for which its error is within its share of
    the accuracy; collective.

    Joints without shapes keep six rigid-body motions where these are enough, by the half-space
    under their areas or, where that is not certain, compared with shapes. The difference between
    both forms hardly depends on the mesh, so it is evaluated on that of the first round.

    Args:
        start: The same scene with the settings and analyses of the first round.
        accuracy: Largest relative error of any number.
        run_round: Runs a scene without writing files.
    """
    allowed = INTERFACE_SHARE * accuracy
    chosen = _choose_candidates(scene, start, allowed, run_round)
    forms = {name: _list_forms(scene, choice.joint) for name, choice in chosen.items()}
    open_joints = [name for name, choice in chosen.items() if choice.shapes]
    compared = [max(COMPARED_SHAPES[0], 2 * count) for count in TRIED_SHAPES]
    last, spent = 0.0, 0.0  # time of the trial before, and of all [s]
    for step, count in enumerate(TRIED_SHAPES):
        growth = compared[step] / compared[max(step - 1, 0)]
        if not open_joints or spent + growth * last > TRIAL_SECONDS:
            break
        begun = time.process_time()
        tried = {name: dataclasses.replace(chosen[name], shapes=count) for name in open_joints}
        comm = _try_forms(start, chosen, tried, forms, run_round)
        # times differ between ranks, and all have to stop together
        last = comm.bcast(time.process_time() - begun)
        spent += last
        open_joints = [
            name for name in open_joints if not chosen[name].reason and chosen[name].share > allowed
        ]
    for name in open_joints:
        chosen[name] = dataclasses.replace(chosen[name], reason=_explain_end(chosen[name].shapes))
    return list(chosen.values())


def _choose_candidates(
    scene: Scene, start: Scene, allowed: float, run_round: Callable[[Scene], RunState]
) -> dict[str, ShapeChoice]:
    """Return selectable joints with their first number of shapes, and those that keep six motions;
    collective.
    """
    planned = plan_scene(start).components
    chosen: dict[str, ShapeChoice] = {}
    plain: list[GluedJoint] = []
    for joint in find_glued_joints(scene.machine, planned):
        ends = [planned[component].interfaces[name] for component, name in joint.ends]
        if all(end.auto for end in ends):
            chosen[joint.name] = ShapeChoice(joint, TRIED_SHAPES[0])
        elif all(_may_deform(scene, end) for end in ends):
            plain.append(joint)
    if plain:
        for name, kept in _evaluate_plain(plain, run_round(start), allowed).items():
            enough = kept.share <= allowed or kept.unknown
            chosen[name] = kept if enough else ShapeChoice(kept.joint, TRIED_SHAPES[0])
    return chosen


def _try_forms(
    start: Scene,
    chosen: dict[str, ShapeChoice],
    tried: Mapping[str, ShapeChoice],
    forms: Mapping[str, Sequence[CouplingKind | None]],
    run_round: Callable[[Scene], RunState],
) -> MPI.Comm:
    """Run the machine with the shapes to try at joints, once for every form, and choose the better
    form of each; collective.

    Args:
        chosen: All joints; those that are tried are replaced.
        tried: Joints with the shapes to try.
    """
    results: dict[str, list[ShapeChoice]] = {name: [] for name in tried}
    for index in range(max(len(forms[name]) for name in tried)):
        for name, choice in tried.items():
            kind = forms[name][min(index, len(forms[name]) - 1)]
            chosen[name] = dataclasses.replace(choice, kind=kind)
        state = run_round(give_chosen(start, chosen.values()))
        errors = _compare(state)
        for name in tried:
            results[name].append(chosen[name].measured_by(errors))
    for name, choices in results.items():
        best = min(choices, key=lambda choice: choice.share)
        others = [choice.share for choice in choices if choice.kind != best.kind]
        chosen[name] = dataclasses.replace(best, other=max(others, default=None))
    return state.comm


def _explain_end(shapes: int) -> str:
    """Explain why the error by a joint is above its share of the accuracy."""
    reason = f"it takes more than {show_share(INTERFACE_SHARE)} of the accuracy"
    if shapes < TRIED_SHAPES[-1]:
        reason += (
            f" with {shapes} shapes, and trials of more would take longer than"
            f" {TRIAL_SECONDS:g} s of processor time; write how many: flexible = {TRIED_SHAPES[-1]}"
        )
    return reason


def _may_deform(scene: Scene, end: Interface) -> bool:
    """Tell whether an interface with six motions may get shapes."""
    goal = scene.accuracy
    if goal is None or goal.interfaces == "none" or end.flexible:
        return False
    return goal.interfaces == "all" or end.open_kind


def _list_forms(scene: Scene, joint: GluedJoint) -> list[CouplingKind | None]:
    """List the forms to try; None for that in the scene."""
    ends = [scene.machine.components[component].interfaces[name] for component, name in joint.ends]
    plain = not any(end.flexible for end in ends)
    return [STRONG, WEAK] if plain or all(end.open_kind for end in ends) else [None]


def _evaluate_plain(
    joints: list[GluedJoint], state: RunState, allowed: float
) -> dict[str, ShapeChoice]:
    """Estimate the largest error of a number by each joint without shapes; collective."""
    bounds = make_on_root(state.comm, functools.partial(_bound_by_half_space, joints, state))
    if all(choice.share <= allowed for choice in bounds.values()):
        return bounds
    errors = _compare(state)
    for name, choice in bounds.items():
        if choice.share <= allowed:
            continue
        reason = errors.left_out.get(name, "")
        plain = ShapeChoice(choice.joint, 0, unknown=reason)
        bounds[name] = plain if reason else plain.measured_by(errors)
    return bounds


def _bound_by_half_space(joints: list[GluedJoint], state: RunState) -> dict[str, ShapeChoice]:
    """Return upper limits of the errors by the kind of the joints' interfaces, on rank 0."""
    shares: dict[str, dict[str, float]] = {}
    for answer in state.answers:
        bounds: Iterable[tuple[str, str, float]] = ()
        if isinstance(answer, PoseModes):
            bounds = _bound_frequencies(state, answer)
        elif isinstance(answer, StaticAnswer):
            bounds = _bound_compliances(state, answer)
        for number, end, share in bounds:
            shares.setdefault(number, {})[end] = share
    choices = {}
    for joint in joints:
        ends = [f"{component}.{name}" for component, name in joint.ends]
        sizes = {
            number: DOUBT_MARGIN * sum(by_end.get(end, 0.0) for end in ends)
            for number, by_end in shares.items()
        }
        worst = max(sizes, key=lambda number: sizes[number], default="")
        choices[joint.name] = ShapeChoice(joint, 0, worst, sizes.get(worst, 0.0))
    return choices


def _bound_frequencies(state: RunState, answer: PoseModes) -> Iterator[tuple[str, str, float]]:
    """Yield the name of each frequency, an end of a joint, and the relative error by the kind of
    this end.
    """
    model = couple_pose(state.parts, answer.pose)
    modes = keep_lowest(model.all_modes, count=answer.below + len(answer.frequencies_hz))
    where = f" in pose {answer.pose.name}" if len(state.plan.poses) > 1 else ""
    for end, bounds in frequency_kind_errors(state.parts, model.coupled, modes).items():
        for mode in range(max(modes.rigid_count, answer.below), len(bounds)):
            hz = float(modes.frequencies_hz[mode])
            yield f"frequency {mode + 1} ({hz:.4g} Hz){where}", end, float(bounds[mode]) / hz


def _bound_compliances(state: RunState, answer: StaticAnswer) -> Iterator[tuple[str, str, float]]:
    """Yield the same of compliances."""
    model = couple_pose(state.parts, state.plan.poses[answer.pose])
    where = f" in pose {answer.pose}" if len(state.plan.poses) > 1 else ""
    for name, point in answer.points.items():
        values = np.diag(point.compliance)[: len(DIRECTIONS)]
        resisted = [axis for axis in range(len(values)) if values[axis] > 0.0]
        if not resisted:
            continue
        motions = np.stack([model.push((name, DIRECTIONS[axis])) for axis in resisted], axis=1)
        for end, bounds in compliance_kind_errors(state.parts, model.coupled, motions).items():
            for axis, bound in zip(resisted, bounds, strict=True):
                number = f"{DIRECTIONS[axis]} compliance at {name}{where}"
                yield number, end, float(bound / values[axis])


def _compare(state: RunState) -> InterfaceErrorsAnswer:
    """Compare a run with the same machine with shapes at its joints; collective."""
    shaped = make_shaped_machines(state)

    def evaluate() -> InterfaceErrorsAnswer:
        (found,) = find_answers(estimate_interfaces(state, shaped).answers, InterfaceErrorsAnswer)
        return found

    return make_on_root(state.comm, evaluate)


def give_chosen(scene: Scene, choices: Iterable[ShapeChoice]) -> Scene:
    """Return the scene with the chosen shapes, and finite elements of the bodies that have them."""
    components: dict[str, Component] = dict(scene.machine.components)
    for choice in choices:
        for name, interface in choice.joint.ends if choice.shapes else ():
            part = components[name]
            entry = part.interfaces[interface]
            entry = dataclasses.replace(
                entry, flexible=choice.shapes, coupling=choice.kind or entry.coupling
            )
            # the search begins with finite elements of rigid or segmented bodies of the scene: only
            # these have shapes
            components[name] = dataclasses.replace(
                part, fidelity="elastic", interfaces={**part.interfaces, interface: entry}
            )
    return replace_components(scene, components)
