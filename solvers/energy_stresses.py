"""Stresses of many displacement fields at once, scaled so that half their square is the density of strain energy."""

from dataclasses import dataclass

import basix
import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.materials import Material
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.meshing.element_topology import cell_family, shape_functions, shape_gradients

# single precision: errors of stresses are wanted, and they are far larger than its rounding
StressArray = NDArray[np.float32]
SHEAR_PAIRS = ((1, 2), (0, 2), (0, 1))
COMPONENTS = 6


@dataclass(frozen=True, eq=False)
class CellStresses:
    """Stresses of ``k`` fields in some cells.

    Attributes:
        values: ``(n_cells, n_places, 6 k)``; per place and component one value per field [sqrt(J/m^3)].
        measures: ``(n_cells, n_places)`` volume per reference volume.
    """

    values: StressArray
    measures: FloatArray


def gauss_places(kind: CellKind, degree: int) -> tuple[FloatArray, FloatArray]:
    """Reference places ``(n, 3)`` and weights ``(n,)`` of a rule that is exact up to a degree."""
    simplex = cell_family(kind) == "tet"
    places, weights = basix.make_quadrature(basix.CellType.tetrahedron if simplex else basix.CellType.hexahedron, degree)
    # gmsh's reference hexahedron reaches from -1 to 1
    return (places, weights) if simplex else (2.0 * places - 1.0, 8.0 * weights)


def scaled_stresses(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, places: FloatArray, cells: slice = slice(None)
) -> CellStresses:
    """Stresses at reference places of cells, in coordinates in which the strain energy is half the sum of squares.

    With deviator s and pressure p of a stress the components are s / sqrt(2 G) and p / sqrt(K) spread evenly over the diagonal, so
    that any two fields have the energy product ``sum(values_a * values_b)`` per volume.

    Args:
        mesh: The component's mesh.
        material: Its material; isotropic.
        displacement: ``(3 n_points, k)`` of the mesh points [m].
        places: ``(n_places, 3)`` in the reference cell.
        cells: Which cells.
    """
    count = displacement.shape[1]
    nodes = mesh.cells[cells]
    gradients = shape_gradients(mesh.kind, places)
    jacobians = np.einsum("rqn,cnd->cqrd", gradients, mesh.points[nodes])
    slopes = np.einsum("cqdr,rqn->cqdn", np.linalg.inv(jacobians), gradients, optimize=True)
    moved = displacement.reshape(-1, 3 * count)[nodes]
    table = np.matmul(slopes.reshape(len(nodes), -1, nodes.shape[1]), moved)
    strains = table.reshape(len(nodes), len(places), 3, 3, count)
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    bulk = material.youngs_modulus / (3.0 * (1.0 - 2.0 * material.poisson_ratio))
    result = np.empty((len(nodes), len(places), COMPONENTS, count), dtype=np.float32)
    mean = (strains[:, :, 0, 0] + strains[:, :, 1, 1] + strains[:, :, 2, 2]) / 3.0
    for axis in range(3):
        result[:, :, axis] = np.sqrt(2.0 * shear) * (strains[:, :, axis, axis] - mean) + np.sqrt(3.0 * bulk) * mean
    for row, (a, b) in enumerate(SHEAR_PAIRS):
        result[:, :, 3 + row] = np.sqrt(shear) * (strains[:, :, a, b] + strains[:, :, b, a])
    return CellStresses(result.reshape(len(nodes), len(places), -1), np.abs(np.linalg.det(jacobians)))


def interpolate(kind: CellKind, places: FloatArray) -> StressArray:
    """Shape functions ``(n_places, nodes per cell)`` in the precision of stresses."""
    return shape_functions(kind, places).astype(np.float32)
