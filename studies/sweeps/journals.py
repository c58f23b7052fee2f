"""Journals of a sweep: finished poses, each appended whole, so that a sweep that was killed goes on where it was.

Every process writes a journal of its own and reads those of all. A record is its length, its CRC-32 and its bytes, written at once:
a process that dies meanwhile leaves a record that ends too early, which readers leave out and the next writer cuts off. A killed
process loses no finished pose; a power cut loses those of the last second. The bytes are a line of JSON about arrays, then the
arrays; no pickle.
"""

import contextlib
import dataclasses
import fcntl
import json
import math
import os
import struct
import time
import typing
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.outputs import OutputError, TakenOutputError, make_part, read_growing_file

PoseState = Literal["done", "failed", "unreachable"]
SingleArray = NDArray[np.float32]
KINDS = ("<f8", "<f4")
# of a frequency response at a port to a load there [m/N, Hz, N/m]
FIGURES = ("worst_real", "worst_real_hz", "chatter_stiffness", "softest", "softest_hz")
LARGEST_HEAD = 1 << 20
_HEAD = struct.Struct("<I")
FOLDER = "poses"
SUFFIX = ".journal"
FLUSH_SECONDS = 1.0
KEY_LETTERS = 16
HEAD = b"headstock poses "
_RECORD = struct.Struct("<II")


@dataclass(frozen=True, eq=False)
class PoseResult:
    """Everything a sweep keeps of a pose.

    Attributes:
        positions: ``(k,)`` of the sweep's axes [m, rad].
        state: ``failed`` when anything asked for could not be computed; ``unreachable`` when a mechanism cannot take the pose.
        error: Why.
        frequencies_hz: ``(m,)`` rising, a few more than asked for, so that modes can be followed from pose to pose.
        wanted: How many of them the scene asks for.
        rigid_count: How many of them are rigid-body modes.
        shapes: ``(d, m)`` mass-normalised, dofs of every component in its own axes.
        compliance: ``(p, 3, 3)`` of each point [m/N], machine axes.
        links: Part that gives most of the compliance in x, y, z at each point, ``3 p`` names, empty where nothing gives way.
        link_shares: ``(3 p,)`` its share.
        condition: ``(0 or 1,)`` condition number of a mechanism.
        figures: ``(q, f)`` of the frequency response, per input port and as ``FIGURES`` names them; NaN where there is none.
    """

    positions: FloatArray
    state: PoseState = "done"
    error: str = ""
    frequencies_hz: FloatArray = field(default_factory=lambda: np.zeros(0))
    wanted: int = 0
    rigid_count: int = 0
    shapes: SingleArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.float32))
    compliance: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    links: tuple[str, ...] = ()
    link_shares: FloatArray = field(default_factory=lambda: np.zeros(0))
    condition: FloatArray = field(default_factory=lambda: np.zeros(0))
    figures: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


def encode_result(result: PoseResult) -> bytes:
    """A result as bytes that ``decode_result`` reads back bit by bit."""
    head: dict[str, Any] = {}
    blocks: list[bytes] = []
    for item in dataclasses.fields(result):
        value = getattr(result, item.name)
        if isinstance(value, np.ndarray):
            kind = "<f4" if value.dtype == np.float32 else "<f8"
            blocks.append(np.ascontiguousarray(value, dtype=kind).tobytes())
            value = [kind, *value.shape]
        head[item.name] = value
    text = json.dumps(head, ensure_ascii=False, separators=(",", ":")).encode()
    return b"".join([_HEAD.pack(len(text)), text, *blocks])


def decode_result(content: bytes) -> PoseResult:
    """A result from its bytes.

    Raises:
        ValueError: They are no result, or one of another version.
    """
    try:
        (length,) = _HEAD.unpack_from(content)
        if length > min(LARGEST_HEAD, len(content)):
            raise ValueError("its head is too long")
        head = json.loads(content[_HEAD.size : _HEAD.size + length])
        place = _HEAD.size + length
        values: dict[str, Any] = {}
        for name, hint in typing.get_type_hints(PoseResult).items():
            value = head[name]
            if isinstance(value, list) and value[:1] and value[0] in KINDS and hint is not tuple[str, ...]:
                kind, *shape = value
                count = math.prod(shape)
                value = np.frombuffer(content, dtype=kind, count=count, offset=place).reshape(shape)
                place += count * np.dtype(kind).itemsize
            values[name] = tuple(value) if isinstance(value, list) else value
        return PoseResult(**values)
    except (struct.error, KeyError, TypeError, AttributeError, UnicodeDecodeError) as error:
        raise ValueError(f"no pose result: {error}") from error


