"""Motions of a machine that nothing holds, with every body rigid: in words, and which analysis they refuse."""

import dataclasses
from collections.abc import Mapping, Sequence

from headstock.geometry.machine.machine import Machine, Pose
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.motions.body_motions import find_free_motions, warn_of_free_motions
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError


def describe_free_motions(
    bodies: Mapping[str, Superelement], machine: Machine, pose: Pose, points: Sequence[str]
) -> tuple[str, ...]:
    """Return warnings of what may move although it is not declared free; empty without.

    Args:
        bodies: Superelement of every component, rigid.
        points: Where a static analysis applies forces.

    Raises:
        ModelError: A joint names what does not exist, or the machine buckles under its weight.
    """
    coupled = couple(bodies, dataclasses.replace(machine, loads={}, sensors={}), pose)
    motions = [
        motion
        for motion in find_free_motions(coupled)
        if not all(machine.components[name].free for name in motion.bodies)
    ]
    if not motions:
        return ()
    refused = [name for name in points if _has_no_answer(coupled, name)]
    refusal = f"the static analysis will be refused: every force at {', '.join(refused)} does work on that motion"
    return (warn_of_free_motions(motions), *([refusal] if refused else []))


def _has_no_answer(coupled: CoupledMachine, point: str) -> bool:
    try:
        point_budget(coupled, point)
    except ModelError:
        return True
    return False
