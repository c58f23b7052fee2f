"""Talk between the ranks of a communicator: sums and maxima of arrays, and values passed from rank
0.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray

SHARE_TAG = 4711
POLL_SECONDS = 0.002


@dataclass(frozen=True)
class Node:
    """Where this rank is.

    Attributes:
        number: Of its node: the lowest rank there.
        ranks: How many ranks that node has.
    """

    number: int
    ranks: int


def find_node(comm: MPI.Comm) -> Node:
    """The node of this rank; collective. Ranks that share memory are on one node: names tell no two
    containers apart, nor two nodes of a trial.
    """
    together = comm.Split_type(MPI.COMM_TYPE_SHARED)
    node = Node(together.allreduce(comm.rank, op=MPI.MIN), together.size)
    together.Free()
    return node


def sum_over_ranks(comm: MPI.Comm, values: FloatArray) -> FloatArray:
    """Entry-wise sum of an array over the ranks; collective, the same shape everywhere."""
    if comm.size == 1:
        return values
    result = np.array(values, dtype=float, order="C")
    comm.Allreduce(MPI.IN_PLACE, result, op=MPI.SUM)
    return result


def max_over_ranks(comm: MPI.Comm, values: FloatArray) -> FloatArray:
    """Entry-wise maximum of an array over the ranks; collective, the same shape everywhere."""
    if comm.size == 1:
        return values
    result = np.array(values, dtype=float, order="C")
    comm.Allreduce(MPI.IN_PLACE, result, op=MPI.MAX)
    return result


class SharedFailure(Exception):  # noqa: N818 (what failed is its cause)
    """Rank 0 could not make what all ranks wait for, and every rank knows; on rank 0 the cause says
    why.
    """


def make_on_root[T](comm: MPI.Comm, make: Callable[[], T]) -> T:
    """What ``make`` returns on rank 0, on every rank; a scene, for example, is read once and
    shared.

    Raises:
        SharedFailure: ``make`` failed, on every rank of several; a single rank gets the error
            itself.
    """
    if comm.size == 1:
        return make()
    made: tuple[T] | None = None
    failure: Exception | None = None
    if comm.rank == 0:
        try:
            made = (make(),)
        except Exception as error:
            failure = error
    made = share_from_root(comm, made)
    if made is None:
        raise SharedFailure from failure
    return made[0]


def share_from_root[T](comm: MPI.Comm, value: T | None) -> T:
    """The value rank 0 hands in, on every rank.

    The others sleep while they wait: a broadcast would spin, and take the cores from the mesher and
    BLAS on rank 0.
    """
    if comm.rank == 0:
        for rank in range(1, comm.size):
            comm.send(value, dest=rank, tag=SHARE_TAG)
        return value  # type: ignore[return-value]
    while not comm.iprobe(source=0, tag=SHARE_TAG):
        time.sleep(POLL_SECONDS)
    shared: T = comm.recv(source=0, tag=SHARE_TAG)
    return shared
