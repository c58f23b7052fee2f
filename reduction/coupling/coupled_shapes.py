"""Joints between flexible interfaces: the deformation shapes of both sides are one field, or a contact
layer with a stiffness per area acts between them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.geometry.machine.joints import ContactLayer, Joint, JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.patches import in_plane_axes
from headstock.reduction.coupling.dof_layout import DOFS_OF_A_BODY, DofLayout
from headstock.reduction.patch_shapes import PatchShapes, gauss_rule, shape_fields
from headstock.solvers.errors import ModelError

MATCH = 1e-6  # by how much of its size an area may miss the other one
ROUNDOFF = 1e-12
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class ShapeRows:
    """Rows ``(m, n_all)`` of deformation shapes that must vanish, and the joint of each."""

    rows: FloatArray
    joints: tuple[str, ...]
    warnings: tuple[str, ...]


def couple_shapes(machine: Machine, layout: DofLayout) -> ShapeRows:
    """Return the rows that make the fields of both sides of every rigid joint equal.

    Between two flexible interfaces the moments of the relative displacement with the shapes of the
    side that has fewer vanish; where both have as many, that is every shape. Against ground and
    against what is rigid shapes are zero. At any other joint, and at an averaging interface, they
    are free.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.

    Raises:
        ModelError: Two flexible interfaces do not have the same area.

    Source: Bernardi, Maday and Patera (1994) on moments in place of equal fields (mortar method).
    """
    blocks: list[FloatArray] = [np.zeros((0, layout.size))]
    joints: list[str] = []
    warnings: list[str] = []
    for joint in machine.joints.values():
        sides = [(end, _find_shapes(layout, end)) for end in joint.ends]
        flexible = [(end, shapes) for end, shapes in sides if shapes is not None and shapes.count]
        if not flexible or len(joint.fixed) < DOFS_OF_A_BODY:
            continue
        if len(flexible) == len(sides):
            (one, fewer), (other, more) = sorted(flexible, key=lambda side: side[1].count)
            block = _select_shapes(layout, one, fewer)
            block -= _shape_moments(joint, layout, one, other) @ _select_shapes(layout, other, more)
            if more.count > fewer.count:
                warnings.append(
                    f"joint {joint.name}: {other} has {more.count} shapes, {one} has {fewer.count}: "
                    f"the {more.count - fewer.count} further shapes of {other} are free"
                )
        else:
            ((end, shapes),) = flexible
            opposite = next(joint_end for joint_end in joint.ends if joint_end is not end)
            if not _is_rigid(machine.components, opposite):
                warnings.append(
                    f"joint {joint.name}: {opposite} has no deformation shapes; those of {end} are free there"
                )
                continue
            block = _select_shapes(layout, end, shapes)
        blocks.append(block)
        joints += [joint.name] * len(block)
    warnings += _warn_of_free_shapes(machine, layout)
    return ShapeRows(np.vstack(blocks), tuple(joints), tuple(warnings))


def _warn_of_free_shapes(machine: Machine, layout: DofLayout) -> list[str]:
    """Return the interfaces whose shapes nothing uses: springs act on their six motions alone."""
    used: set[JointEnd] = set()
    sprung: dict[JointEnd, str] = {}
    for joint in machine.joints.values():
        holds = len(joint.fixed) == DOFS_OF_A_BODY or joint.layer is not None
        for end in joint.ends:
            if (shapes := _find_shapes(layout, end)) is not None and shapes.count:
                if holds:
                    used.add(end)
                else:
                    sprung.setdefault(end, joint.name)
    return [
        f"joint {name}: it acts on six motions of {end}, whose deformation shapes are free there; write stiffness_per_area, or leave "
        "flexible out"
        for end, name in sprung.items()
        if end not in used
    ]


def _find_shapes(layout: DofLayout, end: JointEnd) -> PatchShapes | None:
    """Find the deformation shapes of the interface at an end; None of a rigid one, a rail and
    ground.
    """
    part = layout.superelements.get(end.component or "")
    entry = None if part is None else part.interface_maps.get(end.interface or "")
    return None if entry is None else entry.shapes


def _is_rigid(components: Mapping[str, Component], end: JointEnd) -> bool:
    """Return whether what is behind an end without shapes cannot deform."""
    if end.component is None:
        return True
    component = components[end.component]
    interface = component.interfaces.get(end.interface or "")
    return component.fidelity == "rigid" or (
        interface is not None and interface.rail is None and interface.coupling == "rigid"
    )


def _select_shapes(layout: DofLayout, end: JointEnd, shapes: PatchShapes) -> FloatArray:
    """Return the rows ``(count, n_all)`` that pick the dofs of the shapes."""
    first = layout.offsets[end.component or ""].start + shapes.first
    return np.eye(shapes.count, layout.size, first)


def _shape_moments(joint: Joint, layout: DofLayout, one: JointEnd, other: JointEnd) -> FloatArray:
    """Return the moments ``(m_1, m_2)`` of the shapes of another interface with those of one, over
    their common area.
    """
    near, far = _find_shapes(layout, one), _find_shapes(layout, other)
    if near is None or far is None:
        raise ValueError(f"joint {joint.name!r} has an end without shapes")
    here, there = layout.placements[one.component or ""], layout.placements[other.component or ""]
    turn = there.rotation.T @ here.rotation

    def carry(points: FloatArray) -> FloatArray:
        placed = here.origin + points @ here.rotation.T
        return (placed - there.origin) @ there.rotation

    parallel = abs(turn[far.normal, near.normal]) > 1.0 - MATCH
    if not parallel or not _cover_each_other(near, far, carry):
        raise ModelError(
            f"joint {joint.name!r}: {one} and {other} are flexible but not the same area: "
            f"{_describe(near)} and {_describe(far)}; give both the same patch, or write coupling = "
            '"rigid" or "average" for one of them'
        )
    points, weights = gauss_rule(near if near.count >= far.count else far)
    if near.count < far.count:
        points = (there.origin + points @ there.rotation.T - here.origin) @ here.rotation
    fields = shape_fields(far, carry(points)).reshape(len(points), 3, -1)
    turned = np.einsum("ji,kjm->kim", turn, fields)
    tested = shape_fields(near, points).reshape(len(points), 3, -1)
    result = np.einsum("k,kim,kin->mn", weights, tested, turned)
    return np.where(np.abs(result) > ROUNDOFF, result, 0.0)


def _cover_each_other(
    near: PatchShapes, far: PatchShapes, carry: Callable[[FloatArray], FloatArray]
) -> bool:
    """Return whether two areas in parallel planes are one.

    Args:
        carry: Points of the one ``(k, 3)`` in the frame of the other.
    """
    axes = list(in_plane_axes(far.normal))
    if near.hole is None or far.hole is None:
        corners = np.array([near.center] * len(CORNERS))
        corners[:, list(in_plane_axes(near.normal))] += near.half_lengths * CORNERS
        places = (carry(corners) - far.center)[:, axes] / far.half_lengths
        return near.hole == far.hole and bool(np.abs(np.abs(places) - 1.0).max() <= MATCH)
    (center,) = (carry(near.center[None]) - far.center)[:, axes]
    sizes = (near.half_lengths - far.half_lengths, np.array([near.hole - far.hole]))
    offset = max(np.abs(center).max(), np.abs(sizes[0]).max()) / far.half_lengths[0]
    return bool(max(offset, np.abs(sizes[1]).max()) <= MATCH)


def _describe(shapes: PatchShapes) -> str:
    where = ", ".join(f"{1e3 * value:.6g}" for value in shapes.center)
    return f"{shapes.outline} about ({where}) mm of its component"


def place_layer(
    joint: Joint, layer: ContactLayer, layout: DofLayout, frame: Frame
) -> tuple[FloatArray, FloatArray]:
    """Return the relative deformation of the two patches by shape and the stiffness of a layer,
    integrated over the area that it covers.

    The relative displacement of both patches is a rigid motion and shapes; a patch without shapes
    moves as a rigid body. Over the whole patch shapes are orthogonal to rigid motions and to each
    other; over a part of it they are not.

    Args:
        layer: Stiffness per area.
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        frame: Joint point and joint axes in the machine frame.

    Returns:
        Rows ``(m, n_all)`` of the second end less the first [m]; stiffness ``(6 + m, 6 + m)`` against
        relative rigid motions at the joint point, joint axes, and these [N/m, N, N m].

    Raises:
        ModelError: No end has deformation shapes, which say how large its patch is; or the two areas
            differ.
    """
    sides = [(end, _find_shapes(layout, end)) for end in joint.ends]
    flexible = [(end, shapes) for end, shapes in sides if shapes is not None]
    if not flexible:
        raise ModelError(
            f"joint {joint.name!r}: a stiffness per area needs interfaces of elastic components with deformation shapes; write coupling ="
            " { flexible = 24 } for both ends"
        )
    (other, fewer), (one, more) = sorted(
        [flexible[0], flexible[-1]], key=lambda side: side[1].count
    )
    rows = _select_shapes(layout, one, more)
    if one is not other:
        rows -= _shape_moments(joint, layout, one, other) @ _select_shapes(layout, other, fewer)
    points, weights = gauss_rule(more)
    points = more.center + layer.covers * (points - more.center)
    area = layer.covers**2 * more.outline.area
    placement = layout.placements[one.component or ""]
    turn = frame.rotation.T @ placement.rotation
    placed = (placement.origin + points @ placement.rotation.T - frame.origin) @ frame.rotation
    per_area = layer.shear * np.eye(3)
    per_area += (layer.normal - layer.shear) * np.outer(turn[:, more.normal], turn[:, more.normal])
    fields = turn @ shape_fields(more, points).reshape(len(points), 3, -1)
    rigid = rigid_map(placed, np.zeros(3)).reshape(len(points), 3, 6)
    motions = np.concatenate([rigid, fields], axis=2)
    total = np.einsum("k,kia,kib->ab", area * weights, motions, per_area @ motions)
    return (rows if one is joint.ends[1] else -rows), 0.5 * (total + total.T)
