"""The motion of a meshed strip fitted by a spline of frames: the control values of a rail as
weighted sums of the mesh's motion.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from headstock.geometry.frames import FloatArray, skew
from headstock.geometry.machine.carriages import DEGREE
from headstock.geometry.parts.components import Interface
from headstock.meshing.scipy_library import scipy
from headstock.reduction.rails import (
    CONTROL_POINT_DOFS,
    Rail,
    control_point_positions,
    evaluate_splines,
    place_knots,
)
from headstock.solvers.errors import ModelError

if TYPE_CHECKING:
    from headstock.reduction.components.interface_patches import MeshPatch

# of the fit, dofs scaled alike: 20 to 60 on any mesh that distinguishes the control points, 1e6
# where it just fails to
CONDITION_LIMIT = 1e3
SURE_LIMIT = 100.0  # of a mesh that is recommended: it is cut a little otherwise than even rows
THIN = 1e-9
# Lengths of elements that are tried, in intervals of the control points: with two of the second
# order there are fewer nodes than control points
LENGTHS = (1.5, 1.25, 1.0, 0.8, 0.65, 0.5, 0.4, 0.3)
# integral of the products of shape functions along an element of length 1
LINE_MASS = {
    1: np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0,
    2: np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]]) / 30.0,
}

type Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class RailFit:
    """A rail as the mesh sees it.

    Attributes:
        axis: Axis of the component it runs along, 0..2.
        center: ``(3,)`` middle of its centre line [m].
        knots: ``(N + 4,)`` along the axis [m].
        points: ``(N, 3)`` places of the control points [m].
        operator: ``(3 n, 4 N)`` matrix C whose ``C^T u`` are the control values.
    """

    name: str
    axis: int
    center: FloatArray
    knots: FloatArray
    points: FloatArray
    patch: "MeshPatch"
    operator: FloatArray


def fit_rail(
    component: str,
    interface: Interface,
    patch: "MeshPatch",
    *,
    order: int = 2,
    own_mesh: bool = True,
) -> RailFit:
    """Return the least-squares fit of the motion of a strip by a spline of frames,
    ``integral |u - A d|^2 dA -> min``.

    A section of the strip moves and turns about the rail as the spline says. It may also turn about
    the two axes across the rail; that part is fitted too, so that no rigid motion is left over, but
    carriages do not see it: their pitch and yaw follow from the motion along the rail.

    Args:
        interface: The rail, with its direction and its number of control points.
        own_mesh: The mesh follows a size; else it is that of a file.

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
    splines = evaluate_splines(knots, patch.points[:, axis])
    columns = np.einsum("nk,nif->nikf", splines, fields).reshape(3 * len(patch.nodes), -1)
    weighted = np.zeros_like(columns)
    for direction in range(3):
        weighted[direction::3] = patch.weights @ columns[direction::3]
    gram = columns.T @ weighted
    if _condition(gram) >= CONDITION_LIMIT:
        pairs, coordinates = patch.weights.tocoo(), patch.points[:, axis]
        ends = np.sort([coordinates[pairs.row], coordinates[pairs.col]], axis=0).T
        pieces = merge_spans([(low, high) for low, high in ends if high > low])
        fault = describe_coarse_rail(interface, pieces, order=order, own_mesh=own_mesh)
        raise ModelError(f"component {component}: {fault}")
    fitted = scipy.linalg.solve(gram, weighted.T, assume_a="pos").T
    kept = fitted.reshape(len(weighted), interface.rail.control_points, -1)[
        :, :, :CONTROL_POINT_DOFS
    ]
    points = control_point_positions(knots, center, axis)
    return RailFit(
        interface.name, axis, center, knots, points, patch, kept.reshape(len(weighted), -1)
    )


def free_rails(fits: Sequence[RailFit], first: int, size: int) -> dict[str, Rail]:
    """Return the rails whose control values are dofs of their own."""
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


