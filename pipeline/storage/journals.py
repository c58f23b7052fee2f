"""Journals: files to which finished records are appended, each whole, so that interrupted work is
resumed where it stopped.

A process that dies while it appends leaves a record that ends too early: readers leave it out, the
next writer cuts it off.
"""

import os
import struct
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from headstock.pipeline.storage.atomic_files import append_whole, flush_folder, lock_file
from headstock.pipeline.storage.outputs import (
    OutputError,
    UnusableOutputError,
    read_growing_file,
)

_MARK = struct.Struct("<II")  # length and CRC-32 before a record


@dataclass(frozen=True)
class JournalForm:
    """How a journal begins, and how its records are distinguished.

    Attributes:
        start: What every such file begins with, whatever its version; what begins with something
            else is the user's.
        head: What a file of this version and key begins with; one that begins otherwise has no
            records and is begun anew.
        lines: Records are lines of text; else bytes behind their length and checksum.
    """

    start: bytes
    head: bytes = b""
    lines: bool = False

    def frame(self, record: bytes) -> bytes:
        """A record as it stands in the file."""
        return (
            record + b"\n" if self.lines else _MARK.pack(len(record), zlib.crc32(record)) + record
        )

    def records(self, content: bytes) -> Iterator[bytes]:
        """Records of a file, up to the first that is not whole."""
        start = len(self.head)
        if not content.startswith(self.head):
            return
        if self.lines:
            yield from content[start:].split(b"\n")[:-1]
            return
        while start + _MARK.size <= len(content):
            length, checksum = _MARK.unpack_from(content, start)
            start += _MARK.size + length
            record = content[start - length : start]
            if len(record) < length or zlib.crc32(record) != checksum:
                return
            yield record


class Journal:
    """A journal open for writing by this process alone; a context manager."""

    def __init__(self, path: Path, form: JournalForm, *, flush_seconds: float = 0.0) -> None:
        """Open a journal and cut off a record that was not finished, or begin it.

        Args:
            path: Of the file; its folder is there.
            flush_seconds: A killed process loses no record; a power cut loses those of this time
                [s].

        Raises:
            TakenOutputError: Headstock did not write what is there.
            OutputError: It cannot be written, or another process writes it.
        """
        self._path = path
        self._form = form
        self._flush_seconds = flush_seconds
        self._flushed = time.monotonic()
        try:
            new = not os.path.lexists(path)
            self._handle = os.open(
                path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o644
            )
            try:
                self._begin()
            except (OSError, OutputError):
                os.close(self._handle)
                raise
        except OSError as error:
            raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error
        if new:
            flush_folder(path.parent)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            os.fsync(self._handle)
        except OSError:
            pass  # records are whole, or cut off by the next writer
        finally:
            os.close(self._handle)

    def append(self, record: bytes) -> None:
        """Append a record; it outlives this process from when this returns.

        Raises:
            OutputError: The disk is full or the folder is gone; records before it are untouched.
        """
        flush = time.monotonic() - self._flushed >= self._flush_seconds
        try:
            append_whole(self._handle, self._form.frame(record), flush=flush)
        except OSError as error:
            raise OutputError(
                f"{self._path} cannot be written: {error.strerror or error}; what is finished is kept"
            ) from error
        self._flushed = time.monotonic() if flush else self._flushed

    def _begin(self) -> None:
        if not lock_file(self._handle):
            raise OutputError(
                f"another process writes {self._path}; wait until it ends, or name another folder with -o DIR"
            )
        form, content = self._form, read_growing_file(self._path, self._form.start)
        if not content.startswith(form.head):
            os.ftruncate(self._handle, 0)
            content = b""
        if not content:
            append_whole(self._handle, form.head, flush=False)
        elif (
            whole := len(form.head)
            + sum(len(form.frame(record)) for record in form.records(content))
        ) < len(content):
            os.ftruncate(self._handle, whole)


def read_journal(path: Path, form: JournalForm) -> list[bytes]:
    """Finished records of a journal; none where there is no file, or one of another version or key.

    Raises:
        UnusableOutputError: Headstock did not write what is there, or it cannot be read.
    """
    try:
        return list(form.records(read_growing_file(path, form.start)))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UnusableOutputError(
            f"{path} cannot be read: {error.strerror or error}; name another folder with -o DIR"
        ) from error
