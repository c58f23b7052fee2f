"""Mass, stiffness and damping of a coupled machine in its free coordinates."""

import functools
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, Frame, rotate_dofs
from headstock.geometry.parts.components import RayleighDamping
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    clean_stiffness,
    split_constraints,
    turn_dofs,
)
from headstock.reduction.coupling.elimination import CouplingMemo, Elimination
from headstock.reduction.coupling.joint_springs import PlacedJoint, SpringGrading
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.linear.symmetric_matrices import symmetrise

ROUNDOFF = 1e-15  # a diagonal entry below this share of the terms it is the sum of is roundoff


@dataclass(frozen=True, eq=False)
class ComponentMatrices:
    """Matrices of each component with boundary dofs in machine axes.

    Attributes:
        stiffnesses: ``(n_c, n_c)``.
        masses: ``(n_c, n_c)``.
        dampings: ``(n_c, n_c)`` of those that have any.
        rigid: ``(n_c, 6)`` dofs per rigid motion about the origin of its frame.
        constraints: ``(m, n_c)`` rows that must vanish.
        free_rotations: ``(k, n_c)`` rows that fix what the component does not resist.
    """

    stiffnesses: dict[str, FloatArray]
    masses: dict[str, FloatArray]
    dampings: dict[str, FloatArray]
    rigid: dict[str, FloatArray]
    constraints: dict[str, FloatArray]
    free_rotations: dict[str, FloatArray]


def component_matrices(
    layout: DofLayout,
    memo: CouplingMemo | None = None,
    rayleigh: Mapping[str, RayleighDamping] | None = None,
) -> ComponentMatrices:
    """Turn every superelement's matrices to machine axes, its rigid motions free of roundoff.

    Args:
        memo: Keeps matrices for the next pose; None for no memory.
        rayleigh: Damping by mass and stiffness of each component, on top of what the superelements
            bring; None for none.
    """
    memo = memo or CouplingMemo()
    parts: dict[str, _TurnedComponent] = {}
    for name, superelement in layout.superelements.items():
        placement, added = layout.placements[name], (rayleigh or {}).get(name, RayleighDamping())
        make = functools.partial(_turn_component, superelement, placement, added)
        made_of = (superelement, placement.rotation, np.array([added.alpha, added.beta]))
        parts[name] = memo.recall(f"matrices {name}", made_of, make)
    return ComponentMatrices(
        {name: part.stiffness for name, part in parts.items()},
        {name: part.mass for name, part in parts.items()},
        {name: part.damping for name, part in parts.items() if part.damping is not None},
        {name: part.rigid for name, part in parts.items()},
        {name: part.constraints for name, part in parts.items()},
        {name: part.free_rotations for name, part in parts.items()},
    )


class _TurnedComponent(NamedTuple):
    """A component in machine axes; see :class:`ComponentMatrices`."""

    stiffness: FloatArray
    mass: FloatArray
    damping: FloatArray | None
    rigid: FloatArray
    constraints: FloatArray
    free_rotations: FloatArray


def _turn_component(
    superelement: Superelement, placement: Frame, rayleigh: RayleighDamping
) -> _TurnedComponent:
    turn = turn_dofs(superelement, placement)
    stiffness = _congruence(turn, clean_stiffness(superelement))
    mass = _congruence(turn, superelement.mass)
    damping = None if superelement.damping is None else _congruence(turn, superelement.damping)
    if rayleigh:
        # constraint modes and fixed-interface modes project both matrices, so the sum is exact
        added = rayleigh.alpha * mass + rayleigh.beta * stiffness
        damping = added if damping is None else damping + added
    rigid = rigid_motions(superelement, np.zeros(3)) @ rotate_dofs(placement.rotation.T)
    effective, free_rotations = split_constraints(superelement)
    return _TurnedComponent(
        stiffness, mass, damping, turn.T @ rigid, effective @ turn, free_rotations @ turn
    )


