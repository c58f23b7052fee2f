"""Writes the mesh of a component with its patches, by meshio, in the node order of each format."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
from meshio.xdmf.main import XdmfWriter

from headstock.meshing.component_mesh import CellKind, ComponentMesh, IntArray
from headstock.meshing.elements.quadratic import complete_hexes
from headstock.meshing.elements.topology import (
    EDGES,
    FACETS,
    NODE_COUNTS,
    cell_family,
    corner_count,
)
from headstock.meshing.errors import MeshError
from headstock.meshing.files.exodus import HAS_NETCDF, LONGEST_NAME, NO_NETCDF, add_side_sets
from headstock.meshing.files.nastran import format_bulk_data
from headstock.meshing.files.raw_mesh import MIRRORED, VTK_EDGES, upright_first
from headstock.meshing.formats import find_format

KIND_NAMES: dict[CellKind, str] = {
    "tet4": "tetra", "tet10": "tetra10", "hex8": "hexahedron", "hex20": "hexahedron20", "hex27": "hexahedron27",
}  # fmt: skip
FACET_NAMES = {3: "triangle", 6: "triangle6", 4: "quad", 8: "quad8", 9: "quad9"}
# faces of 27-node hexes by their corners, then None for the centre
VTK_FACES = (
    (0, 4, 7, 3),
    (1, 2, 6, 5),
    (0, 1, 5, 4),
    (2, 3, 7, 6),
    (0, 3, 2, 1),
    (4, 5, 6, 7),
    None,
)
EXODUS_FACES = (None, *(VTK_FACES[k] for k in (4, 5, 0, 1, 2, 3)))
SAME_SHAPE = 1e-9  # of the size of the mesh
SOLID_TAG = 1


def encode_mesh(mesh: ComponentMesh, path: Path) -> dict[str, bytes]:
    """Return the content of the files that hold a mesh, by name; arrays come before the file that
    names them.

    Lengths are in metres.

    Args:
        path: Of the file; its ending chooses the format.

    Raises:
        MeshError: The format cannot hold the mesh.
    """
    form = find_format(path, written=True).name
    with tempfile.TemporaryDirectory() as folder:
        WRITERS[form](mesh, Path(folder, path.name))
        # an XDMF file is complete only with its arrays
        files = sorted(Path(folder).iterdir(), key=lambda file: file.name == path.name)
        return {file.name: file.read_bytes() for file in files}


class _GridWriter(XdmfWriter):  # type: ignore[misc]
    """An XDMF file of several grids; meshio's own writer makes one."""

    def __init__(self, path: Path, mesh: meshio.Mesh, sets: Mapping[str, meshio.Mesh]) -> None:
        self.filename, self.data_format, self.data_counter = path, "HDF", 0
        self.compression = self.compression_opts = None
        self.h5_filename = path.with_name(f"{path.stem}_mesh.h5")
        root = ElementTree.Element("Xdmf", Version="3.0")
        domain = ElementTree.SubElement(root, "Domain")
        with h5py.File(self.h5_filename, "w") as self.h5_file:
            grid = ElementTree.SubElement(domain, "Grid", Name="mesh", GridType="Uniform")
            self.write_points(grid, mesh.points)
            self.write_cells(mesh.cells, grid)
            (geometry,) = grid.findall("Geometry")
            for name, facets in sets.items():
                grid_element = ElementTree.SubElement(domain, "Grid", Name=name, GridType="Uniform")
                grid_element.append(geometry)
                self.write_cells(facets.cells, grid_element)
                self.write_cell_data(facets.cell_data, grid_element)
        ElementTree.indent(root)
        path.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _write_xdmf(mesh: ComponentMesh, path: Path) -> None:
    cells = _order_cells(mesh, VTK_EDGES[cell_family(mesh.kind)], VTK_FACES)
    sets = {
        name: meshio.Mesh(
            mesh.points,
            [(FACET_NAMES[facets.shape[1]], facets)],
            cell_data={name: [np.full(len(facets), number, dtype=np.int32)]},
        )
        for number, (name, facets) in enumerate(_area_patches(mesh).items(), 1)
    }
    _GridWriter(path, meshio.Mesh(mesh.points, [(KIND_NAMES[mesh.kind], cells)]), sets)


