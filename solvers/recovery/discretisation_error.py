"""How much strain energy finite elements miss: element stresses compared with smooth ones recovered
from them.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.elements.quadratic import straight_cells
from headstock.meshing.elements.quality import PLACES, facet_moments, facet_tables
from headstock.meshing.elements.surface import MeshSurface, extract_surface
from headstock.meshing.elements.topology import (
    FACETS,
    Family,
    cell_family,
    cell_order,
    cell_shape_functions,
)
from headstock.solvers.recovery.free_sides import FreeSides, find_free_sides
from headstock.solvers.recovery.patch_recovery import (
    COMPONENTS,
    StressArray,
    corner_patches,
    gauss_places,
    local_motions,
    recover_stresses,
    stress_operators,
)
from headstock.solvers.stresses import pack_tensor, true_stresses

BLOCK_VALUES = 500_000  # of stresses and displacements at a time: they stay in the cache
# places where stresses are better than elsewhere in a cell, and rules for the square of what
# recovery changes
SAMPLE_DEGREES = {("tet", 1): 1, ("tet", 2): 2, ("hex", 1): 1, ("hex", 2): 3}
ENERGY_DEGREES = {("tet", 1): 2, ("tet", 2): 4, ("hex", 1): 3, ("hex", 2): 5}
# What estimates are multiplied by so that they cover the true errors of 95 numbers in 100, fitted
# on parts of `validate coverage` and tried on others; second-order hexahedra that fill a wall alone
# need more than those with neighbours across.
SAFETY: dict[tuple[Family, int], float] = {
    ("tet", 1): 1.55,
    ("tet", 2): 1.55,
    ("hex", 1): 1.8,
    ("hex", 2): 1.4,
}
SINGLE_SAFETY = 1.8
# Where the truth lies relative to an estimate: around this share of it, and 95 numbers in 100 so
# much of it on either side, fitted on parts of the same suites. Where a little more covers the
# truth, it lies further off in proportion; where much more does, it may lie anywhere below that.
TRUTH: dict[tuple[Family, int], tuple[float, float]] = {
    ("tet", 1): (0.85, 0.35),
    ("tet", 2): (1.0, 0.4),
    ("hex", 1): (0.85, 0.35),
    ("hex", 2): (0.85, 0.3),
}
LITTLE_MORE = 1.3
# Single hexahedra nearly as thick as long, this share of their longest side: estimates of torsion
# come out at a third
STOUT, STOUT_SAFETY = 0.625, 3.0
# Flat tetrahedra in walls that they are several times wider than: estimates fall with their width
# over the thickness
WIDE, WIDEST = 3.0, 3.0
# Single hexahedra across a bar, as thick as this share of their longest side: their stresses look
# smooth whatever they miss
THICK = 0.9
UNSEEN_SHARE = 0.5  # of the volume


@dataclass(frozen=True, eq=False)
class ShapeChange:
    """Changes of stiffness and mass of displacement fields where the curved faces of the part
    lie and not the mesh's facets.

    Attributes:
        stiffness: ``(k, k)`` symmetric [J for fields in m].
        mass: ``(k, k)`` symmetric [kg m^2 for fields in m].
    """

    stiffness: FloatArray
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class MeshErrors:
    """Errors that a mesh makes in displacement fields.

    Attributes:
        missing_energy: ``(k, k)`` energy products of their discretisation errors [J for fields in
            m].
        shape: What the part's curved faces change; None where nobody knows where they lie.
        left_out: What small features change that the mesh lacks; None where it lacks none.
    """

    missing_energy: FloatArray
    shape: ShapeChange | None
    left_out: ShapeChange | None = None


def mesh_safety(mesh: ComponentMesh, surface: MeshSurface) -> float:
    """Return what estimates of a mesh with a surface are to be multiplied by to cover 95 % of true
    errors.
    """
    base = SAFETY[cell_family(mesh.kind), cell_order(mesh.kind)]
    if cell_family(mesh.kind) == "hex":
        spans, single = _find_single_spans(mesh)
        stout = single & (spans >= STOUT * spans.max(axis=1, keepdims=True))
        if _fill_most(spans, stout):
            return STOUT_SAFETY
        return SINGLE_SAFETY if _fill_most(spans, single) else base
    return base * float(np.clip(_find_flatness(mesh, surface) / WIDE, 1.0, WIDEST))


def locate_truth(mesh: ComponentMesh, safety: float) -> tuple[float, float]:
    """Return the share of an estimate that the truth lies around, and how far of it on either side
    in 95 of 100 numbers.

    Args:
        safety: What covers its true errors.
    """
    key = cell_family(mesh.kind), cell_order(mesh.kind)
    (centre, spread), more = TRUTH[key], safety / SAFETY[key]
    return centre, spread * more if more <= LITTLE_MORE else safety - centre


def detects_errors(mesh: ComponentMesh) -> bool:
    """Return whether recovery can detect errors: not in a bar with a single thick hexahedron
    across, which has no neighbours to learn from.

    A polynomial through the samples of a row of cells is that of the cells themselves across the
    row: the warping of a twisted bar goes unseen. A wall that is thin compared with its cells has
    little of it.
    """
    if cell_family(mesh.kind) == "tet":
        return True
    spans, single = _find_single_spans(mesh)
    thick = single & (
        (spans >= THICK * spans.max(axis=1, keepdims=True))
        | (single.sum(axis=1, keepdims=True) >= 4)
    )
    return not _fill_most(spans, thick)


def find_resolved_step(mesh: ComponentMesh) -> float:
    """Find the size of the elements over the present one with which recovery sees what they miss; 1
    where it does already.

    Single tetrahedra through a wall, somewhat wider than it is thick, miss up to twice as much of its
    shear and torsion as either fit shows. Sheets, which are far thinner, have little of that.
    """
    if mesh.kind != "tet10":
        return 1.0
    surface, corners = extract_surface(mesh.cells, mesh.kind), mesh.cells[:, :4]
    at_surface = np.zeros(len(mesh.points), dtype=bool)
    at_surface[surface.facets[:, :3]] = True
    single, sides = at_surface[corners].all(axis=1), find_free_sides(mesh)
    unseen = single if sides is None else single & ~sides.alone[corners].all(axis=1)
    edges = mesh.points[corners[:, 1:]] - mesh.points[corners[:, :1]]
    volumes = np.abs(np.linalg.det(edges))
    step = 1.0 / _find_flatness(mesh, surface)
    if volumes[unseen].sum() <= UNSEEN_SHARE * volumes.sum() or step < 1.0 / WIDE:
        return 1.0
    return min(step, 1.0)


def _find_flatness(mesh: ComponentMesh, surface: MeshSurface) -> float:
    """Find the mean width of tetrahedra at a mesh's surface over its walls' thickness."""
    areas, _ = facet_moments(mesh.points, surface.facets)
    # an even triangle of a side has 0.43 times its square
    return float(np.sqrt(2.3 * areas.mean()) * areas.sum() / (2.0 * mesh.quality.volume))


def _fill_most(spans: FloatArray, chosen: NDArray[np.bool_]) -> bool:
    """Return whether hexahedra that are chosen by one of their faces ``(n, 6)`` fill more of the
    volume than may go unseen, by their lengths ``(n, 6)``.
    """
    volumes = spans.prod(axis=1)
    return float(volumes[chosen.any(axis=1)].sum()) > UNSEEN_SHARE * float(volumes.sum())


def _find_single_spans(mesh: ComponentMesh) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Find the lengths of hexahedra through each of their six faces, and where no neighbour is on
    either side of it, ``(n, 6)`` each.
    """
    faces = np.array(FACETS["hex"])
    opposite = np.array(
        [[not set(one) & set(other) for other in FACETS["hex"]] for one in FACETS["hex"]]
    ).argmax(axis=1)
    corners = np.sort(mesh.cells[:, faces], axis=2).reshape(-1, 4)
    _, inverse, counts = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    bare = (counts[inverse.ravel()] == 1).reshape(-1, 6)
    middles = mesh.points[mesh.cells[:, faces]].mean(axis=2)
    spans = np.linalg.norm(middles - middles[:, opposite], axis=2)
    return spans, bare & bare[:, opposite]


