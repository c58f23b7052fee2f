"""Isotropic linear elastic materials."""

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
