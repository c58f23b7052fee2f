"""Which interfaces of rigid joints between elastic bodies stay as they are for a stated accuracy, and
which get how many deformation shapes, in which form.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.parts.components import Component, CouplingKind, Interface
from headstock.pipeline.accuracy.interface_errors import (
    COMPARED_SHAPES,
    STRONG,
    WEAK,
    ShapedMachines,
    judge_interfaces,
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
from headstock.pipeline.stages.estimates import doubt_compliances, doubt_frequencies
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.scene import Scene
from headstock.solvers.linear.modal_analysis import keep_lowest
from headstock.solvers.ranks import make_on_root

# tried one after the other; 24 is what `auto` means without an accuracy
TRIED_SHAPES = (12, 24, 40, 60, 90)
# Processor time [s] that trials of shapes may take: the next one is begun where it is likely to end
# within that. Its cost is about that of the shapes it is compared with, one solve each: three parts
# of 71 000 dofs took 31, 34, 25 and 58 s.
TRIAL_SECONDS = 120.0
INTERFACE_SHARE = 0.25  # of the accuracy, of every joint; the rest is for meshes and modes
# the half-space under an interface says within a factor of three what its kind changes
DOUBT_MARGIN = 5.0
FORMS: dict[CouplingKind, str] = {STRONG: "strong", WEAK: "weak"}


@dataclass(frozen=True)
class ShapeChoice:
    """The interfaces of a joint that leaves them to the accuracy.

    Attributes:
        shapes: Most shapes of each; 0 where they stay as they are.
        number: The number of the scene that it puts off most; empty where nothing is known.
        reason: Why the share is above what the joint may take; empty where it is not.
        kind: The form of the shapes; None for as written.
        other: By how much the other form puts a number off; None where it was not tried.
        unknown: Why nothing is known of interfaces that stay as they are.
    """

    joint: GluedJoint
    shapes: int
    number: str = ""
    share: float = 0.0
    reason: str = ""
    kind: CouplingKind | None = None
    other: float | None = None
    unknown: str = ""

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
    """The fewest shapes of every joint that may choose, for which each takes at most its share of
    the accuracy; collective.

    Joints that have none keep six motions where these are enough, by the half-space under their
    areas or, where that is not sure, beside shapes. The gap between both forms hardly depends on
    the mesh, so it is found on that of the first round.

    Args:
        start: The same with the settings and analyses of the first round.
        accuracy: Largest relative error of any number.
        run_round: Runs a scene without writing anything.
    """
    planned = plan_scene(start).components
    allowed = INTERFACE_SHARE * accuracy
    chosen: dict[str, ShapeChoice] = {}
    plain: list[GluedJoint] = []
    for joint in find_glued_joints(scene.machine, planned):
        ends = [planned[component].interfaces[name] for component, name in joint.ends]
        if all(end.auto for end in ends):
            chosen[joint.name] = ShapeChoice(joint, TRIED_SHAPES[0])
        elif all(_may_deform(scene, end) for end in ends):
            plain.append(joint)
    forms = {
        joint.name: _list_forms(scene, joint)
        for joint in [*plain, *(c.joint for c in chosen.values())]
    }
    if plain:
        kept = _judge_plain(plain, run_round(start), allowed)
        for joint in plain:
            own = kept[joint.name]
            chosen[joint.name] = (
                own if own.share <= allowed or own.unknown else ShapeChoice(joint, TRIED_SHAPES[0])
            )
    open_joints = [name for name, own in chosen.items() if own.shapes]
    compared = [max(COMPARED_SHAPES[0], 2 * count) for count in TRIED_SHAPES]
    last, spent = 0.0, 0.0  # of the trial before, and of all [s]
    for step, count in enumerate(TRIED_SHAPES):
        growth = compared[step] / compared[max(step - 1, 0)]
        if not open_joints or spent + growth * last > TRIAL_SECONDS:
            break
        begun = time.process_time()
        tried: dict[str, list[ShapeChoice]] = {name: [] for name in open_joints}
        for place in range(max(len(forms[name]) for name in open_joints)):
            for name in open_joints:
                kind = forms[name][min(place, len(forms[name]) - 1)]
                chosen[name] = dataclasses.replace(chosen[name], shapes=count, kind=kind)
            state = run_round(give_chosen(start, chosen.values()))
            found = _compare(state)
            # processors of ranks differ, and all have to end alike
            last = state.comm.bcast(time.process_time() - begun)
            for name in open_joints:
                number, share = found.largest(name)
                reason = found.left_out.get(name, "")
                tried[name].append(
                    dataclasses.replace(
                        chosen[name],
                        number="" if number is None else number.describe(),
                        share=share,
                        reason=reason,
                    )
                )
        spent += last
        for name, choices in tried.items():
            best = min(choices, key=lambda each: each.share)
            other = [each.share for each in choices if each.kind != best.kind]
            chosen[name] = dataclasses.replace(best, other=max(other, default=None))
        open_joints = [
            name for name in open_joints if not chosen[name].reason and chosen[name].share > allowed
        ]
    for name in open_joints:
        own = chosen[name]
        reason = f"it takes more than {show_share(INTERFACE_SHARE)} of the accuracy"
        if own.shapes < TRIED_SHAPES[-1]:
            reason += (
                f" with {own.shapes} shapes, and trials of more would take longer than"
                f" {TRIAL_SECONDS:g} s of processor time; write how many: flexible = {TRIED_SHAPES[-1]}"
            )
        chosen[name] = dataclasses.replace(own, reason=reason)
    return list(chosen.values())


def _may_deform(scene: Scene, end: Interface) -> bool:
    """Whether an interface with six motions may get shapes."""
    goal = scene.accuracy
    if goal is None or goal.interfaces == "none" or end.flexible:
        return False
    return goal.interfaces == "all" or end.open_kind


def _list_forms(scene: Scene, joint: GluedJoint) -> list[CouplingKind | None]:
    """Forms to try; None for that which is written."""
    ends = [scene.machine.components[component].interfaces[name] for component, name in joint.ends]
    plain = not any(end.flexible for end in ends)
    return [STRONG, WEAK] if plain or all(end.open_kind for end in ends) else [None]


def _judge_plain(
    joints: list[GluedJoint], state: RunState, allowed: float
) -> dict[str, ShapeChoice]:
    """How far joints without shapes put a number off, by name; collective."""
    doubts = make_on_root(state.comm, functools.partial(_doubt, joints, state))
    if all(own.share <= allowed for own in doubts.values()):
        return doubts
    found = _compare(state)
    judged: dict[str, ShapeChoice] = {}
    for name, own in doubts.items():
        if own.share <= allowed:
            judged[name] = own
        elif name in found.left_out:
            judged[name] = ShapeChoice(own.joint, 0, unknown=found.left_out[name])
        else:
            number, share = found.largest(name)
            words = "" if number is None else number.describe()
            judged[name] = ShapeChoice(own.joint, 0, words, share)
    return judged


def _doubt(joints: list[GluedJoint], state: RunState) -> dict[str, ShapeChoice]:
    """The most that the kind of their interfaces may put a number off, on rank 0."""
    shares: dict[str, dict[str, float]] = {}
    several = len(state.plan.poses) > 1
    for answer in state.answers:
        if isinstance(answer, PoseModes):
            model = couple_pose(state.parts, answer.pose)
            modes = keep_lowest(model.all_modes, count=answer.below + len(answer.frequencies_hz))
            place = f" in pose {answer.pose.name}" if several else ""
            for end, doubts in doubt_frequencies(state.parts, model.coupled, modes).items():
                for mode in range(max(modes.rigid_count, answer.below), len(doubts)):
                    hz = float(modes.frequencies_hz[mode])
                    number = f"frequency {mode + 1} ({hz:.4g} Hz){place}"
                    shares.setdefault(number, {})[end] = float(doubts[mode]) / hz
        elif isinstance(answer, StaticAnswer):
            model = couple_pose(state.parts, state.plan.poses[answer.pose])
            place = f" in pose {answer.pose}" if several else ""
            for name, point in answer.points.items():
                values = np.diag(point.compliance)[: len(DIRECTIONS)]
                known = [axis for axis in range(len(values)) if values[axis] > 0.0]
                motions = [model.push((name, DIRECTIONS[axis])) for axis in known]
                found = (
                    doubt_compliances(state.parts, model.coupled, np.stack(motions, axis=1))
                    if known
                    else {}
                )
                for end, doubts in found.items():
                    for axis, doubt in zip(known, doubts, strict=True):
                        number = f"{DIRECTIONS[axis]} compliance at {name}{place}"
                        shares.setdefault(number, {})[end] = float(doubt / values[axis])
    judged = {}
    for joint in joints:
        ends = [f"{component}.{name}" for component, name in joint.ends]
        sizes = {
            number: DOUBT_MARGIN * sum(own.get(end, 0.0) for end in ends)
            for number, own in shares.items()
        }
        worst = max(sizes, key=lambda number: sizes[number], default="")
        judged[joint.name] = ShapeChoice(joint, 0, worst, sizes.get(worst, 0.0))
    return judged


def _compare(state: RunState) -> InterfaceErrorsAnswer:
    """What the joints of a run leave out; collective."""
    shaped = make_shaped_machines(state)
    return make_on_root(state.comm, functools.partial(_judge, state, shaped))


def _judge(state: RunState, shaped: ShapedMachines) -> InterfaceErrorsAnswer:
    (found,) = find_answers(judge_interfaces(state, shaped).answers, InterfaceErrorsAnswer)
    return found


def give_chosen(scene: Scene, choices: Iterable[ShapeChoice]) -> Scene:
    """The scene with the shapes that were chosen, and finite elements of the bodies that have them."""
    components: dict[str, Component] = dict(scene.machine.components)
    for choice in choices:
        for name, interface in choice.joint.ends if choice.shapes else ():
            part = components[name]
            entry = part.interfaces[interface]
            entry = dataclasses.replace(
                entry, flexible=choice.shapes, coupling=choice.kind or entry.coupling
            )
            # the search begins with finite elements of what is rigid or segmented in the scene: only
            # these have shapes
            components[name] = dataclasses.replace(
                part, fidelity="elastic", interfaces={**part.interfaces, interface: entry}
            )
    return replace_components(scene, components)
