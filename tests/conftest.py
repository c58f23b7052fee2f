"""Small structured meshes with tagged patches that tests of the elastic side share."""

import dataclasses
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
from _pytest.python_api import ApproxScalar
from mpi4py import MPI

from headstock.geometry.frames import rigid_map
from headstock.geometry.parts.components import Component, Interface, Material, Patch, ReductionSettings
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.surface import extract_surface
from headstock.solvers.elastic.elasticity import assemble_elasticity
from headstock.validation.parts.structured_meshes import integrate_over_cells, lattice_mesh, straight_lattice

# pytest.approx means 1e-12 besides any relative tolerance, within which compliances of 1e-9 m/N and moments of mass are all alike;
# without it an expected zero needs an abs of its own
ApproxScalar.DEFAULT_ABSOLUTE_TOLERANCE = 0.0

STEEL = Material("steel", 2.1e11, 0.3, 7850.0)


def tag_patches(mesh: ComponentMesh, groups: dict) -> ComponentMesh:
    """Patch groups of a mesh: a side such as ``z+``, or a function from facet centres ``(n, 3)`` to the facets wanted."""
    surface = extract_surface(mesh.cells, mesh.kind)
    centers = mesh.points[surface.facets[:, : surface.corners]].mean(axis=1)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)

    def facets(group):
        if callable(group):
            return surface.facets[group(centers)]
        axis = "xyz".index(group[0])
        level = low[axis] if group[1] == "-" else high[axis]
        return surface.facets[np.abs(centers[:, axis] - level) < 1e-9 * (high - low).max()]

    return dataclasses.replace(mesh, patches={name: facets(group) for name, group in groups.items()})


def tagged_box(counts, size, groups=None, *, kind="hex27", warp: Callable | None = None, straight=True) -> ComponentMesh:
    """A structured box from the origin, perhaps warped, with patch groups chosen before the warp."""
    mesh = tag_patches(lattice_mesh(straight_lattice(counts, size), kind, straight=straight), groups or {})
    if warp is None:
        return mesh
    points = warp(mesh.points)
    volume = float(integrate_over_cells(points, mesh.cells, kind, lambda x: np.ones(len(x))))
    return dataclasses.replace(mesh, points=points, quality=dataclasses.replace(mesh.quality, volume=volume))


def elastic_component(interfaces=None, *, modes=0, material=STEEL, name="body", size=(1.0, 1.0, 1.0)) -> Component:
    """A component for a structured mesh; interfaces map names to ``rigid`` or ``average``, with ``!`` behind it where forced."""
    made = {
        label: Interface(label, (Patch("z+"),), coupling.removesuffix("!"), coupling.endswith("!"))
        for label, coupling in (interfaces or {}).items()
    }
    return Component(name, Box(size), material, interfaces=made, reduction=ReductionSettings(modes=modes))


@pytest.fixture(scope="session")
def make_box():
    return tagged_box


@pytest.fixture(scope="session")
def make_component():
    return elastic_component


@pytest.fixture(scope="session")
def tag():
    return tag_patches


def dense_pencil(mesh: ComponentMesh, material: Material):
    """Stiffness and mass ``(3 n, 3 n)`` in the order of the mesh points, for roads that share no solver with the code under test."""
    operators = assemble_elasticity(mesh, material, comm=MPI.COMM_SELF, with_mass=True)
    order = np.argsort(operators.nodes)
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    mass = np.kron(operators.scalar_mass.toarray(), np.eye(3))
    return operators.stiffness.toarray()[np.ix_(dofs, dofs)], mass[np.ix_(dofs, dofs)]


def rigid_patch_map(mesh: ComponentMesh, groups):
    """Displacements of all mesh points from 6 dofs at each rigid patch's nodal mean, then the dofs of the points outside.

    Returns the matrix ``(3 n, 6 p + n_i)`` and the reference points ``(p, 3)``.
    """
    patches = [np.unique(mesh.patches[name]) for name in groups]
    inside = np.unique(np.concatenate(patches)) if patches else np.zeros(0, dtype=int)
    outside = np.setdiff1d(np.arange(len(mesh.points)), inside)
    boundary, origins = np.zeros((3 * len(mesh.points), 6 * len(patches))), []
    for number, nodes in enumerate(patches):
        origin = 0.5 * (mesh.points[nodes].min(axis=0) + mesh.points[nodes].max(axis=0))
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        boundary[dofs, 6 * number : 6 * number + 6] = rigid_map(mesh.points[nodes], origin)
        origins.append(origin)
    interior = (3 * outside[:, None] + np.arange(3)).ravel()
    return np.hstack([boundary, np.eye(3 * len(mesh.points))[:, interior]]), np.array(origins)


def frequencies_of(stiffness, mass):
    """All natural frequencies [Hz] of a dense pencil."""
    return np.sqrt(np.abs(scipy.linalg.eigvalsh(stiffness, mass))) / (2.0 * np.pi)


@pytest.fixture(scope="session")
def dense():
    return SimpleNamespace(pencil=dense_pencil, rigid_map=rigid_patch_map, frequencies=frequencies_of)
