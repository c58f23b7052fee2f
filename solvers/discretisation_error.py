"""How much strain energy finite elements miss: element stresses held against smoother ones recovered from them."""

from collections.abc import Iterator

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.materials import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.element_topology import cell_family, cell_order, shape_functions
from headstock.solvers.energy_stresses import (
    COMPONENTS,
    StressArray,
    gauss_places,
    local_motions,
    straight_cells,
    stress_operators,
)
from headstock.solvers.stress_patches import recover_stresses

# places where stresses are better than elsewhere in a cell, and rules for the square of what recovery changes
SAMPLE_DEGREES = {("tet", 1): 1, ("tet", 2): 2, ("hex", 1): 1, ("hex", 2): 3}
ENERGY_DEGREES = {("tet", 1): 2, ("tet", 2): 4, ("hex", 1): 3, ("hex", 2): 5}
BLOCK_VALUES = 2_000_000  # of the stresses that are at work at a time


def estimate_missing_energy(mesh: ComponentMesh, material: Material, displacement: FloatArray) -> FloatArray:
    """Energy products of the discretisation errors of displacement fields.

    For a field that combines them with weights q, ``q^T E q`` estimates the squared energy norm of its error: what the compliance
    under its load is too small by, and by what ``omega^2`` of a mass-normalised mode is too large.

    Args:
        mesh: The component's mesh.
        material: Its material.
        displacement: ``(3 n_points, k)`` of the mesh points [m].

    Returns:
        ``(k, k)`` symmetric, positive semidefinite [J for fields in m].

    Source: Zienkiewicz and Zhu (1987), Int. J. Numer. Meth. Engng. 24, 337-357; Strang and Fix (1973), ch. 6, for eigenvalues.
    """
    count = displacement.shape[1]
    if count == 0:
        return np.zeros((0, 0))
    key = cell_family(mesh.kind), cell_order(mesh.kind)
    samples, _ = gauss_places(mesh.kind, SAMPLE_DEGREES[key])
    taken = _sample_stresses(mesh, material, displacement, samples)
    smooth = recover_stresses(mesh, samples, taken)
    straight = straight_cells(mesh) if key[0] == "tet" else np.zeros(len(mesh.cells), dtype=bool)
    energy = np.zeros((count, count))
    places, weights = gauss_places(mesh.kind, ENERGY_DEGREES[key])
    change_rule = _change_rule(mesh, samples, places, weights) if straight.any() else np.zeros((0, 0), dtype=np.float32)
    for cells in _blocks(np.flatnonzero(straight), mesh.cells.shape[1] * taken.shape[2]):
        values = np.concatenate([smooth[mesh.cells[cells]], taken[cells]], axis=1)
        sizes = np.sqrt(_straight_measures(mesh, cells)).astype(np.float32)
        energy += _products(np.matmul(sizes[:, None, None] * change_rule, values), count)
    shapes = shape_functions(mesh.kind, places).astype(np.float32)
    for cells in _blocks(np.flatnonzero(~straight), len(places) * taken.shape[2]):
        found = stress_operators(mesh, material, places, cells)
        sizes = np.sqrt(found.measures * weights).astype(np.float32)
        change = np.matmul(np.repeat(sizes, COMPONENTS, axis=1)[:, :, None] * found.table, local_motions(mesh, displacement, cells))
        change = change.reshape(len(cells), len(places), -1)
        change -= np.matmul(sizes[:, :, None] * shapes, smooth[mesh.cells[cells]])
        energy += _products(change, count)
    return 0.5 * (energy + energy.T)


def _sample_stresses(mesh: ComponentMesh, material: Material, displacement: FloatArray, places: FloatArray) -> StressArray:
    """Stresses ``(n_cells, n_places, 6 k)``; per place and component one value per field."""
    result = np.empty((len(mesh.cells), len(places), COMPONENTS * displacement.shape[1]), dtype=np.float32)
    for cells in _blocks(np.arange(len(mesh.cells)), 3 * mesh.cells.shape[1] * displacement.shape[1]):
        table = stress_operators(mesh, material, places, cells).table
        found = np.matmul(table, local_motions(mesh, displacement, cells))
        result[cells[0] : cells[-1] + 1] = found.reshape(len(cells), *result.shape[1:])
    return result


def _change_rule(mesh: ComponentMesh, samples: FloatArray, places: FloatArray, weights: FloatArray) -> StressArray:
    """What recovery changes in a straight tetrahedron, from nodal values and samples, so that its squares add up to its energy.

    There the stress is a polynomial of one order less than the displacement, which its samples determine.
    """

    def terms(where: FloatArray) -> FloatArray:
        constant = np.ones((len(where), 1))
        return constant if cell_order(mesh.kind) == 1 else np.hstack([constant, where])

    shapes = shape_functions(mesh.kind, places)
    rule = np.sqrt(weights)[:, None] * np.hstack([shapes, -terms(places) @ np.linalg.pinv(terms(samples))])
    # as many rows as there are nodes hold the same squares
    return np.asarray(np.linalg.qr(rule, mode="r")[: shapes.shape[1]], dtype=np.float32)


def _products(values: StressArray, count: int) -> FloatArray:
    rows = values.reshape(-1, count)
    return np.asarray(rows.T @ rows, dtype=float)


def _blocks(cells: IntArray, values_per_cell: int) -> Iterator[IntArray]:
    step = max(1, BLOCK_VALUES // values_per_cell)
    for start in range(0, len(cells), step):
        yield cells[start : start + step]


def _straight_measures(mesh: ComponentMesh, cells: IntArray) -> FloatArray:
    corners = mesh.points[mesh.cells[cells, :4]]
    a, b, c = (corners[:, axis] - corners[:, 0] for axis in (1, 2, 3))
    return np.asarray(np.abs((np.cross(a, b) * c).sum(axis=1)))
