"""Straight bars of one section among the solids: axis, section properties and ends, for segmented
models and beam theories.
"""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import (
    FACE_DIRECTIONS,
    band_span,
    imprint_window,
    in_plane_axes,
)
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube

SERIES_TERMS = 60


@dataclass(frozen=True, eq=False)
class PrismaticBar:
    """A straight bar of one section along an axis of its component.

    Attributes:
        axis: Direction of the bar, 0..2.
        low: Place of its lower end along the axis [m].
        high: Place of its upper end along the axis [m].
        center: ``(3,)`` middle of the bar in the component frame [m].
        area: Area of the section [m^2].
        second_moments: Second moments of area [m^4] for bending in the two directions across the
            axis, in the order x y z.
        torsion_constant: Saint-Venant's constant [m^4].
        hollow_ratio: Inner over outer diameter of a round section; None for a rectangular one.
        bending_factor: Bending stiffness over that of the section.
        torsion_factor: Torsional stiffness over that of the section.
    """

    axis: int
    low: float
    high: float
    center: FloatArray
    area: float
    second_moments: tuple[float, float]
    torsion_constant: float
    hollow_ratio: float | None = None
    bending_factor: float = 1.0
    torsion_factor: float = 1.0

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.high - self.low


def prismatic_bar(solid: Solid, along: str | None = None) -> PrismaticBar:
    """Return a solid as a bar of one section.

    Args:
        solid: A box, a plate without ribs, or a tube along z.
        along: ``x``, ``y`` or ``z``; None takes the longest side.

    Raises:
        ValueError: The solid has not the same section all along the axis, or its section is not
            known.
    """
    if isinstance(solid, Tube):
        return _round_bar(solid, along)
    if isinstance(solid, Plate) and not (solid.ribs_x or solid.ribs_y):
        return _rectangular_bar(solid.size, along)
    if isinstance(solid, Box):
        return _rectangular_bar(solid.size, along)
    if isinstance(solid, HollowColumn):
        raise ValueError("its section changes along it: a hollow column has caps and ribs")
    if isinstance(solid, Plate):
        raise ValueError("it has ribs, and the shear and torsion of a ribbed section are not known")
    raise ValueError("its section is not known: it is read from a file")


def shear_coefficient(bar: PrismaticBar, poisson_ratio: float) -> float:
    """Return the shear coefficient kappa of the section [-].

    Source: Cowper (1966), table 1: rectangle and hollow circle.
    """
    nu = poisson_ratio
    if bar.hollow_ratio is None:
        return 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    square = (1.0 + bar.hollow_ratio**2) ** 2
    return (
        6.0
        * (1.0 + nu)
        * square
        / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * bar.hollow_ratio**2)
    )


def patch_span(bar: PrismaticBar, patch: Patch) -> tuple[float, float]:
    """Return where along a bar a patch begins and ends [m]; the same place twice for one on an end
    face.

    Raises:
        ValueError: Only a CAD kernel knows where the face lies.
    """
    if patch.face in ("outer", "inner"):
        return band_span(patch, bar.low, bar.high)
    if patch.face not in FACE_DIRECTIONS:
        raise ValueError(
            f"where its face {patch.face!r} lies along the bar is not known; write x- x+ y- y+ z- or z+"
        )
    normal, sign = FACE_DIRECTIONS[patch.face]
    if normal == bar.axis:
        end = bar.low if sign < 0.0 else bar.high
        return end, end
    if patch.shape == "whole":
        return bar.low, bar.high
    first = 2 * in_plane_axes(normal).index(bar.axis)
    start, stop = imprint_window(normal, patch)[first : first + 2]
    return max(start, bar.low), min(stop, bar.high)


def _rectangular_bar(size: tuple[float, float, float], along: str | None) -> PrismaticBar:
    axis = int(np.argmax(size)) if along is None else "xyz".index(along)
    center = np.array([0.0, 0.0, 0.5 * size[2]])
    p, q = (size[i] for i in in_plane_axes(axis))
    return PrismaticBar(
        axis=axis,
        low=float(center[axis] - 0.5 * size[axis]),
        high=float(center[axis] + 0.5 * size[axis]),
        center=center,
        area=p * q,
        second_moments=(q * p**3 / 12.0, p * q**3 / 12.0),
        torsion_constant=_rectangle_torsion_constant(p, q),
    )


def _rectangle_torsion_constant(side: float, other_side: float) -> float:
    """Return the torsion constant [m^4] of a rectangle [m].

    Source: Saint-Venant (1855); Timoshenko and Goodier (1970), section 109, equation 160.
    """
    long, short = max(side, other_side), min(side, other_side)
    odd = np.arange(1, 2 * SERIES_TERMS, 2)
    series = float(np.sum(np.tanh(odd * math.pi * long / (2.0 * short)) / odd**5.0))
    return long * short**3 * (1.0 / 3.0 - 64.0 * short / (math.pi**5 * long) * series)


def _round_bar(tube: Tube, along: str | None) -> PrismaticBar:
    if along not in (None, "z"):
        raise ValueError(f"a tube has the same section along z only, not along {along}")
    outer, inner = 0.5 * tube.outer_diameter, 0.5 * tube.inner_diameter
    second = math.pi * (outer**4 - inner**4) / 4.0
    return PrismaticBar(
        axis=2,
        low=0.0,
        high=tube.length,
        center=np.array([0.0, 0.0, 0.5 * tube.length]),
        area=math.pi * (outer**2 - inner**2),
        second_moments=(second, second),
        torsion_constant=2.0 * second,
        hollow_ratio=inner / outer,
    )