def estimate_mesh_errors(
    mesh: ComponentMesh,
    material: Material,
    displacement: FloatArray,
    weights: FloatArray | None = None,
    *,
    counted: int | None = None,
    sides: FreeSides | None = None,
) -> MeshErrors:
    """Return the energy products of the discretisation errors of displacement fields, and what the
    part's true surface changes.

    For a field that combines them with weights q, ``q^T E q`` estimates the squared energy norm of
    its error: what the compliance under its load is too small by, and by what ``omega^2`` of a
    mass-normalised mode is too large. Energies and masses change by their densities at the surface
    times the volume between the mesh's facets and the part's faces, to first order in that.

    Args:
        displacement: ``(3 n_points, k)`` of the mesh points [m].
        weights: ``(n_cells,)`` what the energies of cells are multiplied by; None for 1.
        counted: Number of leading cells whose energies count; the others help to recover stresses.
            None for all.
        sides: Where single tetrahedra fill the part, and its free sides there; None for none.

    Returns:
        Symmetric matrices; ``missing_energy`` is positive semidefinite.

    Source: Zienkiewicz and Zhu (1987), Int. J. Numer. Meth. Engng. 24, 337-357; Strang and Fix
    (1973), ch. 6, for eigenvalues. Choi
        and Kim (2005), Structural Sensitivity Analysis and Optimization 1, ch. 6, for moved
        boundaries. Sokolowski and Zochowski (1999), SIAM J. Control Optim. 37, 1251-1272, for small
        holes.
    """
    count = displacement.shape[1]
    if count == 0:
        nothing = np.zeros((0, 0))
        none = ShapeChange(nothing, nothing)
        return MeshErrors(nothing, none, None if mesh.missing is None else none)
    taken, smooth = _recover(mesh, material, displacement, counted, sides)
    energy = np.zeros((count, count))
    for _, rows in _stress_changes(
        mesh, material, displacement, taken, smooth, weights=weights, counted=counted
    ):
        flat = rows.reshape(-1, count)
        energy += flat.T @ flat
    return MeshErrors(
        0.5 * (energy + energy.T),
        _shape_change(mesh, material, displacement, smooth),
        _feature_change(mesh, material, displacement, smooth),
    )


