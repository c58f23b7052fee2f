"""Whether the files a run leaves are whole: each kind by its own marks of an end, and by reading
all that is in it.
"""

import base64
import binascii
import csv
import io
import json
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import h5py

from faults.runs import FaultError
from headstock.pipeline.storage.outputs import LIST_FILE

PNG_START = b"\x89PNG\r\n\x1a\n"
PAGE_START, PAGE_END = b"<!doctype html>", b"</script>\n</body>\n</html>"
PAGE_MACHINE = re.compile(
    rb'<script type="application/json" id="machine-data">(.*?)</script>', re.DOTALL
)
PAGE_TABLE = re.compile(rb'href="data:text/csv;charset=utf-8;base64,([^"]*)"')
# what a broken file makes the readers below raise
TORN = (
    ValueError,
    OSError,
    KeyError,
    RuntimeError,
    ElementTree.ParseError,
    zlib.error,
    struct.error,
    csv.Error,
)


def check_files(folder: Path) -> list[str]:
    """Check that every file below a folder is whole, as far as its kind shows; return the
    temporaries that were found."""
    temporaries = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        if path.name == LIST_FILE:
            continue  # readers pass over a line without an end
        if path.name.startswith("."):
            temporaries.append(path.name)
        else:
            check_file(path)
    return temporaries


def check_file(path: Path) -> None:
    """Check that one file is whole."""
    content = path.read_bytes()
    try:
        CHECKS.get(path.suffix, _check_any)(content)
    except TORN as error:
        raise FaultError(f"{path} is torn ({len(content)} bytes): {error}") from error


def _check_hdf5(content: bytes) -> None:
    # opening compares the size of the file with what its head says; reading covers every block
    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(
            lambda _, item: item[()] is None if isinstance(item, h5py.Dataset) else None
        )


def _check_page(content: bytes) -> None:
    """A report: it begins and ends as one, and the machine and the tables in it can be unpacked."""
    if not content.startswith(PAGE_START) or not content.rstrip().endswith(PAGE_END):
        raise ValueError("it does not begin or not end as a report")
    machines, tables = PAGE_MACHINE.findall(content), PAGE_TABLE.findall(content)
    if not machines or not tables:
        raise ValueError("it holds no machine or no table")
    for text in machines:
        zlib.decompress(base64.b64decode(json.loads(text)["blob"], validate=True))
    for text in tables:
        _check_table(base64.b64decode(text, validate=True))


def _check_picture(content: bytes) -> None:
    """A PNG: every chunk has its length and its checksum, the last one is the end."""
    if not content.startswith(PNG_START):
        raise ValueError("no PNG")
    at, kind = len(PNG_START), b""
    while at < len(content):
        length, kind = struct.unpack_from(">I4s", content, at)
        (stated,) = struct.unpack_from(">I", content, at + 8 + length)
        if stated != binascii.crc32(content[at + 4 : at + 8 + length]):
            raise ValueError("a chunk differs from its checksum")
        at += 12 + length
    if kind != b"IEND":
        raise ValueError("it has no end")


def _check_model(content: bytes) -> None:
    """A binary glTF: as long as its head says, and so is each chunk."""
    mark, _, length = struct.unpack_from("<4sII", content)
    if mark != b"glTF" or length != len(content):
        raise ValueError(f"its head says {length} bytes")
    (size,) = struct.unpack_from("<I", content, 12)
    json.loads(content[20 : 20 + size])


def _check_table(content: bytes) -> None:
    """A CSV table: closed lines, all with as many cells as the head."""
    rows = list(csv.reader(io.StringIO(content.decode()), strict=True))
    if not content.endswith(b"\n") or len({len(row) for row in rows}) != 1:
        raise ValueError("a line is cut")


def _check_any(content: bytes) -> None:
    if not content:
        raise ValueError("it is empty")


CHECKS: dict[str, Callable[[bytes], object]] = {
    ".h5": _check_hdf5,
    ".json": json.loads,
    ".html": _check_page,
    ".png": _check_picture,
    ".glb": _check_model,
    ".vtu": ElementTree.fromstring,
    ".pvd": ElementTree.fromstring,
    ".csv": _check_table,
}
