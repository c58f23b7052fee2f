"""The Tripteor with elastic legs; legs as segments here, as finite elements in ``headstock validate
tripteor``.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.runner import run_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mechanisms.modes import linearise_poses, solve_lumped_modes
from headstock.validation.mechanisms import tripteor_machine
from headstock.validation.mechanisms.tripod_beams import solve_tripod
from headstock.validation.mechanisms.tripteor_cases import check_compliances
from headstock.validation.mechanisms.tripteor_machine import (
    SCENE,
    LeggedTripteor,
    load_legs,
    load_tripteor,
    solve_beams,
)

MEASURED = {
    "config_1": (46.2, 55.3, 71.3, 96.6),
    "config_2": (49.4, 50.2, 71.3, 88.8),
    "config_3": (39.6, 51.6, 58.4, 92.0),
}


@pytest.fixture(scope="module")
def elastic() -> LeggedTripteor:
    return load_legs("elastic_legs+segmented")


def frequencies(tripteor: LeggedTripteor, pose: str, count: int = 6) -> FloatArray:
    return solve_modal(tripteor.couple(pose).system, count=count).frequencies_hz


@pytest.mark.parametrize("pose", MEASURED)
def test_the_first_four_modes_with_elastic_legs_are_the_measured_ones_within_a_tenth(
    elastic: LeggedTripteor, pose: str
) -> None:
    found = frequencies(elastic, pose)
    assert np.abs(found[:4] / MEASURED[pose] - 1.0).max() < 0.08
    assert 48.0 < found[1] < 58.0 and 85.0 < found[3] < 100.0 and found[4] > MEASURED[pose][3]


@pytest.mark.parametrize("pose", MEASURED)
def test_beam_elements_in_a_model_of_their_own_give_the_same_frequencies(
    elastic: LeggedTripteor, pose: str
) -> None:
    assert np.allclose(
        frequencies(elastic, pose), solve_beams(elastic, pose, 6), rtol=3e-4, atol=0.0
    )


def test_legs_and_joints_ten_thousand_times_as_stiff_leave_the_lumped_model() -> None:
    stiff, lumped = load_legs("stiff_legs+segmented"), load_tripteor()
    stiffer = load_legs("stiff_legs+segmented", ('materials.leg_steel.E="21000000 GPa"',))
    assert set(lumped.poses) == set(MEASURED)
    for pose, state in lumped.poses.items():
        right = solve_lumped_modes(linearise_poses(lumped.model, state)).frequencies_hz
        off = np.abs(frequencies(stiff, pose) / right - 1.0)
        assert off[:3].max() < 3e-4 and off.max() < 2e-3
        # what is left is the bending of the legs: a tenth of it with ten times the modulus
        assert 0.08 < np.abs(frequencies(stiffer, pose) / right - 1.0)[3] / off[3] < 0.12


def test_a_softer_second_road_is_seen(
    elastic: LeggedTripteor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        tripteor_machine,
        "solve_tripod",
        lambda *parts, frame_stiffness, count: solve_tripod(
            *parts, frame_stiffness=0.99 * frame_stiffness, count=count
        ),
    )
    assert not np.allclose(
        frequencies(elastic, "config_1"), solve_beams(elastic, "config_1", 6), rtol=3e-4, atol=0.0
    )


@pytest.mark.trials
def test_legs_alone_do_not_do_and_a_frame_that_sways_does() -> None:
    rms = {row.quantity.partition(":")[0]: row.value for row in check_compliances(MPI.COMM_SELF)}
    assert rms["elastic legs alone"] > 0.15 and rms["and sway of the frame along x"] < 0.06
    assert min(rms.values()) == rms["and sway of the frame along x, leg 3 of its own"] < 0.035


def test_a_run_names_the_pose_and_damps_legs_that_end_in_nodes_without_mass(tmp_path: Path) -> None:
    settings = [
        'analyses.modal.poses=["config_2"]',
        'analyses.static.poses=["config_2"]',
        *(f"components.beam_{i}.segments.count=6" for i in (1, 2, 3)),
    ]
    scene = keep_analyses(
        load_scene(SCENE, variant="elastic_legs+segmented", overrides=settings), ("static", "modal")
    )
    summary = summarise(run_scene(scene, tmp_path, comm=MPI.COMM_SELF))
    (modes,) = summary["modal"]
    assert modes["pose_name"] == "config_2" and np.allclose(
        np.array(modes["damping_ratio"], dtype=float), 0.02, rtol=1e-6, atol=0.0
    )
    assert "bend" in modes["mode_names"][0] and "columns" in modes["mode_names"][1]
    assert all(sum(shares.values()) == approx(1.0) for shares in modes["energy_share"])
    stiffness = 1e3 / np.diag(
        np.array(summary["static"]["tcp"]["compliance_um_per_kN"], dtype=float)
    )
    assert (stiffness > 10.0).all() and (stiffness < 80.0).all()