def estimate_cell_errors(
    mesh: ComponentMesh,
    material: Material,
    displacement: FloatArray,
    weights: FloatArray | None = None,
    sides: FreeSides | None = None,
) -> FloatArray:
    """Return the squared energy norms ``(n_cells, k)`` of the discretisation errors of displacement
    fields in each cell, see ``estimate_mesh_errors``: their sums are the diagonal of its
    ``missing_energy``.

    Args:
        displacement: ``(3 n_points, k)`` of the mesh points [m].
        weights: ``(n_cells,)`` what the energies of cells are multiplied by; None for 1.
        sides: Where single tetrahedra fill the part, and its free sides there; None for none.
    """
    taken, smooth = _recover(mesh, material, displacement, None, sides)
    energies = np.zeros((len(mesh.cells), displacement.shape[1]))
    for cells, rows in _stress_changes(
        mesh, material, displacement, taken, smooth, weights=weights, counted=None
    ):
        squares = np.square(rows, dtype=float).reshape(len(cells), -1, displacement.shape[1])
        energies[cells] = squares.sum(axis=1)
    return energies


def cut_neighbourhood(mesh: ComponentMesh, cells: IntArray) -> tuple[ComponentMesh, IntArray]:
    """Return the part of a mesh that recovery at the nodes of some cells needs, those cells first,
    and the mesh points that it has.

    Args:
        cells: ``(c,)``.
    """
    samples, _ = gauss_places(
        mesh.kind, SAMPLE_DEGREES[cell_family(mesh.kind), cell_order(mesh.kind)]
    )
    around = corner_patches(mesh, len(samples)).around(cells)
    kept = np.concatenate([cells, np.setdiff1d(around, cells)])
    points: IntArray = np.unique(mesh.cells[kept])
    part = dataclasses.replace(
        mesh,
        points=mesh.points[points],
        cells=np.searchsorted(points, mesh.cells[kept]),
        patches={},
        gaps=None,
        missing=None,
    )
    return part, points


