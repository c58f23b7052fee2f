"""What the model of a machine is worth is what another model of it moves, and what it saves."""

from pathlib import Path

import pytest

import scene_runs
from common import approx
from fixture_machines import machine, write_scene
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.numbers.numbers import make_key
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.studies.kind_changes import Change
from headstock.studies.model_influence import ModelFinding, RunPrice, rank_findings, try_models
from headstock.studies.model_trials import ModelTrial, Sense, list_model_trials

pytestmark = pytest.mark.fem
MACHINES = Path(__file__).resolve().parents[2] / "machines"
SHIPPED = ["cantilever", "fixed_beam", "guideway", "three_axis", "tripteor"]
# a slender column that bends, on a compact block that hardly does
TOWER = machine("""
machine = "column"
components.block.interfaces = { bottom = { face = "z-" }, top = { face = "z+", rect = { size = ["60 mm", "60 mm"] } } }
components.column.solid = { box = ["24 mm", "16 mm", "500 mm"] }
components.column.fidelity = "segmented"
components.column.segments = { count = 10, along = "z" }
joints.feet.stiffness = { x = "2000 N/um", y = "2000 N/um", z = "2000 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
analyses.static = { at = "tcp" }
analyses.modal = { count = 2 }
""")


def trial(sense: Sense) -> ModelTrial:
    return ModelTrial("elasticity", ("base",), "elastic", "rigid", (), sense)


def finding(share: float, seconds: float, sense: Sense = "simpler", **more: object) -> ModelFinding:
    key = make_key("frequency", pose="reference", mode=1)
    change = Change(key, share, 50.0 * (1.0 + share), 50.0, "Hz")
    lacks = ("first bending (50 Hz)",) if more else ()
    written, tried = RunPrice(10.0, 500.0), RunPrice(seconds, 300.0)
    return ModelFinding(trial(sense), (change,), missing=lacks, written=written, tried=tried)


@pytest.mark.parametrize(("found", "action", "verdict"), [
    (finding(1.0, 5.0, missing=True), "keep", "lacks first bending (50 Hz), 50 % less time: keep elastic"),
    (finding(5e-4, 8.8), "drop", "moves frequencies by 0.05 %, 12 % less time: rigid is enough"),
    (finding(5e-4, 9.9), "either", "moves frequencies by 0.05 %, within 5 % of the time: either will do"),
    (finding(5e-3, 5.0), "third digit", "moves frequencies by 0.5 %, 50 % less time: keep elastic for the third digit"),
    (finding(0.2, 5.0, "other"), "matters", "moves frequencies by 20 %, 50 % less time: take the one that is like the joint"),
    (finding(0.2, 15.0, "richer"), "take", "moves frequencies by 20 %, 50 % more time: take rigid"),
    (finding(5e-4, 15.0, "richer"), "enough", "moves frequencies by 0.05 %, 50 % more time: elastic is enough"),
])  # fmt: skip
def test_the_verdict_follows_from_what_is_moved_and_saved(
    found: ModelFinding, action: str, verdict: str
) -> None:
    assert (found.action, found.verdict) == (action, verdict)


def test_what_moves_most_for_its_price_comes_first() -> None:
    cheap, dear = finding(0.1, 9.0), finding(0.2, 1.0)
    obstacle = ModelFinding(trial("simpler"), obstacle="no bar")
    assert rank_findings([obstacle, dear, cheap]) == [cheap, dear, obstacle]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_body_is_tried_with_and_without_its_elasticity(name: str) -> None:
    scene = load_scene(MACHINES / f"{name}.toml")
    trials = list_model_trials(scene, plan_scene(scene))
    bodies = set() if scene.is_lumped else set(scene.machine.components)
    tried = {body for each in trials for body in each.bodies if each.kind == "elasticity"}
    assert tried == bodies
    assert bool(trials) == (name != "tripteor")
    for each in trials:
        rigid = {scene.machine.components[body].fidelity == "rigid" for body in each.bodies}
        assert rigid in ({False}, {True}, set())
        assert rigid != {True} or each.tried == "elastic"
        changed = load_scene(MACHINES / f"{name}.toml", overrides=each.settings)
        assert changed.raw != scene.raw


