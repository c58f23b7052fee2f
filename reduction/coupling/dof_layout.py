"""Where every component's dofs sit in the stacked vector of a machine, and how points on the
components move with them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, rigid_transfer, rotate_dofs
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import NO_OFFSET
from headstock.reduction.rails import carriage_rows
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import (
    characteristic_length,
    rigid_motions,
    rotation_dofs,
)
from headstock.solvers.errors import AccuracyError, ModelError

RIGID_NOISE_LIMIT = 1e-8
EFFECTIVE_TOLERANCE = 1e-9
FREE_ROTATION_LEVEL = 1e-14
DOFS_OF_A_BODY = 6
ROUNDING = 1e-9  # of places, over the size of a part


@dataclass(frozen=True, eq=False)
class DofLayout:
    """The stacked dofs of all components, boundary dofs turned to machine axes.

    Attributes:
        placements: Frame of each component in the machine frame.
        offsets: Slice of each component in the stacked vector.
        size: Number of stacked dofs.
        length: Characteristic length of the machine [m]: makes rotations comparable to
            translations.
    """

    superelements: Mapping[str, Superelement]
    placements: Mapping[str, Frame]
    offsets: dict[str, slice]
    size: int
    length: float


def lay_out_dofs(
    superelements: Mapping[str, Superelement], placements: Mapping[str, Frame]
) -> DofLayout:
    """Stack the dofs of all superelements in the order given."""
    offsets: dict[str, slice] = {}
    size = 0
    positions = []
    for name, superelement in superelements.items():
        offsets[name] = slice(size, size + len(superelement.labels))
        size += len(superelement.labels)
        places = [frame.origin for frame in superelement.frames]
        places += [
            interface_map.frame.origin for interface_map in superelement.interface_maps.values()
        ]
        places += [control_point.point for control_point in superelement.control_points]
        positions += [
            placements[name].origin + placements[name].rotation @ position for position in places
        ]
    spread = np.array(positions) - np.mean(positions, axis=0) if positions else np.zeros((1, 3))
    # the largest distance from the middle does not change when the machine is turned or shifted
    length = float(np.linalg.norm(spread, axis=1).max())
    # parts that all meet in one place spread by rounding alone
    least = max((characteristic_length(part) for part in superelements.values()), default=1.0)
    return DofLayout(
        superelements, placements, offsets, size, length if length > ROUNDING * least else least
    )


def scale_dofs(layout: DofLayout) -> FloatArray:
    """Return the factor per stacked dof ``(n_all,)`` after which every dof is a length.

    All are powers of two: they cost no digits, and those of rotations are the same in neighbouring
    poses, which then share what is made of them.
    """
    scale, length = np.ones(layout.size), _power_of_two(layout.length)
    for name, superelement in layout.superelements.items():
        part = scale[layout.offsets[name]]
        part[: superelement.boundary_size][rotation_dofs(superelement)] = 1.0 / length
        part[superelement.boundary_size :] = (
            _power_of_two(np.sqrt(superelement.mass_kg)) if superelement.mass_kg > 0.0 else 1.0
        )
    return scale


def _power_of_two(size: float) -> float:
    return float(2.0 ** np.round(np.log2(size)))


def label_dofs(layout: DofLayout) -> tuple[str, ...]:
    """Return a name such as ``column.top rx`` per stacked dof."""
    return tuple(
        f"{name}.{node} {dof}"
        for name, superelement in layout.superelements.items()
        for node, dof in superelement.labels
    )


def turn_dofs(superelement: Superelement, placement: Frame) -> FloatArray:
    """Return the matrix ``(n, n)`` from machine-axis dofs of one component to its own."""
    turn = np.eye(len(superelement.labels))
    back = rotate_dofs(placement.rotation.T)
    for node in range(len(superelement.frames)):
        turn[6 * node : 6 * node + 6, 6 * node : 6 * node + 6] = back
    return turn


def clean_stiffness(superelement: Superelement) -> FloatArray:
    """Return the stiffness ``(n, n)`` of a component with rigid motions free of roundoff.

    Static condensation leaves ``K R`` at roundoff of the *local* stiffness, which may be more than
    a soft mount. Rebuilding K from its block without one boundary node makes ``K R = 0`` to
    roundoff of K itself; nothing else changes.

    Raises:
        AccuracyError: The change is more than roundoff: the component is not free although it is
            not marked as supported.
    """
    stiffness = 0.5 * (superelement.stiffness + superelement.stiffness.T)
    if superelement.supported or not stiffness.any() or not superelement.frames:
        return stiffness
    if _has_free_rotations(superelement, stiffness):
        return stiffness
    deformation = free_deformations(superelement)
    cleaned = deformation.T @ stiffness[DOFS_OF_A_BODY:, DOFS_OF_A_BODY:] @ deformation
    change = float(np.abs(cleaned - stiffness).max() / np.abs(stiffness).max())
    if not change <= RIGID_NOISE_LIMIT:
        raise AccuracyError(
            f"component {superelement.name!r}: a rigid motion meets {change:.2g} of its stiffness, limit {RIGID_NOISE_LIMIT:g}; "
            "mark the component as supported if it is fixed"
        )
    return 0.5 * (cleaned + cleaned.T)


def free_deformations(superelement: Superelement) -> FloatArray:
    """Return the rows ``(n - 6, n)``: all dofs but those of the first node, less the rigid motion
    that the first node makes.
    """
    motions = rigid_motions(superelement, superelement.frames[0].origin)[DOFS_OF_A_BODY:]
    return np.hstack([-motions, np.eye(len(motions))])


def split_constraints(superelement: Superelement) -> tuple[FloatArray, FloatArray]:
    """Return the constraint rows of a superelement, and separately those that fix a rotation of one
    node without stiffness and mass.

    Such a rotation, that of a line-like interface about its own line, is no motion of the component
    at all. A row that couples two nodes never counts as one.
    """
    rows = superelement.constraints
    free_rotations = (
        _free_rotations(superelement) if len(rows) else np.zeros((0, len(superelement.labels)))
    )
    if len(free_rotations) == 0:
        return rows, free_rotations
    rest = rows - (rows @ free_rotations.T) @ free_rotations
    sizes = np.linalg.norm(rest, axis=1) / np.maximum(
        np.linalg.norm(rows, axis=1), np.finfo(float).tiny
    )
    return rest[sizes > EFFECTIVE_TOLERANCE], free_rotations


def _free_rotations(superelement: Superelement) -> FloatArray:
    """Return the orthonormal rotations ``(k, n)``, each of one node, that the constraint rows fix
    and that have no stiffness and no mass.
    """
    rows = superelement.constraints
    span = np.linalg.svd(rows / np.linalg.norm(rows, axis=0).max(), full_matrices=False)
    projection = span.Vh[EFFECTIVE_TOLERANCE * span.S[0] < span.S]
    unseen = np.eye(3) - _rotation_products(superelement, projection)
    for matrix in (superelement.stiffness, superelement.mass):
        unseen = unseen + _rotation_products(superelement, matrix / (np.abs(matrix).max() or 1.0))
    levels, vectors = np.linalg.eigh(unseen)
    nodes, modes = np.nonzero(levels < FREE_ROTATION_LEVEL)
    rotations = np.zeros((len(nodes), len(superelement.labels)))
    for row, (node, mode) in enumerate(zip(nodes, modes, strict=True)):
        rotations[row, 6 * node + 3 : 6 * node + 6] = vectors[node, :, mode]
    return rotations


def _rotation_products(superelement: Superelement, rows: FloatArray) -> FloatArray:
    """Return ``R^T R`` for the columns ``(m, 3)`` of each node's rotations: ``(nodes, 3, 3)``."""
    turns = rows[:, : superelement.node_size].reshape(len(rows), -1, 6)[:, :, 3:].transpose(1, 2, 0)
    return turns @ turns.transpose(0, 2, 1)


