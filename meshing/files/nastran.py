"""Reads and writes bulk data of Nastran.

Source: MSC Nastran Quick Reference Guide, "Format of Bulk Data Entries".
"""

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.nastran_cards import Card, read_cards
from headstock.meshing.files.raw_mesh import CORNERS, RawMesh, SolidFamily, upright_first

SOLIDS: dict[str, tuple[SolidFamily, int]] = {
    "CTETRA": ("tet", 10), "CPYRAM": ("pyramid", 13), "CPYRA": ("pyramid", 13), "CPENTA": ("wedge", 15),
    "CHEXA": ("hex", 20),
}  # fmt: skip
SURFACES = {
    "CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 6, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 8, "CQUAD": 9, "CQUAD9": 9,
}  # fmt: skip
SHELL_PROPERTIES = ("PSHELL", "PCOMP", "PCOMPG")
# what carries stiffness or mass and is no solid cell
_OTHER_ELEMENT = re.compile(
    r"C(BAR|BEAM3?|BEND|BUSH([12]D)?|CONEAX|DAMP[1-5]|ELAS[1-4]|FAST|GAP|MASS[1-4]|ONM[12]|ONROD|ROD|SEAM|SHEAR|TUBE|"
    r"VISC|WELD|TRIAX6?|QUADX[48]?|TRAX[36]|PLST[NS][3468])|GENEL|RBAR1?|RBE([123]|2GS)|RROD|RTRPLT1?|RJOINT|RSPLINE|"
    r"RSSCON|MPC"
)
# what begins with C and is no element of a structure
_NO_ELEMENT = re.compile(
    r"C(AERO[1-5]|AMPBLL|AXIF[N234]|BARAO|END|HBDY[EGIP]|LOAD|METHOD|MFREE|NTCT|OMBWLD|ONFIG|ONTRLT|ONVM?|ORD[123]\w|"
    r"REEP|SET1?|SSCHD|SUP(ER|EXT|ORT)|Y\w+)"
)
SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
READ = {
    *SOLIDS, *SURFACES, *SYSTEMS, "GRID", "GRDSET", "PSOLID", "MAT1", "SPC", "SPC1", "SET1",
    *SHELL_PROPERTIES,
}  # fmt: skip
NODE_SET = "1"
# as HyperMesh writes it: number, 1 for nodes or 2 for elements, name
_SET_NAME = re.compile(r'\$HMSET\s+(\d+)\s+(\d+)\s*"([^"\n]+)"')
REAL_COLUMNS, SMALL_REAL = 16, 1e-6
SOLID_PROPERTY = 1


