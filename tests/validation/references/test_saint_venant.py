"""Claims about torsion with free warping."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.torsion import (
    cantilever_twist,
    fixed_beam_twist,
    torsion_constant,
    torsional_frequencies,
)

STEEL = Material("steel", 210e9, 0.3, 7850.0)
COLUMN = PrismaticBeam(0.5, 0.1, 0.038, STEEL)
FIXED = PrismaticBeam(0.75, 0.25, 0.032, STEEL)
FV5 = PrismaticBeam(10.0, 2.0, 2.0, Material("nafems", 200e9, 0.3, 8000.0))


@pytest.mark.parametrize(
    ("ratio", "value"), [(1.0, 0.140577), (2.631579, 0.253542), (7.8125, 0.306443)]
)
def test_torsion_constants_of_rectangles(ratio: float, value: float) -> None:
    assert torsion_constant(ratio, 1.0) / ratio == approx(value, rel=1e-5)


def test_the_order_of_the_sides_does_not_matter() -> None:
    assert (
        torsion_constant(0.1, 0.038)
        == torsion_constant(0.038, 0.1)
        == approx(1.39123901e-6, rel=1e-8)
    )


def test_a_thin_strip_has_a_third_of_a_b_cubed() -> None:
    assert torsion_constant(1e4, 1.0) / 1e4 == approx(1.0 / 3.0, rel=1e-4)


def test_torsional_frequencies_of_the_seeds_and_fv5() -> None:
    assert torsional_frequencies(COLUMN, "clamped-free", 1)[0] == approx(993.73119, rel=1e-7)
    assert round(float(torsional_frequencies(FIXED, "clamped-clamped", 1)[0]), 2) == 520.65
    np.testing.assert_allclose(
        torsional_frequencies(FV5, "clamped-free", 2), [71.196, 213.588], rtol=1e-5
    )


def test_the_polar_moment_in_place_of_j_would_give_77_52_hz_for_fv5() -> None:
    factor = np.sqrt(FV5.polar_moment / torsion_constant(2.0, 2.0))
    assert round(float(factor * torsional_frequencies(FV5, "clamped-free", 1)[0]), 2) == 77.52


def test_static_twists_of_the_seeds_to_their_printed_digits() -> None:
    assert round(1e6 * cantilever_twist(COLUMN, 1.0) * 0.05, 5) == 0.22248
    assert round(1e6 * fixed_beam_twist(FIXED, 100.0) * 0.016, 3) == 1.480
