"""Torsion of rectangular bars that warp freely or are restrained at clamped ends, and axial
vibration of rods.
"""

import math
from collections.abc import Callable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import (
    EndConditions,
    PrismaticBeam,
    bracket_roots,
)

_SERIES_TERMS = 200
_STEPS_PER_ROOT = 40


def wave_numbers(ends: EndConditions, count: int) -> FloatArray:
    """Dimensionless wave numbers ``lambda = k L`` of a second-order wave guide, rigid motion left
    out, ``(count,)`` [-].

    Source: Blevins (1979), table 8-16.
    """
    numbers = np.arange(1, count + 1)
    return np.asarray(math.pi * (numbers - 0.5) if ends == "clamped-free" else math.pi * numbers)


def axial_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Axial frequencies ``(count,)`` [Hz]: ``f = lambda / (2 pi L) sqrt(E / rho)``.

    Args:
        count: How many, from the lowest elastic one.

    Source: Blevins (1979), equation 8-112.
    """
    speed = math.sqrt(beam.material.youngs_modulus / beam.material.density)
    return np.asarray(wave_numbers(ends, count) * speed / (2.0 * math.pi * beam.length))


def axial_extension(beam: PrismaticBeam, force: float) -> float:
    """End displacement [m] of a rod fixed at the other end under an axial force [N]: ``F L / (E
    A)``.
    """
    return force * beam.length / (beam.material.youngs_modulus * beam.area)


def torsion_constant(side: float, other_side: float) -> float:
    """Torsion constant J [m^4] of a rectangle with the given sides [m].

    Source: Saint-Venant (1855); Timoshenko and Goodier (1970), section 109, equation 160:
    ``J = a b^3 (1/3 - 64 b / (pi^5 a) sum tanh(n pi a / (2 b)) / n^5)``, n odd, a >= b.
    """
    long, short = max(side, other_side), min(side, other_side)
    odd = np.arange(1, 2 * _SERIES_TERMS, 2)
    series = float(np.sum(np.tanh(odd * math.pi * long / (2.0 * short)) / odd**5.0))
    return long * short**3 * (1.0 / 3.0 - 64.0 * short / (math.pi**5 * long) * series)


def _torsional_stiffness(beam: PrismaticBeam) -> float:
    """G J [N m^2] of the beam's section."""
    return beam.shear_modulus * torsion_constant(beam.width, beam.depth)


def torsional_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Torsional frequencies ``(count,)`` [Hz], rigid rotation left out, warping free everywhere.

    ``clamped`` ends hold the twist, ``free`` ones do not; the ends of ``supported-supported`` hold
    it too.

    Args:
        beam: Uniform, of rectangular section.
        count: How many, from the lowest elastic one.

    Source: Blevins (1979), table 8-19: ``f = lambda / (2 pi L) sqrt(G J / (rho I_p))``.
    """
    speed = math.sqrt(_torsional_stiffness(beam) / (beam.material.density * beam.polar_moment))
    return np.asarray(wave_numbers(ends, count) * speed / (2.0 * math.pi * beam.length))


def cantilever_twist(beam: PrismaticBeam, moment: float) -> float:
    """Tip twist [rad] of a clamped-free beam under a torque [N m] at its tip: ``T L / (G J)``."""
    return moment * beam.length / _torsional_stiffness(beam)


def fixed_beam_twist(beam: PrismaticBeam, moment: float) -> float:
    """Mid-span twist [rad] of a beam fixed at both ends under a torque [N m] there: ``T L / (4 G
    J)``.
    """
    return moment * beam.length / (4.0 * _torsional_stiffness(beam))


def warping_constant(width: float, depth: float) -> float:
    """Secondary warping constant Gamma [m^6] of a narrow rectangle with the given sides [m].

    Source: Vlasov (1961), section I.5; ``Gamma = b^3 t^3 / 144`` (for example Pilkey (2005), table
    2-5).
    """
    return width**3 * depth**3 / 144.0


def clamped_free_torsion(beam: PrismaticBeam, count: int) -> FloatArray:
    """Torsional frequencies ``(count,)`` [Hz], one end clamped against twist and warping, the other
    free.

    Source: Vlasov (1961); Gere (1954): ``2 a^2 b^2 + (a^4 + b^4) cosh a cos b + a b (a^2 - b^2)
    sinh a sin b = 0`` where ``a, b`` are L times the roots of ``E Gamma r^4 - G J r^2 - rho I_p
    omega^2 = 0``.
    """

    def characteristic(a: float, b: float) -> float:
        bending = (a**4 + b**4) * math.cos(b) + 2.0 * a**2 * b**2 * _sech(a)
        return bending + a * b * (a**2 - b**2) * math.tanh(a) * math.sin(b)

    return _torsion_roots(beam, characteristic, count)


def clamped_clamped_torsion(beam: PrismaticBeam, count: int) -> FloatArray:
    """Torsional frequencies ``(count,)`` [Hz], both ends clamped against twist and warping.

    Source: Vlasov (1961); Gere (1954): ``2 a b (1 - cosh a cos b) + (a^2 - b^2) sinh a sin b = 0``.
    """

    def characteristic(a: float, b: float) -> float:
        return 2.0 * a * b * (_sech(a) - math.cos(b)) + (a**2 - b**2) * math.tanh(a) * math.sin(b)

    return _torsion_roots(beam, characteristic, count)


def _sech(value: float) -> float:
    # cosh overflows beyond 710, which a long bar reaches
    decay = math.exp(-value)
    return 2.0 * decay / (1.0 + decay**2)


def _torsion_roots(
    beam: PrismaticBeam, characteristic: Callable[[float, float], float], count: int
) -> FloatArray:
    warping = beam.material.youngs_modulus * warping_constant(beam.width, beam.depth)
    stiffness = _torsional_stiffness(beam)
    inertia = beam.material.density * beam.polar_moment

    def function(frequency_hz: float) -> float:
        root = math.sqrt(
            stiffness**2 + 4.0 * warping * inertia * (2.0 * math.pi * frequency_hz) ** 2
        )
        a = beam.length * math.sqrt((root + stiffness) / (2.0 * warping))
        b = beam.length * math.sqrt((root - stiffness) / (2.0 * warping))
        return characteristic(a, b)

    first = float(torsional_frequencies(beam, "clamped-free", 1)[0])
    return np.array(bracket_roots(function, count, start=0.1 * first, step=first / _STEPS_PER_ROOT))
