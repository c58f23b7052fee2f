"""What is seen at a point of a component: displacement and stress, from the displacements of its
mesh points.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.solvers.elastic.elasticity import CELL_TYPES, gmsh_cell_order
from headstock.solvers.errors import ModelError
from headstock.solvers.recovery.libraries import basix
from headstock.solvers.stresses import PAIRS

NODE_TOLERANCE = 1e-6
INSIDE_TOLERANCE = 1e-6
NEWTON_STEPS = 30
CANDIDATE_CELLS = 40


@dataclass(frozen=True, eq=False)
class PointRows:
    """Outputs at a point of a mesh: displacement x y z and stress xx yy zz xy xz yz, from the
    displacements of some mesh points.

    Attributes:
        nodes: ``(m,)`` those mesh points.
        rows: ``(9, 3 m)`` [1, Pa/m].
        cells: ``(c,)`` cells that meet at the point.
        shares: ``(m,)`` of a continuous field of nodal values, the value at the point.
    """

    nodes: IntArray
    rows: FloatArray
    cells: IntArray
    shares: FloatArray

    def apply(self, displacement: FloatArray) -> FloatArray:
        """Return the displacement and stress ``(9, k)`` under displacements ``(3 n_points, k)`` of
        mesh points.
        """
        moved = displacement.reshape(-1, 3, displacement.shape[1])[self.nodes]
        return np.asarray(self.rows @ moved.reshape(-1, displacement.shape[1]))

    def read(self, smooth: FloatArray) -> FloatArray:
        """Return a continuous field at the point, from its values ``(m, ...)`` at the nodes."""
        return np.asarray(np.tensordot(self.shares, smooth, axes=1))


def find_point_rows(
    mesh: ComponentMesh, material: Material, point: FloatArray, *, slack: float = INSIDE_TOLERANCE
) -> PointRows:
    """Find what is seen at a point of a component.

    At a mesh point the stresses of all cells that meet there are averaged; elsewhere the cell that
    holds the point is evaluated.

    Args:
        point: ``(3,)`` in the component's frame [m].
        slack: How far it may lie outside of a cell, over the size of the cell.

    Raises:
        ModelError: The point lies outside the mesh.

    Source: Hinton and Campbell (1974) for nodal averaging.
    """
    element = _Element(mesh)
    distances = np.linalg.norm(mesh.points - point, axis=1)
    nearest = int(np.argmin(distances))
    extent = float(np.ptp(mesh.points, axis=0).max())
    if distances[nearest] < NODE_TOLERANCE * extent:
        cells, positions = np.nonzero(element.cells == nearest)
        places = element.nodes[positions]
    else:
        cell_index, place = _locate(element, mesh, point, slack)
        cells, places = np.array([cell_index]), place[None]
    nodes, slots = np.unique(element.cells[cells], return_inverse=True)
    rows, shares = np.zeros((9, len(nodes), 3)), np.zeros(len(nodes))
    for cell, place, slot in zip(cells, places, slots.reshape(len(cells), -1), strict=True):
        values, gradients = element.tabulate(place)
        slopes = gradients @ np.linalg.inv(mesh.points[element.cells[cell]].T @ gradients)
        shares[slot] += values / len(cells)
        rows[:, slot] += _cell_rows(values, slopes, material) / len(cells)
    return PointRows(nodes, rows.reshape(9, -1), cells, shares)


def _cell_rows(values: FloatArray, slopes: FloatArray, material: Material) -> FloatArray:
    """Return the displacement and stress ``(9, n_nodes, 3)`` per displacement of a cell's nodes,
    from values ``(n_nodes,)`` and derivatives ``(n_nodes, 3)`` of their shape functions.
    """
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    rows = np.zeros((9, len(values), 3))
    for axis in range(3):
        rows[axis, :, axis] = values
        rows[3 + axis] = lame * slopes
        rows[3 + axis, :, axis] += 2.0 * shear * slopes[:, axis]
    for row, (first, second) in enumerate(PAIRS[3:], start=6):
        rows[row, :, first] = shear * slopes[:, second]
        rows[row, :, second] = shear * slopes[:, first]
    return rows


class _Element:
    """Shape functions of a mesh's cells, with cell nodes in the order of the shape functions."""

    def __init__(self, mesh: ComponentMesh) -> None:
        shape, order = CELL_TYPES[mesh.kind]
        self._element = basix.create_element(
            basix.ElementFamily.P, basix.CellType[shape], order, basix.LagrangeVariant.equispaced
        )
        self.cells: IntArray = mesh.cells[:, gmsh_cell_order(shape, mesh.cells.shape[1])]
        self.corners = basix.geometry(basix.CellType[shape])
        self.nodes = np.asarray(self._element.points)
        self.simplex = shape == "tetrahedron"

    def tabulate(self, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the values ``(n,)`` and gradients ``(n, 3)`` at a reference place."""
        table = self._element.tabulate(1, reference[None, :])[:, 0, :, 0]
        return table[0], table[1:].T

    def excess(self, reference: FloatArray) -> float:
        """Return how far a reference place lies outside of the reference cell; negative within."""
        high = reference.sum() if self.simplex else reference.max()
        return float(max(-reference.min(), high - 1.0))


def _locate(
    element: _Element, mesh: ComponentMesh, point: FloatArray, slack: float
) -> tuple[int, FloatArray]:
    """Find the cell that holds a point and its place there: the first of those that do, or, where the
    point lies beside all of them, the one that it is nearest to.
    """
    best: tuple[float, int, FloatArray] = (np.inf, -1, np.zeros(3))
    centers = mesh.points[mesh.cells].mean(axis=1)
    for cell in np.argsort(np.linalg.norm(centers - point, axis=1))[:CANDIDATE_CELLS]:
        reference = element.nodes.mean(axis=0)
        for _ in range(NEWTON_STEPS):
            values, gradients = element.tabulate(reference)
            nodes = mesh.points[element.cells[cell]]
            step = np.linalg.solve(nodes.T @ gradients, point - values @ nodes)
            reference = reference + step
            if np.abs(step).max() < 1e-12 or np.abs(reference).max() > 5.0:
                break
        excess = element.excess(reference)
        if excess <= INSIDE_TOLERANCE:
            return int(cell), reference
        best = min(best, (excess, int(cell), reference), key=lambda entry: entry[0])
    if best[0] <= slack:
        return best[1:]
    raise ModelError(
        f"the point ({', '.join(f'{value:.6g}' for value in point)}) m lies outside the component's mesh"
    )
