"""Claims about torsion, with free and with restrained warping, and about axial vibration."""

import numpy as np

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.beam_theory import (
    PrismaticBeam,
    _warping_constant,
    axial_frequencies,
    clamped_clamped_torsion,
    clamped_free_torsion,
    torsion_constant,
    torsional_frequencies,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
FIXED = PrismaticBeam(0.75, 0.25, 0.032, STEEL)


def test_a_long_bar_forgets_that_its_warping_is_restrained() -> None:
    long = PrismaticBeam(500.0, 0.1, 0.038, STEEL)
    free = torsional_frequencies(long, "clamped-free", 3)
    np.testing.assert_allclose(clamped_free_torsion(long, 3), free, rtol=2e-4)
    both = torsional_frequencies(long, "clamped-clamped", 3)
    np.testing.assert_allclose(clamped_clamped_torsion(long, 3), both, rtol=4e-4)


def test_a_frequency_solves_the_differential_equation_with_its_four_end_conditions() -> None:
    """Independent of the determinant: finite differences in a Rayleigh quotient of second order
    converge to it.
    """
    count = 800
    h = FIXED.length / count
    warping = 210e9 * _warping_constant(0.25, 0.032)
    torsion = FIXED.shear_modulus * 2.5103785e-6
    stiffness = np.zeros((count - 1, count - 1))
    beside = np.eye(count - 1, k=1) + np.eye(count - 1, k=-1)
    bend = (beside - 2.0 * np.eye(count - 1)) / h**2
    stiffness += warping * bend @ bend - torsion * bend
    # a clamped end mirrors the first point, which adds 2 / h^4 to the squared second difference of
    # a supported one
    stiffness[0, 0] += 2.0 * warping / h**4
    stiffness[-1, -1] += 2.0 * warping / h**4
    squares = np.linalg.eigvalsh(stiffness)[:2] / (7850.0 * FIXED.polar_moment)
    lowest = np.sqrt(squares) / (2 * np.pi)
    np.testing.assert_allclose(clamped_clamped_torsion(FIXED, 2), lowest, rtol=2e-4)


FV5 = PrismaticBeam(10.0, 2.0, 2.0, Material("nafems", 200e9, 0.3, 8000.0))


def test_the_order_of_the_sides_does_not_matter() -> None:
    one, other = torsion_constant(0.1, 0.038), torsion_constant(0.038, 0.1)
    assert one == other == approx(1.39123901e-6, rel=1e-8)


def test_a_thin_strip_has_a_third_of_a_b_cubed() -> None:
    assert torsion_constant(1e4, 1.0) / 1e4 == approx(1.0 / 3.0, rel=1e-4)


def test_the_polar_moment_in_place_of_j_would_give_77_52_hz_for_fv5() -> None:
    factor = np.sqrt(FV5.polar_moment / torsion_constant(2.0, 2.0))
    assert round(float(factor * torsional_frequencies(FV5, "clamped-free", 1)[0]), 2) == 77.52


ROD = PrismaticBeam(1.0, 0.05, 0.05, Material("nu0", 210e9, 0.0, 7850.0))


def test_holding_both_ends_or_none_gives_the_same_frequencies() -> None:
    both = axial_frequencies(ROD, "clamped-clamped", 4)
    np.testing.assert_array_equal(both, axial_frequencies(ROD, "free-free", 4))
    assert both[0] == approx(2.0 * axial_frequencies(ROD, "clamped-free", 1)[0])
