"""Milling forces of a helical end mill by slices, with linear chip and edge coefficients and
runout.

``dF_t = (K_tc h + K_te) dz``, likewise radially and axially, with the uncut chip thickness ``h =
f_z cos(theta)`` plus runout (Altintas 2012, Manufacturing Automation, sec. 2.8).

Axes are those of the part: along the travel of the tool, away from the part, up. ``theta`` is
counted from the travel towards "away", so a tooth points at the finished face at ``-pi / 2``, where
its chip has no thickness. Milling down (climb) it leaves the part there, and ``theta`` falls; milling
up (conventional) it enters there, and ``theta`` rises. With the part on the right of the travel these
axes are right-handed and a tool that mills down turns clockwise seen from above; with the part on the
left everything is its mirror image: :func:`part_sign` turns "away" from the left of the travel to its
right, and the same sense of milling is that of a spindle that turns the other way.
"""

import functools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.coefficients import CuttingCoefficients as CuttingCoefficients

CHUNK = 4096
STRAIGHT = 1e-6  # twist of an edge over the depth [rad] below which it has none
Sense = Literal["down", "up"]
Side = Literal["right", "left"]


@dataclass(frozen=True)
class EndMill:
    """A cylindrical end mill.

    Attributes:
        diameter: [m].
        helix: Helix angle [rad]; positive pulls the tool down, as a right-hand helix on a clockwise
            tool does, or a left-hand one on its mirror image.
        runout: Distance of the tool's axis from the spindle's [m].
        runout_angle: Where the first tooth stands from the direction of the runout [rad].
    """

    diameter: float
    teeth: int
    helix: float = 0.0
    runout: float = 0.0
    runout_angle: float = 0.0


@dataclass(frozen=True)
class MillingCut:
    """A cut along a straight or slowly turning face.

    Attributes:
        spindle: Speed [rad/s].
        axial_depth: [m].
        radial_depth: [m]; at most the diameter, a slot.
        slices: Discs the engaged length is cut into.
        sense: Down, with teeth that leave the part where the finished face begins, or up, with teeth
            that enter there.
    """

    mill: EndMill
    coefficients: CuttingCoefficients
    spindle: float
    axial_depth: float
    radial_depth: float
    slices: int = 20
    sense: Sense = "down"

    @property
    def spin(self) -> float:
        """1 where ``theta`` falls, milling down; -1 where it rises."""
        return spin_of(self.sense)

    @property
    def upwards(self) -> float:
        """Sign of the axial force: -1 where the helix pulls the tool down."""
        return -float(np.sign(self.mill.helix or 1.0))

    @property
    def tooth_period(self) -> float:
        """Time from tooth to tooth [s]."""
        return 2.0 * np.pi / (self.spindle * self.mill.teeth)


def spin_of(sense: Sense) -> float:
    """Sign of the tangential force in the axes of the part: 1 milling down, -1 milling up."""
    return 1.0 if sense == "down" else -1.0


def part_sign(side: Side) -> float:
    """1 with the part on the right of the travel, where "away" is the left of the travel; -1 with
    the part on the left.
    """
    return 1.0 if side == "right" else -1.0


def clockwise_side(sense: Sense) -> Side:
    """Return where the part lies if the tool turns clockwise seen from above."""
    return "right" if sense == "down" else "left"


def engagement_angles(mill: EndMill, radial_depth: float) -> tuple[float, float]:
    """Between which angles ``theta`` a tooth is in the part [rad], the same for both senses: from
    the finished face at ``-pi / 2`` to the uncut one; ``pi / 2`` in a slot.

    A tooth that mills down enters at the second and leaves at the first, one that mills up the other
    way round.

    Args:
        radial_depth: At most the diameter [m].
    """
    beside = 1.0 - 2.0 * radial_depth / mill.diameter
    return -0.5 * math.pi, -math.asin(min(max(beside, -1.0), 1.0))


def describe_sense(sense: Sense, side: Side) -> str:
    """The sense of milling in words, with the side of the part and how the tool then turns."""
    name = "down (climb) milling" if sense == "down" else "up (conventional) milling"
    turns = "clockwise" if side == clockwise_side(sense) else "counter-clockwise"
    return f"{name}: the part lies on the {side} of the travel and the tool turns {turns} seen from above"


