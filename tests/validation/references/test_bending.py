"""Claims about beams, slender and deep."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.beam_theory import (
    EndConditions,
    PrismaticBeam,
    _cowper_coefficient,
    _euler_bernoulli_roots,
    cantilever_shear_deflection,
    euler_bernoulli_frequencies,
    fixed_beam_shear_deflection,
    timoshenko_frequencies,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
COLUMN = PrismaticBeam(0.5, 0.1, 0.038, STEEL)


@pytest.mark.parametrize(
    ("ends", "roots"),
    [
        ("clamped-free", [1.87510407, 4.69409113, 7.85475744, 10.99554073]),
        ("clamped-clamped", [4.73004074, 7.85320462, 10.99560784, 14.13716549]),
        ("free-free", [4.73004074, 7.85320462, 10.99560784, 14.13716549]),
        ("supported-supported", [np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi]),
    ],
)
def test_roots_are_those_of_blevins_table_8_1(ends: EndConditions, roots: list[float]) -> None:
    np.testing.assert_allclose(_euler_bernoulli_roots(ends, 4), roots, rtol=5e-9)


def test_twenty_roots_are_found_without_a_gap() -> None:
    spacing = np.diff(_euler_bernoulli_roots("clamped-free", 20))
    assert np.all(np.abs(spacing[3:] - np.pi) < 1e-3)


def test_frequencies_scale_with_depth_over_length_squared() -> None:
    thick = PrismaticBeam(0.5, 0.1, 2 * 0.038, STEEL)
    long = PrismaticBeam(1.0, 0.1, 0.038, STEEL)
    base = euler_bernoulli_frequencies(COLUMN, "clamped-free", 3)
    for beam, factor in ((thick, 2.0), (long, 0.25)):
        found = euler_bernoulli_frequencies(beam, "clamped-free", 3)
        np.testing.assert_allclose(found, factor * base, rtol=1e-12)


FV5 = PrismaticBeam(10.0, 2.0, 2.0, Material("nafems", 200e9, 0.3, 8000.0))


def test_supported_ends_give_the_roots_of_the_biquadratic() -> None:
    """A sine solves the equations between simple supports, which leaves a quadratic in the squared
    frequency.
    """
    section, kappa = FV5.second_moment, _cowper_coefficient(0.3)
    exact = []
    for number in (1, 2, 3):
        k = number * np.pi / FV5.length
        shear = kappa * FV5.shear_modulus * FV5.area
        stiffness = np.array(
            [[shear * k**2, -shear * k], [-shear * k, shear + FV5.bending_stiffness * k**2]]
        )
        masses = np.array([FV5.mass_per_length, 8000.0 * section])
        values = np.linalg.eigvalsh(stiffness / np.sqrt(np.outer(masses, masses)))
        exact.append(np.sqrt(values[0]) / (2 * np.pi))
    np.testing.assert_allclose(
        timoshenko_frequencies(FV5, "supported-supported", 3), exact, rtol=1e-9
    )
    np.testing.assert_allclose(exact, [42.645, 148.149, 283.468], rtol=1e-5)


ENDS: list[EndConditions] = ["clamped-free", "clamped-clamped", "free-free", "supported-supported"]


@pytest.mark.parametrize("ends", ENDS)
def test_shear_and_rotary_inertia_only_lower_frequencies_and_of_a_very_slender_beam_hardly(
    ends: EndConditions,
) -> None:
    slender = PrismaticBeam(1.0, 1e-3, 1e-3, STEEL)
    found, plain = (
        frequencies(slender, ends, 4)
        for frequencies in (timoshenko_frequencies, euler_bernoulli_frequencies)
    )
    np.testing.assert_allclose(found, plain, rtol=2e-4)
    plain = euler_bernoulli_frequencies(COLUMN, ends, 3)
    assert np.all(timoshenko_frequencies(COLUMN, ends, 3) < plain)


def test_shear_deflection_of_a_fixed_beam_is_a_quarter_of_a_cantilever_of_its_length() -> None:
    rigid_in_bending = PrismaticBeam(1e-6, 0.1, 0.1, STEEL)
    ratio = fixed_beam_shear_deflection(rigid_in_bending, 1.0) / cantilever_shear_deflection(
        rigid_in_bending, 1.0
    )
    assert ratio == approx(0.25, rel=1e-8)
