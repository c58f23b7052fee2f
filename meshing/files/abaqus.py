"""Reads nodes, solid elements and named surfaces of Abaqus and CalculiX input decks.

meshio's reader knows neither ``*SURFACE`` nor 27-node hexes, overwrites the nodes of all but the
last ``*NODE`` block and ends the interpreter on unknown element types; this one reads what a mesh
of one part needs and refuses the rest by name.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from headstock.meshing.errors import MeshError

SOLID_NODES = {"C3D4": 4, "C3D10": 10, "C3D8": 8, "C3D20": 20, "C3D27": 27}
OTHER_SOLIDS = ("C3D6", "C3D15", "C3D5", "C3D13")
SHELL_NODES = {
    "S3": 3,
    "S6": 6,
    "S4": 4,
    "S8": 8,
    "S9": 9,
    "M3D3": 3,
    "M3D6": 6,
    "M3D4": 4,
    "M3D8": 8,
}
SHELL_NODES |= {
    "STRI3": 3,
    "STRI65": 6,
    "CPS3": 3,
    "CPS4": 4,
    "CPS6": 6,
    "CPS8": 8,
    "SFM3D3": 3,
    "SFM3D4": 4,
    "SFM3D6": 6,
    "SFM3D8": 8,
}
# corners of faces S1 .. S6 (Abaqus Analysis User's Guide, "Three-dimensional solid element
# library")
TET_FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
HEX_FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
REFUSED_KEYWORDS = ("PART", "INSTANCE", "ASSEMBLY", "SYSTEM", "NGEN", "ELGEN", "INCLUDE")


@dataclass
class AbaqusDeck:
    """What a deck holds, by its own numbers.

    Attributes:
        nodes: Node number to position.
        solids: Node count of the type to element number to node numbers, in Abaqus' order.
        shells: Corner nodes of surface elements, by element number.
        node_sets: Node numbers by set name.
        element_sets: Element numbers by set name.
        surfaces: Corner node numbers of the facets of each named surface.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    solids: dict[int, dict[int, list[int]]] = field(default_factory=dict)
    shells: dict[int, list[int]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)


def read_abaqus_deck(path: Path) -> AbaqusDeck:
    """Read a deck.

    Raises:
        MeshError: The deck holds something that this reader does not understand; named with its
            line.
    """
    deck = AbaqusDeck()
    pending: list[tuple[str, str, list[tuple[int, str]]]] = []
    for line, keyword, options, data in _blocks(path):
        if keyword in REFUSED_KEYWORDS and keyword != "PART":
            raise MeshError(
                f"{path.name}:{line}: *{keyword} is not supported; write a flat deck of one part"
            )
        try:
            if keyword == "NODE":
                _add_nodes(deck, options, data)
            elif keyword == "ELEMENT":
                _add_elements(deck, options, data)
            elif keyword in ("NSET", "ELSET"):
                sets = deck.node_sets if keyword == "NSET" else deck.element_sets
                name = options[keyword].upper()
                sets[name] = sets.get(name, []) + _set_members(sets, options, data)
            elif keyword == "SURFACE":
                pending.append(
                    (options["NAME"].upper(), options.get("TYPE", "ELEMENT").upper(), data)
                )
        except (ValueError, KeyError, IndexError) as error:
            raise MeshError(
                f"{path.name}:{line}: cannot read this *{keyword} block ({type(error).__name__}: {error})"
            ) from error
    for name, kind, data in pending:
        _add_surface(deck, path, name, kind, data)
    return deck


def _blocks(path: Path) -> Iterator[tuple[int, str, dict[str, str], list[tuple[int, str]]]]:
    """Keyword blocks: line number, keyword, options and data lines with their numbers."""
    block: tuple[int, str, dict[str, str], list[tuple[int, str]]] | None = None
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, raw in enumerate(file, 1):
            text = raw.strip()
            if not text or text.startswith("**"):
                continue
            if text.startswith("*"):
                if block is not None:
                    yield block
                first, *rest = text[1:].split(",")
                pairs = (option.partition("=") for option in rest)
                options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
                block = (number, first.strip().upper(), options, [])
            elif block is not None:
                block[3].append((number, text))
    if block is not None:
        yield block


def _add_nodes(deck: AbaqusDeck, options: dict[str, str], data: list[tuple[int, str]]) -> None:
    added = []
    for _, text in data:
        fields = text.split(",")
        x, y, z = (float(value) for value in fields[1:4])
        deck.nodes[int(fields[0])] = (x, y, z)
        added.append(int(fields[0]))
    if "NSET" in options:
        name = options["NSET"].upper()
        deck.node_sets[name] = deck.node_sets.get(name, []) + added


