"""Path analyses as stages: run only when asked, what is planned, and what the files hold."""

import json
from pathlib import Path

import numpy as np
import pytest

import scene_runs
from common import approx, present
from fixture_machines import stored_scene, write_scene
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.numbers.estimates import DISCRETISATION
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages.refined_models import NOT_ASKED
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses, list_analyses
from headstock.solvers.milling.forces import cutting_forces

SCENE = stored_scene("path_runs")


CUT = """
[analyses.path.cut]
mill = { diameter = "10 mm", teeth = 2, helix = "30 deg" }
spindle = "6000 rpm"
axial_depth = "1 mm"
radial_depth = "2 mm"
material = "al7075-t6-dry"
"""


def load(folder: Path, text: str = SCENE) -> Scene:
    path = write_scene(folder, text)
    return load_scene(path)


def run(folder: Path, scene: Scene) -> Results:
    return scene_runs.run(scene, folder, "results")


def run_path(folder: Path, text: str = SCENE) -> PathResult:
    (found,) = find_answers(
        run(folder, keep_analyses(load(folder, text), ["path"])).answers, PathResult
    )
    return found


def test_an_analysis_on_request_runs_only_when_it_is_named(tmp_path: Path) -> None:
    scene = load(tmp_path)
    assert PathRequest not in scene.analyses
    assert list(list_analyses(scene)) == ["modal", "path"]
    assert [stage.kind for stage in plan_scene(scene).stages] == [
        "rigid",
        "rigid",
        "couple",
        "modal",
        "write",
    ]
    asked = keep_analyses(scene, ["path"])
    assert [stage.kind for stage in plan_scene(asked).stages] == [
        "rigid",
        "rigid",
        "couple",
        "path",
        "write",
    ]
    ordinary = load(tmp_path, SCENE.replace("on_request = true\n", ""))
    assert PathRequest in ordinary.analyses


def test_what_was_found_is_in_the_summary_and_in_the_results_file(tmp_path: Path) -> None:
    found = run_path(tmp_path)
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())["path"]
    assert [run["name"] for run in summary["feeds"]] == ["600 mm/min", "3000 mm/min"]
    assert summary["feeds"][1]["acceleration"] == approx(0.5, rel=1e-12)
    assert [output["dof"] for output in summary["feeds"][0]["outputs"]] == [
        ["tcp", "x"],
        ["tcp", "y"],
        ["tcp", "z"],
    ]
    zone = found.runs[1].figures[0][0]
    assert summary["feeds"][1]["outputs"][0]["accelerating"]["peak_um"] == approx(
        1e6 * zone.peak, rel=1e-12
    )
    (again,) = find_answers(open_results(tmp_path / "results").answers, PathResult)
    curves = {run.curves.feed: run.curves for run in again.runs}
    # in the order of the scene, though "3000 ..." sorts before "600 ..."
    assert list(curves) == [approx(0.01), approx(0.05)]
    for run_found in found.runs:
        read = curves[run_found.curves.feed]
        np.testing.assert_array_equal(read.deviation.total, run_found.curves.deviation.total)
        assert read.zones == run_found.curves.zones
        assert read.outputs == run_found.curves.outputs


def test_the_quasi_static_part_is_inertia_over_stiffness(tmp_path: Path) -> None:
    """Along x the slider hangs on its screw; by symmetry nothing moves along y."""
    text = SCENE.replace(
        'stiffness = { normal = "500 N/um", shear = "300 N/um", tilt = "1e7 N m/rad" }', ""
    ).replace('kind = "bolted"', 'kind = "rigid"')
    x, y, _ = (zones[0] for zones in run_path(tmp_path, text).runs[1].figures)
    mass = 0.2 * 0.2 * 0.3 * 7850.0
    # the point lies 300 mm above the guide, whose pitch stiffness takes the moment of the mass 150
    # mm above it
    expected = -0.5 * mass * (1.0 / 100e6 + 0.15 * 0.3 / 1e6)
    assert x.quasi_static == approx(expected, rel=1e-9)
    assert abs(y.peak) < 1e-9 * abs(x.peak)


