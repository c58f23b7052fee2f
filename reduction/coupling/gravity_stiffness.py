"""Geometric stiffness of a machine under its own weight: by how much the forces that hold it in
balance turn and shift as its bodies do.

With the forces of all joints, springs and constraints alike, known from the balance under gravity,
the potential energy to second order in the small motions is ``sum f . d2`` over the joints: ``d2``
is what the motions of a joint's two ends differ by in second order. Gravity itself does no work in
second order on the centre of mass, whose displacement is the coordinate.

A component is taken as a rigid body that turns as its mass does on average; a segmented one as its
segments, with the forces between them. Left out is what stress does to the deformation of an
elastic component between its joints.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_transfer, rotate_dofs
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.geometry.mechanisms.kinematics import skew_matrices
from headstock.reduction.coupling.channels import GRAVITY, machine_loads
from headstock.reduction.coupling.dof_layout import DofLayout, motion_rows, turn_dofs
from headstock.reduction.coupling.guide_errors import FixedRows
from headstock.reduction.coupling.joint_springs import PlacedJoint, leading_end
from headstock.reduction.coupling.matrices import ComponentMatrices, CoupledParts
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import solve_balanced
from headstock.solvers.second_order import SecondOrderSystem

SLIDING = ("linear_guide", "prismatic")


@dataclass(frozen=True, eq=False)
class _Body:
    """A rigid body of the machine.

    Attributes:
        point: ``(3,)`` whose displacement is linear in the dofs [m].
        rotation: ``(3, n_all)`` rows of its rotation, machine axes.
    """

    point: FloatArray
    rotation: FloatArray


@dataclass(frozen=True, eq=False)
class _Contact:
    """Force and moment between two bodies at a point.

    Attributes:
        point: ``(3,)`` [m].
        force: ``(3,)`` on the motion of the second against the first: of a spring, its stiffness
            times that motion [N].
        moment: ``(3,)`` likewise [N m].
        shift: ``(3, n_all)`` rows of the motion of the second against the first at the point.
        frame: ``(3, n_all)`` rows of the rotation of the axes in which the force is constant.
        first: Rows ``(3, n_all)`` of the rotation of the first body there.
        bodies: First and second; None for ground.
    """

    point: FloatArray
    force: FloatArray
    moment: FloatArray
    shift: FloatArray
    frame: FloatArray
    first: FloatArray
    second: FloatArray
    bodies: tuple[_Body | None, _Body | None]


def find_gravity_stiffness(
    system: SecondOrderSystem, machine: Machine, parts: CoupledParts, fixed: FixedRows
) -> FloatArray:
    """Find the geometric stiffness ``(n_all, n_all)`` in stacked dofs [N/m].

    Args:
        parts: Components and joints of the system.
        fixed: What was eliminated, and the joints as placed.

    Raises:
        ModelError: The machine is statically unstable, or falls.

    Source: Geradin and Rixen (2015), section 1.4.2 (geometric stiffness of prestressed systems),
    with joint forces as Lagrange multipliers.
    """
    layout, matrices, basis, springs = parts.layout, parts.matrices, parts.basis, fixed.springs
    weight = machine_loads(
        layout, machine, matrices, np.eye(layout.size), np.array(machine.gravity)
    )[GRAVITY]
    balance = solve_balanced(system, (basis.T @ weight)[:, None])
    if not balance.balanced[0]:
        raise ModelError(
            "gravity moves what no joint holds, so there is no balance about which gravity_stiffening could be counted; "
            "hold the machine, or remove the effect"
        )
    moved = basis @ balance.displacements[:, 0]
    inner = {
        name: matrices.stiffnesses[name] @ moved[dofs] for name, dofs in layout.offsets.items()
    }
    given = weight.copy()
    for name, dofs in layout.offsets.items():
        given[dofs] -= inner[name]
    pulls = [(spring.stiffness @ (spring.rows @ moved))[:6] for spring in springs]
    for spring in springs:
        given -= spring.rows.T @ (spring.stiffness @ (spring.rows @ moved))
    held = np.linalg.lstsq(fixed.constraints.T, given, rcond=None)[0]
    row = fixed.first
    bodies = {name: _component_bodies(name, machine, layout, matrices) for name in layout.offsets}
    contacts = []
    extra = np.zeros((layout.size, layout.size))
    for spring, pull in zip(springs, pulls, strict=True):
        forces = pull.copy()
        forces[list(spring.fixed)] += held[row : row + len(spring.fixed)]
        row += len(spring.fixed)
        contacts.append(_joint_contact(spring, forces, machine, layout, bodies))
        if machine.joints[spring.name].second_axis is not None:
            # axes of a cross: x stays with the first end, z with the second, and (x . z) vanishes
            # instead of the rotation about y
            cross = 0.5 * forces[4] * np.outer(spring.rows[3], spring.rows[5])
            extra += cross + cross.T
    for name in bodies:
        if machine.components[name].fidelity == "segmented":
            contacts += _segment_contacts(name, layout, inner[name])
    whole = extra + sum((_second_order(contact) for contact in contacts), np.zeros_like(extra))
    return 0.5 * (whole + whole.T)


def warn_of_stress(machine: Machine, layout: DofLayout) -> tuple[str, ...]:
    """Names what the geometric stiffness leaves out; empty where that is nothing."""
    elastic = [
        name
        for name in layout.superelements
        if machine.components[name].fidelity not in ("rigid", "segmented")
    ]
    if not elastic:
        return ()
    return (
        f"gravity_stiffening takes {', '.join(elastic)} as rigid between joints: what the stress under gravity does to their deformation is left out; "
        "segments count it",
    )


def _second_order(contact: _Contact) -> FloatArray:
    """Return the second derivative ``(n_all, n_all)`` of the work of a contact's force and moment
    on the second-order part of its motion.
    """
    # a constant force in axes that turn: -f . (theta x d)
    mixed = contact.frame.T @ skew_matrices(contact.force) @ contact.shift
    # the rotation vector between two bodies lacks half the product of theirs: -m . (a x b) / 2
    mixed += 0.5 * contact.first.T @ skew_matrices(contact.moment) @ contact.second
    derivative = mixed + mixed.T
    for sign, body in zip((-1.0, 1.0), contact.bodies, strict=True):
        if body is None:
            continue
        # a point on an arm r moves by theta x (theta x r) / 2 in second order
        arm = contact.point - body.point
        product = np.outer(arm, contact.force)
        inner = 0.5 * (product + product.T) - (arm @ contact.force) * np.eye(3)
        derivative += sign * body.rotation.T @ inner @ body.rotation
    return derivative


def _joint_contact(
    spring: PlacedJoint,
    forces: FloatArray,
    machine: Machine,
    layout: DofLayout,
    bodies: Mapping[str, Callable[[FloatArray, str], _Body | None]],
) -> _Contact:
    joint, axes, point = machine.joints[spring.name], spring.frame.rotation, spring.frame.origin
    first, second = (motion_rows(layout, end, point, joint.length)[3:] for end in joint.ends)
    # the force acts at a point of the leading end; where that slides, the way it goes is a line of
    # the other, and the force keeps its direction in the axes of that line
    leads_first = leading_end(joint, layout) is joint.ends[0]
    slides = joint.kind in SLIDING or joint.length is not None
    framed_first = leads_first != slides
    return _Contact(
        point=point,
        force=axes @ forces[:3],
        moment=axes @ forces[3:],
        shift=axes @ spring.rows[:3],
        frame=first if framed_first else second,
        first=first,
        second=second,
        bodies=(_end_body(joint.ends[0], point, bodies), _end_body(joint.ends[1], point, bodies)),
    )


def _end_body(
    end: JointEnd,
    point: FloatArray,
    bodies: Mapping[str, Callable[[FloatArray, str], _Body | None]],
) -> _Body | None:
    if end.component is None:
        return None
    return bodies[end.component](point, end.interface or "")


def _component_bodies(
    name: str, machine: Machine, layout: DofLayout, matrices: ComponentMatrices
) -> Callable[[FloatArray, str], _Body | None]:
    """Return the body of a component behind one of its interfaces at a point."""
    superelement, placement = layout.superelements[name], layout.placements[name]
    dofs = layout.offsets[name]
    if machine.components[name].fidelity == "segmented":
        # the nodes of a row of segments: those that springs act on
        stiffness = matrices.stiffnesses[name]
        count = len(stiffness) // 6
        sizes = np.abs(stiffness.diagonal()).reshape(count, 6).max(axis=1)
        nodes = [int(node) for node in np.flatnonzero(sizes > 0.0)]
        places = np.array(
            [
                placement.origin + placement.rotation @ superelement.frames[node].origin
                for node in nodes
            ]
        )

        def nearest(point: FloatArray, interface: str) -> _Body:
            carried = superelement.interface_maps.get(interface)
            number = (
                nodes.index(carried.node)
                if carried is not None and carried.node in nodes
                else int(np.argmin(np.linalg.norm(places - point, axis=1)))
            )
            return _Body(places[number], _node_rows(layout, dofs.start, nodes[number])[3:])

        return nearest
    if superelement.supported or not superelement.mass_kg > 0.0:
        return lambda point, interface: None
    center = placement.origin + placement.rotation @ superelement.center_of_mass
    rigid = (
        turn_dofs(superelement, placement).T
        @ rigid_motions(superelement, superelement.center_of_mass)
        @ rotate_dofs(placement.rotation.T)
    )
    heavy = matrices.masses[name] @ rigid
    rotation = np.zeros((3, layout.size))
    rotation[:, dofs] = (np.linalg.pinv(rigid.T @ heavy) @ heavy.T)[3:]
    body = _Body(center, rotation)
    return lambda point, interface: body


def _node_rows(layout: DofLayout, start: int, node: int) -> FloatArray:
    rows = np.zeros((6, layout.size))
    first = start + 6 * node
    rows[:, first : first + 6] = np.eye(6)
    return rows


def _segment_contacts(
    name: str,
    layout: DofLayout,
    pulls: FloatArray,
) -> list[_Contact]:
    """Return what neighbouring segments do to each other, half-way between their nodes.

    Args:
        pulls: ``(n,)`` forces that act on its nodes from outside, machine axes.
    """
    superelement, placement = layout.superelements[name], layout.placements[name]
    start = layout.offsets[name].start
    places = np.array(
        [placement.origin + placement.rotation @ frame.origin for frame in superelement.frames]
    )
    nodes = np.flatnonzero(np.abs(superelement.stiffness.diagonal()).reshape(-1, 6).max(axis=1))
    along = places[nodes] - places[nodes].mean(axis=0)
    axis = np.linalg.svd(along, full_matrices=False).Vh[0]
    order = nodes[np.argsort(along @ axis, kind="stable")]
    forces = pulls[: 6 * len(places)].reshape(-1, 6)
    contacts = []
    for number in range(1, len(order)):
        lower, upper = int(order[number - 1]), int(order[number])
        point = 0.5 * (places[lower] + places[upper])
        beyond = order[number:]
        force = forces[beyond, :3].sum(axis=0)
        moment = forces[beyond, 3:].sum(axis=0) + np.cross(
            places[beyond] - point, forces[beyond, :3]
        ).sum(axis=0)
        rows = [_node_rows(layout, start, node) for node in (lower, upper)]
        moved = [
            rigid_transfer(places[node], point) @ row
            for node, row in zip((lower, upper), rows, strict=True)
        ]
        contacts.append(
            _Contact(
                point=point,
                force=force,
                moment=moment,
                shift=moved[1][:3] - moved[0][:3],
                frame=rows[0][3:],
                first=rows[0][3:],
                second=rows[1][3:],
                bodies=(_Body(places[lower], rows[0][3:]), _Body(places[upper], rows[1][3:])),
            )
        )
    return contacts
