"""What every reader of mesh files fills: points, solid cells by family, named sets, materials, and what it left
out.
"""

from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.topology import EDGES, FACETS
from headstock.meshing.errors import MeshError

SolidFamily = Literal["tet", "pyramid", "wedge", "hex"]
Group = tuple[int, ...]

CORNERS: dict[SolidFamily, int] = {"tet": 4, "pyramid": 5, "wedge": 6, "hex": 8}
FAMILY_EDGES: dict[SolidFamily, tuple[tuple[int, int], ...]] = {
    "tet": EDGES["tet"],
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hex": EDGES["hex"],
}
FAMILY_FACES: dict[SolidFamily, tuple[Group, ...]] = {
    "tet": FACETS["tet"],
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hex": FACETS["hex"],
}
# corners counted from the other side, as in MED
MIRRORED: dict[SolidFamily, list[int]] = {
    "tet": [0, 2, 1, 3],
    "pyramid": [0, 3, 2, 1, 4],
    "wedge": [0, 2, 1, 3, 5, 4],
    "hex": [0, 3, 2, 1, 4, 7, 6, 5],
}
# edges in the order in which VTK and Abaqus list their middles
VTK_EDGES: dict[SolidFamily, tuple[tuple[int, int], ...]] = {
    "tet": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "pyramid": FAMILY_EDGES["pyramid"],
    "wedge": FAMILY_EDGES["wedge"],
    "hex": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip

# names that meshio gives to families of cells
MESHIO_FAMILIES: dict[str, SolidFamily] = {
    "tetra": "tet", "pyramid": "pyramid", "wedge": "wedge", "hexahedron": "hex",
}  # fmt: skip
MESHIO_FACETS = {"triangle": 3, "quad": 4}
LONGEST_NAME = 100


def upright_first(family: SolidFamily) -> tuple[tuple[int, int], ...]:
    """Return the edges as Exodus and Nastran list their middles: in wedges and hexes the upright
    ones before the upper ones.
    """
    edges, base = VTK_EDGES[family], {"wedge": 3, "hex": 4}.get(family)
    return edges if base is None else (*edges[:base], *edges[2 * base :], *edges[base : 2 * base])


def middle_groups(family: SolidFamily, count: int) -> tuple[Group, ...] | None:
    """Return the corners whose middles the nodes behind the corners are, edges first; None for a
    number of nodes that no cell of the family has.
    """
    edges = FAMILY_EDGES[family]
    quads = tuple(face for face in FAMILY_FACES[family] if len(face) == 4)
    body = tuple(range(CORNERS[family]))
    for groups in ((), edges, (*edges, *quads), (*edges, *quads, body)):
        allowed = not len(groups) > len(edges) or (family == "hex") == (groups[-1] == body)
        if count == CORNERS[family] + len(groups) and allowed:
            return groups
    return None


@dataclass(frozen=True, eq=False)
class SolidBlock:
    """Solid cells of one family and one number of nodes.

    Attributes:
        nodes: ``(n, k)`` corners first; -1 where the file leaves out a node that is no corner.
        groups: Corners whose middle each further node is, as the format has it.
        ordered: Programs keep to that order.
        numbers: ``(n,)`` numbers of the cells in the file.
    """

    family: SolidFamily
    nodes: IntArray
    groups: tuple[Group, ...]
    ordered: bool
    numbers: IntArray


@dataclass(frozen=True, eq=False)
class Section:
    """Cells that the file gives one material.

    Attributes:
        name: Of a set in ``RawMesh.groups``.
        cells: ``(n,)`` counted over all blocks.
        material: Name of the material and its values, as a message shows them; empty where the file tells
            none.
        key: Equal for equal materials; None where the file names none.
    """

    name: str
    cells: IntArray
    material: str = ""
    key: Hashable = None


@dataclass
class RawMesh:
    """Contents of a file, in its own node order and orientation.

    Attributes:
        points: ``(n, 3)``.
        solids: Blocks of solid cells; cells are counted over them all.
        facets: Corners ``(n, 3 or 4)`` of the blocks of each named set of surface elements.
        groups: Cells of each named set, which ``solid`` of a scene may choose.
        sections: Which cells have which material.
        left_out: How many elements of each kind are no solid cells and carry stiffness or mass.
        notes: What else the user should know.
    """

    points: FloatArray
    solids: list[SolidBlock] = field(default_factory=list)
    facets: dict[str, list[IntArray]] = field(default_factory=dict)
    node_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    groups: dict[str, list[IntArray]] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    @property
    def cell_count(self) -> int:
        """Number of solid cells so far."""
        return sum(len(block.nodes) for block in self.solids)

    def add_solids(
        self,
        family: SolidFamily,
        nodes: IntArray,
        *,
        edges: tuple[tuple[int, int], ...] | None = None,
        numbers: IntArray | None = None,
    ) -> IntArray:
        """Add a block of solid cells.

        Args:
            nodes: ``(n, k)`` corners first.
            edges: In the order in which the format lists their middles; where nodes lie decides as well.
            numbers: ``(n,)`` of the cells in the file; counted from 1 where it has none.

        Returns:
            What the cells count as in groups and sections, ``(n,)``.

        Raises:
            MeshError: No cell of the family has that many nodes.
        """
        start = self.cell_count
        groups = middle_groups(family, nodes.shape[1])
        if groups is None:
            raise MeshError(f"{family} cells with {nodes.shape[1]} nodes are not read")
        if edges is not None and groups:
            groups = (*edges, *groups[len(FAMILY_EDGES[family]) :])
        count = start + np.arange(len(nodes))
        if len(nodes):
            cell_numbers = count + 1 if numbers is None else numbers
            block = SolidBlock(
                family, nodes.astype(np.int64), groups, edges is not None, cell_numbers
            )
            self.solids.append(block)
        return count

    def add_cells(self, kind: str, nodes: IntArray) -> IntArray:
        """Add cells under the name that meshio gives to their kind; those that are no solids are passed over.

        Args:
            kind: Such as ``tetra10``.
            nodes: ``(n, k)`` corners first.

        Returns:
            As `add_solids`.
        """
        family = MESHIO_FAMILIES.get(kind.rstrip("0123456789"))
        if family is None:
            return np.zeros(0, dtype=np.int64)
        return self.add_solids(family, nodes)

    def add_facets(self, name: str, corners: IntArray) -> None:
        """Add facets with corners ``(n, 3 or 4)`` to a named set."""
        if len(corners):
            self.facets.setdefault(_clean_name(name), []).append(corners)

    def add_sheets(self, name: str, kind: str, nodes: IntArray) -> None:
        """Add surface elements to a named set; elements of other kinds are passed over.

        Args:
            kind: Of the elements, by meshio's name.
            nodes: ``(n, k)``, corners first.
        """
        corners = MESHIO_FACETS.get(kind.rstrip("0123456789"))
        if corners is not None:
            self.add_facets(name, nodes[:, :corners])

    def add_nodes(self, name: str, nodes: IntArray) -> None:
        """Add nodes ``(n,)`` to a named set."""
        if len(nodes):
            self.node_sets.setdefault(_clean_name(name), []).append(nodes)

    def add_group(self, name: str, cells: IntArray) -> None:
        """Add solid cells to a named set.

        Args:
            cells: Counted over all blocks, ``(n,)``.
        """
        if len(cells):
            self.groups.setdefault(_clean_name(name), []).append(cells)

    def add_section(self, name: str, cells: IntArray, material: str, key: Hashable) -> None:
        """Add solid cells to a named set that has one material."""
        if len(cells):
            self.add_group(name, cells)
            self.sections.append(Section(_clean_name(name), cells, material, key))


def is_solid(kind: str) -> bool:
    """Return whether cells that meshio calls so are solids."""
    return kind.rstrip("0123456789") in MESHIO_FAMILIES


def _clean_name(name: str) -> str:
    """Return a name as messages may show it."""
    shown = "".join(letter if letter.isprintable() else "?" for letter in name.strip())
    return shown[:LONGEST_NAME] or "unnamed"
