"""Claims about slender beams."""

import numpy as np
import pytest

from headstock.geometry.parts.components import Material
from headstock.validation.references.bending import (
    cantilever_force_deflection,
    cantilever_moment_deflection,
    euler_bernoulli_frequencies,
    euler_bernoulli_roots,
    fixed_beam_deflection,
    strip_frequencies,
)
from headstock.validation.references.prismatic_beams import (
    EndConditions,
    PrismaticBeam,
    turn_section,
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
    np.testing.assert_allclose(euler_bernoulli_roots(ends, 4), roots, rtol=5e-9)


def test_twenty_roots_are_found_without_a_gap() -> None:
    spacing = np.diff(euler_bernoulli_roots("clamped-free", 20))
    assert np.all(np.abs(spacing[3:] - np.pi) < 1e-3)


def test_frequencies_of_the_seed_column_in_both_directions() -> None:
    np.testing.assert_allclose(
        euler_bernoulli_frequencies(COLUMN, "clamped-free", 3),
        [126.99852, 795.88615, 2228.50428],
        rtol=1e-7,
    )
    np.testing.assert_allclose(
        euler_bernoulli_frequencies(turn_section(COLUMN), "clamped-free", 2),
        [334.20664, 2094.43725],
        rtol=1e-7,
    )


def test_frequencies_scale_with_depth_over_length_squared() -> None:
    thick = PrismaticBeam(0.5, 0.1, 2 * 0.038, STEEL)
    long = PrismaticBeam(1.0, 0.1, 0.038, STEEL)
    base = euler_bernoulli_frequencies(COLUMN, "clamped-free", 3)
    np.testing.assert_allclose(
        euler_bernoulli_frequencies(thick, "clamped-free", 3), 2.0 * base, rtol=1e-12
    )
    np.testing.assert_allclose(
        euler_bernoulli_frequencies(long, "clamped-free", 3), base / 4.0, rtol=1e-12
    )


def test_a_strip_is_stiffer_by_one_over_one_minus_nu_squared() -> None:
    ratio = strip_frequencies(COLUMN, "clamped-free", 2) / euler_bernoulli_frequencies(
        COLUMN, "clamped-free", 2
    )
    np.testing.assert_allclose(ratio**2, 1.0 / 0.91, rtol=1e-12)


def test_static_deflections_of_the_seed_to_their_printed_digits() -> None:
    assert round(1e6 * cantilever_force_deflection(COLUMN, 1e3), 2) == 433.91
    assert round(1e6 * cantilever_moment_deflection(COLUMN, 1.0), 5) == 1.30173
    assert round(1e6 * cantilever_moment_deflection(turn_section(COLUMN), 1.0), 5) == 0.18797
    assert (
        round(1e6 * fixed_beam_deflection(PrismaticBeam(0.75, 0.25, 0.032, STEEL), 1e3), 3)
        == 15.327
    )
