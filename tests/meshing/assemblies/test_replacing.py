"""A new file of a part takes the place of the old one, with its faces found again."""

from pathlib import Path

import gmsh
import pytest
from assemblies import SMALL, write_assembly

from built_parts import built_part
from common import approx
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.assemblies.replacing import replace_part
from headstock.meshing.components.survey import survey_step
from headstock.meshing.errors import MeshError


def test_a_part_in_its_own_coordinates_replaces_one_of_the_assembly(tmp_path: Path) -> None:
    """The bracket that stands at 30, 40, 10 mm gets a hole of 10 in place of 8."""
    old = StepFile(write_assembly(tmp_path / "small.step", SMALL), 2)
    occ = gmsh.model.occ
    with built_part(tmp_path / "new.step"):
        foot, wall = occ.addBox(-20, -20, 0, 40, 40, 10), occ.addBox(-20, -20, 10, 10, 40, 40)
        (body, *_), _ = occ.fuse([(3, foot)], [(3, wall)])
        occ.cut([body], [(3, occ.addCylinder(0, 0, -1, 0, 0, 12, 5))])
        occ.rotate(occ.getEntities(3), 0, 0, 0, 0, 0, 1, 0.5)
    before = survey_step(old).faces
    again = replace_part(old, StepFile(tmp_path / "new.step"), tmp_path / "bracket.step")
    after = {face.number: face for face in survey_step(StepFile(tmp_path / "bracket.step")).faces}
    lost = [face for face in before if not again[face.number]]
    assert [(face.kind, round(1e3 * face.radius, 6)) for face in lost] == [("cylinder", 4.0)]
    # planes with a larger hole are found again
    for face in before:
        for number in again[face.number]:
            assert after[number].normal == approx(face.normal, abs=1e-6)
    bottom = next(face for face in before if face.normal[2] < -0.9)
    (number,) = again[bottom.number]
    assert after[number].low == approx(bottom.low, abs=1e-6)


def test_a_file_that_is_none_is_named(tmp_path: Path) -> None:
    old = StepFile(write_assembly(tmp_path / "small.step", SMALL), 2)
    with pytest.raises(MeshError, match="there is no file"):
        replace_part(old, StepFile(tmp_path / "new.step"), tmp_path / "bracket.step")
    assert not (tmp_path / "bracket.step").exists()
