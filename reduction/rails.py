"""Rails: the motion of a strip as a cubic spline, and what a carriage anywhere on it sees of that
motion.
"""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_transfer, skew
from headstock.geometry.machine.carriages import (
    DEGREE,
    LEAST_INTERVALS,
    count_control_points,
    rail_span,
)
from headstock.geometry.machine.machine import show_position
from headstock.geometry.parts.components import Component, Interface
from headstock.geometry.parts.patches import OVERHANG_TOLERANCE
from headstock.solvers.errors import ModelError

CONTROL_POINT_DOFS = 4
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class ControlPoint:
    """A control point of a rail that has dofs of its own: ``x y z`` and the rotation about the
    rail, component axes.

    Attributes:
        point: ``(3,)`` place in the component frame [m]; in a rigid motion the dofs are those of
            this point.
        axis: Axis of the component the rail runs along, 0..2.
    """

    point: FloatArray
    axis: int


@dataclass(frozen=True, eq=False)
class Rail:
    """A straight strip whose motion is a spline: four control values (x y z, rotation about the
    rail) per control point.

    Attributes:
        axis: Axis of the component it runs along, 0..2.
        center: ``(3,)`` middle of its centre line in the component frame [m].
        low: Where it begins along its axis, component frame [m].
        high: Where it ends [m].
        knots: ``(N + degree + 1,)`` of the B-splines along the axis [m]; clamped, from the
            beginning to the end or beyond them.
        control: ``(4 N, n)`` control values per superelement dof, component axes.
        blur: What a carriage sees is averaged over places so far apart [m]: the distance of the
            control points where they have dofs of their own, zero where they follow from others.
    """

    axis: int
    center: FloatArray
    low: float
    high: float
    knots: FloatArray
    control: FloatArray
    blur: float = 0.0


def lay_out_rail(component: Component, interface: Interface, centroid: FloatArray) -> Rail:
    """Return a rail of a component that is not meshed, without control values: the smallest cubic
    spline between its ends.

    Args:
        centroid: ``(3,)`` of the rail's area, component frame [m].

    Raises:
        ModelError: Where it ends is not known.
    """
    if interface.rail is None:
        raise ValueError(f"interface {interface.name!r} is no rail")
    span = rail_span(component.solid, interface)
    if span is None:
        raise ModelError(
            f"component {component.name!r}: where rail {interface.name!r} ends is not known without a mesh; give its area as a rect"
        )
    axis = "xyz".index(interface.rail.along)
    center = np.array(centroid, dtype=float)
    low, high = span
    center[axis] = 0.5 * (low + high)
    return Rail(
        axis,
        center,
        low,
        high,
        place_knots(low, high, DEGREE + 1),
        np.zeros((CONTROL_POINT_DOFS * (DEGREE + 1), 0)),
    )


def place_knots(low: float, high: float, control_points: int) -> FloatArray:
    """Return the evenly spaced clamped knots ``(control_points + 4,)`` of cubic B-splines between
    the ends of a rail.

    Args:
        low: Where the rail begins along its axis [m].
        high: Where it ends [m].
        control_points: Number of control points, at least 4.

    Raises:
        ValueError: Fewer control points than a cubic needs.
    """
    if control_points <= DEGREE:
        raise ValueError(f"a rail needs at least {DEGREE + 1} control points, not {control_points}")
    inner = np.linspace(low, high, control_points - DEGREE + 1)
    return np.concatenate([np.full(DEGREE, low), inner, np.full(DEGREE, high)])


def evaluate_splines(knots: FloatArray, points: FloatArray, degree: int = DEGREE) -> FloatArray:
    """Return the B-splines ``(k, n)`` of clamped knots ``(n + degree + 1,)`` at points ``(k,)``; beyond
    the ends the polynomials there.

    Source: de Boor (2001), chapter X, the recurrence of the splines that are not zero.
    """
    count = len(knots) - degree - 1
    interval = np.clip(np.searchsorted(knots, points, side="right") - 1, degree, count - 1)
    values = np.zeros((degree + 1, len(points)))
    values[0] = 1.0
    for order in range(1, degree + 1):
        carried = np.zeros(len(points))
        for index in range(order):
            right, left = knots[interval + index + 1], knots[interval + index + 1 - order]
            share = values[index] / (right - left)
            values[index] = carried + (right - points) * share
            carried = (points - left) * share
        values[order] = carried
    splines = np.zeros((len(points), count))
    splines[np.arange(len(points))[:, None], interval[:, None] + np.arange(-degree, 1)] = values.T
    return splines


def control_point_positions(knots: FloatArray, center: FloatArray, axis: int) -> FloatArray:
    """Return the places ``(N, 3)`` of the control points on the centre line: there a spline field
    that is linear takes their values.

    Args:
        knots: ``(N + 4,)`` of the B-splines, clamped [m].
        center: ``(3,)`` middle of the centre line, component frame [m].
        axis: Axis of the component that the rail runs along, 0..2.

    Source: Greville (1969); de Boor (2001), chapter IX (Marsden's identity).
    """
    degree = _degree(knots)
    count = len(knots) - degree - 1
    points = np.tile(np.asarray(center, dtype=float), (count, 1))
    points[:, axis] = [knots[k + 1 : k + 1 + degree].mean() for k in range(count)]
    return points


def control_point_motion(point: FloatArray, axis: int, origin: FloatArray) -> FloatArray:
    """Return the control values ``(4, 6)`` of a control point, ``x y z`` and turn about the rail,
    under six unit rigid motions of the body.

    Args:
        point: ``(3,)`` the control point, component frame [m].
        axis: Axis of the component that the rail runs along, 0..2.
        origin: ``(3,)`` point about which the body rotates [m].
    """
    return rigid_transfer(origin, point)[[0, 1, 2, 3 + axis]]