def _has_free_rotations(superelement: Superelement, stiffness: FloatArray) -> bool:
    """Return whether a boundary dof of node 0 has neither stiffness nor mass, so that the node
    cannot stand for the body's rigid motion.
    """
    first = np.abs(stiffness[:6]).max(axis=1)
    return (
        bool(len(superelement.constraints))
        or bool(superelement.free_dofs)
        or bool((first == 0.0).any() and first.any())
    )


def locate_interface(
    layout: DofLayout, end: JointEnd, offset: Sequence[float] = NO_OFFSET
) -> FloatArray:
    """Return the position ``(3,)`` of an interface in the machine frame [m].

    Args:
        offset: ``(3,)`` of a place from it, in the axes of the component [m].
    """
    component, interface = _named_end(layout, end)
    superelement, placement = layout.superelements[component], layout.placements[component]
    local = superelement.interface_position(interface) + np.asarray(offset)
    return placement.origin + placement.rotation @ local


def is_rail(layout: DofLayout, end: JointEnd) -> bool:
    """Return whether an end is an interface that carriages slide along."""
    if end.component is None:
        return False
    component, interface = _named_end(layout, end)
    return interface in layout.superelements[component].rails


def motion_rows(
    layout: DofLayout, end: JointEnd, point: FloatArray, length: float | None = None
) -> FloatArray:
    """Return the rows ``(6, n_all)`` that give the motion in machine axes of the body behind an
    interface at a point; zero for ground.

    Args:
        end: An interface, a rail or ground.
        point: ``(3,)`` in the machine frame [m].
        length: On a rail, of the carriage at the point [m]; None for the mean motion of the
            whole rail.

    Raises:
        ModelError: The end names nothing, or a carriage does not lie on its rail.
    """
    rows = np.zeros((6, layout.size))
    if end.component is None:
        return rows
    component, interface = _named_end(layout, end)
    superelement, placement = layout.superelements[component], layout.placements[component]
    if interface in superelement.rails:
        rows[:, layout.offsets[component]] = _rail_rows(
            superelement, interface, placement, point, length
        )
        return rows
    node = superelement.interface_maps[interface].node
    origin = placement.origin + placement.rotation @ superelement.frames[node].origin
    first = layout.offsets[component].start + 6 * node
    rows[:, first : first + 6] = rigid_transfer(origin, point)
    return rows


