"""Nastran bulk data of a reduced body: GRID and SPOINT of its dofs, and DMIG matrices in the long
form of 16 columns, which keeps ten digits.

Source: the entries GRID, SPOINT and DMIG of the Nastran quick reference guide.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.files.nastran_cards import Card, read_cards
from headstock.meshing.process.strangers import PART, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.pipeline.exchange.matrices import (
    MOST_DOFS,
    BodyMatrices,
    ExchangeError,
    fill_matrix,
    require_last_line,
)

SYMMETRIC, SQUARE, RECTANGULAR = 6, 1, 9
NAMES = {"K": "KAAX", "M": "MAAX", "C": "BAAX"}
_LETTERS = {"K": "K2GG", "M": "M2GG", "C": "B2GG"}


def encode_dmig(body: BodyMatrices, *, matrices: bool = True) -> str:
    """Return bulk data of a body: its nodes as GRID, scalar dofs as SPOINT, the dofs of each node as
    ASET1, and its matrices as DMIG where they are wanted.
    """
    case = [f"$ {_LETTERS[letter]} = {NAMES[letter]}" for letter in body.matrices]
    lines = [f"$ {body.name}: matrices of a reduced body, m kg s; in the case control:", *case]
    lines += [line for number, point in body.points.items() for line in _grid_lines(number, point)]
    scalars = body.scalar_nodes
    lines += [
        "SPOINT  " + "".join(f"{node:>8d}" for node in scalars[k : k + 8])
        for k in range(0, len(scalars), 8)
    ]
    lines += [
        f"ASET1   {''.join(str(dof) for node, dof in body.nodes if node == number):<8}{number:>8d}"
        for number in body.points
    ]
    for letter, matrix in body.matrices.items() if matrices else ():
        lines += _matrix_lines(NAMES[letter], body.nodes, matrix)
    return "\n".join([*lines, ""])


def _grid_lines(number: int, point: Iterable[float]) -> tuple[str, str]:
    x, y, z = (_number(value) for value in point)
    return f"GRID*   {number:>16d}{'':16}{x}{y}*", f"*       {z}"


def _matrix_lines(name: str, nodes: IntArray, matrix: FloatArray) -> Iterator[str]:
    """Yield the lower half of a symmetric matrix, column by column."""
    yield f"DMIG    {name:<8}{0:>8d}{SYMMETRIC:>8d}{2:>8d}{0:>8d}"
    for column, (node, dof) in enumerate(nodes):
        rows = column + np.flatnonzero(matrix[column:, column])
        if not len(rows):
            continue
        yield f"DMIG*   {name:<16}{node:>16d}{dof:>16d}{'':16}*"
        for row in rows:
            yield f"*       {nodes[row, 0]:>16d}{nodes[row, 1]:>16d}{_number(matrix[row, column])}"


def _number(value: float) -> str:
    """Return a number in sixteen columns: ten digits, nine where the exponent has three."""
    text = f"{value:16.9E}"
    return text if len(text) == 16 else f"{value:16.8E}"


def read_dmig(path: Path) -> dict[str, tuple[IntArray, FloatArray]]:
    """Read the real DMIG matrices of a bulk data file, with limits.

    Returns:
        By name the nodes ``(n, 2)`` and the entries ``(n, n)``, whole also where one half is written.

    Raises:
        ExchangeError: The file is damaged, too large, or holds complex or rectangular matrices.
    """
    arrays = read_apart(path, PART, parse_dmig, error=ExchangeError)
    names = [key.removeprefix("nodes of ") for key in arrays if key.startswith("nodes of ")]
    return {name: (arrays[f"nodes of {name}"], arrays[name]) for name in names}


def parse_dmig(path: Path) -> Arrays:
    """Read the DMIG matrices of a bulk data file in this process: entries by name, and their dofs by
    ``nodes of NAME``.
    """
    cards: defaultdict[str, list[Card]] = defaultdict(list)
    require_last_line(path)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    for card in read_cards(path, text, {"DMIG"}):
        if card.name == "DMIG" and card.fields:
            cards[card.fields[0].upper()].append(card)
    if not cards:
        raise ExchangeError(
            f"{path.name} holds no DMIG card; name the file that holds the matrices"
        )
    found: dict[str, FloatArray | IntArray] = {}
    for name, (head, *columns) in cards.items():
        _require_real(head)
        nodes, places, values = _read_entries(columns)
        found[f"nodes of {name}"] = nodes
        found[name] = fill_matrix(
            len(nodes), places, values, symmetric=head.integer(2) == SYMMETRIC
        )
    return found


def _require_real(head: Card) -> None:
    """Refuse what is no header of a real square matrix."""
    name, form, kind = head.fields[0], head.integer(2), head.integer(3)
    if head.integer(1, -1) != 0:
        raise ExchangeError(
            f"{head.place}: DMIG {name} has no header; its first card must have 0 in field 3"
        )
    if form not in (SQUARE, SYMMETRIC):
        raise ExchangeError(
            f"{head.place}: DMIG {name} is of form {form}; square ones (1) and symmetric ones (6) are read"
        )
    if kind not in (1, 2):
        raise ExchangeError(
            f"{head.place}: DMIG {name} is of type {kind}; real ones (1, 2) are read"
        )


def _read_entries(columns: Iterable[Card]) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the dofs in the order of nodes, row and column ``(k, 2)`` of each entry in it, and the
    entries.
    """
    written: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    for card in columns:
        column = _read_dof(card, 1)
        for start in range(4, len(card.fields), 4):
            if card.fields[start]:
                entry = (_read_dof(card, start), column)
                if entry in written:
                    raise ExchangeError(
                        f"{card.place}: DMIG {card.fields[0]} gives row {entry[0]} of column {column} twice"
                    )
                written[entry] = card.real(start + 2)
    dofs = sorted({dof for entry in written for dof in entry})
    if len(dofs) > MOST_DOFS:
        raise ExchangeError(
            f"a matrix has {len(dofs)} dofs; at most {MOST_DOFS} are read: reduce the model further"
        )
    rows = {dof: row for row, dof in enumerate(dofs)}
    places = [(rows[row], rows[column]) for row, column in written]
    return (
        np.array(dofs, dtype=np.int64).reshape(-1, 2),
        np.array(places, dtype=np.int64).reshape(-1, 2),
        np.array(list(written.values())),
    )


def _read_dof(card: Card, start: int) -> tuple[int, int]:
    node, dof = card.integer(start), card.integer(start + 1)
    if node < 1 or not 0 <= dof <= 6:
        raise ExchangeError(
            f"{card.place}: DMIG {card.fields[0]}: {node} {dof} is no grid point and component"
        )
    return node, dof
