"""How much strain energy finite elements miss: element stresses held against smoother ones recovered from them."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.materials import Material
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.element_topology import cell_family, cell_order
from headstock.solvers.energy_stresses import StressArray, gauss_places, interpolate, scaled_stresses
from headstock.solvers.stress_patches import recover_stresses

# places where stresses are better than elsewhere in a cell, and rules for the square of what recovery changes
SAMPLE_DEGREES = {("tet", 1): 1, ("tet", 2): 2, ("hex", 1): 1, ("hex", 2): 3}
ENERGY_DEGREES = {("tet", 1): 2, ("tet", 2): 4, ("hex", 1): 3, ("hex", 2): 5}
BLOCK_VALUES = 4_000_000


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
    taken = scaled_stresses(mesh, material, displacement, samples).values
    recovery = recover_stresses(mesh, samples)
    smooth = recovery.spread @ (recovery.fit @ taken.reshape(-1, taken.shape[2]))
    places, weights = gauss_places(mesh.kind, ENERGY_DEGREES[key])
    shapes = interpolate(mesh.kind, places)
    # in straight tetrahedra the stress is a polynomial that its samples determine
    extend = _extension(key[1], samples, places) if key[0] == "tet" and mesh.straight else None
    energy = np.zeros((count, count))
    step = max(1, BLOCK_VALUES // (len(places) * taken.shape[2]))
    for start in range(0, len(mesh.cells), step):
        cells = slice(start, start + step)
        if extend is None:
            found = scaled_stresses(mesh, material, displacement, places, cells)
            change, measures = found.values, found.measures
        else:
            change = np.matmul(extend, taken[cells])
            measures = _straight_measures(mesh, cells)
        change -= np.matmul(shapes, smooth[mesh.cells[cells]])
        change *= np.sqrt(measures * weights).astype(np.float32)[:, :, None]
        rows = change.reshape(-1, count)
        energy += rows.T @ rows
    return 0.5 * (energy + energy.T)


def _extension(order: int, samples: FloatArray, places: FloatArray) -> StressArray:
    """Values at places from those at samples, of polynomials of one order less than the displacement."""

    def terms(where: FloatArray) -> FloatArray:
        constant = np.ones((len(where), 1))
        return constant if order == 1 else np.hstack([constant, where])

    return np.asarray(terms(places) @ np.linalg.pinv(terms(samples)), dtype=np.float32)


def _straight_measures(mesh: ComponentMesh, cells: slice) -> FloatArray:
    corners = mesh.points[mesh.cells[cells, :4]]
    return np.asarray(np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))[:, None])
