"""Nastran OUTPUT4 files: named dense matrices of real numbers, binary, in Fortran records.

Source: the record layout of the OUTPUT4 module (MSC Nastran DMAP Programmer's Guide): header of
columns, rows, form, type and name; one record per column that is not zero, from its first row that
is not; a last record beyond the columns.
"""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import PART, read_apart
from headstock.pipeline.exchange.matrices import MOST_DOFS, ExchangeError

SQUARE, RECTANGULAR, SYMMETRIC = 1, 2, 6
REAL, COMPLEX = (1, 2), (3, 4)
HEADER = 24  # bytes: four numbers and a name of eight letters
WORD = 4
LONGEST_NAME = 8


def encode_op4(matrices: Mapping[str, FloatArray]) -> bytes:
    """Return an OUTPUT4 file of matrices in double precision, bit for bit.

    Args:
        matrices: By name, at most eight letters and digits that begin with a letter.
    """
    return b"".join(_encode_matrix(name, matrix) for name, matrix in matrices.items())


def _encode_matrix(name: str, matrix: FloatArray) -> bytes:
    rows, columns = matrix.shape
    symmetric = rows == columns and np.array_equal(matrix, matrix.T)
    form = SYMMETRIC if symmetric else SQUARE if rows == columns else RECTANGULAR
    header = struct.pack(
        "<4i8s", columns, rows, form, 2, f"{name:<{LONGEST_NAME}.{LONGEST_NAME}}".encode()
    )
    records = [header]
    for number, column in enumerate(np.ascontiguousarray(matrix.T, dtype="<f8"), 1):
        (filled,) = np.nonzero(column)
        if len(filled):
            first, last = int(filled[0]), int(filled[-1]) + 1
            place = struct.pack("<3i", number, first + 1, 2 * (last - first))
            records.append(place + column[first:last].tobytes())
    records.append(struct.pack("<3id", columns + 1, 1, 2, 1.0))
    return b"".join(
        struct.pack("<i", len(record)) + record + struct.pack("<i", len(record))
        for record in records
    )


def read_op4(path: Path) -> dict[str, FloatArray]:
    """Read the real matrices of a binary OUTPUT4 file of either byte order, with limits.

    Raises:
        ExchangeError: The file is damaged, too large, or holds complex or sparse matrices.
    """
    return dict(read_apart(path, PART, parse_op4, error=ExchangeError))


def parse_op4(path: Path) -> dict[str, FloatArray]:
    """Read an OUTPUT4 file in this process."""
    content = path.read_bytes()
    order = next((o for o in "<>" if content[:WORD] == struct.pack(f"{o}i", HEADER)), None)
    if order is None:
        raise ExchangeError(
            f"{path.name} is no binary OUTPUT4 file of 32-bit records; write it with FORM=UNFORMATTED and without BIGMAT"
        )
    found: dict[str, FloatArray] = {}
    records = _split_records(path.name, content, order)
    for record in records:
        name, matrix = _read_matrix(path.name, record, records, order)
        if name in found:
            raise ExchangeError(f"{path.name} holds two matrices {name}; keep one")
        found[name] = matrix
    return found


def _split_records(name: str, content: bytes, order: str) -> Iterator[bytes]:
    place = 0
    while place < len(content):
        end = place + WORD
        size = struct.unpack_from(f"{order}i", content, place)[0] if end <= len(content) else -1
        after = end + size
        if size < 0 or after + WORD > len(content):
            raise ExchangeError(f"{name} ends within a record, at byte {place}; copy it again")
        if struct.unpack_from(f"{order}i", content, after)[0] != size:
            raise ExchangeError(
                f"{name}: the record at byte {place} does not end where it says; copy the file in binary mode"
            )
        yield content[end:after]
        place = after + WORD


def _read_matrix(
    file: str, header: bytes, records: Iterator[bytes], order: str
) -> tuple[str, FloatArray]:
    """Return the name and the entries of the matrix whose header was read."""
    if len(header) != HEADER:
        raise ExchangeError(
            f"{file}: a header of {len(header)} bytes where {HEADER} are expected; copy the file again"
        )
    columns, rows, _, kind, letters = struct.unpack(f"{order}4i8s", header)
    name = letters.decode("latin-1").strip()
    what = f"{file}, matrix {name[:LONGEST_NAME]!r}"
    if kind not in REAL:
        raise ExchangeError(
            f"{what} is {'complex' if kind in COMPLEX else 'of an unknown type'}; write real matrices"
        )
    if rows < 0:
        raise ExchangeError(f"{what} is sparse with large indices; write it without BIGMAT")
    if not (0 < columns <= MOST_DOFS and rows <= MOST_DOFS):
        raise ExchangeError(
            f"{what} has {rows} x {columns} entries; at most {MOST_DOFS} x {MOST_DOFS} are read: reduce the model further"
        )
    entry, words = (f"{order}f4", 1) if kind == 1 else (f"{order}f8", 2)
    matrix = np.zeros((columns, rows))
    for record in records:
        if len(record) < 3 * WORD:
            break
        column, first, count = struct.unpack_from(f"{order}3i", record)
        if column == columns + 1:
            return name, np.ascontiguousarray(matrix.T)
        if first == 0:
            raise ExchangeError(f"{what} is sparse; write it in the dense form")
        length = count // words
        if not (0 < column <= columns and first > 0 and first - 1 + length <= rows) or len(
            record
        ) != WORD * (3 + count):
            break
        matrix[column - 1, first - 1 : first - 1 + length] = np.frombuffer(
            record, entry, offset=3 * WORD
        )
    raise ExchangeError(
        f"{what}: a column does not fit its {rows} rows, or the file ends before the last one; copy it again"
    )
