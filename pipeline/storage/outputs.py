"""Files that commands write: each is the old one or the whole new one, and none is written over or
removed that somebody else wrote.

Every folder that is written into holds a list, ``.headstock-files``: one JSON line per written file
with its name and SHA-256. A file is Headstock's own while its content has a digest that the list
gives its name; whatever else lies there, or was changed since, is the user's. A line is on the disk
before its file appears, so that a process that is killed in between leaves no file that is later
taken for the user's.
"""

import contextlib
import fcntl
import hashlib
import itertools
import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.storage.atomic_files import (
    PendingFiles,
    append_whole,
    lock_folder,
    remove_abandoned,
    write_atomically,
)

LIST_FILE = ".headstock-files"
# a list is shortened beyond this size: many runs into one folder, of which only the last counts
LIST_BYTES = 1 << 18
Written = dict[str, list[str]]
# a file, or a part and a file
_LISTED = re.compile(r"(?!\.{1,2}(/|$))[^/\0]+(/(?!\.{1,2}$)[^/\0]+)?")


class OutputError(HeadstockError):
    """An output folder or file cannot be written or read."""


class UnusableOutputError(OutputError):
    """What lies in a folder or at a place that was named is not what can be used there: wrong
    input, which is left as it is.
    """


class TakenOutputError(UnusableOutputError):
    """Where a file should be written lies one that Headstock did not write, or that was changed
    since.
    """


class PendingOutputs(PendingFiles):
    """Output files that appear together, once all of them are safely on the disk and listed; a
    context manager.
    """

    def __init__(self) -> None:
        super().__init__()
        self._digests: dict[Path, str] = {}

    def add(
        self, path: Path, content: bytes, *, mode: int = 0o644, start: bytes | None = None
    ) -> None:
        """Write to a temporary neighbour of ``path``.

        Args:
            mode: Permissions of a Unix file.
            start: As for ``check_output``.

        Raises:
            TakenOutputError: There is a file that Headstock did not write.
            OSError: The folder is not writable, the disk is full or the device reports an error.
        """
        check_output(path, start)
        super().add(path, content, mode=mode)
        self._digests[path] = hashlib.sha256(content).hexdigest()

    def publish(self) -> None:
        """List every file and rename its temporary over it.

        Raises:
            OSError: A rename failed; the files before it in the order they were added are new, the
                others old.
        """
        for folder in dict.fromkeys(path.parent for path in self._digests):
            _note(
                folder,
                {
                    path.name: digest
                    for path, digest in self._digests.items()
                    if path.parent == folder
                },
            )
        super().publish()


