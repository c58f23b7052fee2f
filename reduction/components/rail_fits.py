"""The motion of a meshed strip fitted by a spline of frames: the control values of a rail as
weighted sums of the mesh's motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.interpolate import BSpline

from headstock.geometry.frames import FloatArray, skew
from headstock.geometry.machine.carriages import DEGREE
from headstock.geometry.parts.components import Interface
from headstock.reduction.components.interface_patches import MeshPatch
from headstock.reduction.rails import (
    CONTROL_POINT_DOFS,
    Rail,
    control_point_positions,
    place_knots,
)
from headstock.solvers.errors import ModelError

# of the fit, dofs scaled alike: 20 to 60 on any mesh that tells the control points apart, 1e6 where
# it just fails to
CONDITION_LIMIT = 1e3
THIN = 1e-12


@dataclass(frozen=True, eq=False)
class RailFit:
    """A rail as the mesh sees it.

    Attributes:
        name: Interface name.
        axis: Axis of the component it runs along, 0..2.
        center: ``(3,)`` middle of its centre line [m].
        knots: ``(N + 4,)`` along the axis [m].
        points: ``(N, 3)`` places of the control points [m].
        patch: Its area.
        operator: ``(3 n, 4 N)`` matrix C whose ``C^T u`` are the control values.
    """

    name: str
    axis: int
    center: FloatArray
    knots: FloatArray
    points: FloatArray
    patch: MeshPatch
    operator: FloatArray


def fit_rail(component: str, interface: Interface, patch: MeshPatch) -> RailFit:
    """Least-squares fit of the motion of a strip by a spline of frames, ``integral |u - A d|^2 dA
    -> min``.

    A section of the strip moves and turns about the rail as the spline says. It may also turn about
    the two axes across the rail; that part is fitted too, so that no rigid motion is left over, but
    carriages do not see it: their pitch and yaw follow from the motion along the rail.

    Args:
        component: Its name, for messages.
        interface: The rail, with its direction and its number of control points.
        patch: The strip on the mesh.

    Raises:
        ModelError: The mesh is too coarse along the rail for its control points, or the rail has
            gaps.

    Source: as for averaging interfaces (Kaufmann, Buxbaum and Lichtblau 2019), with B-splines (de
    Boor 2001) for constants.
    """
    if interface.rail is None:
        raise ValueError(f"interface {interface.name!r} is no rail")
    axis = "xyz".index(interface.rail.along)
    low, high = float(patch.points[:, axis].min()), float(patch.points[:, axis].max())
    knots = place_knots(low, high, interface.rail.control_points)
    center = np.array(patch.centroid)
    center[axis] = 0.5 * (low + high)
    fields = _section_fields(patch, axis, center)
    splines = BSpline.design_matrix(patch.points[:, axis], knots, DEGREE).toarray()
    columns = np.einsum("nk,nif->nikf", splines, fields).reshape(3 * len(patch.nodes), -1)
    weighted = np.zeros_like(columns)
    for direction in range(3):
        weighted[direction::3] = patch.weights @ columns[direction::3]
    gram = columns.T @ weighted
    _check_condition(component, interface, gram, low, high)
    fitted = scipy.linalg.solve(gram, weighted.T, assume_a="pos").T
    kept = fitted.reshape(len(weighted), interface.rail.control_points, -1)[
        :, :, :CONTROL_POINT_DOFS
    ]
    points = control_point_positions(knots, center, axis)
    return RailFit(
        interface.name, axis, center, knots, points, patch, kept.reshape(len(weighted), -1)
    )


def free_rails(fits: Sequence[RailFit], first: int, size: int) -> dict[str, Rail]:
    """Rails whose control values are dofs of their own.

    Args:
        fits: In the order of their dofs.
        first: Index of the first of these.
        size: Dofs of the superelement.
    """
    rails = {}
    for fit in fits:
        count = CONTROL_POINT_DOFS * len(fit.points)
        low, high = float(fit.knots[0]), float(fit.knots[-1])
        blur = float(np.diff(fit.knots).max())
        rails[fit.name] = Rail(
            fit.axis, fit.center, low, high, fit.knots, np.eye(count, size, first), blur
        )
        first += count
    return rails


def _section_fields(patch: MeshPatch, axis: int, center: FloatArray) -> FloatArray:
    """Displacement of the nodes ``(n, 3, f)`` under the motions of a section: x y z, about the
    rail, and about the axes across it.
    """
    along = np.eye(3)[axis]
    arms = patch.points - center
    arms[:, axis] = 0.0
    roll = arms @ skew(along).T
    fields = [np.tile(direction, (len(arms), 1)) for direction in np.eye(3)] + [roll]
    width = float(np.abs(arms).max())
    wide = [
        across
        for across in range(3)
        if across != axis and np.abs(arms[:, across]).max() > THIN * width
    ]
    fields += [arms[:, across, None] * along for across in wide]
    return np.stack(fields, axis=2)


def _check_condition(
    component: str, interface: Interface, gram: FloatArray, low: float, high: float
) -> None:
    diagonal = gram.diagonal()
    if (diagonal > 0.0).all():
        scale = 1.0 / np.sqrt(diagonal)
        values = np.linalg.eigvalsh(scale[:, None] * gram * scale)
        if values[0] * CONDITION_LIMIT > values[-1]:
            return
    control_points = DEGREE + 1 if interface.rail is None else interface.rail.control_points
    longest = 1e3 * (high - low) / (control_points - DEGREE)
    raise ModelError(
        f"component {component}: the mesh has too few points along rail {interface.name} to tell its {control_points} control points apart, or the "
        f'rail has gaps; write a mesh size of "{longest:.3g} mm" or less, one interval of its control points'
    )
