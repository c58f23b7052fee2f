"""Displacements of a bar or block as polynomials over its whole volume: orthonormal functions, their
values at points, and the stiffness in closed form.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Material
from headstock.geometry.parts.patches import in_plane_axes
from headstock.geometry.parts.prismatic_bars import PrismaticBar
from headstock.geometry.parts.solids import Solid, Tube

DEPENDENCE_TOLERANCE = 1e-9  # of functions of a section, in squares
# of the frequency at which a tube ovalizes: below, hardly any of that is in bending and torsion
ROUND_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class PolynomialSpace:
    """Functions of a section times Legendre polynomials along the bar, orthonormal over the volume.

    Attributes:
        bar: The solid as a bar of one section.
        half: ``(2,)`` half sides of the rectangle around the section [m].
        degrees: ``(t, 2)`` degrees of the Legendre products over that rectangle.
        mix: ``(t, m)`` combinations of them that are orthonormal over the section.
        along: Highest degree along the bar.
        points: ``(q, 3)`` of the volume, for integrals of a function and a linear field.
        weights: ``(q,)`` of these [m^3].
        stiffness: ``(3 n, 3 n)`` of unit displacements, functions first: dof ``3 k + i`` moves
            along axis i by function k [N/m times m^3].
    """

    bar: PrismaticBar
    half: FloatArray
    degrees: FloatArray
    mix: FloatArray
    along: int
    points: FloatArray
    weights: FloatArray
    stiffness: FloatArray

    @property
    def count(self) -> int:
        """Number n of functions."""
        return self.mix.shape[1] * (self.along + 1)

    def values(self, points: FloatArray) -> FloatArray:
        """Return the functions ``(k, n)`` at points ``(k, 3)`` of the component."""
        local = points - self.bar.center
        across = local[:, list(in_plane_axes(self.bar.axis))]
        section = _products(across, self.half, self.degrees, None) @ self.mix
        along = _legendre(local[:, self.bar.axis], 0.5 * self.bar.length, self.along, False)
        return np.einsum("ki,kj->kij", section, along).reshape(len(points), -1)

    def move(self, points: FloatArray, dofs: FloatArray) -> FloatArray:
        """Return the displacements ``(3 k, c)`` of points ``(k, 3)`` under dofs ``(3 n, c)``."""
        return _apply(self.values(points), dofs)

    def pull(self, points: FloatArray, forces: FloatArray) -> FloatArray:
        """Return forces ``(3 n, c)`` on the dofs by those on points ``(k, 3)``, ``(3 k, c)``."""
        return _apply(self.values(points).T, forces)

    def rigid_motion(self, origin: FloatArray) -> FloatArray:
        """Return the dofs ``(3 n, 6)`` of the rigid motions about a point."""
        motion = np.repeat(self.weights, 3)[:, None] * rigid_map(self.points, origin)
        return self.pull(self.points, motion)


def _apply(functions: FloatArray, columns: FloatArray) -> FloatArray:
    """Return the product ``(3 a, c)`` of functions ``(a, b)`` that take each axis alike, and
    columns ``(3 b, c)``.
    """
    return np.asarray(functions @ columns.reshape(functions.shape[1], -1)).reshape(
        3 * len(functions), -1
    )


def build_space(
    bar: PrismaticBar,
    solid: Tube | None,
    half: FloatArray,
    material: Material,
    *,
    across: Sequence[int],
    along: int,
) -> PolynomialSpace:
    """Return the polynomials up to some degrees over a bar.

    Args:
        bar: Its axis, ends and centre.
        solid: The tube, for a round section; None for a rectangular one.
        half: ``(2,)`` half sides of the rectangle around the section [m].
        across: Highest degrees along both sides of a rectangle; of a round section the first is
            that of all products.
        along: Highest degree along the bar.
    """
    pairs = [(i, j) for i in range(across[0] + 1) for j in range(across[1] + 1)]
    if solid is not None:
        pairs = [pair for pair in pairs if sum(pair) <= across[0]]
    degrees = np.array(pairs)
    places, weights = _section_rule(solid, half, int(degrees.max()) + 1)
    plain = _products(places, half, degrees, None)
    # what is constant over a thin wall, but for rounding, is no function of its own
    squares, vectors = np.linalg.eigh(plain.T @ (weights[:, None] * plain))
    kept = squares > DEPENDENCE_TOLERANCE * squares[-1]
    mix = vectors[:, kept] / np.sqrt(squares[kept])
    fields = [plain @ mix] + [_products(places, half, degrees, side) @ mix for side in (0, 1)]
    length = 0.5 * bar.length
    nodes, node_weights = np.polynomial.legendre.leggauss(along + 1)
    line_weights = length * node_weights
    lines = [_legendre(length * nodes, length, along, slope) for slope in (False, True)]
    first, second = in_plane_axes(bar.axis)
    # derivative along each axis: which section field, which line function
    parts = {first: (1, 0), second: (2, 0), bar.axis: (0, 1)}

    def gram(left: int, right: int) -> FloatArray:
        (a, p), (b, q) = parts[left], parts[right]
        section = fields[a].T @ (weights[:, None] * fields[b])
        return np.kron(section, lines[p].T @ (line_weights[:, None] * lines[q]))

    young, poisson = material.youngs_modulus, material.poisson_ratio
    shear = young / (2.0 * (1.0 + poisson))
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    grams = {(i, j): gram(i, j) for i in range(3) for j in range(i, 3)}
    grams |= {(j, i): grams[i, j].T for i in range(3) for j in range(i + 1, 3)}
    every = sum(grams[i, i] for i in range(3))
    count = len(grams[0, 0])
    stiffness = np.zeros((count, 3, count, 3))
    for i in range(3):
        for j in range(3):
            stiffness[:, i, :, j] = lame * grams[i, j] + shear * grams[j, i]
        stiffness[:, i, :, i] += shear * every
    points = np.tile(bar.center, (len(places) * len(nodes), 1))
    points[:, [first, second]] += np.repeat(places, len(nodes), axis=0)
    points[:, bar.axis] += np.tile(length * nodes, len(places))
    return PolynomialSpace(
        bar,
        half,
        degrees,
        mix,
        along,
        points,
        np.asarray(np.outer(weights, line_weights).ravel(), dtype=float),
        stiffness.reshape(3 * count, 3 * count),
    )


def _section_rule(
    solid: Tube | None, half: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the places ``(q, 2)`` from the middle of a section [m] and weights ``(q,)`` [m^2],
    exact for products of two functions of fewer degrees than the count.
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    if solid is None:
        a, b = half[0] * nodes, half[1] * nodes
        places = np.column_stack([np.repeat(a, count), np.tile(b, count)])
        return places, np.asarray(np.outer(half[0] * weights, half[1] * weights).ravel())
    inner, outer = 0.5 * solid.inner_diameter, 0.5 * solid.outer_diameter
    radii = 0.5 * (inner + outer) + 0.5 * (outer - inner) * nodes
    rings = 2 * count + 1
    angles = 2.0 * np.pi * np.arange(rings) / rings
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    areas = 0.5 * (outer - inner) * weights * radii * 2.0 * np.pi / rings
    return (radii[:, None, None] * circle).reshape(-1, 2), np.repeat(areas, rings)


def _products(
    places: FloatArray, half: FloatArray, degrees: FloatArray, slope: int | None
) -> FloatArray:
    """Return the Legendre products ``(k, t)`` over a rectangle at places ``(k, 2)``, or their
    derivatives along one side.
    """
    first, second = (
        _legendre(places[:, side], half[side], int(degrees[:, side].max()), side == slope)
        for side in (0, 1)
    )
    return first[:, degrees[:, 0]] * second[:, degrees[:, 1]]


def _legendre(places: FloatArray, half: float, degree: int, slope: bool) -> FloatArray:
    """Return the Legendre polynomials ``(k, degree + 1)`` of square integral one over
    ``-half .. half``, or their slopes.
    """
    norms = np.sqrt((np.arange(degree + 1) + 0.5) / half)
    if not slope:
        return np.polynomial.legendre.legvander(places / half, degree) * norms
    slopes = np.polynomial.legendre.legder(np.eye(degree + 1))
    values = np.polynomial.legendre.legvander(places / half, max(degree - 1, 0)) @ slopes
    return values * norms / half


def polynomial_limit(solid: Solid, material: Material) -> float:
    """Return the frequency [Hz] up to which polynomials of low degrees across a section lack none
    of its modes: a share of that at which a tube ovalizes; inf for other solids.

    Source: Hoppe (1871) for the ring; Blevins (1979), Formulas for Natural Frequency and Mode Shape.
    """
    if not isinstance(solid, Tube):
        return math.inf
    radius = (solid.outer_diameter + solid.inner_diameter) / 4.0
    thick = (solid.outer_diameter - solid.inner_diameter) / 2.0
    wave = math.sqrt(material.youngs_modulus / (12.0 * material.density))
    return ROUND_SHARE * math.sqrt(36.0 / 5.0) * wave * thick / (2.0 * math.pi * radius**2)
