"""From an assembly file to a scene that runs: one command, and one list of questions."""

import csv
import tomllib
from pathlib import Path

import pytest
from assemblies import SMALL, write_assembly
from write_assembly import MILL

import headstock as hs
from common import Shell, approx


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene of a plate with two brackets, each with a screw."""
    folder = tmp_path_factory.mktemp("small")
    return hs.new_from_assembly(folder / "made", write_assembly(folder / "small.step", SMALL))


def test_equal_parts_are_one_entry_and_screws_are_point_masses(small: Path) -> None:
    scene = tomllib.loads(small.read_text())
    plate, bracket = scene["components"].values()
    assert len(bracket["places"]) == 2 and bracket["each"]["2"]["rotate"]["angle"] == "180 deg"
    assert "places" not in plate
    with (small.parent / "left_out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    # a shank of 8 x 20 and a head of 14 x 5 of steel
    assert [float(row["mass [g]"]) for row in rows] == approx([13.93] * 2, abs=0.01)
    machine = hs.load(small, accept_defaults=True)
    assert len(machine.scene.machine.components) == 3


def test_what_is_not_sure_is_asked_once(small: Path) -> None:
    questions = [text for text in hs.check(small) if text.startswith("open: ")]
    names = [text.partition("parameters.")[2].partition(" = ")[0] for text in questions]
    assert {"ground", "tool", "material_steel"} <= set(names)
    assert len(names) == len(set(names))
    with pytest.raises(hs.SceneError, match="values are open"):
        hs.load(small)


@pytest.mark.fem
def test_it_runs_with_its_defaults(small: Path) -> None:
    results = hs.run(hs.load(small, accept_defaults=True, set={"analyses.modal.count": 2}))
    (modes,) = results.modal
    # two brackets that are alike, on a plate that is fixed
    assert modes.frequencies_hz[0] > 100.0
    assert modes.frequencies_hz[1] == approx(modes.frequencies_hz[0], rel=0.01)
    assert results.provenance is not None
    assert any("material_steel" in text for text in results.provenance.accepted_defaults or ())


def test_a_folder_that_is_taken_and_other_files_are_refused(shell: Shell) -> None:
    step = write_assembly(shell.folder / "small.step", SMALL)
    (shell.folder / "taken").mkdir()
    shell.write("name = 'x'", name="taken/mine")
    assert "not an empty folder" in shell.refuses("new taken --assembly", step)
    assert "no STEP file" in shell.refuses("new made --assembly part.inp")
    assert "--unit does not go" in shell.refuses("new made --unit 1mm --assembly", step)
    assert not (shell.folder / "made").exists()


@pytest.mark.trials
def test_a_machine_has_guides_screws_bearings_and_axes(shell: Shell) -> None:
    step = write_assembly(shell.folder / "mill.step", MILL)
    printed = shell.prints("new made --assembly", step)
    assert "12 guide, 3 screw, 6 bearing" in printed
    assert "4 screws, nuts and washers left out" in printed
    loaded = hs.load(shell.folder / "made" / "made.toml", accept_defaults=True).scene
    assert set(loaded.machine.axes) == {"X", "Y", "Z"}
    assert set(loaded.machine.axes["X"].moves) >= {"table", "carriage_5", "ball_screw_nut_2"}
    assert not loaded.warnings
