"""Matrices as lists of row, column and value: Matrix Market, Abaqus (``*MATRIX GENERATE``) and
CalculiX (``*FREQUENCY, SOLVER=MATRIXSTORAGE``).

Sources: Boisvert, Pozo and Remington (1996), "The Matrix Market Exchange Formats"; Abaqus Analysis
User's Guide, "Generating matrices"; CalculiX CrunchiX User's Manual, "*FREQUENCY".
"""

import io
from pathlib import Path
from typing import Any

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.process.strangers import PART, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.meshing.scipy_library import scipy
from headstock.pipeline.exchange.matrices import (
    MOST_DOFS,
    MOST_ENTRIES,
    ExchangeError,
    fill_matrix,
    require_last_line,
)

MARKET = b"%%MatrixMarket"
NODE_LIST, INDEX_LIST = 5, 3  # columns of Abaqus's and of CalculiX's lists
TABLES = {"K": ".sti", "M": ".mas"}  # what CalculiX calls them
LARGEST_NUMBER = 2.0**31
LONGEST_LINE = 1024  # of Matrix Market
SPARSEST = 8  # rows of a matrix over its entries: masses may have rows of zeros


def encode_matrix_market(matrix: FloatArray) -> bytes:
    """Return a symmetric matrix as a Matrix Market file with the digits of double precision."""
    image = io.BytesIO()
    sparse = scipy.sparse.coo_array(matrix)
    scipy.io.mmwrite(image, sparse, precision=17, symmetry="symmetric")
    return image.getvalue()


def encode_abaqus(nodes: IntArray, matrix: FloatArray) -> bytes:
    """Return the lower half of a matrix as Abaqus reads it with ``*MATRIX INPUT``: node, dof, node,
    dof, value; a scalar dof is the first of its node.

    Args:
        nodes: ``(n, 2)`` as those of ``BodyMatrices``.
    """
    keys = name_first_dofs(nodes)
    rows, columns = np.nonzero(np.tril(matrix))
    table: FloatArray = np.column_stack([keys[rows], keys[columns], matrix[rows, columns]])
    return _encode_table(table, "%d,%d,%d,%d,%.16e")


def encode_calculix(matrix: FloatArray) -> bytes:
    """Return the upper half of a matrix, a line ``row column value`` each."""
    rows, columns = np.nonzero(np.triu(matrix))
    return _encode_table(
        np.column_stack([rows + 1, columns + 1, matrix[rows, columns]]), "%d %d %.16e"
    )


def encode_dof_list(nodes: IntArray) -> bytes:
    """Return a line ``node.dof`` for each row; scalar dofs end in 0."""
    return "".join(f"{node}.{dof}\n" for node, dof in nodes).encode()


def name_first_dofs(nodes: IntArray) -> IntArray:
    """Return node and dof of each row ``(n, 2)`` as Abaqus has them: a scalar dof is the first of its
    node.
    """
    return np.column_stack([nodes[:, 0], np.maximum(nodes[:, 1], 1)])


def _encode_table(table: FloatArray, form: str) -> bytes:
    image = io.BytesIO()
    np.savetxt(image, table, fmt=form)
    return image.getvalue()


def read_coordinates(path: Path, dof_list: Path | None = None) -> tuple[IntArray, FloatArray]:
    """Read a symmetric matrix in any of the three forms, with limits.

    Args:
        dof_list: The file of lines ``node.dof``; None where the matrix names them, or has scalar dofs
            alone.

    Returns:
        ``(n, 2)`` node and dof of each row, and the matrix ``(n, n)``; where one half is written, the
        other is its mirror image.

    Raises:
        ExchangeError: A file is damaged, too large or of another form.
    """
    arrays = read_apart(path, PART, parse_coordinates, error=ExchangeError)
    nodes, matrix = arrays["nodes"], arrays["matrix"]
    if dof_list is not None:
        named = nodes
        nodes = read_apart(dof_list, PART, parse_dof_list, error=ExchangeError)["nodes"]
        if named[:, 1].any() and not np.array_equal(named, name_first_dofs(nodes)):
            raise ExchangeError(f"{dof_list.name} lists other dofs than {path.name}")
        if len(nodes) != len(matrix):
            raise ExchangeError(
                f"{dof_list.name} names {len(nodes)} dofs, but {path.name} has {len(matrix)} rows; take the list that was written with it"
            )
    return nodes, matrix


def parse_dof_list(path: Path) -> Arrays:
    """Read lines ``node.dof`` in this process."""
    require_last_line(path)
    dofs = []
    for number, line in enumerate(path.read_text(errors="replace").split(), 1):
        node, _, dof = line.partition(".")
        if not (node.isdecimal() and dof.isdecimal() and len(node) < 10 and int(dof[:2]) <= 6):
            raise ExchangeError(
                f"{path.name}:{number}: {line[:40]!r} is no dof; write node.dof, such as 12.3"
            )
        dofs.append((int(node), int(dof)))
    return {"nodes": np.array(dofs, dtype=np.int64).reshape(-1, 2)}