def recover_at_nodes(
    part: ComponentMesh, material: Material, displacement: FloatArray, counted: int
) -> FloatArray:
    """Return the recovered stresses ``(n_points, 6, k)`` xx yy zz xy xz yz [Pa] of displacement
    fields at the nodes of the leading cells; of no meaning at the others.

    Args:
        part: Those cells and their neighbours, as ``cut_neighbourhood`` finds them.
        displacement: ``(3 n_points, k)`` of the part's points [m].
        counted: Number of those cells.
    """
    _, smooth = _recover(part, material, displacement, counted)
    scaled = smooth.reshape(len(part.points), COMPONENTS, -1).swapaxes(1, 2).astype(float)
    return pack_tensor(true_stresses(material, scaled)).swapaxes(1, 2)


def _recover(
    mesh: ComponentMesh,
    material: Material,
    displacement: FloatArray,
    counted: int | None,
    sides: FreeSides | None = None,
) -> tuple[StressArray, StressArray]:
    """Return the stresses sampled in cells, and those recovered at the counted nodes."""
    samples, _ = gauss_places(
        mesh.kind, SAMPLE_DEGREES[cell_family(mesh.kind), cell_order(mesh.kind)]
    )
    taken = _sample_stresses(mesh, material, displacement, samples)
    return taken, recover_stresses(
        mesh, samples, taken, wanted=counted, sides=None if sides is None else (sides, material)
    )


def _stress_changes(
    mesh: ComponentMesh,
    material: Material,
    displacement: FloatArray,
    taken: StressArray,
    smooth: StressArray,
    *,
    weights: FloatArray | None,
    counted: int | None,
) -> Iterator[tuple[IntArray, StressArray]]:
    """Yield the blocks of cells, and what recovery changes in them: rows whose squares add up to
    energies, one column per field.
    """
    key = cell_family(mesh.kind), cell_order(mesh.kind)
    samples, _ = gauss_places(mesh.kind, SAMPLE_DEGREES[key])
    straight: NDArray[np.bool_] = np.full(len(mesh.cells), mesh.straight and key[0] == "tet")
    if key[0] == "tet" and not mesh.straight:
        straight = straight_cells(mesh.points, mesh.cells, mesh.kind)
    places, rule = gauss_places(mesh.kind, ENERGY_DEGREES[key])
    factors = np.ones(len(mesh.cells)) if weights is None else weights
    change_rule = (
        _change_rule(mesh, samples, places, rule)
        if straight.any()
        else np.zeros((0, 0), dtype=np.float32)
    )
    for cells in _blocks(np.flatnonzero(straight[:counted]), mesh.cells.shape[1] * taken.shape[2]):
        values = np.concatenate([smooth[mesh.cells[cells]], taken[cells]], axis=1)
        corners = mesh.points[mesh.cells[cells, :4]]
        a, b, c = (corners[:, axis] - corners[:, 0] for axis in (1, 2, 3))
        measures = np.abs((np.cross(a, b) * c).sum(axis=1))
        sizes = np.sqrt(measures * factors[cells]).astype(np.float32)
        yield cells, np.matmul(sizes[:, None, None] * change_rule, values)
    shapes = cell_shape_functions(mesh.kind, places).astype(np.float32)
    for cells in _blocks(np.flatnonzero(~straight[:counted]), len(places) * taken.shape[2]):
        operators = stress_operators(mesh, material, places, cells)
        sizes = np.sqrt(operators.measures * rule * factors[cells, None]).astype(np.float32)
        change = np.matmul(
            np.repeat(sizes, COMPONENTS, axis=1)[:, :, None] * operators.table,
            local_motions(mesh, displacement, cells),
        )
        change = change.reshape(len(cells), len(places), -1)
        change -= np.matmul(sizes[:, :, None] * shapes, smooth[mesh.cells[cells]])
        yield cells, change


