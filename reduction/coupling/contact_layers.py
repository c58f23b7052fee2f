"""Contact layers of joints: stiffness per area between two patches, in their deformation shapes."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, rigid_map
from headstock.geometry.machine.joints import ContactLayer, Joint, JointEnd
from headstock.reduction.coupling.coupled_shapes import find_shapes, select_shapes, shape_moments
from headstock.reduction.coupling.dof_layout import DofLayout
from headstock.reduction.patch_shapes import PatchShapes, gauss_rule, shape_fields
from headstock.solvers.errors import ModelError


@dataclass(frozen=True, eq=False)
class PlacedLayer:
    """A contact layer in a pose.

    Attributes:
        rigid: ``(6, 6)`` stiffness against relative rigid motions at the joint point, joint axes
            [N/m, N, N m].
        rows: ``(m, n_all)`` relative deformation of the two patches by shape [m].
        stiffness: ``(m,)`` against each [N/m].
    """

    rigid: FloatArray
    rows: FloatArray
    stiffness: FloatArray


def place_layer(joint: Joint, layer: ContactLayer, layout: DofLayout, frame: Frame) -> PlacedLayer:
    """Return the stiffness of a layer, integrated over the area of its patches.

    The relative displacement of both patches is a rigid motion and shapes; a patch without shapes
    moves as a rigid body. Shapes are orthogonal to rigid motions and to each other, also in their
    parts across and along the patch, so nothing couples them.

    Args:
        layer: Stiffness per area.
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        frame: Joint point and joint axes in the machine frame.

    Raises:
        ModelError: No end has deformation shapes, which say how large its patch is; or the two areas
            differ.
    """
    sides = [(end, find_shapes(layout, end)) for end in joint.ends]
    flexible = [(end, shapes) for end, shapes in sides if shapes is not None]
    if not flexible:
        raise ModelError(
            f"joint {joint.name!r}: a stiffness per area needs interfaces of elastic components with deformation shapes; write coupling ="
            " { flexible = 24 } for both ends"
        )
    (other, fewer), (one, more) = sorted(
        [flexible[0], flexible[-1]], key=lambda side: side[1].count
    )
    points, weights = gauss_rule(more)
    area = more.outline.area
    rows = select_shapes(layout, one, more)
    if one is not other:
        rows -= shape_moments(joint, layout, one, other) @ select_shapes(layout, other, fewer)
    # mean square of each shape across the patch: one or zero
    fields = shape_fields(more, points).reshape(len(points), 3, -1)
    across = np.round(weights @ fields[:, more.normal] ** 2)
    return PlacedLayer(
        _rigid_stiffness(layer, layout, one, more, frame),
        rows,
        area * (layer.normal * across + layer.shear * (1.0 - across)),
    )


def _rigid_stiffness(
    layer: ContactLayer, layout: DofLayout, end: JointEnd, shapes: PatchShapes, frame: Frame
) -> FloatArray:
    """Return the layer against rigid motions about the joint point, in joint axes ``(6, 6)``."""
    points, weights = gauss_rule(shapes)
    area = shapes.outline.area
    placement = layout.placements[end.component or ""]
    placed = (placement.origin + points @ placement.rotation.T - frame.origin) @ frame.rotation
    normal = frame.rotation.T @ placement.rotation[:, shapes.normal]
    per_area = layer.shear * np.eye(3) + (layer.normal - layer.shear) * np.outer(normal, normal)
    motions = rigid_map(placed, np.zeros(3)).reshape(len(points), 3, 6)
    total = np.einsum("k,kia,ij,kjb->ab", area * weights, motions, per_area, motions)
    return np.asarray(0.5 * (total + total.T))
