"""What every mesh file is turned into: cells of one kind in gmsh's node order, without unused
points.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import EDGES, FACETS, cell_family, corner_count
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshData

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
        MeshError: The file is missing, cannot be read, or holds no usable mesh.
    """
    if not path.is_file():
        raise MeshError(f"there is no file {path}")
    try:
        data = reader(path)
    except MeshError:
        raise
    except (Exception, SystemExit) as error:  # foreign readers raise anything, gmsh the bare class
        raise MeshError(f"{path.name} cannot be read: {type(error).__name__}: {error}") from error
    if not len(data.cells) or not np.isfinite(data.points).all():
        raise MeshError(
            f"{path.name}: {'coordinates that are not finite numbers' if len(data.cells) else 'no solid cells'}"
        )
    return _drop_unused_points(data)


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
    held = (
        f"holds {len(kinds)} kinds of solid cells ({', '.join(kinds)})"
        if kinds
        else "holds no solid cells"
    )
    return f"{path.name} {held}; write a mesh of one kind: tets with 4 or 10 nodes, or hexes with 8, 20 or 27"


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