def parse_coordinates(path: Path) -> Arrays:
    """Read a list of rows, columns and values in this process."""
    with path.open("rb") as file:
        first = file.readline(400)
    if first.startswith(MARKET):
        return _number_rows(_read_market(path))
    require_last_line(path)
    table = _read_table(path, delimiter="," if b"," in first else None, comments="#")
    if table.shape[1] not in (NODE_LIST, INDEX_LIST):
        raise ExchangeError(
            f"{path.name} has {table.shape[1]} columns; expected are row, column, value, or node, dof, node, dof, value"
        )
    keys = _read_indices(path, table[:, :-1])
    if table.shape[1] == NODE_LIST:
        if keys[:, 1::2].max() > len(DOF_NAMES):
            raise ExchangeError(f"{path.name}: dofs of nodes must be 1 to 6; leave out others")
        nodes, places = np.unique(keys.reshape(-1, 2), axis=0, return_inverse=True)
        return {
            "nodes": nodes,
            "matrix": _fill(path, len(nodes), places.reshape(-1, 2), table[:, -1]),
        }
    return _number_rows(_fill(path, int(keys.max()), keys - 1, table[:, -1]))


def _read_market(path: Path) -> FloatArray:
    """Read a Matrix Market file; scipy's reader ends the process on damaged ones."""
    require_last_line(path)
    with path.open(encoding="latin-1") as file:
        kind = file.readline(LONGEST_LINE).lower().split()[1:]
        lines = 1
        sizes = "%"
        while sizes.startswith("%"):
            sizes, lines = file.readline(LONGEST_LINE), lines + 1
    if kind[:1] != ["matrix"] or kind[2:3] not in (["real"], ["integer"], ["double"]):
        raise ExchangeError(f"{path.name} holds {' '.join(kind)}; write a matrix of real numbers")
    listed = kind[1] == "coordinate"
    if kind[3:] not in (["general"], ["symmetric"]):
        raise ExchangeError(f"{path.name} is {' '.join(kind[3:])}; general and symmetric are read")
    try:
        rows, columns, *counts = (int(text) for text in sizes.split())
        whole = rows * columns if kind[3] == "general" else rows * (rows + 1) // 2
        count = counts[0] if listed else whole
    except (ValueError, IndexError) as error:
        raise ExchangeError(f"{path.name}:{lines}: {sizes[:40]!r} are no sizes") from error
    if not 0 < rows == columns <= MOST_DOFS:
        raise ExchangeError(
            f"{path.name} has {rows} x {columns} entries; square ones of at most {MOST_DOFS} rows are read: reduce the model further"
        )
    if not 0 < count <= min(MOST_ENTRIES, path.stat().st_size):
        raise ExchangeError(
            f"{path.name} announces {count} entries, more than it has bytes or than {MOST_ENTRIES}; copy it again"
        )
    table = _read_table(path, skiprows=lines, comments="%")
    if table.shape != (count, INDEX_LIST if listed else 1):
        raise ExchangeError(
            f"{path.name} announces {count} entries and has {len(table)} lines of {table.shape[1]}; copy it again"
        )
    if listed:
        return _fill(path, rows, _read_indices(path, table[:, :-1]) - 1, table[:, -1])
    first = np.argwhere(np.ones((rows, columns), bool))[:, ::-1]  # column by column
    return _fill(
        path,
        rows,
        first if kind[3] == "general" else first[first[:, 0] >= first[:, 1]],
        table[:, 0],
    )


def _read_table(path: Path, **settings: Any) -> FloatArray:
    try:
        return np.loadtxt(path, ndmin=2, encoding="latin-1", **settings)
    except ValueError as error:
        raise ExchangeError(f"{path.name} is no list of a matrix: {error}") from error


def _read_indices(path: Path, named: FloatArray) -> IntArray:
    """Return whole numbers from 1."""
    whole = (named >= 1.0) & (named < LARGEST_NUMBER) & (named == np.floor(named))
    if not whole.all():
        raise ExchangeError(f"{path.name}: rows and columns must be whole numbers from 1")
    return named.astype(np.int64)


def _fill(path: Path, size: int, places: IntArray, values: FloatArray) -> FloatArray:
    """Return a whole matrix from its entries; its size is looked at before memory is taken."""
    if size > MOST_DOFS:
        raise ExchangeError(
            f"{path.name} has {size} dofs; at most {MOST_DOFS} are read: reduce the model further"
        )
    if size < places.max() + 1:
        raise ExchangeError(f"{path.name} names row or column {places.max() + 1} of {size}")
    if size > SPARSEST * len(values):
        raise ExchangeError(
            f"{path.name} names row {size}, but has {len(values)} entries; check its largest index"
        )
    if len(np.unique(places @ [size, 1])) < len(places):
        raise ExchangeError(f"{path.name} gives an entry twice")
    return fill_matrix(size, places, values)


def _number_rows(matrix: FloatArray) -> Arrays:
    """Return a matrix with a scalar dof per row."""
    numbers = np.arange(1, len(matrix) + 1)
    return {"nodes": np.column_stack([numbers, np.zeros_like(numbers)]), "matrix": matrix}