def read_nastran(path: Path) -> RawMesh:
    """Read a ``.bdf`` file.

    Surface elements become a set ``property_N`` per property, the nodes of ``SPC`` and ``SPC1`` cards a set
    ``spc_N``, and those of ``SET1`` cards ``set_N``, or what a comment ``$HMSET`` calls it. Solids of
    a property are the group ``property_N``.

    Raises:
        MeshError: A card cannot be read, is not known, or refers to another file.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    cards, left_out = _sort_cards(path, text)
    nodes = _Nodes(path, cards)
    raw = RawMesh(nodes.positions(), left_out=left_out)
    _add_solids(raw, nodes, cards)
    _add_surfaces(raw, nodes, cards)
    for name, members in _node_sets(text, cards, nodes):
        raw.add_nodes(name, members)
    return raw


def _sort_cards(path: Path, text: str) -> tuple[Mapping[str, Sequence[Card]], Counter[str]]:
    """Return the cards that are read by name, and how many elements of each other kind there are.

    Raises:
        MeshError: A card is not known.
    """
    cards: defaultdict[str, list[Card]] = defaultdict(list)
    left_out: Counter[str] = Counter()
    for card in read_cards(path, text, READ):
        if card.name in READ:
            cards[card.name].append(card)
        elif _OTHER_ELEMENT.fullmatch(card.name):
            left_out[card.name] += 1
        elif card.name.startswith("C") and not _NO_ELEMENT.fullmatch(card.name):
            raise MeshError(
                f"{card.place}: {card.name} is not known; solids are read from CTETRA, CPYRAM, CPENTA and CHEXA"
            )
    return cards, left_out


def _unnamed_properties(elements: Sequence[Card], known: Collection[int]) -> set[int]:
    """Return the properties that are but the number of their one element, as they are where none is
    written.
    """
    count = Counter(card.integer(1, card.integer(0)) for card in elements)
    return {
        card.integer(0)
        for card in elements
        if card.integer(1, card.integer(0)) == card.integer(0) and count[card.integer(0)] == 1
    } - set(known)


@dataclass
class _Nodes:
    """Grid points, and the coordinate systems they are given in."""

    path: Path
    cards: Mapping[str, Sequence[Card]]
    rows: dict[int, int] = field(default_factory=dict)
    given: list[tuple[int, FloatArray]] = field(default_factory=list)
    frames: dict[int, tuple[str, FloatArray, FloatArray]] = field(default_factory=dict)
    pending: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.systems: dict[int, tuple[Card, int]] = {}
        for name in SYSTEMS:
            for card in self.cards.get(name, ()):
                # a card may hold two systems between grid points
                for start in (0, 4) if name.startswith("CORD1") else (0,):
                    number = card.integer(start, -1)
                    if number > 0:
                        first = self.systems.setdefault(number, (card, start))
                        if first != (card, start) and (
                            _system_entry(*first) != _system_entry(card, start)
                        ):
                            raise MeshError(
                                f"{card.place}: coordinate system {number} is defined twice: {card.name} here, "
                                f"{first[0].name} at {first[0].place}; keep one of them"
                            )
        default = next((card.integer(1) for card in self.cards.get("GRDSET", ())), 0)
        for card in self.cards.get("GRID", ()):
            number, entry = card.integer(0, -1), (card.integer(1, default), card.vector(2))
            if number < 1:
                raise MeshError(f"{card.place}: a GRID without a number")
            if number in self.rows:
                earlier = self.given[self.rows[number]]
                if earlier[0] != entry[0] or not np.array_equal(earlier[1], entry[1]):
                    raise MeshError(f"{card.place}: grid point {number} is defined twice")
                continue
            self.rows[number] = len(self.given)
            self.given.append(entry)

    def row(self, card: Card, index: int) -> int:
        """Return the row of the grid point in a field; -1 where it is blank or zero."""
        number = card.integer(index)
        if not number:
            return -1
        if number not in self.rows:
            raise MeshError(
                f"{card.place}: {card.name} {card.integer(0)}: node {number} is used but not defined"
            )
        return self.rows[number]

    def positions(self) -> FloatArray:
        """Return the positions ``(n, 3)`` in the basic system."""
        result = np.zeros((len(self.given), 3))
        numbers = np.array([system for system, _ in self.given], dtype=np.int64)
        values = np.array([coordinates for _, coordinates in self.given]).reshape(-1, 3)
        for system in np.unique(numbers):
            mine = numbers == system
            result[mine] = self._place(int(system), values[mine])
        return result

    def _place(self, system: int, values: FloatArray) -> FloatArray:
        """Return the basic coordinates ``(n, 3)`` of coordinates in a system."""
        if system == 0:
            return values
        kind, origin, axes = self._frame(system)
        first, second, third = values.T
        angle = np.deg2rad(second)
        if kind == "C":
            values = np.stack([first * np.cos(angle), first * np.sin(angle), third], axis=1)
        elif kind == "S":
            # the second is the angle from the axis z
            around, flat = np.deg2rad(third), first * np.sin(angle)
            values = np.stack(
                [flat * np.cos(around), flat * np.sin(around), first * np.cos(angle)], axis=1
            )
        return origin + values @ axes

    def _frame(self, system: int) -> tuple[str, FloatArray, FloatArray]:
        """Return the kind, origin and axes (rows) of a system."""
        if system in self.frames:
            return self.frames[system]
        if system not in self.systems:
            raise MeshError(f"{self.path.name}: coordinate system {system} is used but not defined")
        card, start = self.systems[system]
        if system in self.pending:
            raise MeshError(f"{card.place}: coordinate system {system} refers to itself")
        self.pending.append(system)
        if card.name.startswith("CORD1"):
            points = np.concatenate([self._grid(card, start + 1 + i) for i in range(3)])
        else:
            given_points = np.stack([card.vector(2 + 3 * i) for i in range(3)])
            points = self._place(card.integer(1), given_points)
        self.pending.pop()
        origin, on_axis, in_plane = points
        z = on_axis - origin
        y = np.cross(z, in_plane - origin)
        size = np.linalg.norm(z) * np.linalg.norm(in_plane - origin)
        if not np.linalg.norm(y) > 1e-10 * size:
            raise MeshError(
                f"{card.place}: the points of coordinate system {system} lie on one line"
            )
        x = np.cross(y, z)
        axes = np.stack([axis / np.linalg.norm(axis) for axis in (x, y, z)])
        self.frames[system] = (card.name[-1], origin, axes)
        return self.frames[system]

    def _grid(self, card: Card, index: int) -> FloatArray:
        row = self.row(card, index)
        if row < 0:
            raise MeshError(f"{card.place}: {card.name} lacks a grid point")
        system, values = self.given[row]
        return self._place(system, values[None])


def _system_entry(card: Card, start: int) -> tuple[str, list[int], list[float]]:
    """Return what a coordinate system is: its card, the grid points or system it refers to, its points."""
    if card.name.startswith("CORD1"):
        return card.name, [card.integer(start + 1 + i) for i in range(3)], []
    return card.name, [card.integer(1)], [card.real(2 + i) for i in range(9)]


def _add_surfaces(raw: RawMesh, nodes: _Nodes, cards: Mapping[str, Sequence[Card]]) -> None:
    """Add surface elements to the set of their property, and count those with a thickness."""
    shells = {card.integer(0) for name in SHELL_PROPERTIES for card in cards.get(name, ())}
    for name, count in SURFACES.items():
        elements = cards.get(name, ())
        surfaces: defaultdict[int, list[list[int]]] = defaultdict(list)
        corners = range(2, 5 if count in (3, 6) else 6)
        for card in elements:
            number = card.integer(1, card.integer(0))
            surfaces[number].append([nodes.row(card, field) for field in corners])
            if number in shells:
                raw.left_out[name] += 1
        for number in surfaces.keys() & _unnamed_properties(elements, shells):
            del surfaces[number]
        for number, rows in surfaces.items():
            raw.add_facets(f"property_{number}", np.array(rows, dtype=np.int64))


def _add_solids(raw: RawMesh, nodes: _Nodes, cards: Mapping[str, Sequence[Card]]) -> None:
    """Add solid cells, and which property and material they have."""
    properties: defaultdict[int, list[IntArray]] = defaultdict(list)
    solids = [card.integer(0) for card in cards.get("PSOLID", ())]
    for name, (family, most) in SOLIDS.items():
        elements, first = cards.get(name, ()), CORNERS[family]
        rows = np.array([_cell_nodes(nodes, card, first, most) for card in elements])
        rows = rows.reshape(-1, most)
        numbers = np.array([card.integer(0) for card in elements], dtype=np.int64)
        owners = np.array([card.integer(1, card.integer(0)) for card in elements], dtype=np.int64)
        unnamed = _unnamed_properties(elements, solids)
        curved = (rows[:, first:] >= 0).any(axis=1)
        for chosen, block in ((curved, rows), (~curved, rows[:, :first])):
            cells = raw.add_solids(
                family, block[chosen], edges=upright_first(family), numbers=numbers[chosen]
            )
            for number in set(map(int, owners[chosen])) - unnamed:
                properties[number].append(cells[owners[chosen] == number])
    _refuse_repeated_numbers(nodes.path, raw)
    _add_materials(raw, cards, {name: np.concatenate(parts) for name, parts in properties.items()})


def _add_materials(
    raw: RawMesh, cards: Mapping[str, Sequence[Card]], properties: Mapping[int, IntArray]
) -> None:
    """Add the material of the cells ``(n,)`` of each property."""
    solids = {card.integer(0): card for card in cards.get("PSOLID", ())}
    materials = {card.integer(0): card for card in cards.get("MAT1", ())}
    for number, cells in properties.items():
        material = None if number not in solids else solids[number].integer(1)
        text = "" if material is None else f"material {material}"
        key: Hashable = material
        if material is not None and (card := materials.get(material)):
            shown = {"E": 1, "nu": 3, "density": 4}
            text += ": " + ", ".join(f"{word} = {card.real(at):g}" for word, at in shown.items())
            key = tuple(card.real(at) for at in range(1, 5))
        raw.add_section(f"property_{number}", cells, text, key)


def _cell_nodes(nodes: _Nodes, card: Card, corners: int, most: int) -> list[int]:
    """Return the rows ``(most,)`` of the nodes of a cell, -1 where there is none.

    Raises:
        MeshError: It lacks a corner, or has more.
    """
    rows = [nodes.row(card, index) for index in range(2, len(card.fields))]
    if max(rows[most:], default=-1) >= 0 or min([*rows[:corners], len(rows) - corners]) < 0:
        raise MeshError(
            f"{card.place}: {card.name} {card.integer(0)} needs {corners} corners and has at most {most} nodes"
        )
    return (rows + [-1] * most)[:most]


def _refuse_repeated_numbers(path: Path, raw: RawMesh) -> None:
    """Refuse different cells of one number; equal ones are counted with what is in the file twice."""
    cells_by_number: dict[int, bytes] = {}
    for block in raw.solids:
        for number, row in zip(block.numbers, block.nodes, strict=True):
            if cells_by_number.setdefault(int(number), row.tobytes()) != row.tobytes():
                raise MeshError(f"{path.name}: element {number} is defined twice")


def _node_sets(
    text: str, cards: Mapping[str, Sequence[Card]], nodes: _Nodes
) -> Iterator[tuple[str, IntArray]]:
    """Yield the name and rows of the nodes of each card that lists nodes."""
    grid_numbers = np.array(sorted(nodes.rows), dtype=np.int64)
    rows = np.array([nodes.rows[int(number)] for number in grid_numbers], dtype=np.int64)

    def find(card: Card, start: int) -> tuple[IntArray, bool]:
        """Return the rows of the nodes that are listed, and whether all numbers are of nodes."""
        mine = np.zeros(len(grid_numbers), dtype=bool)
        words = [word for word in card.fields[start:] if word]
        single = []
        for at, word in enumerate(words):
            if word.upper() != "THRU":
                single.append(word)
                continue
            try:
                first, last = int(words[at - 1]), int(words[at + 1])
            except (ValueError, IndexError):
                raise MeshError(
                    f"{card.place}: {card.name}: a range of numbers has no end"
                ) from None
            mine |= (grid_numbers >= first) & (grid_numbers <= last)
        try:
            numbers = np.array([int(word) for word in single], dtype=np.int64)
        except (ValueError, OverflowError):
            return rows[:0], False
        mine |= np.isin(grid_numbers, numbers)
        return rows[mine], bool(np.isin(numbers, grid_numbers).all()) and bool(mine.any())

    for card in cards.get("SPC1", ()):
        yield f"spc_{card.integer(0)}", find(card, 2)[0]
    for card in cards.get("SPC", ()):
        set_rows = [nodes.rows[n] for n in (card.integer(1), card.integer(4)) if n in nodes.rows]
        yield f"spc_{card.integer(0)}", np.array(set_rows, dtype=np.int64)
    comments = {number: (kind, name) for number, kind, name in _SET_NAME.findall(text)}
    for card in cards.get("SET1", ()):
        number = str(card.integer(0))
        kind, name = comments.get(number, (NODE_SET, f"set_{number}"))
        members, every = find(card, 1)
        # a SET1 card may also hold elements, whose numbers need not be those of nodes
        if kind == NODE_SET and every:
            yield name, members


def format_bulk_data(points: FloatArray, cells: IntArray, sets: Mapping[str, IntArray]) -> str:
    """Return a mesh as bulk data, its node sets as ``SET1`` cards with comments that name them.

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


def _card_lines(fields: Sequence[str | int | np.int64]) -> list[str]:
    """Return a card in fields of 8 columns, eight behind the name or the sign of continuation."""
    name, rest = fields[0], fields[1:]
    return [
        "".join(f"{word:<8}" for word in ["+" if start else name, *rest[start : start + 8]])
        for start in range(0, len(rest), 8)
    ]


def _real(value: float) -> str:
    """Return a number in 16 columns, as exact as they allow; Nastran wants a decimal point."""
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
