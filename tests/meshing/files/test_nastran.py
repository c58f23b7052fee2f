"""Bulk data in the forms that programs write it in: sixty decks of the same few blocks, and what
another reader made of them.

``expected.json`` holds the corners of every solid in the basic system and its number of further nodes, read by
pyNastran 1.4.1 (the header up to BEGIN BULK cut off, ``punch=True``), which passes over GRDSET.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from headstock.geometry.frames import FloatArray
from headstock.meshing.elements.quadratic import complete_hexes
from headstock.meshing.elements.quality import integrate_mesh
from headstock.meshing.errors import MeshError
from headstock.meshing.files.cells import _assemble_mesh
from headstock.meshing.files.nastran import read_nastran
from headstock.meshing.files.raw_mesh import CORNERS
from headstock.meshing.process.job import MeshData

DECKS = Path(__file__).resolve().parents[2] / "data" / "nastran_forms"
EXPECTED = json.loads((DECKS / "expected.json").read_text())
# of the sheared cube that every deck is made of, and what stands on it
CUBE = 11030.0
ROUNDING = 2e-3  # of text with three decimals
GRIDS = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,0.,1.,0.\nGRID,4,,0.,0.,1.\nGRID,5,,1.,1.,1.\n"


def read_cells(path: Path) -> tuple[dict[str, FloatArray], dict[str, int]]:
    """Corners of every solid, and its number of further nodes, by its number."""
    raw = read_nastran(path)
    corners, middles = {}, {}
    for block in raw.solids:
        first = CORNERS[block.family]
        for number, row in zip(block.numbers, block.nodes, strict=True):
            corners[str(number)] = raw.points[row[:first]]
            middles[str(number)] = int((row[first:] >= 0).sum())
    return corners, middles


def read_text(path: Path, text: str) -> MeshData:
    path.write_text(text)
    return _assemble_mesh(path, read_nastran(path))


def volume(data: MeshData) -> float:
    assert data.kind is not None
    if data.kind == "hex20":
        points, cells = complete_hexes(data.points, data.cells)
        return integrate_mesh(points, cells, "hex27").volume
    return integrate_mesh(data.points, data.cells, data.kind).volume


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_every_form_is_read_as_another_reader_reads_it(name: str) -> None:
    corners, middles = read_cells(DECKS / name)
    given = EXPECTED[name]
    assert middles == given["middles"]
    assert corners.keys() == given["corners"].keys()
    for number, places in given["corners"].items():
        assert np.allclose(corners[number], places, atol=ROUNDING, rtol=0)
    data = _assemble_mesh(DECKS / name, read_nastran(DECKS / name))
    hexes = sum(len(places) == 8 for places in corners.values())
    # one cube, two, or two with a pyramid on top
    stacked = {0: 1.0, 1: 2.2, 2: 2.0}[hexes]
    assert volume(data) == approx(stacked * CUBE, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "alike"), [("grdset.bdf", "cord2r.bdf"), ("grdset_zero.bdf", "cord2s.bdf")]
)
def test_the_default_system_of_grid_points_holds_where_they_name_none(
    name: str, alike: str
) -> None:
    corners, _ = read_cells(DECKS / name)
    assert len(corners) == len(EXPECTED[alike]["corners"])
    for number, places in EXPECTED[alike]["corners"].items():
        assert np.allclose(corners[number], places, atol=ROUNDING, rtol=0)


def test_lines_that_continue_a_card_are_found_by_their_mark(tmp_path: Path) -> None:
    cell = f"{'CTETRA':<8}{1:>8}{1:>8}{1:>8}{2:>8}{3:>8}{4:>8}{6:>8}{7:>8}+T1\n"
    grids = GRIDS + "GRID,6,,.5,0.,0.\nGRID,7,,.5,.5,0.\nGRID,8,,0.,.5,0.\n"
    far = f"{'+T1':<8}{8:>8}\n"
    texts = (cell + far + grids, cell + grids + far, far + grids + cell)
    path = tmp_path / "part.bdf"
    read = [read_text(path, "BEGIN BULK\n" + text + "ENDDATA\n") for text in texts]
    assert [data.kind for data in read] == ["tet10"] * 3
    assert [volume(data) for data in read] == approx([1 / 6] * 3)


@cases
def test_what_cannot_be_read_is_named_with_its_line(tmp_path: Path, cards: str, words: str) -> None:
    with pytest.raises(MeshError, match=words.replace("'", ".")):
        read_text(tmp_path / "part.bdf", "BEGIN BULK\n" + GRIDS + cards + "ENDDATA\n")


def test_two_properties_are_one_part_only_where_their_materials_are_equal(tmp_path: Path) -> None:
    cells = (
        "CTETRA,1,1,1,2,3,4\nCTETRA,2,2,2,5,3,4\nPSOLID,1,1\nPSOLID,2,2\nMAT1,1,2.1+5,,.3,7.85-9\n"
    )
    text = "BEGIN BULK\n" + GRIDS + cells + "MAT1,2,{},,.3,7.85-9\nENDDATA\n"
    data = read_text(tmp_path / "part.bdf", text.format("210000."))
    assert len(data.cells) == 2 and not data.remarks
    with pytest.raises(
        MeshError, match=r"2 materials: property_1 .*E = 210000.*property_2 .*E = 70000"
    ):
        read_text(tmp_path / "part.bdf", text.format("7.+4"))
    raw = read_nastran(tmp_path / "part.bdf")
    chosen = _assemble_mesh(tmp_path / "part.bdf", raw, "property_1")
    assert volume(chosen) == approx(1 / 6)
    assert len(chosen.facets["cut"]) == 1
    assert len(_assemble_mesh(tmp_path / "part.bdf", raw, "*").cells) == 2
