"""The results file of a study: one JSON line per finished point, so that a killed study goes on
where it was.

Lines of points that are no longer asked for stay and are used again when they are.
"""

import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal, TypedDict

from headstock.geometry.errors import NumberNameError
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.storage.journals import Journal, JournalForm, read_journal
from headstock.scene.reading.files import TomlValue

POINTS_FILE = "points.jsonl"
FORMAT = 3
POINTS = JournalForm(b'{"key":', lines=True)


class Measured(TypedDict, total=False):
    """What a study makes of a point's results beyond its summary.

    With a reference: kind of the model, its dofs, quantities and the MAC of modes. For convergence:
    how bodies move in the modes of the first pose, a column per mode.
    """

    kind: str
    ndof: int
    values: dict[str, float]
    macs: dict[str, float]
    fields: list[list[float]]


@dataclass(frozen=True, eq=False)
class StudyRecord:
    """A finished point of a study.

    Attributes:
        key: Of everything its results depend on.
        varied: Dotted key to the value it has here.
        status: ``failed`` when anything asked for could not be computed.
        error: Why, in the program's own words.
        summary: Content of ``summary.json`` without its files; None where the point failed before.
        numbers: Every number with its ±, by name; none where the point failed before.
        measured: Empty in studies without a reference.
        seconds: Wall-clock time of each repeat [s].
        cpu_seconds: Processor time of each repeat, child processes and threads included [s].
        peak_mb: Most resident memory of this process in each repeat [MB]; empty where nobody could
            look.
        cached_stages: How many stages the store answered in the last repeat.
    """

    key: str
    family: str
    varied: dict[str, TomlValue]
    status: Literal["done", "failed"]
    error: str = ""
    summary: RunSummary | None = None
    numbers: Numbers = field(default_factory=Numbers.empty)
    measured: Measured = field(default_factory=lambda: Measured())
    seconds: tuple[float, ...] = ()
    cpu_seconds: tuple[float, ...] = ()
    peak_mb: tuple[float, ...] = ()
    cached_stages: int = 0
    threads: int = 1
    ranks: int = 1
    format: int = FORMAT


def read_records(folder: Path) -> dict[str, StudyRecord]:
    """Finished points by key, the last one where a key comes twice.

    Raises:
        TakenOutputError: The file is a link, or not one that a study writes.
        OutputError: The file cannot be read.
    """
    records = (_read_line(line) for line in read_journal(folder / POINTS_FILE, POINTS))
    return {record.key: record for record in records if record is not None}


def open_records(folder: Path) -> Journal:
    """The file of finished points, for ``append_record``; a context manager."""
    return Journal(folder / POINTS_FILE, POINTS)


def append_record(journal: Journal, record: StudyRecord) -> None:
    """Append a finished point; it is on the disk when this returns.

    Raises:
        OutputError: The disk is full or the folder is gone; finished points before it are
            untouched.
    """
    line = {column.name: getattr(record, column.name) for column in fields(record)}
    line |= {"summary": record.summary or {}, "numbers": record.numbers.encode()}
    journal.append(
        json.dumps(line, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode()
    )


def _read_line(line: bytes) -> StudyRecord | None:
    """A record, or None for a line of another version or no record: computed anew."""
    try:
        entry = json.loads(line)
        if entry.pop("format") != FORMAT:
            return None
        entry["summary"] = entry["summary"] or None
        entry["numbers"] = Numbers.decode(entry["numbers"])
        entry |= {name: tuple(entry[name]) for name in ("seconds", "cpu_seconds", "peak_mb")}
        return StudyRecord(**entry)
    except (ValueError, TypeError, KeyError, AttributeError, NumberNameError):
        return None
