"""MPI, which starts when something of it is first used."""

from typing import TYPE_CHECKING

from headstock.geometry.loading import Library

if TYPE_CHECKING:
    from mpi4py import MPI as MPI
else:
    MPI = Library("mpi4py.MPI", annotated=("Comm",))
