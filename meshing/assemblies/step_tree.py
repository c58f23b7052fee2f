"""The tree of products in the text of a STEP file (AP203, AP214, AP242; runs in the worker process).

Part 21 of ISO 10303 writes an assembly as product definitions, which next-assembly-usage occurrences
place in one another; how each is rotated there stands between two axis placements.
"""

import contextlib
import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import NamedTuple

import numpy as np

from headstock.geometry.errors import printable
from headstock.geometry.frames import FloatArray, frame_axes
from headstock.meshing.errors import PartFileError
from headstock.meshing.process.worker import Arrays

MOST_ENTITIES = 200_000  # of those that make up the tree
MOST_OCCURRENCES = 20_000
DEEPEST = 40
LONGEST_NAME = 200
END = b"END-ISO-10303-21"
# up to its semicolon; a quote inside a string is doubled
STATEMENT = re.compile(rb"(?:[^';/]++|'[^']*+'|/\*(?:[^*]|\*(?!/))*+\*/|/)*+;")
ENTITY = rb"(?:\s|/\*(?:[^*]|\*(?!/))*+\*/)*+#(\d{1,9})\s*=\s*(?:\(\s*)?(%s)\s*\("
TREE = (
    b"PRODUCT|PRODUCT_DEFINITION|PRODUCT_DEFINITION_FORMATION(?:_WITH_SPECIFIED_SOURCE)?"
    b"|PRODUCT_DEFINITION_SHAPE|NEXT_ASSEMBLY_USAGE_OCCURRENCE|SHAPE_DEFINITION_REPRESENTATION"
    b"|CONTEXT_DEPENDENT_SHAPE_REPRESENTATION|REPRESENTATION_RELATIONSHIP"
    b"|ITEM_DEFINED_TRANSFORMATION"
)
TOKEN = re.compile(rb"'(?:[^']|'')*+'|[(),]|[^'(),]++")
MOVED = re.compile(rb"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION\s*\(\s*(#\d+)")
CODED = re.compile(
    r"\\X2\\([0-9A-Fa-f]*)\\X0\\|\\X4\\([0-9A-Fa-f]*)\\X0\\|\\X\\([0-9A-Fa-f]{2})|\\S\\([ -~])"
)
UNKNOWN = np.full((3, 3), np.nan)

type Entities = dict[int, list[bytes]]


@dataclass
class Occurrences:
    """The tree, opened out: a row per occurrence, parents before children.

    Attributes:
        parents: Row of the parent, -1 for roots.
        labels: Name of the occurrence, or its identifier; of roots their product.
        definitions: Number of the product's definition in the file.
        rotations: From the product to the root ``(3, 3)``; NaN where the file does not give it in
            axis placements.
        broken: Number of occurrences that refer to what is no product.
    """

    parents: list[int] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    products: list[str] = field(default_factory=list)
    definitions: list[int] = field(default_factory=list)
    rotations: list[FloatArray] = field(default_factory=list)
    broken: int = 0

    def arrays(self) -> Arrays:
        """Return an array for each attribute."""
        return {
            "parents": np.array(self.parents, dtype=np.int64),
            "labels": np.array(self.labels, dtype=np.str_),
            "products": np.array(self.products, dtype=np.str_),
            "definitions": np.array(self.definitions, dtype=np.int64),
            "rotations": np.array(self.rotations, dtype=float).reshape(-1, 3, 3),
            "broken": np.array(self.broken),
        }


class _Use(NamedTuple):
    """A product in another: its definition, its label there, its rotation ``(3, 3)``."""

    child: int
    label: str
    rotation: FloatArray


