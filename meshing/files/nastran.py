"""Reads finished meshes in Nastran's bulk data, cells by meshio, sets here."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import meshio
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.cells import MESHIO_SOLIDS, RawMesh, assemble_mesh
from headstock.meshing.process.job import MeshData

NODE_SET = "1"
# as HyperMesh writes it: number, 1 for nodes or 2 for elements, name
_SET_NAME = re.compile(r'\$HMSET\s+(\d+)\s+(\d+)\s*"([^"\n]+)"')
LONGEST_RANGE = 100_000_000
REAL_COLUMNS, SMALL_REAL = 16, 1e-6
SOLID_PROPERTY = 1
SET_CARDS = ("SET1", "SPC1")


def read_nastran_mesh(path: Path) -> MeshData:
    """Read a ``.bdf`` file.

    Surface elements become a set ``property_N`` per property, the nodes of ``SPC1`` cards a set
    ``spc_N``, and those of ``SET1`` cards ``set_N``, or what a comment ``$HMSET`` calls it.

    Raises:
        MeshError: The file holds no or several kinds of solid cells, or refers to another file.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        # meshio passes over it, and the cells in the other file would be missing without a word
        if line.lstrip()[:7].upper() == "INCLUDE":
            raise MeshError(
                f"{path.name}:{number}: INCLUDE is not supported; write the whole mesh into one file"
            )
    mesh = meshio.read(path, file_format="nastran")
    raw = RawMesh(np.asarray(mesh.points, dtype=float).reshape(-1, 3))
    references = mesh.cell_data.get("nastran:ref", [None] * len(mesh.cells))
    for block, properties in zip(mesh.cells, references, strict=True):
        nodes = np.asarray(block.data, dtype=np.int64)
        if block.type.startswith(MESHIO_SOLIDS):
            raw.solids.append((block.type, nodes))
        elif properties is not None:
            for number in np.unique(properties):
                raw.add_facets(f"property_{number}", block.type, nodes[properties == number])
    row = {int(number): place for place, number in enumerate(mesh.points_id)}
    for name, members in _node_sets(text):
        # a SET1 card may also hold elements, whose numbers need not be those of nodes
        found = [row[member] for member in members if member in row]
        if found and len(found) == len(members):
            raw.add_nodes(name, np.array(found, dtype=np.int64))
    return assemble_mesh(path, raw)


def _node_sets(text: str) -> Iterator[tuple[str, list[int]]]:
    """Name and node numbers of each card that lists nodes."""
    comments = {number: (kind, name) for number, kind, name in _SET_NAME.findall(text)}
    for card, number, *rest in _cards(text):
        kind, name = comments.get(number, (NODE_SET, f"set_{number}"))
        if card == "SPC1":
            yield f"spc_{number}", list(_expand(rest[1:]))
        elif kind == NODE_SET:
            yield name, list(_expand(rest))


def _expand(words: list[str]) -> Iterator[int]:
    """Numbers of a list in which ``2 THRU 5`` stands for all from 2 to 5."""
    for place, word in enumerate(words):
        if word.upper() == "THRU":
            first, last = int(words[place - 1]), int(words[place + 1])
            if not 0 < last - first < LONGEST_RANGE:
                raise MeshError(f"{first} THRU {last} is no range of node numbers")
            yield from range(first + 1, last)
        elif word:
            yield int(word)


def _cards(text: str) -> Iterator[list[str]]:
    """Fields of the cards that may list nodes, continuation lines joined."""
    card: list[str] = []
    for line in text.splitlines():
        if not line.strip() or line.startswith("$"):
            continue
        fields = _split(line)
        if card and (line[0] in "+*, " or not fields[0]):
            card += [word for word in fields[1:9] if word and not word.startswith("+")]
            continue
        if card:
            yield card
        name = fields[0].upper().rstrip("*")
        listed = [word for word in fields[1:9] if word and not word.startswith("+")]
        card = [name, *listed] if name in SET_CARDS and listed else []
    if card:
        yield card


def _split(line: str) -> list[str]:
    """Fields of a line: by commas, 16 columns wide where marked by ``*``, or else 8."""
    if "," in line:
        return [word.strip() for word in line.split(",")]
    width = 16 if "*" in line[:8] else 8
    return [
        line[:8].strip(),
        *(line[i : i + width].strip() for i in range(8, min(len(line), 72), width)),
    ]


def format_bulk_data(points: FloatArray, cells: IntArray, sets: Mapping[str, IntArray]) -> str:
    """A mesh as bulk data, its node sets as ``SET1`` cards with comments that name them.

    Args:
        points: ``(n, 3)``, in the unit of the file.
        cells: Tets or hexes in Nastran's node order, ``(n_cells, k)``.
        sets: Node numbers of each set, counted from 0.
    """
    lines = ["$ lengths in metres", "BEGIN BULK"]
    for row in range(len(points)):
        x, y, z = (_real(float(value)) for value in points[row])
        lines.append(f"GRID*   {row + 1:<16}{'':16}{x:>16}{y:>16}")
        lines.append(f"*       {z:>16}")
    name = "CTETRA" if cells.shape[1] in (4, 10) else "CHEXA"
    for row in range(len(cells)):
        lines += _card_lines([name, row + 1, SOLID_PROPERTY, *(cells[row] + 1)])
    for number, (label, members) in enumerate(sets.items(), 1):
        lines.append(f'$HMSET {number:>9} {NODE_SET:>8} "{label}"')
        lines += _card_lines(["SET1", number, *(members + 1)])
    return "\n".join([*lines, "ENDDATA", ""])


def _card_lines(words: Sequence[str | int | np.int64]) -> list[str]:
    """A card in fields of 8 columns, eight behind the name or the sign of continuation."""
    name, rest = words[0], words[1:]
    return [
        "".join(f"{word:<8}" for word in ["+" if start else name, *rest[start : start + 8]])
        for start in range(0, len(rest), 8)
    ]


def _real(value: float) -> str:
    """A number in 16 columns, as exact as they allow; Nastran wants a decimal point."""
    shortest = repr(value)
    if len(shortest) <= REAL_COLUMNS and "e" not in shortest:
        return shortest
    if abs(value) < SMALL_REAL:
        return f"{value:.9E}"
    digits = REAL_COLUMNS - 2 - len(str(int(abs(value))).lstrip("0"))
    text = (
        f"{value:.{digits}f}".replace("0.", ".", 1) if abs(value) < 1.0 else f"{value:.{digits}f}"
    )
    return text[:REAL_COLUMNS]
