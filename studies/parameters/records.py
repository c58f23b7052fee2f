"""The results file of a study: one JSON line per finished point, so that a killed study goes on where it was.

A line is appended and flushed to the disk when its point is finished. A process that dies while it writes leaves a line without an
end; the next study cuts it off. Lines of points that are no longer asked for stay and are used again when they are.
"""

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from headstock.pipeline.storage.json_texts import Json
from headstock.pipeline.storage.outputs import OutputError, read_growing_file

POINTS_FILE = "points.jsonl"
FORMAT = 1
LINE_START = b'{"key":'


@dataclass(frozen=True, eq=False)
class StudyRecord:
    """A finished point of a study.

    Attributes:
        key: Of everything its results depend on.
        family: Name of its family.
        varied: Dotted key to the value it has here.
        status: ``failed`` when anything asked for could not be computed.
        error: Why, in the program's own words.
        summary: Content of ``summary.json``; empty where the point failed before.
        measured: What a study with a reference made of the results besides.
        seconds: Wall-clock time of each repeat [s].
        cpu_seconds: Processor time of each repeat, child processes and threads included [s].
        peak_mb: Most resident memory of this process in each repeat [MB]; empty where nobody could look.
        cached_stages: How many stages the store answered in the last repeat.
        threads: BLAS threads of each rank.
        ranks: MPI ranks.
        format: Of this line.
    """

    key: str
    family: str
    varied: dict[str, Any]
    status: Literal["done", "failed"]
    error: str = ""
    summary: Json = field(default_factory=dict)
    measured: Json = field(default_factory=dict)
    seconds: tuple[float, ...] = ()
    cpu_seconds: tuple[float, ...] = ()
    peak_mb: tuple[float, ...] = ()
    cached_stages: int = 0
    threads: int = 1
    ranks: int = 1
    format: int = FORMAT


def read_records(folder: Path) -> dict[str, StudyRecord]:
    """Finished points by key, the last one where a key comes twice; what a killed process left of a line is cut off.

    Raises:
        TakenOutputError: The file is a link, or not one that a study writes: lines would be cut off or added to a file of the user.
        OutputError: The file cannot be read or mended.
    """
    path = folder / POINTS_FILE
    try:
        content = read_growing_file(path, LINE_START)
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            os.truncate(path, len(whole))
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise OutputError(f"{path} cannot be read: {error.strerror or error}") from error
    records = (_read_line(line) for line in whole.splitlines())
    return {record.key: record for record in records if record is not None}


def append_record(folder: Path, record: StudyRecord) -> None:
    """Append a finished point; it is on the disk when this returns.

    Raises:
        OutputError: The disk is full or the folder is gone; finished points before it are untouched.
    """
    path = folder / POINTS_FILE
    line = json.dumps(asdict(record), allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
    try:
        new = not path.exists()
        with path.open("ab", buffering=0) as file:
            end = file.tell()
            try:
                if file.write(line) != len(line):
                    raise OSError("the disk is full")
                os.fsync(file.fileno())
            except OSError:
                with contextlib.suppress(OSError):
                    file.truncate(end)
                raise
        if new:
            _flush_folder(folder)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}; finished points are kept") from error


def _flush_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _read_line(line: bytes) -> StudyRecord | None:
    """A record, or None for a line that is of another version or no record: its point is then computed anew."""
    try:
        entry = json.loads(line)
        if entry.pop("format") != FORMAT:
            return None
        entry |= {name: tuple(entry[name]) for name in ("seconds", "cpu_seconds", "peak_mb")}
        return StudyRecord(**entry)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