def carriage_rows(rail: Rail, position: float, length: float) -> FloatArray:
    """Return the motion ``(6, n)`` of a carriage per superelement dof, component axes, at the
    centre line nearest to the carriage's middle.

    Translations and the rotation about the rail are the means of the rail's motion over the
    carriage, weighed evenly; pitch and yaw are the slopes of the straight line that fits the
    translations best. A force on the carriage spreads over the rail as the transpose says. All of
    it is three times continuously differentiable in the place.

    Args:
        position: Middle of the carriage along the rail's axis, component frame [m].
        length: Length of the carriage [m].

    Raises:
        ModelError: The carriage is longer than the rail, hangs over one of its ends, or is too
            short for the control points.
    """
    position = _check_position(rail, position, length)
    points, mean, slope = _weigh_carriage(rail.knots, position, length, rail.blur)
    splines = evaluate_splines(rail.knots, points, _degree(rail.knots))
    control = rail.control.reshape(splines.shape[1], CONTROL_POINT_DOFS, -1)
    means = np.tensordot(mean @ splines, control, axes=1)
    rows = np.zeros((6, control.shape[2]))
    rows[3:] = skew(np.eye(3)[rail.axis]) @ np.tensordot(slope @ splines, control[:, :3], axes=1)
    rows[:3], rows[3 + rail.axis] = means[:3], means[3]
    return rows


def _weigh_carriage(
    knots: FloatArray, position: float, length: float, blur: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the points ``(q,)`` along the rail [m], and per value there its part in the mean
    ``(q,)`` [-] and in the slope ``(q,)`` [1/m].

    An even weight over the carriage, averaged over all places within half a blur of its own: its
    spectrum is zero where the control points would be heard. Its lengths are such that the mean of
    parabolas and the slope of cubics are those over the carriage itself. Gauss rules between knots
    and edges are exact.
    """
    # second moment of the blurred even weight: flat^2/3 + blur^2/12 = length^2/12, that of the
    # carriage; third moment of the odd one over its first: 3 tilted^2/5 + blur^2/4 = 3 length^2/20
    flat = 0.5 * math.sqrt(length**2 - blur**2)
    tilted = 0.5 * math.sqrt(length**2 - 5.0 / 3.0 * blur**2)
    edges = position + np.array(
        [
            sign * half + side
            for sign in (-1, 1)
            for half in (flat, tilted)
            for side in (-0.5 * blur, 0.5 * blur)
        ]
    )
    inner = knots[(knots > edges.min()) & (knots < edges.max())]
    breaks = np.unique(np.concatenate([edges, inner]))
    middle, half = 0.5 * (breaks[1:] + breaks[:-1]), 0.5 * np.diff(breaks)
    points = np.asarray((middle[:, None] + half[:, None] * _GAUSS_NODES).ravel())
    parts = (half[:, None] * _GAUSS_WEIGHTS).ravel()
    mean, slope = (
        _blurred_weights(points - position, flat, tilted, blur)
        if blur
        else (1.0 / length, (points - position) * 12.0 / length**3)
    )
    return points, np.asarray(parts * mean, dtype=float), np.asarray(parts * slope, dtype=float)


def _blurred_weights(
    arms: FloatArray, flat: float, tilted: float, blur: float
) -> tuple[FloatArray, FloatArray]:
    """Return the running averages over a blur of an even weight ``(q,)`` between +- flat and of an
    odd one between +- tilted.
    """
    after, before = arms + 0.5 * blur, arms - 0.5 * blur
    mean = (np.clip(after, -flat, flat) - np.clip(before, -flat, flat)) / (2.0 * flat * blur)
    slope = (np.clip(after, -tilted, tilted) ** 2 - np.clip(before, -tilted, tilted) ** 2) * (
        0.75 / (tilted**3 * blur)
    )
    return np.asarray(mean), np.asarray(slope)


def _check_position(rail: Rail, position: float, length: float) -> float:
    slack = OVERHANG_TOLERANCE * (rail.high - rail.low)
    if not 0.0 < length <= rail.high - rail.low + slack:
        raise ModelError(
            f"a carriage of {show_position(length)} does not fit on a rail of {show_position(rail.high - rail.low)}; make the rail longer or the "
            "carriage shorter"
        )
    if length < LEAST_INTERVALS * rail.blur * (1.0 - OVERHANG_TOLERANCE):
        least = count_control_points(rail.high - rail.low, length, LEAST_INTERVALS)
        raise ModelError(
            f"{len(rail.control) // CONTROL_POINT_DOFS} control points are too few for a carriage of {show_position(length)} on a rail of "
            f"{show_position(rail.high - rail.low)}: the compliance would ripple from one to the next; take at least {least}"
        )
    over = max(rail.low - (position - 0.5 * length), position + 0.5 * length - rail.high)
    if over > slack:
        raise ModelError(
            f"a carriage of {show_position(length)} at {show_position(position)} hangs {show_position(over)} over the end of its rail, which runs from "
            f"{show_position(rail.low)} to {show_position(rail.high)}; move the axis by that much, or make the rail longer"
        )
    return float(np.clip(position, rail.low + 0.5 * length, rail.high - 0.5 * length))


def _degree(knots: FloatArray) -> int:
    """Return the degree of clamped knots: the first one is repeated once more than that."""
    return int(np.count_nonzero(knots == knots[0])) - 1