def read_tree(text: bytes, file: str) -> Occurrences:
    """Read the tree of products.

    Args:
        file: Names the file in messages.

    Raises:
        PartFileError: The file is cut off, a product contains itself, or the tree is too large.
    """
    if END not in text[-4096:]:
        raise PartFileError(f"{file} is cut off: it ends without {END.decode()}; export it again")
    entities = _find_entities(text, file)
    names = {number: _name_product(entities, number) for number in entities[b"PRODUCT_DEFINITION"]}
    uses, broken = _find_uses(entities, _read_rotations(entities, text), names)
    _refuse_circles(uses, names, file)
    used = {use.child for below in uses.values() for use in below}
    tree = Occurrences(broken=broken)
    # of each occurrence: use, row of its parent, depth
    waiting = [
        (_Use(root, name, np.eye(3)), -1, 0)
        for root, name in reversed(names.items())
        if root not in used
    ]
    while waiting:
        use, parent, depth = waiting.pop()
        row = len(tree.labels)
        if depth > DEEPEST or row >= MOST_OCCURRENCES:
            raise PartFileError(
                f"{file} has more than {MOST_OCCURRENCES} occurrences of products, or nests them more than {DEEPEST} deep;"
                " export a part of the assembly"
            )
        tree.parents.append(parent)
        tree.labels.append(use.label)
        tree.products.append(names[use.child])
        tree.definitions.append(use.child)
        tree.rotations.append(use.rotation)
        waiting += [
            (below._replace(rotation=use.rotation @ below.rotation), row, depth + 1)
            for below in reversed(uses.get(use.child, []))
        ]
    return tree


def decode_string(quoted: bytes) -> str:
    """Return the text of a string of Part 21, given with its quotes; letters may be coded in it."""
    raw = quoted[1:-1].replace(b"\n", b"").replace(b"\r", b"")
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    text = CODED.sub(_decode_letters, text.replace("''", "'")).replace("\\\\", "\\")
    return printable(text)[:LONGEST_NAME].strip()


