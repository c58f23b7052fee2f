"""Reads finished meshes of Abaqus and Nastran into gmsh's node order, in a worker process: ``python -m
headstock.meshing.files.foreign``.
"""

import sys
from pathlib import Path

import numpy as np

from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import NODE_COUNTS
from headstock.meshing.errors import MeshError
from headstock.meshing.files.abaqus import AbaqusDeck, deck_positions, read_abaqus_deck
from headstock.meshing.files.cells import (
    guard_reader,
    kinds_message,
    order_hex27_faces,
    vtk_to_gmsh,
)
from headstock.meshing.files.nastran import read_nastran_mesh
from headstock.meshing.process.job import MeshData, MeshJob
from headstock.meshing.process.worker import serve_job

COUNT_KINDS: dict[int, CellKind] = {count: kind for kind, count in NODE_COUNTS.items()}


def read_abaqus_mesh(path: Path) -> MeshData:
    """Read an ``.inp`` deck; surfaces, node sets and sets of surface elements become named sets.

    Raises:
        MeshError: The deck holds no or several kinds of solid cells, or something this reader does
            not know.
    """
    deck = read_abaqus_deck(path)
    if len(deck.solids) != 1:
        raise MeshError(kinds_message(path, [f"{count}-node solids" for count in deck.solids]))
    count, rows = next(iter(deck.solids.items()))
    kind = COUNT_KINDS[count]
    row, points = deck_positions(deck)
    try:
        cells = np.array([[row[node] for node in nodes] for nodes in rows.values()], dtype=np.int64)
        facets, node_sets = _abaqus_sets(deck, row)
    except KeyError as error:
        raise MeshError(f"{path.name}: node {error} is used but not defined") from error
    if kind == "hex27":
        cells = order_hex27_faces(points, cells)
    return MeshData(points, vtk_to_gmsh(cells, kind), kind, facets, node_sets)


def _abaqus_sets(
    deck: AbaqusDeck, row: dict[int, int]
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    surfaces = {
        name: [[row[node] for node in facet] for facet in facets]
        for name, facets in deck.surfaces.items()
    }
    for name, members in deck.element_sets.items():
        shells = [
            [row[node] for node in deck.shells[element]]
            for element in members
            if element in deck.shells
        ]
        if shells and name not in surfaces:
            surfaces[name] = shells
    facets = {name: np.array(rows, dtype=np.int64) for name, rows in surfaces.items()}
    nodes = {
        name: np.array([row[node] for node in members], dtype=np.int64)
        for name, members in deck.node_sets.items()
    }
    return facets, {name: members for name, members in nodes.items() if name not in facets}


def perform_job(job: MeshJob) -> MeshData:
    """Read an Abaqus or Nastran mesh."""
    if not isinstance(job.solid, MeshFile):
        raise MeshError(f"a {type(job.solid).__name__} is no mesh file")
    path = job.solid.path
    return guard_reader(
        path, read_abaqus_mesh if path.suffix.lower() == ".inp" else read_nastran_mesh
    )


if __name__ == "__main__":
    sys.exit(serve_job(sys.argv[1:], perform_job))
