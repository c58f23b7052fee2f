"""Component models by scipy alone, with rigid faces built in by hand: an independent method to check the reduction."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from mpi4py import MPI

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh
from headstock.solvers.elastic.elasticity import assemble_elasticity

_SHIFT = -1e6


@dataclass(frozen=True, eq=False)
class ConstrainedMatrices:
    """Stiffness and mass of a component whose interface dofs stand first, six for each, before the free mesh dofs.

    Attributes:
        stiffness: ``(n, n)`` sparse.
        mass: ``(n, n)`` sparse.
        boundary: Number of interface dofs.
    """

    stiffness: scipy.sparse.csc_matrix
    mass: scipy.sparse.csc_matrix
    boundary: int


def rigid_face_matrices(mesh: ComponentMesh, material: Material, centers: Mapping[str, FloatArray]) -> ConstrainedMatrices:
    """Matrices of a component whose named patches move as rigid bodies about given points.

    Args:
        mesh: Mesh with the patches.
        material: Isotropic material.
        centers: ``(3,)`` reference point [m] of each patch, in the order of its dofs.
    """
    stiffness, mass = _whole_matrices(mesh, material)
    free = np.ones(3 * len(mesh.points), dtype=bool)
    columns = []
    for name, center in centers.items():
        nodes = np.unique(mesh.patches[name])
        dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
        free[dofs] = False
        block = scipy.sparse.lil_matrix((len(free), 6))
        block[dofs] = rigid_map(mesh.points[nodes], center)
        columns.append(block)
    interior = scipy.sparse.identity(len(free), format="csc")[:, np.flatnonzero(free)]
    transform = scipy.sparse.hstack([*columns, interior], format="csc")
    return ConstrainedMatrices(
        (transform.T @ stiffness @ transform).tocsc(), (transform.T @ mass @ transform).tocsc(), 6 * len(centers)
    )


def all_frequencies(matrices: ConstrainedMatrices) -> FloatArray:
    """Every natural frequency [Hz] by dense algebra; rigid motions come out as what rounding makes of zero."""
    values = scipy.linalg.eigh(matrices.stiffness.toarray(), matrices.mass.toarray(), eigvals_only=True)
    return np.asarray(np.sqrt(np.abs(values)) / (2.0 * np.pi))


def lowest_frequencies(matrices: ConstrainedMatrices, count: int) -> FloatArray:
    """The lowest natural frequencies [Hz] ``(count,)``, rigid ones among them, by shift and invert."""
    values = scipy.sparse.linalg.eigsh(
        matrices.stiffness, k=count, M=matrices.mass, sigma=_SHIFT, return_eigenvectors=False, tol=1e-13
    )
    return np.asarray(np.sqrt(np.abs(np.sort(values))) / (2.0 * np.pi))


def guyan_matrices(matrices: ConstrainedMatrices) -> tuple[FloatArray, FloatArray]:
    """Stiffness and mass ``(n_b, n_b)`` condensed statically to the interface dofs.

    Source: Guyan (1965).
    """
    count = matrices.boundary
    inner = matrices.stiffness[count:, count:]
    coupling = matrices.stiffness[count:, :count].toarray()
    shapes = np.vstack([np.eye(count), -scipy.sparse.linalg.splu(inner.tocsc()).solve(coupling)])
    return shapes.T @ (matrices.stiffness @ shapes), shapes.T @ (matrices.mass @ shapes)


def held_compliance(matrices: ConstrainedMatrices) -> FloatArray:
    """Compliance ``(6, 6)`` of the last interface of two with the first one held, by one sparse solve of the whole model."""
    loads = np.zeros((matrices.stiffness.shape[0] - 6, 6))
    loads[:6] = np.eye(6)
    return np.asarray(scipy.sparse.linalg.splu(matrices.stiffness[6:, 6:].tocsc()).solve(loads)[:6])


def _whole_matrices(mesh: ComponentMesh, material: Material) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
    """Stiffness and mass in mesh point order; every rank makes its own."""
    operators = assemble_elasticity(mesh, material, comm=MPI.COMM_SELF, with_mass=True)
    place = np.argsort((3 * operators.nodes[:, None] + np.arange(3)).ravel())
    stiffness = scipy.sparse.csr_matrix(operators.stiffness)[place][:, place]
    mass = scipy.sparse.csr_matrix(scipy.sparse.kron(operators.scalar_mass, np.eye(3)))[place][:, place]
    return stiffness, mass