def _decode_letters(match: re.Match[str]) -> str:
    utf16, utf32, latin, page = match.groups()
    if page or latin:
        return chr(ord(page) + 128 if page else int(latin, 16))
    code, digits, width = ("utf-16-be", utf16, 4) if utf32 is None else ("utf-32-be", utf32, 8)
    return bytes.fromhex(digits[: len(digits) // width * width]).decode(code, errors="replace")


def _find_entities(text: bytes, file: str) -> dict[bytes, Entities]:
    """Return the arguments of the tree's entities by type and number."""
    entities: dict[bytes, Entities] = defaultdict(dict)
    for count, (number, kind, body) in enumerate(_scan(text, TREE)):
        if count >= MOST_ENTITIES:
            raise PartFileError(
                f"{file} has more than {MOST_ENTITIES} entities in its tree of products; export a part of the assembly"
            )
        entities[kind.removesuffix(b"_WITH_SPECIFIED_SOURCE")][number] = _split(body)
    return entities


def _scan(text: bytes, kinds: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield number, type and arguments of the entities of some types, their bracket open; one pass,
    whatever the text holds.
    """
    head, position = re.compile(ENTITY % kinds), 0
    while statement := STATEMENT.match(text, position):
        if entity := head.match(text, position, statement.end()):
            yield int(entity[1]), entity[2], text[entity.end() : statement.end()]
        position = statement.end()


def _split(body: bytes) -> list[bytes]:
    """Return the arguments of an entity whose bracket is open; behind them the transformation that a
    complex entity names.
    """
    arguments, depth = [b""], 1
    for token in TOKEN.findall(body):
        depth += (token == b"(") - (token == b")")
        if depth == 0:
            break
        if depth == 1 and token == b",":
            arguments.append(b"")
        else:
            arguments[-1] += token.strip()
    moved = MOVED.search(body)
    return [*arguments, moved[1]] if moved else arguments


def _reference(arguments: list[bytes], index: int) -> int:
    """Return the number of the entity that an argument refers to; -1 where it does not."""
    word = arguments[index] if index < len(arguments) else b""
    return int(word[1:]) if re.fullmatch(rb"#\d{1,9}", word) else -1


def _string(arguments: list[bytes], index: int) -> str:
    word = arguments[index] if index < len(arguments) else b""
    return decode_string(word) if word.startswith(b"'") else ""


def _name_product(entities: dict[bytes, Entities], definition: int) -> str:
    formation = _reference(entities[b"PRODUCT_DEFINITION"][definition], 2)
    product = _reference(entities[b"PRODUCT_DEFINITION_FORMATION"].get(formation, []), 2)
    arguments = entities[b"PRODUCT"].get(product, [])
    return _string(arguments, 1) or _string(arguments, 0)


def _find_uses(
    entities: dict[bytes, Entities], rotations: dict[int, FloatArray], names: Collection[int]
) -> tuple[dict[int, list[_Use]], int]:
    """Return what each definition is made of, and the number of occurrences of what is none."""
    uses: dict[int, list[_Use]] = defaultdict(list)
    broken = 0
    for number, arguments in entities[b"NEXT_ASSEMBLY_USAGE_OCCURRENCE"].items():
        parent, child = _reference(arguments, 3), _reference(arguments, 4)
        if parent in names and child in names:
            rotation = rotations.get(number, UNKNOWN)
            label = _string(arguments, 1) or _string(arguments, 0)
            uses[parent].append(_Use(child, label, rotation))
        else:
            broken += 1
    return uses, broken


def _refuse_circles(uses: dict[int, list[_Use]], names: dict[int, str], file: str) -> None:
    graph = {parent: {use.child for use in below} for parent, below in uses.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        circle = ", in ".join(f'"{names[number]}"' for number in error.args[1][:6])
        raise PartFileError(
            f"{file}: a product contains itself ({circle}); export the assembly again"
        ) from error


def _read_rotations(entities: dict[bytes, Entities], text: bytes) -> dict[int, FloatArray]:
    """Return the rotation ``(3, 3)`` of each occurrence, from its product to that it is in, by the
    occurrence's number.
    """
    shapes = {
        number: _reference(arguments, 2)
        for number, arguments in entities[b"PRODUCT_DEFINITION_SHAPE"].items()
    }
    drawn = {
        (shapes.get(_reference(arguments, 0)), _reference(arguments, 1))
        for arguments in entities[b"SHAPE_DEFINITION_REPRESENTATION"].values()
    }
    frames = _read_frames(entities, text)
    rotations = {}
    for arguments in entities[b"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"].values():
        relation = entities[b"REPRESENTATION_RELATIONSHIP"].get(_reference(arguments, 0), [])
        occurrence = shapes.get(_reference(arguments, 1), -1)
        moved = entities[b"ITEM_DEFINED_TRANSFORMATION"].get(_reference(relation, 4), [])
        start, end = (frames.get(_reference(moved, index)) for index in (2, 3))
        if start is None or end is None:
            continue
        parent = _reference(entities[b"NEXT_ASSEMBLY_USAGE_OCCURRENCE"].get(occurrence, []), 3)
        # some programs name the assembly first and its part second
        backwards = (parent, _reference(relation, 2)) in drawn
        rotations[occurrence] = start @ end.T if backwards else end @ start.T
    return rotations


def _read_frames(entities: dict[bytes, Entities], text: bytes) -> dict[int, FloatArray]:
    """Return the axes ``(3, 3)``, in columns, of the placements that transformations name."""
    moves = entities[b"ITEM_DEFINED_TRANSFORMATION"].values()
    wanted = {_reference(move, index) for move in moves for index in (2, 3)}
    placements = _pick(text, b"AXIS2_PLACEMENT_3D", wanted)
    named = {_reference(arguments, index) for arguments in placements.values() for index in (2, 3)}
    directions = {
        number: _read_numbers(arguments[-1])
        for number, arguments in _pick(text, b"DIRECTION", named).items()
    }
    frames = {}
    for number, arguments in placements.items():
        z = directions.get(_reference(arguments, 2), np.array([0.0, 0.0, 1.0]))
        x = directions.get(_reference(arguments, 3), np.array([1.0, 0.0, 0.0]))
        with contextlib.suppress(ValueError):  # parallel, or without length
            frames[number] = frame_axes(z, x)[:, [2, 1, 0]] * [1.0, -1.0, 1.0]
    return frames


def _pick(text: bytes, kind: bytes, numbers: set[int]) -> Entities:
    """Return the arguments of entities of a type with these numbers."""
    if numbers <= {-1}:
        return {}
    return {number: _split(body) for number, _, body in _scan(text, kind) if number in numbers}


def _read_numbers(word: bytes) -> FloatArray:
    """Return three numbers of a list; zeros where they are none."""
    try:
        numbers = np.array([float(part) for part in word.strip(b"()").split(b",")])
    except ValueError:
        return np.zeros(3)
    return numbers if len(numbers) == 3 and math.isfinite(numbers.sum()) else np.zeros(3)
