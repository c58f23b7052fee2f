"""From interfaces to boundary dofs: which nodes are fixed, which means are prescribed, and which
dofs interfaces share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, BoolArray, FloatArray, Frame
from headstock.geometry.parts.components import Component, Interface, Support
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.components.interface_patches import MeshPatch, measure_patch
from headstock.reduction.components.rail_fits import RailFit, fit_rail
from headstock.reduction.rails import ControlPoint
from headstock.reduction.superelement import InterfaceMap
from headstock.solvers.errors import ModelError

MINIMUM_FACETS = 4
DEPENDENCE_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class BoundaryNode:
    """One 6-dof boundary node: the patch that carries it and how it is coupled."""

    name: str
    patch: MeshPatch
    coupling: str


@dataclass(frozen=True, eq=False)
class BoundaryBasis:
    """Boundary dofs of a component in terms of its mesh points (all ranks hold the same).

    Attributes:
        nodes: Boundary nodes in dof order.
        interface_maps: Every fixed interface by name.
        rails: Interfaces that carriages slide along; their control points follow the nodes in dof
            order.
        shapes: ``(3 n_points, 6 n_nodes)`` sparse-in-spirit pairs ``(dofs, columns block)`` of
            rigid patches.
        fixed: Mesh dofs in rigid patches or supports, rising.
        supported: Mesh dofs fixed by supports, rising.
        constraints: ``(m, 6 n_nodes)`` orthonormal rows that must vanish: shared nodes and
            undetermined rotations.
        warnings: What was merged, dropped or disabled.
    """

    nodes: tuple[BoundaryNode, ...]
    interface_maps: dict[str, InterfaceMap]
    rails: tuple[RailFit, ...]
    shapes: tuple[tuple[IntArray, FloatArray, int], ...]
    fixed: IntArray
    supported: IntArray
    constraints: FloatArray
    warnings: tuple[str, ...]

    @property
    def control_points(self) -> tuple[ControlPoint, ...]:
        """Control points of all rails in dof order."""
        return tuple(ControlPoint(point, rail.axis) for rail in self.rails for point in rail.points)


def build_boundary_basis(
    component: Component, mesh: ComponentMesh, supports: Sequence[Support]
) -> BoundaryBasis:
    """Boundary nodes, fixed dofs and dependence rows of a component's interfaces and supports.

    Args:
        component: With its interfaces.
        mesh: Its mesh, with a patch per interface and a patch ``support:NAME`` per support.
        supports: Those of this component; each fixes some directions of the points of its patch.

    Raises:
        ModelError: An interface is point- or line-like and not forced.
    """
    warnings: list[str] = []
    nodes, interface_maps = _merge_interfaces(component, mesh, warnings)
    supported = np.zeros(3 * len(mesh.points), dtype=bool)
    for support in supports:
        points = np.unique(mesh.patches[f"support:{support.name}"])
        for direction in support.directions:
            supported[3 * points + "xyz".index(direction)] = True
    fixed, rows, shapes = supported.copy(), [], []
    first_owner: dict[int, _PointOwner] = {}
    for number, node in enumerate(nodes):
        rows += _undetermined_rows(component.name, node, number, len(nodes), warnings)
        if node.coupling != "rigid":
            continue
        rigid = node.patch.rigid_displacements()
        own = np.ones(len(node.patch.nodes), dtype=bool)
        for local, point in enumerate(node.patch.nodes):
            block = rigid[3 * local : 3 * local + 3]
            rows += _shared_rows(
                first_owner.get(int(point)),
                block,
                supported[3 * point : 3 * point + 3],
                number,
                len(nodes),
            )
            own[local] = int(point) not in first_owner
            first_owner.setdefault(int(point), _PointOwner(number, block))
        dofs = (3 * node.patch.nodes[:, None] + np.arange(3)).ravel()
        free = np.repeat(own, 3) & ~supported[dofs]
        shapes.append((dofs[free], rigid[free], number))
        fixed[dofs] = True
    constraints = _independent_rows(np.array(rows).reshape(len(rows), 6 * len(nodes)))
    shared = len(constraints) - sum("rotation about" in warning for warning in warnings)
    if shared > 0:
        warnings.append(
            f"component {component.name}: interfaces share points with each other or with a support; {shared} of their dofs are coupled"
        )
    rails = tuple(
        fit_rail(component.name, interface, measure_patch(mesh, name))
        for name, interface in component.interfaces.items()
        if interface.rail is not None
    )
    return BoundaryBasis(
        tuple(nodes),
        interface_maps,
        rails,
        tuple(shapes),
        np.flatnonzero(fixed),
        np.flatnonzero(supported),
        constraints,
        tuple(warnings),
    )


def _merge_interfaces(
    component: Component, mesh: ComponentMesh, warnings: list[str]
) -> tuple[list[BoundaryNode], dict[str, InterfaceMap]]:
    nodes: list[BoundaryNode] = []
    interface_maps: dict[str, InterfaceMap] = {}
    # rigid patches first: a mean over points that a rigid patch already carries is that patch's own
    # motion
    fixed = [interface for interface in component.interfaces.values() if interface.rail is None]
    ordered = sorted(fixed, key=lambda interface: interface.coupling != "rigid")
    for interface in ordered:
        patch = measure_patch(mesh, interface.name)
        _refuse_point_like(component.name, interface, patch, warnings)
        host = next((i for i, node in enumerate(nodes) if _carries(node, interface, patch)), None)
        if host is None:
            host = len(nodes)
            nodes.append(BoundaryNode(interface.name, patch, interface.coupling))
        else:
            warnings.append(
                f"component {component.name}: interface {interface.name} covers the same points as {nodes[host].name}; merged"
            )
        interface_maps[interface.name] = InterfaceMap(host, Frame(patch.centroid))
    return nodes, interface_maps


def _carries(node: BoundaryNode, interface: Interface, patch: MeshPatch) -> bool:
    if node.coupling == "rigid":
        return (
            bool(np.isin(patch.nodes, node.patch.nodes).all())
            and len(node.patch.undetermined_rotations()) == 0
        )
    return interface.coupling == "average" and np.array_equal(node.patch.nodes, patch.nodes)


def _refuse_point_like(
    component: str, interface: Interface, patch: MeshPatch, warnings: list[str]
) -> None:
    whole = all(
        part.shape == "whole" and not part.face.startswith("set:") for part in interface.patches
    )
    thin = len(patch.undetermined_rotations()) > 0
    if not thin and (whole or patch.facet_count >= MINIMUM_FACETS):
        return
    kind = "a point or a line" if thin else f"{patch.facet_count} facet(s)"
    text = (
        f"interface {interface.name} of component {component} is {kind} of the mesh: in 3D its compliance grows without bound "
        "as the mesh is refined"
    )
    if not interface.allow_singular:
        raise ModelError(
            f"{text}; choose a larger patch or a finer mesh, or set allow_singular = true to keep it"
        )
    warnings.append(f"{text}; kept because allow_singular = true")


def _undetermined_rows(
    component: str, node: BoundaryNode, number: int, count: int, warnings: list[str]
) -> list[FloatArray]:
    rows: list[FloatArray] = []
    for axis in node.patch.undetermined_rotations():
        row = np.zeros(6 * count)
        row[6 * number + 3 : 6 * number + 6] = axis
        rows.append(row)
        direction = ", ".join(f"{value:+.3f}" for value in axis)
        warnings.append(
            f"component {component}: interface {node.name} has no rotation about ({direction}); this rotation is fixed at zero"
        )
    return rows


class _PointOwner(NamedTuple):
    """The first rigid node that carries a mesh point: its number, and ``(3, 6)`` motion of the
    point per unit motion of it.
    """

    number: int
    block: FloatArray


def _shared_rows(
    owner: _PointOwner | None, block: FloatArray, supported: BoolArray, number: int, count: int
) -> list[FloatArray]:
    rows: list[FloatArray] = []
    for direction in range(3):
        row = np.zeros(6 * count)
        row[6 * number : 6 * number + 6] = block[direction]
        if supported[direction]:
            rows.append(row)
        elif owner is not None and owner.number != number:
            row[6 * owner.number : 6 * owner.number + 6] -= owner.block[direction]
            rows.append(row)
    return rows


def _independent_rows(rows: FloatArray) -> FloatArray:
    if not len(rows):
        return rows
    # rotations weigh by the arms in the rows themselves; scale columns so that rank is judged
    # without units
    scale = np.linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, vectors = np.linalg.svd(rows / scale, full_matrices=False)
    kept = vectors[singular > DEPENDENCE_TOLERANCE * singular[0]] * scale
    return np.asarray(np.linalg.qr(kept.T)[0].T)


def boundary_labels(basis: BoundaryBasis) -> list[tuple[str, str]]:
    """Labels of the boundary dofs in order."""
    nodes = [(node.name, dof) for node in basis.nodes for dof in DOF_NAMES]
    control_points = [
        (f"{rail.name}[{i}]", i, rail) for rail in basis.rails for i in range(len(rail.points))
    ]
    return nodes + [
        (name, dof)
        for name, _, rail in control_points
        for dof in (*DIRECTIONS, DOF_NAMES[3 + rail.axis])
    ]
