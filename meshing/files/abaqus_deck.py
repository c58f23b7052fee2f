"""What input decks of Abaqus and CalculiX hold, by their own names and numbers.

Source: Abaqus Keywords Reference Guide; Analysis User's Guide, "Three-dimensional solid element library".
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from headstock.geometry.frames import FloatArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import SolidFamily

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
# what makes or brings nodes and elements by rules that are not known here
REFUSED = frozenset(
    ("INCLUDE", "MANIFEST", "NFILL", "NCOPY", "NMAP", "ELCOPY", "PARAMETER", "SYMMETRIC MODEL GENERATION")
)  # fmt: skip
CONSTRAINTS = frozenset(
    ("COUPLING", "RIGID BODY", "MPC", "EQUATION", "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "FASTENER",
     "EMBEDDED ELEMENT", "SHELL TO SOLID COUPLING")
)  # fmt: skip
MESH_KEYWORDS = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SYSTEM")
SCOPES = ("PART", "INSTANCE", "ASSEMBLY", "END PART", "END INSTANCE", "END ASSEMBLY")
SHELL_SECTIONS = ("SHELL SECTION", "SHELL GENERAL SECTION", "MEMBRANE SECTION")
LONGEST_RANGE = 10_000_000


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
        """Return a set, part or material that an option names.

        Raises:
            MeshError: It names none.
        """
        if not self.options.get(name):
            raise MeshError(f"{self.place}: *{self.keyword} needs {name}=")
        return self.options[name]


@dataclass(frozen=True)
class _Members:
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
class _Elements:
    """Elements of one type.

    Attributes:
        family: Of solids; None of surface elements.
        nodes: Node numbers by element number; corners alone of surface elements.
    """

    family: SolidFamily | None
    nodes: dict[int, list[int]] = field(default_factory=dict)


@dataclass
class _Scope:
    """Definitions of a part, an instance or the deck itself, by its own numbers.

    Attributes:
        numbers: Nodes by element number, of solids and surface elements.
        others: Numbers of elements that are left out.
        node_sets: Members by name in upper case.
        surfaces: Blocks of each named surface, by name in upper case.
        internal: Sets that only help to define others.
        sections: Set in upper case, its material or those of its layers, and where that stands.
        shells: Sets with a thickness, in upper case.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[str, _Elements] = field(default_factory=dict)
    numbers: dict[int, list[int]] = field(default_factory=dict)
    others: set[int] = field(default_factory=set)
    node_sets: dict[str, list[_Members]] = field(default_factory=dict)
    element_sets: dict[str, list[_Members]] = field(default_factory=dict)
    surfaces: dict[str, list[Block]] = field(default_factory=dict)
    internal: set[str] = field(default_factory=set)
    sections: list[tuple[str, list[str], str]] = field(default_factory=list)
    shells: list[str] = field(default_factory=list)


@dataclass
class Instance:
    """A part in its place.

    Attributes:
        name: As written; empty for the deck itself.
        own: What stands between its own keywords, a mesh of its own where it has one.
        rotation: ``(3, 3)``.
        shift: ``(3,)``, added after the rotation.
        cells: Which solid cell of the mesh each of its solid elements is.
        sheets: Numbers of elements that have a section without solids.
    """

    name: str
    scope: _Scope
    own: _Scope = field(default_factory=_Scope)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    shift: FloatArray = field(default_factory=lambda: np.zeros(3))
    rows: dict[int, int] = field(default_factory=dict)
    cells: dict[int, int] = field(default_factory=dict)
    sheets: set[int] = field(default_factory=set)


