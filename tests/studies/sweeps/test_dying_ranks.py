"""a rank that dies or raises in the middle of a sweep ends the job soon; no half file, and no
finished pose is lost.
"""

import os
import subprocess
import time
from pathlib import Path

import pytest

from common import rank_words, run_alone, run_process
from headstock.scene.building.loader import load_scene
from headstock.studies.sweeps.files import SWEEP_FILE
from headstock.studies.sweeps.journals import FOLDER

pytestmark = pytest.mark.hard("H42")

SCENE = Path(__file__).parents[2] / "data" / "slide.toml"
PROGRAM = """
import os, signal, sys, time
from mpi4py import MPI
from headstock.app.command_line import main
from headstock.studies.sweeps import runs

whole, calls = runs.solve_machine_pose, []

def fail_on_one_rank(*arguments, **options):
    calls.append(1)
    if MPI.COMM_WORLD.rank == 1 and len(calls) == 3:
        {fault}
    return whole(*arguments, **options)

runs.solve_machine_pose = fail_on_one_rank
sys.exit(main(sys.argv[1:]))
"""
FAULTS = {
    "dies": "os.kill(os.getpid(), signal.SIGKILL)",
    "raises": 'raise RuntimeError("the cosmic ray hit")',
}


def sweep_words(folder: Path) -> list[str]:
    return ["sweep", str(SCENE), "line", "-o", str(folder / "out")]


def sweep_on_two_ranks(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    variables = {**os.environ, "HEADSTOCK_STORE": str(folder / "store"), "OMP_NUM_THREADS": "1"}
    command = [*rank_words(2), "-P", "-c", program]
    return run_process([*command, *sweep_words(folder)], env=variables, timeout=60)


@pytest.mark.parametrize(
    "fault", [pytest.param("raises", marks=pytest.mark.trials), *sorted({*FAULTS} - {"raises"})]
)
def test_a_rank_that_fails_ends_the_job_without_a_half_file_and_keeps_finished_poses(
    tmp_path: Path, fault: str
) -> None:
    start = time.monotonic()
    ended = sweep_on_two_ranks(tmp_path, PROGRAM.format(fault=FAULTS[fault]))
    assert time.monotonic() - start < 60.0
    assert ended.returncode != 0
    if fault == "raises":
        assert "rank 1" in ended.stderr and "cosmic ray" in ended.stderr
    out = tmp_path / "out"
    assert [path.name for path in out.iterdir()] == [FOLDER]
    again = run_alone(tmp_path, *sweep_words(tmp_path))
    assert again.returncode == 0, again.stderr
    assert (out / SWEEP_FILE).is_file()
    total = len(load_scene(SCENE).sweeps["line"].positions)
    computed = int(again.stdout.rpartition(" s, ")[2].split()[0])
    # rank 1 had finished two of its poses when it failed
    assert computed <= total - 2
