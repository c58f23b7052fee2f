"""A column of 40 x 100 x 400 mm on structured meshes, clamped at its foot."""

import functools

from mpi4py import MPI

from common import make_box, make_component
from headstock.meshing.component_mesh import CellKind
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from lumped_machines import couple_clamped

SIZE = (0.04, 0.1, 0.4)
COLUMN = make_component({"foot": "rigid", "tip": "average"}, size=SIZE)


@functools.cache
def reduce_column(kind: CellKind, counts: tuple[int, int, int]) -> Superelement:
    mesh = make_box(counts, SIZE, {"foot": "z-", "tip": "z+"}, kind=kind)
    request = ReductionRequest(ModeTarget(count=16))
    return reduce_elastic(COLUMN, mesh, comm=MPI.COMM_SELF, request=request)


def couple_column(kind: CellKind, counts: tuple[int, int, int]) -> CoupledMachine:
    return couple_clamped(COLUMN, reduce_column(kind, counts))
