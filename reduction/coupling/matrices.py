"""Mass, stiffness and damping of a coupled machine in its free coordinates, and a memo of what
poses of the same superelements share.

A memo changes no result: a coupling with one gives the numbers of a coupling without, whatever was
coupled before.
"""

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.components import RayleighDamping
from headstock.reduction.coupling.dof_layout import DofLayout, clean_stiffness, turn_dofs
from headstock.reduction.coupling.elimination import Elimination
from headstock.reduction.coupling.joint_springs import PlacedJoint, SpringGrading
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.symmetric_matrices import symmetrise

ROUNDOFF = 1e-15  # a diagonal entry below this share of the terms it is the sum of is roundoff


@dataclass(eq=False)
class CouplingMemo:
    """What was made last under each name, with what it was made of.

    Attributes:
        channels: Names of the points and interfaces that are loaded and observed; None for all.
    """

    channels: Collection[str] | None = None
    _kept: dict[str, tuple[tuple[object, ...], Any]] = field(default_factory=dict)

    def recall[T](self, name: str, made_of: tuple[object, ...], make: Callable[[], T]) -> T:
        """A value made anew, or that of the last call of this name where it was made of the same:
        arrays equal, the rest identical.

        Args:
            name: One per kind of value.
            made_of: All that the value depends on.
            make: Makes the value; it must depend on nothing else.
        """
        kept = self._kept.get(name)
        if kept is not None and len(kept[0]) == len(made_of) and all(map(_same, kept[0], made_of)):
            value: T = kept[1]
            return value
        made = make()
        self._kept[name] = (made_of, made)
        return made


def _same(one: object, other: object) -> bool:
    return one is other or (
        isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.array_equal(one, other)
    )


@dataclass(frozen=True, eq=False)
class ComponentMatrices:
    """Matrices of each component with boundary dofs in machine axes."""

    stiffnesses: dict[str, FloatArray]
    masses: dict[str, FloatArray]
    dampings: dict[str, FloatArray]


def component_matrices(
    layout: DofLayout,
    memo: CouplingMemo | None = None,
    rayleigh: Mapping[str, RayleighDamping] | None = None,
) -> ComponentMatrices:
    """Turn every superelement's matrices to machine axes, its rigid motions free of roundoff.

    Args:
        layout: Placed superelements.
        memo: Keeps matrices for the next pose; None for no memory.
        rayleigh: Damping by mass and stiffness of each component, on top of what the superelements
            bring; None for none.
    """
    memo = memo or CouplingMemo()
    stiffnesses, masses, dampings = {}, {}, {}
    for name, superelement in layout.superelements.items():
        placement, added = layout.placements[name], (rayleigh or {}).get(name, RayleighDamping())
        make = functools.partial(_turned_matrices, superelement, placement, added)
        made_of = (superelement, placement.rotation, np.array([added.alpha, added.beta]))
        stiffnesses[name], masses[name], damping = memo.recall(f"matrices {name}", made_of, make)
        if damping is not None:
            dampings[name] = damping
    return ComponentMatrices(stiffnesses, masses, dampings)


class _TurnedMatrices(NamedTuple):
    """Matrices ``(n, n)`` of a component in machine axes."""

    stiffness: FloatArray
    mass: FloatArray
    damping: FloatArray | None


def _turned_matrices(
    superelement: Superelement, placement: Frame, rayleigh: RayleighDamping
) -> _TurnedMatrices:
    turn = turn_dofs(superelement, placement)
    stiffness = _congruence(turn, clean_stiffness(superelement))
    mass = _congruence(turn, superelement.mass)
    damping = None if superelement.damping is None else _congruence(turn, superelement.damping)
    if rayleigh:
        # constraint modes and fixed-interface modes project both matrices, so the sum is exact
        added = rayleigh.alpha * mass + rayleigh.beta * stiffness
        damping = added if damping is None else damping + added
    return _TurnedMatrices(stiffness, mass, damping)


def sum_stiffness(
    layout: DofLayout,
    matrices: ComponentMatrices,
    elimination: Elimination,
    springs: Sequence[PlacedJoint],
    grading: SpringGrading,
    weights: Mapping[str, float] | None = None,
    memo: CouplingMemo | None = None,
) -> FloatArray:
    """Stiffness ``(n, n)`` of components and joints, each times its weight where weights are given.

    A stiff spring enters only the coordinates that stretch its group or a stiffer one: in the
    others its row is zero but for roundoff, which times its stiffness would drown a soft spring.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Matrices of each component in machine axes.
        elimination: Free coordinates, and which spring groups each of them stretches.
        springs: Every joint, its rows already in the free coordinates, ``(6, n)``.
        grading: Groups of springs of like stiffness.
        weights: Factor by name of component and joint, such as loss factors; None for 1.
        memo: Keeps the components' sum for the next pose; None for no memory. Not used with
            weights.
    """
    weigh = _unit_weight if weights is None else weights.__getitem__
    basis = elimination.basis
    if weights is None:
        total = _recall_sum(layout, matrices.stiffnesses, basis, "stiffness", memo).copy()
    else:
        total = _sum_components(
            layout, {name: weigh(name) * part for name, part in matrices.stiffnesses.items()}, basis
        )
    if not grading.groups:
        for spring in springs:
            _add_spring(total, spring, weigh(spring.name) * spring.stiffness)
        return _symmetric_if(
            total, all(np.array_equal(s.stiffness, s.stiffness.T) for s in springs)
        )
    rows = {spring.name: spring.rows for spring in springs}
    for index, group in enumerate(
        (*grading.groups, grading.soft), start=1 + len(grading.deformations)
    ):
        sees = (
            (elimination.levels > 0) & (elimination.levels <= index)
            if group is not grading.soft
            else True
        )
        stretch = np.where(sees, [part.direction @ rows[part.joint] for part in group], 0.0)
        total += stretch.T @ (
            np.array([weigh(part.joint) * part.stiffness for part in group])[:, None] * stretch
        )
    return symmetrise(total)


