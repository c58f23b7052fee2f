"""Reads finished gmsh meshes (runs in the worker process)."""

from pathlib import Path
from typing import Any, BinaryIO

import gmsh
import numpy as np

from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import NODE_COUNTS
from headstock.meshing.errors import MeshError
from headstock.meshing.files.cells import kinds_message
from headstock.meshing.process.job import MeshData

GMSH_KINDS: dict[int, CellKind] = {4: "tet4", 11: "tet10", 5: "hex8", 17: "hex20", 12: "hex27"}


def read_gmsh_mesh(path: Path) -> MeshData:
    """Read a ``.msh`` file; its physical surfaces become named surface sets.

    Raises:
        MeshError: The file is no gmsh mesh, or holds no or several kinds of solid cells.
    """
    with path.open("rb") as file:  # gmsh would run a script that only calls itself .msh
        if not file.read(64).lstrip().startswith(b"$MeshFormat"):
            raise MeshError(f"{path.name} is not a gmsh mesh (no $MeshFormat at its start)")
    _check_counts(path)
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        types, _, nodes = gmsh.model.mesh.getElements(3)
        found = {
            int(kind): np.asarray(block, dtype=np.int64)
            for kind, block in zip(types, nodes, strict=True)
        }
        names = [str(gmsh.model.mesh.getElementProperties(kind)[0]) for kind in found]
        if len(found) != 1 or next(iter(found)) not in GMSH_KINDS:
            raise MeshError(kinds_message(path, names))
        kind = GMSH_KINDS[next(iter(found))]
        row = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
        row[np.asarray(tags, dtype=np.int64)] = np.arange(len(tags))
        cells = row[next(iter(found.values()))].reshape(-1, NODE_COUNTS[kind])
        return MeshData(coordinates.reshape(-1, 3), cells, kind, _gmsh_surfaces(row))
    finally:
        gmsh.finalize()


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
                stated, found = _count_section(file, section, version)
                if stated != found:
                    name = section.decode()[1:].lower()
                    raise MeshError(
                        f"{path.name}: {name} take {stated} lines by their counts, the file holds {found}; it is damaged"
                    )


def _count_section(file: BinaryIO, section: bytes, version: bytes) -> tuple[int, int]:
    """Lines a section should have behind its first, and has: version 4 has a line per block, 4.1
    two lines per node.
    """
    try:
        head = [int(word) for word in file.readline().split()]
        lines = 2 if section == b"$Nodes" and version.startswith(b"4.1") else 1
        stated = head[0] + lines * head[1] if version.startswith(b"4") else head[0]
    except (ValueError, IndexError) as error:
        raise MeshError(
            f"{section.decode()} does not begin with its counts; the file is damaged"
        ) from error
    end, found = section.replace(b"$", b"$End"), 0
    for line in file:
        if line.strip() == end:
            return stated, found
        found += bool(line.strip())
    raise MeshError(f"{section.decode()} has no end; the file is cut short")


def _gmsh_surfaces(row: IntArray) -> dict[str, IntArray]:
    """Corners of the elements of each physical surface; unnamed ones go by their number."""
    result: dict[str, IntArray] = {}
    for dim, group in gmsh.model.getPhysicalGroups(2):
        parts: list[Any] = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, group):
            types, _, nodes = gmsh.model.mesh.getElements(2, entity)
            for kind, block in zip(types, nodes, strict=True):
                _, _, _, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
                parts.append(row[np.asarray(block, dtype=np.int64)].reshape(-1, count)[:, :corners])
        if parts and len({part.shape[1] for part in parts}) == 1:
            result[str(gmsh.model.getPhysicalName(dim, group)) or str(group)] = np.concatenate(
                parts
            )
    return result
