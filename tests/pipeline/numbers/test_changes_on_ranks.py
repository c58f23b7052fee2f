"""Changes are prepared by all ranks together: a body that fails on rank 0 alone leaves the others."""

from pathlib import Path

from common import run_on_ranks

PROGRAM = """
import functools

from mpi4py import MPI

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.numbers.changes import Change, try_changes
from headstock.pipeline.numbers.estimates import MODEL
from headstock.pipeline.numbers.numbers import Number, make_key
from headstock.solvers.ranks import SharedFailure, make_on_root

COMM = MPI.COMM_WORLD
KEY = make_key("frequency", pose="reference", mode=1)


def reduce(hertz: float, *, body: str) -> float:
    def soften() -> float:
        if body == "bed":
            raise HeadstockError("no mesh")
        return hertz - {"column": 2.0, "table": 1.0}[body]

    return make_on_root(COMM, soften)

bodies = ("column", "bed", "table")
changes = [Change((body, MODEL), functools.partial(reduce, body=body)) for body in bodies]
for tried in try_changes(
    50.0,
    changes,
    lambda hertz: [Number(KEY, hertz, "Hz")],
    refused=(HeadstockError, SharedFailure),
    is_root=COMM.rank == 0,
):
    outcome = tried.outcome
    text = outcome if isinstance(outcome, str) else "".join(str(n.value) for n in outcome)
    print(f"{COMM.rank} {tried.owner[0]}: {text}", flush=True)
"""


def test_on_two_ranks_one_body_that_fails_leaves_the_others(tmp_path: Path) -> None:
    done = run_on_ranks(2, tmp_path, "-c", PROGRAM)
    assert sorted(done.stdout.splitlines()) == [
        "0 bed: no mesh",
        "0 column: 48.0",
        "0 table: 49.0",
        "1 bed: ",
        "1 column: ",
        "1 table: ",
    ], done.stderr[-2000:]
