"""A machine in coordinates that are the same wherever its axes stand: bodies keep their matrices, and
only the rows of joints and channels change with the pose.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.reduction.coupling.channels import machine_channels, machine_loads
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import DofLayout, lay_out_dofs, turn_dofs
from headstock.reduction.coupling.joint_springs import PlacedJoint, place_joints
from headstock.reduction.coupling.matrices import ComponentMatrices
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import Channel

MOVED = 1e-9  # of the largest motion in a row that a fixed joint may see: roundoff


@dataclass(frozen=True, eq=False)
class PlacedRows:
    """What a pose changes, per fixed coordinate.

    Attributes:
        springs: Joints with rows ``(6 + m, n)``.
        channels: Row ``(n,)`` of each channel: motion there, and by work the load of a unit force.
        loads: Generalised load ``(n,)`` of each load by name.
    """

    springs: tuple[PlacedJoint, ...]
    channels: Mapping[Channel, FloatArray]
    loads: Mapping[str, FloatArray]

    def reduce(self, basis: FloatArray) -> "PlacedRows":
        """Return the same per coordinate of a basis ``(n, m)``."""
        return PlacedRows(
            tuple(replace(spring, rows=spring.rows @ basis) for spring in self.springs),
            {channel: row @ basis for channel, row in self.channels.items()},
            {name: load @ basis for name, load in self.loads.items()},
        )


@dataclass(frozen=True, eq=False)
class TravelCoordinates:
    """The stacked dofs of a machine, turned with the components from where these stand at home.

    Attributes:
        home: Layout of the pose whose machine axes the coordinates have.
        matrices: Of each component, the same in every pose.
        loss_factors: Of each component and joint.
        gravity: ``(3,)`` acceleration [m/s^2], or None.
        channels: Names of points, interfaces and sensors that are loaded or observed.
    """

    machine: Machine
    home: DofLayout
    matrices: ComponentMatrices
    loss_factors: Mapping[str, float]
    gravity: FloatArray | None
    channels: Collection[str]

    def place(self, pose: Pose) -> PlacedRows:
        """Return the rows of joints and channels in a pose, ``n`` stacked dofs."""
        placements = place_components(self.machine, pose)
        parts = self.home.superelements
        layout = lay_out_dofs(parts, {name: placements[name] for name in parts})
        turned = self._turn(layout, np.eye(layout.size))
        springs = (
            replace(spring, rows=spring.rows @ turned)
            for spring in place_joints(self.machine, layout)
        )
        return PlacedRows(
            tuple(springs),
            machine_channels(layout, self.machine, turned, self.channels),
            machine_loads(layout, self.machine, self.matrices, turned, self.gravity),
        )

    def bring_home(self, coupled: CoupledMachine, motions: FloatArray) -> FloatArray:
        """Return motions ``(n, k)`` of the fixed coordinates of motions ``(n_free, k)`` of the free ones
        in a pose.
        """
        return self._turn(coupled.layout, coupled.basis @ motions, back=True)

    def require_held(self, coupled: CoupledMachine, basis: FloatArray) -> None:
        """Refuse a joint that fixes motions rigidly and slides: what it fixes changes with the pose.

        Args:
            basis: ``(n, m)`` of the fixed coordinates, from other poses.

        Raises:
            ModelError: A motion of the basis is fixed in this pose.
        """
        rows = coupled.fixed.constraints
        if not len(rows):
            return
        turned = self._turn(coupled.layout, basis)
        reach = np.linalg.norm(rows, axis=1)[:, None] * np.linalg.norm(turned, axis=0)
        moved = np.abs(rows @ turned).max(axis=1) > MOVED * reach.max(axis=1)
        if moved.any():
            names = sorted({coupled.fixed.sources[row] for row in np.flatnonzero(moved)})
            raise ModelError(
                f"{', '.join(names)} fixes other motions wherever the axes stand, and there is no common basis; "
                "give what is rigid there a stiffness"
            )

    def sum_bodies(
        self, basis: FloatArray, matrices: Mapping[str, FloatArray], weights: Mapping[str, float]
    ) -> FloatArray:
        """Return the sum ``(m, m)`` of matrices of components, each times its weight; 1 by default."""
        total = np.zeros((basis.shape[1],) * 2)
        for name, matrix in matrices.items():
            moved = basis[self.home.offsets[name]]
            total += weights.get(name, 1.0) * (moved.T @ matrix @ moved)
        return 0.5 * (total + total.T)

    def _turn(self, layout: DofLayout, motions: FloatArray, *, back: bool = False) -> FloatArray:
        """Return motions ``(n, k)`` in machine axes of a pose; or back from there."""
        turned = motions.copy()
        for name, element in layout.superelements.items():
            here, home = (frames.placements[name] for frames in (layout, self.home))
            if not np.array_equal(here.rotation, home.rotation):
                turn = turn_dofs(element, here).T @ turn_dofs(element, home)
                dofs = layout.offsets[name]
                turned[dofs] = (turn.T if back else turn) @ motions[dofs]
        return turned


def find_travel(
    machine: Machine,
    coupled: CoupledMachine,
    *,
    gravity: FloatArray | None,
    channels: Collection[str],
) -> TravelCoordinates:
    """Return the coordinates that a machine has wherever its axes stand.

    Args:
        coupled: The machine in any pose.
        channels: Names of points, interfaces and sensors that are loaded or observed.

    Raises:
        ModelError: A mechanism or the stiffness of weight changes with the pose.
    """
    if machine.mechanism is not None or coupled.geometric is not None:
        what = "the mechanism" if machine.mechanism is not None else "gravity_stiffening"
        raise ModelError(
            f"{what} changes more than the rows of joints along the travel; leave out `travel`, which takes none of it"
        )
    factors = {name: machine.components[name].material.loss_factor for name in coupled.offsets}
    factors |= {name: joint.loss_factor for name, joint in machine.joints.items()}
    return TravelCoordinates(
        machine, coupled.layout, coupled.matrices, factors, gravity, frozenset(channels)
    )
