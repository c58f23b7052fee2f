"""Components meshed and reduced the way a scene does it, for the cases that need a superelement or its parts."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Load, Support
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.rank_messages import share_from_root

Compliance = dict[tuple[str, str], FloatArray]


def shared_mesh(
    component: Component, supports: Sequence[Support] = (), loads: Sequence[Load] = (), *, comm: MPI.Comm
) -> ComponentMesh:
    """The mesh of a component on every rank, made by rank 0.

    Raises:
        HeadstockError: Meshing failed; raised on every rank.
    """
    made: tuple[ComponentMesh | None, HeadstockError | None] = (None, None)
    if comm.rank == 0:
        try:
            made = (mesh_component(component, supports, loads), None)
        except HeadstockError as error:
            made = (None, error)
    mesh, failure = share_from_root(comm, made)
    if mesh is None:
        raise failure or HeadstockError(f"component {component.name!r} has no mesh")
    return mesh


def interface_compliance(component: Component, mesh: ComponentMesh, supports: Sequence[Support], *, comm: MPI.Comm) -> Compliance:
    """Compliances of the interfaces of a supported component by its static superelement.

    Returns:
        For each pair of interface names the motion ``(6, 6)`` of the first under unit forces and moments on the second.
    """
    element = reduce_elastic(component, mesh, supports, comm=comm, request=ReductionRequest(recovery=False))
    whole: FloatArray = np.asarray(np.linalg.inv(element.stiffness), dtype=float)
    rows = {name: slice(6 * place.node, 6 * place.node + 6) for name, place in element.attachments.items()}
    return {(moved, loaded): whole[rows[moved], rows[loaded]] for moved in rows for loaded in rows}