def sum_hysteretic(
    layout: DofLayout,
    matrices: ComponentMatrices,
    elimination: Elimination,
    springs: Sequence[PlacedJoint],
    grading: SpringGrading,
    loss_factors: Mapping[str, float],
) -> FloatArray | None:
    """Imaginary part ``(n, n)`` of the complex stiffness: loss factor times stiffness of each part
    [N/m]; None without any.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Matrices of each component in machine axes.
        elimination: Free coordinates, and which spring groups each of them stretches.
        springs: Every joint, its rows already in the free coordinates, ``(6, n)``.
        grading: Groups of springs of like stiffness.
        loss_factors: ``eta`` by name of component and joint.
    """
    if not any(loss_factors.values()):
        return None
    return sum_stiffness(layout, matrices, elimination, springs, grading, loss_factors)


def sum_mass(
    layout: DofLayout,
    matrices: ComponentMatrices,
    basis: FloatArray,
    memo: CouplingMemo | None = None,
) -> FloatArray:
    """Mass ``(n, n)`` of the components.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Matrices of each component in machine axes.
        basis: ``(n_all, n)`` stacked dofs per free coordinate.
        memo: Keeps the sum for the next pose; None for no memory.
    """
    return _recall_sum(layout, matrices.masses, basis, "mass", memo)


def _recall_sum(
    layout: DofLayout,
    matrices: Mapping[str, FloatArray],
    basis: FloatArray,
    what: str,
    memo: CouplingMemo | None,
) -> FloatArray:
    make = functools.partial(_sum_components, layout, matrices, basis)
    return (
        make() if memo is None else memo.recall(f"sum of {what}", (basis, *matrices.values()), make)
    )


def sum_damping(
    layout: DofLayout,
    matrices: ComponentMatrices,
    basis: FloatArray,
    springs: Sequence[PlacedJoint],
) -> FloatArray | None:
    """Viscous damping ``(n, n)`` of components and joints, or None without any.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Matrices of each component in machine axes.
        basis: ``(n_all, n)`` stacked dofs per free coordinate.
        springs: Every joint, its rows already in the free coordinates, ``(6, n)``.
    """
    dampers = [spring for spring in springs if np.any(spring.damping)]
    if not matrices.dampings and not dampers:
        return None
    total = _sum_components(layout, matrices.dampings, basis)
    for spring in dampers:
        _add_spring(total, spring, spring.damping)
    return _symmetric_if(total, all(np.array_equal(s.damping, s.damping.T) for s in dampers))


def _add_spring(total: FloatArray, spring: PlacedJoint, matrix: FloatArray) -> None:
    """Add ``R^T A R`` to the dofs that a joint sees."""
    seen = np.flatnonzero(spring.rows.any(axis=0))
    acting = spring.rows[:, seen]
    total[np.ix_(seen, seen)] += acting.T @ matrix @ acting


def _sum_components(
    layout: DofLayout, matrices: Mapping[str, FloatArray], basis: FloatArray
) -> FloatArray:
    """``T^T A T``; coordinates whose diagonal is roundoff of its terms are set to zero."""
    total = np.zeros((basis.shape[1], basis.shape[1]))
    terms = np.zeros(basis.shape[1])
    for name, matrix in matrices.items():
        block = basis[layout.offsets[name]]
        columns = np.flatnonzero(np.any(block != 0.0, axis=0))
        part = block[:, columns]
        if _is_identity(part):
            total[np.ix_(columns, columns)] += matrix
            terms[columns] += np.abs(matrix.diagonal())
            continue
        total[np.ix_(columns, columns)] += part.T @ matrix @ part
        magnitude = np.abs(part)
        terms[columns] += np.einsum("ij,ij->j", magnitude, np.abs(matrix) @ magnitude)
    noise = np.abs(total.diagonal()) <= ROUNDOFF * terms
    total[noise, :] = 0.0
    total[:, noise] = 0.0
    return symmetrise(total)


def _is_identity(part: FloatArray) -> bool:
    """Whether a component's dofs are coordinates as they stand: nothing is fixed and no spring
    stands apart.
    """
    return (
        part.shape[0] == part.shape[1]
        and np.count_nonzero(part) == len(part)
        and bool((part.diagonal() == 1.0).all())
    )


def _unit_weight(name: str) -> float:
    return 1.0


def _congruence(turn: FloatArray, matrix: FloatArray) -> FloatArray:
    # axis-parallel components, which are most, need no products
    turned = matrix if _is_identity(turn) else turn.T @ matrix @ turn
    return np.asarray(0.5 * (turned + turned.T))


def _symmetric_if(matrix: FloatArray, symmetric: bool) -> FloatArray:
    return symmetrise(matrix) if symmetric else matrix
