"""a sweep over 1000 poses in which modes cross: curves keep their mode, and a pose that lacks
one result is seen.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import Shell
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray
from headstock.scene.building.loader import load_scene
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.linear.modal_analysis import ModalResult, solve_lowest_modes
from headstock.solvers.second_order import SecondOrderSystem
from headstock.studies.sweeps import poses
from headstock.studies.sweeps.results import SweepResults
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses

pytestmark = pytest.mark.hard("H40")

SCENE = stored_scene("crossing_modes")
MASS, LATERAL = 20.0, 60e6


@pytest.fixture
def slide(shell: Shell) -> Shell:
    shell.write(SCENE)
    return shell


def run(path: Path, name: str) -> SweepResults:
    scene = load_scene(path)
    job = SweepJob(select_analyses(scene), scene.sweeps[name], path.parent)
    outcome = run_sweep(job, comm=MPI.COMM_SELF)
    return gather_sweep(job, outcome)


def screw_frequency(places: FloatArray) -> FloatArray:
    """Of the slide on nut, shaft and bearing in series; the bearing is at -450 mm."""
    area = 0.25 * np.pi * 0.016**2
    compliance = 1.0 / 200e6 + 1.0 / 300e6 + (places + 0.45) / (210e9 * area)
    return np.asarray(np.sqrt(1.0 / compliance / MASS) / (2.0 * np.pi))


@pytest.mark.trials
def test_over_1000_poses_each_curve_is_one_closed_form_from_end_to_end(slide: Shell) -> None:
    results = run(slide.folder / "scene.toml", "travel")
    places = results.sweep.positions[:, 0]
    along = screw_frequency(places)
    across = np.full(len(places), np.sqrt(LATERAL / MASS) / (2.0 * np.pi))
    assert (along[0] > across[0]) and (along[-1] < across[-1])
    found = results.frequencies_hz
    assert found.shape == (1000, 2)
    for curve in (along, across):
        assert np.abs(found / curve[:, None] - 1.0).max(axis=0).min() < 1e-9
    assert results.tracked is not None
    assert results.tracked.crossings == {(0, 1): 1}
    assert results.tracked.tracking_breaks == 0
    swaps = np.flatnonzero(np.diff(np.sign(found[:, 0] - found[:, 1])))
    crossing = places[np.argmin(np.abs(along - across))]
    assert len(swaps) == 1
    assert abs(places[swaps[0]] - crossing) < 2.0 * (places[1] - places[0])


def test_a_pose_that_lacks_one_result_fails_the_sweep_by_name(
    slide: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []

    def fail_in_the_third(
        system: SecondOrderSystem, *, count: int | None = None, up_to_hz: float | None = None
    ) -> ModalResult:
        calls.append(1)
        if len(calls) == 3:
            raise ConvergenceError("LAPACK gave up")
        return solve_lowest_modes(system, count=count, up_to_hz=up_to_hz)

    with monkeypatch.context() as patch:
        patch.setattr(poses, "solve_lowest_modes", fail_in_the_third)
        said = slide("sweep scene.toml few -o out", code=1).out
    assert "failed: pose X 0 mm: modal analysis: LAPACK gave up" in said
    assert "failed in" in said
    slide("sweep scene.toml few -o out", code=1)
    assert "failed" not in slide("sweep scene.toml few -o out --retry").out


def test_a_carriage_that_would_leave_its_rail_is_refused_before_anything_is_computed(
    slide: Shell,
) -> None:
    longer = 'sweeps.few.axes={ X = ["-400 mm", "420 mm", 5] }'
    said = slide("sweep scene.toml few -o out --set", longer, code=2).err
    assert "joint carriage (80 mm long) hangs 10 mm over the end of rail bed.rail" in said
    assert "out" not in slide.files()
