"""Reads finished meshes whose arrays lie in HDF5, XDMF and MED, in a worker process.

XDMF values and kinds of cells are read by meshio; several grids in one file, as dolfinx writes
meshes with tags, and mixed second-order cells are not, nor are names of other files checked there.
meshio's reader of MED knows no 27-node hexes, and fails at families without groups and at fields.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import h5py
import numpy as np
from meshio.xdmf.common import xdmf_idx_to_meshio_type, xdmf_to_meshio_type
from meshio.xdmf.main import XdmfReader
from numpy.typing import NDArray

from headstock.geometry.errors import printable
from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import MESHIO_FACETS, RawMesh, is_solid
from headstock.meshing.process.plain_hdf5 import plain_objects, require_own_data

MED_NAME_BYTES = 80
AnyArray = NDArray[Any]
CORNERS = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6}
CORNERS["hexahedron"] = 8
NODE_FAMILIES, CELL_FAMILIES = "NOEUD", "ELEME"
MED_KINDS = {
    "TR3": "triangle", "TR6": "triangle6", "TR7": "triangle7", "QU4": "quad", "QU8": "quad8", "QU9": "quad9",
    "TE4": "tetra", "T10": "tetra10", "HE8": "hexahedron", "H20": "hexahedron20", "H27": "hexahedron27",
    "PE6": "wedge", "P15": "wedge15", "P18": "wedge18", "PY5": "pyramid", "P13": "pyramid13",
}  # fmt: skip

MED_OTHERS = ("PO1", "SE2", "SE3", "SE4", "POG", "POG2", "PG1", "PG2")
MOST_GROUPS = 50  # values of more kinds number cells


class _GuardedXdmf(XdmfReader):  # type: ignore[misc]
    """Reads values of an XDMF file, and of HDF5 files only those that are given."""

    def __init__(self, path: Path, beside: Sequence[Path]) -> None:
        super().__init__(path)
        self.files = {other.name: other for other in beside}

    def values(self, element: ElementTree.Element) -> AnyArray:
        """Return the array of the one data item of an element.

        Raises:
            MeshError: It is none, or lies elsewhere.
        """
        items = element.findall("DataItem")
        if len(items) != 1:
            raise MeshError(
                f"{self.filename.name}: a {element.tag} has {len(items)} data items, one is read"
            )
        (item,) = items
        form, text = item.get("Format", "XML"), (item.text or "").strip()
        if item.get("ItemType", "Uniform") != "Uniform" or "Reference" in item.attrib:
            raise MeshError(
                f"{self.filename.name}: data items made of others are not read; export it again"
            )
        if form == "XML":
            item.set("Format", "XML")
            return self._read_data_item(item)
        name, colon, array_path = text.rpartition(":")
        if form != "HDF" or not colon:
            raise MeshError(
                f"{self.filename.name}: data of format {form!r} are not read; write HDF or XML"
            )
        if name.strip() not in self.files:
            raise MeshError(f"{self.filename.name} reads {text!r}, which is no HDF5 file beside it")
        with h5py.File(self.files[name.strip()], "r") as file:
            array = _read_plain(file, array_path.strip())
        stated = [int(size) for size in (item.get("Dimensions") or "").split()]
        if math.prod(stated) != array.size:
            raise MeshError(
                f"{self.filename.name}: {text} has the shape {array.shape}, stated are {stated}; one of the two files is of another mesh"
            )
        return array.reshape(stated)


def _read_plain(group: h5py.Group, place: str) -> AnyArray:
    """Return an array of an HDF5 file whose numbers lie in the file itself.

    Raises:
        MeshError: There is none, or it lies elsewhere.
    """
    for name in (part for part in place.split("/") if part):
        kind = (
            group.get(name, getclass=True, getlink=True) if isinstance(group, h5py.Group) else None
        )
        if kind is None:
            raise MeshError(f"{Path(group.file.filename).name} holds no array {place}")
        if kind is not h5py.HardLink:
            raise MeshError(f"{place} is a link to another place, which is not followed")
        group = group[name]
    if not isinstance(group, h5py.Dataset):
        raise MeshError(f"{place} is no array of this file")
    require_own_data(group, printable(place), MeshError)
    return group[()]


def read_xdmf(path: Path, *beside: Path) -> RawMesh:
    """Read an ``.xdmf`` file; integer values of surface elements become named sets.

    Elements may stand beside the solid cells in one grid, or in grids of their own, as dolfinx
    writes mesh tags. A set is called by the name of the values, and by the value where there are
    several.

    Args:
        beside: HDF5 files that it may read.

    Raises:
        MeshError: The file holds cells that are not read, or reaches for other files.
    """
    root = _parse_xdmf(path)
    reader = _GuardedXdmf(path, beside)
    raw: RawMesh | None = None
    pending = []
    for grid in root.iter("Grid"):
        topology = grid.find("Topology")
        if grid.get("GridType", "Uniform") != "Uniform" or topology is None:
            continue  # a field on a mesh that another grid holds
        blocks = list(_xdmf_cells(reader, topology))
        geometry = grid.find("Geometry")
        if not any(is_solid(kind) for kind, _ in blocks):
            pending.append((grid, geometry, blocks))
        elif raw is None:
            if geometry is None:
                raise MeshError(f"{path.name}: the grid with the solid cells has no coordinates")
            raw = RawMesh(_xdmf_points(reader, geometry))
            _add_tags(reader, grid, blocks, raw, [raw.add_cells(*block) for block in blocks])
        elif geometry is None:
            _add_tags(reader, grid, blocks, raw, [_find_cells(raw, *block) for block in blocks])
        else:
            raise MeshError(f"{path.name} holds several meshes; write one")
    if raw is None:
        return RawMesh(np.zeros((0, 3)))
    for grid, geometry, blocks in pending:
        if geometry is not None:
            places = _same_places(raw.points, _xdmf_points(reader, geometry))
            blocks = [(kind, _renumber(places, nodes)) for kind, nodes in blocks]
        _add_tags(reader, grid, blocks, raw, [])
    return raw


def _parse_xdmf(path: Path) -> ElementTree.Element:
    text = path.read_bytes()
    try:
        _refuse_entities(text, path.name)
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, expat.ExpatError) as error:
        raise MeshError(f"{path.name} is no XML, or is cut short: {error}") from error
    if root.tag != "Xdmf":
        raise MeshError(f"{path.name} is no XDMF file: it begins with {root.tag[:80]!r}")
    return root


def _refuse_entities(text: bytes, name: str) -> None:
    """Refuse entities, in whatever encoding they are written."""

    def refuse(*_: object) -> None:
        raise MeshError(f"{name} defines entities, which are not expanded; export it again")

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = refuse
    parser.Parse(text, True)


def _find_cells(raw: RawMesh, kind: str, nodes: IntArray) -> IntArray:
    """Find which solid cells have the nodes of others, ``(n,)``; none where one of them has not."""
    number_of: dict[bytes, int] = {}
    start = 0
    for block in raw.solids if is_solid(kind) else ():
        keys = np.sort(block.nodes, axis=1)
        number_of |= {key.tobytes(): start + index for index, key in enumerate(keys)}
        start += len(keys)
    matches = [number_of.get(key.tobytes(), -1) for key in np.sort(nodes, axis=1)]
    return np.array([] if -1 in matches else matches, dtype=np.int64)


def _xdmf_points(reader: _GuardedXdmf, geometry: ElementTree.Element) -> FloatArray:
    kind = geometry.get("GeometryType") or geometry.get("Type") or "XYZ"
    points = reader.values(geometry)
    if kind != "XYZ" or points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(
            f"{reader.filename.name}: coordinates of type {kind} and shape {points.shape}; XYZ is read"
        )
    return points.astype(float)


def _xdmf_cells(
    reader: _GuardedXdmf, topology: ElementTree.Element
) -> Iterator[tuple[str, IntArray]]:
    """Yield the kind and nodes ``(n, k)`` of each block of cells."""
    kind = topology.get("TopologyType") or topology.get("Type") or ""
    values = reader.values(topology).astype(np.int64)
    if kind == "Mixed":
        yield from _split_mixed(reader.filename.name, values.ravel())
        return
    if kind not in xdmf_to_meshio_type:
        raise MeshError(f"{reader.filename.name}: cells of the type {kind!r} are not known")
    name = str(xdmf_to_meshio_type[kind])
    yield name, values.reshape(-1, _node_count(name))


def _split_mixed(name: str, values: IntArray) -> Iterator[tuple[str, IntArray]]:
    """Yield the blocks of cells of a mixed topology: per cell its type, for points and lines their
    count, and its nodes.
    """
    position, current = 0, ""
    rows: list[list[int]] = []
    numbers = [int(value) for value in values]
    while position < len(numbers):
        kind = xdmf_idx_to_meshio_type.get(numbers[position])
        if kind is None:
            raise MeshError(f"{name}: cells of the type {numbers[position]} are not known")
        start = position + (2 if kind in ("vertex", "line") else 1)
        position = start + _node_count(kind)
        if kind != current and rows:
            yield current, np.array(rows, dtype=np.int64)
            rows = []
        current = kind
        rows.append(numbers[start:position])
        if position > len(numbers):
            raise MeshError(f"{name}: the list of cells is cut short")
    if rows:
        yield current, np.array(rows, dtype=np.int64)


def _node_count(kind: str) -> int:
    family = kind.rstrip("0123456789")
    return int(kind[len(family) :] or CORNERS[family])


def _add_tags(
    reader: _GuardedXdmf,
    grid: ElementTree.Element,
    blocks: Sequence[tuple[str, IntArray]],
    raw: RawMesh,
    cells: Sequence[IntArray],
) -> None:
    """Add sets of surface elements, and groups of solid cells, by the integer values that a grid
    gives them.

    Args:
        blocks: Kind and nodes of its cells.
        cells: What the cells of each block count as among the solid ones; none of surface elements.
    """
    for name, tags in _read_tags(reader, grid, [len(nodes) for _, nodes in blocks]):
        solid = [
            (index, values_of) for index, values_of in zip(cells, tags, strict=False) if len(index)
        ]
        values = np.unique(np.concatenate([values_of for _, values_of in solid])) if solid else ()
        for value in values if 1 < len(values) <= MOST_GROUPS else ():
            chosen = np.concatenate([index[values_of == value] for index, values_of in solid])
            raw.add_section(f"{name}_{value}", chosen, "", None)
        sheets = [
            (*block, values_of)
            for block, values_of in zip(blocks, tags, strict=True)
            if block[0].startswith(tuple(MESHIO_FACETS))
        ]
        _add_sheet_tags(raw, name, sheets)


def _add_sheet_tags(
    raw: RawMesh, name: str, sheets: Sequence[tuple[str, IntArray, IntArray]]
) -> None:
    """Add a set of surface elements per value, called by the value where there are several.

    Args:
        sheets: Kind, nodes ``(n, k)`` and values ``(n,)`` of each block of them.
    """
    values = np.unique(np.concatenate([tags for _, _, tags in sheets])) if sheets else ()
    for value in values:
        label = name if len(values) == 1 else f"{name}_{value}"
        for kind, nodes, tags in sheets:
            raw.add_sheets(label, kind, nodes[tags == value])


def _read_tags(
    reader: _GuardedXdmf, grid: ElementTree.Element, counts: Sequence[int]
) -> Iterator[tuple[str, list[IntArray]]]:
    """Yield the name and the integer values of each field on the cells of a grid, by block of cells.

    Args:
        counts: Number of cells of each block.
    """
    for attribute in grid.findall("Attribute"):
        if attribute.get("Center") != "Cell":
            continue
        values = reader.values(attribute).ravel()
        if not np.issubdtype(values.dtype, np.integer):
            continue
        name = attribute.get("Name", "tags")
        if len(values) != sum(counts):
            raise MeshError(
                f"{reader.filename.name}: {name} has {len(values)} values, the grid other many cells"
            )
        yield name, np.split(values, np.cumsum(counts)[:-1])


def _same_places(points: FloatArray, others: FloatArray) -> IntArray:
    """Return the number of the point at the place of each of ``others``, -1 where none."""
    _, groups = np.unique(np.vstack([points, others]), axis=0, return_inverse=True)
    first = np.full(groups.max() + 1, -1, dtype=np.int64)
    first[groups[: len(points)].ravel()] = np.arange(len(points))
    return first[groups[len(points) :].ravel()]


def _renumber(places: IntArray, nodes: IntArray) -> IntArray:
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(places):
        raise MeshError("surface elements use nodes that the file does not hold; it is damaged")
    return places[nodes]


def read_med(path: Path) -> RawMesh:
    """Read a ``.med`` file; groups of surface elements and of nodes become named sets.

    Raises:
        MeshError: The file holds no or several meshes, or cells that are not read.
    """
    with h5py.File(path, "r") as file:
        for _ in plain_objects(file, MeshError, ("ENS_MAA", "FAS")):
            pass  # what is refused is refused before anything is read
        meshes = file.get("ENS_MAA")
        if not isinstance(meshes, h5py.Group) or len(meshes) != 1:
            raise MeshError(
                f"{path.name} holds {len(meshes or ())} meshes; write a MED file with one"
            )
        (name,) = meshes
        mesh = meshes[name]
        step = mesh if "NOE" in mesh else mesh[sorted(mesh)[0]]
        flat = _read_plain(step, "NOE/COO")
        if int(mesh.attrs["ESP"]) != 3 or len(flat) % 3:
            raise MeshError(f"{path.name}: its coordinates are not three per node")
        raw = RawMesh(flat.reshape(3, -1).T.astype(float))
        families = file.get(f"FAS/{name}")
        for members, group in _med_members(step["NOE"], families, NODE_FAMILIES):
            raw.add_nodes(group, members)
        solids: defaultdict[str, list[IntArray]] = defaultdict(list)
        for code, cells in step["MAI"].items():
            kind = MED_KINDS.get(code)
            if kind is None:
                if code in MED_OTHERS:
                    continue  # points, lines, polygons
                raise MeshError(f"{path.name}: cells of the type {code!r} are not read")
            nodes = _read_plain(cells, "NOD").reshape(_node_count(kind), -1).T.astype(np.int64) - 1
            numbers = raw.add_cells(kind, nodes)
            for members, group in _med_members(cells, families, CELL_FAMILIES):
                if is_solid(kind):
                    solids[group].append(numbers[members])
                else:
                    raw.add_sheets(group, kind, nodes[members])
    for group, parts in solids.items():
        raw.add_section(group, np.concatenate(parts), "", None)
    return raw


def _med_members(
    holder: h5py.Group, families: h5py.Group | None, kind: str
) -> Iterator[tuple[IntArray, str]]:
    """Yield the nodes or cells of each family, counted from 0, with each group it belongs to."""
    if "FAM" not in holder or families is None or kind not in families:
        return
    tags = _read_plain(holder, "FAM")
    for number, names in _med_groups(families[kind]).items():
        for name in names:
            yield np.flatnonzero(tags == number), name


def _med_groups(families: h5py.Group) -> dict[int, list[str]]:
    """Return the names of the groups that each family belongs to, by its number."""
    groups: dict[int, list[str]] = {}
    for family in families.values():
        if "GRO" in family:
            rows = _read_plain(family, "GRO/NOM").astype(np.uint8).reshape(-1, MED_NAME_BYTES)
            groups[int(family.attrs["NUM"])] = [
                row.tobytes().partition(b"\0")[0].decode("utf-8", errors="replace").strip()
                for row in rows
            ]
    return groups
