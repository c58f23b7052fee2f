"""Deformation shapes of a flat patch: products of Legendre polynomials over its rectangle, beside
the six rigid motions and orthogonal to them.
"""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.patches import in_plane_axes

FIRST_LEVEL = 3  # shapes among the linear displacements; the other three are rotations
TIE = 1e-6  # levels closer than this are one, so that a square's two directions are treated alike


@dataclass(frozen=True, eq=False)
class PatchShapes:
    """Shapes that an interface keeps besides its rigid motions, in component axes.

    A rigid motion of the component has all their dofs at zero. Each shape has a mean square of one
    over the rectangle, so that its dof is a length.

    Attributes:
        center: ``(3,)`` of the rectangle [m].
        normal: Axis of the component across the patch, 0..2.
        half_lengths: ``(2,)`` of the rectangle along the two in-plane axes in the order x y z [m].
        count: Number of shapes.
        first: Index of the first of their dofs in the superelement.
        strong: The patch's displacement is in their span; else only its moments are those of one.
    """

    center: FloatArray
    normal: int
    half_lengths: FloatArray
    count: int
    first: int
    strong: bool


def list_degrees(half_lengths: FloatArray, most: int) -> list[tuple[int, int]]:
    """Degrees along both in-plane axes, level by level, for at most so many shapes.

    A level is there as a whole or not at all, so that the basis is the same seen from both sides of
    a joint and each basis contains the smaller ones. Along a strip degrees rise alone: across it the
    linear ones come at once (a bent plate turns about its edge), the others by the aspect ratio
    later.

    Args:
        half_lengths: ``(2,)`` of the rectangle [m].
        most: Shapes besides the rigid motions; the first level has three, which with the rigid
            motions span all linear displacements.
    """
    if most < FIRST_LEVEL:
        return []
    aspect = float(half_lengths.max() / half_lengths.min())
    long = int(np.argmax(half_lengths))

    def cost(pair: tuple[int, int]) -> float:
        across = pair[1 - long]
        return pair[long] + (across if across < 2 else 1.0 + aspect * (across - 1))

    top = 2 + most // 3
    pairs = [(i, j) for i in range(top) for j in range(top) if i + j > 1 and cost((i, j)) <= top]
    kept = [(1, 0), (0, 1)]
    for _, level in groupby(sorted(pairs, key=cost), key=lambda pair: round(cost(pair) / TIE)):
        added = list(level)
        if count_shapes([*kept, *added]) > most:
            break
        kept += added
    return kept


def count_shapes(degrees: list[tuple[int, int]]) -> int:
    """Number of shapes of some degrees: three each, less the three rotations in the linear ones."""
    return max(0, 3 * len(degrees) - FIRST_LEVEL)


def shape_fields(shapes: PatchShapes, points: FloatArray) -> FloatArray:
    """Displacement ``(3 k, count)`` of points ``(k, 3)`` of the component per unit of each shape."""
    first, second = in_plane_axes(shapes.normal)
    a, b = shapes.half_lengths
    degrees = list_degrees(shapes.half_lengths, shapes.count)
    values = _legendre(degrees, (points - shapes.center)[:, [first, second]] / [a, b])
    fields = np.zeros((len(points), 3, 3 * len(degrees)))
    for number in range(len(degrees)):
        columns = slice(3 * number, 3 * number + 3)
        fields[:, :, columns] = values[:, number, None, None] * np.eye(3)
    if not degrees:
        return fields.reshape(3 * len(points), 0)
    # of the linear fields three are rotations: (1, 0) and (0, 1) along the normal, and one
    # combination of the two shears in the plane; the other combination is the shear
    stretches = fields[:, :, [first, 3 + second]]
    shear = (b * fields[:, :, second] + a * fields[:, :, 3 + first]) / np.hypot(a, b)
    kept = np.concatenate([stretches, shear[:, :, None], fields[:, :, 6:]], axis=2)
    return np.asarray(kept.reshape(3 * len(points), -1))


def _legendre(degrees: list[tuple[int, int]], places: FloatArray) -> FloatArray:
    """Products ``(k, len(degrees))`` of mean square one at places ``(k, 2)`` in -1..1."""
    highest = max((max(pair) for pair in degrees), default=0)
    norms = np.sqrt(2.0 * np.arange(highest + 1) + 1.0)
    along, across = (
        np.polynomial.legendre.legvander(places[:, side], highest) * norms for side in (0, 1)
    )
    rows, columns = [pair[0] for pair in degrees], [pair[1] for pair in degrees]
    return np.asarray(along[:, rows] * across[:, columns])


def gauss_rule(shapes: PatchShapes) -> tuple[FloatArray, FloatArray]:
    """Points ``(k, 3)`` of the rectangle, component frame [m], and their weights, one in sum; exact
    for products of shapes.
    """
    highest = max(max(pair) for pair in list_degrees(shapes.half_lengths, shapes.count))
    line, weights = np.polynomial.legendre.leggauss(highest + 1)
    first, second = in_plane_axes(shapes.normal)
    points = np.tile(shapes.center, (len(line) ** 2, 1))
    points[:, first] += shapes.half_lengths[0] * np.repeat(line, len(line))
    points[:, second] += shapes.half_lengths[1] * np.tile(line, len(line))
    return points, np.asarray(np.outer(weights, weights).ravel() / 4.0, dtype=float)
