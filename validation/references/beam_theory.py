"""Closed forms of a straight beam of rectangular section: bending of slender beams (Euler and
Bernoulli) and of deep ones (Timoshenko), torsion with free and with restrained warping, and axial
vibration.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material

EndConditions = Literal["clamped-free", "clamped-clamped", "free-free", "supported-supported"]
MAXIMUM_STEPS = 200_000

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

_SERIES_TERMS = 200
_STEPS_PER_ROOT = 40


@dataclass(frozen=True)
class PrismaticBeam:
    """A straight beam of rectangular section that bends in the direction of its depth.

    Attributes:
        length: Span [m].
        width: Side of the section normal to the bending plane [m].
        depth: Side of the section in the bending plane [m].
    """

    length: float
    width: float
    depth: float
    material: Material

    @property
    def area(self) -> float:
        """Area of the section [m^2]."""
        return self.width * self.depth

    @property
    def second_moment(self) -> float:
        """Second moment of area for bending in the direction of the depth [m^4]."""
        return self.width * self.depth**3 / 12.0

    @property
    def polar_moment(self) -> float:
        """Polar second moment of area about the centroid, for rotary inertia of torsion [m^4]."""
        return self.area * (self.width**2 + self.depth**2) / 12.0

    @property
    def shear_modulus(self) -> float:
        """G [Pa]."""
        return self.material.youngs_modulus / (2.0 * (1.0 + self.material.poisson_ratio))

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.material.youngs_modulus * self.second_moment

    @property
    def mass_per_length(self) -> float:
        """Rho A [kg/m]."""
        return self.material.density * self.area


def turn_section(beam: PrismaticBeam) -> PrismaticBeam:
    """Return the same beam bending in the direction of its width."""
    return PrismaticBeam(beam.length, beam.depth, beam.width, beam.material)


def _bracket_roots(
    function: Callable[[float], float], count: int, *, start: float, step: float
) -> list[float]:
    """Return the first roots of a function above a start, by walking until its sign changes and
    closing in by Brent's method.

    Args:
        function: Continuous, with simple roots further apart than ``step``.
        count: Number of roots wanted.
        start: Where to begin; not itself a root.

    Returns:
        ``count`` roots in rising order.

    Raises:
        ValueError: Fewer roots lie within the first 200000 steps.

    Source: Brent (1973), chapter 4.
    """
    roots: list[float] = []
    low, value_low = start, function(start)
    for number in range(1, MAXIMUM_STEPS + 1):
        if len(roots) == count:
            return roots
        high = start + number * step
        value_high = function(high)
        if value_low * value_high <= 0.0 and value_high != 0.0:
            roots.append(float(brentq(function, low, high, xtol=1e-15 * high, rtol=1e-14)))
        low, value_low = high, value_high
    raise ValueError(f"only {len(roots)} of {count} roots lie between {start:g} and {low:g}")


def _euler_bernoulli_roots(ends: EndConditions, count: int) -> FloatArray:
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
    return np.array(_bracket_roots(functions[ends], count, start=1.0, step=0.1))


def euler_bernoulli_frequencies(beam: PrismaticBeam, ends: EndConditions, count: int) -> FloatArray:
    """Bending frequencies ``(count,)`` [Hz] in the direction of the beam's depth.

    Args:
        count: How many, from the lowest elastic one.

    Source: Blevins (1979), equation 8-17: ``f = lambda^2 / (2 pi L^2) sqrt(E I / (rho A))``.
    """
    speed = math.sqrt(beam.bending_stiffness / beam.mass_per_length)
    return np.asarray(
        _euler_bernoulli_roots(ends, count) ** 2 * speed / (2.0 * math.pi * beam.length**2)
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
    root = float(_euler_bernoulli_roots(ends, number)[-1])
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
    """Tip deflection [m] of a clamped-free beam under a tip force [N]: ``F L^3 / (3 E I)``."""
    return force * beam.length**3 / (3.0 * beam.bending_stiffness)


def cantilever_moment_deflection(beam: PrismaticBeam, moment: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a tip moment [N m]: ``M L^2 / (2 E I)``."""
    return moment * beam.length**2 / (2.0 * beam.bending_stiffness)


def fixed_beam_deflection(beam: PrismaticBeam, force: float) -> float:
    """Mid-span deflection [m], clamped-clamped, under a force [N]: ``F L^3 / (192 E I)``."""
    return force * beam.length**3 / (192.0 * beam.bending_stiffness)


def _cowper_coefficient(poisson_ratio: float) -> float:
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

    roots = _bracket_roots(determinant, count, start=_FIRST_WAVE_NUMBER, step=_WAVE_NUMBER_STEP)
    return np.asarray(np.array(roots) ** 2 * scale / (2.0 * math.pi))


def cantilever_shear_deflection(beam: PrismaticBeam, force: float) -> float:
    """Tip deflection [m] of a clamped-free beam under a tip force [N]: ``F L^3 / (3 E I) + F L /
    (kappa G A)``.
    """
    return cantilever_force_deflection(beam, force) + force * beam.length / _shear_stiffness(beam)


def fixed_beam_shear_deflection(beam: PrismaticBeam, force: float) -> float:
    """Mid-span deflection [m], clamped-clamped: ``F L^3 / (192 E I) + F L / (4 kappa G A)``."""
    return fixed_beam_deflection(beam, force) + force * beam.length / (4.0 * _shear_stiffness(beam))


def _shear_stiffness(beam: PrismaticBeam) -> float:
    return _cowper_coefficient(beam.material.poisson_ratio) * beam.shear_modulus * beam.area


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
    """End displacement [m] of a rod fixed at one end under an axial force [N]: ``F L / (E A)``."""
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
    """Mid-span twist [rad] of a beam fixed at both ends under a torque [N m]: ``T L / (4 G J)``."""
    return moment * beam.length / (4.0 * _torsional_stiffness(beam))


def _warping_constant(width: float, depth: float) -> float:
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
    warping = beam.material.youngs_modulus * _warping_constant(beam.width, beam.depth)
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
    return np.array(
        _bracket_roots(function, count, start=0.1 * first, step=first / _STEPS_PER_ROOT)
    )
