"""Torsion of rectangular bars whose sections warp freely."""

import math

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import EndConditions, PrismaticBeam
from headstock.validation.references.rods import wave_numbers

_SERIES_TERMS = 200


def torsion_constant(side: float, other_side: float) -> float:
    """Torsion constant J [m^4] of a rectangle with the given sides [m].

    Source: Saint-Venant (1855); Timoshenko and Goodier (1970), section 109, equation 160:
    ``J = a b^3 (1/3 - 64 b / (pi^5 a) sum tanh(n pi a / (2 b)) / n^5)``, n odd, a >= b.
    """
    long, short = max(side, other_side), min(side, other_side)
    odd = np.arange(1, 2 * _SERIES_TERMS, 2)
    series = float(np.sum(np.tanh(odd * math.pi * long / (2.0 * short)) / odd**5.0))
    return long * short**3 * (1.0 / 3.0 - 64.0 * short / (math.pi**5 * long) * series)


def torsional_stiffness(beam: PrismaticBeam) -> float:
    """G J [N m^2] of the beam's section."""
    return beam.shear_modulus * torsion_constant(beam.width, beam.depth)


def torsional_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Torsional frequencies ``(count,)`` [Hz], rigid rotation left out, warping free everywhere.

    ``clamped`` ends hold the twist, ``free`` ones do not; the ends of ``supported-supported`` hold it too.

    Source: Blevins (1979), table 8-19: ``f = lambda / (2 pi L) sqrt(G J / (rho I_p))``.
    """
    speed = math.sqrt(torsional_stiffness(beam) / (beam.material.density * beam.polar_moment))
    return np.asarray(wave_numbers(ends, count) * speed / (2.0 * math.pi * beam.length))


def cantilever_twist(beam: PrismaticBeam, moment: float) -> float:
    """Tip twist [rad] of a clamped-free beam under a torque [N m] at its tip: ``T L / (G J)``."""
    return moment * beam.length / torsional_stiffness(beam)


def fixed_beam_twist(beam: PrismaticBeam, moment: float) -> float:
    """Mid-span twist [rad] of a beam held at both ends under a torque [N m] there: ``T L / (4 G J)``."""
    return moment * beam.length / (4.0 * torsional_stiffness(beam))
