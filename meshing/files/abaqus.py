"""Reads input decks of Abaqus and CalculiX: flat ones, and those of Abaqus/CAE with parts and instances.

Source: Abaqus Keywords Reference Guide; Analysis User's Guide, "Three-dimensional solid element library".
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.families import CORNERS, VTK_EDGES, SolidFamily
from headstock.meshing.files.raw_mesh import RawMesh

SOLID_COUNTS: dict[int, SolidFamily] = {
    4: "tet", 10: "tet", 5: "pyramid", 13: "pyramid", 6: "wedge", 15: "wedge", 8: "hex", 20: "hex",
    27: "hex",
}  # fmt: skip
# letters behind the number of nodes: reduced integration, hybrid, incompatible modes and the like; V is
# a variable number of nodes
_SOLID = re.compile(r"(?:DC|C|Q)3D(4|5|6|8|10|13|15|20|27)([A-UW-Z]*)$")
_SURFACE = re.compile(r"(?:S|SFM3D|M3D|CPS|CPE|STRI|DS)(3|4|65|6|8|9)[A-Z]*5?$")
# elements without a volume, whose stiffness and mass are left out
_OTHER = re.compile(
    r"(?:MASS|ROTARYI|SPRING[12A]|DASHPOT[12A]|B[23][123]\w*|PIPE\w+|T[23]D[23]\w*|CONN[23]D2|DCOUP[23]D|RB?[23]D[234]|"
    r"RAX2|GAP\w+|DGAP|FRAME[23]D|ELBOW\w+|JOINTC|JOINT[23]D|DRAG[23]D|HEATCAP|ITSCYL|ITT[23]1|LS[36S]|PSI\w+|SAX\w+|"
    r"CAX\w+|DCAX\w+|DC[12]D\w+|MAX\w+|MGAX\w+|CGAX\w+|CPEG\w+|F3D[34]|FAX2|U\d+)$"
)
# what stands between commas, which names in quotes may hold
_QUOTED = re.compile(r'(?:"[^"]*"|[^,"])+')
# nodes and corners of surface elements by the number in their type
SURFACE_NODES = {"3": (3, 3), "6": (6, 3), "65": (6, 3), "4": (4, 4), "8": (8, 4), "9": (9, 4)}
# corners of faces S1 .. S6
SOLID_FACES: dict[SolidFamily, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hex": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}  # fmt: skip
REFUSED = frozenset(
    "INCLUDE NGEN NFILL NCOPY NMAP ELGEN ELCOPY PARAMETER SYMMETRIC_MODEL_GENERATION MANIFEST".replace(
        "_", " "
    ).split()
)
CONSTRAINTS = frozenset(
    ("COUPLING", "RIGID BODY", "MPC", "EQUATION", "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "FASTENER",
     "EMBEDDED ELEMENT", "SHELL TO SOLID COUPLING")
)  # fmt: skip
MESH_KEYWORDS = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SYSTEM")
SHELL_SECTIONS = ("SHELL SECTION", "SHELL GENERAL SECTION", "MEMBRANE SECTION")
LONGEST_RANGE = 10_000_000
SURFACE_KINDS = ("ELEMENT", "NODE")
COINCIDENT = 1e-6  # of the size of the mesh


@dataclass
class Block:
    """A keyword with its options and data lines.

    Attributes:
        place: Name of the file and number of the line, for messages.
        keyword: Upper case, single spaces.
        options: By name in upper case.
        rows: Fields of each data line.
    """

    place: str
    keyword: str
    options: dict[str, str]
    rows: list[list[str]]

    def option(self, name: str) -> str:
        """A set, part or material that an option names.

        Raises:
            MeshError: It names none.
        """
        if not self.options.get(name):
            raise MeshError(f"{self.place}: *{self.keyword} needs {name}=")
        return self.options[name]


@dataclass(frozen=True)
class Members:
    """Members of a set.

    Attributes:
        place: Name of the file and number of the line, for messages.
        instance: Whose they are, in upper case; empty for the scope of the set itself.
        items: Numbers, ranges of them and names of other sets in upper case.
    """

    place: str
    instance: str
    items: tuple[int | range | str, ...]


@dataclass
class Elements:
    """Elements of one type.

    Attributes:
        family: Of solids; None of surface elements.
        nodes: Node numbers by element number; corners alone of surface elements.
    """

    family: SolidFamily | None
    nodes: dict[int, list[int]] = field(default_factory=dict)


@dataclass
class Scope:
    """What a part, an instance or the deck itself defines, by its own numbers.

    Attributes:
        nodes: Node number to position.
        elements: By type.
        numbers: Nodes by element number, of solids and surface elements.
        others: Numbers of elements that are left out.
        node_sets: Members by name in upper case.
        element_sets: The same of elements.
        surfaces: Blocks of each named surface, by name in upper case.
        internal: Sets that only help to define others.
        sections: Set and material, in upper case, and where that stands.
        shells: Sets with a thickness, in upper case.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[str, Elements] = field(default_factory=dict)
    numbers: dict[int, list[int]] = field(default_factory=dict)
    others: set[int] = field(default_factory=set)
    node_sets: dict[str, list[Members]] = field(default_factory=dict)
    element_sets: dict[str, list[Members]] = field(default_factory=dict)
    surfaces: dict[str, list[Block]] = field(default_factory=dict)
    internal: set[str] = field(default_factory=set)
    sections: list[tuple[str, str, str]] = field(default_factory=list)
    shells: list[str] = field(default_factory=list)