def test_equal_bodies_are_tried_together_and_the_pose_where_there_is_a_path() -> None:
    path = MACHINES / "three_axis.toml"
    scene = load_scene(path, overrides=["analyses.path.on_request=false"])
    trials = list_model_trials(scene, plan_scene(scene))
    assert ("column_left", "column_right") in {each.bodies for each in trials}
    (pose,) = [each for each in trials if each.kind == "pose"]
    assert (pose.written, pose.tried) == ("pose_dependent", "frozen")
    assert not list_model_trials(load_scene(path, overrides=['accuracy="3 %"']), plan_scene(scene))


def test_a_body_that_bends_loses_a_mode_by_name_and_one_that_does_not_may_be_rigid(
    tmp_path: Path,
) -> None:
    path = write_scene(tmp_path, TOWER, name="tower")
    choice = SceneChoice(path, None, (), ())
    found = try_models(choice, Store(tmp_path / "store"), kinds=["elasticity"])
    by_change = {(each.trial.bodies[0], each.trial.tried): each for each in found}
    column = by_change["column", "rigid"]
    assert column.action == "keep" and any("column bends" in mode for mode in column.missing)
    block = by_change["block", "rigid"]
    assert not block.missing and block.action == "drop", block.verdict
    assert 0.0 < block.influence < 1e-3 and block.saved_share > 0.3
    assert block.tried.peak_memory_mb > 0.0
    kinds = {change.label for change in block.changes}
    assert kinds >= {"frequencies", "static compliance"}
    # one is the other with what is written and tried changed round
    assert by_change["column", "elastic"].trial.sense == "richer"
    assert not (tmp_path / "store").exists() or not list((tmp_path / "store").iterdir())


DATA = Path(__file__).resolve().parents[1] / "data"
FOLLOWED = 'analyses.path.pose_model="pose_dependent"'
MOVE = """
[effects]
damping = { modal = "2 %" }
[analyses.path]
from = { X = "-100 mm" }
to = { X = "150 mm" }
feeds = ["12 m/min"]
time_constant = "100 ms"
lowpass = "300 Hz"
pose_model = "WRITTEN"
"""


@pytest.mark.parametrize(
    ("written", "tried", "sense"),
    [
        ("pose_dependent", "frozen", "simpler"),
        pytest.param("frozen", "pose_dependent", "richer", marks=pytest.mark.trials),
    ],
)
def test_the_worth_of_following_the_pose_is_the_difference_that_one_run_tells(
    written: str, tried: str, sense: str, tmp_path: Path
) -> None:
    move = MOVE.replace("WRITTEN", written)
    path = write_scene(tmp_path, (DATA / "slide.toml").read_text() + move, name="slide")
    choice = SceneChoice(path, None, (), ("path",))
    (found,) = try_models(choice, Store(tmp_path / "trials"), kinds=["pose"])
    assert not found.obstacle
    assert (found.trial.written, found.trial.tried, found.trial.sense) == (written, tried, sense)
    results = scene_runs.run(load_scene(path, overrides=[FOLLOWED]), tmp_path, "results")
    (answer,) = find_answers(results.answers, PathResult)
    (run,) = answer.runs
    peaks = {
        name: [1e6 * size for zones in figures for zone in zones for size in (zone.peak, zone.span)]
        for name, figures in (("pose_dependent", run.figures), ("frozen", run.frozen_figures))
    }
    (change,) = [each for each in found.changes if each.label == "path deviation"]
    assert any(1e6 * (change.present or 0.0) == approx(peak, rel=1e-3) for peak in peaks[written])
    assert any(1e6 * (change.without or 0.0) == approx(peak, rel=1e-3) for peak in peaks[tried])
    assert 0.01 < found.influence < 1.0 and change.key["output"] != "tcp y"  # zero by symmetry
