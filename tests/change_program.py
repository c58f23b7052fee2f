"""Tries a change of each of three bodies, of which one fails on rank 0 alone; run by
``test_changes.py`` under mpirun.
"""

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
    """Return the frequency with a body softened by its share; collective."""

    def soften() -> float:
        if body == "bed":
            raise HeadstockError("no mesh")
        return hertz - {"column": 2.0, "table": 1.0}[body]

    return make_on_root(COMM, soften)


def main() -> None:
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


if __name__ == "__main__":
    main()
