"""The parts a coupled machine is put together from, in stacked dofs, before any coordinate is eliminated.

They are smooth functions of every dimension, stiffness and place in the scene, which coordinates and mode shapes are not:
differences are taken of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.dof_layout import DofLayout, locate_interface, motion_rows, split_constraints, turn_dofs
from headstock.reduction.coupling.joint_springs import place_joint
from headstock.reduction.coupling.matrices import component_matrices
from headstock.reduction.coupling.ports import point_rows
from headstock.reduction.superelement_checks import rigid_motions


@dataclass(frozen=True, eq=False)
class StackedPieces:
    """Parts of a machine, or the derivatives of those parts that a parameter moves.

    Attributes:
        stiffnesses: By component, ``(n_c, n_c)`` in machine axes.
        masses: By component, ``(n_c, n_c)`` in machine axes.
        rows: By joint, ``(6, n_all)`` relative motion in joint axes.
        springs: By joint, ``(6, 6)`` in joint axes.
        constraints: By what holds (``component a``, ``joint b``), rows ``(m, n_all)`` that must vanish.
        observers: By point, interface (``component.interface``) or component (its mean rigid motion at the centre of mass),
            rows ``(6, n_all)`` of the motion there in machine axes.
    """

    stiffnesses: dict[str, FloatArray]
    masses: dict[str, FloatArray]
    rows: dict[str, FloatArray]
    springs: dict[str, FloatArray]
    constraints: dict[str, FloatArray]
    observers: dict[str, FloatArray]


@dataclass(frozen=True)
class Selection:
    """Which parts are wanted: components, joints and observers by name."""

    components: tuple[str, ...]
    joints: tuple[str, ...]
    observers: tuple[str, ...]


def stack_pieces(layout: DofLayout, machine: Machine, wanted: Selection) -> StackedPieces:
    """The wanted parts of a machine as placed.

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
    constraints = {f"component {name}": _component_constraints(layout, name) for name in wanted.components}
    constraints |= {f"joint {spring.name}": spring.rows[list(spring.held)] for spring in joints}
    return StackedPieces(
        stiffnesses=matrices.stiffnesses,
        masses=matrices.masses,
        rows={spring.name: spring.rows for spring in joints},
        springs={spring.name: spring.stiffness for spring in joints},
        constraints=constraints,
        observers={name: observer_rows(layout, machine, name) for name in wanted.observers},
    )


def difference_pieces(pairs: Sequence[tuple[StackedPieces, StackedPieces, float]]) -> StackedPieces:
    """Sum of ``weight (after - before)`` over pairs of pieces that hold the same parts; what is equal gives exact zeros."""

    def subtract(pick: Callable[[StackedPieces], Mapping[str, FloatArray]]) -> dict[str, FloatArray]:
        tables = [(pick(after), pick(before), weight) for after, before, weight in pairs]
        return {name: np.sum([w * (after[name] - before[name]) for after, before, w in tables], axis=0) for name in tables[0][0]}

    return StackedPieces(
        stiffnesses=subtract(lambda part: part.stiffnesses),
        masses=subtract(lambda part: part.masses),
        rows=subtract(lambda part: part.rows),
        springs=subtract(lambda part: part.springs),
        constraints=subtract(lambda part: part.constraints),
        observers=subtract(lambda part: part.observers),
    )


def observer_rows(layout: DofLayout, machine: Machine, name: str) -> FloatArray:
    """Rows ``(6, n_all)`` of the motion of a point, an interface or a component.

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
    felt, _ = split_constraints(superelement)  # what nothing feels changes no frequency
    rows = np.zeros((len(felt), layout.size))
    rows[:, layout.offsets[name]] = felt @ turn_dofs(superelement, layout.placements[name])
    return rows


def _mean_motion_rows(layout: DofLayout, name: str) -> FloatArray:
    """Rigid motion nearest to that of a component in the norm of its mass matrix, at its centre of mass."""
    superelement, placement = layout.superelements[name], layout.placements[name]
    motions = rigid_motions(superelement, superelement.center_of_mass)
    weighed = motions.T @ superelement.mass
    turn = rotate_dofs(placement.rotation)
    rows = np.zeros((6, layout.size))
    own = turn @ np.linalg.solve(weighed @ motions, weighed)
    rows[:, layout.offsets[name]] = own @ turn_dofs(superelement, placement)
    return rows