def cutting_forces(cut: MillingCut, times: FloatArray, feed: FloatArray) -> FloatArray:
    """Force on the tool ``(n, 3)`` [N]: along the travel, away from the part, upwards.

    Args:
        cut: Tool, material and engagement.
        times: ``(n,)`` [s].
        feed: ``(n,)`` feed rate [m/s]; no force where it is zero.

    Raises:
        ModelError: The tool cannot stand so deep in the part.
    """
    if not 0.0 < cut.radial_depth <= cut.mill.diameter:
        raise ModelError(
            f"a radial depth of {1e3 * cut.radial_depth:g} mm is not between zero and the tool's diameter,"
            f" {1e3 * cut.mill.diameter:g} mm"
        )
    parts = [
        _chunk_forces(cut, times[start : start + CHUNK], feed[start : start + CHUNK])
        for start in range(0, len(times), CHUNK)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def repeated_forces(cut: MillingCut, steps_per_turn: int, feed: FloatArray) -> FloatArray:
    """As :func:`cutting_forces` at even steps from time zero, each turn's angles evaluated once
    where chips grow with the feed.

    Args:
        cut: Tool, material and engagement.
        feed: ``(n,)`` feed rate at the steps [m/s]; no force where it is zero.

    Returns:
        ``(n, 3)`` force on the tool [N]: along the travel, away from the part, upwards.

    Raises:
        ModelError: The tool cannot stand so deep in the part.
    """
    turn = 2.0 * np.pi / cut.spindle
    if cut.mill.runout > 0.0 or len(feed) < 2 * steps_per_turn:
        return cutting_forces(cut, np.arange(len(feed)) * turn / steps_per_turn, feed)
    instants = np.arange(steps_per_turn) * turn / steps_per_turn
    one = float(feed.max(initial=1e-9)) or 1e-9
    # without runout no chip vanishes before the feed does, so forces are a line in it
    half, whole = (
        cutting_forces(cut, instants, np.full(steps_per_turn, share * one)) for share in (0.5, 1.0)
    )
    slope, edge = 2.0 * (whole - half) / one, 2.0 * half - whole
    phase = np.arange(len(feed)) % steps_per_turn
    return (slope[phase] * feed[:, None] + edge[phase]) * (feed > 0.0)[:, None]


def tooth_angles(cut: MillingCut, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle of each tooth at the middle of each slice ``(n, teeth, slices)`` [rad], and the lag of
    each tooth ``(teeth,)``.
    """
    lag = 2.0 * np.pi * np.arange(cut.mill.teeth) / cut.mill.teeth
    middles = (np.arange(cut.slices) + 0.5) * cut.axial_depth / cut.slices
    twist = 2.0 * middles * np.tan(cut.mill.helix) / cut.mill.diameter
    return -cut.spin * (cut.spindle * times[:, None, None] + lag[:, None] - twist), lag


def engaged(cut: MillingCut, theta: FloatArray) -> FloatArray:
    """1 where a tooth is in the part: in front of the tool's centre and nearer to the finished face
    than the uncut one, see :func:`engagement_angles`.
    """
    return _engaged(cut, np.sin(theta), np.cos(theta))


def _engaged(cut: MillingCut, sine: FloatArray, cosine: FloatArray) -> FloatArray:
    depth = 1.0 - 2.0 * cut.radial_depth / cut.mill.diameter
    return np.asarray((sine < -depth) & (cosine > 0.0), dtype=float)


def push_tool(
    cut: MillingCut, coefficients: tuple[float, float, float], theta: FloatArray
) -> FloatArray:
    """Force on the tool ``(3, ...)`` of teeth at angles ``(...)``, per width and chip with chip
    coefficients, per width with those of the edge: along the travel, away from the part, up.
    """
    tangential, radial, axial = coefficients
    tangential *= cut.spin
    sine, cosine = np.sin(theta), np.cos(theta)
    return np.stack(
        [
            -tangential * sine - radial * cosine,
            tangential * cosine - radial * sine,
            np.full_like(theta, cut.upwards * axial),
        ]
    )


def radius_differences(mill: EndMill, lag: FloatArray, back: int = 1) -> FloatArray:
    """By how much each tooth stands out further, owing to runout, than an earlier one whose surface
    it cuts.

    Args:
        lag: ``(teeth,)`` angle of each tooth behind the first [rad].
        back: How many teeth before it the other one passed.

    Returns:
        ``(teeth,)`` [m].
    """
    radii = mill.runout * np.cos(lag + mill.runout_angle)
    # in either sense the tooth with the larger lag has passed earlier
    return radii - np.roll(radii, -back)


def _chunk_forces(cut: MillingCut, times: FloatArray, feed: FloatArray) -> FloatArray:
    theta, lag = tooth_angles(cut, times)
    per_tooth = feed * cut.tooth_period
    mill = cut.mill
    chip = per_tooth[:, None, None] * np.cos(theta) + radius_differences(mill, lag)[:, None]
    cutting = (
        engaged(cut, theta)
        * (chip > 0.0)
        * (feed > 0.0)[:, None, None]
        * cut.axial_depth
        / cut.slices
    )
    force = push_tool(cut, cut.coefficients.chip, theta) * chip
    force += push_tool(cut, cut.coefficients.edge, theta)
    return (force * cutting).sum(axis=(2, 3)).T


def regeneration_stiffness(cut: MillingCut, times: FloatArray) -> FloatArray:
    """Force per motion of the tool towards the part since the tooth before, ``(n, 3, 3)`` [N/m],
    axes as the forces.

    A tooth at ``theta`` meets a chip thicker by the tool's motion along its radius, ``(cos, sin,
    0)``, since the last tooth passed; linear as long as teeth stay in the cut (Altintas 2012, sec.
    3.4).
    """
    theta, _ = tooth_angles(cut, times)
    width = engaged(cut, theta) * cut.axial_depth / cut.slices
    force = push_tool(cut, cut.coefficients.chip, theta)
    normal = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)])
    return np.einsum("njs,anjs,bnjs->nab", width, force, normal)


def chip_stiffness(cut: MillingCut, times: FloatArray, depth: float) -> FloatArray:
    """As :func:`regeneration_stiffness`, ``(n, 3, 2)`` for motions along and away, with the helix in
    closed form instead of slices.

    Args:
        cut: Tool, material and engagement; its axial depth has no part in it.
        times: ``(n,)`` [s].
        depth: Axial depth [m].
    """
    lag = 2.0 * np.pi * np.arange(cut.mill.teeth) / cut.mill.teeth
    low = -cut.spin * (cut.spindle * times + lag[:, None])
    twist = cut.spin * 2.0 * depth * math.tan(cut.mill.helix) / cut.mill.diameter
    if abs(twist) < STRAIGHT:
        sine, cosine = np.sin(low), np.cos(low)
        products = np.array([sine * sine, sine * cosine, cosine * cosine, sine, cosine])
        means = (products * _engaged(cut, sine, cosine)).sum(axis=1)
    else:
        ends = _engaged_products(cut, np.concatenate([low + twist, low], axis=1))
        means = (ends[:, : len(times)] - ends[:, len(times) :]) / twist
    tangential, radial, axial = cut.coefficients.chip
    tangential, upwards = cut.spin * tangential, cut.upwards * axial
    # of sin^2, sin cos, cos^2, sin and cos
    shares = np.array(
        [
            [0.0, -tangential, -radial, 0.0, 0.0],
            [-tangential, -radial, 0.0, 0.0, 0.0],
            [0.0, -radial, tangential, 0.0, 0.0],
            [-radial, tangential, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, upwards],
            [0.0, 0.0, 0.0, upwards, 0.0],
        ]
    )
    return (means.T @ (depth * shares.T)).reshape(-1, 3, 2)


def _engaged_products(cut: MillingCut, theta: FloatArray) -> FloatArray:
    """``(5, n)`` integrals of sin^2, sin cos, cos^2, sin and cos over angles up to ``theta`` at which
    a tooth cuts, from the beginning of one cut on, all teeth ``(z, n)`` together.
    """
    begin, end = engagement_angles(cut.mill, cut.radial_depth)
    arc = end - begin
    turns = np.floor((theta - begin) / (2.0 * np.pi))
    # from -pi/2 on the sine is minus the cosine of the angle since then, the cosine its sine
    since = np.minimum(theta - begin - 2.0 * np.pi * turns, arc)
    return _integrate_products(since) + _whole_products(arc) * turns.sum(axis=0)


@functools.lru_cache(maxsize=16)
def _whole_products(arc: float) -> FloatArray:
    return _integrate_products(np.full((1, 1), arc))


def _integrate_products(angles: FloatArray) -> FloatArray:
    """``(5, n)`` integrals from -pi/2 on over angles ``(z, n)``, in sum."""
    sine, cosine = np.sin(angles), np.cos(angles)
    half, mixed = 0.5 * angles.sum(axis=0), 0.5 * (sine * cosine).sum(axis=0)
    square = (sine * sine).sum(axis=0)
    return np.array(
        [
            half + mixed,
            -0.5 * square,
            half - mixed,
            -sine.sum(axis=0),
            len(angles) - cosine.sum(axis=0),
        ]
    )
