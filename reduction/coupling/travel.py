"""A machine in coordinates that are the same wherever its axes stand: bodies keep their matrices, and
only the rows of joints and channels change with the pose.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.reduction.coupling.channels import machine_channels, machine_loads
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import DofLayout, lay_out_dofs, turn_dofs
from headstock.reduction.coupling.drives import (
    StackedJoints,
    free_driven,
    release_springs,
    stack_drives,
)
from headstock.reduction.coupling.joint_springs import PlacedJoint, place_joints
from headstock.reduction.coupling.matrices import ComponentMatrices
from headstock.solvers.control.drive_trains import (
    FORCE,
    MOTOR,
    SCALE,
    SLIDE,
    DriveTrain,
    Turns,
    count_coordinates,
    find_turns,
)
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
        rotors: Row ``(n,)`` of the turn in space of every motor and screw with inertia, as travel, with
            that inertia as a mass.
    """

    springs: tuple[PlacedJoint, ...]
    channels: Mapping[Channel, FloatArray]
    loads: Mapping[str, FloatArray]
    rotors: tuple[tuple[float, FloatArray], ...] = ()

    def reduce(self, basis: FloatArray) -> "PlacedRows":
        """Return the same per coordinate of a basis ``(n, m)``."""
        return PlacedRows(
            tuple(replace(spring, rows=spring.rows @ basis) for spring in self.springs),
            {channel: row @ basis for channel, row in self.channels.items()},
            {name: load @ basis for name, load in self.loads.items()},
            tuple((mass, row @ basis) for mass, row in self.rotors),
        )


@dataclass(frozen=True, eq=False)
class TravelCoordinates:
    """The stacked dofs of a machine, turned with the components from where these stand at home; behind
    them, where its motors are free, the turns of motors and screws in space, so that their inertia is
    the same in every pose.

    Attributes:
        machine: With free motors one whose joints these may move.
        home: Layout of the pose whose machine axes the coordinates have.
        matrices: Of each component, the same in every pose.
        loss_factors: Of each component and joint.
        gravity: ``(3,)`` acceleration [m/s^2], or None.
        channels: Names of points, interfaces and sensors that are loaded or observed.
        drives: With free motors; none where motors are locked.
    """

    machine: Machine
    home: DofLayout
    matrices: ComponentMatrices
    loss_factors: Mapping[str, float]
    gravity: FloatArray | None
    channels: Collection[str]
    drives: tuple[Drive, ...] = ()

    def place(self, pose: Pose) -> PlacedRows:
        """Return the rows of joints, channels and rotors in a pose."""
        placements = place_components(self.machine, pose)
        parts = self.home.superelements
        layout = lay_out_dofs(parts, {name: placements[name] for name in parts})
        joints = {spring.name: spring for spring in place_joints(self.machine, layout)}
        trains = stack_drives(StackedJoints(layout, joints), self.machine, self.drives)
        stators, turns = self._list_stators(trains), _find_turns(trains)
        # of the fixed coordinates: stacked dofs, then turns of motors and screws against housings
        size, added = layout.size, len(stators)
        back = np.eye(size + added)
        back[:size, :size] = self._turn(layout, np.eye(size))
        back[size:, :size] = -stators @ back[:size, :size]
        springs = [*release_springs(joints, trains).values()]
        springs += [
            _couple_screw(train, joints[train.joint], turn)
            for train, turn in zip(trains, turns, strict=True)
            if turn.apart
        ]
        channels = machine_channels(layout, self.machine, back[:size], self.channels)
        for train, turn in zip(trains, turns, strict=True):
            channels |= {(train.name, name): turn.motor @ back for name in (FORCE, MOTOR)}
            channels |= {
                (train.name, name): row @ back[:size]
                for name, row in ((SCALE, train.scale), (SLIDE, train.slide))
            }
        rotors = (
            (mass, (turn_of + np.pad(train.stator, (0, added))) @ back)
            for train, turn in zip(trains, turns, strict=True)
            for mass, turn_of in ((train.motor_mass, turn.motor), (train.screw_mass, turn.screw))
            if mass
        )
        return PlacedRows(
            tuple(replace(spring, rows=spring.rows @ back) for spring in springs),
            channels,
            machine_loads(layout, self.machine, self.matrices, back[:size], self.gravity),
            tuple(rotors),
        )

    def bring_home(self, coupled: CoupledMachine, motions: FloatArray) -> FloatArray:
        """Return motions ``(n, k)`` of the fixed coordinates of motions ``(n_free, k)`` of the free ones
        in a pose.
        """
        moved = coupled.basis @ motions
        joints = {spring.name: spring for spring in coupled.fixed.springs}
        trains = stack_drives(StackedJoints(coupled.layout, joints), self.machine, self.drives)
        stators = self._list_stators(trains)
        turns = motions[len(motions) - len(stators) :] + stators @ moved
        return np.vstack([self._turn(coupled.layout, moved, back=True), turns])

    def _list_stators(self, trains: Sequence[DriveTrain]) -> FloatArray:
        """Return the turn ``(a, n_all)`` of the housing behind each coordinate of motors and screws."""
        rows = [train.stator for train in trains for _ in range(count_coordinates(train))]
        return np.array(rows).reshape(len(rows), self.home.size)

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
        turned = self._turn(coupled.layout, basis)[: self.home.size]
        reach = np.linalg.norm(rows, axis=1)[:, None] * np.linalg.norm(turned, axis=0)
        moved = np.abs(rows @ turned).max(axis=1) > MOVED * reach.max(axis=1)
        if moved.any():
            names = sorted({coupled.fixed.sources[row] for row in np.flatnonzero(moved)})
            raise ModelError(
                f"{', '.join(names)} fixes other motions wherever the axes stand, and there is no common basis; "
                "give what is rigid there a stiffness"
            )

    def sum_rotors(self, rows: PlacedRows) -> FloatArray:
        """Return the mass ``(m, m)`` of motors and screws.

        Args:
            rows: In any pose, per coordinate of a basis.
        """
        total = np.zeros((len(next(iter(rows.channels.values()))),) * 2)
        return sum((mass * np.outer(row, row) for mass, row in rows.rotors), total)

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
    drives: tuple[Drive, ...] = (),
) -> TravelCoordinates:
    """Return the coordinates that a machine has wherever its axes stand.

    Args:
        machine: With neither a mechanism nor ``gravity_stiffening``, which change more than rows.
        coupled: The machine in any pose.
        channels: Names of points, interfaces and sensors that are loaded or observed.
        drives: With free motors; none where motors are locked.
    """
    factors = {name: machine.components[name].material.loss_factor for name in coupled.offsets}
    factors |= {name: joint.loss_factor for name, joint in machine.joints.items()}
    return TravelCoordinates(
        free_driven(coupled, machine, drives),
        coupled.layout,
        coupled.matrices,
        factors,
        gravity,
        frozenset(channels),
        drives,
    )


def _find_turns(trains: Sequence[DriveTrain]) -> list[Turns]:
    """Return the turns of motors and screws against their housings, per stacked dof and coordinate of
    motors and screws.
    """
    size = len(trains[0].stretch) if trains else 0
    return find_turns(trains, size + sum(map(count_coordinates, trains)))


def _couple_screw(train: DriveTrain, joint: PlacedJoint, turns: Turns) -> PlacedJoint:
    """Return the coupling between motor and screw of a drive as a joint of one row."""
    coupling = np.array([[train.coupling]])
    return PlacedJoint(
        f"{train.name} coupling",
        (turns.motor - turns.screw)[None],
        coupling,
        train.beta * coupling,
        (),
        joint.frame,
    )