class PoseJournal:
    """A journal open for writing by this process; a context manager."""

    def __init__(self, folder: Path, key: str, name: str) -> None:
        """Open a journal, or begin it.

        Args:
            folder: Of the sweep's results.
            key: Of everything the poses' results depend on.
            name: Of the process among those of the sweep.

        Raises:
            OutputError: It cannot be written, or another process writes it.
        """
        self._path = folder / FOLDER / f"{key[:KEY_LETTERS]}-{name}{SUFFIX}"
        self._flushed = time.monotonic()
        try:
            make_part(self._path.parent)
            self._handle = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o644)
            try:
                self._lock()
                self._begin(key)
            except (OSError, OutputError):
                os.close(self._handle)
                raise
        except OSError as error:
            raise OutputError(f"{self._path} cannot be written: {error.strerror or error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            os.fsync(self._handle)
        os.close(self._handle)

    def append(self, result: PoseResult) -> None:
        """Append a finished pose; it outlives this process from when this returns.

        Raises:
            OutputError: The disk is full or the folder is gone; poses before it are untouched.
        """
        content = encode_result(result)
        record = _RECORD.pack(len(content), zlib.crc32(content)) + content
        end = os.fstat(self._handle).st_size
        try:
            if os.write(self._handle, record) != len(record):
                raise OSError("the disk is full")
            if time.monotonic() - self._flushed > FLUSH_SECONDS:
                os.fsync(self._handle)
                self._flushed = time.monotonic()
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._handle, end)
            raise OutputError(f"{self._path} cannot be written: {error.strerror or error}; finished poses are kept") from error

    def _lock(self) -> None:
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"another process writes {self._path}; wait until it ends, or name another folder with -o DIR"
            ) from None
        except OSError:
            pass  # a file system without locks

    def _begin(self, key: str) -> None:
        """Write the head of a new journal; cut a record off that was not finished."""
        content = read_growing_file(self._path, HEAD)
        if not content.startswith(_head(key)):
            os.ftruncate(self._handle, 0)
            if os.write(self._handle, _head(key)) != len(_head(key)):
                # records behind half a head would be lost
                os.ftruncate(self._handle, 0)
                raise OSError("the disk is full")
            return
        whole = len(_head(key)) + sum(_RECORD.size + len(record) for record in _records(content, key))
        if whole < len(content):
            os.ftruncate(self._handle, whole)


def read_journals(folder: Path, key: str) -> dict[bytes, PoseResult]:
    """Finished poses by the bytes of their positions; a pose that succeeded in one journal counts before one that failed.

    Raises:
        OutputError: A journal cannot be read.
    """
    found: dict[bytes, PoseResult] = {}
    for path in sorted((folder / FOLDER).glob(f"{key[:KEY_LETTERS]}-*{SUFFIX}")):
        try:
            content = path.read_bytes()
        except OSError as error:
            raise OutputError(f"{path} cannot be read: {error.strerror or error}") from error
        for record in _records(content, key):
            with contextlib.suppress(ValueError):
                result = decode_result(record)
                name = result.positions.tobytes()
                if name not in found or found[name].state == "failed":
                    found[name] = result
    return found


def count_poses(folder: Path) -> int:
    """How many finished poses all journals of a folder hold."""
    total = 0
    for path in (folder / FOLDER).glob(f"*{SUFFIX}"):
        content = path.read_bytes()
        key = content.partition(b"\n")[0].rpartition(b" ")[2].decode("ascii", "replace")
        total += sum(1 for _ in _records(content, key))
    return total


def remove_other_journals(folder: Path, key: str) -> None:
    """Remove journals of other contents that no living process writes."""
    for path in (folder / FOLDER).glob(f"*{SUFFIX}"):
        if path.name.startswith(key[:KEY_LETTERS]):
            continue
        with contextlib.suppress(OSError, TakenOutputError):
            read_growing_file(path, HEAD)
            with path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()


def _head(key: str) -> bytes:
    return HEAD + f"1 {key}\n".encode()


def _records(content: bytes, key: str) -> Iterator[bytes]:
    """Whole records of a journal, up to the first that is not."""
    place = len(_head(key))
    if not content.startswith(_head(key)):
        return
    while place + _RECORD.size <= len(content):
        length, checksum = _RECORD.unpack_from(content, place)
        record = content[place + _RECORD.size : place + _RECORD.size + length]
        if len(record) < length or zlib.crc32(record) != checksum:
            return
        yield record
        place += _RECORD.size + length
