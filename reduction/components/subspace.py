"""A component's matrices in the subspace of its constraint modes and fixed-interface modes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Component
from headstock.reduction.components.boundary_basis import BoundaryBasis, boundary_labels
from headstock.reduction.components.constraint_modes import MeanConstraints, dependent_rows
from headstock.reduction.components.fixed_interface_modes import FixedInterfaceModes
from headstock.reduction.components.rail_fits import free_rails
from headstock.reduction.superelement import InterfaceMap, Superelement
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.ranks import sum_over_ranks

BODY_NODE = "body"


@dataclass(frozen=True, eq=False)
class ReductionSpace:
    """The subspace ``[psi phi]`` of a component.

    Attributes:
        means: What averaging interfaces prescribe.
        psi: Constraint modes ``(3 n_owned, n_b)``.
        modes: Fixed-interface modes ``phi``.
    """

    basis: BoundaryBasis
    means: MeanConstraints
    psi: FloatArray
    modes: FixedInterfaceModes


def project_component(
    component: Component, solver: ConstrainedSolver, space: ReductionSpace
) -> Superelement:
    """Return the superelement with the dofs ``[boundary | modal]``, without recovery, loads and
    error moments.

    Its stiffness is ``[psi^T K psi, 0; 0, omega^2]``; its mass is zero where none was assembled.

    Args:
        component: Its name and reduction settings.
        solver: Factorised operators of its mesh.
        space: Boundary basis, means, constraint modes and fixed-interface modes that span the
            subspace.

    Source: Craig and Bampton (1968).
    """
    basis, means, modes = space.basis, space.means, space.modes
    stiffness, mass = _project_matrices(solver, space)
    size, operators = len(stiffness), solver.operators
    total, center, inertia = (
        (0.0, np.zeros(3), np.zeros((3, 3)))
        if operators.scalar_mass is None
        else _mass_properties(operators)
    )
    boundary = space.psi.shape[1]
    labels = boundary_labels(basis) or [
        (BODY_NODE, dof) for dof in ("x", "y", "z", "rx", "ry", "rz")[:boundary]
    ]
    labels += [("mode", str(number + 1)) for number in range(size - boundary)]
    rows = (
        means.fixed if means.loose_frame is not None else basis.constraints,
        dependent_rows(basis, means, solver),
    )
    constraints = np.vstack([np.pad(block, ((0, 0), (0, size - block.shape[1]))) for block in rows])
    return Superelement(
        name=component.name,
        labels=tuple(labels),
        frames=means.node_frames,
        interface_maps=basis.interface_maps
        if means.loose_frame is None
        else {BODY_NODE: InterfaceMap(0, means.loose_frame)},
        stiffness=stiffness,
        mass=mass,
        constraints=constraints,
        modal_frequencies_hz=np.sqrt(modes.eigenvalues) / (2.0 * np.pi),
        cutoff_hz=modes.cutoff_hz,
        full_dofs=3 * operators.total_nodes,
        mass_kg=total,
        center_of_mass=center,
        inertia=inertia,
        supported=bool(basis.held),
        warnings=basis.warnings,
        control_points=basis.control_points,
        rails=free_rails(basis.rails, 6 * len(basis.nodes), size),
    )


def _project_matrices(
    solver: ConstrainedSolver, space: ReductionSpace
) -> tuple[FloatArray, FloatArray]:
    psi, modes, operators = space.psi, space.modes, solver.operators
    boundary, count = psi.shape[1], modes.shapes.shape[1]
    size = boundary + count
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    if space.means.body_motions is None:
        stiffness[:boundary, :boundary] = _symmetric(solver.product(psi, solver.forces(psi)))
    stiffness[boundary:, boundary:] = np.diag(modes.eigenvalues)
    if operators.scalar_mass is not None:
        weighted = operators.apply_mass(psi)
        mass[:boundary, :boundary] = _symmetric(solver.product(psi, weighted))
        mass[:boundary, boundary:] = solver.product(weighted, modes.shapes)
        mass[boundary:, :boundary] = mass[:boundary, boundary:].T
        mass[boundary:, boundary:] = np.eye(count)
    return stiffness, mass


class _MassProperties(NamedTuple):
    """Mass [kg], its centre ``(3,)`` [m], and the inertia ``(3, 3)`` about that [kg m^2]."""

    mass: float
    center: FloatArray
    inertia: FloatArray


def _mass_properties(operators: ElasticOperators) -> _MassProperties:
    # about the mean point: far from the origin the inertia would cancel
    middle = sum_over_ranks(operators.comm, operators.points.sum(axis=0)) / operators.total_nodes
    rigid = rigid_map(operators.points, middle)
    weighted = np.ascontiguousarray(operators.apply_mass(rigid).T)
    # in pairs: one after the other, equal terms of an even mesh are all rounded alike
    gram = sum_over_ranks(
        operators.comm, np.array([np.sum(weighted * motion, axis=1) for motion in rigid.T])
    )
    mass = float(np.trace(gram[:3, :3]) / 3.0)
    static = gram[:3, 3:]
    arm = np.array(
        [static[1, 2] - static[2, 1], static[2, 0] - static[0, 2], static[0, 1] - static[1, 0]]
    ) / (2.0 * mass)
    inertia = gram[3:, 3:] - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return _MassProperties(mass, middle + arm, _symmetric(inertia))


def _symmetric(matrix: FloatArray) -> FloatArray:
    return 0.5 * (matrix + matrix.T)
