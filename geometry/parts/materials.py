"""Isotropic linear elastic materials."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """An isotropic, linear elastic material.

    Attributes:
        name: Name in the scene.
        youngs_modulus: E [Pa].
        poisson_ratio: nu [-].
        density: rho [kg/m^3].
        loss_factor: Structural damping eta: the complex modulus is ``E (1 + i eta)`` [-].
    """

    name: str
    youngs_modulus: float
    poisson_ratio: float
    density: float
    loss_factor: float = 0.0


def weigh_modes(youngs_modulus: float, poisson_ratio: float, density: float) -> float:
    """Natural frequencies of a body below a frequency, over its volume and the cube of that frequency [1 / (m^3 Hz^3)], for many of them.

    Args:
        youngs_modulus: E [Pa].
        poisson_ratio: nu, above -1 and at most 0.5.
        density: rho [kg/m^3].

    Source: Weyl's law for elastic bodies, Dupuis, Mazo and Onsager (1960): ``4 pi / 3 (1 / c_l^3 + 2 / c_t^3)``.
    """
    transverse = math.sqrt(youngs_modulus / (2.0 * (1.0 + poisson_ratio) * density))
    # (c_t / c_l)^2, zero for incompressible bodies
    squared_ratio = (1.0 - 2.0 * poisson_ratio) / (2.0 - 2.0 * poisson_ratio)
    return 4.0 * math.pi / 3.0 * (2.0 + squared_ratio * math.sqrt(squared_ratio)) / transverse**3
