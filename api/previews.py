"""What is wrong with a machine, and what a run of it calls for: ``check`` and ``plan``."""

from headstock.loading import Source, take_machine
from headstock.pipeline.accuracy.search import plan_first_round
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import add_compiling
from headstock.pipeline.preview.doubts import check_scene


def check(machine: Source) -> tuple[str, ...]:
    """Return which values are open, and what is allowed but looks wrong: bodies that move freely, odd
    numbers, what an analysis on request lacks.

    Raises:
        SceneError: Anything is wrong.
    """
    scene = take_machine(machine, "check", accept_defaults=True).scene
    return (*(f"open: {question}" for question in scene.questions), *check_scene(scene))


def plan(machine: Source) -> Plan:
    """Return the stages that a machine calls for, each with its reason and an estimate of its cost."""
    scene = take_machine(machine, "plan", accept_defaults=True).scene
    planned = plan_scene(scene, survey=True) if scene.accuracy is None else plan_first_round(scene)
    return add_compiling(planned, scene)
