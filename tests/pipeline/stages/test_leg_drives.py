"""Drives of legs in scenes: the lumped mechanism, the same of rigid components, and legs that bend."""

from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx, present
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.control import ControlAnswer
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.second_order import ComplexArray
from scene_runs import run

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"
FRF = (
    'analyses.frf = { up_to = "250 Hz", points = 41, adaptive = false, inputs = [["tcp", "x"], ["tcp", "z"]],'
    ' poses = ["config_2"], motors = "controlled" }'
)
POSE = 'analyses.control.poses = ["config_2"]'


def load(variant: str, *settings: str) -> Scene:
    given = [setting.replace(" = ", "=", 1) for setting in (FRF, POSE, *settings)]
    scene = load_scene(SCENE, variant=f"{variant}+controlled", overrides=given)
    return keep_analyses(scene, ["frf", "control"])


def receptance(results: Results) -> ComplexArray:
    return find_answers(results.answers, PoseResponse)[0].curves.receptance


def poles(results: Results) -> ComplexArray:
    return np.array([pole.pole for pole in find_answers(results.answers, ControlAnswer)[0].poles])


@pytest.fixture(scope="module")
def lumped(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return run(load("lumped"), tmp_path_factory.mktemp("lumped"))


def test_legs_of_rigid_components_are_controlled_like_those_of_the_lumped_mechanism(
    lumped: Results, tmp_path: Path
) -> None:
    found = run(load("components"), tmp_path)
    assert lumped.failures == found.failures == ()
    # velocity feed-forward takes the whole lag off
    (answer,) = find_answers(lumped.answers, ControlAnswer)
    assert [drive.velocity_lag for drive in answer.drives] == [0.0, 0.0, 0.0]
    assert len(poles(lumped)) >= 9
    np.testing.assert_allclose(poles(found), poles(lumped), rtol=1e-6)
    size = np.abs(receptance(lumped)).max()
    np.testing.assert_allclose(receptance(found), receptance(lumped), atol=1e-7 * size)
    ours, theirs = (
        [drive.margins for drive in find_answers(each.answers, ControlAnswer)[0].drives]
        for each in (found, lumped)
    )
    for one, other in zip(ours, theirs, strict=True):
        assert one.phase_deg == approx(present(other.phase_deg), rel=1e-5)


def test_the_plan_says_which_legs_are_under_control() -> None:
    reasons = {stage.kind: stage.reason for stage in plan_scene(load("lumped")).stages}
    assert "leg_1, leg_2, leg_3" in reasons["control"]
    assert "under control" in reasons["frf"]
    milled = load_scene(SCENE, variant="lumped+controlled")
    reasons = {stage.kind: stage.reason for stage in plan_scene(milled).stages}
    assert "leg_1, leg_2, leg_3 under control" in reasons["contour"]


@cases
def test_what_is_wrong_with_the_drive_of_a_leg_is_said_at_its_key(
    variant: str, setting: str, key: str, words: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load(variant, *setting.split("; "))
    (found,) = [problem for problem in caught.value.problems if problem.key == key]
    assert words in found.message


def test_the_weight_of_released_legs_stiffens_the_components_as_the_lumped_mechanism(
    tmp_path: Path,
) -> None:
    """There by the complex step with the legs free to grow, here by the forces of locked joints."""
    stiffened = "effects.gravity_stiffening = true"
    moved = []
    for variant in ("lumped", "components"):
        plain, found = (poles(run(load(variant, *more), tmp_path)) for more in ((), (stiffened,)))
        moved.append(found - plain)
    assert np.abs(moved[0]).max() > 1e-3
    np.testing.assert_allclose(moved[1], moved[0], atol=1e-3 * np.abs(moved[0]).max())
