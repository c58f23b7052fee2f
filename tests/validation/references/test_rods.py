"""Claims about axial vibration."""

import numpy as np

from common import approx
from headstock.geometry.parts.components import Material
from headstock.validation.references.prismatic_beams import PrismaticBeam
from headstock.validation.references.torsion import axial_extension, axial_frequencies

COLUMN = PrismaticBeam(0.5, 0.1, 0.038, Material("steel", 210e9, 0.3, 7850.0))
ROD = PrismaticBeam(1.0, 0.05, 0.05, Material("nu0", 210e9, 0.0, 7850.0))


def test_axial_frequencies_of_the_rod_and_the_seed_column() -> None:
    np.testing.assert_allclose(
        axial_frequencies(ROD, "clamped-free", 3), [1293.04854, 3879.14561, 6465.24269], rtol=2e-9
    )
    assert axial_frequencies(COLUMN, "clamped-free", 1)[0] == approx(2586.0971, rel=1e-8)


def test_holding_both_ends_or_none_gives_the_same_frequencies() -> None:
    both = axial_frequencies(ROD, "clamped-clamped", 4)
    np.testing.assert_array_equal(both, axial_frequencies(ROD, "free-free", 4))
    assert both[0] == approx(2.0 * axial_frequencies(ROD, "clamped-free", 1)[0])


def test_extension_of_the_seed_column_to_its_printed_digits() -> None:
    assert round(1e6 * axial_extension(COLUMN, 1e3), 5) == 0.62657
