"""Meshes, interfaces and poses that may be dropped are written as a variant that runs and moves what
was said; those that matter stay.
"""

import json
import tomllib
from pathlib import Path

import pytest

from common import Shell, approx
from fixture_machines import machine, stored_scene
from headstock.pipeline.numbers.folders import read_run_numbers
from headstock.pipeline.numbers.numbers import make_key
from headstock.scene.building.loader import load_scene
from headstock.studies.effects import EffectTrial
from headstock.studies.good_enough import (
    Drop,
    append_variant,
    choose_drops,
    keep_within,
    name_variant,
)
from headstock.studies.kind_changes import Change, compare_kinds
from headstock.studies.model_influence import ModelFinding, RunPrice
from headstock.studies.model_trials import ModelTrial

pytestmark = pytest.mark.fem
DATA = Path(__file__).resolve().parents[1] / "data"
# a stiff block on soft springs, whose mesh matters little, and a column of few linear elements,
# whose mesh matters much
COLUMN = machine("""
machine = "column"
components.block.mesh = { size = "50 mm", cells = "hex" }
components.block.interfaces = { bottom = { face = "z-", coupling = "average" }, top = { face = "z+", coupling = "average" } }
components.column.fidelity = "elastic"
components.column.mesh = { size = "50 mm", cells = "hex", order = 1 }
analyses.modal = { count = 8 }
""")
# the seam of two halves is as flexible as the plate; a block on soft springs needs no shapes at its
# foot
PLATE = stored_scene("written_models_plate")
PATH = """
[effects]
damping = { modal = "2 %" }
[analyses.path]
from = { X = "FROM" }
to = { X = "TO" }
feeds = ["FEED"]
time_constant = "100 ms"
lowpass = "300 Hz"
"""


def slide(start: str, end: str, feed: str) -> str:
    move = PATH.replace("FROM", start).replace("TO", end).replace("FEED", feed)
    return (DATA / "slide.toml").read_text() + move


SLOW, FAST = slide("0 mm", "0.1 mm", "10 mm/min"), slide("-100 mm", "150 mm", "12 m/min")


BLOCK_SIZE = {"components.block.mesh.size": "71.4 mm"}
FOOT = {"components.block.interfaces.foot.coupling": "rigid"}
HALVES = {"left": "keep", "right": "keep"}
TRIAL = pytest.mark.trials


@pytest.mark.parametrize(
    ("text", "kind", "dropped", "kept"),
    [
        pytest.param(SLOW, "pose", {"analyses.path.pose_model": "frozen"}, {}, id="pose"),
        pytest.param(COLUMN, "mesh", BLOCK_SIZE, {"column": "keep"}, marks=TRIAL, id="mesh"),
        pytest.param(PLATE, "interfaces", FOOT, HALVES, marks=TRIAL, id="interfaces"),
    ],
)
def test_what_is_written_checks_runs_and_moves_what_was_said(
    text: str, kind: str, dropped: dict[str, str], kept: dict[str, str], shell: Shell
) -> None:
    shell.write(text)
    shell(f"effects scene.toml --only {kind} --write --json told.json")
    written = tomllib.loads(shell.text("scene_good_enough.toml"))
    assert written["variants"]["good_enough"] == dropped
    findings = shell.json("told.json")["models"]
    simpler = {
        each["bodies"][0]: each["action"]
        for each in findings
        if each["bodies"] and each["action"] in ("keep", "drop")
    }
    assert kept.items() <= simpler.items()
    settings = [f"{key}={json.dumps(value)}" for key, value in dropped.items()]
    (said,) = [each for each in findings if each["settings"] == settings]
    assert said["action"] == "drop" and said["worth"] > 0.0
    shell("check scene_good_enough.toml --variant good_enough")
    runs = []
    for folder, chosen in (("with", "--variant good_enough"), ("without", "")):
        shell(f"run scene_good_enough.toml {chosen} -o {folder} --no-figures")
        runs.append(read_run_numbers(shell.folder / folder).values())
    moved = max(change.share for change in compare_kinds(*runs))
    assert moved == approx(said["worth"], rel=1e-3, abs=1e-9)


def test_a_pose_that_matters_stays(shell: Shell) -> None:
    shell.write(FAST)
    told = shell("effects scene.toml --only pose --write").out
    assert "keep pose_dependent" in told and "no file is written" in told
    assert "scene_good_enough.toml" not in shell.files()


MACHINES = Path(__file__).resolve().parents[2] / "machines"
BLOCK = "# a comment of the user\n" + machine("""
machine = "column"
without = ["components.column", "joints.bolts"]
components.block.mesh = { size = "75 mm", cells = "hex" }
points.tcp.tool = "block.top"
analyses.static = { at = "tcp" }
analyses.modal = { count = 2 }
""").replace("[components.block]", "[components.block]   # odd   spacing stays")