def _add_elements(deck: AbaqusDeck, options: dict[str, str], data: list[tuple[int, str]]) -> None:
    kind = options["TYPE"].upper()
    base, shell = _family(kind, SOLID_NODES), _family(kind, SHELL_NODES)
    if kind.startswith(OTHER_SOLIDS) and base is None:
        raise ValueError(
            f"element type {kind} is no tet or hex; only C3D4, C3D10, C3D8, C3D20 and C3D27 are read"
        )
    if base is None and shell is None:
        raise ValueError(f"element type {kind} is neither a solid nor a surface element")
    count = SOLID_NODES[base] if base is not None else SHELL_NODES[shell or ""]
    numbers = [int(value) for _, text in data for value in text.split(",") if value.strip()]
    if len(numbers) % (count + 1):
        raise ValueError(
            f"{kind} needs {count} nodes per element; {len(numbers)} numbers do not divide into elements"
        )
    rows = [numbers[start : start + count + 1] for start in range(0, len(numbers), count + 1)]
    for row in rows:
        if row[0] in deck.shells or any(row[0] in known for known in deck.solids.values()):
            raise ValueError(f"element {row[0]} is defined twice")
        if base is not None:
            deck.solids.setdefault(count, {})[row[0]] = row[1:]
        else:
            deck.shells[row[0]] = row[1 : 1 + (3 if count in (3, 6) else 4)]
    if "ELSET" in options:
        name = options["ELSET"].upper()
        deck.element_sets[name] = deck.element_sets.get(name, []) + [row[0] for row in rows]


def _family(kind: str, families: Mapping[str, int]) -> str | None:
    """The longest family name that a type begins with; what follows are letters, such as R for
    reduced integration.
    """
    found = [
        name for name in families if kind.startswith(name) and not kind[len(name) :].strip(LETTERS)
    ]
    return max(found, key=len) if found else None


def _set_members(
    sets: dict[str, list[int]], options: dict[str, str], data: list[tuple[int, str]]
) -> list[int]:
    members: list[int] = []
    for _, text in data:
        fields = [value.strip() for value in text.split(",") if value.strip()]
        if "GENERATE" in options:
            start, stop, step = (int(value) for value in [*fields, "1"][:3])
            members += range(start, stop + 1, step)
            continue
        for value in fields:
            members += [int(value)] if value.isdigit() else sets[value.upper()]
    return members


def _add_surface(
    deck: AbaqusDeck, path: Path, name: str, kind: str, data: list[tuple[int, str]]
) -> None:
    facets = deck.surfaces.setdefault(name, [])
    for line, text in data:
        target, label = ([value.strip().upper() for value in text.split(",")] + [""])[:2]
        if kind == "NODE":
            members = [int(target)] if target.isdigit() else deck.node_sets.get(target, [])
            deck.node_sets[name] = deck.node_sets.get(name, []) + members
            continue
        elements = [int(target)] if target.isdigit() else deck.element_sets.get(target)
        if elements is None:
            raise MeshError(
                f"{path.name}:{line}: surface {name} names an unknown element set {target!r}"
            )
        for element in elements:
            if element in deck.shells:
                facets.append(tuple(deck.shells[element]))
            else:
                facets.append(_solid_face(deck, element, label, f"{path.name}:{line}"))
    if not facets:
        del deck.surfaces[name]


def _solid_face(deck: AbaqusDeck, element: int, label: str, where: str) -> tuple[int, ...]:
    for count, rows in deck.solids.items():
        if element in rows:
            faces = TET_FACES if count in (4, 10) else HEX_FACES
            number = label.removeprefix("S")
            if not number.isdigit() or not 1 <= int(number) <= len(faces):
                raise MeshError(
                    f"{where}: face {label!r} of element {element}; write S1 .. S{len(faces)}"
                )
            return tuple(rows[element][corner] for corner in faces[int(number) - 1])
    raise MeshError(f"{where}: there is no element {element}")


def deck_positions(
    deck: AbaqusDeck,
) -> tuple[dict[int, int], np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Row of each node number, and positions ``(n, 3)`` in the deck's unit."""
    return {number: row for row, number in enumerate(deck.nodes)}, np.array(
        list(deck.nodes.values()), dtype=float
    ).reshape(-1, 3)
