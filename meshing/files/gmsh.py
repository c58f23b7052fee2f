"""Reads finished gmsh meshes (runs in the worker process)."""

import tempfile
from pathlib import Path
from typing import Any, BinaryIO

import gmsh
import numpy as np

from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import RawMesh, SolidFamily

# gmsh's names of families of cells begin so
FAMILIES: dict[str, SolidFamily] = {
    "Tetrahedron": "tet", "Pyramid": "pyramid", "Prism": "wedge", "Hexahedron": "hex",
}  # fmt: skip


def read_gmsh(path: Path) -> RawMesh:
    """Read a ``.msh`` file; its physical surfaces become named surface sets, its physical volumes groups.

    Raises:
        MeshError: The file is no gmsh mesh, or holds cells that are not read.
    """
    with path.open("rb") as file:  # gmsh would run a script that only calls itself .msh
        if not file.read(64).lstrip().startswith(b"$MeshFormat"):
            raise MeshError(f"{path.name} is not a gmsh mesh (no $MeshFormat at its start)")
    _check_counts(path)
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        # gmsh runs a script beside a mesh, of its name and .opt: beside a link there is none
        with tempfile.TemporaryDirectory() as folder:
            (link := Path(folder, "mesh.msh")).symlink_to(path.absolute())
            gmsh.open(str(link))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        row = np.full(int(tags.max(initial=0)) + 1, -1, dtype=np.int64)
        row[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
        raw = RawMesh(np.asarray(coordinates, dtype=float).reshape(-1, 3))
        owned = {int(tag): _add_cells(raw, int(tag), row) for _, tag in gmsh.model.getEntities(3)}
        for dim, group in gmsh.model.getPhysicalGroups(3):
            entities = gmsh.model.getEntitiesForPhysicalGroup(dim, group)
            cells = [owned[int(tag)] for tag in entities if int(tag) in owned]
            name = str(gmsh.model.getPhysicalName(dim, group)) or f"volume_{group}"
            raw.add_section(name, np.concatenate([*cells, np.zeros(0, dtype=np.int64)]), "", None)
        for name, facets in _gmsh_surfaces(row).items():
            raw.facets[name] = facets
        return raw
    finally:
        gmsh.finalize()


def _add_cells(raw: RawMesh, entity: int, row: IntArray) -> IntArray:
    """Add the cells of a volume, and return what they count as."""
    cell_numbers: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    types, tags, nodes = gmsh.model.mesh.getElements(3, entity)
    for kind, numbers, block in zip(types, tags, nodes, strict=True):
        name, _, _, count, _, _ = gmsh.model.mesh.getElementProperties(kind)
        family = FAMILIES.get(str(name).split()[0])
        if family is None:
            raise MeshError(f"cells of the kind {name} are not read")
        rows = row[np.asarray(block, dtype=np.int64)].reshape(-1, count)
        cell_numbers.append(
            raw.add_solids(family, rows, numbers=np.asarray(numbers, dtype=np.int64))
        )
    return np.concatenate(cell_numbers)


def _check_counts(path: Path) -> None:
    """Compare the counts of a text file with its lines: gmsh drops what goes beyond them without a
    word.

    Raises:
        MeshError: Nodes or elements are missing or left over, or a section has no end.
    """
    with path.open("rb") as file:
        while file.readline().strip() != b"$MeshFormat":
            pass
        version, kind, *_ = [*file.readline().split(), b"", b""]
        if kind != b"0":
            # binary sections are of a length that follows from their counts, which gmsh checks
            return
        for line in file:
            section = line.strip()
            if section in (b"$Nodes", b"$Elements"):
                stated, counted = _count_section(file, section, version)
                if stated != counted:
                    name = section.decode()[1:].lower()
                    raise MeshError(
                        f"{path.name}: {name} take {stated} lines by their counts, the file holds {counted}; it is damaged"
                    )


def _count_section(file: BinaryIO, section: bytes, version: bytes) -> tuple[int, int]:
    """Return the lines a section should have behind its first, and has: version 4 has a line per
    block, 4.1 two lines per node.
    """
    try:
        head = [int(word) for word in file.readline().split()]
        lines = 2 if section == b"$Nodes" and version.startswith(b"4.1") else 1
        stated = head[0] + lines * head[1] if version.startswith(b"4") else head[0]
    except (ValueError, IndexError) as error:
        raise MeshError(
            f"{section.decode()} does not begin with its counts; the file is damaged"
        ) from error
    end, counted = section.replace(b"$", b"$End"), 0
    for line in file:
        if line.strip() == end:
            return stated, counted
        counted += bool(line.strip())
    raise MeshError(f"{section.decode()} has no end; the file is cut short")


def _gmsh_surfaces(row: IntArray) -> dict[str, list[IntArray]]:
    """Return corners of elements of each physical surface; unnamed ones by number."""
    result: dict[str, list[IntArray]] = {}
    for dim, group in gmsh.model.getPhysicalGroups(2):
        parts: list[Any] = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, group):
            types, _, nodes = gmsh.model.mesh.getElements(2, entity)
            for kind, block in zip(types, nodes, strict=True):
                _, _, _, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
                parts.append(row[np.asarray(block, dtype=np.int64)].reshape(-1, count)[:, :corners])
        if parts:
            result[str(gmsh.model.getPhysicalName(dim, group)) or str(group)] = parts
    return result