@pytest.mark.parametrize("pose_model", ["frozen", "pose_dependent"])
def test_a_cut_without_control_pushes_the_tool_away_by_its_mean_force_times_the_compliance(
    tmp_path: Path, pose_model: str
) -> None:
    """Motors are held: over whole turns at constant feed, the teeth deflect bed, guide and screw."""
    text = SCENE.replace('feeds = ["600 mm/min", "3000 mm/min"]', 'feeds = ["3000 mm/min"]')
    text = text.replace(
        'lowpass = "300 Hz"', f'pose_model = "{pose_model}"\nresidual_time = "20 ms"'
    )
    text = text.replace("on_request = true", CUT)
    text = text.replace('modal = "2 %" }', 'modal = "20 %" }\ncutting_force = true')
    scene = load(tmp_path, text + '[analyses.static]\nat = "tcp"\n')
    found = run(tmp_path, scene)
    curves = find_answers(found.answers, PathResult)[0].runs[0].curves
    times = curves.deviation.times
    # 10 ms for a turn; X 0 mm, the pose of the static analysis, in the middle
    steady = (times >= 0.2) & (times < 0.3)
    mean = curves.deviation.total[steady].mean(axis=0)
    fine = 0.2 + 1e-6 * np.arange(100_000)
    path = scene.analyses.get(PathRequest)
    assert path is not None and path.cut is not None
    force = cutting_forces(path.cut.cut, fine, np.full(len(fine), 0.05)).mean(axis=0)
    (compliance,) = (points["tcp"].compliance[:3, :3] for points in found.static.values())
    np.testing.assert_allclose(mean, compliance @ force, rtol=2e-3)


@pytest.mark.fem
def test_a_path_has_an_error_unless_the_scene_wants_none(tmp_path: Path) -> None:
    start = SCENE.index("[components.slider]")
    deforming = SCENE[:start] + SCENE[start:].replace(
        'fidelity = "rigid"', 'fidelity = "elastic"\nmesh = { size = "60 mm" }', 1
    )
    found, bare = (
        run_path(tmp_path, deforming.replace("on_request", f"estimate = {estimate}\non_request"))
        for estimate in ("true", "false")
    )
    owners = [error.parts.get(DISCRETISATION, {}) for error in found.errors.values()]
    assert any("slider" in each for each in owners)
    assert all(error.total is None for error in bare.errors.values())
    np.testing.assert_array_equal(
        bare.runs[0].curves.deviation.total, found.runs[0].curves.deviation.total
    )
    told, silent = found.summarise(), bare.summarise()
    assert told["error_left_out"] == ["rigid model of bed"]
    assert silent["error_left_out"] == [NOT_ASKED]
    errors, none = (
        each["feeds"][0]["outputs"][0]["errors"]["accelerating"] for each in (told, silent)
    )
    assert present(errors["peak_um"]) > 0.0 and none["peak_um"] is None


def test_an_undamped_path_is_warned_of(tmp_path: Path) -> None:
    text = SCENE.replace('[effects]\ndamping = { modal = "2 %" }\n', "")
    results = run(tmp_path, keep_analyses(load(tmp_path, text), ["path"]))
    assert any("nothing is damped" in warning for warning in results.warnings)
    (found,) = find_answers(results.answers, PathResult)
    assert not found.damped and found.runs[0].figures[0][0].settling is None


def test_a_path_that_leaves_the_rail_is_named(tmp_path: Path) -> None:
    scene = Path(__file__).parents[3] / "machines" / "guideway.toml"
    text = scene.read_text().replace('"240 mm"]\n\n[points]', '"260 mm"]\n\n[points]')
    text += '\n[analyses.path]\nfrom = { X = "0 mm" }\nto = { X = "250 mm" }\nfeeds = ["3000 mm/min"]\ntime_constant = "100 ms"\n'
    with pytest.raises(SceneError) as caught:
        load(tmp_path, text)
    assert {problem.key for problem in caught.value.problems} == {"analyses.path.to"}
    assert all(
        "hangs 10 mm over the end of rail bed.rail_" in problem.message
        for problem in caught.value.problems
    )


