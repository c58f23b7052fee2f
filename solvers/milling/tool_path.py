"""Tool paths in a plane with closed-form derivatives: lines and arcs at constant feed, smoothed by
moving averages in time.

A moving average of length T is a finite impulse response interpolator (Biagiotti and Melchiorri
2012; Tajima and Sencer 2016). Its derivative is a difference, ``(p(t) - p(t - T)) / T``, and its
value needs an antiderivative of the path, which lines and arcs have in closed form. Three averages
limit the jerk, and positions, speeds and accelerations belong together to the last digit: nothing
is differenced numerically. Points in the plane are complex numbers inside.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.forces import Side, part_sign

if TYPE_CHECKING:  # every scene loads this module, and interpolation takes a third of a second
    from scipy.interpolate import BSpline

AVERAGES = 3
BLOCK_FACES: dict[Side, tuple[str, ...]] = {
    "right": ("lowest x", "highest y", "highest x", "lowest y"),
    "left": ("lowest x", "lowest y", "highest x", "highest y"),
}
SHORTEST_FACE = 5e-3  # of a straight cut that is evaluated [m]
STRAIGHT_BACK = math.radians(175.0)
TOUCHING = 1e-9  # of lengths [m]
# antiderivatives grow with the cube of time and are differenced at the scale of milliseconds:
# doubles would leave nanometres
ComplexArray = NDArray[np.complexfloating]
_WIDE = np.clongdouble


@dataclass(frozen=True, eq=False)
class _PiecewisePath:
    """``p(t) = sum_j poly_j tau^j + swing exp(i rate tau)``, ``tau`` from the start of each piece;
    constant before and after.

    Attributes:
        starts: ``(s,)`` start of each piece [s]; the first holds from minus infinity, the last to
            infinity.
        poly: ``(s, k)`` complex coefficients.
        swing: ``(s,)`` complex amplitude of arcs.
        rate: ``(s,)`` angular speed of arcs [rad/s]; 1 where there is no arc.
    """

    starts: FloatArray
    poly: ComplexArray
    swing: ComplexArray
    rate: FloatArray

    def at(self, times: NDArray[np.floating]) -> ComplexArray:
        """Values at times ``(n,)``."""
        piece = np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, None)
        tau = times.astype(np.longdouble) - self.starts[piece]
        value = np.zeros(len(times), dtype=_WIDE)
        for column in range(self.poly.shape[1] - 1, -1, -1):
            value = value * tau + self.poly[piece, column]
        return value + self.swing[piece] * np.exp(1j * self.rate[piece].astype(np.longdouble) * tau)

    def antiderivative(self) -> "_PiecewisePath":
        """The integral from the start of the first piece."""
        powers = np.arange(1, self.poly.shape[1] + 1)
        poly = np.concatenate([np.zeros((len(self.starts), 1)), self.poly / powers], axis=1).astype(
            _WIDE
        )
        swing = self.swing / (1j * self.rate)
        spans = np.diff(self.starts.astype(np.longdouble))
        poly[0, 0] = -swing[0]
        for piece, span in enumerate(spans):
            end = np.polynomial.polynomial.polyval(span, poly[piece])
            end = end + swing[piece] * np.exp(1j * np.longdouble(self.rate[piece]) * span)
            poly[piece + 1, 0] = end - swing[piece + 1]
        return _PiecewisePath(self.starts, poly, swing, self.rate)


@dataclass(frozen=True, eq=False)
class PathPoints:
    """A path at instants: ``(n, 3)`` positions [m], velocities [m/s] and accelerations [m/s^2],
    machine frame.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class _SmoothPath:
    """A path after :data:`AVERAGES` moving averages.

    Attributes:
        raw: The path before them.
        window: Length of each average [s].
        height: z of the plane [m].
        span: When it starts and ends [s].
    """

    raw: _PiecewisePath
    window: float
    height: float
    span: tuple[float, float]

    def at(self, times: FloatArray) -> PathPoints:
        """Positions, velocities and accelerations at times ``(n,)``."""
        primitives = [self.raw]
        for _ in range(AVERAGES):
            primitives.append(primitives[-1].antiderivative())
        # p' takes one antiderivative less and a difference more than p, p'' two
        values = [self._averaged(primitives[AVERAGES - order], times) for order in range(3)]
        position, velocity, acceleration = (
            np.stack([value.real, value.imag, np.zeros(len(times))], axis=-1).astype(float)
            for value in values
        )
        position[:, 2] = self.height
        return PathPoints(position, velocity, acceleration)

    def velocity(self, times: FloatArray) -> FloatArray:
        """``(n, 3)`` velocities alone, for a third of the work."""
        primitive = self.raw
        for _ in range(AVERAGES - 1):
            primitive = primitive.antiderivative()
        averaged = self._averaged(primitive, times)
        return np.stack([averaged.real, averaged.imag, np.zeros(len(times))], axis=-1).astype(float)

    def _averaged(self, primitive: _PiecewisePath, times: FloatArray) -> ComplexArray:
        weights = [(-1) ** k * math.comb(AVERAGES, k) for k in range(AVERAGES + 1)]
        # instants rounded to doubles would leave 2e-9 of the speed: an antiderivative is steep, and
        # divided by the window thrice
        wide, window = times.astype(np.longdouble), np.longdouble(self.window)
        total = sum(weight * primitive.at(wide - k * window) for k, weight in enumerate(weights))
        return total / window**AVERAGES


