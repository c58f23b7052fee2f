"""What a scene with an accuracy calls for, as far as can be said before its first round."""

import dataclasses

from headstock.pipeline.accuracy.search import MOST_ROUNDS, plan_start
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.scene.scene import Scene


def plan_first_round(scene: Scene) -> Plan:
    """The stages of a scene with an accuracy, with the settings that its search begins with.

    Raises:
        BudgetError: A mesh or a stage would be larger than allowed.
    """
    if scene.accuracy is None:
        raise ValueError("the scene asks for no accuracy")
    plan = plan_scene(dataclasses.replace(plan_start(scene)[0], analyses=scene.analyses))
    note = (
        f"accuracy = {100.0 * scene.accuracy.to:g} %: these are the settings of the first round; what owns the largest error is refined"
        f" then, in up to {MOST_ROUNDS} rounds, and meshes and modes written in the scene are not used"
    )
    return dataclasses.replace(plan, warnings=(*plan.warnings, note))
