"""How the frequencies, shapes and compliances of a coupled machine change with a parameter, exactly, from the change of its parts.

With ``q = T z`` and held motions ``C q = 0`` that a parameter may move, any ``dT`` with ``C dT = -dC T`` keeps the coordinates
admissible, and ``K = T^T K_s T`` differentiates by the product rule; a turn of the coordinates among themselves drops out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import scale_dofs
from headstock.reduction.coupling.elimination import RANK_TOLERANCE
from headstock.reduction.coupling.stacked_pieces import StackedPieces
from headstock.solvers.errors import ModelError

CONSISTENCY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class CoupledSlopes:
    """A machine in one pose ready to be differentiated.

    Attributes:
        coupled: The machine.
        pieces: All of its parts.
    """

    coupled: CoupledMachine
    pieces: StackedPieces

    @cached_property
    def _spread(self) -> FloatArray:
        """``C^+`` ``(n_all, m)``: smallest motion that gives the held rows unit values."""
        rows = np.vstack(list(self.pieces.constraints.values()))
        scale = scale_dofs(self.coupled.layout)
        return np.asarray(scale[:, None] * np.linalg.pinv(rows * scale, rcond=RANK_TOLERANCE))

    @cached_property
    def _places(self) -> dict[str, slice]:
        """Where each source of held motions has its rows."""
        places, start = {}, 0
        for name, rows in self.pieces.constraints.items():
            places[name] = slice(start, start + len(rows))
            start += len(rows)
        return places

    def stiffness_times(self, motions: FloatArray) -> FloatArray:
        """``K_s q`` ``(n_all, m)`` of components and joints without held motions."""
        forces = self._component_forces(self.pieces.stiffnesses, motions)
        for name, rows in self.pieces.rows.items():
            if self.pieces.springs[name].any():
                forces += rows.T @ (self.pieces.springs[name] @ (rows @ motions))
        return forces

    def mass_times(self, motions: FloatArray) -> FloatArray:
        """``M_s q`` ``(n_all, m)``."""
        return self._component_forces(self.pieces.masses, motions)

    def changed_forces(self, slope: StackedPieces, motions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """``dK_s q`` and ``dM_s q`` ``(n_all, m)``."""
        forces = self._component_forces(slope.stiffnesses, motions)
        for name, spring in slope.springs.items():
            if spring.any():
                rows = self.pieces.rows[name]
                forces += rows.T @ (spring @ (rows @ motions))
        for name, change in slope.rows.items():
            rows, spring = self.pieces.rows[name], self.pieces.springs[name]
            if change.any() and spring.any():
                forces += rows.T @ (spring @ (change @ motions)) + change.T @ (spring @ (rows @ motions))
        return forces, self._component_forces(slope.masses, motions)

    def carried_motions(self, slope: StackedPieces, motions: FloatArray) -> FloatArray | None:
        """``dT z`` ``(n_all, m)`` for ``q = T z``: how the held motions carry the dofs along; None where they do not change.

        Raises:
            ModelError: Redundantly held motions would contradict each other after the change.
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
            raise ModelError("moving this parameter makes held motions contradict each other: the machine would lose a freedom")
        return carried

    def carried_forces(self, slope: StackedPieces, forces: FloatArray) -> FloatArray:
        """``dT^T f`` ``(n, m)`` for stacked forces ``(n_all, m)``."""
        multipliers = self._spread.T @ forces
        total = np.zeros_like(forces)
        for name, change in slope.constraints.items():
            total -= change.T @ multipliers[self._places[name]]
        return np.asarray(self.coupled.basis.T @ total)

    def _component_forces(self, matrices: Mapping[str, FloatArray], motions: FloatArray) -> FloatArray:
        forces = np.zeros_like(motions)
        for name, matrix in matrices.items():
            part = self.coupled.layout.offsets[name]
            forces[part] += matrix @ motions[part]
        return forces


@dataclass(frozen=True, eq=False)
class ModeSlopes:
    """What one parameter does to modes.

    Attributes:
        forces: ``(n, m)`` ``(dK - omega^2 dM) phi`` in free coordinates.
        mass_terms: ``(m,)`` ``phi^T dM phi``.
        carried: ``(n_all, m)`` ``dT z``, zero where held motions do not change.
    """

    forces: FloatArray
    mass_terms: FloatArray
    carried: FloatArray


def slope_modes(machine: CoupledSlopes, slope: StackedPieces, squares: FloatArray, shapes: FloatArray) -> ModeSlopes:
    """Change of the pencil on given modes.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        squares: ``(m,)`` omega^2 [rad^2/s^2].
        shapes: ``(n, m)`` mass-normalised, in free coordinates.
    """
    basis = machine.coupled.basis
    motions = basis @ shapes
    stiff, heavy = machine.changed_forces(slope, motions)
    stacked = stiff - heavy * squares
    mass_terms = np.einsum("ij,ij->j", motions, heavy)
    carried = machine.carried_motions(slope, motions)
    if carried is None:
        return ModeSlopes(basis.T @ stacked, mass_terms, np.zeros_like(motions))
    inertia = machine.mass_times(motions)
    reactions = machine.stiffness_times(motions) - inertia * squares
    stacked += machine.stiffness_times(carried) - machine.mass_times(carried) * squares
    mass_terms += 2.0 * np.einsum("ij,ij->j", carried, inertia)
    return ModeSlopes(basis.T @ stacked + machine.carried_forces(slope, reactions), mass_terms, carried)


def slope_point_compliance(
    machine: CoupledSlopes, slope: StackedPieces, ports: tuple[tuple[str, int], tuple[str, int]], answers: FloatArray
) -> float:
    """Derivative of the motion at one port per unit force at another.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        ports: Observer and dof (0..5) of the motion, then of the force.
        answers: ``(n_all, 2)`` static motions under a unit force at the motion port and at the force port.
    """
    (seen, seen_dof), (pushed, pushed_dof) = ports
    rows = np.vstack([machine.pieces.observers[seen][seen_dof], machine.pieces.observers[pushed][pushed_dof]])
    stiff, _ = machine.changed_forces(slope, answers)
    total = -float(answers[:, 0] @ stiff[:, 1])
    if seen in slope.observers:
        total += float(slope.observers[seen][seen_dof] @ answers[:, 1])
    if pushed in slope.observers:
        total += float(slope.observers[pushed][pushed_dof] @ answers[:, 0])
    carried = machine.carried_motions(slope, answers)
    if carried is not None:
        reactions = machine.stiffness_times(answers) - rows.T
        total -= float(carried[:, 0] @ reactions[:, 1] + carried[:, 1] @ reactions[:, 0])
    return total
