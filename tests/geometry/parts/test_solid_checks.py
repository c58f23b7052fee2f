from pathlib import Path
from typing import Any

import pytest

from cases import cases
from headstock.geometry.parts import solids
from headstock.geometry.parts.solid_checks import find_solid_faults
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, StepFile, Tube

SIZE = (0.3, 0.2, 1.0)


@cases
def test_impossible_dimensions_are_named(
    kind: str, sizes: tuple[Any, ...], more: dict[str, Any], words: str
) -> None:
    assert words in "; ".join(find_solid_faults(getattr(solids, kind)(*sizes, **more)))


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
