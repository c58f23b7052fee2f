"""A mesh file of two materials: shown, and made a scene of, by the name of a set of its cells."""

from pathlib import Path

import pytest

from headstock.app.command_line import main

pytestmark = pytest.mark.process

CUBE = [(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0), (0, 0, 20), (20, 0, 20), (20, 20, 20)]
CUBE += [(0, 20, 20), (0, 0, 40), (20, 0, 40), (20, 20, 40), (0, 20, 40)]
DECK = "*NODE\n" + "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in enumerate(CUBE, 1))
DECK += "*ELEMENT, TYPE=C3D8, ELSET=LOW\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
DECK += "*ELEMENT, TYPE=C3D8, ELSET=UP\n2, 5, 6, 7, 8, 9, 10, 11, 12\n"
DECK += "*SOLID SECTION, ELSET=LOW, MATERIAL=STEEL\n*SOLID SECTION, ELSET=UP, MATERIAL=ALU\n"


def test_a_set_of_cells_is_shown_and_becomes_a_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bar.inp").write_text(DECK)
    assert main(["show", "bar.inp"]) == 2
    assert "LOW (STEEL, 1 cells), UP (ALU, 1 cells)" in " ".join(capsys.readouterr().err.split())
    assert main(["show", "bar.inp", "--solid", "LOW", "--unit", "1 mm"]) == 0
    assert "cut" in capsys.readouterr().out
    assert main(["new", "mine", "--part", "bar.inp", "--unit", "1 mm", "--solid", "up"]) == 0
    assert 'unit = "1 mm", solid = "up" }' in Path("mine/mine.toml").read_text()