@dataclass
class Instance:
    """A part in its place.

    Attributes:
        name: As written; empty for the deck itself.
        scope: Of its part.
        own: What stands between its own keywords, a mesh of its own where it has one.
        rotation: ``(3, 3)``.
        shift: ``(3,)``, added after the rotation.
        rows: Row of each of its nodes in the mesh.
        cells: Which solid cell of the mesh each of its solid elements is.
    """

    name: str
    scope: Scope
    own: Scope = field(default_factory=Scope)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    shift: FloatArray = field(default_factory=lambda: np.zeros(3))
    rows: dict[int, int] = field(default_factory=dict)
    cells: dict[int, int] = field(default_factory=dict)


@dataclass
class Deck:
    """What a deck holds.

    Attributes:
        root: What stands outside of parts and instances.
        parts: By name in upper case.
        instances: In their order.
        materials: Numbers of each material by keyword, by name in upper case.
        ties: Surfaces of each pair that is bonded, with their place.
        left_out: Elements and constraints that are no solid cells, by kind.
        repeated: Number of elements that were defined before, alike.
    """

    root: Scope = field(default_factory=Scope)
    parts: dict[str, Scope] = field(default_factory=dict)
    instances: list[Instance] = field(default_factory=list)
    materials: dict[str, dict[str, tuple[float, ...]]] = field(default_factory=dict)
    ties: list[tuple[str, str, str]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    repeated: int = 0


def read_abaqus(path: Path) -> RawMesh:
    """Read an ``.inp`` deck; surfaces, node sets and sets of surface elements become named sets.

    Raises:
        MeshError: The deck holds something that this reader does not know; named with its line.
    """
    deck = _DeckReader(path).read()
    instances = deck.instances
    if not instances:
        instances = [Instance(name, scope) for name, scope in deck.parts.items()]
    return _Assembly(path, deck, [*instances, Instance("", deck.root)]).mesh()


def _blocks(path: Path) -> Iterator[Block]:
    """Keyword blocks; a keyword line that ends in a comma goes on in the next."""
    block: Block | None = None
    head, start = "", 0
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, raw in enumerate(file, 1):
            text = raw.strip()
            if not text or text.startswith("**"):
                continue
            if head or text.startswith("*"):
                if not head and block is not None:
                    yield block
                    block = None
                head, start = head + text, start or number
                if text.endswith(","):
                    continue
                block = _parse_keyword(f"{path.name}:{start}", head)
                head, start = "", 0
            elif block is not None:
                words = _QUOTED.findall(text) if '"' in text else text.split(",")
                block.rows.append([word.strip().strip('"') for word in words])
    if block is not None:
        yield block


def _parse_keyword(place: str, text: str) -> Block:
    first, *rest = _QUOTED.findall(text[1:]) or [""]
    options = {}
    for option in rest:
        key, _, value = option.partition("=")
        options[" ".join(key.split()).upper()] = value.strip().strip('"')
    return Block(place, " ".join(first.split()).upper(), options, [])


def _number(text: str) -> float:
    return float(text.upper().replace("D", "E")) if text else 0.0


def _numbers(rows: Sequence[Sequence[str]]) -> list[float]:
    """Numbers of data lines, without the blanks at their ends."""
    found: list[float] = []
    for row in rows:
        while row and not row[-1]:
            row = row[:-1]
        found += [_number(word) for word in row]
    return found


class _DeckReader:
    """Reads the blocks of a deck one after the other."""

    def __init__(self, path: Path) -> None:
        self.path, self.deck = path, Deck()
        self.scope = self.deck.root
        self.material: dict[str, tuple[float, ...]] = {}
        self.system: tuple[FloatArray, FloatArray] | None = None

    def read(self) -> Deck:
        """Read the deck.

        Raises:
            MeshError: It holds something that is not known.
        """
        for block in _blocks(self.path):
            outside = block.keyword in MESH_KEYWORDS and "INPUT" in block.options
            if block.keyword in REFUSED or outside:
                raise MeshError(
                    f"{block.place}: *{block.keyword}{', INPUT=' if outside else ''} is not supported; write "
                    "all nodes and elements into one file"
                )
            try:
                self._take(block)
            except (ValueError, KeyError, IndexError) as error:
                raise MeshError(
                    f"{block.place}: cannot read this *{block.keyword} block ({type(error).__name__}: {error})"
                ) from error
        return self.deck

    def _take(self, block: Block) -> None:
        deck, keyword, options = self.deck, block.keyword, block.options
        if keyword in ("PART", "INSTANCE", "ASSEMBLY", "END PART", "END INSTANCE", "END ASSEMBLY"):
            self.scope, self.system = deck.root, None
            if keyword == "PART":
                self.scope = deck.parts[block.option("NAME").upper()] = Scope()
            elif keyword == "INSTANCE":
                self.scope = self._start_instance(block)
        elif keyword == "SYSTEM":
            self.system = _read_system(block)
        elif keyword == "NODE":
            self._add_nodes(block)
        elif keyword == "ELEMENT":
            self._add_elements(block)
        elif keyword in ("NSET", "ELSET"):
            self._add_set(block)
        elif keyword == "SURFACE":
            self.scope.surfaces.setdefault(block.option("NAME").upper(), []).append(block)
        elif keyword == "SOLID SECTION":
            material = options.get("MATERIAL", options.get("COMPOSITE", ""))
            self.scope.sections.append((block.option("ELSET").upper(), material, block.place))
        elif keyword in SHELL_SECTIONS:
            self.scope.shells.append(options.get("ELSET", "").upper())
        elif keyword == "MATERIAL":
            self.material = deck.materials.setdefault(block.option("NAME").upper(), {})
        elif keyword in ("ELASTIC", "DENSITY"):
            self.material.setdefault(keyword, tuple(_numbers(block.rows)))
        elif keyword == "TIE":
            pairs = [row for row in block.rows if len(row) > 1]
            deck.ties += [(row[0].upper(), row[1].upper(), block.place) for row in pairs]
        elif keyword in CONSTRAINTS:
            deck.left_out[f"*{keyword}"] += 1

    def _start_instance(self, block: Block) -> Scope:
        if "LIBRARY" in block.options or "INSTANCE" in block.options:
            raise MeshError(f"{block.place}: instances of other analyses are not supported")
        part = block.option("PART").upper()
        if part not in self.deck.parts:
            raise MeshError(f"{block.place}: there is no part {part}")
        moves = [_numbers([row]) for row in block.rows if any(row)]
        rotation: FloatArray = np.eye(3)
        shift: FloatArray = np.zeros(3)
        if moves and len(moves[0]) <= 3:
            shift = np.array((moves.pop(0) + [0.0] * 3)[:3])
        if moves:
            # about the line from a to b, once it has been moved
            a, b, degrees = np.array(moves[0][:3]), np.array(moves[0][3:6]), moves[0][6]
            axis = (b - a) / np.linalg.norm(b - a)
            rotation = Rotation.from_rotvec(np.deg2rad(degrees) * axis).as_matrix()
            shift = rotation @ (shift - a) + a
        scope = self.deck.parts[part]
        instance = Instance(block.option("NAME"), scope, rotation=rotation, shift=shift)
        self.deck.instances.append(instance)
        return instance.own

    def _add_nodes(self, block: Block) -> None:
        numbers = [int(row[0]) for row in block.rows]
        places: FloatArray = np.array(
            [[_number(word) for word in [*row[1:4], "", "", ""][:3]] for row in block.rows]
        ).reshape(-1, 3)
        kind = block.options.get("SYSTEM", "R").upper()
        if kind not in ("R", "C"):
            raise MeshError(
                f"{block.place}: *NODE, SYSTEM={kind} is not supported; write SYSTEM=R or C"
            )
        if kind == "C":
            radius, angle = places[:, 0], np.deg2rad(places[:, 1])
            places = np.stack(
                [radius * np.cos(angle), radius * np.sin(angle), places[:, 2]], axis=1
            )
        if self.system is not None:
            origin, axes = self.system
            places = origin + places @ axes
        for number, place in zip(numbers, places, strict=True):
            x, y, z = (float(value) for value in place)
            if self.scope.nodes.setdefault(number, (x, y, z)) != (x, y, z) and np.isfinite(
                x + y + z
            ):
                raise ValueError(f"node {number} is defined twice")
        if "NSET" in block.options:
            own = Members(block.place, "", tuple(numbers))
            self.scope.node_sets.setdefault(block.option("NSET").upper(), []).append(own)

    def _add_elements(self, block: Block) -> None:
        kind = block.option("TYPE").upper()
        solid, surface = _SOLID.match(kind), _SURFACE.match(kind)
        if solid is None and surface is None:
            if not _OTHER.match(kind):
                raise MeshError(
                    f"{block.place}: elements of type {kind} are not read; solids are C3D4, C3D5, C3D6, C3D8, C3D10, "
                    "C3D13, C3D15, C3D20 and C3D27 with what follows in letters"
                )
            # a line that ends in a comma goes on in the next
            starts = [0, *(at for at, row in enumerate(block.rows[:-1], 1) if row[-1])]
            found = [int(block.rows[at][0]) for at in starts if block.rows]
            self.deck.left_out[kind] += len(found)
            self.scope.others.update(found)
            self._name_elements(block, found)
            return
        if solid is not None:
            count = used = int(solid[1])
        else:
            count, used = SURFACE_NODES[surface[1] if surface is not None else ""]
        numbers = [int(word) for row in block.rows for word in row if word]
        if len(numbers) % (count + 1):
            raise ValueError(
                f"{kind} needs {count} nodes per element; {len(numbers)} numbers do not divide into elements"
            )
        family = SOLID_COUNTS[count] if solid is not None else None
        own = self.scope.elements.setdefault(kind, Elements(family))
        members = []
        for start in range(0, len(numbers), count + 1):
            number, nodes = numbers[start], numbers[start + 1 : start + 1 + used]
            if number in self.scope.numbers:
                if self.scope.numbers[number] != nodes:
                    raise ValueError(f"element {number} is defined twice")
                self.deck.repeated += 1
            self.scope.numbers[number] = own.nodes[number] = nodes
            members.append(number)
        self._name_elements(block, members)

    def _name_elements(self, block: Block, numbers: Sequence[int]) -> None:
        if "ELSET" in block.options:
            found = Members(block.place, "", tuple(numbers))
            self.scope.element_sets.setdefault(block.option("ELSET").upper(), []).append(found)

    def _add_set(self, block: Block) -> None:
        sets = self.scope.node_sets if block.keyword == "NSET" else self.scope.element_sets
        name = block.option(block.keyword).upper()
        items: list[int | range | str] = []
        for row in block.rows:
            words = [word for word in row if word]
            if any(key.startswith("GEN") for key in block.options):
                first, last = int(words[0]), int(words[min(1, len(words) - 1)])
                step = int(words[2]) if len(words) > 2 else 1
                if step < 1 or (last - first) // step > LONGEST_RANGE:
                    raise ValueError(f"{first} to {last} is no range of numbers")
                items.append(range(first, last + 1, step))
                continue
            items += [int(word) if word.isdigit() else word.upper() for word in words]
        instance = block.options.get("INSTANCE", "").upper()
        sets.setdefault(name, []).append(Members(block.place, instance, tuple(items)))
        if "INTERNAL" in block.options:
            self.scope.internal.add(name)


def _read_system(block: Block) -> tuple[FloatArray, FloatArray] | None:
    """Origin and axes (rows) of the coordinates that follow; None for global ones.

    The first line holds the origin and a point on the axis x, the second a point in the plane xy; without
    the second the axis z stays where it was.
    """
    values = _numbers(block.rows[:1])
    if not any(values) and len(block.rows) < 2:
        return None
    origin = np.array((values + [0.0] * 3)[:3])
    if len(values) <= 3:
        return origin, np.eye(3)
    x = np.array((values[3:] + [0.0] * 3)[:3]) - origin
    if len(block.rows) > 1:
        z = np.cross(x, np.array((_numbers(block.rows[1:2]) + [0.0] * 3)[:3]) - origin)
    else:
        z = np.array([0.0, 0.0, 1.0]) - x * x[2] / (x @ x)
    if not np.linalg.norm(z) > 0.0 < np.linalg.norm(x):
        raise ValueError("its points lie on one line")
    axes = np.stack([x, np.cross(z, x), z])
    return origin, axes / np.linalg.norm(axes, axis=1, keepdims=True)


class _Assembly:
    """Parts in their places, their nodes and elements counted over all of them."""

    def __init__(self, path: Path, deck: Deck, instances: Sequence[Instance]) -> None:
        self.path, self.deck, self.instances = path, deck, instances
        self.by_name = {one.name.upper(): one for one in instances}
        places, start = [], 0
        for one in instances:
            own = one.own
            if own.nodes or own.numbers:
                one.scope = own
            elif own.node_sets or own.element_sets or own.surfaces:
                one.scope = replace(
                    one.scope,
                    node_sets=one.scope.node_sets | own.node_sets,
                    element_sets=one.scope.element_sets | own.element_sets,
                    surfaces=one.scope.surfaces | own.surfaces,
                )
            one.rows = {number: start + row for row, number in enumerate(one.scope.nodes)}
            nodes = np.array(list(one.scope.nodes.values())).reshape(-1, 3)
            places.append(nodes @ one.rotation.T + one.shift)
            start += len(nodes)
        self.raw = RawMesh(np.concatenate(places))

    def mesh(self) -> RawMesh:
        """The mesh of the deck."""
        raw, deck = self.raw, self.deck
        self._merge_ties()
        for one in self.instances:
            for kind, elements in one.scope.elements.items():
                if elements.family is not None and elements.nodes:
                    rows = np.array(
                        [
                            self._rows(one, nodes, f"{kind} {number}")
                            for number, nodes in elements.nodes.items()
                        ]
                    )
                    numbers = np.array(list(elements.nodes), dtype=np.int64)
                    cells = raw.add_solids(
                        elements.family, rows, edges=VTK_EDGES[elements.family], numbers=numbers
                    )
                    one.cells |= dict(zip(elements.nodes, map(int, cells), strict=True))
        solid = [one for one in self.instances if one.cells]
        for one in self.instances:
            if one.cells and len(solid) > 1:
                raw.add_group(one.name, np.array(list(one.cells.values())))
            self._add_sets(one)
            self._add_sections(one)
        if deck.repeated:
            raw.notes.append(f"{self.path.name} defines {deck.repeated} elements twice alike")
        used = {id(one.scope.elements) for one in self.instances}
        for name, scope in deck.parts.items():
            if id(scope.elements) not in used and any(
                kind.family for kind in scope.elements.values()
            ):
                raw.notes.append(f"{self.path.name}: part {name} stands in no instance: left out")
        raw.left_out.update(deck.left_out)
        return raw

    def _rows(self, one: Instance, nodes: Sequence[int], what: str) -> list[int]:
        try:
            return [self.alias[one.rows[node]] for node in nodes]
        except KeyError as error:
            raise MeshError(
                f"{self.path.name}: element {what}: node {error} is used but not defined"
            ) from error

    def _find(self, one: Instance, text: str) -> tuple[Instance, str]:
        """The instance and the name or number that ``INSTANCE.NAME`` stands for."""
        owner, dot, rest = text.partition(".")
        if dot and owner in self.by_name:
            return self.by_name[owner], rest
        return one, text

    def _members(
        self, one: Instance, name: str, kind: str, seen: tuple[str, ...] = ()
    ) -> Iterator[tuple[Instance, int]]:
        """Instance and number of each member of a set; kind is ``node`` or ``element``.

        Raises:
            MeshError: There is no such set, or it holds itself.
        """
        sets = one.scope.node_sets if kind == "node" else one.scope.element_sets
        if name not in sets:
            raise MeshError(f"{self.path.name}: there is no {kind} set {name!r}")
        if name in seen:
            raise MeshError(f"{self.path.name}: {kind} set {name!r} holds itself")
        for members in sets[name]:
            owner = self.by_name.get(members.instance) if members.instance else one
            if owner is None:
                raise MeshError(f"{members.place}: there is no instance {members.instance!r}")
            known = owner.rows if kind == "node" else owner.scope.numbers
            for item in members.items:
                if isinstance(item, str):
                    target, rest = self._find(owner, item)
                    if rest.isdigit():
                        yield target, int(rest)
                    else:
                        yield from self._members(target, rest, kind, (*seen, name))
                elif isinstance(item, range):
                    yield from ((owner, number) for number in item if number in known)
                else:
                    yield owner, item

    def _add_sets(self, one: Instance) -> None:
        raw, scope = self.raw, one.scope
        for name in scope.surfaces:
            facets, nodes = self._surface(one, name)
            for corners in (3, 4):
                rows = [facet[:corners] for facet in facets if len(facet) == corners]
                if rows:
                    raw.add_facets(
                        self._name(one, name),
                        "triangle" if corners == 3 else "quad",
                        np.array(rows),
                    )
            if nodes:
                raw.add_nodes(self._name(one, name), np.array(nodes))
        for name in scope.node_sets:
            found = [
                self.alias[owner.rows[number]]
                for owner, number in self._members(one, name, "node")
                if number in owner.rows
            ]
            if found and name not in scope.internal:
                raw.add_nodes(self._name(one, name), np.array(found))
        for name in scope.element_sets:
            if name in scope.internal:
                continue
            members = list(self._members(one, name, "element"))
            cells = [owner.cells[number] for owner, number in members if number in owner.cells]
            raw.add_group(self._name(one, name), np.array(cells, dtype=np.int64))
            if name in scope.surfaces:
                continue
            for owner, number in members:
                if number in owner.scope.numbers and number not in owner.cells:
                    sheet = self._rows(owner, owner.scope.numbers[number], str(number))
                    raw.add_facets(
                        self._name(one, name),
                        "triangle" if len(sheet) == 3 else "quad",
                        np.array([sheet]),
                    )

    def _name(self, one: Instance, name: str) -> str:
        """What a set is called: by its instance where several have one of that name."""
        owners = [
            other for other in self.instances
            if any(name in sets for sets in (other.scope.node_sets, other.scope.element_sets, other.scope.surfaces))
        ]  # fmt: skip
        return f"{one.name}.{name}" if len(owners) > 1 and one.name else name

    def _add_sections(self, one: Instance) -> None:
        for name, material, place in one.scope.sections:
            try:
                members = list(self._members(one, name, "element"))
            except MeshError as error:
                raise MeshError(f"{place}: *SOLID SECTION: {error}") from error
            cells = [owner.cells[number] for owner, number in members if number in owner.cells]
            values = self.deck.materials.get(material.upper(), {})
            elastic, density = values.get("ELASTIC", ()), values.get("DENSITY", ())
            shown = [material]
            shown += [f"E = {elastic[0]:g}, nu = {elastic[1]:g}"] if len(elastic) > 1 else []
            shown += [f"density = {density[0]:g}"] if density else []
            key = (elastic, density) if elastic else material.upper()
            self.raw.add_section(
                self._name(one, name), np.array(cells, dtype=np.int64), ", ".join(shown), key
            )
        for name in one.scope.shells:
            sheets = {number for _, number in self._members(one, name, "element")} if name else ()
            for kind, elements in one.scope.elements.items():
                if elements.family is None:
                    self.deck.left_out[kind] += len(elements.nodes.keys() & sheets)
        self.deck.left_out = +self.deck.left_out

    def _surface(self, one: Instance, name: str) -> tuple[list[list[int]], list[int]]:
        """Nodes of the facets of a surface, those of first order alone, and those of a surface of nodes.

        Raises:
            MeshError: It names elements or faces that are not there.
        """
        facets: list[list[int]] = []
        nodes: list[int] = []
        for block in one.scope.surfaces[name]:
            kind = block.options.get("TYPE", "ELEMENT").upper()
            # others are combined of surfaces, or analytical
            for row in (
                block.rows if kind in SURFACE_KINDS and "COMBINE" not in block.options else ()
            ):
                target, label = ([word.upper() for word in row] + [""])[:2]
                owner, rest = self._find(one, target)
                if kind == "NODE":
                    known = (
                        [(owner, int(rest))]
                        if rest.isdigit()
                        else list(self._members(owner, rest, "node"))
                    )
                    nodes += [self.alias[a.rows[n]] for a, n in known if n in a.rows]
                    continue
                if rest.isdigit():
                    members = [(owner, int(rest))]
                elif rest in owner.scope.element_sets:
                    members = list(self._members(owner, rest, "element"))
                else:
                    raise MeshError(
                        f"{block.place}: surface {name} names an unknown element set {target!r}"
                    )
                free = self._free_faces(members) if not label else set()
                for a, number in members:
                    facets += self._faces(block, a, number, label, free)
        return facets, nodes

    def _faces(
        self, block: Block, one: Instance, number: int, label: str, free: set[frozenset[int]]
    ) -> list[list[int]]:
        """Corners of the faces of an element that a surface names."""
        if number in one.scope.others:
            return []
        if number not in one.scope.numbers:
            raise MeshError(f"{block.place}: there is no element {number}")
        rows = self._rows(one, one.scope.numbers[number], str(number))
        family = next((e.family for e in one.scope.elements.values() if number in e.nodes), None)
        if family is None:
            return [] if label.startswith("E") else [rows]  # E1 is an edge
        faces = SOLID_FACES[family]
        if not label:
            every = [[rows[corner] for corner in face] for face in faces]
            return [face for face in every if frozenset(face) in free]
        place = label.removeprefix("S")
        if not place.isdigit() or not 1 <= int(place) <= len(faces):
            raise MeshError(
                f"{block.place}: face {label!r} of element {number}; write S1 .. S{len(faces)}"
            )
        return [[rows[corner] for corner in faces[int(place) - 1]]]

    def _free_faces(self, members: Sequence[tuple[Instance, int]]) -> set[frozenset[int]]:
        """Faces of solids that no other element of their instances has."""
        counts: Counter[frozenset[int]] = Counter()
        for one in {id(one): one for one, _ in members}.values():
            for elements in one.scope.elements.values():
                for number, nodes in elements.nodes.items() if elements.family else ():
                    rows = self._rows(one, nodes, str(number))
                    counts.update(
                        frozenset(rows[corner] for corner in face)
                        for face in SOLID_FACES[elements.family or "tet"]
                    )
        return {face for face, count in counts.items() if count == 1}

    def _merge_ties(self) -> None:
        """Make one of the nodes on both sides of bonded surfaces whose meshes match."""
        self.alias = list(range(len(self.raw.points)))
        for slave, master, place in self.deck.ties:
            sides = []
            for name in (slave, master):
                one, rest = self._find(self.by_name[""], name)
                if rest not in one.scope.surfaces:
                    raise MeshError(f"{place}: *TIE: there is no surface {name!r}")
                sides.append(np.unique(self._surface_nodes(one, rest)))
            own, other = sides
            if not len(own) or not len(other):
                continue
            size = float(np.ptp(self.raw.points, axis=0).max())
            away, nearest = cKDTree(self.raw.points[other]).query(self.raw.points[own])
            if (away > COINCIDENT * size).any():
                self.deck.left_out["*TIE of meshes that do not match"] += 1
                continue
            for row, target in zip(own, other[nearest], strict=True):
                self.alias[int(row)] = self.alias[int(target)]

    def _surface_nodes(self, one: Instance, name: str) -> IntArray:
        """Rows of all nodes on a surface, those between corners among them."""
        facets, nodes = self._surface(one, name)
        faces = {frozenset(facet) for facet in facets}
        found = {*nodes, *(row for facet in facets for row in facet)}
        for other in self.instances:
            for kind, elements in other.scope.elements.items():
                family = elements.family
                if family is None:
                    continue
                first = CORNERS[family]
                for number, members in elements.nodes.items():
                    rows = self._rows(other, members, f"{kind} {number}")
                    edges = VTK_EDGES[family] if len(rows) > first else ()
                    for face in SOLID_FACES[family]:
                        if frozenset(rows[corner] for corner in face) in faces:
                            found |= {
                                rows[first + place]
                                for place, edge in enumerate(edges)
                                if set(edge) <= set(face)
                            }
        return np.array(sorted(found), dtype=np.int64)
