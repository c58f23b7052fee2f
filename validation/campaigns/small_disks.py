"""A small file system for this process and its children, without being root (Linux user namespaces)."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from headstock.validation.campaigns.campaign_outcome import CampaignError

MOUNT, UNMOUNT = "mount", "umount2"
BIND, DETACH = 4096, 2  # MS_BIND, MNT_DETACH


def enter_own_view() -> None:
    """Give this process a user and a mount namespace of its own; only while it has a single thread.

    Raises:
        CampaignError: The kernel refuses.
    """
    user, group = os.geteuid(), os.getegid()
    try:
        if sys.platform != "linux":
            raise OSError("only on Linux")
        os.unshare(os.CLONE_NEWUSER | os.CLONE_NEWNS)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
    except OSError as error:
        raise CampaignError(f"no file system of a chosen size can be made here: {error}") from error


@contextlib.contextmanager
def small_disk(folder: Path, size: int) -> Iterator[Path]:
    """A tmpfs of so many bytes at a folder, inside ``enter_own_view``.

    Raises:
        CampaignError: The kernel refuses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _call(MOUNT, b"tmpfs", bytes(folder), b"tmpfs", 0, f"size={size}".encode())
    try:
        yield folder
    finally:
        _call(UNMOUNT, bytes(folder), DETACH)


@contextlib.contextmanager
def bound_folder(folder: Path, source: Path) -> Iterator[None]:
    """Show a folder at another place too, inside ``enter_own_view``.

    Raises:
        CampaignError: The kernel refuses.
    """
    folder.mkdir(exist_ok=True)
    _call(MOUNT, bytes(source), bytes(folder), None, BIND, None)
    try:
        yield
    finally:
        _call(UNMOUNT, bytes(folder), DETACH)


def _call(name: str, *arguments: object) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if getattr(library, name)(*arguments):
        raise CampaignError(f"{name}: {os.strerror(ctypes.get_errno())}")
