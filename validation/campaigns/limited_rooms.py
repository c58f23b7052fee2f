"""Folders on a small disk whose free room is set; where no file system can be made, a limit on the size of each file instead."""

import contextlib
import resource
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from headstock.validation.campaigns.small_disks import bound_folder, small_disk

DISK_BYTES = 64 << 20
# bytes that may still be written, or None for all there are
SetRoom = Callable[[int | None], None]


@contextlib.contextmanager
def limited_room(folder: Path, names: Sequence[str], *, limited_files: bool) -> Iterator[SetRoom]:
    """Put folders on a disk that fills up; the body sets how far it is filled.

    Args:
        folder: Holds the folders.
        names: Of the folders; those that are there are empty and take their place on the disk.
        limited_files: Limit the size of each file of this process and its children instead.

    Raises:
        CampaignError: The kernel refuses a file system.
    """
    if limited_files:
        for name in names:
            (folder / name).mkdir(exist_ok=True)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        try:
            yield lambda room: resource.setrlimit(resource.RLIMIT_FSIZE, (before[0] if room is None else room, before[1]))
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
