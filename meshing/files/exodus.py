"""Reads finished meshes in Exodus files, in a worker process, and adds side sets to them.

meshio writes Exodus without side sets; its reader knows neither them, nor sets without a name, nor
blocks of the type TETRA4.
"""

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import RawMesh, is_solid
from headstock.meshing.process.plain_hdf5 import plain_objects

HAS_NETCDF = importlib.util.find_spec("netCDF4") is not None
if HAS_NETCDF:  # a Python of the user's own may be without it
    import netCDF4

NO_NETCDF = "Exodus files need the Python package netCDF4 (Debian: python3-netcdf4)"
# first letters of a block's type, and its number of nodes, to the kind
FAMILIES = {
    "TET": "tetra",
    "HEX": "hexahedron",
    "WED": "wedge",
    "PYR": "pyramid",
    "TRI": "triangle",
}
FAMILIES |= {"SHE": "quad", "QUA": "quad"}
CORNERS = {"tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5, "triangle": 3, "quad": 4}
# corners of sides 1, 2, ... (Exodus II: A finite element data model, SAND92-2137, table 4)
SIDES = {
    "tetra": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "hexahedron": (
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (0, 4, 7, 3),
        (0, 3, 2, 1),
        (4, 5, 6, 7),
    ),
    "wedge": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
}
LONGEST_NAME = 32
# what carries stiffness or mass and is no solid cell
OTHER = "other"
OTHER_TYPES = ("SPH", "CIR", "BAR", "BEA", "TRU", "ROD", "EDG", "SPR", "NUL", "POI")


def read_exodus(path: Path) -> RawMesh:
    """Read an ``.exo`` file; its side sets and node sets become named sets, its blocks groups.

    Raises:
        MeshError: The package netCDF4 is missing, or the file holds cells that are not read.
    """
    if not HAS_NETCDF:
        raise MeshError(f"{path.name}: {NO_NETCDF}")
    if h5py.is_hdf5(path):  # netCDF-4; the earlier format knows neither links nor compression
        with h5py.File(path, "r") as content:
            for _ in plain_objects(content, MeshError):
                pass
    with netCDF4.Dataset(str(path)) as file:
        file.set_auto_mask(False)
        variables = file.variables
        raw = RawMesh(_read_points(path, variables))
        blocks = [
            (_block_kind(path, variables[name]), np.asarray(variables[name][:], dtype=np.int64) - 1)
            for name in _numbered(variables, "connect")
        ]
        names = dict(_named_sets(variables, "connect", "eb", "block"))
        for block_name, (kind, nodes) in zip(_numbered(variables, "connect"), blocks, strict=True):
            if is_solid(kind):
                raw.add_section(names[block_name], raw.add_cells(kind, nodes), "", None)
            elif kind == OTHER or block_name.replace("connect", "attrib") in variables:
                # sheets have their thickness as an attribute
                raw.left_out[str(variables[block_name].elem_type)] += len(nodes)
        for name, label in _named_sets(variables, "elem_ss", "ss", "side_set"):
            elements = np.asarray(variables[name][:], dtype=np.int64) - 1
            sides = np.asarray(variables[name.replace("elem", "side")][:], dtype=np.int64)
            _add_side_set(path, raw, blocks, label=label, elements=elements, sides=sides)
        for name, label in _named_sets(variables, "node_ns", "ns", "node_set"):
            raw.add_nodes(label, np.asarray(variables[name][:], dtype=np.int64) - 1)
    return raw


def _read_points(path: Path, variables: Mapping[str, "netCDF4.Variable[Any]"]) -> FloatArray:
    if "coord" in variables:
        points = np.asarray(variables["coord"][:], dtype=float).T
    else:
        missing = [name for name in ("coordx", "coordy", "coordz") if name not in variables]
        if missing:
            raise MeshError(
                f"{path.name} has no coordinates {', '.join(missing)}; it is no Exodus file of a solid mesh"
            )
        points = np.stack(
            [np.asarray(variables[f"coord{axis}"][:], dtype=float) for axis in "xyz"], axis=1
        )
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path.name}: its coordinates are not three per node")
    return points


def _block_kind(path: Path, block: "netCDF4.Variable[Any]") -> str:
    """Return the kind of the cells of a block by meshio's name, such as ``tetra10``."""
    kind = str(getattr(block, "elem_type", "")).upper()
    family = FAMILIES.get(kind[:3], "")
    if len(block.shape) != 2:
        raise MeshError(f"{path.name}: {block.name} is no table of nodes; the file is damaged")
    count = block.shape[1]
    if not family and not kind.startswith(OTHER_TYPES):
        raise MeshError(
            f"{path.name}: {block.name} holds cells of type {kind!r}, which are not read"
        )
    if not family:
        return OTHER
    return family if count == CORNERS[family] else f"{family}{count}"


