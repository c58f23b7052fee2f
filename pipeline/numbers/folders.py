"""The two files of a run that hold its numbers, as files: their names, whether they belong to the
same run, and messages where they do not. Neither an answer nor a solver is imported.
"""

import contextlib
import hashlib
import io
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Never

from headstock.meshing.process.plain_hdf5 import h5py
from headstock.meshing.process.strangers import RESULTS, SUMMARY, require_size
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.storage.outputs import UnusableOutputError
from headstock.pipeline.storage.records import RecordError, require_plain
from headstock.scene.reading.names import RESULT_FORMAT

FORMAT = "headstock results"
VERSION = 3
RESULTS_FILE = "results.h5"
NUMBERS_FILE, TABLES_FORMAT = "numbers.h5", "headstock numbers"
SUMMARY_FILE = "summary.json"
# what other commands leave in their folders
OTHER_RESULTS = {
    "sweep.json": "sweep",
    "study.json": "study",
    "compare.json": "compare",
    "convergence.json": "converge",
    "correlate.json": "correlate",
    "identification.json": "identify",
}


def _name_remedy(folder: Path) -> str:
    """Return the command that writes the files of a folder anew, in plain words."""
    return f"`headstock run SCENE -o {folder}` writes it anew, with what is in the store"


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the summary in an output folder, of which only the format is checked.

    Raises:
        UnusableOutputError: There is no summary, or the file is not one.
    """
    path = folder / SUMMARY_FILE
    if folder.is_file():
        raise UnusableOutputError(f"{folder} is a file; name the folder that a run has written")
    remedy = _name_remedy(folder)
    try:
        if path.exists():
            require_size(path, SUMMARY, RecordError)
        summary = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except OSError as error:
        raise UnusableOutputError(
            f"{path} cannot be read: {error.strerror or error}; {_find_other_results(folder) or remedy}"
        ) from error
    except RecordError as error:
        raise UnusableOutputError(f"{path} cannot be read: {error}; {remedy}") from error
    except (ValueError, RecursionError) as error:
        raise UnusableOutputError(f"{path} is not a summary: {error}; {remedy}") from error
    if not isinstance(summary, dict):
        raise UnusableOutputError(
            f"{path} is not a summary: it holds a {type(summary).__name__}; {remedy}"
        )
    if (stated := summary.get("format", 1)) != RESULT_FORMAT:
        raise UnusableOutputError(
            f"{path} has format {stated}, and this version reads format {RESULT_FORMAT}; {remedy}"
        )
    return summary


def encode_tables(tables: Mapping[str, Numbers]) -> bytes:
    """Return the content of ``numbers.h5``: tables of several machines.

    Args:
        tables: Point of a study or variant to its numbers; an empty text for a single run.
    """
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        file.attrs["format"], file.attrs["version"] = TABLES_FORMAT, VERSION
        for number, (label, numbers) in enumerate(tables.items()):
            group = file.create_group(str(number))
            group.attrs["label"] = label
            numbers.write(group)
    return image.getvalue()


def read_number_tables(folder: Path) -> dict[str, Numbers]:
    """Return the tables of numbers in a folder, by point or variant; an empty text for a single
    run. A folder written by both a run and a study holds the tables of the later one.

    Raises:
        UnusableOutputError: There are none, or they cannot be read.
    """
    path, summary = folder / NUMBERS_FILE, folder / SUMMARY_FILE
    if not path.is_file() or (
        summary.is_file() and summary.stat().st_mtime_ns > path.stat().st_mtime_ns
    ):
        return {"": read_run_numbers(folder)}
    with naming_damage(path):
        require_size(path, RESULTS, RecordError)
        with h5py.File(path, "r") as file:
            require_plain(file)
            if (file.attrs.get("format"), file.attrs.get("version")) != (TABLES_FORMAT, VERSION):
                raise RecordError("it holds no numbers of this version")
            groups = [file[str(number)] for number in range(len(file))]
            return {str(group.attrs["label"]): Numbers.read(group) for group in groups}


def read_run_numbers(folder: Path) -> Numbers:
    """Return every number of a run with its ±.

    Raises:
        UnusableOutputError: The file is missing, damaged, of an earlier version or of another run than the
            summary.
    """
    return read_results_file(folder, lambda file: Numbers.read(file["numbers"]))


def read_results_file[T](folder: Path, read: "Callable[[h5py.File], T]") -> T:
    """Return a function's result on ``results.h5``, the file that the summary names.

    Raises:
        UnusableOutputError: It is missing, damaged, of an earlier version or of another run.
    """
    path = folder / RESULTS_FILE
    summary = read_summary(folder)
    with naming_damage(folder / SUMMARY_FILE):
        stated = summary["files"][RESULTS_FILE]["sha256"]
    with naming_damage(path):
        if path.exists():
            require_size(path, RESULTS, RecordError)
        if stated != _digest_of(path):
            raise RecordError(f"it is damaged, or of another run than {SUMMARY_FILE}")
        with h5py.File(path, "r") as file:
            require_plain(file, attribute_axes=2)
            if file.attrs.get("format") != FORMAT or "view" not in file:
                raise RecordError("it holds no results of a run")
            if (version := file.attrs.get("version")) != VERSION:
                raise RecordError(f"it has version {version}, and this one reads {VERSION}")
            return read(file)


@contextlib.contextmanager
def naming_damage(path: Path) -> Iterator[None]:
    """Turn errors of reading into one that names the file and the remedy.

    Raises:
        UnusableOutputError: The file holds something else than this version writes.
    """
    try:
        yield
    except (
        OSError,
        RecordError,
        LookupError,
        AttributeError,
        TypeError,
        ValueError,
        RuntimeError,
        MemoryError,
    ) as error:
        raise UnusableOutputError(
            f"{path} cannot be read: {error}; {_name_remedy(path.parent)}"
        ) from error


def _refuse_constant(name: str) -> Never:
    raise ValueError(f"it holds {name}, which no run writes")


def _find_other_results(folder: Path) -> str:
    """Return the remedy for a folder of a command of many runs; empty where it is none."""
    names = [name for name in OTHER_RESULTS if (folder / name).is_file()]
    if not names:
        return ""
    command = OTHER_RESULTS[names[0]]
    return (
        f"{folder / names[0]} is of `headstock {command}`, which writes its own pages: run it again"
    )


def _digest_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
