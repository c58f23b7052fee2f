"""Compliance at a point of a machine, and which component or joint it comes from."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.body_motions import free_motion_error, rigid_dofs
from headstock.reduction.motions.part_names import name_families
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.static_response import solve_balanced
from headstock.solvers.linear.symmetric_matrices import absolute_product

BUDGET_LIMIT = 1e-9
LARGEST_MISS = 1e-4  # of the work, whatever rounding may leave
ROUNDOFF = 4.0 * float(np.finfo(float).eps)
WEIGHT = (
    "own weight"  # the share of gravity stiffening: negative where weight makes a machine softer
)


@dataclass(frozen=True, eq=False)
class PointBudget:
    """Compliance of the tool against the work, and its make-up.

    Attributes:
        compliance: ``(6, 6)`` motion per unit load [m/N, rad/N, m/(N m), rad/(N m)], machine axes;
            NaN where the load does work on a free motion of the machine, or the motion is part of
            one, and for the rotations of a sensor.
        shares: For x, y and z the share of each component and joint in that direction's compliance;
            each sums to 1. Empty for a direction in which nothing deforms.
        displacements: ``(n, 6)`` responses to the unit loads; zero where there is none.
        free: The machine has free motions that loads at the point do work on.
    """

    compliance: FloatArray
    shares: dict[str, dict[str, float]]
    displacements: FloatArray
    free: bool = False


@dataclass(frozen=True)
class WeakLink:
    """The component, joint or family of numbered joints with the largest share.

    Attributes:
        name: Its name, such as ``y_base`` or ``z_carriage_1..4``.
        direction: ``x``, ``y`` or ``z``.
        change: Relative change of the compliance when its stiffness is doubled, recomputed.
    """

    name: str
    direction: str
    share: float
    change: float
    plural: bool = False

    def __str__(self) -> str:
        return (
            f"{self.name} {'contribute' if self.plural else 'contributes'} {100.0 * self.share:.0f} % of the {self.direction} compliance; "
            f"doubling {'their' if self.plural else 'its'} stiffness changes it by {100.0 * self.change:+.0f} %"
        )


def point_loads(coupled: CoupledMachine, point: str) -> FloatArray:
    """Return the generalised loads ``(n, 6)`` of unit forces and moments on the tool, opposite ones
    on the work, machine axes; zero for moments at a sensor.

    Raises:
        ModelError: There is no such point.
    """
    if (point, "x") not in coupled.system.inputs:
        names = sorted({name for name, _ in coupled.system.inputs})
        raise ModelError(f"there is no point {point!r}; points and interfaces: {names}")
    return motions_at(coupled.system.inputs, point).T


def motions_at(channels: Mapping[tuple[str, str], FloatArray], point: str) -> FloatArray:
    """Return the rows ``(6, n)`` of a point, sensor or interface; zero for rotations of a sensor."""
    nothing = np.zeros_like(channels[point, "x"])
    return np.array([channels.get((point, dof), nothing) for dof in DOF_NAMES])


def point_compliance(coupled: CoupledMachine, point: str) -> FloatArray:
    """Return the static compliance ``(6, 6)`` at a point: motion of the tool relative to the work
    per unit load between them.

    Raises:
        ModelError: There is no such point, or every force there does work on a free motion of the
            machine.
    """
    return _solve_point(coupled, point)[0]


def point_budget(coupled: CoupledMachine, point: str) -> PointBudget:
    """Return the compliance at a point with the share of every component and joint by strain
    energy.

    Under a unit load the compliance is twice the strain energy (Clapeyron 1833), which is a sum
    over components and joints, and over what the weight does where it stiffens.

    Raises:
        ModelError: There is no such point, or every force there does work on a free motion of the
            machine.
        AccuracyError: The energies do not add up to the work of the load.
    """
    compliance, displacements = _solve_point(coupled, point)
    shares: dict[str, dict[str, float]] = {}
    moved = displacements[:, : len(DIRECTIONS)]
    energies = strain_energies(coupled, moved)
    if coupled.geometric is not None:
        energies[WEIGHT] = 0.5 * weight_energy(coupled, moved, moved)
    for i, direction in enumerate(DIRECTIONS):
        energies_now = {name: float(values[i]) for name, values in energies.items()}
        # a load that does work on a free motion has no answer, so nothing has a share in it
        work = 0.5 * float(np.nan_to_num(compliance[i, i]))
        shares[direction] = _shares(
            energies_now, work, _roundoff(coupled, displacements[:, i]), f"{point} {direction}"
        )
    count = len(DOF_NAMES) if turns_at(coupled, point) else len(DIRECTIONS)
    free = bool(np.isnan(compliance[:count, :count]).any())
    return PointBudget(compliance, shares, displacements, free)


def turns_at(coupled: CoupledMachine, point: str) -> bool:
    """Tell whether rotations are known there: not at a sensor."""
    return (point, DOF_NAMES[-1]) in coupled.system.outputs


def _solve_point(coupled: CoupledMachine, point: str) -> tuple[FloatArray, FloatArray]:
    """Return the compliance ``(6, 6)``, NaN where a free motion makes it undetermined and for the
    rotations of a sensor, and displacements ``(n, 6)``.
    """
    result = solve_balanced(coupled.system, point_loads(coupled, point))
    if not result.balanced[: len(DIRECTIONS)].any():
        raise free_motion_error(coupled)
    rows = motions_at(coupled.system.outputs, point)
    determined = result.determines(rows)[:, None] & result.balanced
    if not turns_at(coupled, point):
        determined[:, len(DIRECTIONS) :] = determined[len(DIRECTIONS) :] = False
    return np.where(determined, rows @ result.displacements, np.nan), result.displacements


def strain_energies(coupled: CoupledMachine, displacements: FloatArray) -> dict[str, FloatArray]:
    """Return the strain energy ``(m,)`` [J] of each component and joint for generalised
    displacements ``(n, m)``; rigid ones are left out.
    """
    return {
        name: 0.5 * energy
        for name, energy in mutual_energies(coupled, displacements, displacements).items()
    }


def mutual_energies(
    coupled: CoupledMachine, first: FloatArray, second: FloatArray
) -> dict[str, FloatArray]:
    """Return ``p^T K q`` ``(m,)`` [J] of each component and joint for pairs of displacements
    ``(n, m)``; rigid ones are left out.
    """
    same = first is second
    one = coupled.basis @ first
    other = one if same else coupled.basis @ second
    energies = {}
    for name, stiffness in coupled.matrices.stiffnesses.items():
        if stiffness.any():
            dofs = coupled.offsets[name]
            left = _deformation(coupled, name, one[dofs])
            right = left if same else _deformation(coupled, name, other[dofs])
            energies[name] = np.einsum("im,im->m", left, stiffness @ right)
    for spring in coupled.joint_springs:
        if np.any(spring.stiffness):
            stretch = spring.rows @ first
            answer = stretch if same else spring.rows @ second
            energies[spring.name] = np.einsum("im,im->m", stretch, spring.stiffness @ answer)
    return energies


def weight_energy(coupled: CoupledMachine, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return ``p^T K q`` ``(m,)`` [J] of the geometric stiffness of gravity for pairs of
    displacements ``(n, m)``; zero without the effect.
    """
    if coupled.geometric is None:
        return np.zeros(first.shape[1])
    moved = coupled.geometric @ (coupled.basis @ second)
    return np.einsum("im,im->m", coupled.basis @ first, moved)


