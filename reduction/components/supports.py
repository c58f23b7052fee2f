"""Pointwise supports on a mesh: dofs along the component's axes that do not move, and motions in
turned directions that must vanish.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.geometry.parts.components import NORMAL, Component, Support
from headstock.geometry.parts.solids import Tube
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.components.interface_patches import nodal_normals
from headstock.solvers.errors import ModelError

FLAT = 1e-6  # normals that differ by less are those of a flat face
ALIGNED = 1e-9  # of a unit vector: components below are rounding
# each takes a solve, a column as long as the mesh, and a row of a dense matrix
MOST_TURNED = 800


@dataclass(frozen=True, eq=False)
class HeldPoints:
    """Motions of mesh points that supports fix (all ranks hold the same).

    Attributes:
        dofs: Mesh dofs that do not move, rising.
        nodes: ``(m,)`` mesh points that do not move along a turned direction, once for each.
        points: ``(m, 3)`` where they are [m].
        directions: ``(m, 3)`` unit vectors, component axes; those of one point orthogonal.
    """

    dofs: IntArray
    nodes: IntArray
    points: FloatArray
    directions: FloatArray
    warnings: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return len(self.dofs) > 0 or len(self.nodes) > 0

    def turned_motions(self, center: FloatArray) -> FloatArray:
        """Return the motion ``(m, 6)`` along the directions in unit rigid motions about a point."""
        motions = rigid_map(self.points, center).reshape(-1, 3, 6)
        return np.einsum("mi,mij->mj", self.directions, motions)


def hold_points(
    component: Component, mesh: ComponentMesh, supports: Sequence[Support]
) -> HeldPoints:
    """Return what the supports of a component fix; several may meet in a point.

    Args:
        mesh: Its mesh, with the groups of patches of each support.

    Raises:
        ModelError: An edge is none, or a turned direction holds too many points.
    """
    fixed: BoolArray = np.zeros((len(mesh.points), 3), dtype=bool)
    turned: dict[int, list[FloatArray]] = {}
    warnings: list[str] = []
    for support in supports:
        nodes = _find_nodes(component, mesh, support, warnings)
        for direction in support.directions:
            if isinstance(direction, str) and direction != NORMAL:
                fixed[nodes, "xyz".index(direction)] = True
                continue
            vectors = (
                _find_normals(component, mesh, support, warnings)
                if isinstance(direction, str)
                else np.tile(direction, (len(nodes), 1))
            )
            for node, vector in zip(nodes, vectors, strict=True):
                turned.setdefault(int(node), []).append(vector)
    kept_nodes: list[int] = []
    kept: list[FloatArray] = []
    for point, given in turned.items():
        rest = _split_axes(fixed[point], np.array(given))
        kept_nodes += [point] * len(rest)
        kept += list(rest)
    if len(kept) > MOST_TURNED:
        names = ", ".join(support.name for support in supports)
        raise ModelError(
            f"component {component.name}: supports ({names}) hold {len(kept)} points in directions that are not along its axes; at most "
            f"{MOST_TURNED} can be: take larger elements or a smaller patch, or turn the solid so that the direction is along one of its axes"
        )
    held = np.array(kept_nodes, dtype=np.int64)
    return HeldPoints(
        np.flatnonzero(fixed.ravel()),
        held,
        mesh.points[held],
        np.array(kept).reshape(len(kept), 3),
        tuple(warnings),
    )


def _find_nodes(
    component: Component, mesh: ComponentMesh, support: Support, warnings: list[str]
) -> IntArray:
    first, *second = (np.unique(mesh.patches[name]) for name in support.groups)
    if not second:
        return first
    nodes = np.intersect1d(first, second[0])
    if len(nodes) < 2:
        raise ModelError(
            f"component {component.name}: the faces of support {support.name} do not meet in an edge; name two that do"
        )
    warnings.append(
        f"component {component.name}: support {support.name} holds an edge: stresses there, and the stiffness of a part that is not "
        "thin beside it, depend on the mesh (they grow with the logarithm of the element size)"
    )
    return nodes


def _find_normals(
    component: Component, mesh: ComponentMesh, support: Support, warnings: list[str]
) -> FloatArray:
    """Find the unit normals ``(n, 3)`` at the sorted points of a support's patches."""
    nodes, normals = nodal_normals(mesh, next(iter(support.groups)))
    if isinstance(component.solid, Tube) and {patch.face for patch in support.patches} <= {
        "outer",
        "inner",
    }:
        # those of the mesh are a little off, and would stop the tube from turning about its axis
        radial = mesh.points[nodes] * [1.0, 1.0, 0.0]
        return radial / np.linalg.norm(radial, axis=1, keepdims=True)
    mean = normals.mean(axis=0)
    if np.abs(normals - mean).max() <= FLAT:
        return np.tile(mean / np.linalg.norm(mean), (len(nodes), 1))
    warnings.append(
        f"component {component.name}: support {support.name} is normal to a curved face, whose normals are those of its mesh; they let a "
        "round part turn and slide only roughly"
    )
    return normals


def _split_axes(fixed: BoolArray, vectors: FloatArray) -> FloatArray:
    """Return the orthonormal directions ``(k, 3)`` of one point other than its fixed dofs, to which
    those along axes are added.
    """
    while True:
        free = np.where(fixed, 0.0, vectors)
        _, sizes, rows = np.linalg.svd(free, full_matrices=False)
        rows = rows[sizes > ALIGNED]
        # an axis lies in the span of the rows where nothing of it is left besides them
        remainders = np.linalg.norm(np.eye(3) - rows.T @ rows, axis=0)
        along = (remainders <= ALIGNED) & ~fixed
        if not along.any():
            return np.asarray(rows)
        fixed |= along
