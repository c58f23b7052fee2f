"""Bending of beams: slender ones (Euler and Bernoulli), and deep ones with shear deformation and
rotary inertia (Timoshenko).
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.linalg import expm

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import (
    EndConditions,
    PrismaticBeam,
    bracket_roots,
)

# state: deflection, rotation, moment, shear force; (rows that vanish at the far end, columns left
# free at the near end)
_BOUNDARY_BLOCKS: dict[EndConditions, tuple[tuple[int, int], tuple[int, int]]] = {
    "clamped-free": ((2, 3), (2, 3)),
    "clamped-clamped": ((0, 1), (2, 3)),
    "free-free": ((2, 3), (0, 1)),
    "supported-supported": ((0, 2), (1, 3)),
}
_FIRST_WAVE_NUMBER = 0.5
_WAVE_NUMBER_STEP = 0.05


def euler_bernoulli_roots(ends: EndConditions, count: int) -> FloatArray:
    """Dimensionless wave numbers ``lambda = beta L`` of the bending modes, rigid ones left out.

    Args:
        ends: How the two ends are fixed.

    Returns:
        ``(count,)`` [-]: ``cos cosh = -1`` clamped-free, ``cos cosh = 1`` clamped-clamped and
        free-free, ``sin = 0`` supported.

    Source: Blevins (1979), table 8-1.
    """
    functions: dict[EndConditions, Callable[[float], float]] = {
        "clamped-free": lambda x: math.cos(x) + 1.0 / math.cosh(x),
        "clamped-clamped": lambda x: math.cos(x) - 1.0 / math.cosh(x),
        "free-free": lambda x: math.cos(x) - 1.0 / math.cosh(x),
        "supported-supported": math.sin,
    }
    return np.array(bracket_roots(functions[ends], count, start=1.0, step=0.1))


def euler_bernoulli_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Bending frequencies ``(count,)`` [Hz] in the direction of the beam's depth.

    Args:
        count: How many, from the lowest elastic one.

    Source: Blevins (1979), equation 8-17: ``f = lambda^2 / (2 pi L^2) sqrt(E I / (rho A))``.
    """
    speed = math.sqrt(beam.bending_stiffness / beam.mass_per_length)
    return np.asarray(
        euler_bernoulli_roots(ends, count) ** 2 * speed / (2.0 * math.pi * beam.length**2)
    )


def euler_bernoulli_shape(
    ends: EndConditions, number: int, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Deflection and its slope of a bending mode of a beam of unit length with a clamped lower end.

    Args:
        ends: ``clamped-free`` or ``clamped-clamped``.
        number: Which mode, from 1.
        places: ``(n,)`` along the beam, 0 to 1 [-].

    Raises:
        ValueError: The lower end is not clamped.

    Source: Blevins (1979), table 8-1.
    """
    if not ends.startswith("clamped"):
        raise ValueError(
            f"the shape of a {ends} beam is not known here: its lower end must be clamped"
        )
    root = float(euler_bernoulli_roots(ends, number)[-1])
    sign = 1.0 if ends == "clamped-free" else -1.0
    ratio = (math.cosh(root) + sign * math.cos(root)) / (math.sinh(root) + sign * math.sin(root))
    x = root * np.asarray(places)
    deflection = np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))
    slope = root * (np.sinh(x) + np.sin(x) - ratio * (np.cosh(x) - np.cos(x)))
    return deflection, slope


def strip_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Bending frequencies ``(count,)`` [Hz] of a strip so wide that it cannot contract sideways: E
    becomes E / (1 - nu^2).

    Args:
        beam: Uniform, as wide as a plate.
        count: How many, from the lowest elastic one.

    Source: Timoshenko and Woinowsky-Krieger (1959), cylindrical bending of a long plate, chapter 1.
    """
    factor = 1.0 / math.sqrt(1.0 - beam.material.poisson_ratio**2)
    return np.asarray(factor * euler_bernoulli_frequencies(beam, ends, count))


def cantilever_force_deflection(beam: PrismaticBeam, force: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a force [N] at its tip: ``F L^3 / (3 E
    I)``.
    """
    return force * beam.length**3 / (3.0 * beam.bending_stiffness)


def cantilever_moment_deflection(beam: PrismaticBeam, moment: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a moment [N m] at its tip: ``M L^2 / (2 E
    I)``.
    """
    return moment * beam.length**2 / (2.0 * beam.bending_stiffness)


def fixed_beam_deflection(beam: PrismaticBeam, force: float) -> float:
    """Mid-span deflection [m] of a clamped-clamped beam under a force [N] there: ``F L^3 / (192 E
    I)``.
    """
    return force * beam.length**3 / (192.0 * beam.bending_stiffness)


def cowper_coefficient(poisson_ratio: float) -> float:
    """Shear coefficient kappa of a rectangular section [-].

    Source: Cowper (1966), table 1: ``10 (1 + nu) / (12 + 11 nu)``.
    """
    return 10.0 * (1.0 + poisson_ratio) / (12.0 + 11.0 * poisson_ratio)


def timoshenko_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Bending frequencies ``(count,)`` [Hz] in the direction of the beam's depth, exact for the
    theory.

    The state is carried over the span by the matrix exponential; a frequency is a root of the 2 x 2
    determinant that the ends leave.

    Args:
        beam: Uniform, with its shear coefficient.
        count: How many, from the lowest elastic one.

    Source: Timoshenko (1921); transfer matrices after Pestel and Leckie (1963), chapter 5.
    """
    scale = math.sqrt(beam.bending_stiffness / beam.mass_per_length) / beam.length**2
    rows, columns = _BOUNDARY_BLOCKS[ends]

    def determinant(wave_number: float) -> float:
        transfer = _transfer_matrix(beam, wave_number**4)
        block = transfer[np.ix_(rows, columns)]
        return float(np.linalg.det(block) / math.cosh(wave_number))

    roots = bracket_roots(determinant, count, start=_FIRST_WAVE_NUMBER, step=_WAVE_NUMBER_STEP)
    return np.asarray(np.array(roots) ** 2 * scale / (2.0 * math.pi))


def cantilever_shear_deflection(beam: PrismaticBeam, force: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a tip force [N]: ``F L^3 / (3 E I) + F L /
    (kappa G A)``.
    """
    return cantilever_force_deflection(beam, force) + force * beam.length / _shear_stiffness(beam)


def fixed_beam_shear_deflection(beam: PrismaticBeam, force: float) -> float:
    """Mid-span deflection [m] of a clamped-clamped beam: ``F L^3 / (192 E I) + F L / (4 kappa G
    A)``.
    """
    return fixed_beam_deflection(beam, force) + force * beam.length / (4.0 * _shear_stiffness(beam))


def _shear_stiffness(beam: PrismaticBeam) -> float:
    return cowper_coefficient(beam.material.poisson_ratio) * beam.shear_modulus * beam.area


def _transfer_matrix(beam: PrismaticBeam, squared_frequency: float) -> FloatArray:
    """Transfer matrix ``(4, 4)`` of the span; units L, E I / L^2 and, for the squared frequency, E
    I / (rho A L^4).
    """
    shear = beam.bending_stiffness / (_shear_stiffness(beam) * beam.length**2)
    rotary = beam.second_moment / (beam.area * beam.length**2)
    system = np.array(
        [
            [0.0, 1.0, 0.0, shear],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, -squared_frequency * rotary, 0.0, -1.0],
            [-squared_frequency, 0.0, 0.0, 0.0],
        ]
    )
    return np.asarray(expm(system))
