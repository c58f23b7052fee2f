"""A small file system for this process and its children, without being root (Linux user
namespaces).

Folders on a small disk whose free room is set; where no file system can be made, a limit on the
size of each file instead.
"""

import contextlib
import ctypes
import os
import resource
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from faults.runs import FaultError

MOUNT, UNMOUNT = "mount", "umount2"
BIND, DETACH = 4096, 2  # MS_BIND, MNT_DETACH
DISK_BYTES = 64 << 20
# bytes that may still be written, or None for all there are
SetRoom = Callable[[int | None], None]


def enter_own_view() -> None:
    """Give this process a user and a mount namespace of its own; only while it has a single thread."""
    user, group = os.geteuid(), os.getegid()
    try:
        if sys.platform != "linux":
            raise OSError("only on Linux")
        os.unshare(os.CLONE_NEWUSER | os.CLONE_NEWNS)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
    except OSError as error:
        raise FaultError(f"no file system of a chosen size can be made here: {error}") from error


@contextlib.contextmanager
def small_disk(folder: Path, size: int) -> Iterator[Path]:
    """A tmpfs of so many bytes at a folder, inside ``enter_own_view``."""
    folder.mkdir(parents=True, exist_ok=True)
    _call(MOUNT, b"tmpfs", bytes(folder), b"tmpfs", 0, f"size={size}".encode())
    try:
        yield folder
    finally:
        _call(UNMOUNT, bytes(folder), DETACH)


@contextlib.contextmanager
def bound_folder(folder: Path, source: Path) -> Iterator[None]:
    """Show a folder at another place too, inside ``enter_own_view``."""
    folder.mkdir(exist_ok=True)
    _call(MOUNT, bytes(source), bytes(folder), None, BIND, None)
    try:
        yield
    finally:
        _call(UNMOUNT, bytes(folder), DETACH)


def _call(name: str, *arguments: object) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if getattr(library, name)(*arguments):
        raise FaultError(f"{name}: {os.strerror(ctypes.get_errno())}")


@contextlib.contextmanager
def limited_room(folder: Path, names: Sequence[str], *, limited_files: bool) -> Iterator[SetRoom]:
    """Put folders on a disk that fills up; the body sets how far it is filled."""
    if limited_files:
        for name in names:
            (folder / name).mkdir(exist_ok=True)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        try:
            yield lambda room: resource.setrlimit(
                resource.RLIMIT_FSIZE, (before[0] if room is None else room, before[1])
            )
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        return
    with contextlib.ExitStack() as stack:
        disk = stack.enter_context(small_disk(folder / "disk", DISK_BYTES))
        for name in names:
            (disk / name).mkdir()
            stack.enter_context(bound_folder(folder / name, disk / name))
        yield lambda room: _fill(disk / "ballast", room)


def _fill(ballast: Path, room: int | None) -> None:
    """Make or shrink the file that takes up what is not to be free."""
    ballast.unlink(missing_ok=True)
    if room is not None:
        with ballast.open("wb") as file:
            file.write(bytes(max(shutil.disk_usage(ballast.parent).free - room, 0)))
