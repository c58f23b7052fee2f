"""Discretisation errors of a part whose displacements lie on several ranks: each rank looks at its
own cells and at those around them that recovery takes samples of.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.meshing.component_mesh import ComponentMesh, IntArray, SurfaceGaps
from headstock.meshing.elements.topology import cell_family, cell_order
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import RowBlocks, sum_over_ranks
from headstock.solvers.recovery.discretisation_error import (
    SAMPLE_DEGREES,
    MeshErrors,
    ShapeChange,
    estimate_mesh_errors,
)
from headstock.solvers.recovery.free_sides import FreeSides, find_free_sides
from headstock.solvers.recovery.patch_recovery import corner_patches, gauss_places

CELLS_TAG = 4714


@dataclass(frozen=True, eq=False)
class _Piece:
    """Part of a mesh that a rank needs.

    Attributes:
        mesh: Its own cells first, then those around them.
        nodes: ``(n,)`` points of the whole mesh behind its points.
        weights: ``(n_cells,)`` what the energies of its cells count.
        counted: Number of its own cells.
        sides: Where single tetrahedra fill it, and free sides there; None for nowhere.
    """

    mesh: ComponentMesh
    nodes: IntArray
    weights: FloatArray
    counted: int
    sides: FreeSides | None


def estimate_split_errors(
    mesh: ComponentMesh | None,
    material: Material,
    operators: ElasticOperators,
    fields: RowBlocks,
    weights: FloatArray | None,
) -> MeshErrors:
    """Return ``estimate_mesh_errors`` of a mesh on rank 0; collective, the same result everywhere.

    Args:
        mesh: On rank 0.
        operators: Which cells each rank owns.
        fields: ``(n_points, 3, k)`` displacement of the mesh points [m].
        weights: ``(n_cells,)`` what the energies of cells are multiplied by, on rank 0.
    """
    comm, count = operators.comm, fields.rows.shape[2]
    if comm.size == 1 and mesh is not None:
        return estimate_mesh_errors(
            mesh,
            material,
            fields.rows.reshape(3 * fields.total, count),
            weights,
            sides=find_free_sides(mesh),
        )
    if mesh is None or weights is None:
        comm.send(operators.cells, dest=0, tag=CELLS_TAG)
        piece: _Piece = comm.recv(source=0, tag=CELLS_TAG)
    else:
        piece = _deal_pieces(mesh, operators, weights)
    local = fields.fetch(piece.nodes).reshape(3 * len(piece.nodes), count)
    zero = np.zeros((count, count))
    nothing = ShapeChange(zero, zero)
    errors = MeshErrors(
        zero,
        None if piece.mesh.gaps is None else nothing,
        None if piece.mesh.missing is None else nothing,
    )
    if piece.counted:
        errors = estimate_mesh_errors(
            piece.mesh,
            material,
            local,
            piece.weights,
            counted=piece.counted,
            sides=piece.sides,
        )
    return MeshErrors(
        sum_over_ranks(comm, errors.missing_energy),
        _sum_change(comm, errors.shape),
        _sum_change(comm, errors.left_out),
    )


def _sum_change(comm: MPI.Comm, change: ShapeChange | None) -> ShapeChange | None:
    if change is None:
        return None
    return ShapeChange(sum_over_ranks(comm, change.stiffness), sum_over_ranks(comm, change.mass))


def _deal_pieces(mesh: ComponentMesh, operators: ElasticOperators, weights: FloatArray) -> _Piece:
    """Send each rank its piece; returns that of rank 0."""
    comm = operators.comm
    samples, _ = gauss_places(
        mesh.kind, SAMPLE_DEGREES[cell_family(mesh.kind), cell_order(mesh.kind)]
    )
    sides = find_free_sides(mesh)
    patches = corner_patches(mesh, len(samples), sides)
    open_gaps = np.ones(0 if mesh.gaps is None else len(mesh.gaps.facets), dtype=bool)
    for rank in reversed(range(comm.size)):
        cells = operators.cells if rank == 0 else comm.recv(source=rank, tag=CELLS_TAG)
        cells = np.sort(cells)
        around = np.concatenate([cells, np.setdiff1d(patches.around(cells), cells)])
        nodes = np.unique(mesh.cells[around])
        gaps = mesh.gaps
        if gaps is not None:
            # stresses on a facet are known wherever all of its points belong to cells that count
            mine = open_gaps & np.isin(gaps.facets, mesh.cells[cells]).all(axis=1)
            open_gaps &= ~mine
            gaps = SurfaceGaps(np.searchsorted(nodes, gaps.facets[mine]), gaps.volumes[mine])
        part = dataclasses.replace(
            mesh,
            points=mesh.points[nodes],
            cells=np.searchsorted(nodes, mesh.cells[around]),
            patches={},
            gaps=gaps,
            missing=None if mesh.missing is None else mesh.missing.within(cells),
        )
        piece = _Piece(
            part,
            nodes,
            weights[around],
            len(cells),
            None if sides is None else sides.within(nodes, around),
        )
        if rank:
            comm.send(piece, dest=rank, tag=CELLS_TAG)
    return piece
