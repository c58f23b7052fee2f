"""A rigid block on four equal springs at its bottom corners."""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray


@dataclass(frozen=True)
class SprungBlock:
    """A homogeneous rigid block on four corner springs.

    Attributes:
        size: Edge lengths x, y, z [m].
        mass: Mass [kg].
        spring: Stiffness of each corner spring along x, y and z [N/m].
    """

    size: tuple[float, float, float]
    mass: float
    spring: tuple[float, float, float]


def block_frequencies(block: SprungBlock) -> FloatArray:
    """The six natural frequencies ``(6,)`` [Hz] of a block on four corner springs, rising.

    Heave and yaw stand alone; swaying along x couples with rocking about y, swaying along y with rocking about x.

    Source: Newton-Euler equations about the centre of mass (Rivin (2003), section 1.3).
    """
    a, b, h = (0.5 * edge for edge in block.size)
    kx, ky, kz = (4.0 * stiffness for stiffness in block.spring)
    ix, iy, iz = (block.mass * (p**2 + q**2) / 3.0 for p, q in ((b, h), (a, h), (a, b)))
    squares = [kz / block.mass, (kx * b**2 + ky * a**2) / iz]
    squares += _sway_rock_pair(kx, block.mass, kz * a**2, iy, h)
    squares += _sway_rock_pair(ky, block.mass, kz * b**2, ix, h)
    return np.asarray(np.sqrt(np.sort(squares)) / (2.0 * math.pi))


def _sway_rock_pair(sway: float, mass: float, rock: float, inertia: float, height: float) -> list[float]:
    """Squared angular frequencies [rad^2/s^2] of swaying and rocking when the springs act ``height`` below the centre."""
    k11, k22 = sway / mass, (rock + sway * height**2) / inertia
    k12 = sway * height / math.sqrt(mass * inertia)
    mean, radius = 0.5 * (k11 + k22), math.hypot(0.5 * (k11 - k22), k12)
    return [mean - radius, mean + radius]
