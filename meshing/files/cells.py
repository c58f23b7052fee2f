"""What every mesh file is turned into: cells of one kind in gmsh's node order, without unused
points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import (
    EDGES,
    FACETS,
    NODE_COUNTS,
    Family,
    cell_family,
    corner_count,
)
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.process.job import MeshData

MESHIO_KINDS: dict[str, CellKind] = {
    "tetra": "tet4", "tetra10": "tet10", "hexahedron": "hex8", "hexahedron20": "hex20", "hexahedron27": "hex27",
}  # fmt: skip
MESHIO_SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid")
MESHIO_FACETS = ("triangle", "quad")
# corners counted from the other side, as in MED
MIRRORED: dict[Family, list[int]] = {"tet": [0, 2, 1, 3], "hex": [0, 3, 2, 1, 4, 7, 6, 5]}
LONGEST_NAME = 100
ORDER_SAMPLE = 5000  # cells that vote on the order of their nodes
# edges in the order of VTK, Abaqus C3D10/C3D20 and (as meshio returns them) Nastran CTETRA/CHEXA
VTK_EDGES = {
    "tet": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex": (
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 0),
        (4, 5),
        (5, 6),
        (6, 7),
        (7, 4),
        (0, 4),
        (1, 5),
        (2, 6),
        (3, 7),
    ),
}


def guard_reader(path: Path, reader: Callable[[Path], MeshData]) -> MeshData:
    """Read a mesh file with a reader that may raise anything.

    Returns:
        Points in the file's unit, cells of one kind in gmsh's node order, and named surface and
        node sets.

    Raises:
        PartFileError: The file cannot be read, or holds no usable mesh.
        MeshError: The file is missing.
    """
    if not path.is_file():
        raise MeshError(f"there is no file {path}")
    try:
        return _check_mesh(path, reader(path))
    except MeshError as error:
        raise PartFileError(str(error)) from error
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # foreign readers raise anything, gmsh the bare class
        raise PartFileError(
            f"{path.name} cannot be read: {type(error).__name__}: {error}; it is damaged or of another kind: export it again"
        ) from error


def _check_mesh(path: Path, data: MeshData) -> MeshData:
    if not len(data.cells) or not np.isfinite(data.points).all():
        raise MeshError(
            f"{path.name}: {'coordinates that are not finite numbers' if len(data.cells) else 'no solid cells'}"
        )
    for what, numbers in {"cells": data.cells, **data.facets, **data.node_sets}.items():
        if numbers.size and not -1 <= numbers.min() <= numbers.max() < len(data.points):
            raise MeshError(
                f"{path.name}: {what} use nodes that are not among the {len(data.points)} of the file; "
                "it is damaged, export it again"
            )
    if data.cells.min() < 0:
        raise MeshError(
            f"{path.name}: cells use nodes without a number; it is damaged, export it again"
        )
    return _drop_unused_points(data)


@dataclass
class RawMesh:
    """What a file holds, in its own node order and under the names that meshio gives kinds of
    cells.

    Attributes:
        points: ``(n, 3)``.
        solids: Kind and nodes ``(n_cells, k)`` of each block of solid cells.
        facets: Nodes ``(n, k)``, corners first, of the blocks of each named set of surface elements.
        node_sets: Node numbers of each named set.
    """

    points: FloatArray
    solids: list[tuple[str, IntArray]] = field(default_factory=list)
    facets: dict[str, list[IntArray]] = field(default_factory=dict)
    node_sets: dict[str, list[IntArray]] = field(default_factory=dict)

    def add_facets(self, name: str, kind: str, nodes: IntArray) -> None:
        """Add surface elements to a named set; elements of other kinds are passed over.

        Args:
            name: Of the set.
            kind: Of the elements, by meshio's name.
            nodes: ``(n, k)``, corners first.
        """
        corners = {"t": 3, "q": 4}.get(kind[:1]) if kind.startswith(MESHIO_FACETS) else None
        if corners is not None and len(nodes):
            self.facets.setdefault(_clean(name), []).append(nodes[:, :corners])

    def add_nodes(self, name: str, nodes: IntArray) -> None:
        """Add nodes to a named set."""
        self.node_sets.setdefault(_clean(name), []).append(nodes)


def assemble_mesh(path: Path, raw: RawMesh) -> MeshData:
    """Cells of one kind in gmsh's node order, found from where the nodes lie.

    Formats differ in the order of mid-side nodes and in the side from which corners are counted,
    and programs differ in how well they keep to the format they write.

    Raises:
        MeshError: There is no or more than one kind of solid cell, or mid-side nodes lie at no
            sides.
    """
    kinds = list(dict.fromkeys(kind for kind, cells in raw.solids if len(cells)))
    if len(kinds) != 1 or kinds[0] not in MESHIO_KINDS:
        raise MeshError(kinds_message(path, kinds))
    kind = MESHIO_KINDS[kinds[0]]
    cells = np.concatenate([cells for _, cells in raw.solids if len(cells)]).astype(np.int64)
    if cells.shape[1:] != (NODE_COUNTS[kind],):
        raise MeshError(
            f"{path.name}: {cells.shape[-1]} nodes per cell, {kinds[0]} has {NODE_COUNTS[kind]}; it is damaged"
        )
    if not 0 <= cells.min() <= cells.max() < len(raw.points):
        raise MeshError(
            f"{path.name}: cells use nodes that are not among the {len(raw.points)} of the file; "
            "it is damaged, export it again"
        )
    corners = corner_count(kind)
    if _mostly_inverted(raw.points, cells[:, :corners]):
        cells[:, :corners] = cells[:, MIRRORED[cell_family(kind)]]
    if kind != ("tet4" if corners == 4 else "hex8"):
        cells = _order_by_place(path, raw.points, cells, kind)
    wanted = 3 if corners == 4 else 4
    facets = {}
    for name, blocks in raw.facets.items():
        fitting = [block for block in blocks if block.shape[1] == wanted] or blocks[:1]
        facets[name] = np.concatenate(fitting).astype(np.int64)
    nodes = {
        name: np.unique(np.concatenate(members)).astype(np.int64)
        for name, members in raw.node_sets.items()
        if name not in facets
    }
    return MeshData(raw.points, cells, kind, facets, nodes)


def _clean(name: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in name.strip())
    return shown[:LONGEST_NAME] or "unnamed"


def _mostly_inverted(points: FloatArray, corners: IntArray) -> bool:
    """Whether the corners of most cells are counted from the other side."""
    a, b, c = (1, 2, 3) if corners.shape[1] == 4 else (1, 3, 4)
    first = points[corners[:, 0]]
    x, y, z = (points[corners[:, k]] - first for k in (a, b, c))
    return bool(np.median(np.sign(np.einsum("ci,ci->c", x, np.cross(y, z)))) < 0)


def _order_by_place(path: Path, points: FloatArray, cells: IntArray, kind: CellKind) -> IntArray:
    """Second-order cells with the nodes behind the corners in gmsh's order, by where they lie in
    most cells.

    Raises:
        MeshError: They do not lie near the middles of edges and faces.
    """
    family, first = cell_family(kind), corner_count(kind)
    groups: list[tuple[int, ...]] = list(EDGES[family])
    if kind == "hex27":
        groups += [*FACETS[family], tuple(range(8))]
    sample = cells[:: max(1, len(cells) // ORDER_SAMPLE)]
    targets = np.stack([points[sample[:, list(group)]].mean(axis=1) for group in groups], axis=1)
    nodes = points[sample[:, first:]]
    apart = np.linalg.norm(targets[:, :, None, :] - nodes[:, None, :, :], axis=3)
    orders, votes = np.unique(np.argmin(apart, axis=2), axis=0, return_counts=True)
    order = orders[np.argmax(votes)]  # strongly curved cells may vote otherwise
    if len(set(order.tolist())) != len(groups):
        raise MeshError(
            f"{path.name}: nodes of second-order cells do not lie near the middles of their edges; "
            "it is damaged, or its node order is none that is known"
        )
    return np.hstack([cells[:, :first], cells[:, first:][:, order]])


def vtk_to_gmsh(cells: IntArray, kind: CellKind) -> IntArray:
    """Cells whose mid-edge nodes come in VTK's order, reordered to gmsh's; nodes after the edges
    stay.
    """
    if kind in ("tet4", "hex8"):
        return cells
    family, first = cell_family(kind), corner_count(kind)
    place = {frozenset(edge): first + i for i, edge in enumerate(VTK_EDGES[family])}
    order = [*range(first), *(place[frozenset(edge)] for edge in EDGES[family])]
    return cells[:, [*order, *range(len(order), cells.shape[1])]]


def order_hex27_faces(points: FloatArray, cells: IntArray) -> IntArray:
    """Put the last seven nodes of 27-node hexes into gmsh's order (six faces, centre) by where they
    lie.

    Raises:
        MeshError: Most cells do not have one node near the middle of each face.
    """
    corners = points[cells[:, :8]]
    targets = np.stack(
        [*(corners[:, list(facet)].mean(axis=1) for facet in FACETS["hex"]), corners.mean(axis=1)],
        axis=1,
    )
    nodes = points[cells[:, 20:]]
    nearest = np.argmin(
        np.linalg.norm(targets[:, :, None, :] - nodes[:, None, :, :], axis=3), axis=2
    )
    orders, votes = np.unique(nearest, axis=0, return_counts=True)
    order = orders[np.argmax(votes)]  # distorted cells may vote otherwise
    if len(set(order.tolist())) != 7:
        raise MeshError("27-node hexes whose face nodes are not near the middle of their faces")
    return np.hstack([cells[:, :20], cells[:, 20:][:, order]])


def kinds_message(path: Path, kinds: Sequence[str]) -> str:
    """What to tell the user of a file that does not hold exactly one kind of solid cell."""
    found = (
        f"holds {len(kinds)} kinds of solid cells ({', '.join(kinds)})"
        if kinds
        else "holds no solid cells"
    )
    return f"{path.name} {found}; write a mesh of one kind: tets with 4 or 10 nodes, or hexes with 8, 20 or 27"


def _drop_unused_points(data: MeshData) -> MeshData:
    used = np.unique(data.cells)
    place = np.full(len(data.points), -1, dtype=np.int64)
    place[used] = np.arange(len(used))
    nodes = {name: place[members] for name, members in data.node_sets.items()}
    return MeshData(
        data.points[used],
        place[data.cells],
        data.kind,
        {name: place[facets] for name, facets in data.facets.items()},
        {name: members[members >= 0] for name, members in nodes.items()},
    )