def prepare_output(folder: Path, names: Iterable[str] = (), parts: Iterable[str] = ()) -> None:
    """Make an output folder and try that files can be written there, before anything is computed.

    Args:
        names: Of files that will be written there whatever is computed.
        parts: Names of the folders in it that may be written into.

    Raises:
        TakenOutputError: The folder or a part is a link, or one of the files is there and Headstock
            did not write it.
        OutputError: Nothing can be written there.
    """
    try:
        _make_folder(folder, parents=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for part in parts:
            _refuse_other(folder / part)
        listed = _read_list(folder)
        taken = [name for name in names if _is_taken(folder, name, listed)]
    except OSError as error:
        raise OutputError(
            f"{folder} cannot be written: {error.strerror or error}; name another folder with -o DIR"
        ) from error
    if taken:
        raise TakenOutputError(
            f"{folder} holds {', '.join(taken)}, which Headstock did not write or which changed since; nothing was computed: "
            "move them away, or name another folder with -o DIR"
        )


@contextlib.contextmanager
def claim_output(
    folder: Path, names: Iterable[str] = (), parts: Iterable[str] = ()
) -> Iterator[None]:
    """Keep other runs out of an output folder while the body runs.

    Args:
        names: Of files that will be written there whatever is computed.
        parts: Names of the folders in it that may be written into.

    Raises:
        TakenOutputError: The folder or a part is a link, or one of the files is there and Headstock
            did not write it.
        OutputError: Another run is writing there, or nothing can be written there.
    """
    prepare_output(folder, names, parts)
    with lock_folder(folder) as mine:
        if not mine:
            raise OutputError(
                f"another run is writing into {folder}; wait until it ends, or name another folder with -o DIR"
            )
        yield


def require_new_folder(folder: Path) -> None:
    """Refuse a folder that holds anything.

    Raises:
        UnusableOutputError: It does, or is none.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UnusableOutputError(
            f"{folder} exists and is not an empty folder; nothing was changed: choose another name"
        )


def fill_new_folder(folder: Path, texts: Mapping[str, str], files: Iterable[Path]) -> None:
    """Make a folder with texts by name, and copies of files; it appears when it is complete.

    Raises:
        UnusableOutputError: It cannot be made.
    """
    require_new_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".headstock-new-", dir=folder.parent) as made:
            filled = Path(made, folder.name)
            filled.mkdir()
            for name, text in texts.items():
                (filled / name).write_text(text)
            for file in files:
                shutil.copyfile(file, filled / file.name)
            filled.replace(folder)  # an empty folder of that name gives way
    except OSError as error:
        raise UnusableOutputError(f"{folder} cannot be made: {error.strerror or error}") from error


def check_output(path: Path, start: bytes | None = None) -> None:
    """Refuse a file that must not be written over.

    Args:
        start: What a file begins with that Headstock wrote and that came here without the list of its
            folder, as in a clone of a repository.

    Raises:
        TakenOutputError: It is there and Headstock did not write it, it was changed since, or it is
            a link or a device.
        OutputError: Nobody can tell.
    """
    with naming_output(path):
        listed = _read_list(path.parent)
        if start and path.name not in listed and path.is_file() and not path.is_symlink():
            with path.open("rb") as file:
                if file.read(len(start)) == start:
                    return
        if _is_taken(path.parent, path.name, listed):
            what = (
                "is a link"
                if path.is_symlink()
                else "exists, and Headstock did not write it or it changed since"
            )
            raise TakenOutputError(
                f"{path} {what}: it is left as it is; move it away, or name another file"
            )


def write_output(path: Path, content: bytes, start: bytes | None = None) -> None:
    """Write one file atomically.

    Args:
        start: As for ``check_output``.

    Raises:
        TakenOutputError: It is there and Headstock did not write it.
        OutputError: It cannot be written.
    """
    with naming_output(path), PendingOutputs() as pending:
        pending.add(path, content, start=start)
        pending.publish()


def write_named_files(folder: Path, files: Mapping[str, bytes]) -> list[str]:
    """Write files whose names follow from what was computed; where a file of the user has the name,
    under another name beside it.

    Args:
        files: Content by path relative to it.

    Returns:
        A remark for each that got another name.

    Raises:
        OutputError: One cannot be written.
    """
    return _write_all(folder, files)[1]


def replace_outputs(folder: Path, part: str, files: Mapping[str, bytes]) -> list[str]:
    """Write files into a part of an output folder, and remove those that Headstock wrote there
    before and nobody has changed.

    Args:
        folder: Of the output; it holds the list.

    Returns:
        A remark for each that got another name, as in ``write_named_files``, and for each of an earlier
        run that is kept.

    Raises:
        TakenOutputError: The part is a link.
        OutputError: A file cannot be written.
    """
    with naming_output(folder / part):
        if files or os.path.lexists(folder / part):
            _make_folder(folder / part)
        elif not os.path.lexists(folder / LIST_FILE):
            return []
        names, remarks = _write_all(
            folder, {f"{part}/{name}": content for name, content in files.items()}
        )
        with _open_list(folder) as handle:
            written = _parse_list(_read_handle(handle))
            for name in [
                name for name in written if name.startswith(f"{part}/") and name not in names
            ]:
                digests = written.pop(name)
                if not os.path.lexists(folder / part):
                    continue
                with _unlinked(folder, name) as path:
                    remove_abandoned(path)
                    if not os.path.lexists(path):
                        continue
                    if _is_own(path, digests):
                        path.unlink()
                        continue
                remarks.append(
                    f"{folder / name} is of an earlier run and was changed since: it is kept"
                )
            _replace_list(folder, written)
    return remarks


def are_intact(folder: Path, names: Iterable[str], parts: Sequence[str]) -> bool:
    """Return whether files of an output folder, and all that were written into parts of it, are what
    Headstock wrote there last.
    """
    listed = _read_list(folder)
    inside = [name for name in listed if name.partition("/")[0] in parts and "/" in name]
    return all(_holds(folder, name, listed.get(name, [])[-1:]) for name in (*names, *inside))


def remove_outputs(folder: Path, names: Iterable[str]) -> None:
    """Remove files of an earlier run that the present one does not write; what somebody else wrote
    or changed is kept.

    Raises:
        OutputError: One cannot be removed.
    """
    with naming_output(folder):
        listed = _read_list(folder)
        for name in names:
            if _holds(folder, name, listed.get(name, ())):
                with _unlinked(folder, name) as path:
                    path.unlink()


def make_part(folder: Path) -> None:
    """Make a folder in an output folder, where it is missing.

    Raises:
        TakenOutputError: It is a link.
        OutputError: It cannot be made.
    """
    with naming_output(folder):
        _make_folder(folder)


def read_growing_file(path: Path, start: bytes) -> bytes:
    """The content of a file that records are appended to, before anything is added to it or cut
    off.

    Args:
        start: What every such file begins with; a writer that was killed may have left only a part
            of it.

    Raises:
        TakenOutputError: It begins with something else, or it is a link.
        OSError: It cannot be read.
    """
    _refuse_link(path)
    content = path.read_bytes()
    if not content.startswith(start) and not start.startswith(content):
        raise TakenOutputError(
            f"{path} exists, and Headstock did not write it: it is left as it is; name another folder with -o DIR"
        )
    return content


@contextlib.contextmanager
def naming_output(path: Path) -> Iterator[Path]:
    """Turn what the operating system says while a path is written into an error that names it."""
    try:
        yield path
    except OSError as error:
        raise OutputError(
            f"{path} cannot be written: {error.strerror or error}; what was there before is as it was"
        ) from error


def _write_all(folder: Path, files: Mapping[str, bytes]) -> tuple[set[str], list[str]]:
    """Write files under the first name that is free or Headstock's own; names and remarks."""
    remarks: list[str] = []
    with naming_output(folder):
        listed = _read_list(folder)
        chosen: dict[str, bytes] = {}
        for wanted, content in files.items():
            name = next(
                name
                for name in _numbered(wanted)
                if name not in chosen and not _is_taken(folder, name, listed)
            )
            chosen[name] = content
            if name != wanted:
                remarks.append(
                    f"{folder / wanted} is not Headstock's, or was changed since, and is kept: this run's is {name}"
                )
        _note(
            folder, {name: hashlib.sha256(content).hexdigest() for name, content in chosen.items()}
        )
        for name, content in chosen.items():
            with naming_output(folder / name), _unlinked(folder, name) as path:
                # what is there already is not written again
                if not (path.is_file() and path.read_bytes() == content):
                    write_atomically(path, content)
    return set(chosen), remarks


def _numbered(name: str) -> Iterator[str]:
    """``x.csv``, ``x-2.csv``, ``x-3.csv``, ..."""
    yield name
    path = Path(name)
    for number in itertools.count(2):
        yield path.with_name(f"{path.stem}-{number}{path.suffix}").as_posix()


def _make_folder(folder: Path, *, parents: bool = False) -> None:
    _refuse_other(folder)
    folder.mkdir(parents=parents, exist_ok=True)


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise TakenOutputError(
            f"{path} cannot be written: it is a link, and nothing is written through links; name the folder itself with -o DIR"
        )


def _refuse_other(folder: Path) -> None:
    """Refuse what lies where a folder should be."""
    _refuse_link(folder)
    if os.path.lexists(folder) and not folder.is_dir():
        raise TakenOutputError(
            f"{folder} cannot be written: it is a file and no folder; move it away, or name another folder with -o DIR"
        )


@contextlib.contextmanager
def _unlinked(folder: Path, name: str) -> Iterator[Path]:
    """The path of a file in an output folder or in a part of it, by way of the open folder that
    holds it: whatever is done there is done in that folder, where no link leads.

    Raises:
        TakenOutputError: The part is a link, or no folder.
    """
    part, _, file = name.rpartition("/")
    flags = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
    with contextlib.ExitStack() as stack:
        handle = os.open(folder, flags)
        stack.callback(os.close, handle)
        if part:
            _refuse_other(folder / part)  # says so in words; the kernel makes sure
            handle = os.open(part, flags | os.O_NOFOLLOW, dir_fd=handle)
            stack.callback(os.close, handle)
        yield Path(f"/proc/self/fd/{handle}", file)


def _holds(folder: Path, name: str, digests: Sequence[str]) -> bool:
    """Whether a file of the folder, or of a part that is no link, has one of the digests."""
    try:
        with _unlinked(folder, name) as path:
            return _is_own(path, digests)
    except (FileNotFoundError, TakenOutputError):
        return False


def _is_taken(folder: Path, name: str, listed: Mapping[str, Sequence[str]]) -> bool:
    try:
        with _unlinked(folder, name) as path:
            return os.path.lexists(path) and not _is_own(path, listed.get(name, ()))
    except FileNotFoundError:
        return False


def _is_own(path: Path, digests: Sequence[str]) -> bool:
    """Whether what lies there is a plain file with one of the digests; links, pipes and devices are
    not.
    """
    if not digests or not stat.S_ISREG(path.lstat().st_mode):
        return False
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() in digests


def _read_list(folder: Path) -> Written:
    """What Headstock wrote into a folder: name to digests, the last one last; empty without a
    list.
    """
    if not os.path.lexists(folder / LIST_FILE):
        return {}
    handle = _open_plain(folder / LIST_FILE, os.O_RDONLY)
    try:
        return _parse_list(_read_handle(handle))
    finally:
        os.close(handle)


def _open_plain(path: Path, flags: int) -> int:
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise TakenOutputError(
            f"{path} cannot be written: it is no plain file, and Headstock did not write it; move it away, or name another folder with -o DIR"
        )
    return handle


def _read_handle(handle: int) -> bytes:
    return os.pread(handle, os.fstat(handle).st_size, 0)


def _parse_list(content: bytes) -> Written:
    """Entries of a list; a line that a killed process did not finish, or that names anything but a
    file of the folder or of a part of it, is none.
    """
    written: Written = {}
    for line in content.splitlines():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            entry = json.loads(line)
            name, digest = str(entry["file"]), str(entry["sha256"])
            if _LISTED.fullmatch(name):
                # the same digest again goes to the end
                written[name] = [
                    *(earlier for earlier in written.get(name, []) if earlier != digest),
                    digest,
                ]
    return written


@contextlib.contextmanager
def _open_list(folder: Path) -> Iterator[int]:
    """The list of a folder, made where missing, for this process while the body runs."""
    path = folder / LIST_FILE
    while True:
        handle = _open_plain(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        try:
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
            # another process may have replaced it meanwhile
            if os.fstat(handle).st_nlink and os.path.samestat(os.fstat(handle), path.stat()):
                yield handle
                return
        finally:
            os.close(handle)


def _note(folder: Path, digests: Mapping[str, str]) -> None:
    """List files before they appear."""
    if not digests:
        return
    with _open_list(folder) as handle:
        before = _read_handle(handle)
        # what has a second name elsewhere is not appended to, either
        if len(before) > LIST_BYTES or os.fstat(handle).st_nlink > 1:
            _replace_list(folder, _shorten(folder, _parse_list(before), digests))
            return
        text = b"\n" * (bool(before) and not before.endswith(b"\n")) + _format_list(
            {name: [one] for name, one in digests.items()}
        )
        append_whole(handle, text)


def _shorten(folder: Path, written: Written, digests: Mapping[str, str]) -> Written:
    """Of each file the digest it has and the last one listed, which may be about to appear; and the
    new ones.
    """
    short: Written = {}
    for name, listed in written.items():
        has = [digest for digest in listed[:-1] if _holds(folder, name, [digest])]
        short[name] = [*has, listed[-1]]
    for name, digest in digests.items():
        short[name] = [*short.get(name, []), digest]
    return short


def _replace_list(folder: Path, written: Written) -> None:
    write_atomically(folder / LIST_FILE, _format_list(written))


def _format_list(written: Written) -> bytes:
    return "".join(
        json.dumps({"file": name, "sha256": digest}) + "\n"
        for name, digests in written.items()
        for digest in digests
    ).encode()
