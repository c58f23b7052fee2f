"""Passing a value from rank 0 to ranks that have nothing to do meanwhile."""

import time

from mpi4py import MPI

SHARE_TAG = 4711
POLL_SECONDS = 0.002


def share_from_root[T](comm: MPI.Comm, value: T | None) -> T:
    """The value rank 0 hands in, on every rank.

    The others sleep while they wait: a broadcast would spin, and take the cores from the mesher and BLAS on rank 0.
    """
    if comm.rank == 0:
        for rank in range(1, comm.size):
            comm.send(value, dest=rank, tag=SHARE_TAG)
        return value  # type: ignore[return-value]
    while not comm.iprobe(source=0, tag=SHARE_TAG):
        time.sleep(POLL_SECONDS)
    shared: T = comm.recv(source=0, tag=SHARE_TAG)
    return shared
