"""A real Slurm, disturbed, as root: ``./headstock test -m faults tests/faults/test_slurm.py``; the
launcher enters a root that has one.
"""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from faults.slurm import disturb_slurm
from faults.slurm_daemons import DAEMONS

pytestmark = pytest.mark.workers


@pytest.mark.faults
@pytest.mark.skipif(
    os.geteuid() != 0 or None in map(shutil.which, DAEMONS),
    reason="no Slurm here, or not root: name this file to the launcher",
)
def test_a_sweep_on_a_disturbed_slurm_leaves_the_file_of_a_local_one(
    pytestconfig: pytest.Config,
) -> None:
    trials, seed = pytestconfig.getoption("--trials") or 4, pytestconfig.getoption("--seed")
    # munged wants every folder above its socket open to all, which those of tmp_path are not
    with tempfile.TemporaryDirectory() as folder:
        outcome = disturb_slurm(trials, seed=seed, root=Path(folder))
    print(outcome)
    assert outcome.faults == []
