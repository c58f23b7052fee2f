"""Sums and maxima of arrays over the ranks of a communicator."""

import numpy as np
from mpi4py import MPI

from headstock.geometry.frames import FloatArray


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
