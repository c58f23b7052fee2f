"""What following the pose along a path is worth agrees with what one run says of both."""

from pathlib import Path

import pytest
from mpi4py import MPI

from common import approx
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.studies.model_worth import try_models

pytestmark = pytest.mark.fem

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
    path = tmp_path / "slide.toml"
    path.write_text((DATA / "slide.toml").read_text() + MOVE.replace("WRITTEN", written))
    choice = SceneChoice(path, None, (), ("path",))
    (found,) = try_models(choice, Store(tmp_path / "trials"), kinds=["pose"])
    assert not found.obstacle
    assert (found.trial.written, found.trial.tried, found.trial.sense) == (written, tried, sense)
    results = run_scene(
        load_scene(path, overrides=[FOLLOWED]),
        tmp_path / "results",
        comm=MPI.COMM_SELF,
        store=Store(tmp_path / "store"),
    )
    (answer,) = find_answers(results.answers, PathResult)
    (run,) = answer.runs
    peaks = {
        name: [1e6 * size for zones in figures for zone in zones for size in (zone.peak, zone.span)]
        for name, figures in (("pose_dependent", run.figures), ("frozen", run.frozen_figures))
    }
    (change,) = [each for each in found.changes if each.label == "path deviation"]
    assert any(1e6 * (change.present or 0.0) == approx(peak, rel=1e-3) for peak in peaks[written])
    assert any(1e6 * (change.without or 0.0) == approx(peak, rel=1e-3) for peak in peaks[tried])
    assert 0.01 < found.worth < 1.0 and change.key["output"] != "tcp y"  # zero by symmetry