def _deformation(coupled: CoupledMachine, name: str, motion: FloatArray) -> FloatArray:
    """Return a component's dofs less the rigid motion of its first node: strains nothing, and would
    only cost digits.
    """
    superelement = coupled.layout.superelements[name]
    if superelement.supported or not superelement.frames:
        return motion
    placement = coupled.placements[name]
    first = placement.origin + placement.rotation @ superelement.frames[0].origin
    return motion - rigid_dofs(coupled, name, first) @ motion[:6]


def _kinetic_energies(coupled: CoupledMachine, shape: FloatArray) -> dict[str, float]:
    """Return ``q^T M q / 2`` of each component for a shape ``(n,)``: its kinetic energy at unit
    angular frequency.
    """
    stacked = coupled.basis @ shape
    parts = {name: stacked[coupled.offsets[name]] for name in coupled.offsets}
    return {
        name: 0.5 * float(motion @ coupled.matrices.masses[name] @ motion)
        for name, motion in parts.items()
    }


def energy_shares(
    coupled: CoupledMachine, shapes: FloatArray
) -> tuple[tuple[dict[str, float], ...], tuple[dict[str, float], ...]]:
    """Return the shares of strain energy (components and joints) and of kinetic energy (components)
    for each mode shape ``(n, m)``.

    A rigid-body mode has no strain energy and an empty strain share.
    """
    strain, kinetic = [], []
    table = strain_energies(coupled, shapes)
    for number in range(shapes.shape[1]):
        shape = shapes[:, number]
        energies = {name: float(values[number]) for name, values in table.items()}
        terms = 0.5 * float(np.abs(shape) @ absolute_product(coupled.system.stiffness, shape))
        strained = sum(energies.values()) > len(shape) * np.finfo(float).eps * terms
        strain.append(_normalised(energies) if strained else {})
        kinetic.append(_normalised(_kinetic_energies(coupled, shape)))
    return tuple(strain), tuple(kinetic)


