"""Faults on purpose, often: ``./headstock test -m faults [--trials N] [--seed N]``; short versions
are among the hard cases (H44 to H48).
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from faults.disk import fill_disks
from faults.file_fuzz import run_file_fuzz
from faults.kill import kill_runs
from faults.resume import kill_and_resume
from faults.runs import Outcome
from faults.scene_fuzz import run_scene_fuzz

pytestmark = pytest.mark.workers


@pytest.mark.faults
@pytest.mark.parametrize(
    ("inject", "usual_trials"),
    [
        pytest.param(kill_runs, 200, id="kill"),
        pytest.param(kill_and_resume, 60, id="resume"),
        pytest.param(fill_disks, 20, id="disk"),
        pytest.param(run_scene_fuzz, 100_000, id="scenes"),
        pytest.param(run_file_fuzz, 500, id="files"),
    ],
)
def test_nothing_is_torn_wrong_or_left_behind(
    inject: Callable[..., Outcome], usual_trials: int, pytestconfig: pytest.Config, tmp_path: Path
) -> None:
    trials, seed = (
        pytestconfig.getoption("--trials") or usual_trials,
        pytestconfig.getoption("--seed"),
    )
    outcome = inject(trials, seed=seed, root=tmp_path)
    print(outcome)  # -rA shows it
    assert outcome.faults == []
