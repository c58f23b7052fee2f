"""Deformation shapes of a flat patch, in addition to the six rigid motions and orthogonal to them:
products of Legendre polynomials over a rectangle, polynomials of radius and angle over a disk or a
ring.
"""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.patches import Outline, in_plane_axes
from headstock.meshing.scipy_library import scipy

FIRST_LEVEL = 3  # shapes among the linear displacements; the other three are rotations
TIE = 1e-6  # levels closer than this are one, so that a square's two directions are treated alike
DISK_COST = 2  # of a further zero along the radius: what it adds to the degree of a polynomial


@dataclass(frozen=True, eq=False)
class PatchShapes:
    """Shapes that an interface keeps besides its rigid motions, in component axes.

    A rigid motion of the component has all their dofs at zero. Each shape has a mean square of one
    over the area, so that its dof is a length.

    Attributes:
        center: ``(3,)`` of the area [m].
        normal: Axis of the component across the patch, 0..2.
        half_lengths: As those of the ``Outline``.
        first: Index of the first of their dofs in the superelement.
        strong: The patch's displacement is in their span; else only its moments are those of one.
        hole: As that of the ``Outline``.
    """

    center: FloatArray
    normal: int
    half_lengths: FloatArray
    count: int
    first: int
    strong: bool
    hole: float | None = None

    @property
    def outline(self) -> Outline:
        """The area."""
        return Outline(self.half_lengths, self.hole)


def list_degrees(outline: Outline, most: int) -> list[tuple[int, int]]:
    """Return the degrees of the polynomials, level by level, for at most so many shapes: along both
    in-plane axes of a rectangle; zeros along the radius and waves around a disk or a ring, cosines
    with waves above zero and sines below.

    A level is there as a whole or not at all, so that the basis is the same seen from both sides of
    a joint and each basis contains the smaller ones. Along a strip degrees rise alone: across it the
    linear ones come at once (a bent plate turns about its edge), the others by the aspect ratio
    later; likewise around a thin ring. Over a square and a disk levels are total degrees.

    Args:
        most: Shapes besides the rigid motions; the first level has three, which with the rigid
            motions span all linear displacements.
    """
    if most < FIRST_LEVEL:
        return []
    top = 2 + most // 3
    pairs, kept = (
        (_rectangle_pairs(outline, top), [(1, 0), (0, 1)])
        if outline.hole is None
        else (_round_pairs(outline.hole, top), [(0, 1), (0, -1)])
    )
    for _, level in groupby(
        sorted(pairs, key=pairs.__getitem__), key=lambda own: round(pairs[own] / TIE)
    ):
        added = list(level)
        if count_patch_shapes([*kept, *added]) > most:
            break
        kept += added
    return kept


def _rectangle_pairs(outline: Outline, top: int) -> dict[tuple[int, int], float]:
    """Return the degrees above the linear ones, each with its level."""
    half = outline.half_lengths
    aspect, long = float(half.max() / half.min()), int(np.argmax(half))

    def cost(pair: tuple[int, int]) -> float:
        across = pair[1 - long]
        return pair[long] + (across if across < 2 else 1.0 + aspect * (across - 1))

    every = ((i, j) for i in range(top) for j in range(top) if i + j > 1)
    return {pair: cost(pair) for pair in every if cost(pair) <= top}


def _round_pairs(hole: float, top: int) -> dict[tuple[int, int], float]:
    """Return zeros along the radius and waves around, above the linear ones, with levels."""
    # half the mean circumference over the width: as many half waves fit around as zeros across
    aspect = max(DISK_COST, 0.5 * np.pi * (1.0 + hole) / (1.0 - hole))

    def cost(pair: tuple[int, int]) -> float:
        zeros, waves = pair[0], abs(pair[1])
        return waves + (DISK_COST * zeros if zeros < 2 else DISK_COST + aspect * (zeros - 1))

    every = ((k, m) for k in range(top) for m in range(-top, top + 1) if 2 * k + abs(m) > 1)
    return {pair: cost(pair) for pair in every if cost(pair) <= top}


def count_patch_shapes(degrees: list[tuple[int, int]]) -> int:
    """Return the number of shapes of some degrees: three each, less three linear rotations."""
    return max(0, 3 * len(degrees) - FIRST_LEVEL)


def shape_fields(shapes: PatchShapes, points: FloatArray) -> FloatArray:
    """Return the displacement ``(3 k, count)`` of points ``(k, 3)`` per unit of each shape."""
    first, second = in_plane_axes(shapes.normal)
    a, b = shapes.half_lengths
    degrees = list_degrees(shapes.outline, shapes.count)
    places = (points - shapes.center)[:, [first, second]] / [a, b]
    values = (
        _legendre(degrees, places)
        if shapes.hole is None
        else _round_polynomials(degrees, places, shapes.hole)
    )
    fields = np.zeros((len(points), 3, 3 * len(degrees)))
    for number in range(len(degrees)):
        columns = slice(3 * number, 3 * number + 3)
        fields[:, :, columns] = values[:, number, None, None] * np.eye(3)
    if not degrees:
        return fields.reshape(3 * len(points), 0)
    # of the linear fields three are rotations: both along the normal, and one combination of the
    # two shears in the plane; the other combination is the shear
    stretches = fields[:, :, [first, 3 + second]]
    shear = (b * fields[:, :, second] + a * fields[:, :, 3 + first]) / np.hypot(a, b)
    kept = np.concatenate([stretches, shear[:, :, None], fields[:, :, 6:]], axis=2)
    return kept.reshape(3 * len(points), -1)


