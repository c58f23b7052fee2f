"""How the frequencies, damping, shapes, compliances and responses of a coupled machine change with a
parameter, exactly, from the change of its parts.

With ``q = T z`` and fixed motions ``C q = 0`` that a parameter may move, any ``dT`` with ``C dT =
-dC T`` keeps the coordinates admissible, and ``K = T^T K_s T`` differentiates by the product rule;
a turn of the coordinates among themselves drops out. Differences are taken of the parts in stacked
dofs, before any coordinate is eliminated: they are smooth functions of every dimension, stiffness
and place in the scene, which coordinates and mode shapes are not.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.channels import channel_rows
from headstock.reduction.coupling.coupling import CoupledMachine, sum_rayleigh
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    scale_dofs,
    split_constraints,
    turn_dofs,
)
from headstock.reduction.coupling.elimination import RANK_TOLERANCE
from headstock.reduction.coupling.joint_springs import place_joint
from headstock.reduction.coupling.matrices import component_matrices
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.second_order import ComplexArray

CONSISTENCY_LIMIT = 1e-6
NOTHING = np.zeros((1, 1))
Term = Literal["stiffness", "damping", "loss", "mass"]
TERMS: tuple[Term, ...] = ("stiffness", "damping", "loss", "mass")


@dataclass(frozen=True, eq=False)
class StackedPieces:
    """Parts of a machine, or the derivatives of those parts that a parameter moves.

    A term is a matrix of the equations of motion ``(s^2 M + s C + K + i H) q = f``: mass, damping,
    stiffness and loss (loss factor times stiffness). What is zero may be left out.

    Attributes:
        bodies: By term and component, ``(n_c, n_c)`` in machine axes.
        joints: By term and joint, ``(6 + m, 6 + m)`` in joint axes.
        rows: By joint, ``(6 + m, n_all)`` relative motion in joint axes.
        constraints: By what holds (``component a``, ``joint b``), rows ``(m, n_all)`` that must
            vanish.
        observers: By point, sensor, interface (``component.interface``) or component (its mean
            rigid motion at the centre of mass), rows ``(6, n_all)`` of the motion there in machine
            axes, of a sensor along what it measures.
    """

    bodies: dict[Term, dict[str, FloatArray]]
    joints: dict[Term, dict[str, FloatArray]]
    rows: dict[str, FloatArray]
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
    matrices = component_matrices(part, rayleigh=sum_rayleigh(machine, part.superelements))
    joints = [place_joint(machine.joints[name], machine, layout) for name in wanted.joints]
    constraints = {
        f"component {name}": _component_constraints(layout, name) for name in wanted.components
    }
    constraints |= {f"joint {spring.name}": spring.rows[list(spring.fixed)] for spring in joints}
    body_losses = {
        name: factor * matrices.stiffnesses[name]
        for name in wanted.components
        if (factor := machine.components[name].material.loss_factor)
    }
    joint_losses = {
        spring.name: factor * spring.stiffness
        for spring in joints
        if (factor := machine.joints[spring.name].loss_factor)
    }
    return StackedPieces(
        bodies={
            "stiffness": matrices.stiffnesses,
            "damping": matrices.dampings,
            "loss": body_losses,
            "mass": matrices.masses,
        },
        joints={
            "stiffness": {spring.name: spring.stiffness for spring in joints},
            "damping": {spring.name: spring.damping for spring in joints if spring.damping.any()},
            "loss": joint_losses,
        },
        rows={spring.name: spring.rows for spring in joints},
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
        names = dict.fromkeys(name for *both, _ in tables for table in both for name in table)
        zero = np.zeros(())  # a part without damping has no matrix
        return {
            name: np.sum(
                np.array([w * (a.get(name, zero) - b.get(name, zero)) for a, b, w in tables]),
                axis=0,
            )
            for name in names
        }

    def subtract_terms(
        pick: Callable[[StackedPieces], Mapping[Term, Mapping[str, FloatArray]]],
    ) -> dict[Term, dict[str, FloatArray]]:
        return {
            term: subtract(functools.partial(_pick_term, pick=pick, term=term)) for term in TERMS
        }

    return StackedPieces(
        bodies=subtract_terms(lambda part: part.bodies),
        joints=subtract_terms(lambda part: part.joints),
        rows=subtract(lambda part: part.rows),
        constraints=subtract(lambda part: part.constraints),
        observers=subtract(lambda part: part.observers),
    )


def _pick_term(
    part: StackedPieces,
    *,
    pick: Callable[[StackedPieces], Mapping[Term, Mapping[str, FloatArray]]],
    term: Term,
) -> Mapping[str, FloatArray]:
    return pick(part).get(term, {})


def _observer_rows(layout: DofLayout, machine: Machine, name: str) -> FloatArray:
    """Return the rows ``(6, n_all)`` of the motion of a point, a sensor, an interface or a component.

    Raises:
        ModelError: There is nothing of that name.
    """
    if name in layout.superelements:
        return _mean_motion_rows(layout, name)
    return channel_rows(layout, machine, name)


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
    # a point mass without inertia does not turn
    local_rows = turn @ np.linalg.pinv(weighed @ motions, hermitian=True) @ weighed
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

    def times[Array: (FloatArray, ComplexArray)](self, term: Term, motions: Array) -> Array:
        """Return a term of components and joints without fixed motions, times motions
        ``(n_all, m)``.
        """
        forces = self._component_forces(self.pieces.bodies.get(term, {}), motions)
        for name, matrix in self.pieces.joints.get(term, {}).items():
            if matrix.any():
                rows = self.pieces.rows[name]
                forces += rows.T @ (matrix @ (rows @ motions))
        return forces

    def changes[Array: (FloatArray, ComplexArray)](
        self, slope: StackedPieces, term: Term, motions: Array
    ) -> Array:
        """Return the derivative of a term times motions ``(n_all, m)``."""
        forces = self._component_forces(slope.bodies.get(term, {}), motions)
        for name, matrix in slope.joints.get(term, {}).items():
            if matrix.any():
                rows = self.pieces.rows[name]
                forces += rows.T @ (matrix @ (rows @ motions))
        acting = self.pieces.joints.get(term, {})
        for name, change in slope.rows.items():
            matrix = acting.get(name, NOTHING)
            if change.any() and matrix.any():
                rows = self.pieces.rows[name]
                # a spring is R^T k R: product rule in R, of which a moved joint changes the rows
                forces += rows.T @ (matrix @ (change @ motions)) + change.T @ (
                    matrix @ (rows @ motions)
                )
        return forces

    def dynamic_times(self, motions: ComplexArray, poles: ComplexArray) -> ComplexArray:
        """Return ``(s^2 M + s C + K + i H) q`` ``(n_all, m)`` of motions at each ``s`` [rad/s]."""
        return _sum_terms(poles, lambda term: self.times(term, motions))

    def dynamic_changes(
        self, slope: StackedPieces, motions: ComplexArray, poles: ComplexArray
    ) -> ComplexArray:
        """Return the derivative of what ``dynamic_times`` returns, by the matrices."""
        return _sum_terms(poles, lambda term: self.changes(slope, term, motions))

    def carried_motions[Array: (FloatArray, ComplexArray)](
        self, slope: StackedPieces, motions: Array
    ) -> Array | None:
        """Return ``dT z`` ``(n_all, m)`` for ``q = T z``: how the fixed motions carry the dofs
        along; None where they do not change.

        Raises:
            ModelError: Redundantly fixed motions would contradict each other after the change.
        """
        if not any(change.any() for change in slope.constraints.values()):
            return None
        gap = np.zeros((self._spread.shape[1], motions.shape[1]), dtype=motions.dtype)
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

    def carried_forces[Array: (FloatArray, ComplexArray)](
        self, slope: StackedPieces, forces: Array
    ) -> Array:
        """Return ``dT^T f`` ``(n, m)`` for stacked forces ``(n_all, m)``."""
        multipliers = self._spread.T @ forces
        total = np.zeros_like(forces)
        for name, change in slope.constraints.items():
            total -= change.T @ multipliers[self._places[name]]
        return self.coupled.basis.T @ total

    def _component_forces[Array: (FloatArray, ComplexArray)](
        self, matrices: Mapping[str, FloatArray], motions: Array
    ) -> Array:
        forces = np.zeros_like(motions)
        for name, matrix in matrices.items():
            part = self.coupled.layout.offsets[name]
            forces[part] += matrix @ motions[part]
        return forces


def _sum_terms(poles: ComplexArray, multiply: Callable[[Term], ComplexArray]) -> ComplexArray:
    """Return the sum of terms times their powers of ``s``; at rest there is no structural damping.

    Args:
        poles: ``(m,)`` ``s`` of each column.
        multiply: Gives a term times the columns ``(n, m)``.
    """
    turning = 1j * (poles.imag > 0.0)
    weights = {
        "stiffness": np.ones_like(poles),
        "damping": poles,
        "loss": turning,
        "mass": poles**2,
    }
    return np.sum([weights[term] * multiply(term) for term in TERMS if weights[term].any()], axis=0)


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
    stiff, heavy = (machine.changes(slope, term, motions) for term in ("stiffness", "mass"))
    stacked = stiff - heavy * eigenvalues
    mass_terms = np.einsum("ij,ij->j", motions, heavy)
    carried = machine.carried_motions(slope, motions)
    if carried is None:
        return ModeSlopes(basis.T @ stacked, mass_terms, np.zeros_like(motions))
    inertia = machine.times("mass", motions)
    reactions = machine.times("stiffness", motions) - inertia * eigenvalues
    stacked += machine.times("stiffness", carried) - machine.times("mass", carried) * eigenvalues
    mass_terms += 2.0 * np.einsum("ij,ij->j", carried, inertia)
    return ModeSlopes(
        basis.T @ stacked + machine.carried_forces(slope, reactions), mass_terms, carried
    )


class ObservedDof(NamedTuple):
    """Observer of a machine, and which of its dofs (0..5)."""

    observer: str
    dof: int


def slope_receptances(
    machine: CoupledSlopes,
    slope: StackedPieces,
    by_motion: ComplexArray,
    by_force: ComplexArray,
    poles: ComplexArray,
    *,
    motions: Sequence[ObservedDof],
    forces: Sequence[ObservedDof],
) -> ComplexArray:
    """Return the derivatives ``(m, f, l)`` of motions per unit force.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        by_motion: ``(n, m, l)`` free coordinates under a unit force where each motion is seen.
        by_force: ``(n, f, l)`` free coordinates under a unit force where each force acts.
        poles: ``(l,)`` ``i omega`` [rad/s]; zero at rest.
    """
    basis = machine.coupled.basis
    excited = np.tensordot(basis, by_force, axes=1)
    changes = machine.dynamic_changes(slope, *_flatten(excited, poles))
    total = -_line_products(by_motion, (basis.T @ changes).reshape(by_force.shape))
    if not (slope.observers or slope.constraints):
        return total
    stacked = np.tensordot(basis, by_motion, axes=1), excited
    for channels, answers, others, part in (
        (motions, stacked[0], stacked[1], total),
        (forces, stacked[1], stacked[0], total.transpose(1, 0, 2)),
    ):
        for index, (observer, dof) in enumerate(channels):
            if observer in slope.observers:
                part[index] += np.tensordot(slope.observers[observer][dof], others, axes=1)
        carried = machine.carried_motions(slope, _flatten(others, poles)[0])
        if carried is not None:
            rows = np.array([machine.pieces.observers[name][dof] for name, dof in channels])
            reactions = machine.dynamic_times(*_flatten(answers, poles)).reshape(answers.shape)
            part -= _line_products(reactions - rows.T[:, :, None], carried.reshape(others.shape))
    return total


def _flatten(motions: ComplexArray, poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return motions ``(n, c, l)`` as columns ``(n, c l)``, and the pole of each column."""
    return motions.reshape(len(motions), -1), np.tile(poles, motions.shape[1])


def _line_products(first: ComplexArray, second: ComplexArray) -> ComplexArray:
    """Return the sums ``(m, f, l)`` of products of ``(n, m, l)`` and ``(n, f, l)``, line by line."""
    products = first.transpose(2, 1, 0) @ second.transpose(2, 0, 1)
    return np.ascontiguousarray(products.transpose(1, 2, 0))


def slope_pole(
    machine: CoupledSlopes, slope: StackedPieces, shape: ComplexArray, pole: complex
) -> complex:
    """Return the derivative of a pole.

    Args:
        machine: The machine at the parameter's value.
        slope: Derivatives of the parts that the parameter moves.
        shape: ``(n_all,)`` complex mode shape with ``x^T (2 s M + C) x = 1``.
        pole: ``s`` [rad/s] above the real axis.

    Source: Adhikari (1999), derivatives of eigenvalues of symmetric quadratic pencils.
    """
    poles, motion = np.array([pole]), shape[:, None]
    total = complex(shape @ machine.dynamic_changes(slope, motion, poles)[:, 0])
    carried = machine.carried_motions(slope, motion)
    if carried is not None:
        total += 2.0 * complex(carried[:, 0] @ machine.dynamic_times(motion, poles)[:, 0])
    return -total
