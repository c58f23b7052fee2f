"""Checks of a meshed component: rounding that makes free rigid motions stiff is taken out,
first-order elements that lock are refused.
"""

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.components import Component
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.elements.topology import EDGES, cell_family
from headstock.reduction.components.supports import HeldPoints
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions, rotation_dofs
from headstock.solvers.errors import AccuracyError, ModelError

RIGID_FORCE_LIMIT = 1e-9
FIXED_LIMIT = 1e-9
LARGEST_ASPECT = 10.0
THINNEST = 1e-2
LINEAR = ("tet4", "hex8")


def without_rigid_stiffness(
    element: Superelement, points: FloatArray, held: HeldPoints, *, scale: float
) -> FloatArray:
    """Return the stiffness ``(n, n)`` of a superelement with its free rigid motions exactly in its
    null space.

    A rounding error of 1e-16 of the largest nodal stiffness would otherwise look like a very soft
    spring, which hides mechanisms; with a single boundary node nothing but rounding is left.

    Args:
        points: ``(n_points, 3)`` mesh points [m].
        scale: Largest entry of the stiffness it was reduced from [N/m].

    Raises:
        AccuracyError: What is to be taken out is more than rounding.

    Source: Farhat and Geradin (1998), projection onto the self-equilibrated loads.
    """
    boundary = element.boundary_size
    length = float(np.linalg.norm(np.ptp(points, axis=0)))
    free = _free_combinations(points, held, length)
    if not boundary or not free.shape[1]:
        return element.stiffness
    units = np.ones(boundary)
    units[rotation_dofs(element)] = 1.0 / length
    rows = rigid_motions(element, points.mean(axis=0))[:boundary] @ free
    motions, _ = np.linalg.qr(rows / units[:, None])
    scaled = units[:, None] * element.stiffness[:boundary, :boundary] * units
    force = float(np.abs(scaled @ motions).max())
    if not force <= RIGID_FORCE_LIMIT * scale:
        raise AccuracyError(
            f"component {element.name}: a rigid motion of its interfaces causes {force:.3g} N/m, {force / scale:.2g} of its largest "
            f"nodal stiffness (allowed {RIGID_FORCE_LIMIT:g}); look for slivers"
        )
    elastic = np.eye(boundary) - motions @ motions.T
    # projecting leaves rounding of rounding where nothing is to be left at all
    projected = elastic @ scaled @ elastic if motions.shape[1] < boundary else np.zeros_like(scaled)
    # nor does a dof that only free motions move, next to a support: of its diagonal entry the
    # square of rounding is left
    dead = projected.diagonal() <= (boundary * np.finfo(float).eps) ** 2 * np.abs(projected).max(
        initial=0.0
    )
    projected[dead, :], projected[:, dead] = 0.0, 0.0
    projected = projected / units / units[:, None]
    result = element.stiffness.copy()
    result[:boundary, :boundary] = 0.5 * (projected + projected.T)
    return result


def _free_combinations(points: FloatArray, held: HeldPoints, length: float) -> FloatArray:
    """Return the combinations ``(6, k)`` of the rigid motions about the mean point that supports do
    not prevent.
    """
    middle = points.mean(axis=0)
    prevented = np.vstack([rigid_map(points, middle)[held.dofs], held.turned_motions(middle)])
    rows = prevented * np.repeat([1.0, 1.0 / length], 3)
    if not len(rows):
        return np.eye(6)
    values, vectors = np.linalg.eigh(rows.T @ rows)
    return (
        np.repeat([1.0, 1.0 / length], 3)[:, None] * vectors[:, values <= FIXED_LIMIT * len(rows)]
    )


def remark_on_element_order(component: Component, mesh: ComponentMesh) -> tuple[str, ...]:
    """Return remarks on the order of a mesh's elements; nothing of second-order ones.

    Raises:
        ModelError: First-order elements are drawn out, or the part is thin, and the scene does not
            insist on them.

    Source: MacNeal (1994), Finite Elements: Their Design and Performance, ch. 6: parasitic shear
    grows with the square of length over thickness.
    """
    if mesh.kind not in LINEAR:
        return ()
    starts, ends = np.array(EDGES[cell_family(mesh.kind)]).T
    edges = mesh.points[mesh.cells[:, ends]] - mesh.points[mesh.cells[:, starts]]
    lengths = np.linalg.norm(edges, axis=2)
    aspect = float((lengths.max(axis=1) / lengths.min(axis=1)).max())
    extents = np.ptp(mesh.points, axis=0)
    thinness = float(extents.min() / extents.max())
    if aspect > LARGEST_ASPECT or thinness < THINNEST:
        finding = (
            f"component {component.name}: its elements are of order 1 ({mesh.kind}), up to {aspect:.3g} times longer than thick, in a "
            f"part {thinness:.2g} times as thick as long: in bending they lock and come out many times too stiff"
        )
        if component.mesh.allow_locking:
            return (finding,)
        raise ModelError(f"{finding}; write order = 2 (or give a mesh of second-order elements)")
    if component.mesh.order == 1:
        return ()  # asked for in the scene, which has been reported
    return (
        f"component {component.name}: its mesh has elements of order 1 ({mesh.kind}), which lock: bending comes out too stiff; give a "
        "mesh of second-order elements",
    )
