"""How the frequencies, shapes and compliances of a coupled machine change with a parameter,
exactly, from the change of its parts.

With ``q = T z`` and fixed motions ``C q = 0`` that a parameter may move, any ``dT`` with ``C dT =
-dC T`` keeps the coordinates admissible, and ``K = T^T K_s T`` differentiates by the product rule;
a turn of the coordinates among themselves drops out. Differences are taken of the parts in stacked
dofs, before any coordinate is eliminated: they are smooth functions of every dimension, stiffness
and place in the scene, which coordinates and mode shapes are not.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.channels import point_rows
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    locate_interface,
    motion_rows,
    scale_dofs,
    split_constraints,
    turn_dofs,
)
from headstock.reduction.coupling.elimination import RANK_TOLERANCE
from headstock.reduction.coupling.joint_springs import place_joint
from headstock.reduction.coupling.matrices import component_matrices
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import ModelError

CONSISTENCY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class StackedPieces:
    """Parts of a machine, or the derivatives of those parts that a parameter moves.

    Attributes:
        stiffnesses: By component, ``(n_c, n_c)`` in machine axes.
        masses: By component, ``(n_c, n_c)`` in machine axes.
        rows: By joint, ``(6, n_all)`` relative motion in joint axes.
        springs: By joint, ``(6, 6)`` in joint axes.
        constraints: By what holds (``component a``, ``joint b``), rows ``(m, n_all)`` that must
            vanish.
        observers: By point, interface (``component.interface``) or component (its mean rigid motion
            at the centre of mass), rows ``(6, n_all)`` of the motion there in machine axes.
    """

    stiffnesses: dict[str, FloatArray]
    masses: dict[str, FloatArray]
    rows: dict[str, FloatArray]
    springs: dict[str, FloatArray]
    constraints: dict[str, FloatArray]
    observers: dict[str, FloatArray]


@dataclass(frozen=True)
class Selection:
    """Parts that are wanted: components, joints and observers by name."""

    components: tuple[str, ...]
    joints: tuple[str, ...]
    observers: tuple[str, ...]


def stack_pieces(layout: DofLayout, machine: Machine, wanted: Selection) -> StackedPieces:
    """Return the wanted parts of a machine as placed.

    Args:
        layout: Placed superelements with ``n_all`` stacked dofs.
        wanted: Names of the components, joints and observers that are taken.

    Raises:
        ModelError: A joint or an observer names what does not exist.
    """
    part = DofLayout(
        {name: layout.superelements[name] for name in wanted.components},
        layout.placements,
        layout.offsets,
        layout.size,
        layout.length,
    )
    matrices = component_matrices(part)
    joints = [place_joint(machine.joints[name], machine, layout) for name in wanted.joints]
    constraints = {
        f"component {name}": _component_constraints(layout, name) for name in wanted.components
    }
    constraints |= {f"joint {spring.name}": spring.rows[list(spring.fixed)] for spring in joints}
    return StackedPieces(
        stiffnesses=matrices.stiffnesses,
        masses=matrices.masses,
        rows={spring.name: spring.rows for spring in joints},
        springs={spring.name: spring.stiffness for spring in joints},
        constraints=constraints,
        observers={name: _observer_rows(layout, machine, name) for name in wanted.observers},
    )


def difference_pieces(pairs: Sequence[tuple[StackedPieces, StackedPieces, float]]) -> StackedPieces:
    """Return the sum of ``weight (after - before)`` over pairs of pieces that hold the same parts;
    what is equal gives exact zeros.
    """

    def subtract(
        pick: Callable[[StackedPieces], Mapping[str, FloatArray]],
    ) -> dict[str, FloatArray]:
        tables = [(pick(after), pick(before), weight) for after, before, weight in pairs]
        return {
            name: np.sum([w * (after[name] - before[name]) for after, before, w in tables], axis=0)
            for name in tables[0][0]
        }

    return StackedPieces(
        stiffnesses=subtract(lambda part: part.stiffnesses),
        masses=subtract(lambda part: part.masses),
        rows=subtract(lambda part: part.rows),
        springs=subtract(lambda part: part.springs),
        constraints=subtract(lambda part: part.constraints),
        observers=subtract(lambda part: part.observers),
    )


def _observer_rows(layout: DofLayout, machine: Machine, name: str) -> FloatArray:
    """Return the rows ``(6, n_all)`` of the motion of a point, an interface or a component.

    Raises:
        ModelError: There is nothing of that name.
    """
    if name in machine.points:
        return point_rows(layout, machine.points[name])
    if name in layout.superelements:
        return _mean_motion_rows(layout, name)
    component, _, interface = name.partition(".")
    end = JointEnd(component, interface)
    return motion_rows(layout, end, locate_interface(layout, end))


def _component_constraints(layout: DofLayout, name: str) -> FloatArray:
    superelement = layout.superelements[name]
    effective, _ = split_constraints(superelement)  # the others change no frequency
    rows = np.zeros((len(effective), layout.size))
    rows[:, layout.offsets[name]] = effective @ turn_dofs(superelement, layout.placements[name])
    return rows


def _mean_motion_rows(layout: DofLayout, name: str) -> FloatArray:
    """Return the rigid motion nearest to that of a component in the norm of its mass matrix, at its
    centre of mass.
    """
    superelement, placement = layout.superelements[name], layout.placements[name]
    motions = rigid_motions(superelement, superelement.center_of_mass)
    weighed = motions.T @ superelement.mass
    turn = rotate_dofs(placement.rotation)
    rows = np.zeros((6, layout.size))
    local_rows = turn @ np.linalg.solve(weighed @ motions, weighed)
    rows[:, layout.offsets[name]] = local_rows @ turn_dofs(superelement, placement)
    return rows


@dataclass(frozen=True, eq=False)
class CoupledSlopes:
    """A machine in one pose ready to be differentiated."""

    coupled: CoupledMachine
    pieces: StackedPieces

    @cached_property
    def _spread(self) -> FloatArray:
        """``C^+`` ``(n_all, m)``: smallest motion that gives the fixed rows unit values."""
        rows = np.vstack(list(self.pieces.constraints.values()))
        scale = scale_dofs(self.coupled.layout)
        return scale[:, None] * np.linalg.pinv(rows * scale, rcond=RANK_TOLERANCE)

    @cached_property
    def _places(self) -> dict[str, slice]:
        """Return where each source of fixed motions has its rows."""
        places, start = {}, 0
        for name, rows in self.pieces.constraints.items():
            places[name] = slice(start, start + len(rows))
            start += len(rows)
        return places

    def stiffness_times(self, motions: FloatArray) -> FloatArray:
        """Return ``K_s q`` ``(n_all, m)`` of components and joints without fixed motions."""
        forces = self._component_forces(self.pieces.stiffnesses, motions)
        for name, rows in self.pieces.rows.items():
            if self.pieces.springs[name].any():
                forces += rows.T @ (self.pieces.springs[name] @ (rows @ motions))
        return forces

    def mass_times(self, motions: FloatArray) -> FloatArray:
        """Return ``M_s q`` ``(n_all, m)``."""
        return self._component_forces(self.pieces.masses, motions)

    def changed_forces(
        self, slope: StackedPieces, motions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ``dK_s q`` and ``dM_s q`` ``(n_all, m)``."""
        forces = self._component_forces(slope.stiffnesses, motions)
        for name, spring in slope.springs.items():
            if spring.any():
                rows = self.pieces.rows[name]
                forces += rows.T @ (spring @ (rows @ motions))
        for name, change in slope.rows.items():
            rows, spring = self.pieces.rows[name], self.pieces.springs[name]
            if change.any() and spring.any():
                # a spring is R^T k R: product rule in R, of which a moved joint changes the rows
                forces += rows.T @ (spring @ (change @ motions)) + change.T @ (
                    spring @ (rows @ motions)
                )
        return forces, self._component_forces(slope.masses, motions)

    def carried_motions(self, slope: StackedPieces, motions: FloatArray) -> FloatArray | None:
        """Return ``dT z`` ``(n_all, m)`` for ``q = T z``: how the fixed motions carry the dofs
        along; None where they do not change.

        Raises:
            ModelError: Redundantly fixed motions would contradict each other after the change.
        """
        if not any(change.any() for change in slope.constraints.values()):
            return None
        gap = np.zeros((self._spread.shape[1], motions.shape[1]))
        for name, change in slope.constraints.items():
            gap[self._places[name]] = change @ motions
        if not gap.any():
            return None
        carried = -self._spread @ gap
        left = np.vstack([rows @ carried for rows in self.pieces.constraints.values()]) + gap
        if not np.abs(left).max() <= CONSISTENCY_LIMIT * np.abs(gap).max():
            raise ModelError(
                "moving this parameter makes fixed motions contradict each other: the machine would lose a freedom"
            )
        return carried

    def carried_forces(self, slope: StackedPieces, forces: FloatArray) -> FloatArray:
        """Return ``dT^T f`` ``(n, m)`` for stacked forces ``(n_all, m)``."""
        multipliers = self._spread.T @ forces
        total = np.zeros_like(forces)
        for name, change in slope.constraints.items():
            total -= change.T @ multipliers[self._places[name]]
        return self.coupled.basis.T @ total

    def _component_forces(
        self, matrices: Mapping[str, FloatArray], motions: FloatArray
    ) -> FloatArray:
        forces = np.zeros_like(motions)
        for name, matrix in matrices.items():
            part = self.coupled.layout.offsets[name]
            forces[part] += matrix @ motions[part]
        return forces