def find_weakest_link(
    coupled: CoupledMachine, point: str, direction: str, budget: PointBudget | None = None
) -> WeakLink | None:
    """Find the part that gives most of the compliance in a direction, and what doubling its
    stiffness would change.

    Joints and components whose names differ by a number only, such as the carriages of one guide,
    count as one part.

    Args:
        direction: ``x``, ``y`` or ``z``.
        budget: The point's budget where it is already known.

    Returns:
        None where nothing deforms in that direction, or one part alone.
    """
    budget = budget or point_budget(coupled, point)
    shares = {name: share for name, share in budget.shares[direction].items() if name != WEIGHT}
    if len(shares) < 2:
        return None
    families = name_families(shares)
    totals = {family: sum(shares[name] for name in members) for family, members in families.items()}
    largest = min(totals, key=lambda family: (-round(totals[family], 9), family))
    members = families[largest]
    axis = DIRECTIONS.index(direction)
    load = coupled.system.inputs[point, direction]
    row = coupled.system.outputs[point, direction]
    stiffness = coupled.system.stiffness.copy()
    for name in members:
        _add_stiffness(stiffness, coupled, name)
    stiffened = dataclasses.replace(coupled.system, stiffness=stiffness)
    changed = float(row @ solve_balanced(stiffened, load[:, None]).displacements[:, 0])
    change = changed / float(budget.compliance[axis, axis]) - 1.0
    return WeakLink(
        largest,
        direction,
        totals[largest],
        change,
        len(members) > 1,
    )


def _add_stiffness(total: FloatArray, coupled: CoupledMachine, name: str) -> None:
    """Add to a stiffness ``(n, n)`` what a component or joint adds to it."""
    if name in coupled.matrices.stiffnesses:
        rows, stiffness = coupled.basis[coupled.offsets[name]], coupled.matrices.stiffnesses[name]
    else:
        spring = next(spring for spring in coupled.joint_springs if spring.name == name)
        rows, stiffness = spring.rows, spring.stiffness
    columns = np.flatnonzero(rows.any(axis=0))
    total[np.ix_(columns, columns)] += rows[:, columns].T @ stiffness @ rows[:, columns]


def _roundoff(coupled: CoupledMachine, displacement: FloatArray) -> float:
    """Return what rounding leaves of the strain energy [J] of a displacement ``(n,)``: in a long
    slender machine parts move far and strain little, and a compact body of thin segments is stiff
    for how far it is carried along.
    """
    size = np.abs(displacement)
    energy = float(size @ absolute_product(coupled.system.stiffness, size))
    for name, stiffness in coupled.matrices.stiffnesses.items():
        moved = np.abs(coupled.basis[coupled.offsets[name]] @ displacement)
        energy += float(moved @ absolute_product(stiffness, moved))
    return ROUNDOFF * energy


def _shares(
    energies: dict[str, float], work: float, roundoff: float, what: str
) -> dict[str, float]:
    """Return the energies over the work of the load, which they must add up to but for rounding."""
    if not work > 0.0:
        return {}
    error = abs(sum(energies.values()) / work - 1.0)
    limit = min(max(BUDGET_LIMIT, roundoff / work), LARGEST_MISS)
    if not error <= limit:
        raise AccuracyError(
            f"compliance budget of {what}: the strain energies miss the work of the load by {error:.2g}, limit {limit:.2g}; "
            "look for joint stiffnesses that differ by more than 14 decades"
        )
    return {name: energy / work for name, energy in energies.items()}


def _normalised(energies: dict[str, float]) -> dict[str, float]:
    total = sum(energies.values())
    return {name: energy / total for name, energy in energies.items()} if total > 0.0 else {}