@dataclass(frozen=True, eq=False)
class CoupledParts:
    """Components and joints of a machine in its free coordinates, whose matrices are sums over both.

    Attributes:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Of each component in machine axes.
        elimination: Free coordinates, and which spring groups each of them stretches.
        springs: Every joint, its rows in the free coordinates, ``(6, n)``.
        grading: Groups of springs of like stiffness.
        memo: Keeps the components' sums for the next pose.
    """

    layout: DofLayout
    matrices: ComponentMatrices
    elimination: Elimination
    springs: tuple[PlacedJoint, ...]
    grading: SpringGrading
    memo: CouplingMemo

    @property
    def basis(self) -> FloatArray:
        """Stacked dofs per free coordinate, ``(n_all, n)``."""
        return self.elimination.basis

    def sum_stiffness(self, weights: Mapping[str, float] | None = None) -> FloatArray:
        """Return the stiffness ``(n, n)``, each part times its weight where weights are given [N/m].

        A stiff spring enters only the coordinates that stretch its group or a stiffer one: in the
        others its row is zero but for roundoff, which times its stiffness would drown a soft spring.

        Args:
            weights: Factor by name of component and joint, such as loss factors; None for 1.
        """
        if weights is None:
            total = self._sum_components(self.matrices.stiffnesses, "stiffness")
            weights = defaultdict(lambda: 1.0)
        else:
            stiffnesses = self.matrices.stiffnesses.items()
            total = self._sum_components({name: weights[name] * part for name, part in stiffnesses})
        if not self.grading.groups:
            for spring in self.springs:
                _add_spring(total, spring, weights[spring.name] * spring.stiffness)
            symmetric = all(np.array_equal(s.stiffness, s.stiffness.T) for s in self.springs)
            return symmetrise(total) if symmetric else total
        rows = {spring.name: spring.rows for spring in self.springs}
        levels, grading = self.elimination.levels, self.grading
        for index, group in enumerate(
            (*grading.groups, grading.soft), start=1 + len(grading.deformations)
        ):
            sees = (levels > 0) & (levels <= index) if group is not grading.soft else True
            stretch = np.where(sees, [part.direction @ rows[part.joint] for part in group], 0.0)
            stiffness = np.array([weights[part.joint] * part.stiffness for part in group])
            total += stretch.T @ (stiffness[:, None] * stretch)
        return symmetrise(total)

    def sum_hysteretic(self, loss_factors: Mapping[str, float]) -> FloatArray | None:
        """Return the imaginary part ``(n, n)`` of the complex stiffness: loss factor times stiffness of
        each part [N/m]; None without any.

        Args:
            loss_factors: ``eta`` by name of component and joint.
        """
        return self.sum_stiffness(loss_factors) if any(loss_factors.values()) else None

    def sum_mass(self) -> FloatArray:
        """Return the mass ``(n, n)`` of the components."""
        return self._sum_components(self.matrices.masses, "mass")

    def sum_damping(self) -> FloatArray | None:
        """Return the viscous damping ``(n, n)`` of components and joints, or None without any."""
        dampers = [spring for spring in self.springs if np.any(spring.damping)]
        if not self.matrices.dampings and not dampers:
            return None
        total = self._sum_components(self.matrices.dampings)
        for spring in dampers:
            _add_spring(total, spring, spring.damping)
        symmetric = all(np.array_equal(s.damping, s.damping.T) for s in dampers)
        return symmetrise(total) if symmetric else total

    def _sum_components(self, matrices: Mapping[str, FloatArray], what: str = "") -> FloatArray:
        """Return ``T^T A T``; coordinates whose diagonal is roundoff of its terms are set to zero.

        The block of the coordinates that all poses share is kept in the memo under ``what``.
        """
        basis, unshared = self.basis, np.flatnonzero(~self.elimination.shared)
        shared = np.flatnonzero(self.elimination.shared)
        make = functools.partial(_sum_shared, self.layout, matrices, basis, shared)
        made_of = (basis[:, shared], shared, *matrices.values())
        kept = self.memo.recall(f"sum of {what}", made_of, make) if what else make()
        total, terms = kept.total.copy(), kept.terms.copy()
        for name, matrix in matrices.items():
            block = basis[self.layout.offsets[name]]
            columns = np.any(block != 0.0, axis=0)
            mine, others = (places[columns[places]] for places in (unshared, shared))
            if not len(mine):
                continue
            part = block[:, mine]
            moved = matrix @ part
            across = block[:, others].T @ moved
            total[np.ix_(others, mine)] += across
            total[np.ix_(mine, others)] += across.T
            total[np.ix_(mine, mine)] += part.T @ moved
            terms[mine] += _sum_terms(part, matrix)
        noise = np.abs(total.diagonal()) <= ROUNDOFF * terms
        total[noise, :] = 0.0
        total[:, noise] = 0.0
        return symmetrise(total)


def _add_spring(total: FloatArray, spring: PlacedJoint, matrix: FloatArray) -> None:
    """Add ``R^T A R`` to the dofs that a joint sees."""
    columns = np.flatnonzero(spring.rows.any(axis=0))
    acting = spring.rows[:, columns]
    total[np.ix_(columns, columns)] += acting.T @ matrix @ acting


class _SharedSum(NamedTuple):
    """Sum over components in the coordinates that all poses share, zero in the others.

    Attributes:
        total: ``(n, n)``.
        terms: ``(n,)`` sizes of what each entry on the diagonal is the sum of.
    """

    total: FloatArray
    terms: FloatArray


def _sum_shared(
    layout: DofLayout,
    matrices: Mapping[str, FloatArray],
    basis: FloatArray,
    shared: NDArray[np.intp],
) -> _SharedSum:
    total = np.zeros((basis.shape[1], basis.shape[1]))
    terms = np.zeros(basis.shape[1])
    for name, matrix in matrices.items():
        block = basis[layout.offsets[name]]
        columns = shared[np.any(block != 0.0, axis=0)[shared]]
        part = block[:, columns]
        if _is_identity(part):
            total[np.ix_(columns, columns)] += matrix
            terms[columns] += np.abs(matrix.diagonal())
            continue
        total[np.ix_(columns, columns)] += part.T @ matrix @ part
        terms[columns] += _sum_terms(part, matrix)
    return _SharedSum(total, terms)


def _sum_terms(part: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return the sizes ``(k,)`` of the terms of the diagonal of ``P^T A P``."""
    size = np.abs(part)
    return np.einsum("ij,ij->j", size, np.abs(matrix) @ size)


def _is_identity(part: FloatArray) -> bool:
    """Return whether a component's dofs are coordinates as they stand: nothing is fixed and no
    spring stands apart.
    """
    return (
        part.shape[0] == part.shape[1]
        and np.count_nonzero(part) == len(part)
        and bool((part.diagonal() == 1.0).all())
    )


def _congruence(turn: FloatArray, matrix: FloatArray) -> FloatArray:
    # axis-parallel components, which are most, need no products
    turned = matrix if _is_identity(turn) else turn.T @ matrix @ turn
    return 0.5 * (turned + turned.T)
