"""A closed-loop mechanism with rigid bodies, lumped compliances and gravity, as data."""

from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.kinematics import IndexArray
from headstock.geometry.mechanisms.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class MechanismBody:
    """A rigid body that is fixed to a mark.

    Attributes:
        name: For energy shares and messages.
        mark: The mark whose frame it is given in.
        mass: [kg].
        center: ``(3,)`` centre of mass [m].
        inertia: ``(3, 3)`` about the centre of mass [kg m^2].
    """

    name: str
    mark: str
    mass: float
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class LumpedSprings:
    """Springs in the compliant coordinates: compliance = constant + per_length times a driven length (Bonnemains et al., eq. 2).

    Attributes:
        constant: ``(c,)`` [m/N].
        per_length: ``(c,)`` [1/N]: 1 / EA of the screw where its free length grows with the leg.
        length: ``(c,)`` which driven coordinate that is.
        labels: ``(c,)`` what each is called in energy shares.
    """

    constant: FloatArray
    per_length: FloatArray
    length: IndexArray
    labels: tuple[str, ...]

    def stiffness(self, driven: FloatArray) -> FloatArray:
        """``(..., c)`` [N/m] at driven coordinates ``(..., u)``."""
        return np.asarray(1.0 / (self.constant + self.per_length * driven[..., self.length]))

    def stiffness_slope(self, driven: FloatArray) -> FloatArray:
        """``(..., c)`` derivative of each stiffness by its own length [N/m^2]."""
        return np.asarray(-self.per_length * self.stiffness(driven) ** 2)


@dataclass(frozen=True, eq=False)
class CompliantMechanism:
    """A mechanism that moves and gives.

    Attributes:
        mechanism: Chains and closures; its compliant coordinates carry the springs.
        bodies: Rigid bodies.
        springs: In the compliant coordinates.
        tool: Mark of the tool point.
        gravity: ``(3,)`` acceleration in the ground frame of the chains [m/s^2].
        damping: ``(c, c)`` viscous damping of the compliant coordinates [N s/m].
        velocity_terms: Whether Coriolis and centrifugal forces are counted; without them bodies and closures answer to
            accelerations alone.
        gravity_stiffening: Whether small motions feel how gravity's forces turn with them.
    """

    mechanism: Mechanism
    bodies: tuple[MechanismBody, ...]
    springs: LumpedSprings
    tool: str = "tcp"
    gravity: FloatArray = field(default_factory=lambda: np.zeros(3))
    damping: FloatArray | None = None
    velocity_terms: bool = True
    gravity_stiffening: bool = False
