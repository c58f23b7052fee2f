"""Talk between the ranks of a communicator: sums and maxima of arrays, and values passed from rank
0.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.mpi import MPI

SHARE_TAG, ROWS_TAG = 4711, 4713
COLUMNS = 48  # sent at a time: what sending takes besides the values
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
    """Find the node of this rank; collective. Ranks that share memory are on one node: names
    distinguish neither two containers nor two nodes of a trial.
    """
    together = comm.Split_type(MPI.COMM_TYPE_SHARED)
    node = Node(together.allreduce(comm.rank, op=MPI.MIN), together.size)
    together.Free()
    return node


def sum_over_ranks(comm: MPI.Comm, values: FloatArray) -> FloatArray:
    """Return the entry-wise sum of an array over ranks; collective, one shape everywhere."""
    return values if comm.size == 1 else _reduce(comm, values, MPI.SUM)


def max_over_ranks(comm: MPI.Comm, values: FloatArray) -> FloatArray:
    """Return the entry-wise maximum of an array over the ranks; collective, the same shape
    everywhere.
    """
    return values if comm.size == 1 else _reduce(comm, values, MPI.MAX)


def _reduce(comm: MPI.Comm, values: FloatArray, operation: "MPI.Op") -> FloatArray:
    result = np.array(values, dtype=float, order="C")
    comm.Allreduce(MPI.IN_PLACE, result, op=operation)
    return result


class SharedFailure(Exception):  # noqa: N818 (what failed is its cause)
    """Rank 0 could not make what all ranks wait for, and every rank knows; on rank 0 the cause says
    why, and this error with its words.
    """

    def __str__(self) -> str:
        return "" if self.__cause__ is None else str(self.__cause__)


def make_on_root[T](comm: MPI.Comm, make: Callable[[], T]) -> T:
    """Return what ``make`` returns on rank 0, on every rank; a scene, for example, is read once and
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
    """Return the value rank 0 hands in, on every rank.

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


def rows_from_root(
    comm: MPI.Comm, values: NDArray[Any] | None, wanted: NDArray[np.int64]
) -> NDArray[Any]:
    """Return the rows of an array that rank 0 alone holds; collective.

    Args:
        values: ``(n, ...)`` on rank 0.
        wanted: Which rows this rank is to have.
    """
    if comm.rank or values is None:
        comm.send(wanted, dest=0, tag=ROWS_TAG)
        return comm.recv(source=0, tag=ROWS_TAG)
    for rank in range(1, comm.size):
        comm.send(values[comm.recv(source=rank, tag=ROWS_TAG)], dest=rank, tag=ROWS_TAG)
    return values[wanted]


@dataclass(frozen=True, eq=False)
class RowBlocks:
    """Rows of an array by their numbers: each rank holds an equal share of consecutive ones.

    Attributes:
        comm: Ranks, in the order of the rows.
        rows: ``(n, ...)`` those of this rank.
    """

    comm: MPI.Comm
    total: int
    rows: FloatArray

    def fetch(self, wanted: NDArray[np.int64]) -> FloatArray:
        """Return the rows of any numbers ``(m, ...)``, rising; collective."""
        if self.comm.size == 1:
            return self.rows[wanted]
        ends = _block_ends(self.comm, self.total)
        asked = self.comm.alltoall(np.split(wanted, np.searchsorted(wanted, ends[1:-1])))
        result = np.empty((len(wanted), *self.rows.shape[1:]))
        for columns in _column_slices(self.rows):
            sent = [self.rows[numbers - ends[self.comm.rank], ..., columns] for numbers in asked]
            result[..., columns] = np.concatenate(self.comm.alltoall(sent))
        return result

    def gather(self) -> FloatArray | None:
        """Return all rows ``(total, ...)`` on rank 0, one rank after another; collective."""
        if self.comm.rank:
            for columns in _column_slices(self.rows):
                self.comm.send(self.rows[..., columns], dest=0, tag=ROWS_TAG)
            return None
        if self.comm.size == 1:
            return self.rows
        ends = _block_ends(self.comm, self.total)
        result = np.empty((self.total, *self.rows.shape[1:]))
        result[: ends[1]] = self.rows
        for rank in range(1, self.comm.size):
            for columns in _column_slices(self.rows):
                result[ends[rank] : ends[rank + 1], ..., columns] = self.comm.recv(
                    source=rank, tag=ROWS_TAG
                )
        return result


def order_rows(
    comm: MPI.Comm, numbers: NDArray[np.int64], values: FloatArray, total: int
) -> RowBlocks:
    """Return the rows that lie scattered over the ranks, in the order of their numbers; collective.

    Args:
        numbers: ``(n,)`` of the rows of this rank; each occurs on one rank only.
        values: ``(n, ...)`` these rows.
        total: Number of rows on all ranks.
    """
    ends = _block_ends(comm, total)
    if comm.size == 1:
        rows = np.empty(values.shape)
        rows[numbers] = values
        return RowBlocks(comm, total, rows)
    order = np.argsort(numbers)
    parts = np.split(order, np.searchsorted(numbers[order], ends[1:-1]))
    places = np.concatenate(comm.alltoall([numbers[part] for part in parts])) - ends[comm.rank]
    rows = np.empty((ends[comm.rank + 1] - ends[comm.rank], *values.shape[1:]))
    for columns in _column_slices(values):
        rows[places, ..., columns] = np.concatenate(
            comm.alltoall([values[part, ..., columns] for part in parts])
        )
    return RowBlocks(comm, total, rows)


def _block_ends(comm: MPI.Comm, total: int) -> NDArray[np.int64]:
    return total * np.arange(comm.size + 1, dtype=np.int64) // comm.size


def _column_slices(values: FloatArray) -> list[slice]:
    count = values.shape[-1]
    return [slice(first, first + COLUMNS) for first in range(0, count, COLUMNS)]