def finding(
    tried: str, saved: float, kind: str = "elasticity", moved: float = 5e-4
) -> ModelFinding:
    trial = ModelTrial(
        "modes" if kind == "modes" else "elasticity",
        ("block",),
        "elastic",
        tried,
        (f"components.block.{kind}={tried}",),
        "simpler",
    )
    key = make_key("frequency", pose="reference", mode=1)
    change = Change(key, moved, 50.0, 50.0 * (1.0 + moved), "Hz")
    return ModelFinding(
        trial, (change,), written=RunPrice(10.0, 1.0), tried=RunPrice(10.0 * (1.0 - saved), 1.0)
    )


def test_of_what_may_be_dropped_of_a_body_the_one_that_saves_most_is_taken() -> None:
    scene = load_scene(MACHINES / "tripteor.toml")
    key = make_key("drive_force", face=1, drive="leg_1", figure="mean")
    little, nothing = (Change(key, share, 1.0, 1.0, "N") for share in (5e-4, 1e-13))
    trials = [EffectTrial("coriolis", True, (little,)), EffectTrial("damping", True, (nothing,))]
    found = [finding("segmented", 0.5), finding("rigid", 0.9), finding("5", 0.95, "modes")]
    drops = choose_drops(scene, trials, found)
    settings = [setting for drop in drops for setting in drop.settings]
    assert settings == ["effects.coriolis=false", "components.block.elasticity=rigid"]


def test_of_models_that_save_as_much_the_one_that_moves_least_is_taken() -> None:
    scene = load_scene(MACHINES / "tripteor.toml")
    found = [
        finding("segmented", 0.9, moved=1e-4),
        finding("rigid", 0.92),
        finding("polynomial", 0.5, moved=1e-6),
    ]
    (drop,) = choose_drops(scene, [], found)
    assert drop.settings == ("components.block.elasticity=segmented",)


def test_what_is_too_much_together_is_given_up_from_the_largest_on() -> None:
    drops = [Drop((f"a{number}=1",), "", worth) for number, worth in enumerate((4.0, 1.0, 2.0))]
    kept = keep_within(drops, 3.5, lambda some: sum(drop.influence for drop in some))
    assert [drop.influence for drop in kept] == [1.0, 2.0]
    assert not keep_within(drops, 0.5, lambda some: sum(drop.influence for drop in some))


def test_a_variant_keeps_every_letter_before_it_and_has_a_name_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "block.toml"
    drop = Drop(('components.block.fidelity="rigid"',), "moves little", 1e-4)
    once = append_variant(BLOCK, [drop], name="good_enough", overrides=["materials.steel.nu=0.29"])
    assert once.startswith(BLOCK)
    path.write_text(once)
    scene = load_scene(path, variant="good_enough")
    assert scene.machine.components["block"].fidelity == "rigid"
    assert scene.raw["materials"] == {"steel": {"E": "210 GPa", "nu": 0.29, "rho": "7850 kg/m^3"}}
    assert name_variant(scene) == "good_enough_2"
    windows = append_variant(BLOCK.replace("\n", "\r\n"), [drop], name="x")
    assert windows.count("\n") == windows.count("\r\n")


def test_words_of_an_option_given_twice_are_all_taken(shell: Shell) -> None:
    line = f"effects {MACHINES / 'three_axis.toml'} --list"
    once = shell(f"{line} --only modes,mesh").out
    assert once == shell(f"{line} --only modes --only mesh").out
    assert "mesh" in once and "modes" in once


def test_the_command_writes_a_scene_that_checks_and_runs_and_overwrites_nothing(
    shell: Shell,
) -> None:
    path, target = shell.write(BLOCK), shell.folder / "scene_good_enough.toml"
    line = "effects scene.toml --only elasticity --write --page effects.html"
    assert "together they move" in shell(line).out
    assert "data:image/png;base64" in shell.text("effects.html")
    assert target.read_text().startswith(BLOCK) and path.read_text() == BLOCK
    variant = "scene_good_enough.toml --variant good_enough"
    shell(f"check {variant}")
    shell(f"run {variant} -o out --no-figures")
    # which of the simpler models is taken depends on what each costs here
    block = load_scene(target, variant="good_enough").machine.components["block"]
    assert block.fidelity != "elastic"
    report = f"effects {variant} --only elasticity --report out"
    for again in (report, "report out"):
        shell(again)
        assert 'id="effects"' in shell.text("out/report.html")
    said = shell(f"{report} --set materials.steel.nu=0.25", code=2).err
    assert "results of another scene" in said
    shell("run scene_good_enough.toml -o out --no-figures")  # without the variant
    assert 'id="effects"' not in shell.text("out/report.html")
    written = target.read_bytes()
    assert "add --force" in shell(line, code=2).err
    shell("effects scene.toml --write -o scene.toml --force", code=2)
    assert target.read_bytes() == written and path.read_text() == BLOCK
