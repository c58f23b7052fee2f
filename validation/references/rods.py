"""Axial vibration of rods: the one-dimensional wave equation."""

import math

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import EndConditions, PrismaticBeam


def wave_numbers(ends: EndConditions, count: int) -> FloatArray:
    """Dimensionless wave numbers ``lambda = k L`` of a second-order wave guide, rigid motion left out, ``(count,)`` [-].

    Source: Blevins (1979), table 8-16.
    """
    numbers = np.arange(1, count + 1)
    return np.asarray(math.pi * (numbers - 0.5) if ends == "clamped-free" else math.pi * numbers)


def axial_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Axial frequencies ``(count,)`` [Hz]: ``f = lambda / (2 pi L) sqrt(E / rho)``.

    Source: Blevins (1979), equation 8-112.
    """
    speed = math.sqrt(beam.material.youngs_modulus / beam.material.density)
    return np.asarray(wave_numbers(ends, count) * speed / (2.0 * math.pi * beam.length))


def axial_extension(beam: PrismaticBeam, force: float) -> float:
    """End displacement [m] of a rod held at the other end under an axial force [N]: ``F L / (E A)``."""
    return force * beam.length / (beam.material.youngs_modulus * beam.area)
