"""Torsion of rectangular bars whose warping is restrained at clamped ends."""

import math
from collections.abc import Callable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.root_bracketing import bracket_roots
from headstock.validation.references.saint_venant import torsional_frequencies, torsional_stiffness

_STEPS_PER_ROOT = 40


def warping_constant(width: float, depth: float) -> float:
    """Secondary warping constant Gamma [m^6] of a narrow rectangle with the given sides [m].

    Source: Vlasov (1961), section I.5; ``Gamma = b^3 t^3 / 144`` (for example Pilkey (2005), table 2-5).
    """
    return width**3 * depth**3 / 144.0


def clamped_free_torsion(beam: PrismaticBeam, count: int) -> FloatArray:
    """Torsional frequencies ``(count,)`` [Hz], one end clamped against twist and warping, the other free.

    Source: Vlasov (1961); Gere (1954): ``2 a^2 b^2 + (a^4 + b^4) cosh a cos b + a b (a^2 - b^2) sinh a sin b = 0`` where
    ``a, b`` are L times the roots of ``E Gamma r^4 - G J r^2 - rho I_p omega^2 = 0``.
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


def _torsion_roots(beam: PrismaticBeam, characteristic: Callable[[float, float], float], count: int) -> FloatArray:
    warping = beam.material.youngs_modulus * warping_constant(beam.width, beam.depth)
    stiffness = torsional_stiffness(beam)
    inertia = beam.material.density * beam.polar_moment

    def function(frequency_hz: float) -> float:
        root = math.sqrt(stiffness**2 + 4.0 * warping * inertia * (2.0 * math.pi * frequency_hz) ** 2)
        a = beam.length * math.sqrt((root + stiffness) / (2.0 * warping))
        b = beam.length * math.sqrt((root - stiffness) / (2.0 * warping))
        return characteristic(a, b)

    first = float(torsional_frequencies(beam, "clamped-free", 1)[0])
    return np.array(bracket_roots(function, count, start=0.1 * first, step=first / _STEPS_PER_ROOT))