@dataclass(frozen=True, eq=False)
class ModeSlopes:
    """Slopes of modes by one parameter.

    Attributes:
        forces: ``(n, m)`` ``(dK - omega^2 dM) phi`` in free coordinates.
        mass_terms: ``(m,)`` ``phi^T dM phi``.
        carried: ``(n_all, m)`` ``dT z``, zero where fixed motions do not change.
    """

    forces: FloatArray
    mass_terms: FloatArray
    carried: FloatArray


def slope_modes(
    machine: CoupledSlopes, slope: StackedPieces, eigenvalues: FloatArray, shapes: FloatArray
) -> ModeSlopes:
    """Return the change of the pencil on given modes.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2].
        shapes: ``(n, m)`` mass-normalised, in free coordinates.
    """
    basis = machine.coupled.basis
    motions = basis @ shapes
    stiff, heavy = machine.changed_forces(slope, motions)
    stacked = stiff - heavy * eigenvalues
    mass_terms = np.einsum("ij,ij->j", motions, heavy)
    carried = machine.carried_motions(slope, motions)
    if carried is None:
        return ModeSlopes(basis.T @ stacked, mass_terms, np.zeros_like(motions))
    inertia = machine.mass_times(motions)
    reactions = machine.stiffness_times(motions) - inertia * eigenvalues
    stacked += machine.stiffness_times(carried) - machine.mass_times(carried) * eigenvalues
    mass_terms += 2.0 * np.einsum("ij,ij->j", carried, inertia)
    return ModeSlopes(
        basis.T @ stacked + machine.carried_forces(slope, reactions), mass_terms, carried
    )


class ObservedDof(NamedTuple):
    """Observer of a machine, and which of its dofs (0..5)."""

    observer: str
    dof: int


def slope_point_compliance(
    machine: CoupledSlopes,
    slope: StackedPieces,
    answers: FloatArray,
    *,
    motion: ObservedDof,
    force: ObservedDof,
) -> float:
    """Return the derivative of the motion at one channel per unit force at another.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        answers: ``(n_all, 2)`` static motions under a unit force where the motion is seen, and
            where the force acts.
    """
    rows = np.vstack(
        [machine.pieces.observers[channel.observer][channel.dof] for channel in (motion, force)]
    )
    stiff, _ = machine.changed_forces(slope, answers)
    total = -float(answers[:, 0] @ stiff[:, 1])
    if motion.observer in slope.observers:
        total += float(slope.observers[motion.observer][motion.dof] @ answers[:, 1])
    if force.observer in slope.observers:
        total += float(slope.observers[force.observer][force.dof] @ answers[:, 0])
    carried = machine.carried_motions(slope, answers)
    if carried is not None:
        reactions = machine.stiffness_times(answers) - rows.T
        total -= float(carried[:, 0] @ reactions[:, 1] + carried[:, 1] @ reactions[:, 0])
    return total