def _numbered(variables: Mapping[str, object], start: str) -> list[str]:
    numbered = [
        name for name in variables if name.startswith(start) and name[len(start) :].isdigit()
    ]
    return sorted(numbered, key=lambda name: int(name[len(start) :]))


def _named_sets(
    variables: Mapping[str, "netCDF4.Variable[Any]"], start: str, kind: str, unnamed: str
) -> list[tuple[str, str]]:
    """Return the variable and name of each set that has members; ``unnamed`` and its number without
    a name.
    """
    names, numbers = variables.get(f"{kind}_names"), variables.get(f"{kind}_prop1")
    named = []
    for name in _numbered(variables, start):
        index = int(name[len(start) :]) - 1
        label = b""
        if names is not None and index < len(names):
            label = np.asarray(names[index]).tobytes().partition(b"\0")[0].strip()
        has_number = numbers is not None and index < len(numbers)
        number = int(numbers[index]) if has_number and numbers is not None else index + 1
        named.append((name, label.decode("utf-8", errors="replace") or f"{unnamed}_{number}"))
    return named


def _add_side_set(
    path: Path,
    raw: RawMesh,
    blocks: list[tuple[str, IntArray]],
    *,
    label: str,
    elements: IntArray,
    sides: IntArray,
) -> None:
    """Add the facets of a side set: elements, counted over all blocks, and their sides."""
    if len(elements) != len(sides):
        raise MeshError(
            f"{path.name}: side set {label} has {len(elements)} elements and {len(sides)} sides; it is damaged"
        )
    start = 0
    for kind, cells in blocks:
        inside = (elements >= start) & (elements < start + len(cells))
        cell_nodes, numbers = cells[elements[inside] - start], sides[inside]
        start += len(cells)
        if not is_solid(kind):
            raw.add_sheets(label, kind, cell_nodes)
            continue
        table = SIDES.get(kind.rstrip("0123456789"), ())
        if inside.any() and (not table or not 1 <= numbers.min() <= numbers.max() <= len(table)):
            raise MeshError(
                f"{path.name}: side set {label} names sides that a {kind} does not have"
            )
        for number, corners in enumerate(table, 1):
            raw.add_facets(label, cell_nodes[numbers == number][:, list(corners)])
    if len(elements) and not 0 <= elements.min() <= elements.max() < start:
        raise MeshError(f"{path.name}: side set {label} names elements that the file does not hold")


def add_side_sets(path: Path, cells: IntArray, sets: Mapping[str, IntArray]) -> None:
    """Add side sets to an Exodus file with one block of cells.

    Args:
        cells: Its cells, corners first, ``(n_cells, k)``.
        sets: Corners of the facets of each set, ``(n, 3 or 4)``.
    """
    corners = 4 if cells.shape[1] in (4, 10) else 8
    table = np.array(SIDES["tetra" if corners == 4 else "hexahedron"])
    sides = np.sort(cells[:, table].reshape(-1, table.shape[1]), axis=1)
    number_of = {key.tobytes(): number for number, key in enumerate(np.ascontiguousarray(sides))}
    with netCDF4.Dataset(str(path), "a") as file:
        # meshio counts from 0, which is no number of a set
        for numbering in ("eb_prop1", "ns_prop1"):
            if numbering in file.variables:
                file.variables[numbering][:] += 1
        file.createDimension("num_side_sets", len(sets))
        numbers = file.createVariable("ss_prop1", "i4", ("num_side_sets",))
        numbers.setncattr("name", "ID")
        status = file.createVariable("ss_status", "i4", ("num_side_sets",))
        names = file.createVariable("ss_names", "S1", ("num_side_sets", "len_string"))
        for index, (name, facets) in enumerate(sets.items()):
            keys = np.ascontiguousarray(np.sort(facets, axis=1))
            side_numbers = np.array([number_of[key.tobytes()] for key in keys])
            numbers[index], status[index] = index + 1, 1
            names[index] = np.frombuffer(name.encode().ljust(LONGEST_NAME + 1, b"\0"), dtype="S1")
            file.createDimension(f"num_side_ss{index + 1}", len(side_numbers))
            elements = file.createVariable(
                f"elem_ss{index + 1}", "i4", (f"num_side_ss{index + 1}",)
            )
            elements[:] = side_numbers // len(table) + 1
            side_variable = file.createVariable(
                f"side_ss{index + 1}", "i4", (f"num_side_ss{index + 1}",)
            )
            side_variable[:] = side_numbers % len(table) + 1