class ToolPath(Protocol):
    """A path in time, smooth enough to be accelerated along."""

    @property
    def span(self) -> tuple[float, float]:
        """Start and end [s]."""

    def at(self, times: FloatArray) -> PathPoints:
        """Positions, velocities and accelerations at times ``(n,)``."""

    def velocity(self, times: FloatArray) -> FloatArray:
        """``(n, 3)`` velocities alone."""


@dataclass(frozen=True, eq=False)
class StraightLine:
    """A line over the position along it.

    Attributes:
        start: ``(3,)`` where it begins [m].
        along: ``(3,)`` motion of the tool per travel along it.
    """

    start: FloatArray
    along: FloatArray

    def at(self, positions: FloatArray) -> PathPoints:
        """Points at positions ``(n,)``, and their first and second derivatives."""
        still = np.zeros((len(positions), 3))
        return PathPoints(self.start + positions[:, None] * self.along, still + self.along, still)


@dataclass(frozen=True, eq=False)
class TracedPath:
    """A path that was measured.

    Attributes:
        law: Its positions ``(3,)`` over time, with continuous second derivative.
        span: When it starts and ends [s].
    """

    law: "BSpline"
    span: tuple[float, float]

    def at(self, times: FloatArray) -> PathPoints:
        """Positions, velocities and accelerations at times ``(n,)``; at rest before and after."""
        position, velocity, acceleration = (
            np.asarray(self.law(np.clip(times, *self.span), nu=order)) for order in range(3)
        )
        return PathPoints(position, velocity, acceleration)

    def velocity(self, times: FloatArray) -> FloatArray:
        """``(n, 3)`` velocities alone."""
        return self.law(np.clip(times, *self.span), nu=1)


@dataclass(frozen=True)
class TraceFit:
    """How a spline went through measured positions.

    Attributes:
        residual: Root mean square of what it left, in the positions of the tool [m].
        off_path: Largest distance of the tool from its planned path, while it cuts [m].
    """

    residual: float
    off_path: float


@dataclass(frozen=True)
class SquareContour:
    """A square block milled around from outside: clockwise seen from above, so that it lies on the
    right of the travel, or counter-clockwise.

    Attributes:
        side: Of the finished block [m].
        center: Its centre in the machine frame [m].
        height: Of the tool point above the table [m].
        offset: Tool radius: the tool's centre runs so far outside the block, and around its corners
            on arcs of this radius [m].
        lead: Straight way before the first corner region and after the last [m].
        feed: Feed rate [m/s].
        window: Length of each of the three moving averages [s].
        part: On which side of the travel the block lies.
    """

    side: float
    center: tuple[float, float]
    height: float
    offset: float
    lead: float
    feed: float
    window: float
    part: Side = "right"


@dataclass(frozen=True)
class PolylineContour:
    """A line of corners that the tool's centre follows, the part on one side of it.

    Attributes:
        points: ``(x, y)`` of its corners in the machine frame [m].
        feeds: Feed rate to each corner but the first [m/s].
        radius: Of the arcs around its corners; zero for sharp ones, which the averages round [m].
        height: Of the tool point above the table [m].
        offset: Tool radius: the finished part lies so far beside the line [m].
        lead: Way before the part begins and after it ends [m].
        window: Length of each of the three moving averages [s].
        part: On which side of the travel the part lies.
    """

    points: tuple[tuple[float, float], ...]
    feeds: tuple[float, ...]
    radius: float
    height: float
    offset: float
    lead: float
    window: float
    part: Side = "right"


