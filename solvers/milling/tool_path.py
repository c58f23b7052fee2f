"""Tool paths in a plane with closed-form derivatives: lines and arcs at constant feed, smoothed by
moving averages in time.

A moving average of length T is a finite impulse response interpolator (Biagiotti and Melchiorri
2012; Tajima and Sencer 2016). Its derivative is a difference, ``(p(t) - p(t - T)) / T``, and its
value needs an antiderivative of the path, which lines and arcs have in closed form. Three averages
limit the jerk, and positions, speeds and accelerations belong together to the last digit: nothing
is differenced numerically. Points in the plane are complex numbers inside.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

AVERAGES = 3
# antiderivatives grow with the cube of time and are differenced at the scale of milliseconds:
# doubles would leave nanometres
ComplexArray = NDArray[np.complexfloating]
_WIDE = np.clongdouble


@dataclass(frozen=True, eq=False)
class PiecewisePath:
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
        return np.asarray(
            value + self.swing[piece] * np.exp(1j * self.rate[piece].astype(np.longdouble) * tau)
        )

    def antiderivative(self) -> "PiecewisePath":
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
        return PiecewisePath(self.starts, poly, swing, self.rate)


@dataclass(frozen=True, eq=False)
class PathPoints:
    """A path at instants: ``(n, 3)`` positions [m], velocities [m/s] and accelerations [m/s^2],
    machine frame.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A path after :data:`AVERAGES` moving averages.

    Attributes:
        raw: The path before them.
        window: Length of each average [s].
        height: z of the plane [m].
        span: When it starts and ends [s].
    """

    raw: PiecewisePath
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
        found = self._averaged(primitive, times)
        return np.stack([found.real, found.imag, np.zeros(len(times))], axis=-1).astype(float)

    def _averaged(self, primitive: PiecewisePath, times: FloatArray) -> ComplexArray:
        weights = [(-1) ** k * math.comb(AVERAGES, k) for k in range(AVERAGES + 1)]
        # instants rounded to doubles would leave 2e-9 of the speed: an antiderivative is steep, and
        # divided by the window thrice
        wide, window = times.astype(np.longdouble), np.longdouble(self.window)
        total = sum(weight * primitive.at(wide - k * window) for k, weight in enumerate(weights))
        return np.asarray(total / window**AVERAGES)


@dataclass(frozen=True)
class SquareContour:
    """A square block milled around from outside, clockwise seen from above, so that it lies on the
    right of the travel.

    Attributes:
        side: Of the finished block [m].
        center: Its centre in the machine frame [m].
        height: Of the tool point above the table [m].
        offset: Tool radius: the tool's centre runs so far outside the block, and around its corners
            on arcs of this radius [m].
        lead: Straight way before the first corner region and after the last [m].
        feed: Feed rate [m/s].
        window: Length of each of the three moving averages [s].
    """

    side: float
    center: tuple[float, float]
    height: float
    offset: float
    lead: float
    feed: float
    window: float


def square_path(contour: SquareContour) -> tuple[SmoothPath, FloatArray]:
    """The path of the tool's centre, and ``(5,)`` times at which the straight cuts along faces 1 to
    4 start and the last one ends.

    Face 1 is at the lowest x and cut towards +y, then face 2 at the highest y, face 3 at the
    highest x, face 4 at the lowest y. Times are those before smoothing; each moving average delays
    by half its length.
    """
    half, radius, feed = 0.5 * contour.side, contour.offset, contour.feed
    center = complex(*contour.center)
    starts, rate, face_times = [-math.inf], [1.0], list[float]()
    poly, swing = list[list[complex]](), list[complex]()
    corner = center + complex(-half, -half)
    direction = 1j
    here = corner + radius * 1j * direction - contour.lead * direction
    poly.append([here, 0.0])
    swing.append(0.0)
    now = 0.0

    def add(duration: float, coefficients: list[complex], amplitude: complex, speed: float) -> None:
        nonlocal now
        starts.append(now)
        poly.append(coefficients)
        swing.append(amplitude)
        rate.append(speed)
        now += duration

    for face in range(4):
        lead = (contour.lead if face == 0 else 0.0) + (contour.lead if face == 3 else 0.0)
        face_times.append(now + (contour.lead / feed if face == 0 else 0.0))
        add((contour.side + lead) / feed, [here, feed * direction], 0.0, 1.0)
        here += (contour.side + lead) * direction
        if face == 3:
            face_times.append(now - contour.lead / feed)
            break
        arm = radius * 1j * direction
        add(0.5 * math.pi * radius / feed, [here - arm, 0.0], arm, -feed / radius)
        here, direction = here - arm + arm * -1j, direction * -1j
    add(0.0, [here, 0.0], 0.0, 1.0)
    # a finite start keeps antiderivatives small
    times = np.array([-AVERAGES * contour.window - 1e-3, *starts[1:]])
    raw = PiecewisePath(
        times, np.array(poly, dtype=_WIDE), np.array(swing, dtype=_WIDE), np.array(rate)
    )
    delay = 0.5 * AVERAGES * contour.window
    return SmoothPath(raw, contour.window, contour.height, (0.0, now + 2.0 * delay)), np.array(
        face_times
    ) + delay