def _legendre(degrees: list[tuple[int, int]], places: FloatArray) -> FloatArray:
    """Return products ``(k, len(degrees))`` of mean square one at places ``(k, 2)`` in -1..1."""
    highest = max((max(pair) for pair in degrees), default=0)
    norms = np.sqrt(2.0 * np.arange(highest + 1) + 1.0)
    along, across = (
        np.polynomial.legendre.legvander(places[:, side], highest) * norms for side in (0, 1)
    )
    rows, columns = [pair[0] for pair in degrees], [pair[1] for pair in degrees]
    return along[:, rows] * across[:, columns]


def _round_polynomials(
    degrees: list[tuple[int, int]], places: FloatArray, hole: float
) -> FloatArray:
    """Return the polynomials ``(k, len(degrees))`` of mean square one over the disk or ring of
    outer radius one at places ``(k, 2)``: with m waves around r^m cos(m phi), r^m sin(m phi), each
    times polynomials of r^2 that are orthogonal to each other.

    Source: Zernike (1934) for the disk, Mahajan (1981), J. Opt. Soc. Am. 71, 75-85, for the ring.
    """
    values = np.zeros((len(places), len(degrees)))
    turned = places[:, 0] + 1j * places[:, 1]
    squares = np.abs(turned) ** 2
    for waves in {abs(pair[1]) for pair in degrees}:
        members = [(column, pair) for column, pair in enumerate(degrees) if abs(pair[1]) == waves]
        zeros = max(pair[0] for _, pair in members)
        radial = _radial_polynomials(zeros, waves, hole, squares)
        around = turned**waves * (np.sqrt(2.0) if waves else 1.0)
        for column, (number, signed) in members:
            values[:, column] = radial[:, number] * (around.imag if signed < 0 else around.real)
    return values


def _radial_polynomials(zeros: int, waves: int, hole: float, squares: FloatArray) -> FloatArray:
    """Return the polynomials ``(k, zeros + 1)`` of squared radii ``(k,)``, orthonormal under the
    weight r^(2 m) over the mean of the disk or ring.
    """
    nodes, weights = np.polynomial.legendre.leggauss(zeros + waves + 1)
    low, high = hole**2, 1.0

    def powers(at: FloatArray) -> FloatArray:
        return np.polynomial.legendre.legvander((2.0 * at - low - high) / (high - low), zeros)

    radii = 0.5 * (low + high) + 0.5 * (high - low) * nodes
    weighted = np.sqrt(0.5 * weights * radii**waves)[:, None] * powers(radii)
    triangle = np.asarray(np.linalg.qr(weighted)[1])
    triangle = np.where(np.diag(triangle) < 0.0, -1.0, 1.0)[:, None] * triangle
    values_at = scipy.linalg.solve_triangular(triangle, powers(squares).T, trans="T")
    return values_at.T


def gauss_rule(shapes: PatchShapes) -> tuple[FloatArray, FloatArray]:
    """Return the points ``(k, 3)`` of the area, component frame [m], and their weights, one in sum;
    exact for products of shapes.
    """
    degrees = list_degrees(shapes.outline, shapes.count)
    places, weights = (
        _rectangle_rule(degrees) if shapes.hole is None else _round_rule(degrees, shapes.hole)
    )
    first, second = in_plane_axes(shapes.normal)
    points = np.tile(shapes.center, (len(places), 1))
    points[:, [first, second]] += shapes.half_lengths * places
    return points, weights


def _rectangle_rule(degrees: list[tuple[int, int]]) -> tuple[FloatArray, FloatArray]:
    line, weights = np.polynomial.legendre.leggauss(max(max(pair) for pair in degrees) + 1)
    places = np.stack([np.repeat(line, len(line)), np.tile(line, len(line))], axis=1)
    return places, np.asarray(np.outer(weights, weights).ravel() / 4.0, dtype=float)


def _round_rule(degrees: list[tuple[int, int]], hole: float) -> tuple[FloatArray, FloatArray]:
    """Return a rule by squared radius and angle, which makes equal areas of equal steps."""
    highest = max(2 * zeros + abs(waves) for zeros, waves in degrees)
    line, weights = np.polynomial.legendre.leggauss(highest + 1)
    radii = np.sqrt(0.5 * (1.0 + hole**2) + 0.5 * (1.0 - hole**2) * line)
    angles = 2.0 * np.pi * (np.arange(2 * highest + 1) + 0.5) / (2 * highest + 1)
    places = np.stack([np.outer(radii, wave(angles)).ravel() for wave in (np.cos, np.sin)], axis=1)
    return places, np.repeat(0.5 * weights, len(angles)) / len(angles)
