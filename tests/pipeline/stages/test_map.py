"""The map of a lumped mechanism is what single poses give, and says where there is nothing to
give.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from summary_shapes import list_strangers

from common import approx
from headstock.app.drawings.figures import draw_map, map_layers
from headstock.app.views.registry import list_tables
from headstock.app.views.volumetric import _tabulate_map
from headstock.pipeline.answers.map import WorkspaceMap
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.map import _map_workspace
from headstock.scene.analyses.map import MapRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import SceneMechanism, keep_analyses
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

SCENE = Path(__file__).resolve().parents[3] / "machines" / "tripteor.toml"


def run(folder: Path, *overrides: str) -> Results:
    scene = keep_analyses(
        load_scene(SCENE, variant="lumped", overrides=overrides), ("static", "modal", "map")
    )
    return run_scene(scene, folder, comm=MPI.COMM_SELF)


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> RunSummary:
    spans = '{ X = ["-130 mm", "160 mm", 3], Y = ["-380 mm", "390 mm", 4], Z = ["200 mm", "200 mm", 1] }'
    return summarise(
        run(
            tmp_path_factory.mktemp("map"),
            f"sweeps.plane.axes={spans}",
            'analyses.modal.poses="config_2"',
        )
    )


def test_a_corner_of_the_map_is_the_pose_that_stands_there(summary: RunSummary) -> None:
    found = summary["map"]
    alone, legs = summary["modal"][0], summary["mechanism"]["config_2"]
    assert (
        found["positions"][0][0] == -0.13
        and found["positions"][1][-1] == 0.39
        and found["fixed"] == {"Z": 0.2}
    )
    corner = {
        name: np.array(grid, dtype=float)[0, -1] for name, grid in found["quantities"].items()
    }
    for number in range(3):
        assert corner[f"f{number + 1}_hz"] == approx(alone["frequencies_hz"][number], rel=1e-12)
    assert corner["condition_number"] == approx(legs["condition_number"], rel=1e-12)
    compliance = np.diag(
        np.array(summary["static_poses"]["config_2"]["tcp"]["compliance_um_per_kN"], dtype=float)
    )
    for place, axis in enumerate("xyz"):
        assert corner[f"stiffness_{axis}_n_per_um"] == approx(1e3 / compliance[place], rel=1e-9)


def test_the_first_frequency_falls_as_the_legs_grow(summary: RunSummary) -> None:
    assert summary["map"]["f1_and_mean_leg_correlation"] < -0.95
    assert list(list_strangers(summary)) == []


def test_poses_beyond_a_limit_are_empty_in_summary_table_and_picture(tmp_path: Path) -> None:
    spans = (
        '{ X = ["-300 mm", "2 m", 4], Y = ["-100 mm", "100 mm", 3], Z = ["200 mm", "200 mm", 1] }'
    )
    results = run(tmp_path, f"sweeps.plane.axes={spans}")
    (found,) = results.find(WorkspaceMap)
    values = np.array(summarise(results)["map"]["quantities"]["f1_hz"], dtype=float)
    np.testing.assert_array_equal(values, found.quantities["f1_hz"])
    assert np.isfinite(values[0]).all() and np.isnan(values[-1]).all()
    table = next(table for table in list_tables(results) if table.name == "map")
    assert table.rows[-1][-1] is None and len(table.rows) == 12
    assert "data:image/png;base64" in str(draw_map(found, "f1_hz"))


def request_of(axes: str, *overrides: str) -> tuple[MapRequest, SceneMechanism, CompliantMechanism]:
    scene = load_scene(SCENE, variant="lumped", overrides=[f"sweeps.plane.axes={axes}", *overrides])
    assert scene.mechanism is not None
    return scene.analyses[MapRequest], scene.mechanism, load_tripteor(overrides).model


def test_a_volume_holds_its_planes_and_is_drawn_in_layers() -> None:
    volume, mechanism, model = request_of(
        '{ X = ["-100 mm", "100 mm", 3], Y = ["0 mm", "90 mm", 2], Z = ["150 mm", "250 mm", 5] }'
    )
    plane, _, _ = request_of(
        '{ X = ["-100 mm", "100 mm", 3], Y = ["0 mm", "90 mm", 2], Z = ["200 mm", "200 mm", 1] }'
    )
    whole, middle = (
        _map_workspace(mechanism, model, volume),
        _map_workspace(mechanism, model, plane),
    )
    assert whole is not None and middle is not None
    for name, values in middle.quantities.items():
        assert np.allclose(whole.quantities[name][:, :, 2], values, rtol=1e-12, atol=0.0)
    layers = map_layers(whole)
    assert [layer.place for layer in layers] == [0, 2, 4] and layers[1].title == "Z = 200 mm"
    assert 'id="map_f1_hz_2"' in str(draw_map(whole, "f1_hz", 2))
    table = _tabulate_map("map", whole)
    assert table.headings[:3] == ("X", "Y", "Z") and len(table.rows) == 30
    assert table.rows[7][3] == whole.quantities["condition_number"][0, 1, 2]


def test_a_mode_is_followed_by_its_shape_where_frequencies_cross() -> None:
    # legs 1 and 2 close together: near the plane of symmetry tilting between them and swinging
    # about their axis change places along x
    near = "mechanism.dimensions.base=['-360 mm', '360 mm', '730 mm']"
    spans = (
        '{ X = ["-300 mm", "300 mm", 31], Y = ["0 mm", "1 mm", 2], Z = ["200 mm", "200 mm", 1] }'
    )
    request, mechanism, model = request_of(spans, near)
    found = _map_workspace(mechanism, model, request)
    assert found is not None and found.crossings == ((1, 2),) and found.tracking_breaks == 0
    first, second = (found.quantities[f"f{number}_hz"] for number in (1, 2))
    assert (second - first).max() > 0.5 and (second - first).min() < -0.5
    # a mode changes smoothly along x; the lower of the two has an edge where they cross
    smooth, edged = (
        np.abs(np.diff(values, 2, axis=0)).max() for values in (first, np.minimum(first, second))
    )
    assert smooth < 0.3 * edged
