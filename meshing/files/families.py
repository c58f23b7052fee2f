"""Local numbering of the four families of solid cells that files hold: corners, edges, outward faces and
their mirror images; tets and hexes as gmsh counts them.
"""

from typing import Literal

from headstock.meshing.elements.topology import EDGES, FACETS

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
