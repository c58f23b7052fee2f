"""Lobes along the feed of a path: limits of the direction in which the tool moves against its work."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from headstock.app.tables.sweep_quantities import limit_words
from headstock.geometry.machine.machine import Pose
from headstock.geometry.machine.tool_travel import Feed, find_feed
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import PoseLobes
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene, prepare_sweep
from headstock.scene.reading.findings import SceneError
from headstock.studies.sweeps.files import SWEEP_FILE, summarise_sweep, write_sweep
from headstock.studies.sweeps.results import SweepResults
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses

MACHINES = Path(__file__).parents[3] / "machines"
RADIUS = 60.0  # of the circle [mm]
LOBES = """{ speeds = ["8000 rpm", "12000 rpm", 4], mill = { diameter = "16 mm", teeth = 4 },
 material = "al7075-t6", radial_depth = "12 mm", directions = [%s] }"""


@pytest.fixture(autouse=True)
def _own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def settings(path: str, directions: str, more: str = "") -> tuple[str, ...]:
    return (
        "analyses.lobes=" + (LOBES % directions).replace("\n", ""),
        f'sweeps.way={{ path = [{path}], step = "1 m"{more} }}',
        "analyses.modal.on_request=true",
        "analyses.static.on_request=true",
    )


def sweep(
    scene: str, folder: Path, path: str, directions: str, variant: str | None = "R"
) -> tuple[SweepResults, int]:
    overrides = settings(path, directions)
    loaded = load_scene(MACHINES / f"{scene}.toml", variant=variant, overrides=overrides)
    loaded = prepare_sweep(loaded, "way", overrides=overrides)
    job = SweepJob(select_analyses(loaded), loaded.sweeps["way"], folder)
    outcome = run_sweep(job, comm=MPI.COMM_SELF)
    return gather_sweep(job, outcome), outcome.computed


def waypoints(form: str, *places: float) -> str:
    """Poses of a path, each from a place [mm]."""
    return ", ".join(f"{{ {form.format(place)} }}" for place in places)


def test_a_straight_path_has_the_limits_of_a_fixed_direction_there_and_back(tmp_path: Path) -> None:
    """The table moves along X, so the tool travels against it the other way; half a turn about the
    tool changes no limit.
    """
    path = waypoints('X = "{} mm"', 0, 25, 50, 25)
    results, computed = sweep("three_axis", tmp_path, path, '"feed", "-x"')
    feed, fixed = results.limits["feed"], results.limits["-x"]
    np.testing.assert_array_equal(feed.directions, [[-1, 0, 0]] * 3 + [[1, 0, 0]])
    np.testing.assert_array_equal(feed.depths[:3], fixed.depths[:3])
    np.testing.assert_allclose(feed.depths[3], fixed.depths[3], rtol=1e-6)
    assert computed == 4  # the same place twice, with another feed
    assert sweep("three_axis", tmp_path, path, '"feed", "-x"')[1] == 0
    (remark,) = results.warnings
    assert "in pose 3 (X 50 mm) the way has a corner" in remark
    write_sweep(tmp_path, results)
    with h5py.File(tmp_path / SWEEP_FILE) as file:
        np.testing.assert_array_equal(file["lobes/feed/directions"], feed.directions)
    summary = summarise_sweep(results)
    assert summary["lobes"]["feed"]["directions"] == feed.directions.tolist()
    assert any(words.startswith("travel feed:") for words in limit_words(results))


def test_on_a_circle_limits_are_those_of_the_axes_and_of_the_diagonal(tmp_path: Path) -> None:
    angles = np.radians([-22.5, 0.0, 22.5, 45.0, 67.5, 90.0, 112.5])
    path = ", ".join(
        f'{{ X = "{RADIUS * np.cos(angle):.12f} mm", Y = "{RADIUS * np.sin(angle):.12f} mm" }}'
        for angle in angles
    )
    results, _ = sweep("three_axis", tmp_path, path, '"y", "feed", [1, 1, 0], "x"')
    feed = results.limits["feed"]
    tangents = np.column_stack([np.sin(angles), np.cos(angles), np.zeros(7)])
    np.testing.assert_allclose(feed.directions[1:-1], tangents[1:-1], atol=1e-9)
    # one-sided at the ends, of second order: (22.5 deg)^2 / 3 at most
    np.testing.assert_allclose(feed.directions[[0, -1]], tangents[[0, -1]], atol=0.052)
    for pose, name in ((1, "y"), (3, "0.7071 0.7071 0"), (5, "x")):
        np.testing.assert_allclose(feed.depths[pose], results.limits[name].depths[pose], rtol=1e-6)
    assert results.warnings == ()


def way_of(corners: list[tuple[float, float]]) -> Feed:
    """Feed of a point that X and Y of the three-axis machine lead through places [mm]."""
    machine = load_scene(MACHINES / "three_axis.toml", variant="R").machine
    poses = [Pose(str(n), {"X": 1e-3 * x, "Y": 1e-3 * y}) for n, (x, y) in enumerate(corners)]
    return find_feed(machine, machine.points["tcp"], np.zeros(3), poses)


def test_a_closed_circle_has_its_tangent_at_the_seam_but_a_square_has_a_corner() -> None:
    angles = np.radians([0.0, 15.0, 40.0, 60.0, *np.arange(90.0, 346.0, 15.0), 360.0])
    circle = way_of([(RADIUS * np.cos(a), RADIUS * np.sin(a)) for a in angles])
    # the table moves along X, so the tool travels against it
    tangents = np.column_stack([np.sin(angles), np.cos(angles), np.zeros(len(angles))])
    np.testing.assert_allclose(circle.directions[[0, -1]], tangents[[0, -1]], atol=1e-9)
    assert circle.corners == circle.standing == ()
    square = way_of([(0, 0), (50, 0), (50, 50), (0, 50), (0, 0)])
    np.testing.assert_allclose(square.directions[[0, -1]], [[-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert square.corners == (1, 2, 3)


@pytest.mark.parametrize("variant", ["lumped", "components"])
def test_the_tool_of_a_mechanism_is_fed_where_its_path_leads(tmp_path: Path, variant: str) -> None:
    path = waypoints('X = "{} mm", Z = "200 mm"', 0, 30, 100)
    results, _ = sweep("tripteor", tmp_path, path, '"feed", "x"', variant)
    assert results.states == ("done",) * 3
    feed, fixed = results.limits["feed"], results.limits["x"]
    np.testing.assert_allclose(feed.directions, [[1.0, 0.0, 0.0]] * 3, atol=1e-12)
    np.testing.assert_allclose(feed.depths, fixed.depths, rtol=1e-9)


def test_a_pose_in_which_the_tool_plunges_has_no_limit_and_says_so(tmp_path: Path) -> None:
    path = '{ Z = "0 mm" }, { Z = "20 mm" }, { Z = "20 mm", Y = "20 mm" }'
    results, _ = sweep("three_axis", tmp_path, path, '"feed"')
    known = np.isfinite(results.limits["feed"].depths).all(axis=1)
    assert known.tolist() == [False, False, True]
    assert results.failed == ()
    assert any("fed along its axis" in remark for remark in results.warnings)


def test_a_run_takes_the_feed_of_its_path_analysis(tmp_path: Path) -> None:
    lobes = "analyses.lobes=" + (LOBES % '"feed"').replace("\n", "")
    scene = load_scene(MACHINES / "three_axis.toml", variant="R", overrides=(lobes,))
    answers = run_scene(scene, tmp_path / "run", comm=MPI.COMM_SELF).answers
    (own,) = next(iter(find_answers(answers, PoseLobes))).directions
    assert (own.name, own.direction) == ("feed", (-1.0, 0.0, 0.0))


def use_scene(path: Path, name: str | None, overrides: tuple[str, ...], folder: Path) -> None:
    scene = load_scene(path, variant="R", overrides=overrides)
    if name is None:
        run_scene(scene, folder, comm=MPI.COMM_SELF)
    else:
        prepare_sweep(scene, name, overrides=overrides)


GRID, NO_PATH = 'sweeps.way={ axes = { X = ["0 mm", "1 mm", 2] } }', "analyses.path=false"
LIST = 'sweeps.way={ poses = [{ X = "0 mm" }] }'


@pytest.mark.parametrize(
    ("more", "name", "words"),
    [
        ((NO_PATH,), None, "a pose alone has no feed; sweep a path"),
        ((GRID,), "way", "is a grid of poses"),
        ((LIST,), "way", "is a list of poses"),
        ((GRID, NO_PATH), "way", "and the scene has none; write a sweep with a path"),
    ],
)
def test_poses_without_a_feed_are_refused_with_the_key_and_a_remedy(
    tmp_path: Path, more: tuple[str, ...], name: str | None, words: str
) -> None:
    path = tmp_path / "scene.toml"
    text = (MACHINES / "three_axis.toml").read_text()
    feed = 'directions = ["x", "feed"]'
    lines = text.replace("radial_depth =", f"{feed}\nradial_depth =").splitlines()
    path.write_text("\n".join(lines))
    overrides = (*settings('{ X = "0 mm" }, { X = "1 mm" }', '"x", "feed"')[1:], *more)
    overrides = ("analyses.lobes.on_request=false", *overrides)
    with pytest.raises(SceneError, match=words) as caught:
        use_scene(path, name, overrides, tmp_path / "run")
    (problem,) = caught.value.problems
    assert problem.key == "analyses.lobes.directions[1]"
    assert lines[(problem.line or 0) - 1] == feed


def test_a_path_along_which_the_tool_stands_still_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="does not move against its work; write another path"):
        sweep("three_axis", tmp_path, waypoints('X = "{} mm"', 5, 5), '"feed"')
