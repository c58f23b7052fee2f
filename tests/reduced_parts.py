"""Meshed components reduced on this process."""

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

from headstock.geometry.machine.machine import Probe
from headstock.geometry.parts.components import Component, Load, Support
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget


def reduce_mesh(
    component: Component,
    mesh: ComponentMesh,
    supports: Sequence[Support] = (),
    loads: Sequence[Load] = (),
    *,
    modes: int | None = None,
    probes: Sequence[Probe] = (),
    **settings: Any,
) -> Superelement:
    """With so many fixed-interface modes, or none and without mass; settings are those of a
    `ReductionRequest`.
    """
    target = None if modes is None else ModeTarget(count=modes)
    request = ReductionRequest(target, **settings)
    return reduce_elastic(
        component, mesh, supports, loads, comm=MPI.COMM_SELF, request=request, probes=probes
    )