def _rail_rows(
    superelement: Superelement,
    interface: str,
    placement: Frame,
    point: FloatArray,
    length: float | None,
) -> FloatArray:
    rail = superelement.rails[interface]
    carriage_center = np.array(rail.center)
    if length is not None:
        carriage_center[rail.axis] = (placement.rotation.T @ (point - placement.origin))[rail.axis]
    try:
        local_rows = carriage_rows(
            rail,
            float(carriage_center[rail.axis]),
            rail.high - rail.low if length is None else length,
        )
    except ModelError as error:
        raise ModelError(f"rail {superelement.name}.{interface}: {error}") from error
    carried = rigid_transfer(
        placement.origin + placement.rotation @ carriage_center, point
    ) @ rotate_dofs(placement.rotation)
    return carried @ local_rows @ turn_dofs(superelement, placement)


def _named_end(layout: DofLayout, end: JointEnd) -> tuple[str, str]:
    if end.component is None or end.component not in layout.superelements:
        raise ModelError(
            f"there is no component {end.component!r}; components: {sorted(layout.superelements)}"
        )
    superelement = layout.superelements[end.component]
    names = [*superelement.interface_maps, *superelement.rails]
    if end.interface is None or end.interface not in names:
        raise ModelError(
            f"component {end.component!r} has no interface {end.interface!r}; interfaces: {sorted(names)}"
        )
    return end.component, end.interface
