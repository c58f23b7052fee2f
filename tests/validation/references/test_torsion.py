"""Claims about torsion with restrained warping."""

import numpy as np

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.torsion import (
    clamped_clamped_torsion,
    clamped_free_torsion,
    torsional_frequencies,
    warping_constant,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
COLUMN = PrismaticBeam(0.5, 0.1, 0.038, STEEL)
FIXED = PrismaticBeam(0.75, 0.25, 0.032, STEEL)


def test_warping_constant_of_a_rectangle() -> None:
    assert warping_constant(0.1, 0.038) == approx(3.8105556e-10, rel=1e-7)


def test_first_torsional_frequency_of_the_seed_column() -> None:
    assert clamped_free_torsion(COLUMN, 1)[0] == approx(1053.01759, rel=1e-7)


def test_torsional_frequencies_of_the_seed_fixed_beam_to_their_printed_digits() -> None:
    assert [round(float(value), 1) for value in clamped_clamped_torsion(FIXED, 2)] == [
        640.1,
        1385.1,
    ]


def test_a_long_bar_forgets_that_its_warping_is_restrained() -> None:
    long = PrismaticBeam(500.0, 0.1, 0.038, STEEL)
    free = torsional_frequencies(long, "clamped-free", 3)
    np.testing.assert_allclose(clamped_free_torsion(long, 3), free, rtol=2e-4)
    np.testing.assert_allclose(
        clamped_clamped_torsion(long, 3),
        torsional_frequencies(long, "clamped-clamped", 3),
        rtol=4e-4,
    )


def test_restraining_the_warping_raises_every_frequency() -> None:
    assert np.all(
        clamped_free_torsion(COLUMN, 3) > torsional_frequencies(COLUMN, "clamped-free", 3)
    )
    assert np.all(
        clamped_clamped_torsion(FIXED, 3) > torsional_frequencies(FIXED, "clamped-clamped", 3)
    )


def test_a_frequency_solves_the_differential_equation_with_its_four_end_conditions() -> None:
    """Independent of the determinant: finite differences in a Rayleigh quotient of second order
    converge to it.
    """
    count = 800
    h = FIXED.length / count
    warping = 210e9 * warping_constant(0.25, 0.032)
    torsion = FIXED.shear_modulus * 2.5103785e-6
    stiffness = np.zeros((count - 1, count - 1))
    bend = (
        np.diag(-2.0 * np.ones(count - 1))
        + np.diag(np.ones(count - 2), 1)
        + np.diag(np.ones(count - 2), -1)
    ) / h**2
    stiffness += warping * bend @ bend - torsion * bend
    # a clamped end mirrors the first point, which adds 2 / h^4 to the squared second difference of
    # a supported one
    stiffness[0, 0] += 2.0 * warping / h**4
    stiffness[-1, -1] += 2.0 * warping / h**4
    lowest = np.sqrt(np.linalg.eigvalsh(stiffness)[:2] / (7850.0 * FIXED.polar_moment)) / (
        2 * np.pi
    )
    np.testing.assert_allclose(clamped_clamped_torsion(FIXED, 2), lowest, rtol=2e-4)