def _section_fields(patch: "MeshPatch", axis: int, center: FloatArray) -> FloatArray:
    """Return the displacement of the nodes ``(n, 3, f)`` under the motions of a section: x y z,
    about the rail, and about the axes across it.
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


def _condition(gram: FloatArray) -> float:
    """Return the condition of the fit, dofs scaled alike; inf where it is singular."""
    diagonal = gram.diagonal()
    if not (diagonal > 0.0).all():
        return math.inf
    scale = 1.0 / np.sqrt(diagonal)
    values = np.linalg.eigvalsh(scale[:, None] * gram * scale)
    return float(values[-1] / values[0]) if values[0] > 0.0 else math.inf


def merge_spans(spans: Sequence[Sequence[float]]) -> Spans:
    """Return the spans that touch or overlap as one, in rising order."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted((float(low), float(high)) for low, high in spans):
        if merged and low <= merged[-1][1] + THIN * abs(high):
            merged[-1] = merged[-1][0], max(merged[-1][1], high)
        else:
            merged.append((low, high))
    return tuple(merged)


def line_condition(lines: Sequence[FloatArray], control_points: int, order: int) -> float:
    """Return the condition of the fit to rows of elements straight across the rail.

    Elements, shape functions and splines are products then, and so is the fit: of the condition
    this is the factor along the rail.

    Args:
        lines: Ends of the elements along the rail [m], ascending, of each of its pieces.
    """
    knots = place_knots(float(lines[0][0]), float(lines[-1][-1]), control_points)
    gram = np.zeros((control_points, control_points))
    for ends in lines:
        starts, lengths = ends[:-1], np.diff(ends)
        nodes = starts[:, None] + lengths[:, None] * np.linspace(0.0, 1.0, order + 1)
        nodes = np.clip(nodes, knots[0], knots[-1])
        splines = evaluate_splines(knots, nodes.ravel())
        splines = splines.reshape(*nodes.shape, control_points)
        gram += np.einsum("e,ij,eik,ejl->kl", lengths, LINE_MASS[order], splines, splines)
    return _condition(gram)


@functools.cache
def longest_elements(pieces: Spans, control_points: int, order: int) -> float | None:
    """Return the longest elements that surely distinguish the control points of a rail [m]; None
    where no mesh does, because the rail has gaps.

    Args:
        pieces: Where the rail is along its axis [m].
    """
    interval = (pieces[-1][1] - pieces[0][0]) / (control_points - DEGREE)
    for length in LENGTHS:
        size = float(f"{length * interval:.2e}")
        lines = [
            np.linspace(low, high, math.ceil((high - low) / size - 1e-6) + 1, dtype=np.float64)
            for low, high in pieces
        ]
        if line_condition(lines, control_points, order) < SURE_LIMIT:
            return size
    return None


def describe_coarse_rail(
    interface: Interface, pieces: Spans, *, order: int, own_mesh: bool = True
) -> str:
    """Return why a mesh does not distinguish the control points of a rail, and what to write.

    Args:
        pieces: Where it is along its axis [m].
        own_mesh: The mesh follows a size; else it is that of a file.
    """
    count = DEGREE + 1 if interface.rail is None else interface.rail.control_points
    longest = longest_elements(pieces, count, order)
    what = f"along rail {interface.name} to tell its {count} control points apart"
    if longest is None:
        low, high = max(
            ((end, start) for (_, end), (start, _) in itertools.pairwise(pieces)),
            key=lambda gap: gap[1] - gap[0],
            default=(pieces[0][0], pieces[-1][1]),
        )
        return (
            f"no mesh has points enough {what}: it has a gap of {1e3 * (high - low):.3g} mm; close the gap, or write an interface for each "
            "of its pieces"
        )
    size = f'"{1e3 * longest:.3g} mm"'
    remedy = (
        f"write a mesh size of {size} or less"
        if own_mesh
        else f"write a mesh file with elements of {size} or less along the rail"
    )
    return f"the mesh has too few points {what}; {remedy}"
