"""Displacement and stress at points of a component from the displacements of its mesh points."""

from dataclasses import dataclass

import basix
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.solvers.elastic.compat import gmsh_cell_order
from headstock.solvers.elastic.elasticity import CELL_TYPES
from headstock.solvers.errors import ModelError

NODE_TOLERANCE = 1e-6
INSIDE_TOLERANCE = 1e-6
NEWTON_STEPS = 30
CANDIDATE_CELLS = 40


@dataclass(frozen=True, eq=False)
class PointResponse:
    """Recovered response at points.

    Attributes:
        displacement: ``(n, 3)`` [m].
        stress: ``(n, 3, 3)`` Cauchy stress [Pa].
        jump: ``(n,)`` largest difference between the stresses of the cells that meet at the point
            over their largest entry: a measure of the discretisation error there (zero inside a
            cell).
    """

    displacement: FloatArray
    stress: FloatArray
    jump: FloatArray


def recover_at_points(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, points: FloatArray
) -> PointResponse:
    """Displacement and stress at points of a component.

    At a mesh point the stresses of all cells that meet there are averaged; elsewhere the cell that
    holds the point is evaluated.

    Args:
        mesh: The component's mesh.
        material: Its material.
        displacement: ``(n_points, 3)`` or ``(3 n_points,)`` displacement of the mesh points [m].
        points: ``(n, 3)`` in the component's frame [m].

    Raises:
        ModelError: A point lies outside the mesh.

    Source: Hinton and Campbell (1974) for nodal averaging.
    """
    field = np.asarray(displacement, dtype=float).reshape(-1, 3)
    element = _Element(mesh)
    moved, stresses, jumps = [], [], []
    for point in np.atleast_2d(points):
        values, tensors = _evaluate(element, mesh, material, field, point)
        mean = tensors.mean(axis=0)
        scale = max(float(np.abs(tensors).max()), np.finfo(float).tiny)
        moved.append(values)
        stresses.append(mean)
        jumps.append(float(np.abs(tensors - mean).max()) / scale)
    return PointResponse(np.array(moved), np.array(stresses), np.array(jumps))


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

    def tabulate(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values ``(n,)`` and gradients ``(n, 3)`` at a reference place."""
        table = self._element.tabulate(1, place[None, :])[:, 0, :, 0]
        return table[0], table[1:].T

    def contains(self, place: FloatArray) -> bool:
        """Whether a reference place lies in the reference cell."""
        low = bool((place >= -INSIDE_TOLERANCE).all())
        return low and bool(
            place.sum() <= 1.0 + INSIDE_TOLERANCE
            if self.simplex
            else (place <= 1.0 + INSIDE_TOLERANCE).all()
        )


def _evaluate(
    element: _Element, mesh: ComponentMesh, material: Material, field: FloatArray, point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    distances = np.linalg.norm(mesh.points - point, axis=1)
    nearest = int(np.argmin(distances))
    extent = float(np.ptp(mesh.points, axis=0).max())
    if distances[nearest] < NODE_TOLERANCE * extent:
        cells, positions = np.nonzero(element.cells == nearest)
        tensors = [
            _stress(element, mesh, material, field, int(cell), element.nodes[position])
            for cell, position in zip(cells, positions, strict=True)
        ]
        return field[nearest], np.array(tensors)
    cell, place = _locate(element, mesh, point)
    values, _ = element.tabulate(place)
    return values @ field[element.cells[cell]], _stress(
        element, mesh, material, field, cell, place
    )[None]


def _locate(element: _Element, mesh: ComponentMesh, point: FloatArray) -> tuple[int, FloatArray]:
    centers = mesh.points[mesh.cells].mean(axis=1)
    for cell in np.argsort(np.linalg.norm(centers - point, axis=1))[:CANDIDATE_CELLS]:
        place = element.nodes.mean(axis=0)
        for _ in range(NEWTON_STEPS):
            values, gradients = element.tabulate(place)
            nodes = mesh.points[element.cells[cell]]
            step = np.linalg.solve(nodes.T @ gradients, point - values @ nodes)
            place = place + step
            if np.abs(step).max() < 1e-12 or np.abs(place).max() > 5.0:
                break
        if element.contains(place):
            return int(cell), place
    raise ModelError(
        f"the point ({', '.join(f'{value:.6g}' for value in point)}) m lies outside the component's mesh"
    )


def _stress(
    element: _Element,
    mesh: ComponentMesh,
    material: Material,
    field: FloatArray,
    cell: int,
    place: FloatArray,
) -> FloatArray:
    _, gradients = element.tabulate(place)
    nodes = element.cells[cell]
    slopes = gradients @ np.linalg.inv(mesh.points[nodes].T @ gradients)
    strain = field[nodes].T @ slopes
    strain = 0.5 * (strain + strain.T)
    shear = material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))
    lame = 2.0 * shear * material.poisson_ratio / (1.0 - 2.0 * material.poisson_ratio)
    return np.asarray(2.0 * shear * strain + lame * np.trace(strain) * np.eye(3))
