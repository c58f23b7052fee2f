from pathlib import Path

import pytest

from headstock.geometry.parts.solid_checks import find_solid_faults
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, StepFile, Tube

SIZE = (0.3, 0.2, 1.0)


@pytest.mark.parametrize(
    ("solid", "words"),
    [
        (Box((0.1, 0.0, 0.2)), "side"),
        (Box((0.1, float("nan"), 0.2)), "finite"),
        (Box((0.1, -0.1, 0.2)), "below zero"),
        (Tube(0.1, 0.1, 0.2), "inner diameter"),
        (Tube(0.1, 0.0, 0.0), "length"),
        (Plate((0.3, 0.2, 0.02), rib_height=0.05), "there are none"),
        (Plate((0.3, 0.2, 0.02), ribs_x=2), "height and a thickness"),
        (Plate((0.3, 0.2, 0.02), 0.05, 0.1, ribs_x=2), "do not fit the 200 mm along y"),
        (HollowColumn(SIZE, 0.1, 0.02), "fill the whole y side"),
        (HollowColumn(SIZE, 0.02, 0.5), "fill the whole z side"),
        (HollowColumn(SIZE, 0.0, 0.02), "thicker than zero"),
        (HollowColumn(SIZE, 0.02, 0.02, ribs_z=1), "thickness above zero"),
        (HollowColumn(SIZE, 0.02, 0.02, 0.01, ribs_x=1, core_hole=0.13), "narrowest cell, 125 mm"),
    ],
)
def test_impossible_dimensions_are_named(solid: Solid, words: str) -> None:
    assert words in "; ".join(find_solid_faults(solid))


@pytest.mark.parametrize(
    "solid",
    [
        Box(SIZE),
        Tube(0.1, 0.0, 0.2),
        Plate((0.3, 0.2, 0.02)),
        Plate((0.3, 0.2, 0.02), 0.05, 0.01, 2, 2),
        HollowColumn(SIZE, 0.02, 0.02, 0.01, 2, 1, 1, 0.06),
        StepFile(Path("part.step")),
    ],
)
def test_sound_solids_have_no_faults(solid: Solid) -> None:
    assert find_solid_faults(solid) == []
