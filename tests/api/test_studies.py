"""Studies, sweeps, comparisons and fits from Python find what the command line finds."""

import json
from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from common import Shell, approx
from fixture_machines import targets

ROOT = Path(__file__).resolve().parents[2]
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"
SLIDE = ROOT / "tests" / "data" / "slide.toml"
LENGTH = "components.column.solid.box[2]"
STUDY = f"""[analyses.modal]
count = 2
[studies.length]
vary = {{ "{LENGTH}" = ["400 mm", "500 mm"] }}
watch = ["modal.frequencies_hz[0]"]
[variants.shorter]
"{LENGTH}" = "400 mm"
"""


@pytest.fixture
def column(shell: Shell) -> Shell:
    shell.write(COLUMN.read_text() + STUDY)
    return shell


@pytest.fixture
def scene(column: Shell) -> Path:
    return column.folder / "scene.toml"


def test_a_study_of_the_scene_is_the_study_of_the_command_line(column: Shell) -> None:
    table = hs.study("scene.toml", "length", output="mine")
    column("study scene.toml length -o other")
    text = json.dumps(column.json("other/study.json"))
    found = [row.values["modal.frequencies_hz[0]"] for row in table.rows]
    assert len(found) == 2
    assert all(json.dumps(value) in text for value in found)


def test_a_study_made_in_python_varies_as_single_runs_do(scene: Path, tmp_path: Path) -> None:
    lengths = [0.4, 0.5]
    reported: list[bool] = []
    watch = "modal.frequencies_hz[0]"
    machine = hs.load(scene).change(set={"name": "made in Python", "analyses.modal.count": 1})
    for _ in range(2):
        table = hs.study(
            machine,
            vary={LENGTH: lengths},
            watch=[watch],
            output=tmp_path / "points",
            progress=lambda point: reported.append(point.known),
        )
    assert reported == [False, False, True, True]
    for row, length in zip(table.rows, lengths, strict=True):
        single = hs.run(machine.change(set={LENGTH: length})).modes["reference"]
        assert row.values[watch] == single.frequencies_hz[0]
    # a cantilever's frequency falls with the square of its length, nearly
    first, second = (row.values[watch] for row in table.rows)
    assert isinstance(first, float)
    assert isinstance(second, float)
    assert first / second == approx(1.5625, rel=0.02)


def test_an_unknown_study_or_value_is_told(scene: Path) -> None:
    with pytest.raises(hs.SceneError, match=r"did you mean 'length'\? studies: length"):
        hs.study(scene, "lenght")
    with pytest.raises(hs.SceneError, match=r"solid\.box"):
        hs.study(scene, vary={LENGTH: ["400 kg"]}, watch=["modal.frequencies_hz[0]"])


def test_variants_are_compared_mode_by_mode(scene: Path) -> None:
    names: list[str] = []
    found = hs.compare(scene, progress=names.append)
    assert names == ["as written", "shorter"]
    assert list(hs.compare(scene, ["shorter"]).solutions) == ["as written", "shorter"]
    assert list(hs.compare(scene, ["shorter"], baseline=False).solutions) == ["shorter"]
    lengths = {"as written": 0.5, "shorter": 0.4}
    for name, length in lengths.items():
        run = hs.run(hs.load(scene, set={LENGTH: length})).modes["reference"]
        assert found.rows[0].cells[name].frequency_hz == approx(run.frequencies_hz[0], rel=1e-9)


def test_a_sweep_has_the_frequencies_of_runs_in_its_poses(tmp_path: Path) -> None:
    stages: list[str] = []
    out = tmp_path / "out"
    swept = hs.sweep(
        SLIDE, "named", output=out, progress=lambda done: stages.append(done.stage.kind)
    )
    assert set(stages) == {"rigid", "segment"}
    assert len(swept.frequencies_hz) == 3
    assert (out / "sweep.h5").is_file()
    machine = hs.load(SLIDE, set={"poses.third": {"X": "12 mm"}})
    single = hs.run(machine, analyses=["modal"]).modes["third"].frequencies_hz
    wanted = np.sort(swept.frequencies_hz[2])
    assert wanted == approx(np.sort(single)[: len(wanted)], rel=1e-6)


TARGETS = "[fit]\nstarts = 3\n" + targets(
    200,
    500,
    length="components.column.solid.box[2]: 300 mm, 600 mm",
    stiffness="materials.steel.E: 100 GPa, 300 GPa",
)
TARGETS += "prior_sigma = 0.05\n"


@pytest.mark.trials
def test_a_fit_is_that_of_the_command_line(column: Shell) -> None:
    targets, ends = column.write(TARGETS, name="targets"), list[bool]()
    scene = column.folder / "scene.toml"
    found = hs.identify(scene, targets, progress=lambda start: ends.append(start.converged))
    assert ends == [True] * 3
    column("identify scene.toml targets.toml -o out")
    written = column.json("out/identification.json")["parameters"]
    values = [
        entry["value"] * scale for entry, scale in zip(written.values(), (1e-3, 1e9), strict=True)
    ]
    assert found.values == approx(dict(zip(written, values, strict=True)), rel=1e-9)
    fitted = {LENGTH: found.values["length"], "materials.steel.E": found.values["stiffness"]}
    modes = hs.run(hs.load(scene, set=fitted)).modes["reference"].frequencies_hz
    assert [outcome.found for outcome in found.outcomes] == approx(modes[:2], rel=1e-6)
    assert len(hs.identify(hs.load(scene), targets, starts=1).starts) == 1
    column.write(TARGETS, ("box[2]", "box[3]"), name="targets")
    with pytest.raises(hs.SceneError, match=r"box.* 3 "):
        hs.identify(scene, targets)
