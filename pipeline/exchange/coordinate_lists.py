"""Matrices as lists of row, column and value: Matrix Market, Abaqus (``*MATRIX GENERATE``) and
CalculiX (``*FREQUENCY, SOLVER=MATRIXSTORAGE``).

Sources: Boisvert, Pozo and Remington (1996), "The Matrix Market Exchange Formats"; Abaqus Analysis
User's Guide, "Generating matrices"; CalculiX CrunchiX User's Manual, "*FREQUENCY".
"""

import io
from pathlib import Path

import numpy as np
import scipy.io
import scipy.sparse

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.process.strangers import PART, read_apart
from headstock.meshing.process.worker import Arrays
from headstock.pipeline.exchange.matrices import (
    MOST_DOFS,
    MOST_ENTRIES,
    ExchangeError,
)

MARKET = b"%%MatrixMarket"
NODE_LIST, INDEX_LIST = 5, 3  # columns of Abaqus's and of CalculiX's lists
TABLES = {"K": ".sti", "M": ".mas"}  # what CalculiX calls them


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
    keys = np.column_stack([nodes[:, 0], np.maximum(nodes[:, 1], 1)])
    rows, columns = np.nonzero(np.tril(matrix))
    table = np.column_stack([keys[rows], keys[columns], matrix[rows, columns]])
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
        nodes = read_apart(dof_list, PART, parse_dof_list, error=ExchangeError)["nodes"]
        if len(nodes) != len(matrix):
            raise ExchangeError(
                f"{dof_list.name} names {len(nodes)} dofs, but {path.name} has {len(matrix)} rows; take the list that was written with it"
            )
    return nodes, matrix


def parse_dof_list(path: Path) -> Arrays:
    """Read lines ``node.dof`` in this process."""
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
    try:
        table = np.loadtxt(path, delimiter="," if b"," in first else None, comments="#", ndmin=2)
    except ValueError as error:
        raise ExchangeError(f"{path.name} is no list of a matrix: {error}") from error
    if table.shape[1] not in (NODE_LIST, INDEX_LIST):
        raise ExchangeError(
            f"{path.name} has {table.shape[1]} columns; expected are row, column, value, or node, dof, node, dof, value"
        )
    keys = table[:, :-1].astype(np.int64)
    if (keys != table[:, :-1]).any() or keys.min() < 0:
        raise ExchangeError(f"{path.name}: rows and columns must be whole numbers from 1")
    if table.shape[1] == NODE_LIST:
        nodes, places = np.unique(keys.reshape(-1, 2), axis=0, return_inverse=True)
        return {
            "nodes": nodes,
            "matrix": _fill(path, len(nodes), places.reshape(-1, 2), table[:, -1]),
        }
    return _number_rows(_fill(path, int(keys.max()), keys - 1, table[:, -1]))


def _read_market(path: Path) -> FloatArray:
    """Read a Matrix Market file whose size was looked at first."""
    try:
        rows, columns, entries, _, kind, _ = scipy.io.mminfo(path)
        if rows > MOST_DOFS or columns > MOST_DOFS or entries > MOST_ENTRIES:
            raise ExchangeError(
                f"{path.name} has {rows} x {columns} entries; at most {MOST_DOFS} x {MOST_DOFS} are read: reduce the model further"
            )
        if kind not in ("real", "integer"):
            raise ExchangeError(f"{path.name} holds {kind} numbers; write real ones")
        matrix = scipy.io.mmread(path)
    except (ValueError, OverflowError) as error:
        raise ExchangeError(f"{path.name} is no Matrix Market file: {error}") from error
    return np.asarray(matrix.toarray() if scipy.sparse.issparse(matrix) else matrix, dtype=float)


def _fill(path: Path, size: int, places: IntArray, values: FloatArray) -> FloatArray:
    """Return a whole matrix from its entries; where one half is written, the other mirrors it."""
    if size > MOST_DOFS:
        raise ExchangeError(
            f"{path.name} has {size} dofs; at most {MOST_DOFS} are read: reduce the model further"
        )
    matrix = np.zeros((size, size))
    if len(np.unique(places @ [size, 1])) < len(places):
        raise ExchangeError(f"{path.name} gives an entry twice")
    matrix[tuple(places.T)] = values
    lower, upper = np.tril(matrix, -1), np.triu(matrix, 1)
    if not lower.any() or not upper.any():
        matrix += matrix.T - np.diag(matrix.diagonal())
    return matrix


def _number_rows(matrix: FloatArray) -> Arrays:
    """Return a matrix with a scalar dof per row."""
    numbers = np.arange(1, len(matrix) + 1)
    return {"nodes": np.column_stack([numbers, np.zeros_like(numbers)]), "matrix": matrix}
