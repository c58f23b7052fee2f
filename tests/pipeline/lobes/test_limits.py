"""How far the lowest limit depth may be off, compared with limits of a finer mesh and of more modes."""

from pathlib import Path

import h5py
import pytest

import scene_runs
from common import approx, present
from fixture_machines import stored_scene
from headstock.app.report.report import render_report
from headstock.app.texts.bounded_values import show_bound
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import HZ, DirectionLobes, PoseLobes
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION
from headstock.pipeline.numbers.folders import RESULTS_FILE
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene

pytestmark = [pytest.mark.fem, pytest.mark.process]

SCENE = stored_scene("limits")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lobes")


@pytest.fixture(scope="module")
def runs(folder: Path) -> dict[str, Results]:
    (folder / "scene.toml").write_text(SCENE)
    changes = {
        "coarse": [],
        "fine": ['components.column.mesh={ size = "22 mm", cells = "hex" }'],
        "few": ["components.column.reduction.modes=0"],
    }
    return {
        name: scene_runs.run(load_scene(folder / "scene.toml", overrides=overrides), folder, name)
        for name, overrides in changes.items()
    }


def find_direction(results: Results) -> DirectionLobes:
    (found,) = find_answers(results.answers, PoseLobes)
    return found.directions[0]


@pytest.mark.parametrize(
    ("model", "truth", "source", "largest"),
    [("coarse", "fine", DISCRETISATION, 4.0), ("few", "coarse", REDUCTION, 1.3)],
)
def test_a_lowest_limit_and_its_chatter_lie_within_their_errors_of_a_finer_model(
    runs: dict[str, Results], model: str, truth: str, source: str, largest: float
) -> None:
    own, other = (find_direction(runs[name]) for name in (model, truth))
    first = present(own.lowest).place
    off = abs(float(own.depths[first] - other.depths[first]))
    assert off > 2e-3 * own.depths[first]
    depth, chatter = own.estimate(first)
    error = present(depth.shares[source])
    assert off < error < largest * off
    off = HZ * abs(float(own.chatter[first] - other.chatter[first]))
    error = present(chatter.shares[source])
    assert off < error < largest * off


def test_errors_of_lowest_limits_stand_in_table_summary_and_file(
    runs: dict[str, Results], folder: Path
) -> None:

    own = find_direction(runs["few"])
    depth, chatter = own.estimate(present(own.lowest).place)
    summary = summarise(runs["few"])
    direction = summary["lobes"]["reference"]["directions"][0]
    assert direction["lowest_error_mm"] == approx(1e3 * present(depth.total))
    assert set(direction["chatter_error_share"]) == {DISCRETISATION, REDUCTION}
    with h5py.File(folder / "few" / RESULTS_FILE) as file:
        group = file["lobes/reference/x"]
        assert group["lowest_error"][()] == present(depth.total)
        assert group["chatter_error_hz"][()] == present(chatter.total)
    page = render_report(runs["few"])
    lowest = present(direction["lowest"])
    shown = show_bound(lowest["limit_depth_mm"], direction["lowest_error_mm"])
    assert f"{shown} mm, chatter " in page
    assert "lowest limit, with its ±" in page
    assert "± of a lowest limit from border of stability up to" in page
