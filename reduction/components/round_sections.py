"""How far the section of a tube stays round."""

import math

from headstock.geometry.parts.components import Material
from headstock.geometry.parts.solids import Solid, Tube

# of the frequency at which a tube ovalizes: below, hardly any of that is in bending and torsion
ROUND_SHARE = 0.5


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
