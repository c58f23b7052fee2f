"""What is seen at probes in an elastic component: rows over its reduced dofs, the static share of
the modes left out, what recovery changes, and where stresses are singular.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Probe
from headstock.geometry.parts.components import (
    EDGE_GROUP,
    NORMAL,
    SUPPORT_GROUP,
    Component,
    Material,
    Support,
)
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.elements.surface import (
    MeshSurface,
    corner_normals,
    extract_surface,
    match_facets,
)
from headstock.reduction.components.nodal_loads import scatter_rows
from headstock.reduction.superelement import ProbeLoad, ProbeRows
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.stress_recovery import PointRows, find_point_rows
from headstock.solvers.errors import ModelError
from headstock.solvers.recovery.discretisation_error import cut_neighbourhood, recover_at_nodes

SEEN = 9  # displacement x y z, stress xx yy zz xy xz yz
MOVED = 3
# cosine of the angle between the facets of one face of the mesh; beyond it the surface has an edge
SAME_FACE = 0.7
INWARD = 0.1  # of a facet's size: how far one must rise above its neighbour at a re-entrant edge


@dataclass(frozen=True)
class ProbePlace:
    """Position of a probe in a mesh.

    Attributes:
        rows: What is seen there.
        strain_reach: Size of the largest of its cells over Young's modulus [m/Pa].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    rows: PointRows
    strain_reach: float
    singular: str = ""


def find_probe_places(
    component: Component,
    mesh: ComponentMesh,
    supports: Sequence[Support],
    probes: Sequence[Probe],
) -> dict[str, ProbePlace]:
    """Find where the probes of a component are in its mesh.

    Raises:
        ModelError: A probe lies outside the mesh.
    """
    if not probes:
        return {}
    edges = _find_singular_edges(component, mesh, supports)
    places = {}
    for probe in probes:
        try:
            rows = find_point_rows(mesh, component.material, np.array(probe.position))
        except ModelError as error:
            raise ModelError(f"probe {probe.name!r}: {error}") from error
        near = np.unique(mesh.cells[rows.cells])
        widths = np.ptp(mesh.points[mesh.cells[rows.cells]], axis=1)
        size = float(np.sqrt((widths**2).mean(axis=1).max()))
        names = [name for name, nodes in edges.items() if np.isin(near, nodes).any()]
        places[probe.name] = ProbePlace(
            rows, size / component.material.youngs_modulus, " and ".join(names)
        )
    return places


def _find_singular_edges(
    component: Component, mesh: ComponentMesh, supports: Sequence[Support]
) -> dict[str, IntArray]:
    """Find the mesh points at which stresses are singular, by what makes them so: rims of rigid
    interfaces and of supports, and re-entrant edges.

    A support that holds a flat face along its normal alone is a plane of symmetry for the faces
    next to it, where they are square to it.

    Source: Williams (1952), J. Appl. Mech. 19, 526-528, stress singularities at corners.
    """
    surface = extract_surface(mesh.cells, mesh.kind)
    normals = corner_normals(mesh.points, surface)
    edges = {"a re-entrant edge": _reentrant_nodes(mesh, surface, normals)}
    held = {f"{SUPPORT_GROUP}{support.name}": support for support in supports}
    for name, facets in mesh.patches.items():
        if name.endswith(EDGE_GROUP):
            continue
        interface, support = component.interfaces.get(name), held.get(name)
        if support is not None and support.edge:
            edge = mesh.patches[f"{name}{EDGE_GROUP}"]
            edges[f"the edge of support {support.name!r}"] = np.intersect1d(facets, edge)
            continue
        rigid = interface is not None and interface.rail is None and interface.coupling == "rigid"
        if support is None and not rigid:
            continue
        within, _ = match_facets(surface, facets)
        outside = np.delete(np.arange(len(surface.facets)), within)
        if support is not None and _slides(support, normals[within]):
            outside = outside[(normals[outside] @ normals[within].mean(axis=0)) > SAME_FACE]
        what = f"support {support.name!r}" if support is not None else f"rigid interface {name!r}"
        edges[f"the rim of {what}"] = np.intersect1d(facets, surface.facets[outside])
    return {name: nodes for name, nodes in edges.items() if len(nodes)}


