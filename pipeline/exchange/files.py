"""Files of reduced bodies, by their ending: what is read as a superelement, and what is written for
other programs.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.solids import SuperelementFile
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.abaqus_deck import DeckReader
from headstock.meshing.files.nastran_cards import read_cards
from headstock.meshing.process.strangers import PART, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.pipeline.exchange.bodies import make_superelement
from headstock.pipeline.exchange.coordinate_lists import (
    TABLES,
    encode_abaqus,
    encode_calculix,
    encode_dof_list,
    encode_matrix_market,
    name_first_dofs,
    read_coordinates,
)
from headstock.pipeline.exchange.dmig import NAMES, encode_dmig, read_dmig
from headstock.pipeline.exchange.matrices import (
    MOST_DOFS,
    BodyMatrices,
    ExchangeError,
    list_matrices,
    require_last_line,
    require_matrix,
)
from headstock.pipeline.exchange.op4 import encode_op4, read_op4
from headstock.pipeline.exchange.simscape import encode_simscape
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.superelements import encode_superelement, read_superelement
from headstock.reduction.superelement import Superelement

BULK_DATA = (".bdf", ".dat", ".nas", ".pch")
# endings of the files of stiffness, mass and damping that lie side by side
FAMILIES: tuple[dict[str, str], ...] = (
    {"K": "_STIF1.mtx", "M": "_MASS1.mtx", "C": "_DMPV1.mtx"},
    {"K": "_K.mtx", "M": "_M.mtx", "C": "_C.mtx"},
    TABLES,
)
DECK = ".inp"  # of Abaqus or CalculiX, for the points of matrices
EVERY_DOF = "123456"
OWN = (".h5", ".hdf5")


class Points(NamedTuple):
    """What bulk data say of the nodes of a body.

    Attributes:
        places: ``(3,)`` by number [m].
        nodes: ``(n, 2)`` node and dof of each row, in the order of their numbers.
    """

    places: dict[int, tuple[float, float, float]]
    nodes: IntArray


def read_body(file: SuperelementFile) -> Superelement:
    """Read a reduced body: Headstock's own layout, or matrices of another program.

    Raises:
        HeadstockError: A file is missing, damaged, or the matrices are not those of one body.
    """
    path, points = file.path, file.points
    if path.suffix in OWN:
        return read_superelement(path)
    own = path if points is None and path.suffix in BULK_DATA else points
    places, named = ({}, np.zeros((0, 2), np.int64)) if own is None else read_points(own)
    matrices, nodes = _read_matrices(path, named)
    if own is None and not len(nodes):
        raise ExchangeError(
            f'{path.name} does not say of which nodes its rows are; write points = "{path.stem}_points.bdf", bulk data with their GRID cards'
        )
    sizes = {letter: len(matrix) for letter, matrix in matrices.items()}
    if len(set(sizes.values())) > 1 or len(nodes) != sizes["K"]:
        listed = ", ".join(f"{letter} has {size} rows" for letter, size in sizes.items())
        raise ExchangeError(
            f"{path.name}: {listed}, and there are {len(nodes)} dofs; take matrices, points and list of dofs of one body"
        )
    matrices = {
        letter: require_matrix(matrix, f"{path.name}, {letter}")
        for letter, matrix in matrices.items()
    }
    body = BodyMatrices(path.stem, nodes, places, matrices["K"], matrices["M"], matrices.get("C"))
    return make_superelement(body, supported=file.supported)


def read_points(path: Path) -> Points:
    """Read the GRID, SPOINT and ASET1 cards of bulk data, or the nodes of a deck, with limits.

    Raises:
        HeadstockError: The file is damaged, or has points in coordinate systems of their own.
    """
    arrays = read_apart(path, PART, parse_points, error=ExchangeError)
    places = zip(arrays["numbers"].tolist(), arrays["places"].tolist(), strict=True)
    return Points({number: (x, y, z) for number, (x, y, z) in places}, arrays["nodes"])


def parse_points(path: Path) -> Arrays:
    """Read the points of bulk data, or of a deck, in this process."""
    if path.suffix == DECK:
        return _parse_deck(path)
    require_last_line(path)
    places: dict[int, FloatArray] = {}
    dofs: list[tuple[int, int]] = []
    chosen: dict[int, str] = {}
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    for card in read_cards(path, text, {"GRID", "SPOINT", "ASET1"}):
        if card.name == "GRID":
            if card.integer(1) or card.integer(5):
                raise ExchangeError(
                    f"{card.place}: GRID {card.integer(0)} has a coordinate system of its own; write points and matrices in the basic one"
                )
            places[card.integer(0)] = card.vector(2)
        elif card.name == "SPOINT":
            dofs += [(number, 0) for number in _list_numbers(card.fields)]
        elif card.name == "ASET1":
            chosen |= dict.fromkeys(_list_numbers(card.fields[1:]), card.fields[0])
    dofs += [
        (number, int(dof))
        for number in places
        for dof in chosen.get(number, EVERY_DOF)
        if dof in EVERY_DOF
    ]
    return {
        "numbers": np.array(list(places), dtype=np.int64),
        "places": np.array(list(places.values()), dtype=float).reshape(-1, 3),
        "nodes": np.array(sorted(dofs), dtype=np.int64).reshape(-1, 2),  # as Nastran orders them
    }


def _parse_deck(path: Path) -> Arrays:
    """Read the nodes of a deck of Abaqus or CalculiX."""
    try:
        nodes = DeckReader(path).read().root.nodes
    except MeshError as error:
        raise ExchangeError(str(error)) from error
    if not nodes:
        raise ExchangeError(
            f"{path.name} has no *NODE outside of parts; write a deck without parts and instances"
        )
    return {
        "numbers": np.array(list(nodes), dtype=np.int64),
        "places": np.array(list(nodes.values()), dtype=float),
        "nodes": np.zeros((0, 2), dtype=np.int64),
    }


def _list_numbers(fields: list[str]) -> list[int]:
    """Return the numbers of a card: listed, or from one THRU another."""
    words = [word for word in fields if word]
    if (
        len(words) == 3
        and words[1].upper() == "THRU"
        and words[0].isdecimal()
        and words[2].isdecimal()
    ):
        first, last = int(words[0]), int(words[2])
        if not 0 <= last - first < MOST_DOFS:
            raise ExchangeError(f"{first} THRU {last}: at most {MOST_DOFS} points are read")
        return list(range(first, last + 1))
    return [int(word) for word in words if word.isdecimal()]


def _read_matrices(path: Path, nodes: IntArray) -> tuple[dict[str, FloatArray], IntArray]:
    """Return stiffness, mass and damping by letter, and ``(n, 2)`` node and dof of each row.

    Args:
        nodes: What the points say of them.
    """
    if path.suffix in BULK_DATA:
        return _join_dmig(path)
    if path.suffix == ".op4":
        return _choose_named(path, read_op4(path)), nodes
    family, stem = _find_family(path)
    dof_list = path.with_name(f"{stem}.dof")
    nodes, stiffness = read_coordinates(path, dof_list if dof_list.is_file() else None)
    found = {"K": stiffness}
    for letter, ending in family.items():
        other = path.with_name(stem + ending)
        if letter != "K" and (letter == "M" or other.is_file()):
            named, found[letter] = read_coordinates(other)
            # those of lists without nodes are counted by the caller
            if named[:, 1].any() and not np.array_equal(named, name_first_dofs(nodes)):
                raise ExchangeError(
                    f"{other.name} has other dofs than {path.name}; take matrices of one body"
                )
    return found, nodes


def _find_family(path: Path) -> tuple[dict[str, str], str]:
    """Return the endings of the files that belong together, and what they begin with."""
    for family in FAMILIES:
        if path.name.endswith(family["K"]):
            return family, path.name.removesuffix(family["K"])
    listed = ", ".join(f"NAME{family['K']}" for family in FAMILIES)
    raise ExchangeError(
        f"{path.name}: the stiffness is expected as {listed}, its mass beside it; rename them"
    )


def _choose_named[T](path: Path, found: Mapping[str, T]) -> dict[str, T]:
    """Return what is stiffness, mass and damping among named matrices: by our names, or by the only
    one that begins with K, M, or B or C.
    """
    chosen: dict[str, T] = {}
    for letter, name in NAMES.items():
        begins = [key for key in found if key.upper().startswith((letter, name[0]))]
        exact = [key for key in begins if key.upper() == name]
        if len(exact or begins) == 1:
            chosen[letter] = found[(exact or begins)[0]]
        elif letter != "C" or begins:
            raise ExchangeError(
                f"{path.name} holds {', '.join(found)}; name stiffness {NAMES['K']} and mass {NAMES['M']}"
            )
    return chosen


def _join_dmig(path: Path) -> tuple[dict[str, FloatArray], IntArray]:
    """Return the DMIG matrices of bulk data over all dofs that any of them names."""
    read = _choose_named(path, read_dmig(path))
    dofs = sorted({(int(node), int(dof)) for nodes, _ in read.values() for node, dof in nodes})
    rows = {dof: row for row, dof in enumerate(dofs)}
    matrices: dict[str, FloatArray] = {}
    for letter, (nodes, matrix) in read.items():
        places = [rows[int(node), int(dof)] for node, dof in nodes]
        matrices[letter] = np.zeros((len(dofs),) * 2)
        matrices[letter][np.ix_(places, places)] = matrix
    return matrices, np.array(dofs, dtype=np.int64).reshape(-1, 2)


def encode_body(
    superelement: Superelement, form: str, origin: Provenance | None = None
) -> dict[str, bytes]:
    """Return the files of a reduced body in a format, by what they end in.

    Args:
        form: One of those of bodies.
        origin: Where it comes from; of Headstock's own layout.

    Raises:
        ExchangeError: The format cannot hold it.
    """
    if form == "h5":
        return {OWN[0]: encode_superelement(superelement, origin)}
    if form == "simscape":
        return encode_simscape(superelement)
    body = list_matrices(superelement)
    if form == "dmig":
        return {".bdf": encode_dmig(body).encode()}
    points = {"_points.bdf": encode_dmig(body, matrices=False).encode()}
    if form == "op4":
        named = {NAMES[letter]: matrix for letter, matrix in body.matrices.items()}
        return {".op4": encode_op4(named), **points}
    family, encode = _LISTS[form]
    files = {
        family[letter]: encode(body.nodes, matrix)
        for letter, matrix in body.matrices.items()
        if letter in family
    }
    return {**files, ".dof": encode_dof_list(body.nodes), **points}


_LISTS: dict[str, tuple[dict[str, str], Callable[[IntArray, FloatArray], bytes]]] = {
    "abaqus": (FAMILIES[0], encode_abaqus),
    "mtx": (FAMILIES[1], lambda _, matrix: encode_matrix_market(matrix)),
    "calculix": (FAMILIES[2], lambda _, matrix: encode_calculix(matrix)),
}
