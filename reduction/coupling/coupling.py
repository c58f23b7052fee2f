"""Superelements and joints of a machine in one pose, coupled to one second-order system."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.components import RayleighDamping
from headstock.reduction.coupling.channels import machine_channels, machine_loads
from headstock.reduction.coupling.coupled_shapes import ShapeRows, couple_shapes
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    label_dofs,
    lay_out_dofs,
    scale_dofs,
)
from headstock.reduction.coupling.elimination import (
    CouplingMemo,
    Elimination,
    eliminate_constraints,
)
from headstock.reduction.coupling.gravity_stiffness import find_gravity_stiffness, warn_of_stress
from headstock.reduction.coupling.guide_errors import (
    GUIDE_ERRORS,
    ErrorLoads,
    FixedRows,
    find_displacements,
    find_offsets,
    find_places,
    has_errors,
    solve_error_loads,
    warn_of_held_displacements,
)
from headstock.reduction.coupling.joint_springs import (
    PlacedJoint,
    express_in_free_coordinates,
    find_floating_groups,
    grade_springs,
    place_joints,
)
from headstock.reduction.coupling.matrices import (
    ComponentMatrices,
    CoupledParts,
    component_matrices,
)
from headstock.reduction.superelement import Superelement
from headstock.solvers.linear.symmetric_matrices import require_standing
from headstock.solvers.second_order import SecondOrderSystem

LOCAL_SHARE = 0.99
EQUAL_SHARES = 1e-9  # shares of a coordinate that differ by less are equal: the first names it
FREE_ROTATION_TOLERANCE = 1e-12
LOOSE_LEVEL = 1e-9  # of the largest singular value of free rotations in the rows of joints


@dataclass(frozen=True, eq=False)
class CoupledMachine:
    """A machine in one pose as a second-order system.

    Attributes:
        system: What the analyses take; inputs and outputs for every interface (``"column.top"``,
            motion in machine axes) and every point (``"tcp"``, tool relative to work at the tool).
        basis: ``(n_all, n)`` stacked dofs per free coordinate.
        layout: Where each component's dofs sit in the stacked vector.
        matrices: Matrices of each component in machine axes, for energies.
        joint_springs: Joints with their rows in free coordinates ``(6, n)``.
        loads: Load name to generalised load ``(n,)``.
        floating: Groups of components that no joint or support connects to ground.
        redundant_constraints: Number of fixed motions that others already hold.
        fixed: What was eliminated.
        errors: What the errors of guides and drives do, together the load ``guide_errors``; None
            without any.
        displaced: What prescribed displacements do, each a load of its name; None without any.
        geometric: ``(n_all, n_all)`` stiffness of the machine's weight in stacked dofs, which the
            system has; None where it does not count.
        rayleigh: Damping by mass and stiffness of each component, which the system has.
    """

    system: SecondOrderSystem
    basis: FloatArray
    layout: DofLayout
    matrices: ComponentMatrices
    joint_springs: tuple[PlacedJoint, ...]
    loads: dict[str, FloatArray]
    floating: tuple[tuple[str, ...], ...]
    redundant_constraints: int
    warnings: tuple[str, ...]
    fixed: FixedRows
    errors: ErrorLoads | None = None
    geometric: FloatArray | None = None
    displaced: ErrorLoads | None = None
    rayleigh: Mapping[str, RayleighDamping] = field(default_factory=dict)

    @property
    def offset(self) -> FloatArray:
        """Motion ``(n_all,)`` of the stacked dofs by fixed directions that all loads together
        displace, at zero free coordinates.
        """
        size = self.layout.size
        sources = [source for source in (self.errors, self.displaced) if source is not None]
        return np.sum([np.zeros(size), *(source.offset(size) for source in sources)], axis=0)

    @property
    def offsets(self) -> dict[str, slice]:
        """Slice of each component in the stacked vector."""
        return self.layout.offsets

    @property
    def placements(self) -> Mapping[str, Frame]:
        """Frame of each component in the machine frame."""
        return self.layout.placements


def couple(
    superelements: Mapping[str, Superelement],
    machine: Machine,
    pose: Pose,
    *,
    gravity: FloatArray | None = None,
    memo: CouplingMemo | None = None,
    geometric: FloatArray | None = None,
) -> CoupledMachine:
    """Place the superelements in a pose and tie them together at the joints.

    Fixed joint dofs and superelement constraints are eliminated by an orthonormal null space; joint
    stiffness acts between the two ends carried to the joint point by rigid levers. Where springs
    differ by more than 1e4 the stiff relative motions become coordinates of their own, so that no
    digit of a soft mount is lost next to a stiff bolt; no stiffness is changed.

    Args:
        machine: Its joints, points, axes, loads and placements.
        gravity: ``(3,)`` acceleration in machine axes [m/s^2] to make a load ``gravity`` of, or
            None.
        memo: What the poses of a sweep share; the result is the same without.
        geometric: ``(n_all, n_all)`` geometric stiffness of a machine in the same pose that stands
            by itself, where this one is held by its drives; None to find it here.

    Raises:
        ModelError: A joint, point or load names what does not exist, or a joint matrix is not
            finite.
        AccuracyError: A component resists rigid motions without being marked as supported.
        ValueError: The pose names an unknown axis or leaves its limits.
    """
    memo = memo or CouplingMemo()
    # components and joints where the pose puts them
    placements = place_components(machine, pose)
    layout = lay_out_dofs(superelements, {name: placements[name] for name in superelements})
    rayleigh = sum_rayleigh(machine, superelements)
    matrices = component_matrices(layout, memo, rayleigh)
    springs = place_joints(machine, layout)
    shapes = couple_shapes(machine, layout)
    # what may not move, and the coordinates that this leaves free
    fixed = _list_fixed_rows(layout, matrices, springs, shapes)
    parts = _free_parts(layout, matrices, fixed, memo)
    # what acts
    loads = machine_loads(layout, machine, matrices, parts.basis, gravity)
    errors = displaced = None
    if has_errors(machine):
        places = find_places(machine, pose.positions, layout, springs)
        errors = solve_error_loads(find_offsets(machine, places), parts, fixed)
        loads[GUIDE_ERRORS] = errors.load
    if machine.displacements:
        displaced = solve_error_loads(find_displacements(machine, springs), parts, fixed)
        loads |= displaced.loads
    # how it answers
    system, stiffened = _sum_system(machine, parts), None
    if machine.gravity_stiffening:
        system, stiffened = _stiffen_by_gravity(system, machine, parts, fixed, geometric)
    floating = find_floating_groups(
        machine, {name: part.supported for name, part in superelements.items()}
    )
    return CoupledMachine(
        system=system,
        basis=parts.basis,
        layout=layout,
        matrices=matrices,
        joint_springs=parts.springs,
        loads=loads,
        floating=floating,
        redundant_constraints=len(parts.elimination.redundant),
        warnings=(
            *parts.grading.warnings,
            *shapes.warnings,
            *_redundancy_warnings(parts.elimination, fixed.sources),
            *(
                f"{' + '.join(group)} float(s): no joint or support connects to ground"
                for group in floating
                if not all(machine.components[name].free for name in group)
            ),
            *warn_of_held_displacements(machine, parts.springs),
            *(warn_of_stress(machine, layout) if machine.gravity_stiffening else ()),
        ),
        errors=errors,
        displaced=displaced,
        rayleigh=rayleigh,
        geometric=stiffened,
        fixed=fixed,
    )


def _free_parts(
    layout: DofLayout, matrices: ComponentMatrices, fixed: FixedRows, memo: CouplingMemo
) -> CoupledParts:
    """Return components and joints in the coordinates that the fixed rows leave free, stiff relative
    motions apart from compliant ones.
    """
    grading = grade_springs(fixed.springs, layout, matrices.stiffnesses, memo)
    elimination = eliminate_constraints(
        fixed.constraints,
        grading.group_rows(fixed.springs),
        scale_dofs(layout),
        shared_groups=len(grading.deformations),
        memo=memo,
    )
    springs = tuple(express_in_free_coordinates(spring, elimination) for spring in fixed.springs)
    return CoupledParts(layout, matrices, elimination, springs, grading, memo)


def _sum_system(machine: Machine, parts: CoupledParts) -> SecondOrderSystem:
    """Return the equations of motion, with every point and interface as input and output."""
    layout, basis, memo = parts.layout, parts.basis, parts.memo
    channels = machine_channels(layout, machine, basis, memo.channels)
    loss_factors = {name: machine.components[name].material.loss_factor for name in layout.offsets}
    loss_factors |= {name: joint.loss_factor for name, joint in machine.joints.items()}
    return SecondOrderSystem(
        mass=parts.sum_mass(),
        damping=parts.sum_damping(),
        stiffness=parts.sum_stiffness(),
        inputs=channels,
        outputs=channels,
        labels=memo.recall(
            "labels",
            (basis, *layout.superelements.values()),
            lambda: _label_coordinates(layout, basis),
        ),
        hysteretic=parts.sum_hysteretic(loss_factors),
    )


def _stiffen_by_gravity(
    system: SecondOrderSystem,
    machine: Machine,
    parts: CoupledParts,
    fixed: FixedRows,
    geometric: FloatArray | None,
) -> tuple[SecondOrderSystem, FloatArray]:
    """Return the system with the geometric stiffness of the machine's weight, and that in stacked
    dofs ``(n_all, n_all)``; see ``couple``.
    """
    stacked = geometric
    if stacked is None:
        stacked = find_gravity_stiffness(system, machine, parts, fixed)
    added = parts.basis.T @ stacked @ parts.basis
    if geometric is None:  # otherwise drives hold what springs alone do not
        require_standing(system.stiffness, added)
    return dataclasses.replace(system, stiffness=system.stiffness + added), stacked


def sum_rayleigh(
    machine: Machine, superelements: Mapping[str, Superelement]
) -> dict[str, RayleighDamping]:
    """Return the Rayleigh damping of every component: that of the component and of the machine."""
    whole = machine.rayleigh
    parts = {name: machine.components[name].rayleigh for name in superelements}
    return {
        name: RayleighDamping(whole.alpha + part.alpha, whole.beta + part.beta)
        for name, part in parts.items()
    }


def _list_fixed_rows(
    layout: DofLayout,
    matrices: ComponentMatrices,
    springs: tuple[PlacedJoint, ...],
    shapes: ShapeRows,
) -> FixedRows:
    """Return the rows ``(m, n_all)`` that must vanish. Shared interfaces first: joints count as
    redundant.

    A dof of an interface that its component does not resist (the rotation of a line about itself,
    of a point mass about any axis) is fixed only if no joint acts on it: otherwise it follows what
    it is joined to.
    """
    rows: list[FloatArray] = [np.zeros((0, layout.size))]
    sources: list[str] = []
    acting = [
        row
        for spring in springs
        for row in (*spring.rows[list(spring.fixed)], *(spring.stiffness @ spring.rows))
    ]
    joined = np.array(acting).reshape(len(acting), layout.size)
    for name, effective in matrices.constraints.items():
        free_rotations = matrices.free_rotations[name]
        joint_rotations = joined[:, layout.offsets[name]] @ free_rotations.T
        component_rows = np.vstack(
            [effective, _find_loose_rotations(joint_rotations) @ free_rotations]
        )
        block = np.zeros((len(component_rows), layout.size))
        block[:, layout.offsets[name]] = component_rows
        rows.append(block)
        sources += [f"component {name}"] * len(component_rows)
    first = len(sources)
    for spring in springs:
        rows.append(spring.rows[list(spring.fixed)])
        sources += [f"joint {spring.name}"] * len(spring.fixed)
    sources += [f"joint {name}" for name in shapes.joints]
    return FixedRows(springs, np.vstack([*rows, shapes.rows]), tuple(sources), first)


def _find_loose_rotations(rotations: FloatArray) -> FloatArray:
    """Find the orthonormal combinations ``(m, k)`` of free rotations that no joint acts on.

    Args:
        rotations: ``(joint rows, k)`` free rotations in the rows that act.
    """
    count = rotations.shape[1]
    sizes = np.abs(rotations).max(axis=1, initial=0.0)
    acting = (
        rotations[sizes > FREE_ROTATION_TOLERANCE] / sizes[sizes > FREE_ROTATION_TOLERANCE, None]
    )
    # those that nothing touches stay as they are
    touched = np.flatnonzero(np.any(acting != 0.0, axis=0))
    untouched = np.delete(np.eye(count), touched, axis=0)
    if not len(touched):
        return untouched
    _, levels, combinations = np.linalg.svd(acting[:, touched])
    rank = int((levels > LOOSE_LEVEL * levels[0]).sum())
    between = np.zeros((len(touched) - rank, count))
    between[:, touched] = combinations[rank:]
    return np.vstack([untouched, between])


def _label_coordinates(layout: DofLayout, basis: FloatArray) -> tuple[str, ...]:
    """Return each coordinate by the stacked dof it moves most; ``~`` where it moves others too."""
    if not layout.size:
        # supports hold every component, none has an interface, and no mode is kept
        return ()
    names = label_dofs(layout)
    weights = (basis / scale_dofs(layout)[:, None]) ** 2
    totals = weights.sum(axis=0)
    largest = np.argmax(weights >= weights.max(axis=0) - EQUAL_SHARES * totals, axis=0)
    local = weights[largest, np.arange(len(totals))] >= LOCAL_SHARE * totals
    return tuple(
        names[int(row)] + ("" if alone else " ~") for row, alone in zip(largest, local, strict=True)
    )


def _redundancy_warnings(elimination: Elimination, sources: tuple[str, ...]) -> tuple[str, ...]:
    if not elimination.redundant:
        return ()
    names = sorted({sources[row] for row in elimination.redundant})
    return (
        f"{len(elimination.redundant)} fixed motion(s) are fixed more than once ({', '.join(names)}): "
        "the machine moves as described, but how the joints share the forces is not unique",
    )