def _slides(support: Support, normals: FloatArray) -> bool:
    """Return whether a support fixes only motion along the normals ``(n, 3)`` of a flat face."""
    if np.abs(normals - normals[0]).max(initial=0.0) > 1e-6:
        return all(direction == NORMAL for direction in support.directions)
    units = [
        np.eye(3)["xyz".index(direction)] if isinstance(direction, str) else np.array(direction)
        for direction in support.directions
        if direction != NORMAL
    ]
    return all(
        abs(unit @ normals[0]) > (1.0 - 1e-6) * float(np.linalg.norm(unit)) for unit in units
    )


def _reentrant_nodes(mesh: ComponentMesh, surface: MeshSurface, normals: FloatArray) -> IntArray:
    """Return corner points of edges where the surface turns inwards by more than 45 degrees."""
    corners = surface.facets[:, : surface.corners]
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    keys = np.sort(ends.reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(corners)), surface.corners)
    edges, which = np.unique(keys, axis=0, return_inverse=True)
    pairs = coo_array((np.ones(len(which)), (which.ravel(), np.arange(len(which))))).tocsr()
    two = np.flatnonzero(np.diff(pairs.indptr) == 2)
    sides = owners[pairs.indices[pairs.indptr[two][:, None] + np.arange(2)]]
    middles = mesh.points[corners].mean(axis=1)
    over = middles[sides[:, 1]] - mesh.points[edges[two]].mean(axis=1)
    rise = np.einsum("ij,ij->i", normals[sides[:, 0]], over)
    turned = np.einsum("ij,ij->i", normals[sides[:, 0]], normals[sides[:, 1]]) < SAME_FACE
    inward = turned & (rise > INWARD * np.linalg.norm(over, axis=1))
    nodes: IntArray = np.unique(edges[two[inward]])
    return nodes


@dataclass(frozen=True, eq=False)
class _WatchedDofs:
    """Outputs of probes for reduced dofs and loads, nine rows for each probe, one after the other.

    Attributes:
        values: ``(9 p, n)`` per reduced dof.
        inertia: ``(9 p, n_b)`` static share of the modes left out per boundary acceleration.
        direct: ``(9 p, k)`` of loads with boundary and modal dofs fixed.
        moved: ``(3 n_owned, 9 p)`` response to the loads that do the work of what is seen, with
            boundary and modal dofs fixed.
    """

    values: FloatArray
    inertia: FloatArray
    direct: FloatArray
    moved: FloatArray


def watch_dofs(
    solver: ConstrainedSolver,
    places: Mapping[str, ProbePlace],
    basis: tuple[FloatArray, FloatArray],
    eigenvalues: FloatArray,
    particular: FloatArray,
) -> _WatchedDofs:
    """Return what probes see, by the responses to unit loads that do the work of what they see.

    With ``z`` the response to such a load ``l`` with interfaces fixed, less its share along the modes
    kept, the modes left out add ``omega^2 z^T M psi q_b`` at rest to what is seen: one solve per
    probe and row instead of one per boundary dof.

    Args:
        solver: With the interfaces fixed; collective.
        basis: Constraint modes ``(3 n_owned, n_b)`` and fixed-interface modes ``(3 n_owned, m)``.
        eigenvalues: ``(m,)`` of the modes [rad^2/s^2].
        particular: ``(3 n_owned, k)`` responses to loads with boundary and modal dofs fixed.

    Source: MacNeal (1971), Computers and Structures 1, 581-601, residual flexibility; Betti for the
    exchange of loads.
    """
    psi, shapes = basis
    operators = solver.operators
    rows_of = [probe_place.rows for probe_place in places.values()]
    by_node = [one.rows.reshape(SEEN, len(one.nodes), 3).transpose(1, 2, 0) for one in rows_of]
    blocks = [
        scatter_rows(values, one.nodes, operators).reshape(-1, SEEN)
        for values, one in zip(by_node, rows_of, strict=True)
    ]
    loads = np.hstack([np.zeros((len(psi), 0)), *blocks])
    observed = [solver.product(loads, fields) for fields in (psi, shapes, particular)]
    inertia: FloatArray = np.zeros((loads.shape[1], psi.shape[1]))
    responses: FloatArray = loads
    if loads.shape[1]:
        responses = solver.solve(loads) - shapes @ (observed[1] / eigenvalues).T
        if operators.scalar_mass is not None:
            inertia = solver.product(responses, operators.apply_mass(psi))
    return _WatchedDofs(np.hstack(observed[:2]), inertia, observed[2], responses)


