"""Stresses of many displacement fields at once, scaled so that half their square is the density of strain energy."""

from dataclasses import dataclass

import basix
import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.materials import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.topology import cell_family, corner_count, reference_nodes, shape_functions, shape_gradients

# single precision: errors of stresses are wanted, and they are far larger than its rounding
StressArray = NDArray[np.float32]
SHEAR_PAIRS = ((1, 2), (0, 2), (0, 1))
COMPONENTS = 6
STRAIGHT = 1e-12  # of the size of the mesh


@dataclass(frozen=True, eq=False)
class StressOperators:
    """What turns displacements at the nodes of some cells into stresses.

    Attributes:
        table: ``(n_cells, 6 n_places, 3 n_nodes)``; all x of a cell's nodes first, then y, then z.
        measures: ``(n_cells, n_places)`` volume per reference volume.
    """

    table: StressArray
    measures: FloatArray


def gauss_places(kind: CellKind, degree: int) -> tuple[FloatArray, FloatArray]:
    """Reference places ``(n, 3)`` and weights ``(n,)`` of a rule that is exact up to a degree."""
    simplex = cell_family(kind) == "tet"
    places, weights = basix.make_quadrature(basix.CellType.tetrahedron if simplex else basix.CellType.hexahedron, degree)
    # gmsh's reference hexahedron reaches from -1 to 1
    return (places, weights) if simplex else (2.0 * places - 1.0, 8.0 * weights)


def stress_operators(mesh: ComponentMesh, material: Material, places: FloatArray, cells: IntArray) -> StressOperators:
    """Operators to stresses at reference places of cells, in coordinates in which the strain energy is half the sum of squares.

    With deviator s and pressure p of a stress the components are s / sqrt(2 G) and p / sqrt(K) spread evenly over the diagonal, so
    that any two fields have the energy product ``sum(values_a * values_b)`` per volume.

    Args:
        mesh: The component's mesh.
        material: Its material; isotropic.
        places: ``(n_places, 3)`` in the reference cell.
        cells: Which cells.
    """
    nodes = mesh.cells[cells]
    gradients = shape_gradients(mesh.kind, places)
    spots, width = len(places), nodes.shape[1]
    jacobians = np.matmul(gradients.transpose(1, 0, 2).reshape(3 * spots, width), mesh.points[nodes])
    inverse, measures = _invert(jacobians.reshape(len(nodes), spots, 3, 3))
    # one long product per place: rows are cells, stress components and directions of the displacement
    turned = np.tensordot(_stress_law(material), inverse, (2, 2)).transpose(3, 2, 0, 1, 4)
    turned = turned.reshape(spots, -1, 3).astype(np.float32)
    table = np.matmul(turned, gradients.transpose(1, 0, 2).astype(np.float32))
    table = table.reshape(spots, len(nodes), COMPONENTS, 3 * width).swapaxes(0, 1)
    return StressOperators(table.reshape(len(nodes), COMPONENTS * spots, 3 * width), np.abs(measures))


def local_motions(mesh: ComponentMesh, displacement: FloatArray, cells: IntArray) -> StressArray:
    """Displacements of the nodes of cells against the first of each, ``(n_cells, 3 n_nodes, k)`` in the order of the operators.

    Args:
        mesh: The component's mesh.
        displacement: ``(3 n_points, k)``.
        cells: Which cells.
    """
    nodes = mesh.cells[cells]
    dofs = 3 * nodes[:, None, :] + np.arange(3)[:, None]
    moved = displacement[dofs]
    # taken in double precision: what is common to a cell would eat the digits that its strain is made of
    result = np.empty(moved.shape, dtype=np.float32)
    np.subtract(moved, moved[:, :, :1], out=result, casting="same_kind")
    return result.reshape(len(nodes), -1, displacement.shape[1])


def straight_cells(mesh: ComponentMesh) -> NDArray[np.bool_]:
    """Cells ``(n_cells,)`` whose nodes are where those of straight edges are."""
    if mesh.straight:
        return np.ones(len(mesh.cells), dtype=bool)
    first = corner_count(mesh.kind)
    linear: CellKind = "tet4" if cell_family(mesh.kind) == "tet" else "hex8"
    nodes = mesh.points[mesh.cells]
    away = nodes[:, first:] - np.matmul(shape_functions(linear, reference_nodes(mesh.kind))[first:], nodes[:, :first])
    return np.asarray(np.abs(away).max(axis=(1, 2), initial=0.0) <= STRAIGHT * np.ptp(mesh.points, axis=0).max())


def _stress_law(material: Material) -> FloatArray:
    """``(6, 3, 3)`` scaled stress per derivative [.., component of the displacement, direction]."""
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    bulk = material.youngs_modulus / (3.0 * (1.0 - 2.0 * material.poisson_ratio))
    law = np.zeros((COMPONENTS, 3, 3))
    for axis in range(3):
        law[axis, axis, axis] = np.sqrt(2.0 * shear)
        law[axis] += np.eye(3) * (np.sqrt(3.0 * bulk) - np.sqrt(2.0 * shear)) / 3.0
    for row, (a, b) in enumerate(SHEAR_PAIRS):
        law[3 + row, a, b] = law[3 + row, b, a] = np.sqrt(shear)
    return law


def _invert(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses and determinants of ``(..., 3, 3)``; by cofactors, as a factorisation of each takes longer than all the rest."""
    a, b, c = (matrices[..., row, :] for row in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    determinants = (a * cofactors[..., 0]).sum(axis=-1)
    return cofactors / determinants[..., None, None], determinants
