"""Jobs dealt out to ranks: each once, the longest first, none too many for the memory, and one
message where one fails.
"""

import errno
import fcntl
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TypedDict

import pytest
from mpi4py import MPI

from common import rank_words, run_process
from headstock.geometry.errors import HeadstockError
from headstock.solvers import shared_work
from headstock.solvers.ranks import Node, SharedFailure
from headstock.solvers.shared_work import Job, share_work

pytestmark = pytest.mark.mpi

PROGRAM = """
import json, sys, time
from pathlib import Path
from mpi4py import MPI
from headstock.solvers import shared_work
from headstock.solvers.ranks import Node, SharedFailure
from headstock.solvers.shared_work import Job, share_work

comm, folder = MPI.COMM_WORLD, Path(sys.argv[1])
seconds, memory_mb, failing, nodes = json.loads(sys.argv[2])
said = []
if nodes > 1:
    ranks = comm.size // nodes
    shared_work.find_node = lambda comm: Node(comm.rank // ranks * ranks, ranks)

def work(number, settle):
    settle()
    begin = time.time()
    time.sleep(0.05 + seconds[number])
    if number in failing:
        raise ValueError(f"job {number}")
    return [number, comm.rank, begin, time.time()]

try:
    results = share_work(
        comm, [Job(length, 60.0) for length in seconds], work, folder=folder, memory_mb=memory_mb,
        idle_mb=20.0, observer=lambda number, result: said.append(number),
    )
    error = ""
except SharedFailure as failure:
    results, error = [], str(failure.__cause__)
if comm.rank == 0:
    print(json.dumps({"results": results, "said": said, "error": error}))
elif results or said:
    raise ValueError("results are for rank 0")
"""


class Shared(TypedDict):
    """What rank 0 knows in the end; of each job its number, its rank, begin and end."""

    results: list[tuple[int, int, float, float]]
    said: list[int]
    error: str


def share_on_ranks(
    ranks: int,
    seconds: list[float],
    memory_mb: float = 1e6,
    failing: tuple[int, ...] = (),
    *,
    nodes: int = 1,
    folder: Path = Path(),
) -> Shared:
    words = [*rank_words(ranks), "-P", "-m", "mpi4py", "-c", PROGRAM, str(folder)]
    request = json.dumps([seconds, memory_mb, failing, nodes])
    done = run_process([*words, request], timeout=120)
    assert done.returncode == 0, done.stderr
    found: Shared = json.loads(done.stdout)
    return found


def test_every_job_is_done_once_and_the_longest_begins_first() -> None:
    found = share_on_ranks(3, [0.0, 0.1, 0.4, 0.0, 0.2])
    assert [row[0] for row in found["results"]] == [0, 1, 2, 3, 4]
    assert sorted(found["said"]) == [0, 1, 2, 3, 4]
    assert len({row[1] for row in found["results"]}) == 3
    assert min(found["results"], key=lambda row: row[2])[0] in (2, 4, 1)
    # a rank that is free takes the next job: nobody else does what the longest one keeps waiting
    assert [row[1] for row in found["results"]].count(found["results"][2][1]) < 4


def test_jobs_that_do_not_fit_into_the_memory_together_follow_each_other() -> None:
    rows = sorted(share_on_ranks(2, [0.1] * 4, memory_mb=100.0)["results"], key=lambda row: row[2])
    assert all(later[2] >= earlier[3] for earlier, later in itertools.pairwise(rows))


def at_once(rows: list[tuple[int, int, float, float]]) -> int:
    """The most jobs that were at work at a time."""
    return max(sum(other[2] <= row[2] < other[3] for other in rows) for row in rows)


@pytest.mark.parametrize(("memory_mb", "together"), [(90.0, 1), (130.0, 2)])
def test_memory_counts_by_node_and_every_rank_of_it_holds_some(
    memory_mb: float, together: int, tmp_path: Path
) -> None:
    # 60 MB per job, of which a rank without one holds 20: 80 MB with one job on two ranks, 120 with two
    rows = share_on_ranks(4, [0.3] * 8, memory_mb, nodes=2, folder=tmp_path)["results"]
    for ranks in ((0, 1), (2, 3)):
        assert at_once([row for row in rows if row[1] in ranks]) == together
    assert at_once(rows) == 2 * together
    assert list(tmp_path.iterdir()) == []


HOLDER = """
import fcntl, sys
with open(sys.argv[1], "r+") as file:
    fcntl.lockf(file, fcntl.LOCK_EX)
    print("held", flush=True)
    sys.stdin.read()
"""


def test_folders_of_killed_jobs_are_removed_and_those_of_living_ones_kept(tmp_path: Path) -> None:
    for name in ("dead", "living", "young"):
        place = tmp_path / f"{shared_work.FOLDER_PREFIX}{name}"
        place.mkdir()
        (place / shared_work.ALIVE_FILE).touch()
        if name != "young":
            os.utime(place, (0.0, 0.0))
    alive = tmp_path / f"{shared_work.FOLDER_PREFIX}living" / shared_work.ALIVE_FILE
    words = [sys.executable, "-c", HOLDER, str(alive)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        shared_work._clear_dead(tmp_path)
        holder.communicate()
    left = {place.name.removeprefix(shared_work.FOLDER_PREFIX) for place in tmp_path.iterdir()}
    assert left == {"living", "young"}


def test_a_folder_without_locks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "lockf", refuse)
    counter = shared_work._Counter(tmp_path, Node(0, 1), [1.0], 1.0)
    with pytest.raises(HeadstockError, match=f"{tmp_path}.*No locks available"):
        counter.join()


def test_the_first_of_the_failures_is_told_and_no_further_job_begins() -> None:
    found = share_on_ranks(2, [0.5, 0.4, 0.0, 0.0], failing=(0, 1))
    assert found["error"] == "job 0"
    assert found["said"] == []


def test_one_rank_does_them_in_their_order_and_raises_its_own_errors(tmp_path: Path) -> None:
    begun: list[int] = []

    def work(number: int, _settle: object) -> int:
        begun.append(number)
        if number == 2:
            raise KeyError(number)
        return number

    with pytest.raises(KeyError):
        share_work(
            MPI.COMM_SELF, [Job(float(n)) for n in range(4)], work, folder=tmp_path, memory_mb=1.0
        )
    assert begun == [0, 1, 2]


def test_a_shared_failure_speaks_with_the_words_of_its_cause() -> None:
    with pytest.raises(SharedFailure, match=r"^no room$"):
        raise SharedFailure from OSError("no room")
    assert not str(SharedFailure())  # on the other ranks