def _shape_change(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, smooth: StressArray
) -> ShapeChange | None:
    """Return the energy and mass densities at the surface, times the volume between facets and
    faces, in products of all fields.
    """
    if mesh.gaps is None:
        return None
    count = displacement.shape[1]
    stiffness, mass = np.zeros((count, count)), np.zeros((count, count))
    values, _, _ = facet_tables(mesh.gaps.facets.shape[1], PLACES)
    moved = displacement.reshape(len(mesh.points), -1)
    facets = np.arange(len(mesh.gaps.facets))
    for part in _blocks(facets, len(values) * smooth.shape[1]):
        nodes, weights = mesh.gaps.facets[part], mesh.gaps.volumes[part].ravel()[:, None, None]
        stresses = np.matmul(values, smooth[nodes].astype(float)).reshape(
            len(weights), COMPONENTS, count
        )
        motions = np.matmul(values, moved[nodes]).reshape(len(weights), 3, count)
        stiffness += (weights * stresses).reshape(-1, count).T @ stresses.reshape(-1, count)
        mass += (
            material.density * (weights * motions).reshape(-1, count).T @ motions.reshape(-1, count)
        )
    return ShapeChange(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))


def _feature_change(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, smooth: StressArray
) -> ShapeChange | None:
    """Return the energy and mass densities where small features lie that the mesh lacks, times
    their volumes.
    """
    lacks = mesh.missing
    if lacks is None:
        return None
    count = displacement.shape[1]
    stiffness, mass = np.zeros((count, count)), np.zeros((count, count))
    moved = displacement.reshape(len(mesh.points), -1)
    for cell, shape, volume, strength in zip(
        lacks.cells, lacks.shapes, lacks.volumes, lacks.strengths, strict=True
    ):
        nodes = mesh.cells[cell]
        stresses = (shape @ smooth[nodes].astype(float)).reshape(COMPONENTS, count)
        motions = (shape @ moved[nodes]).reshape(3, count)
        stiffness += strength * volume * stresses.T @ stresses
        mass += material.density * volume * motions.T @ motions
    return ShapeChange(stiffness, mass)


def _sample_stresses(
    mesh: ComponentMesh, material: Material, displacement: FloatArray, places: FloatArray
) -> StressArray:
    """Return stresses ``(n_cells, n_places, 6 k)``; by place and component one per field."""
    result = np.empty(
        (len(mesh.cells), len(places), COMPONENTS * displacement.shape[1]), dtype=np.float32
    )
    for cells in _blocks(
        np.arange(len(mesh.cells)), 3 * mesh.cells.shape[1] * displacement.shape[1]
    ):
        table = stress_operators(mesh, material, places, cells).table
        stresses = np.matmul(table, local_motions(mesh, displacement, cells))
        result[cells[0] : cells[-1] + 1] = stresses.reshape(len(cells), *result.shape[1:])
    return result


def _change_rule(
    mesh: ComponentMesh, samples: FloatArray, places: FloatArray, weights: FloatArray
) -> StressArray:
    """Return what recovery changes in a straight tetrahedron, from nodal values and samples, so
    that its squares add up to its energy.

    There the stress is a polynomial of one order less than the displacement, which its samples
    determine.
    """

    def terms(where: FloatArray) -> FloatArray:
        constant = np.ones((len(where), 1))
        return constant if cell_order(mesh.kind) == 1 else np.hstack([constant, where])

    shapes = cell_shape_functions(mesh.kind, places)
    rule = np.sqrt(weights)[:, None] * np.hstack(
        [shapes, -terms(places) @ np.linalg.pinv(terms(samples))]
    )
    # as many rows as there are nodes hold the same squares
    return np.asarray(np.linalg.qr(rule, mode="r")[: shapes.shape[1]], dtype=np.float32)


def _blocks(cells: IntArray, values_per_cell: int) -> Iterator[IntArray]:
    step = max(1, BLOCK_VALUES // values_per_cell)
    for start in range(0, len(cells), step):
        yield cells[start : start + step]