def _write_exodus(mesh: ComponentMesh, path: Path) -> None:
    if not HAS_NETCDF:
        raise MeshError(f"{path.name}: {NO_NETCDF}")
    for name in mesh.patches:
        if len(name.encode()) > LONGEST_NAME:
            raise MeshError(
                f"{path.name}: {name!r} is too long for Exodus, whose names have up to {LONGEST_NAME} letters"
            )
    family = cell_family(mesh.kind)
    cells = _order_cells(mesh, upright_first(family), EXODUS_FACES)
    written = meshio.Mesh(
        mesh.points, [(KIND_NAMES[mesh.kind], cells)], point_sets=_patch_nodes(mesh)
    )
    meshio.write(path, written, file_format="exodus")
    corners = 3 if family == "tet" else 4
    add_side_sets(
        path, cells, {name: facets[:, :corners] for name, facets in _area_patches(mesh).items()}
    )


def _write_med(mesh: ComponentMesh, path: Path) -> None:
    mesh = _with_twenty_nodes(mesh, path)
    family = cell_family(mesh.kind)
    # MED counts the corners of a cell from the other side
    corners = MIRRORED[family]
    edges = tuple((corners[a], corners[b]) for a, b in VTK_EDGES[family])
    cells = np.hstack(
        [mesh.cells[:, corners], _order_cells(mesh, edges, ())[:, corner_count(mesh.kind) :]]
    )
    blocks = [(KIND_NAMES[mesh.kind], cells)]
    tags: list[IntArray] = [np.zeros(len(cells), dtype=np.int64)]
    facets, owners, cell_groups = _families(_area_patches(mesh))
    if len(facets):
        blocks.append((FACET_NAMES[facets.shape[1]], facets))
        tags.append(-owners)
    numbers, families, node_groups = _families(
        {name: nodes[:, None] for name, nodes in _patch_nodes(mesh).items()}
    )
    point_tags = np.zeros(len(mesh.points), dtype=np.int64)
    point_tags[numbers.ravel()] = families
    written = meshio.Mesh(
        mesh.points, blocks, point_data={"point_tags": point_tags}, cell_data={"cell_tags": tags}
    )
    written.point_tags = node_groups
    written.cell_tags = {-number: names for number, names in cell_groups.items()}
    meshio.write(path, written, file_format="med")


def _families(
    sets: Mapping[str, IntArray],
) -> tuple[IntArray, IntArray, dict[int, list[str]]]:
    """Return the members of any set, the family of each, from 1, and the sets that each family
    belongs to.
    """
    if not sets:
        return np.zeros((0, 1), dtype=np.int64), np.zeros(0, dtype=np.int64), {}
    rows = np.concatenate(list(sets.values()))
    keys = np.sort(rows, axis=1)
    _, first, family_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    inside = np.zeros((len(first), len(sets)), dtype=bool)
    owner = np.repeat(np.arange(len(sets)), [len(members) for members in sets.values()])
    inside[family_of.ravel(), owner] = True
    combinations, family = np.unique(inside, axis=0, return_inverse=True)
    names = np.array(list(sets), dtype=object)
    groups = {number: list(names[row]) for number, row in enumerate(combinations, 1)}
    return rows[first], family.ravel().astype(np.int64) + 1, groups


def _write_nastran(mesh: ComponentMesh, path: Path) -> None:
    # meshio writes names of second-order cells that Nastran does not know, and ends at coordinates
    # near zero
    mesh = _with_twenty_nodes(mesh, path)
    cells = _order_cells(mesh, upright_first(cell_family(mesh.kind)), ())
    path.write_text(format_bulk_data(mesh.points, cells, _patch_nodes(mesh)))


