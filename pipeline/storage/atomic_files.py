"""Files that are either the old one or the whole new one, and appended to wholly or not, whatever
happens while they are written.
"""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Self

SUFFIX = ".part"


class PendingFiles:
    """Files that appear together, once all of them are safely on the disk; a context manager.

    A temporary never stays behind, except where the process is killed: the next writer of the same
    file then removes it.
    """

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Path, Path]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for handle, temporary, _path in self._waiting:
            temporary.unlink(missing_ok=True)
            os.close(handle)  # after the temporary is gone, since closing gives up the lock
        self._waiting.clear()

    def add(self, path: Path, content: bytes, *, mode: int = 0o644) -> None:
        """Write to a temporary neighbour of ``path`` and flush it to the disk.

        Args:
            mode: Permissions of a Unix file.

        Raises:
            OSError: The folder is not writable, the disk is full or the device reports an error.
        """
        remove_abandoned(path)
        handle, temporary = _open_temporary(path)
        self._waiting.append((handle, temporary, path))
        with os.fdopen(os.dup(handle), "wb") as file:
            file.write(content)
        os.fchmod(handle, mode)
        os.fsync(handle)

    def publish(self) -> None:
        """Rename every temporary over its file.

        Raises:
            OSError: A rename failed; the files before it in the order they were added are new, the
                others old.
        """
        for _handle, temporary, path in self._waiting:
            temporary.replace(path)
        for folder in {path.parent for _handle, _temporary, path in self._waiting}:
            flush_folder(folder)


def write_atomically(path: Path, content: bytes, *, mode: int = 0o644) -> None:
    """Write one file so that a reader sees the old one or the whole new one.

    Args:
        mode: Permissions of a Unix file.

    Raises:
        OSError: The folder is not writable, the disk is full or the device reports an error; an
            earlier file is untouched.
    """
    with PendingFiles() as pending:
        pending.add(path, content, mode=mode)
        pending.publish()


@contextlib.contextmanager
def lock_folder(folder: Path) -> Iterator[bool]:
    """Hold a folder for this process while the body runs; True when nobody else holds it.

    The kernel gives the lock up when the process ends, however it ends. Where the file system knows
    no locks, nothing is locked.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield lock_file(handle)
    finally:
        os.close(handle)


def _open_temporary(path: Path) -> tuple[int, Path]:
    while True:
        handle, name = tempfile.mkstemp(prefix=_prefix(path), suffix=SUFFIX, dir=path.parent)
        if lock_file(handle) and os.fstat(handle).st_nlink:
            return handle, Path(name)
        # another writer took it for abandoned before it was locked, and has removed it or is about to
        os.close(handle)


def remove_abandoned(path: Path) -> None:
    """Remove temporaries of ``path`` that no living process writes."""
    prefix = _prefix(path)
    for temporary in list(path.parent.iterdir()):
        if not (temporary.name.startswith(prefix) and temporary.name.endswith(SUFFIX)):
            continue
        with contextlib.suppress(OSError):
            handle = os.open(temporary, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                temporary.unlink(missing_ok=True)
            finally:
                os.close(handle)


def _prefix(path: Path) -> str:
    # a user's file beside it is not called like that: what begins so may be removed
    return f".{path.name}.headstock-"


def append_whole(handle: int, content: bytes, *, flush: bool = True) -> None:
    """Append all of the content to an open file or, where that fails, nothing.

    Args:
        handle: Of a file open for appending.
        flush: Wait until it is on the disk.

    Raises:
        OSError: The disk is full or the device reports an error.
    """
    end = os.fstat(handle).st_size
    try:
        if os.write(handle, content) != len(content):
            raise OSError("the disk is full")
        if flush:
            os.fsync(handle)
    except OSError:
        with contextlib.suppress(OSError):
            os.ftruncate(handle, end)
        raise


def lock_file(handle: int) -> bool:
    """Keep an open file for this process; False where another one has it, True on file systems
    without locks.
    """
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks
    return True


def flush_folder(folder: Path) -> None:
    """Let the names in a folder reach the disk."""
    # some network file systems refuse to open folders; the rename itself has already happened
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
