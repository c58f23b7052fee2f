"""A straight beam of rectangular section: what every beam theory in this folder takes."""

from dataclasses import dataclass
from typing import Literal

from headstock.geometry.parts.materials import Material

EndConditions = Literal["clamped-free", "clamped-clamped", "free-free", "supported-supported"]


@dataclass(frozen=True)
class PrismaticBeam:
    """A straight beam of rectangular section that bends in the direction of its depth.

    Attributes:
        length: Span [m].
        width: Side of the section normal to the bending plane [m].
        depth: Side of the section in the bending plane [m].
        material: Isotropic material.
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
        """Polar second moment of area about the centroid, which carries the rotary inertia of torsion [m^4]."""
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
    """The same beam bending in the direction of its width."""
    return PrismaticBeam(beam.length, beam.depth, beam.width, beam.material)
