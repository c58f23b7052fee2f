"""The Sturm count of a reduction, and that a lost mode is found out."""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
    ReductionSettings,
)
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.components.boundary_basis import build_boundary_basis
from headstock.reduction.components.constraint_modes import find_dofs
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.fixed_interface_modes import (
    find_fixed_interface_modes,
    verify_mode_count,
)
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.elasticity import assemble_elasticity
from headstock.solvers.errors import AccuracyError

STEEL = Material("steel", 210e9, 0.3, 7850.0)


def _column() -> tuple[Component, ComponentMesh]:
    component = Component(
        "column",
        Box((0.05, 0.05, 0.5)),
        STEEL,
        interfaces={
            "foot": Interface("foot", (Patch("z-"),)),
            "tip": Interface("tip", (Patch("z+"),), "average"),
        },
        mesh=MeshSettings(size=0.025, cells="hex"),
        reduction=ReductionSettings(modes=7, verify=True),
    )
    return component, mesh_component(component)


def test_a_reduction_with_verify_counts_its_modes() -> None:
    component, mesh = _column()
    element = reduce_elastic(component, mesh, comm=MPI.COMM_SELF)
    assert element.modal_count >= 7


def test_a_lost_repeated_mode_is_found_by_the_count() -> None:
    component, mesh = _column()
    operators = assemble_elasticity(mesh, STEEL, comm=MPI.COMM_SELF, with_mass=True)
    fixed = find_dofs(operators, build_boundary_basis(component, mesh, ()).fixed)
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        modes = find_fixed_interface_modes(solver, ModeTarget(count=6))
        verify_mode_count(solver, modes)
        lost = dataclasses.replace(modes, eigenvalues=np.delete(modes.eigenvalues, 1))
        with pytest.raises(AccuracyError, match="Sturm count"):
            verify_mode_count(solver, lost)
