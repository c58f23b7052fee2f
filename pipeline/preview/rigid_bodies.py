"""A machine of rigid bodies on its joints in six dofs a body: what may move freely, and how far weight stretches
joints. Stiffnesses that differ by more than twelve decades need a coupling.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.dof_layout import DofLayout, lay_out_dofs, scale_dofs, turn_dofs
from headstock.reduction.coupling.joint_springs import PlacedJoint, place_joints

RANK_TOLERANCE = 1e-9  # of rows of length one: below it they say the same
FREE_LEVEL = 1e-13  # of the stiffest motion: roundoff of its digits
WORK_LIMIT = 1e-6  # of a load: less of it on a free motion is roundoff


@dataclass(frozen=True, eq=False)
class RigidMachine:
    """Motions of rigid bodies that fixed joint dofs leave, by their stiffness.

    Attributes:
        layout: Places of the bodies' dofs among the ``n`` stacked ones.
        springs: Joints with their rows in stacked dofs.
        levels: ``(f,)`` stiffness of each motion, all dofs lengths, rising [N/m].
        motions: ``(n, f)`` stacked dofs of each.
    """

    layout: DofLayout
    springs: tuple[PlacedJoint, ...]
    levels: FloatArray
    motions: FloatArray

    @property
    def held(self) -> int:
        """Index of the first motion that clearly meets a stiffness."""
        return int(np.searchsorted(self.levels, FREE_LEVEL * self.levels.max(initial=0.0), "right"))

    def stretch_by_weight(self, gravity: FloatArray) -> dict[str, FloatArray]:
        """Return how far the weight of the bodies moves the second end of each joint from its first,
        ``(3,)`` in joint axes [m]; empty where it does work on a motion that may be free.

        Args:
            gravity: ``(3,)`` acceleration in machine axes [m/s^2].
        """
        weight = np.zeros(self.layout.size)
        for name, body in self.layout.superelements.items():
            weight[self.layout.offsets[name]][:3] = body.mass_kg * gravity
        work, held = self.motions.T @ weight, self.held
        if np.abs(work[:held]).max(initial=0.0) > WORK_LIMIT * np.linalg.norm(work):
            return {}
        moved = self.motions[:, held:] @ (work[held:] / self.levels[held:])
        return {spring.name: (spring.rows @ moved)[:3] for spring in self.springs}


def place_rigid(machine: Machine, parts: Mapping[str, SolidProperties], pose: Pose) -> RigidMachine:
    """Return the machine in a pose with every component rigid; loads, sensors and supports play no
    part.

    Args:
        parts: Mass properties of the components that take part.

    Raises:
        ModelError: A body cannot be made, or a joint names what does not exist.
        ValueError: The pose names an unknown axis or leaves its limits.
    """
    bodies = {
        name: reduce_rigid(machine.components[name], properties)
        for name, properties in parts.items()
    }
    frames = place_components(machine, pose)
    layout = lay_out_dofs(bodies, {name: frames[name] for name in bodies})
    springs, scale = place_joints(machine, layout), scale_dofs(layout)
    acting = np.vstack([np.zeros((0, layout.size)), *(spring.rows for spring in springs)]) * scale
    fixed = np.vstack(
        [
            np.zeros((0, layout.size)),
            *(spring.rows[list(spring.fixed)] * scale for spring in springs),
            _fix_unresisted(layout, acting),
        ]
    )
    lengths = np.linalg.norm(fixed, axis=1, keepdims=True)
    _, sizes, span = np.linalg.svd(fixed / np.where(lengths > 0.0, lengths, 1.0))
    left = span[np.count_nonzero(sizes > RANK_TOLERANCE) :].T
    stiffness = np.zeros((left.shape[1], left.shape[1]))
    for spring in springs:
        rows = spring.rows * scale @ left
        stiffness += rows.T @ spring.stiffness @ rows
    levels, shapes = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    return RigidMachine(layout, springs, levels, scale[:, None] * (left @ shapes))


def _fix_unresisted(layout: DofLayout, acting: FloatArray) -> FloatArray:
    """Return rows ``(m, n)`` of what bodies do not resist, such as the rotations of a point mass,
    where no joint ``(k, n)`` acts on it.
    """
    rows: list[FloatArray] = [np.zeros((0, layout.size))]
    for name, body in layout.superelements.items():
        local = body.constraints @ turn_dofs(body, layout.placements[name])
        block = np.zeros((len(local), layout.size))
        block[:, layout.offsets[name]] = local
        rows.append(block[~(acting @ block.T).any(axis=0)])
    return np.vstack(rows)
