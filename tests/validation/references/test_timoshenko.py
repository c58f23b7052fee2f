"""Claims about deep beams."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.bending import (
    cantilever_shear_deflection,
    cowper_coefficient,
    euler_bernoulli_frequencies,
    fixed_beam_shear_deflection,
    timoshenko_frequencies,
)
from headstock.validation.references.prismatic_beams import (
    EndConditions,
    PrismaticBeam,
    turn_section,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
COLUMN = PrismaticBeam(0.5, 0.1, 0.038, STEEL)
FV5 = PrismaticBeam(10.0, 2.0, 2.0, Material("nafems", 200e9, 0.3, 8000.0))


def test_cowper_coefficient_at_a_poisson_ratio_of_0_3() -> None:
    assert cowper_coefficient(0.3) == approx(13.0 / 15.3, rel=1e-14)


def test_frequencies_of_the_seed_column_in_both_directions() -> None:
    np.testing.assert_allclose(
        timoshenko_frequencies(COLUMN, "clamped-free", 3),
        [126.42642, 771.88119, 2079.22362],
        rtol=1e-7,
    )
    np.testing.assert_allclose(
        timoshenko_frequencies(turn_section(COLUMN), "clamped-free", 2),
        [324.24962, 1749.43768],
        rtol=1e-7,
    )


def test_in_plane_frequency_of_the_seed_fixed_beam_to_its_printed_digits() -> None:
    upright = PrismaticBeam(0.75, 0.032, 0.25, STEEL)
    assert round(float(timoshenko_frequencies(upright, "clamped-clamped", 1)[0]), 1) == 1503.6


def test_supported_ends_give_the_roots_of_the_biquadratic() -> None:
    """A sine solves the equations between simple supports, which leaves a quadratic in the squared
    frequency.
    """
    section, kappa = FV5.second_moment, cowper_coefficient(0.3)
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


@pytest.mark.parametrize(
    "ends", ["clamped-free", "clamped-clamped", "free-free", "supported-supported"]
)
def test_a_very_slender_beam_has_euler_bernoulli_frequencies(ends: EndConditions) -> None:
    slender = PrismaticBeam(1.0, 1e-3, 1e-3, STEEL)
    np.testing.assert_allclose(
        timoshenko_frequencies(slender, ends, 4),
        euler_bernoulli_frequencies(slender, ends, 4),
        rtol=2e-4,
    )


@pytest.mark.parametrize(
    "ends", ["clamped-free", "clamped-clamped", "free-free", "supported-supported"]
)
def test_shear_and_rotary_inertia_only_lower_frequencies(ends: EndConditions) -> None:
    assert np.all(
        timoshenko_frequencies(COLUMN, ends, 3) < euler_bernoulli_frequencies(COLUMN, ends, 3)
    )


def test_shear_deflections_of_the_seed_to_their_printed_digits() -> None:
    assert round(1e6 * cantilever_shear_deflection(COLUMN, 1e3), 2) == 435.83
    assert round(1e6 * cantilever_shear_deflection(turn_section(COLUMN), 1e3), 3) == 64.574


def test_shear_deflection_of_a_fixed_beam_is_a_quarter_of_a_cantilever_of_its_length() -> None:
    rigid_in_bending = PrismaticBeam(1e-6, 0.1, 0.1, STEEL)
    ratio = fixed_beam_shear_deflection(rigid_in_bending, 1.0) / cantilever_shear_deflection(
        rigid_in_bending, 1.0
    )
    assert ratio == approx(0.25, rel=1e-8)