@dataclass(frozen=True, eq=False)
class StraightCut:
    """A straight cut of a contour, and the face of the part that it leaves.

    Attributes:
        start: ``(3,)`` where the face starts, at the height of the tool point, machine frame [m].
        travel: ``(3,)`` unit vector in which the tool goes along it.
        length: [m].
        feed: [m/s].
        begins: When the cut starts [s].
        ends: When the next straight cut starts, or this one ends if it is the last [s].
        part: On which side of the travel the part lies.
    """

    at: str
    start: FloatArray
    travel: FloatArray
    length: float
    feed: float
    begins: float
    ends: float
    part: Side = "right"

    @property
    def outward(self) -> FloatArray:
        """``(3,)`` unit vector away from the part."""
        return part_sign(self.part) * np.array([-self.travel[1], self.travel[0], 0.0])

    @property
    def middle(self) -> float:
        """Time half-way between its start and its end [s]."""
        return 0.5 * (self.begins + self.ends)


@dataclass(frozen=True, eq=False)
class ContourPlan:
    """A contour laid out in time.

    Attributes:
        path: Of the tool's centre.
        bends: When the tool has sped up, and when it enters and leaves arcs and corners, rising
            [s].
        enters: When the tool meets the part [s].
        leaves: When it has left it [s].
        entry: How long it takes to enter [s].
        exit: How long it takes to leave [s].
    """

    path: ToolPath
    cuts: tuple[StraightCut, ...]
    bends: FloatArray
    enters: float
    leaves: float
    entry: float
    exit: float


def describe_contour(contour: SquareContour | PolylineContour) -> str:
    """Describe where the tool goes, in a few words."""
    if isinstance(contour, SquareContour):
        return f"around a block of {1e3 * contour.side:g} mm"
    length = sum(math.dist(*ends) for ends in itertools.pairwise(contour.points))
    return f"along a line of {len(contour.points)} corners, {1e3 * length:.4g} mm"


def plan_contour(contour: SquareContour | PolylineContour) -> ContourPlan:
    """Lay a contour out in time. Times are those before smoothing; each moving average delays by
    half its length.

    Face 1 of a block is at the lowest x and cut towards +y, then face 2 at the highest y, face 3 at
    the highest x, face 4 at the lowest y; with the block on the left everything is mirrored in y.

    Raises:
        ValueError: An arc around a corner does not fit, or the line turns back on itself.
    """
    if isinstance(contour, PolylineContour):
        return _lay_out(contour, ())
    reach, (x, y) = 0.5 * contour.side + contour.offset, contour.center
    first, mirror = 0.5 * contour.side + contour.lead, part_sign(contour.part)
    corners = ((-reach, -first), (-reach, reach), (reach, reach), (reach, -reach), (-first, -reach))
    line = PolylineContour(
        points=tuple((x + right, y + mirror * up) for right, up in corners),
        feeds=4 * (contour.feed,),
        radius=contour.offset,
        height=contour.height,
        offset=contour.offset,
        lead=contour.lead,
        window=contour.window,
        part=contour.part,
    )
    return _lay_out(line, BLOCK_FACES[contour.part])


def _lay_out(line: PolylineContour, names: Sequence[str]) -> ContourPlan:
    """Straight lines and arcs in turn, each a piece of the path."""
    corners, travels, lengths, turns = _measure_corners(line)
    # so far from a corner the arc around it begins and ends
    cut_off = np.array([0.0, *(line.radius * np.tan(0.5 * np.abs(turns))), 0.0])
    straight = lengths - cut_off[1:] - cut_off[:-1]
    if (straight < -TOUCHING).any():
        shortest = int(np.argmin(straight))
        raise ValueError(
            f"arcs of {1e3 * line.radius:g} mm do not fit between points {shortest + 1} and {shortest + 2}, {1e3 * lengths[shortest]:.4g} mm apart"
        )
    begins = corners[:-1] + cut_off[:-1] * travels
    pieces, places = list[_Piece](), list[int]()
    for number, (here, travel, feed) in enumerate(zip(begins, travels, line.feeds, strict=True)):
        way = max(0.0, float(straight[number]))
        places.append(len(pieces))
        pieces.append(_Piece(way / feed, complex(here), complex(feed * travel)))
        if number < len(turns) and turns[number] != 0.0 and line.radius > 0.0:
            turn = float(turns[number])
            rate = math.copysign(min(line.feeds[number : number + 2]) / line.radius, turn)
            # from the centre of the arc to where it starts
            arm = complex(-1j * math.copysign(line.radius, turn) * travel)
            pieces.append(_Piece(turn / rate, complex(here + way * travel) - arm, 0.0, arm, rate))
    times = np.array([0.0, *itertools.accumulate(piece.duration for piece in pieces)])
    delay, end = 0.5 * AVERAGES * line.window, float(times[-1])
    return ContourPlan(
        path=_SmoothPath(
            _join_pieces(pieces, times, corners, line.window),
            line.window,
            line.height,
            (0.0, end + 2.0 * delay),
        ),
        cuts=_straight_cuts(line, names, times[places] + delay),
        bends=np.unique([2.0 * delay, *(times[1:-1] + delay)]),
        enters=line.lead / line.feeds[0] + delay,
        leaves=end - line.lead / line.feeds[-1] + delay,
        entry=line.offset / line.feeds[0],
        exit=line.offset / line.feeds[-1],
    )