def _write_gmsh(mesh: ComponentMesh, path: Path) -> None:
    cells = _order_cells(mesh, VTK_EDGES[cell_family(mesh.kind)], VTK_FACES)
    patches = _area_patches(mesh)
    blocks = [(KIND_NAMES[mesh.kind], cells)]
    blocks += [(FACET_NAMES[facets.shape[1]], facets) for facets in patches.values()]
    tags = [
        np.full(len(nodes), number, dtype=np.int32) for number, (_, nodes) in enumerate(blocks, 1)
    ]
    names = {name: np.array([number, 2]) for number, name in enumerate(patches, 2)}
    written = meshio.Mesh(
        mesh.points,
        blocks,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"solid": np.array([SOLID_TAG, 3]), **names},
    )
    meshio.write(path, written, file_format="gmsh22", binary=False)


WRITERS: dict[str, Callable[[ComponentMesh, Path], None]] = {
    "XDMF": _write_xdmf,
    "Exodus": _write_exodus,
    "MED": _write_med,
    "Nastran": _write_nastran,
    "gmsh": _write_gmsh,
}


def _area_patches(mesh: ComponentMesh) -> dict[str, IntArray]:
    """Return the facets of the patches that are areas; a forced point or line is one node per
    facet.
    """
    return {
        name: facets
        for name, facets in mesh.patches.items()
        if len(facets) and not (facets == facets[:, :1]).all()
    }


def _patch_nodes(mesh: ComponentMesh) -> dict[str, IntArray]:
    return {name: np.unique(facets) for name, facets in mesh.patches.items()}


def _order_cells(
    mesh: ComponentMesh,
    edges: tuple[tuple[int, int], ...],
    faces: tuple[tuple[int, ...] | None, ...],
) -> IntArray:
    """Return the cells with the nodes behind the corners in the order of another format.

    Args:
        mesh: In gmsh's order.
        edges: Ends of each edge, by corners of gmsh.
        faces: Corners of each face of a 27-node hex, None for its centre.
    """
    family, first = cell_family(mesh.kind), corner_count(mesh.kind)
    order = list(range(first))
    if NODE_COUNTS[mesh.kind] > first:
        position_of = {frozenset(edge): first + i for i, edge in enumerate(EDGES[family])}
        order += [position_of[frozenset(edge)] for edge in edges]
    if mesh.kind == "hex27":
        middles = {frozenset(facet): 20 + i for i, facet in enumerate(FACETS["hex"])}
        order += [26 if face is None else middles[frozenset(face)] for face in faces]
    return mesh.cells[:, order]


def _with_twenty_nodes(mesh: ComponentMesh, path: Path) -> ComponentMesh:
    """Return a mesh without 27-node hexes, of the same shape.

    Raises:
        MeshError: Twenty nodes do not describe the shape of its hexes.
    """
    if mesh.kind != "hex27":
        return mesh
    used = np.unique(mesh.cells[:, :20])
    row_of = np.full(len(mesh.points), -1, dtype=np.int64)
    row_of[used] = np.arange(len(used))
    cells, points = row_of[mesh.cells[:, :20]], mesh.points[used]
    completed, whole = complete_hexes(points, cells)
    away = np.abs(completed[whole[:, 20:]] - mesh.points[mesh.cells[:, 20:]]).max()
    if away > SAME_SHAPE * float(np.ptp(mesh.points, axis=0).max()):
        raise MeshError(
            f"{path.name}: {find_format(path).name} has hexes of 20 nodes only, and these are curved so that they need 27; "
            "write .xdmf or .exo"
        )
    patches = {
        name: row_of[facets[:, :8]] if facets.shape[1] == 9 else row_of[facets]
        for name, facets in mesh.patches.items()
    }
    return ComponentMesh(points, cells, "hex20", mesh.straight, patches, mesh.quality)