@dataclass
class Deck:
    """Contents of a deck.

    Attributes:
        root: What stands outside of parts and instances.
        parts: By name in upper case.
        materials: Numbers of each material by keyword, by name in upper case.
        ties: Surfaces of each pair that is bonded, with their place.
        left_out: Elements and constraints that are no solid cells, by kind.
        repeated: Number of elements that were defined before, alike.
    """

    root: _Scope = field(default_factory=_Scope)
    parts: dict[str, _Scope] = field(default_factory=dict)
    instances: list[Instance] = field(default_factory=list)
    materials: dict[str, dict[str, tuple[float, ...]]] = field(default_factory=dict)
    ties: list[tuple[str, str, str]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    repeated: int = 0


def _blocks(path: Path) -> Iterator[Block]:
    """Yield the keyword blocks; a keyword line that ends in a comma goes on in the next."""
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
    """Return the numbers of data lines, without the blanks at their ends."""
    numbers: list[float] = []
    for row in rows:
        while row and not row[-1]:
            row = row[:-1]
        numbers += [_number(word) for word in row]
    return numbers


class DeckReader:
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
        keyword = block.keyword
        if keyword in TAKEN:
            TAKEN[keyword](self, block)
        elif keyword in CONSTRAINTS:
            self.deck.left_out[f"*{keyword}"] += 1

    def _change_scope(self, block: Block) -> None:
        self.scope, self.system = self.deck.root, None
        if block.keyword == "PART":
            self.scope = self.deck.parts[block.option("NAME").upper()] = _Scope()
        elif block.keyword == "INSTANCE":
            self.scope = self._start_instance(block)

    def _set_system(self, block: Block) -> None:
        self.system = _read_system(block)

    def _add_surface(self, block: Block) -> None:
        self.scope.surfaces.setdefault(block.option("NAME").upper(), []).append(block)

    def _add_section(self, block: Block) -> None:
        options = block.options
        materials = [options.get("MATERIAL", options.get("COMPOSITE", ""))]
        if "COMPOSITE" in options:
            # a layer a line: thickness, integration points, material
            layers = [row[2] for row in block.rows if len(row) > 2 and row[2]]
            materials = list({name.upper(): name for name in layers}.values()) or materials
        self.scope.sections.append((block.option("ELSET").upper(), materials, block.place))

    def _add_shell(self, block: Block) -> None:
        self.scope.shells.append(block.options.get("ELSET", "").upper())

    def _start_material(self, block: Block) -> None:
        self.material = self.deck.materials.setdefault(block.option("NAME").upper(), {})

    def _add_property(self, block: Block) -> None:
        self.material.setdefault(block.keyword, tuple(_numbers(block.rows)))

    def _add_tie(self, block: Block) -> None:
        pairs = [row for row in block.rows if len(row) > 1]
        self.deck.ties += [(row[0].upper(), row[1].upper(), block.place) for row in pairs]

    def _start_instance(self, block: Block) -> _Scope:
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
            if not np.linalg.norm(b - a) > 0.0:
                raise MeshError(
                    f"{block.place}: *INSTANCE, NAME={block.option('NAME')}: both points of its rotation axis are "
                    f'({", ".join(f"{value:g}" for value in a)}), in the line "{", ".join(block.rows[-1])}"; write two '
                    "different points, or leave the line out"
                )
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
        self._place_nodes(block, numbers, places)

    def _place_nodes(self, block: Block, numbers: Sequence[int], places: FloatArray) -> None:
        for number, position in zip(numbers, places, strict=True):
            x, y, z = (float(value) for value in position)
            if self.scope.nodes.setdefault(number, (x, y, z)) != (x, y, z) and np.isfinite(
                x + y + z
            ):
                raise ValueError(f"node {number} is defined twice")
        if "NSET" in block.options:
            members = _Members(block.place, "", tuple(numbers))
            self.scope.node_sets.setdefault(block.option("NSET").upper(), []).append(members)

    def _generate_nodes(self, block: Block) -> None:
        """Generate nodes at even steps on the line between two others."""
        if block.options.keys() - {"NSET"}:
            raise MeshError(
                f"{block.place}: *NGEN is read along straight lines only, without {', '.join(block.options)}; "
                "write the nodes out"
            )
        for row in block.rows:
            first, last, step = (int(word or 1) for word in [*row, "1"][:3])
            if step < 1 or not 0 < last - first <= LONGEST_RANGE or (last - first) % step:
                raise ValueError(f"{first} to {last} by {step} is no range of numbers")
            numbers = range(first, last + 1, step)
            ends = np.array([self.scope.nodes[first], self.scope.nodes[last]])
            shares = np.linspace(0.0, 1.0, len(numbers))[1:-1, None]
            between = (1.0 - shares) * ends[0] + shares * ends[1]
            self._place_nodes(block, numbers, np.concatenate([ends[:1], between, ends[1:]]))

    def _define(self, elements: _Elements, number: int, nodes: list[int]) -> bool:
        """Take an element; return whether it was defined before, alike."""
        repeated = number in self.scope.numbers
        if repeated and self.scope.numbers[number] != nodes:
            raise ValueError(f"element {number} is defined twice")
        self.scope.numbers[number] = elements.nodes[number] = nodes
        return repeated

    def _generate_elements(self, block: Block) -> None:
        """Generate elements like a given one, in up to three directions, each with its steps of
        nodes and of elements.
        """
        made: list[int] = []
        for row in block.rows:
            words = [int(word or 1) for word in row] + [1] * (10 - len(row))
            master = words[0]
            kind = next((e for e in self.scope.elements.values() if master in e.nodes), None)
            if kind is None:
                raise ValueError(f"there is no solid or surface element {master}")
            counts, node_steps, steps = (np.array(words[start:10:3]) for start in (1, 2, 3))
            if min(words[1:10]) < 1 or np.prod(counts, dtype=float) > LONGEST_RANGE:
                raise ValueError("its counts and steps are no whole numbers above zero")
            for offsets in np.ndindex(*counts):
                number, shift = master + int(offsets @ steps), int(offsets @ node_steps)
                self._define(kind, number, [node + shift for node in kind.nodes[master]])
                made.append(number)
        self._name_elements(block, made)

    def _add_elements(self, block: Block) -> None:
        kind = block.option("TYPE").upper()
        if solid := _SOLID.match(kind):
            count = used = int(solid[1])
        elif surface := _SURFACE.match(kind):
            count, used = SURFACE_NODES[surface[1]]
        else:
            self._leave_out(block, kind)
            return
        numbers = [int(word) for row in block.rows for word in row if word]
        if len(numbers) % (count + 1):
            raise ValueError(
                f"{kind} needs {count} nodes per element; {len(numbers)} numbers do not divide into elements"
            )
        family = SOLID_COUNTS[count] if solid else None
        elements = self.scope.elements.setdefault(kind, _Elements(family))
        members = numbers[:: count + 1]
        for row, number in enumerate(members):
            first = row * (count + 1) + 1
            self.deck.repeated += self._define(elements, number, numbers[first : first + used])
        self._name_elements(block, members)

    def _leave_out(self, block: Block, kind: str) -> None:
        """Count elements without a volume.

        Raises:
            MeshError: They are of no known type.
        """
        if not _OTHER.match(kind):
            raise MeshError(
                f"{block.place}: elements of type {kind} are not read; solids are C3D4, C3D5, C3D6, C3D8, C3D10, "
                "C3D13, C3D15, C3D20 and C3D27 with what follows in letters"
            )
        # a line that ends in a comma goes on in the next
        starts = [0, *(at for at, row in enumerate(block.rows[:-1], 1) if row[-1])]
        numbers = [int(block.rows[at][0]) for at in starts if block.rows]
        self.deck.left_out[kind] += len(numbers)
        self.scope.others.update(numbers)
        self._name_elements(block, numbers)

    def _name_elements(self, block: Block, numbers: Sequence[int]) -> None:
        if "ELSET" in block.options:
            members = _Members(block.place, "", tuple(numbers))
            self.scope.element_sets.setdefault(block.option("ELSET").upper(), []).append(members)

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
        sets.setdefault(name, []).append(_Members(block.place, instance, tuple(items)))
        if "INTERNAL" in block.options:
            self.scope.internal.add(name)


# what is done with the block of each keyword that is read
TAKEN: dict[str, Callable[[DeckReader, Block], None]] = {
    **dict.fromkeys(SCOPES, DeckReader._change_scope),
    "SYSTEM": DeckReader._set_system,
    "NODE": DeckReader._add_nodes,
    "ELEMENT": DeckReader._add_elements,
    "NGEN": DeckReader._generate_nodes,
    "ELGEN": DeckReader._generate_elements,
    "NSET": DeckReader._add_set,
    "ELSET": DeckReader._add_set,
    "SURFACE": DeckReader._add_surface,
    "SOLID SECTION": DeckReader._add_section,
    **dict.fromkeys(SHELL_SECTIONS, DeckReader._add_shell),
    "MATERIAL": DeckReader._start_material,
    "ELASTIC": DeckReader._add_property,
    "DENSITY": DeckReader._add_property,
    "TIE": DeckReader._add_tie,
}


def _read_system(block: Block) -> tuple[FloatArray, FloatArray] | None:
    """Return the origin and axes (rows) of the coordinates that follow; None for global ones.

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