class _Piece(NamedTuple):
    """A line or an arc of a path: its duration [s] and its terms."""

    duration: float
    here: complex
    speed: complex
    swing: complex = 0.0
    rate: float = 1.0


def _measure_corners(
    line: PolylineContour,
) -> tuple[ComplexArray, ComplexArray, FloatArray, FloatArray]:
    """Corners, unit vectors and lengths between them, and angles by which the travel turns."""
    corners = np.array([complex(*point) for point in line.points])
    ways = np.diff(corners)
    lengths = np.abs(ways)
    if not (lengths > TOUCHING).all():
        place = int(np.argmin(lengths)) + 1
        raise ValueError(f"points {place} and {place + 1} are in the same place")
    travels = ways / lengths
    turns = np.angle(travels[1:] / travels[:-1])
    if (np.abs(turns) > STRAIGHT_BACK).any():
        raise ValueError(
            f"the line turns back on itself at point {int(np.argmax(np.abs(turns))) + 2}"
        )
    for place in (0, -1):
        if lengths[place] <= line.lead:
            raise ValueError(
                f"the {'first' if place == 0 else 'last'} line is {1e3 * lengths[place]:.4g} mm long, no more than the lead of {1e3 * line.lead:g} mm"
            )
    return corners, travels, lengths, turns


def _join_pieces(
    pieces: Sequence[_Piece], times: FloatArray, corners: ComplexArray, window: float
) -> _PiecewisePath:
    """At rest before the first piece and after the last."""
    # a finite start keeps antiderivatives small
    still = _Piece(0.0, corners[0], 0.0), _Piece(0.0, corners[-1], 0.0)
    rows = [still[0], *pieces, still[1]]
    return _PiecewisePath(
        starts=np.array([-AVERAGES * window - 1e-3, *times]),
        poly=np.array([[row.here, row.speed] for row in rows], dtype=_WIDE),
        swing=np.array([row.swing for row in rows], dtype=complex),
        rate=np.array([row.rate for row in rows]),
    )


def _straight_cuts(
    line: PolylineContour, names: Sequence[str], starts: FloatArray
) -> tuple[StraightCut, ...]:
    """Straight lines whose face is long enough to be evaluated, without the way before and after
    the part.

    Args:
        line: Corners of the tool's centre.
        names: Of the faces; none for those of a line.
        starts: ``(s,)`` when straight lines start [s].
    """
    corners, travels, lengths, turns = _measure_corners(line)
    half, sign = np.tan(0.5 * np.abs(turns)), part_sign(line.part)
    arcs = np.array([0.0, *(line.radius * half), 0.0])
    # a face ends where it meets the next one of the part, or where the arc begins
    meets = np.where(sign * turns < 0.0, max(line.radius, line.offset), line.radius) * half
    before = np.array([line.lead, *meets]) - arcs[:-1]
    after = np.array([*meets, line.lead]) - arcs[1:]
    last, cuts = len(travels) - 1, list[StraightCut]()
    for number, (travel, feed) in enumerate(zip(travels, line.feeds, strict=True)):
        straight = lengths[number] - arcs[number] - arcs[number + 1]
        length = float(straight - before[number] - after[number])
        if length < SHORTEST_FACE:
            continue
        way = arcs[number] + before[number] - 1j * sign * line.offset
        start = corners[number] + way * travel
        leaves = starts[number] + (straight - after[number]) / feed
        cuts.append(
            StraightCut(
                at=names[number] if names else _tell_line(line.points[number : number + 2]),
                start=np.array([start.real, start.imag, line.height]),
                travel=np.array([travel.real, travel.imag, 0.0]),
                length=length,
                feed=feed,
                begins=float(starts[number] + before[number] / feed),
                ends=float(leaves if number == last else starts[number + 1]),
                part=line.part,
            )
        )
    return tuple(cuts)


def _tell_line(ends: Sequence[tuple[float, float]]) -> str:
    return " to ".join(f"({1e3 * x:.4g}, {1e3 * y:.4g})" for x, y in ends) + " mm"
