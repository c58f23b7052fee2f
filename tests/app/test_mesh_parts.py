"""A mesh file of two materials: shown, and made a scene of, by the name of a set of its cells."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.app.actions.showing import survey_part
from headstock.app.actions.starting import write_part_scene
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.skins import find_areas
from headstock.meshing.errors import MeshError
from meshed_parts import make_part

pytestmark = pytest.mark.process

CUBE = [(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0), (0, 0, 20), (20, 0, 20), (20, 20, 20)]
CUBE += [(0, 20, 20), (0, 0, 40), (20, 0, 40), (20, 20, 40), (0, 20, 40)]
DECK = "*NODE\n" + "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(CUBE, 1))
DECK += "*ELEMENT, TYPE=C3D8, ELSET=LOW\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
DECK += "*ELEMENT, TYPE=C3D8, ELSET=UP\n2, 5, 6, 7, 8, 9, 10, 11, 12\n"
DECK += "*SOLID SECTION, ELSET=LOW, MATERIAL=STEEL\n*SOLID SECTION, ELSET=UP, MATERIAL=ALU\n"


def test_a_set_of_cells_is_surveyed_and_becomes_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "bar.inp"
    path.write_text(DECK)
    with pytest.raises(MeshError, match=r"LOW \(STEEL, 1 cells\), UP \(ALU, 1 cells\)"):
        survey_part(path, None, "1 mm")
    _, survey = survey_part(path, "up", "1 mm")
    assert max(survey.size) == approx(0.02)
    assert "cut" in [one.name for one in survey.sets]
    text = write_part_scene(path, survey, "bar.toml", solid="up", unit="1 mm")
    assert 'solid = { mesh = "bar.inp", unit = "1 mm", solid = "up" }' in text


def test_areas_on_a_mesh_file_are_those_of_the_facets_that_patches_take(tmp_path: Path) -> None:
    (tmp_path / "bar.inp").write_text(DECK)
    patches = {"top": Patch("z+"), "cut": Patch("set:cut"), "none": Patch("set:other")}
    part = make_part(MeshFile(tmp_path / "bar.inp", 1e-3, solid="UP"), patches)
    corners = find_areas(part)
    assert corners.keys() == {"top", "cut"}
    assert corners["top"].reshape(-1, 3)[:, 2] == approx(0.04)
    normals = np.cross(*np.diff(corners["cut"], axis=1).swapaxes(0, 1))
    assert normals.sum(axis=0) / 2.0 == approx([0.0, 0.0, -4e-4], abs=1e-15)
