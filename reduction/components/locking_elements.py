"""First-order elements lock in bending: where that would be gross they are refused, elsewhere they are spoken of."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component
from headstock.meshing.component_mesh import ComponentMesh
from headstock.solvers.errors import ModelError

LARGEST_ASPECT = 10.0
THINNEST = 1e-2
# pairs of corners in gmsh's order
EDGES = {
    "tet4": ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)),
    "hex8": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
}


def judge_element_order(component: Component, mesh: ComponentMesh) -> tuple[str, ...]:
    """What is to be said of the order of a mesh's elements; nothing of second-order ones.

    Raises:
        ModelError: First-order elements are drawn out, or the part is thin, and the scene does not insist on them.

    Source: MacNeal (1994), Finite Elements: Their Design and Performance, ch. 6: parasitic shear grows with the square of length
    over thickness.
    """
    if mesh.kind not in EDGES:
        return ()
    aspect = float(_aspect_ratios(mesh).max())
    extents = np.ptp(mesh.points, axis=0)
    thinness = float(extents.min() / extents.max())
    if aspect > LARGEST_ASPECT or thinness < THINNEST:
        finding = (
            f"component {component.name}: its elements are of order 1 ({mesh.kind}), up to {aspect:.3g} times longer than thick, in a "
            f"part {thinness:.2g} times as thick as long: in bending they lock and come out many times too stiff"
        )
        if component.mesh.force:
            return (finding,)
        raise ModelError(f"{finding}; write order = 2 (or give a mesh of second-order elements)")
    if component.mesh.order == 1:
        return ()  # asked for in the scene, which has been told
    return (
        f"component {component.name}: its mesh has elements of order 1 ({mesh.kind}), which lock: bending comes out too stiff; give a "
        "mesh of second-order elements",
    )


def _aspect_ratios(mesh: ComponentMesh) -> FloatArray:
    """Longest over shortest edge of each cell ``(n_cells,)``."""
    pairs = np.array(EDGES[mesh.kind])
    lengths = np.linalg.norm(mesh.points[mesh.cells[:, pairs[:, 1]]] - mesh.points[mesh.cells[:, pairs[:, 0]]], axis=2)
    return np.asarray(lengths.max(axis=1) / lengths.min(axis=1))
