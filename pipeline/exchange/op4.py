"""Nastran OUTPUT4 files: named dense matrices of real numbers, binary in Fortran records, or text.

Source: the record layout of the OUTPUT4 module (MSC Nastran DMAP Programmer's Guide): header of
columns, rows, form, type and name; one record per column that is not zero, from its first row that
is not; a last record beyond the columns.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import PART, read_apart
from headstock.pipeline.exchange.matrices import MOST_DOFS, ExchangeError

SQUARE, RECTANGULAR, SYMMETRIC = 1, 2, 6
REAL, COMPLEX = (1, 2), (3, 4)
HEADER = 24  # bytes: four numbers and a name of eight letters
WORD = 4
LONGEST_NAME = 8
# of text: four numbers, a name, and how numbers stand in a line, such as 1P,3E23.16
TEXT_HEADER = re.compile(
    r"([ \d]{8})([ \d-]{8})([ \d]{8})([ \d]{8})(.{8})\s*(?:1P,?)?(\d+)[ED](\d+)\.\d+\s*$"
)
LONGEST_LINE = 400
FREE_ENTRIES, MOST_PER_BYTE = 1 << 23, 12  # columns of zeros are not written


class _Header(NamedTuple):
    """Sizes, type and name of a matrix."""

    columns: int
    rows: int
    kind: int
    name: str


type _Column = tuple[int, int, FloatArray]  # number, first row, entries


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
    """Read the real matrices of an OUTPUT4 file, binary of either byte order or text, with limits.

    Raises:
        ExchangeError: The file is damaged, too large, or holds complex or sparse matrices.
    """
    return dict(read_apart(path, PART, parse_op4, error=ExchangeError))


def parse_op4(path: Path) -> dict[str, FloatArray]:
    """Read an OUTPUT4 file in this process."""
    content = path.read_bytes()
    order = next((o for o in "<>" if content[:WORD] == struct.pack(f"{o}i", HEADER)), None)
    found: dict[str, FloatArray] = {}
    for header, columns in (
        _split_text(path.name, content)
        if order is None
        else _split_binary(path.name, content, order)
    ):
        if header.name in found:
            raise ExchangeError(f"{path.name} holds two matrices {header.name}; keep one")
        found[header.name] = _fill(path.name, MOST_PER_BYTE * len(content), header, columns)
    return found


def _split_binary(
    file: str, content: bytes, order: str
) -> Iterator[tuple[_Header, Iterator[_Column]]]:
    """Yield the header of each matrix and its columns, which must be taken before the next."""
    records = _split_records(file, content, order)
    for record in records:
        if len(record) != HEADER:
            raise ExchangeError(
                f"{file}: a header of {len(record)} bytes where {HEADER} are expected; copy the file again"
            )
        columns, rows, _, kind, letters = struct.unpack(f"{order}4i8s", record)
        header = _Header(columns, rows, kind, letters.decode("latin-1").strip())
        yield header, _read_columns(records, order, kind)


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


def _read_columns(records: Iterator[bytes], order: str, kind: int) -> Iterator[_Column]:
    entry, words = (f"{order}f4", 1) if kind == REAL[0] else (f"{order}f8", 2)
    for record in records:
        if len(record) < 3 * WORD:
            return
        column, first, count = struct.unpack_from(f"{order}3i", record)
        if len(record) != WORD * (3 + count) or count % words:
            return
        yield column, first, np.frombuffer(record, entry, offset=3 * WORD)


def _split_text(file: str, content: bytes) -> Iterator[tuple[_Header, Iterator[_Column]]]:
    """Yield the header of each matrix of a text and its columns."""
    lines = iter(content.decode("latin-1").splitlines())
    for line in lines:
        header = TEXT_HEADER.match(line[:LONGEST_LINE])
        if header is None:
            raise ExchangeError(
                f"{file} is no OUTPUT4 file: {line[:40]!r} is no header; write it with FORM=UNFORMATTED or FORM=FORMATTED, without BIGMAT"
            )
        try:
            columns, rows, _, kind = (int(text) for text in header.groups()[:4])
        except ValueError as error:
            raise ExchangeError(f"{file}: {line[:40]!r} is no header; copy it again") from error
        width, name = int(header[7]), header[5].strip()
        yield (
            _Header(columns, rows, kind, name),
            _read_text_columns(lines, max(int(header[6]), 1), max(width, 1), rows),
        )


def _read_text_columns(
    lines: Iterator[str], per_line: int, width: int, rows: int
) -> Iterator[_Column]:
    """Yield columns until what stands there is none."""
    for line in lines:
        try:
            column, first, count = (int(line[start : start + 8]) for start in (0, 8, 16))
        except ValueError:
            return
        if first == 0:
            yield column, first, np.zeros(0)
        if not 0 < count <= max(rows, 1):
            return
        texts: list[str] = []
        while len(texts) < count:
            text = next(lines, "").rstrip()
            if not text:
                return
            texts += [
                text[k : k + width] for k in range(0, min(len(text), per_line * width), width)
            ]
        try:
            numbers = [float(text.replace("D", "E")) for text in texts[:count]]
        except ValueError:
            return
        yield column, first, np.array(numbers)


def _fill(file: str, size: int, header: _Header, columns: Iterator[_Column]) -> FloatArray:
    """Return the entries of a matrix; its size is compared with that of the file before memory is taken."""
    count, rows, kind, name = header
    what = f"{file}, matrix {name[:LONGEST_NAME]!r}"
    if kind not in REAL:
        raise ExchangeError(
            f"{what} is {'complex' if kind in COMPLEX else 'of an unknown type'}; write real matrices"
        )
    if rows < 0:
        raise ExchangeError(f"{what} is sparse with large indices; write it without BIGMAT")
    if not (0 < count <= MOST_DOFS and rows <= MOST_DOFS):
        raise ExchangeError(
            f"{what} has {rows} x {count} entries; at most {MOST_DOFS} x {MOST_DOFS} are read: reduce the model further"
        )
    if count * rows > max(FREE_ENTRIES, size):
        raise ExchangeError(
            f"{what} announces {rows} x {count} entries, far more than the file holds; copy it again"
        )
    matrix = np.zeros((count, rows))
    for column, first, entries in columns:
        if column == count + 1:
            return np.ascontiguousarray(matrix.T)
        if first == 0:
            raise ExchangeError(f"{what} is sparse; write it in the dense form")
        last = first - 1 + len(entries)
        if not (0 < column <= count and first > 0 and last <= rows):
            break
        matrix[column - 1, first - 1 : last] = entries
    raise ExchangeError(
        f"{what}: a column does not fit its {rows} rows, or the file ends before the last one; copy it again"
    )