def read_smoothing(
    mesh: ComponentMesh, material: Material, places: Mapping[str, ProbePlace], fields: FloatArray
) -> dict[str, FloatArray]:
    """Return what recovery changes in the stresses of displacement fields ``(s, 6, k)`` at each
    probe and at the nodes of its cells, which count as one together.

    The change at the probe alone is sometimes small by chance: that of its cells is kept with it.

    Args:
        fields: ``(3 n_points, k)`` displacement of the mesh points [m].
    """
    return {
        name: _read_change(mesh, material, probe_place.rows, fields)
        for name, probe_place in places.items()
    }


def _read_change(
    mesh: ComponentMesh, material: Material, rows: PointRows, fields: FloatArray
) -> FloatArray:
    part, points = cut_neighbourhood(mesh, rows.cells)
    moved = fields.reshape(len(mesh.points), 3, -1)[points].reshape(3 * len(points), -1)
    smooth = recover_at_nodes(part, material, moved, len(rows.cells))
    at_probe = rows.read(smooth[np.searchsorted(points, rows.nodes)]) - rows.apply(fields)[MOVED:]
    nodes = np.unique(part.cells[: len(rows.cells)])
    plain = np.array(
        [find_point_rows(part, material, part.points[node]).apply(moved)[MOVED:] for node in nodes]
    )
    around = (smooth[nodes] - plain) / np.sqrt(len(nodes))
    return np.concatenate([at_probe[None], around])


def gather_probes(
    places: Mapping[str, ProbePlace],
    watched: _WatchedDofs,
    loads: Sequence[str],
    smoothing: Mapping[str, FloatArray] | None,
    missing: FloatArray | None,
) -> dict[str, ProbeRows]:
    """Return the probes of a superelement of ``n`` dofs and ``k`` loads.

    Args:
        smoothing: By probe, ``(s, 6, n + k)`` what recovery changes in the stresses of dofs and
            loads; None where nobody knows.
        missing: ``(9 p, n + k)`` energy products of the errors of unit responses at the probes with
            those of dofs and loads; None where nobody knows.
    """
    count, gathered = watched.values.shape[1], {}
    for number, (name, probe_place) in enumerate(places.items()):
        rows = slice(SEEN * number, SEEN * (number + 1))
        smooth = None if smoothing is None else smoothing[name]
        energy = None if missing is None else missing[rows]
        gathered[name] = ProbeRows(
            values=watched.values[rows],
            inertia=watched.inertia[rows],
            smoothing=None if smooth is None else smooth[..., :count],
            missing=None if energy is None else energy[:, :count],
            loads={
                load: ProbeLoad(
                    watched.direct[rows, column],
                    None if smooth is None else smooth[..., count + column],
                    None if energy is None else energy[:, count + column],
                )
                for column, load in enumerate(loads)
            },
            strain_reach=probe_place.strain_reach,
            singular=probe_place.singular,
        )
    return gathered
