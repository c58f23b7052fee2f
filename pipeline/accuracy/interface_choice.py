"""How many deformation shapes the interfaces of rigid joints get for a stated accuracy."""

import dataclasses
import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from headstock.geometry.parts.components import Component
from headstock.pipeline.accuracy.interface_errors import (
    ShapedMachines,
    judge_interfaces,
    make_shaped_machines,
)
from headstock.pipeline.accuracy.rounds import replace_components
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.estimates import show_share
from headstock.pipeline.answers.interfaces import InterfaceErrorsAnswer
from headstock.pipeline.planning.interfaces import GluedJoint, find_glued_joints
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.scene import Scene
from headstock.solvers.ranks import make_on_root

# tried one after the other; 24 is what `auto` means without an accuracy
TRIED_SHAPES = (12, 24, 40, 60, 90)
INTERFACE_SHARE = 0.25  # of the accuracy, of every joint; the rest is for meshes and modes


@dataclass(frozen=True)
class ShapeChoice:
    """The shapes of a joint whose interfaces leave their number to the accuracy.

    Attributes:
        joint: With its interfaces.
        shapes: Most shapes of each.
        number: The number of the scene that it puts off most; empty where nothing is known.
        share: By how much of it.
        reason: Why the share is above what the joint may take; empty where it is not.
    """

    joint: GluedJoint
    shapes: int
    number: str = ""
    share: float = 0.0
    reason: str = ""

    def __str__(self) -> str:
        words = f"{self.shapes} deformation shapes at {self.joint}"
        return f"{words}: {self.number} off by {show_share(self.share)}" if self.number else words


def choose_shapes(
    scene: Scene, start: Scene, accuracy: float, run_round: Callable[[Scene], RunState]
) -> list[ShapeChoice]:
    """The fewest shapes of every joint that may choose, for which each takes at most its share of
    the accuracy; collective.

    The gap between both forms hardly depends on the mesh, so it is found on that of the first
    round.

    Args:
        scene: With an accuracy.
        start: The same with the settings and analyses of the first round.
        accuracy: Largest relative error of any number.
        run_round: Runs a scene without writing anything.
    """
    planned = plan_scene(start).components
    joints = [
        joint
        for joint in find_glued_joints(scene.machine, planned)
        if all(planned[component].interfaces[name].auto for component, name in joint.ends)
    ]
    chosen = {joint.name: ShapeChoice(joint, TRIED_SHAPES[0]) for joint in joints}
    open_joints = [joint.name for joint in joints]
    for count in TRIED_SHAPES:
        if not open_joints:
            break
        chosen |= {name: dataclasses.replace(chosen[name], shapes=count) for name in open_joints}
        state = run_round(give_chosen(start, chosen.values()))
        shaped = make_shaped_machines(state)
        found = make_on_root(state.comm, functools.partial(_judge, state, shaped))
        for name in open_joints:
            number, share = found.largest(name)
            chosen[name] = dataclasses.replace(
                chosen[name], number=number, share=share, reason=found.left_out.get(name, "")
            )
        open_joints = [
            name
            for name in open_joints
            if not chosen[name].reason and chosen[name].share > INTERFACE_SHARE * accuracy
        ]
    for name in open_joints:
        own = chosen[name]
        reason = f"it takes more than {show_share(INTERFACE_SHARE)} of the accuracy"
        chosen[name] = dataclasses.replace(own, reason=reason)
    return list(chosen.values())


def _judge(state: RunState, shaped: ShapedMachines) -> InterfaceErrorsAnswer:
    (found,) = find_answers(judge_interfaces(state, shaped).answers, InterfaceErrorsAnswer)
    return found


def give_chosen(scene: Scene, choices: Iterable[ShapeChoice]) -> Scene:
    """The scene with the shapes that were chosen."""
    components: dict[str, Component] = dict(scene.machine.components)
    for choice in choices:
        for name, interface in choice.joint.ends:
            part = components[name]
            entry = dataclasses.replace(part.interfaces[interface], flexible=choice.shapes)
            components[name] = dataclasses.replace(
                part, interfaces={**part.interfaces, interface: entry}
            )
    return replace_components(scene, components)