def test_poses_are_followed_unless_the_scene_keeps_that_of_the_middle(tmp_path: Path) -> None:
    followed = run_path(tmp_path)
    assert followed.poses is not None
    assert followed.poses.sampled_poses == 9
    assert followed.poses.error < 5e-5
    kept = run_path(tmp_path, SCENE.replace("on_request", 'pose_model = "frozen"\non_request'))
    assert kept.poses is None
    for one, other in zip(followed.runs, kept.runs, strict=True):
        np.testing.assert_array_equal(one.curves.frozen, other.curves.deviation.total)
        np.testing.assert_array_equal(other.curves.frozen, other.curves.deviation.total)
        # the slider's way on its bed changes little, and what it changes is reported
        change = np.abs(one.curves.deviation.total - one.curves.frozen).max()
        assert (
            1e-4 * np.abs(one.curves.frozen).max() < change < 0.2 * np.abs(one.curves.frozen).max()
        )
    assert followed.poses.effect == approx(
        [np.abs(run.curves.deviation.total - run.curves.frozen).max() for run in followed.runs]
    )


DRIVE = stored_scene("path_runs_drive")
DRIVEN = SCENE.replace('[effects]\ndamping = { modal = "2 %" }\n', DRIVE).replace(
    "on_request",
    'pose_model = "pose_dependent"\noutputs = [["tcp", "x"], ["tcp", "z"]]\non_request',
)


def test_drives_on_a_bed_that_stands_still_do_not_see_the_pose(tmp_path: Path) -> None:
    text = DRIVEN.replace(
        'stiffness = { normal = "500 N/um", shear = "300 N/um", tilt = "1e7 N m/rad" }', ""
    ).replace('kind = "bolted"', 'kind = "rigid"')
    found = run_path(tmp_path, text)
    assert found.poses is not None and found.poses.truncation < 1e-3
    for run_found in found.runs:
        followed, frozen = run_found.curves.deviation.total, run_found.curves.frozen
        np.testing.assert_allclose(followed, frozen, rtol=0.0, atol=1e-9 * np.abs(frozen).max())


def test_drives_on_a_bed_that_tilts_see_the_pose(tmp_path: Path) -> None:
    soft = 'stiffness = { normal = "9 N/um", shear = "9 N/um", tilt = "1e5 N m/rad", torsion = "1e5 N m/rad" }'
    text = DRIVEN.replace(
        'stiffness = { normal = "500 N/um", shear = "300 N/um", tilt = "1e7 N m/rad" }', soft
    )
    found = run_path(tmp_path, text.replace('["tcp", "x"], ', ""))
    assert found.poses is not None and found.drives == ("X",)
    for run_found in found.runs:
        change = np.abs(run_found.curves.deviation.total - run_found.curves.frozen).max()
        size = np.abs(run_found.curves.frozen).max()
        assert found.poses.error < 5e-5 and change > 1e-3 * size, (change, size)
    # the same controller as a state space
    law = "controller = { a = [[0]], b = [[1e3]], c = [[1333.3333333333333]], d = [[2e4]] }"
    own = text.replace('velocity_gain = "2e4 N s/m"\nintegral_time = "15 ms"', law)
    assert own != text
    other = run_path(tmp_path, own.replace('["tcp", "x"], ', ""))
    for first, second in zip(found.runs, other.runs, strict=True):
        moved = [each.curves.deviation.total for each in (first, second)]
        np.testing.assert_allclose(moved[1], moved[0], rtol=0.0, atol=1e-7 * np.abs(moved[0]).max())


def test_control_that_is_unstable_somewhere_on_the_path_is_refused_there(tmp_path: Path) -> None:
    scene = keep_analyses(load(tmp_path, DRIVEN.replace("2e4 N s/m", "4e6 N s/m")), ["path"])
    results = run(tmp_path, scene)
    (failure,) = results.failures
    assert "the control of axis X is unstable" in failure
