"""Drives of legs in scenes: the lumped mechanism, the same of rigid components, and legs that bend."""

from pathlib import Path

import numpy as np
import pytest

import scene_runs
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

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"
FRF = (
    'analyses.frf = { to = "250 Hz", points = 41, adaptive = false, inputs = [["tcp", "x"], ["tcp", "z"]],'
    ' poses = ["config_2"], motors = "MOTORS" }'
)
POSE = 'analyses.control.poses = ["config_2"]'
UNDAMPED = "effects.damping = false"
STIFF = tuple(
    f"drives.leg_{leg}.{key}"
    for leg in (1, 2, 3)
    # a rotor without inertia: locked ones are not known to turn with their leg
    for key in ('kv = "1e3 1/s"', 'velocity_gain = "1e12 N s/m"', 'inertia = "1e-12 kg m^2"')
)


def load(
    variant: str, *settings: str, motors: str = "controlled", scene_file: Path = SCENE
) -> Scene:
    given = [setting.replace(" = ", "=", 1) for setting in (FRF, POSE, *settings)]
    scene = load_scene(
        scene_file,
        variant=f"{variant}+controlled",
        overrides=[setting.replace("MOTORS", motors) for setting in given],
    )
    return keep_analyses(scene, ["frf", "control"])


def run(folder: Path, scene: Scene) -> Results:
    return scene_runs.run(scene, folder)


def receptance(results: Results) -> ComplexArray:
    return find_answers(results.answers, PoseResponse)[0].curves.receptance


def poles(results: Results) -> ComplexArray:
    return np.array([pole.pole for pole in find_answers(results.answers, ControlAnswer)[0].poles])


@pytest.fixture(scope="module")
def lumped(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return run(tmp_path_factory.mktemp("lumped"), load("lumped"))


def test_legs_of_rigid_components_are_controlled_like_those_of_the_lumped_mechanism(
    lumped: Results, tmp_path: Path
) -> None:
    found = run(tmp_path, load("components"))
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


@pytest.mark.parametrize("variant", ["lumped", "components"])
def test_stiff_loops_leave_the_response_of_locked_motors(variant: str, tmp_path: Path) -> None:
    # without damping, so that the motors' part in it does not differ, and without dead time
    prompt = tmp_path / "prompt.toml"
    prompt.write_text(SCENE.read_text().replace('sampling = "250 us"', ""))
    closed = receptance(run(tmp_path, load(variant, UNDAMPED, *STIFF, scene_file=prompt)))
    locked = receptance(run(tmp_path, load(variant, UNDAMPED, motors="locked")))
    # a motor gives way 1e-7 as much as its leg; lines beside an undamped mode magnify that
    off = np.abs(closed - locked).max(axis=(1, 2)) / np.abs(locked).max(axis=(1, 2))
    assert np.median(off) < 1e-6
    assert off.max() < 1e-5


def test_the_plan_says_which_legs_are_under_control() -> None:
    reasons = {stage.kind: stage.reason for stage in plan_scene(load("lumped")).stages}
    assert "leg_1, leg_2, leg_3" in reasons["control"]
    assert "under control" in reasons["frf"]
    milled = load_scene(SCENE, variant="lumped+controlled")
    reasons = {stage.kind: stage.reason for stage in plan_scene(milled).stages}
    assert "leg_1, leg_2, leg_3 under control" in reasons["contour"]


@pytest.mark.parametrize(
    ("variant", "setting", "key", "words"),
    [
        ("lumped", 'drives.leg_1.axis = "q4"', "drives.leg_1.axis", "q1"),
        ("lumped", 'drives.leg_1.joint = "slide_1"', "drives.leg_1.joint", "driven itself"),
        ("lumped", 'drives.leg_1.lead = "5 mm"', "drives.leg_1.lead", "screw_lead"),
        ("components", 'drives.leg_1.joint = "tip_1"', "drives.leg_1.joint", "slide_1"),
        (
            "lumped",
            'drives.leg_2.scale = "tcp"; drives.leg_2.encoder = "scale"',
            "drives.leg_2.scale",
            "length of the leg",
        ),
        ("lumped", "effects.drive_control = false", "analyses.frf.motors", "drive_control"),
    ],
)
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
        plain, found = (poles(run(tmp_path, load(variant, *more))) for more in ((), (stiffened,)))
        moved.append(found - plain)
    assert np.abs(moved[0]).max() > 1e-3
    np.testing.assert_allclose(moved[1], moved[0], atol=1e-3 * np.abs(moved[0]).max())
