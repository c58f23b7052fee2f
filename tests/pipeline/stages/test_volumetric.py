"""The volumetric analysis of a scene of rigid axes: maps, measures, files and report."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from summary_shapes import list_strangers

from cases import cases
from common import approx
from headstock.app.report.report import render_report
from headstock.app.views.registry import list_tables
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.numbers.folders import RESULTS_FILE, read_run_numbers
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.pipeline.runner import run_scene
from headstock.reduction.motions.tool_deviation import solve_deviation
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import keep_analyses
from headstock.studies.kind_changes import compare_kinds
from scene_runs import couple_parts

SCENE = Path(__file__).parents[2] / "data" / "three_rigid_axes.toml"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunSummary, Path]:
    folder = tmp_path_factory.mktemp("volumetric")
    scene = keep_analyses(load_scene(SCENE), ("volumetric",))
    return summarise(run_scene(scene, folder, comm=MPI.COMM_SELF)), folder


def test_the_map_holds_the_deviation_of_each_pose(run: tuple[RunSummary, Path]) -> None:
    summary, folder = run
    assert list(list_strangers(summary)) == []
    machine = load_scene(SCENE).machine
    pose = Pose("", {"X": -0.125, "Y": 0.15, "Z": -0.15})
    gravity = np.array([0.0, 0.0, -9.80665])
    found = solve_deviation(couple_parts(machine, pose, gravity=gravity), machine, "tcp")
    with h5py.File(folder / RESULTS_FILE) as file:
        group = file["volumetric/tcp"]
        for source, moved in found.sources.items():
            stored = group[source.replace(" ", "_")][1, 3, 0]
            assert stored == approx(moved, rel=1e-9, abs=1e-15)
    shown = summary["volumetric"]["tcp"]
    assert shown["largest_at"] == pose.positions
    assert shown["largest_um"] == approx(1e6 * np.linalg.norm(found.total[:3]), rel=1e-9)
    assert shown["failed"] == 0


def test_shares_of_the_parts_add_up(run: tuple[RunSummary, Path]) -> None:
    budget = run[0]["volumetric"]["tcp"]["budget"]
    assert set(budget) == {"x", "y", "z"}
    for shares in budget.values():
        assert sum(shares.values()) == approx(1.0, rel=1e-9)
        assert {"errors of X", "gravity on x_drive", "static forces on z_guide_1"} <= set(shares)


def test_squareness_alone_is_measured_as_it_is_written(tmp_path: Path) -> None:
    square = {"X": "{ EB0 = '0 urad', EX = { polynomial = ['0 um'] } }",
              "Y": "{ EC0 = '20 urad', EA0 = '-15 urad' }",
              "Z": "{ EB0 = '18 urad' }"}  # fmt: skip
    changes = [f"axes.{axis}.errors={table}" for axis, table in square.items()]
    changes += ["effects.gravity=false", "loads={}"]
    scene = keep_analyses(load_scene(SCENE, overrides=changes), ("volumetric",))
    found = summarise(run_scene(scene, tmp_path, comm=MPI.COMM_SELF))["volumetric"]["tcp"]
    angles = {each["symbol"]: each["angle_urad"] for each in found["squareness"]}
    # Z to Y: Z is straight, Y turned by -15 urad about x
    assert angles == approx({"EC0Y": 20.0, "EB0Z": 18.0, "EA0Z": 15.0}, rel=1e-6)
    assert found["lines"]["X"]["along"] == "-x" and found["lines"]["Z"]["along"] == "z"
    assert max(found["lines"]["Y"]["deviations"].values()) < 1e-6


def test_effects_tell_what_errors_of_guides_move(
    run: tuple[RunSummary, Path], tmp_path: Path
) -> None:
    ideal = load_scene(SCENE, overrides=["effects.guide_errors=false"])
    results = run_scene(keep_analyses(ideal, ("volumetric",)), tmp_path, comm=MPI.COMM_SELF)
    present = read_run_numbers(run[1])
    changes = {
        change.label: change for change in compare_kinds(results.numbers.values(), present.values())
    }
    assert changes["volumetric error"].share > 0.9
    assert str(changes["volumetric error"].key).startswith(
        "volumetric_range(point=tcp,source=total,"
    )


def test_tables_and_report_show_it(run: tuple[RunSummary, Path]) -> None:
    results = open_results(run[1])
    tables = {table.name: table for table in list_tables(results)}
    assert len(tables["volumetric_tcp"].rows) == 60
    assert len(tables["error_motions_tcp"].rows) == 3
    page = render_report(results)
    for text in ("Volumetric errors", "EC0Y", "The volume as the tool travels it", "errors of X"):
        assert text in page


@cases
def test_what_is_wrong_is_said(change: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load_scene(SCENE, overrides=[change])
