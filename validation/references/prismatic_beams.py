"""A straight beam of rectangular section, and the roots of a characteristic equation one after the
other.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from scipy.optimize import brentq

from headstock.geometry.parts.components import Material

EndConditions = Literal["clamped-free", "clamped-clamped", "free-free", "supported-supported"]
MAXIMUM_STEPS = 200_000


@dataclass(frozen=True)
class PrismaticBeam:
    """A straight beam of rectangular section that bends in the direction of its depth.

    Attributes:
        length: Span [m].
        width: Side of the section normal to the bending plane [m].
        depth: Side of the section in the bending plane [m].
    """

    length: float
    width: float
    depth: float
    material: Material

    @property
    def area(self) -> float:
        """Area of the section [m^2]."""
        return self.width * self.depth

    @property
    def second_moment(self) -> float:
        """Second moment of area for bending in the direction of the depth [m^4]."""
        return self.width * self.depth**3 / 12.0

    @property
    def polar_moment(self) -> float:
        """Polar second moment of area about the centroid, which carries the rotary inertia of
        torsion [m^4].
        """
        return self.area * (self.width**2 + self.depth**2) / 12.0

    @property
    def shear_modulus(self) -> float:
        """G [Pa]."""
        return self.material.youngs_modulus / (2.0 * (1.0 + self.material.poisson_ratio))

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.material.youngs_modulus * self.second_moment

    @property
    def mass_per_length(self) -> float:
        """Rho A [kg/m]."""
        return self.material.density * self.area


def turn_section(beam: PrismaticBeam) -> PrismaticBeam:
    """Return the same beam bending in the direction of its width."""
    return PrismaticBeam(beam.length, beam.depth, beam.width, beam.material)


def bracket_roots(
    function: Callable[[float], float], count: int, *, start: float, step: float
) -> list[float]:
    """Return the first roots of a function above a start, by walking until its sign changes and
    closing in by Brent's method.

    Args:
        function: Continuous, with simple roots further apart than ``step``.
        count: Number of roots wanted.
        start: Where to begin; not itself a root.

    Returns:
        ``count`` roots in rising order.

    Raises:
        ValueError: Fewer roots lie within the first 200000 steps.

    Source: Brent (1973), chapter 4.
    """
    roots: list[float] = []
    low, value_low = start, function(start)
    for number in range(1, MAXIMUM_STEPS + 1):
        if len(roots) == count:
            return roots
        high = start + number * step
        value_high = function(high)
        if value_low * value_high <= 0.0 and value_high != 0.0:
            roots.append(float(brentq(function, low, high, xtol=1e-15 * high, rtol=1e-14)))
        low, value_low = high, value_high
    raise ValueError(f"only {len(roots)} of {count} roots lie between {start:g} and {low:g}")
