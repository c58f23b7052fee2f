"""What moves freely in a machine, from rigid bodies and joints alone: known before anything is
planned or meshed.
"""

import dataclasses

from headstock.geometry.errors import HeadstockError
from headstock.geometry.machine.joints import Joint
from headstock.geometry.parts.solids import MeshFile, SuperelementFile
from headstock.pipeline.planning.planner import choose_poses
from headstock.pipeline.storage.part_files import describe_solid
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.motions.body_motions import find_free_motions, warn_of_free_motions
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import Scene
from headstock.solvers.errors import ModelError


def free_motion_warnings(scene: Scene) -> tuple[str, ...]:
    """Warnings of a machine in which bodies may move that are not declared free; empty without.

    Elastic bodies have the free motions of rigid ones on the same joints. Nothing is said where
    that would take a mesh: imported parts, supports on faces or points, mechanisms.
    """
    try:
        coupled = _couple_rigid(scene)
    except HeadstockError:
        # a solid or a joint that cannot be built is the matter of its own stage
        return ()
    if coupled is None:
        return ()
    motions = [
        motion
        for motion in find_free_motions(coupled)
        if not all(scene.machine.components[name].free for name in motion.bodies)
    ]
    if not motions:
        return ()
    points = scene.analyses[StaticRequest].at if StaticRequest in scene.analyses else ()
    refused = [name for name in points if _has_no_answer(coupled, name)]
    refusal = f"the static analysis will be refused: every force at {', '.join(refused)} does work on that motion"
    return (warn_of_free_motions(motions), *([refusal] if refused else []))


def _couple_rigid(scene: Scene) -> CoupledMachine | None:
    """The machine in its first pose with every body rigid; None where that is not known without a
    mesh or nothing can be free.
    """
    machine = scene.machine
    if (
        scene.mechanism is not None
        or machine.supports
        or not any(_frees(joint) for joint in machine.joints.values())
    ):
        return None
    if any(
        isinstance(part.solid, MeshFile | SuperelementFile) for part in machine.components.values()
    ):
        return None
    store = Store(default_store_root())
    bodies = {
        name: reduce_rigid(part, describe_solid(part, store))
        for name, part in machine.components.items()
    }
    return couple(
        bodies, dataclasses.replace(machine, loads={}), next(iter(choose_poses(scene).values()))
    )


def _frees(joint: Joint) -> bool:
    """Whether a joint alone leaves a relative motion without stiffness."""
    return any(dof not in joint.fixed and not joint.stiffness[dof].any() for dof in range(6))


def _has_no_answer(coupled: CoupledMachine, point: str) -> bool:
    try:
        point_budget(coupled, point)
    except ModelError:
        return True
    return False
