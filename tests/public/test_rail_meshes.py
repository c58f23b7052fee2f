"""Meshes that do not tell the control points of a rail apart are foreseen, and the remedy is accepted."""

import re
from pathlib import Path

import pytest

import headstock as hs
from fixture_machines import stored_scene, write_scene

SCENE = stored_scene("rail_meshes")


def write(folder: Path, mesh: str, rail: str, length: str = "80 mm") -> Path:
    way = f'{{ face = "z+", {rail} }}'
    changes = ('"MESH"', f"{{ {mesh} }}"), ('"RAIL"', way), ("LENGTH", length)
    return write_scene(folder, SCENE, *changes)


def size_of(words: str) -> str:
    found = re.search(r'write a mesh size of "([^"]+)" or less', words)
    assert found is not None, words
    return found[1]


HEX, LINEAR = 'cells = "hex", size = "SIZE"', "order = 1, allow_locking = true, "
RAIL = 'rail = { along = "x" }'
RECT = 'rect = { center = ["20 mm", "0 mm"], size = ["300 mm", "40 mm"] }, '


@pytest.mark.parametrize(
    ("mesh", "rail", "length"),
    [
        (HEX, RAIL, "80 mm"),
        (HEX, 'rail = { along = "x", control_points = 24 }', "60 mm"),
        (HEX, 'rail = { along = "x", control_points = 5 }', "400 mm"),
        (LINEAR + HEX, RAIL, "80 mm"),
        (HEX, RECT + RAIL, "80 mm"),
    ],
)
def test_check_plan_and_run_name_a_size_that_all_of_them_accept(
    tmp_path: Path, mesh: str, rail: str, length: str
) -> None:
    coarse = write(tmp_path, mesh.replace("SIZE", "400 mm"), rail, length)
    words = []
    for command in (hs.check, hs.plan, lambda path: hs.run(path, output=tmp_path / "coarse")):
        with pytest.raises(hs.SceneError, match=r"components\.bed\.mesh") as error:
            command(coarse)
        words.append(size_of(str(error.value)))
    assert len(set(words)) == 1
    fine = write(tmp_path, mesh.replace("SIZE", words[0]), rail, length)
    assert not [warning for warning in hs.check(fine) if "control points" in warning]
    hs.plan(fine)
    hs.run(fine, output=tmp_path / "fine")


def test_tets_that_are_far_too_long_are_refused_and_longish_ones_doubted(tmp_path: Path) -> None:
    rail = 'rail = { along = "x", control_points = 40 }'
    with pytest.raises(hs.SceneError, match="control points apart") as error:
        hs.check(write(tmp_path, 'size = "100 mm"', rail, "60 mm"))
    doubted = hs.check(write(tmp_path, 'size = "40 mm"', rail, "60 mm"))
    assert any("perhaps the mesh has too few points along rail way" in each for each in doubted)
    fine = write(tmp_path, f'size = "{size_of(str(error.value))}"', rail, "60 mm")
    assert not [warning for warning in hs.check(fine) if "control points" in warning]


def test_a_strip_whose_tets_are_small_is_not_doubted(tmp_path: Path) -> None:
    rail = 'strip = { along = "x", width = "20 mm" }, rail = { along = "x", control_points = 24 }'
    found = hs.check(write(tmp_path, 'size = "100 mm"', rail, "60 mm"))
    assert not [warning for warning in found if "control points" in warning]


def test_a_rail_with_a_gap_is_told_to_close_it(tmp_path: Path) -> None:
    piece = '{{ face = "z+", rect = {{ center = ["{0} mm", "0 mm"], size = ["60 mm", "40 mm"] }} }}'
    pieces = ", ".join(piece.format(x) for x in (-170, 170))
    rail = f'patches = [{pieces}], rail = {{ along = "x", control_points = 16 }}'
    scene = write(tmp_path, HEX.replace("SIZE", "10 mm"), rail, "60 mm")
    scene.write_text(scene.read_text().replace('way = { face = "z+", ', "way = { "))
    with pytest.raises(hs.SceneError, match="gap of 280 mm"):
        hs.check(scene)
