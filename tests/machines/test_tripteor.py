from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, read_json
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses

SCENE = Path(__file__).resolve().parents[2] / "machines" / "tripteor.toml"
# the first and third measured mode of the paper's figure 12
WANTED = ("static", "modal")
MEASURED = {"config_1": (46.2, 71.3), "config_2": (49.4, 71.3), "config_3": (39.6, 58.4)}


def run(variant: str, folder: Path) -> RunSummary:
    scene = keep_analyses(load_scene(SCENE, variant=variant), WANTED)
    return summarise(run_scene(scene, folder, comm=MPI.COMM_SELF))


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> RunSummary:
    folder = tmp_path_factory.mktemp("tripteor")
    written = run("lumped", folder)
    assert read_json(folder / "summary.json")["modal"] == written["modal"]
    return written


def test_one_parameter_set_meets_the_measured_modes_in_three_configurations(
    summary: RunSummary,
) -> None:
    found = {modes["pose_name"]: modes["frequencies_hz"][:2] for modes in summary["modal"]}
    assert set(found) == set(MEASURED)
    for name, measured in MEASURED.items():
        assert np.allclose(found[name], measured, rtol=0.01, atol=0.0)


def test_the_third_leg_carries_the_first_mode_and_the_others_the_second(
    summary: RunSummary,
) -> None:
    assert len(summary["modal"]) == len(MEASURED)
    for modes in summary["modal"]:
        first, second = modes["energy_share"][:2]
        assert 0.6 < first["leg_3"] < 0.7 and second["leg_1"] + second["leg_2"] > 0.97
        assert sum(first.values()) == approx(1.0)
        assert "swings about the common axis" in modes["mode_names"][0]
        assert "tilts" in modes["mode_names"][1]
        assert sum(modes["kinetic_share"][0].values()) == approx(1.0)


def test_static_stiffness_and_condition_number_are_told_for_each_pose(summary: RunSummary) -> None:
    stiffness = {
        pose: 1e3 / np.diag(np.array(points["tcp"]["compliance_um_per_kN"], dtype=float))
        for pose, points in summary["static_poses"].items()
    }
    assert np.allclose(stiffness["config_1"], [30.3, 30.7, 21.9], atol=0.1)
    assert np.allclose(stiffness["config_3"], [26.3, 24.1, 15.6], atol=0.1)
    budget = summary["static"]["tcp"]["budget"]
    assert [sum(shares.values()) for shares in budget.values()] == approx([1.0] * 3)
    assert all(3.0 < pose["condition_number"] < 5.0 for pose in summary["mechanism"].values())
    assert summary["mechanism"]["config_2"]["coordinates"]["q2"] == approx(0.786, abs=5e-4)


def test_components_on_joints_with_springs_at_the_leg_tips_are_the_lumped_model(
    summary: RunSummary, tmp_path: Path
) -> None:
    found = run("components", tmp_path)
    for ours, lumped in zip(found["modal"], summary["modal"], strict=True):
        assert ours["pose_name"] == lumped["pose_name"]
        assert np.allclose(ours["frequencies_hz"], lumped["frequencies_hz"], rtol=1e-9, atol=0.0)
    for pose, points in summary["static_poses"].items():
        expected = np.array(points["tcp"]["compliance_6x6"])
        coupled = np.array(found["static_poses"][pose]["tcp"]["compliance_6x6"])
        assert np.abs(coupled - expected).max() < 1e-9 * np.abs(expected).max()
        moved, right = (
            np.array(each["displacement"], dtype=float)
            for each in (found["static_poses"][pose]["tcp"], points["tcp"])
        )
        assert np.allclose(moved, right, rtol=1e-8, atol=1e-15)
    assert found["mechanism"] == summary["mechanism"]
    # the tripod is fixed twice over-constrained, as its mobility says
    over = ["2 fixed motion(s)" in warning for warning in found["warnings"]]
    assert over and all(over)
