"""Forces of joints as outputs of a machine: what their springs and dampers do at its motions."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.solvers.second_order import Channel

SPRING, DAMPER = "spring", "damper"


@dataclass(frozen=True, eq=False)
class JointForces:
    """A joint's forces on its first end, at the joint point in joint axes; of a lumped leg along and
    across it.

    Attributes:
        directions: ``k`` of them: those in which it has a spring or a damper. What a direction holds
            rigidly is no force of a spring, and is left out.
        springs: ``(k, n)`` per motion [N/m, N m/m].
        dampers: ``(k, n)`` per rate of it [N s/m, N m s/m].
    """

    name: str
    directions: tuple[str, ...]
    springs: FloatArray
    dampers: FloatArray

    def outputs(self) -> dict[Channel, FloatArray]:
        """Return the rows ``(n,)`` of springs and dampers by channel."""
        return {
            (f"{self.name} {kind}", direction): row
            for kind, rows in ((SPRING, self.springs), (DAMPER, self.dampers))
            for direction, row in zip(self.directions, rows, strict=True)
        }

    def channels(self, kind: str) -> tuple[Channel, ...]:
        """Return the channels of its springs, or of its dampers."""
        return tuple((f"{self.name} {kind}", direction) for direction in self.directions)


def joint_outputs(joints: Iterable[JointForces]) -> dict[Channel, FloatArray]:
    """Return the rows ``(n,)`` of the springs and dampers of all joints by channel."""
    return {name: row for joint in joints for name, row in joint.outputs().items()}


def find_joint_forces(joints: Iterable[PlacedJoint], *, damped: bool) -> tuple[JointForces, ...]:
    """Find the forces of all joints that have any.

    Args:
        joints: With their rows in the coordinates ``(n,)`` of a machine.
    """
    joint_forces = []
    for joint in joints:
        dampers = joint.damping if damped else np.zeros_like(joint.damping)
        acting = [
            dof
            for dof in range(len(DOF_NAMES))
            if dof not in joint.fixed and (joint.stiffness[dof].any() or dampers[dof].any())
        ]
        if acting:
            names = tuple(DOF_NAMES[dof] for dof in acting)
            forces = (matrix[acting] @ joint.rows for matrix in (joint.stiffness, dampers))
            joint_forces.append(JointForces(joint.name, names, *forces))
    return tuple(joint_forces)
