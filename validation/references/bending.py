"""Slender beams: plane sections stay plane and normal to the axis, no shear, no rotary inertia."""

import math
from collections.abc import Callable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.validation.references.prismatic_beams import EndConditions, PrismaticBeam
from headstock.validation.references.root_bracketing import bracket_roots


def euler_bernoulli_roots(ends: EndConditions, count: int) -> FloatArray:
    """Dimensionless wave numbers ``lambda = beta L`` of the bending modes, rigid ones left out.

    Args:
        ends: How the two ends are held.
        count: Number of roots.

    Returns:
        ``(count,)`` [-]: ``cos cosh = -1`` clamped-free, ``cos cosh = 1`` clamped-clamped and free-free, ``sin = 0`` supported.

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

    Source: Blevins (1979), equation 8-17: ``f = lambda^2 / (2 pi L^2) sqrt(E I / (rho A))``.
    """
    speed = math.sqrt(beam.bending_stiffness / beam.mass_per_length)
    return np.asarray(euler_bernoulli_roots(ends, count) ** 2 * speed / (2.0 * math.pi * beam.length**2))


def euler_bernoulli_shape(ends: EndConditions, number: int, places: FloatArray) -> tuple[FloatArray, FloatArray]:
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
        raise ValueError(f"the shape of a {ends} beam is not known here: its lower end must be clamped")
    root = float(euler_bernoulli_roots(ends, number)[-1])
    sign = 1.0 if ends == "clamped-free" else -1.0
    ratio = (math.cosh(root) + sign * math.cos(root)) / (math.sinh(root) + sign * math.sin(root))
    x = root * np.asarray(places)
    deflection = np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))
    slope = root * (np.sinh(x) + np.sin(x) - ratio * (np.cosh(x) - np.cos(x)))
    return deflection, slope


def strip_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Bending frequencies ``(count,)`` [Hz] of a strip so wide that it cannot contract sideways: E becomes E / (1 - nu^2).

    Source: Timoshenko and Woinowsky-Krieger (1959), cylindrical bending of a long plate, chapter 1.
    """
    factor = 1.0 / math.sqrt(1.0 - beam.material.poisson_ratio**2)
    return np.asarray(factor * euler_bernoulli_frequencies(beam, ends, count))


def cantilever_force_deflection(beam: PrismaticBeam, force: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a force [N] at its tip: ``F L^3 / (3 E I)``."""
    return force * beam.length**3 / (3.0 * beam.bending_stiffness)


def cantilever_moment_deflection(beam: PrismaticBeam, moment: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a moment [N m] at its tip: ``M L^2 / (2 E I)``."""
    return moment * beam.length**2 / (2.0 * beam.bending_stiffness)


def fixed_beam_deflection(beam: PrismaticBeam, force: float) -> float:
    """Mid-span deflection [m] of a clamped-clamped beam under a force [N] there: ``F L^3 / (192 E I)``."""
    return force * beam.length**3 / (192.0 * beam.bending_stiffness)
