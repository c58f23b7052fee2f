"""A content-addressed store of meshes and superelements that many runs may read and write at once.

An entry is one HDF5 file whose user block holds its own kind and key and the SHA-256 digest of the
rest. It is believed only when it belongs to this user, nobody else may write it, it lies where its
key says, and the digest agrees; anything else is computed anew and replaced.
"""

import hashlib
import io
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.storage.atomic_files import write_atomically
from headstock.pipeline.storage.records import read_record, require_plain, write_record

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

USER_BLOCK = 512
SIGNATURE = b"headstock store entry 2 "


@dataclass(frozen=True)
class StoreRead[T]:
    """What the store had: a value, or None with a warning when an entry was there but could not be
    believed.
    """

    value: T | None
    warning: str | None = None


@dataclass(frozen=True)
class Store:
    """A folder of entries, ``ROOT/KIND/aa/KEY.h5``."""

    root: Path


def default_store_root() -> Path:
    """``$HEADSTOCK_STORE``, else ``headstock/store`` in the user's cache folder."""
    named = os.environ.get("HEADSTOCK_STORE")
    if named:
        return Path(named).expanduser()
    cache = os.environ.get("XDG_CACHE_HOME")
    base = Path(cache) if cache else Path.home() / ".cache"
    return base / "headstock" / "store"


def _entry_path(store: Store, kind: str, key: str) -> Path:
    """Where an entry lives.

    Args:
        key: SHA-256 in hexadecimal digits, perhaps with more after it.
    """
    return store.root / kind / key[:2] / f"{key}.h5"


def list_keys(store: Store, kind: type, prefix: str) -> list[str]:
    """Keys of the entries of a kind that begin so, in their order; whether they can be believed
    shows when they are read.

    Args:
        prefix: Beginning of the keys, at least two characters.
    """
    folder = _entry_path(store, _folder(kind), prefix).parent
    try:
        return sorted(
            path.stem
            for path in folder.iterdir()
            if path.name.startswith(prefix) and path.suffix == ".h5"
        )
    except OSError:
        return []


def read_entry[T](store: Store, key: str, kind: type[T]) -> StoreRead[T]:
    """The record stored under a key, verified; a missing entry is no warning."""
    path = _entry_path(store, _folder(kind), key)

    def refuse(why: str) -> StoreRead[T]:
        return StoreRead(None, f"store entry {path.name[:12]} {why}")

    try:
        content = read_own_file(path)
    except FileNotFoundError:
        return StoreRead(None)
    except OSError as error:
        return refuse(f"is not used: {error.strerror or error}")
    stated, payload = content[:USER_BLOCK].rstrip(b"\0"), memoryview(content)[USER_BLOCK:]
    head, _, digest = stated.rpartition(b" sha256 ")
    if not head.startswith(SIGNATURE) or digest != _digest(head, payload):
        return refuse("is damaged (its digest differs) and is computed anew")
    if head != _head(_folder(kind), key):
        other = head.removeprefix(SIGNATURE).decode("ascii", "replace")
        return refuse(f"holds another entry ({other[:80]}) and is computed anew")
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            require_plain(file)
            return StoreRead(read_record(file["record"], kind))
    except MemoryError:
        raise
    # the digest is right but the content is foreign: h5py raises almost anything
    except Exception as error:
        return refuse(f"is of another layout and is computed anew: {error}")


def write_entry(store: Store, key: str, record: "DataclassInstance") -> str | None:
    """Keep a record under a key; a store that cannot be written costs time later but no result, so
    it gives a warning.

    Args:
        record: A frozen dataclass of arrays, numbers, texts and records.

    Returns:
        The warning; None where it was kept.
    """
    image = io.BytesIO()
    with h5py.File(image, "w", userblock_size=USER_BLOCK) as file:
        write_record(file.create_group("record", track_order=True), record)
    content = bytearray(image.getvalue())
    content[:USER_BLOCK] = _seal_entry(_folder(type(record)), key, memoryview(content)[USER_BLOCK:])
    path = _entry_path(store, _folder(type(record)), key)
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_atomically(path, bytes(content), mode=0o600)
    except OSError as error:
        return f"the store in {store.root} cannot be written, nothing is kept: {error.strerror or error}"
    return None


def _seal_entry(kind: str, key: str, payload: bytes | memoryview) -> bytes:
    """The user block of an entry: its kind and key, and a digest over them and the rest.

    Args:
        kind: Folder of the store it lies in.
        payload: The file behind the user block.

    Raises:
        ValueError: The key does not fit.
    """
    head = _head(kind, key)
    block = head + b" sha256 " + _digest(head, payload)
    if len(block) > USER_BLOCK:
        raise ValueError(f"a key of {len(key)} characters does not fit into {USER_BLOCK} bytes")
    return block.ljust(USER_BLOCK, b"\0")


def _head(kind: str, key: str) -> bytes:
    return SIGNATURE + f"{kind} {key}".encode()


def _digest(own: bytes, payload: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(own)
    digest.update(payload)
    return digest.hexdigest().encode()


def _folder(kind: type) -> str:
    return kind.__name__.lower()


def read_own_file(path: Path) -> bytes:
    """Read a file that nobody else may have written.

    Raises:
        OSError: There is none, or it belongs to another user or may be written by one.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError("it is not a regular file")
        if status.st_uid != os.geteuid():
            raise PermissionError("it belongs to another user")
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError("other users may write it")
        return file.read()
