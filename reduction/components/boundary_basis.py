"""From interfaces to boundary dofs: which nodes are fixed, which means are prescribed, and which
dofs interfaces share.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, BoolArray, FloatArray, Frame
from headstock.geometry.parts.components import Component, Interface, Support
from headstock.geometry.parts.patches import Outline, in_plane_axes, patch_outline
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.elements.regions import are_whole_faces
from headstock.meshing.elements.surface import extract_surface, find_facets
from headstock.meshing.elements.topology import cell_order
from headstock.reduction.components.interface_patches import MeshPatch, measure_patch
from headstock.reduction.components.rail_fits import RailFit, fit_rail
from headstock.reduction.components.supports import HeldPoints, hold_points
from headstock.reduction.patch_shapes import (
    PatchShapes,
    count_patch_shapes,
    list_degrees,
    shape_fields,
)
from headstock.reduction.rails import CONTROL_POINT_DOFS, ControlPoint
from headstock.reduction.superelement import InterfaceMap
from headstock.solvers.errors import ModelError

MINIMUM_FACETS = 4
DEPENDENCE_TOLERANCE = 1e-10
FLATNESS = 1e-6  # of a flexible patch, over its size
CONDITION_LIMIT = 1e6  # of its shapes on the mesh, scaled alike


@dataclass(frozen=True, eq=False)
class _BoundaryNode:
    """One 6-dof boundary node: the patch that carries it, how it is coupled, and the deformation
    shapes it has besides.
    """

    name: str
    patch: MeshPatch
    coupling: str
    flexible: int = 0
    shapes: PatchShapes | None = None

    def columns(self, number: int) -> IntArray:
        """Return the boundary dofs of the node with this number, rigid ones first."""
        rigid = 6 * number + np.arange(6)
        if self.shapes is None:
            return rigid
        return np.concatenate([rigid, self.shapes.first + np.arange(self.shapes.count)])

    def fields(self) -> FloatArray:
        """Return the displacement ``(3 n, 6 + count)`` of its points per unit of its dofs."""
        rigid = self.patch.rigid_displacements()
        if self.shapes is None:
            return rigid
        return np.hstack([rigid, shape_fields(self.shapes, self.patch.points)])

    def mean_operator(self) -> FloatArray:
        """Return the matrix C ``(3 n, 6 + count)`` whose ``C^T u`` are the dofs of the field that
        fits the patch best.
        """
        if self.shapes is None:
            return self.patch.average_operator()
        fields, weighted = self.fields(), self.weighted_fields()
        return scipy.linalg.solve(fields.T @ weighted, weighted.T, assume_a="pos").T

    def weighted_fields(self) -> FloatArray:
        """Return the fields integrated against the shape functions of the patch."""
        fields = self.fields()
        weighted = np.zeros_like(fields)
        for axis in range(3):
            weighted[axis::3] = self.patch.weights @ fields[axis::3]
        return weighted


@dataclass(frozen=True, eq=False)
class BoundaryBasis:
    """Boundary dofs of a component in terms of its mesh points (all ranks hold the same).

    Attributes:
        nodes: Boundary nodes in dof order.
        interface_maps: Every fixed interface by name.
        rails: Interfaces that carriages slide along; their control points follow the nodes in dof
            order.
        size: Number of boundary dofs.
        shapes: ``(3 n_points, size)`` sparse-in-spirit: mesh dofs, values, and boundary dofs of
            rigid patches.
        fixed: Mesh dofs in rigid patches or supports along axes, rising.
        held: What supports fix.
        constraints: ``(m, size)`` orthonormal rows that must vanish: shared nodes and
            undetermined rotations.
        warnings: What was merged, dropped or disabled.
    """

    nodes: tuple[_BoundaryNode, ...]
    interface_maps: dict[str, InterfaceMap]
    rails: tuple[RailFit, ...]
    size: int
    shapes: tuple[tuple[IntArray, FloatArray, IntArray], ...]
    fixed: IntArray
    held: HeldPoints
    constraints: FloatArray
    warnings: tuple[str, ...]

    @property
    def control_points(self) -> tuple[ControlPoint, ...]:
        """Control points of all rails in dof order."""
        return tuple(ControlPoint(point, rail.axis) for rail in self.rails for point in rail.points)


def build_boundary_basis(
    component: Component, mesh: ComponentMesh, supports: Sequence[Support]
) -> BoundaryBasis:
    """Return the boundary nodes, fixed dofs and dependence rows of a component's interfaces and
    supports.

    Args:
        mesh: Its mesh, with a patch per interface and the groups of patches of each support.
        supports: Those of this component; each fixes some directions of the points of its patch.

    Raises:
        ModelError: An interface is point- or line-like and not forced.
    """
    warnings: list[str] = []
    nodes, interface_maps = _merge_interfaces(component, mesh, warnings)
    size = 6 * len(nodes) + _rail_dofs(component)
    size += sum(one.count for one in {node.shapes for node in nodes} if one is not None)
    held = hold_points(component, mesh, supports)
    warnings += held.warnings
    supported = np.zeros(3 * len(mesh.points), dtype=bool)
    supported[held.dofs] = True
    fixed, rows, shapes = supported.copy(), [], []
    first_owner: dict[int, _PointOwner] = {}
    for number, node in enumerate(nodes):
        rows += _undetermined_rows(component.name, node, number, size, warnings)
        if node.coupling != "rigid":
            continue
        fields, columns = node.fields(), node.columns(number)
        sole = np.ones(len(node.patch.nodes), dtype=bool)
        for local, point in enumerate(node.patch.nodes):
            here = _PointOwner(columns, fields[3 * local : 3 * local + 3])
            rows += _shared_rows(
                first_owner.get(int(point)), here, supported[3 * point : 3 * point + 3], size
            )
            sole[local] = int(point) not in first_owner
            first_owner.setdefault(int(point), here)
        dofs = (3 * node.patch.nodes[:, None] + np.arange(3)).ravel()
        free = np.repeat(sole, 3) & ~supported[dofs]
        shapes.append((dofs[free], fields[free], columns))
        fixed[dofs] = True
    constraints = _independent_rows(np.array(rows).reshape(len(rows), size))
    shared = len(constraints) - sum("rotation about" in warning for warning in warnings)
    if shared > 0:
        warnings.append(
            f"component {component.name}: interfaces share points with each other or with a support; {shared} of their dofs are coupled"
        )
    rails = tuple(
        fit_rail(
            component.name,
            interface,
            measure_patch(mesh, name),
            order=cell_order(mesh.kind),
            own_mesh=not isinstance(component.solid, MeshFile),
        )
        for name, interface in component.interfaces.items()
        if interface.rail is not None
    )
    return BoundaryBasis(
        tuple(nodes),
        interface_maps,
        rails,
        size,
        tuple(shapes),
        np.flatnonzero(fixed),
        held,
        constraints,
        tuple(warnings),
    )


def _merge_interfaces(
    component: Component, mesh: ComponentMesh, warnings: list[str]
) -> tuple[list[_BoundaryNode], dict[str, InterfaceMap]]:
    nodes: list[_BoundaryNode] = []
    interface_maps: dict[str, InterfaceMap] = {}
    # rigid patches first: a mean over points that a rigid patch already carries is that patch's own
    # motion
    fixed = [interface for interface in component.interfaces.values() if interface.rail is None]
    ordered = sorted(
        fixed, key=lambda interface: (interface.coupling != "rigid", interface.flexible > 0)
    )
    hosts: dict[str, int] = {}
    for interface in ordered:
        patch = measure_patch(mesh, interface.name)
        _refuse_point_like(component.name, interface, mesh, patch, warnings)
        host = next((i for i, node in enumerate(nodes) if _carries(node, interface, patch)), None)
        if host is None:
            host = len(nodes)
            nodes.append(
                _BoundaryNode(interface.name, patch, interface.coupling, interface.flexible)
            )
        else:
            warnings.append(
                f"component {component.name}: interface {interface.name} covers the same points as {nodes[host].name}; merged"
            )
        interface_maps[interface.name] = InterfaceMap(host, Frame(patch.centroid))
        hosts[interface.name] = host
    first = 6 * len(nodes) + _rail_dofs(component)
    for number, node in enumerate(nodes):
        if node.flexible:
            shapes = _lay_out_shapes(component, node, first)
            first += shapes.count
            nodes[number] = dataclasses.replace(node, shapes=shapes)
            _require_distinct_shapes(component.name, nodes[number])
    return nodes, {
        name: dataclasses.replace(entry, shapes=nodes[hosts[name]].shapes)
        for name, entry in interface_maps.items()
    }


def _rail_dofs(component: Component) -> int:
    rails = [entry.rail for entry in component.interfaces.values() if entry.rail is not None]
    return CONTROL_POINT_DOFS * sum(rail.control_points for rail in rails)


def _lay_out_shapes(component: Component, node: _BoundaryNode, first: int) -> PatchShapes:
    """Return the deformation shapes of a flexible interface over the area of its patch: a
    rectangle, disk or ring as written, or the rectangle around it as the mesh has it.

    Args:
        first: Where the dofs of its shapes begin.

    Raises:
        ModelError: Its patch is not flat and across an axis of the component.
    """
    points, (patch, *others) = node.patch.points, component.interfaces[node.name].patches
    low, high = points.min(axis=0), points.max(axis=0)
    extents = high - low
    flat = np.flatnonzero(extents <= FLATNESS * extents.max())
    if len(flat) != 1 or others:
        raise ModelError(
            f"interface {node.name} of component {component.name} is flexible but not one flat patch "
            'across x, y or z; write coupling = "rigid" or "average", or a flat patch'
        )
    normal = int(flat[0])
    axes = list(in_plane_axes(normal))
    center, outline = 0.5 * (low + high), patch_outline(component.solid, patch)
    if outline is not None and (outline.hole is not None or patch.shape == "rect"):
        center[axes] = np.array(patch.center)[axes]
    else:
        # as the mesh has it: other faces, and strips that end with theirs
        outline = Outline(0.5 * extents[axes])
    count = count_patch_shapes(list_degrees(outline, node.flexible))
    return PatchShapes(
        center,
        normal,
        outline.half_lengths,
        count,
        first,
        node.coupling == "rigid",
        outline.hole,
    )


def _require_distinct_shapes(component: str, node: _BoundaryNode) -> None:
    fields = node.fields()
    gram = fields.T @ node.weighted_fields()
    scale = 1.0 / np.sqrt(np.maximum(gram.diagonal(), np.finfo(float).tiny))
    values = np.linalg.eigvalsh(scale[:, None] * gram * scale)
    if not values[0] * CONDITION_LIMIT > values[-1]:
        raise ModelError(
            f"component {component}: the mesh has too few points on interface {node.name} to tell its "
            f"{fields.shape[1] - 6} deformation shapes apart, or its patch is a thin frame; take smaller "
            "elements, or a smaller number for flexible"
        )


def _carries(node: _BoundaryNode, interface: Interface, patch: MeshPatch) -> bool:
    if node.flexible and (node.flexible, node.coupling) != (interface.flexible, interface.coupling):
        return False
    if node.coupling == "rigid" and not node.flexible:
        return (
            bool(np.isin(patch.nodes, node.patch.nodes).all())
            and len(node.patch.undetermined_rotations()) == 0
        )
    alike = (node.flexible, node.coupling) == (interface.flexible, interface.coupling)
    return alike and np.array_equal(node.patch.nodes, patch.nodes)


def _refuse_point_like(
    component: str,
    interface: Interface,
    mesh: ComponentMesh,
    patch: MeshPatch,
    warnings: list[str],
) -> None:
    whole = all(
        part.shape == "whole" and not part.face.startswith("set:") for part in interface.patches
    )
    thin = len(patch.undetermined_rotations()) > 0
    if not thin and (whole or patch.facet_count >= MINIMUM_FACETS):
        return
    if not thin:
        surface = extract_surface(mesh.cells, mesh.kind)
        chosen = find_facets(surface, mesh.patches[interface.name])
        if are_whole_faces(mesh.points, surface, chosen):
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
    component: str, node: _BoundaryNode, number: int, size: int, warnings: list[str]
) -> list[FloatArray]:
    rows: list[FloatArray] = []
    for axis in node.patch.undetermined_rotations():
        row = np.zeros(size)
        row[6 * number + 3 : 6 * number + 6] = axis
        rows.append(row)
        direction = ", ".join(f"{value:+.3f}" for value in axis)
        warnings.append(
            f"component {component}: interface {node.name} has no rotation about ({direction}); this rotation is fixed at zero"
        )
    return rows


class _PointOwner(NamedTuple):
    """A rigid node that carries a mesh point: its boundary dofs ``(k,)``, and ``(3, k)`` motion of
    the point per unit of them.
    """

    columns: IntArray
    block: FloatArray


def _shared_rows(
    owner: _PointOwner | None, here: _PointOwner, supported: BoolArray, size: int
) -> list[FloatArray]:
    rows: list[FloatArray] = []
    for direction in range(3):
        row = np.zeros(size)
        row[here.columns] = here.block[direction]
        if supported[direction]:
            rows.append(row)
        elif owner is not None:
            row[owner.columns] -= owner.block[direction]
            rows.append(row)
    return rows


def _independent_rows(rows: FloatArray) -> FloatArray:
    if not len(rows):
        return rows
    # rotations weigh by the arms in the rows themselves; scale columns so that rank is measured
    # without units
    scale = np.linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, vectors = np.linalg.svd(rows / scale, full_matrices=False)
    kept = vectors[singular > DEPENDENCE_TOLERANCE * singular[0]] * scale
    return np.linalg.qr(kept.T)[0].T


def boundary_labels(basis: BoundaryBasis) -> list[tuple[str, str]]:
    """Return the labels of the boundary dofs in order."""
    nodes = [(node.name, dof) for node in basis.nodes for dof in DOF_NAMES]
    control_points = [
        (f"{rail.name}[{i}]", i, rail) for rail in basis.rails for i in range(len(rail.points))
    ]
    labels = nodes + [
        (name, dof)
        for name, _, rail in control_points
        for dof in (*DIRECTIONS, DOF_NAMES[3 + rail.axis])
    ]
    return labels + [
        (node.name, f"shape {number + 1}")
        for node in basis.nodes
        if node.shapes is not None
        for number in range(node.shapes.count)
    ]
