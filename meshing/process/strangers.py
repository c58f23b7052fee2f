"""Files of strangers: how large each kind may be, and reading them in a process apart.

Whoever reads a file that a scene or a command names asks here first. The size is looked at before
anything else; what is not small is read by a worker process with limits of memory and time.
"""

import math
import os
import stat
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.meshing.errors import MeshError
from headstock.meshing.formats import find_format, list_array_files
from headstock.meshing.process.isolation import WorkerEnd, WorkerLimits
from headstock.meshing.process.worker import BAD_FILE, REFUSED, Arrays, call_apart, read_arrays

type Reader = Callable[..., Arrays]

SMALL_BYTES = 1 << 18  # read within a tenth of a second, whatever is in it
# what honest tables need: up to 60 times their size in memory, 0.1 s of processor time per MB
MEMORY_BYTES = 768 << 20
MEMORY_FACTOR = 60
LARGEST_MEMORY = 8 << 30
SECONDS = 5.0
SECONDS_PER_MB = 0.3
WALL_FACTOR = 6.0  # a busy machine gives little of its processors
KEPT = 4  # results that a process remembers
READ_PATH = "headstock.meshing.process.strangers:serve_reader"


@dataclass(frozen=True)
class FileKind:
    """A kind of files that others make.

    Attributes:
        most_bytes: That one may have.
        advice: What to do with a larger one.
        packed: One may unpack to far more, so a small one is read in a process apart, too.
    """

    name: str
    most_bytes: int
    advice: str
    packed: bool = False

    def refusal(self, name: str, size: int) -> str | None:
        """Return what is wrong with a file of a size; None for nothing."""
        if size <= self.most_bytes:
            return None
        return f"{name} has {_format_bytes(size)}; {self.name} may have {_format_bytes(self.most_bytes)}: {self.advice}"


PART = FileKind("a file of a part", 4_000_000_000, "export it coarser")
ELEMENT_SIZES = FileKind("a file of element sizes", 200_000_000, "write a coarser view")
XDMF = FileKind("an XDMF file", 1_000_000_000, "write its arrays into an HDF5 file")
CORNERS = FileKind("a table of corners", 1_000_000, "leave out those on straight lines")
TEST_POINTS = FileKind(
    "a table of points", 10_000_000, "leave out points that are not on this machine"
)
WAYPOINTS = FileKind("a path", 50_000_000, "write fewer waypoints, or cut it in two")
RECORD = FileKind("a record", 500_000_000, "cut it, or keep fewer samples per second")
TEST_DATA = FileKind("a file of test data", 200_000_000, "export fewer frequencies or channels")
MATLAB = FileKind("a MATLAB file", TEST_DATA.most_bytes, TEST_DATA.advice, packed=True)
SUMMARY = FileKind("a summary", 200_000_000, "no run writes one as large")
RESULTS = FileKind("a file of results", 16_000_000_000, "no run writes one as large")

_known: dict[tuple[object, ...], Arrays] = {}


def _format_bytes(size: int) -> str:
    """Return a number of bytes as a message has it."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"


def read_apart(
    path: Path, kind: FileKind, reader: Reader, *arguments: str, error: type[HeadstockError]
) -> Arrays:
    """Read a file of strangers: a large one in a process apart, with limits.

    Args:
        reader: A function of a module. It takes the path and the arguments and raises ``error``.
        error: Raised for everything that is wrong with the file.

    Returns:
        What the reader returns.
    """
    status = require_size(path, kind, error)
    if status.st_size <= SMALL_BYTES and not kind.packed:
        return reader(path, *arguments)
    file_key = (path.absolute(), status.st_ino, status.st_size, status.st_mtime_ns)
    key = (*file_key, reader.__module__, reader.__qualname__, arguments)
    if key not in _known:
        arrays = _read_in_worker(path, status.st_size, reader, arguments, error)
        while len(_known) >= KEPT:
            del _known[next(iter(_known))]
        _known[key] = arrays
    return _known[key]


def require_size(path: Path, kind: FileKind, error: type[HeadstockError]) -> os.stat_result:
    """Refuse what is no regular file, or is larger than its kind."""
    try:
        status = path.stat()
    except OSError as fault:
        raise error(f"{path.name} cannot be read: {fault.strerror}") from fault
    if not stat.S_ISREG(status.st_mode):
        raise error(f"{path.name} is no regular file")
    if refusal := kind.refusal(path.name, status.st_size):
        raise error(refusal)
    return status


def files_beside(path: Path) -> tuple[str, ...]:
    """Return the names of the HDF5 files that an XDMF file reads its arrays from; none for other
    formats.

    Raises:
        MeshError: It names one in another folder, or is too large.
    """
    if find_format(path).name != "XDMF" or not path.stat().st_size:
        return ()
    return tuple(map(str, read_apart(path, XDMF, list_array_files, error=MeshError)["names"]))


def _read_in_worker(
    path: Path,
    size: int,
    reader: Reader,
    arguments: tuple[str, ...],
    error: type[HeadstockError],
) -> Arrays:
    seconds = SECONDS + SECONDS_PER_MB * size / 1e6
    limits = WorkerLimits(
        min(MEMORY_BYTES + MEMORY_FACTOR * size, LARGEST_MEMORY),
        math.ceil(seconds),
        WALL_FACTOR * seconds,
    )
    functions = [READ_PATH, f"{reader.__module__}:{reader.__qualname__}"]
    arrays = run_apart(functions, path, *arguments, limits=limits, error=error)
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def run_apart(
    functions: Sequence[str],
    path: Path,
    *arguments: str,
    limits: WorkerLimits,
    error: type[HeadstockError],
    content: bytes = b"",
    progress: Callable[[str], None] | None = None,
) -> Arrays:
    """Call a function on a file in a worker process; arguments as in `call_apart`.

    Raises:
        HeadstockError: As ``error``, where the function refuses the file or meets a limit.
    """
    path = path.absolute()
    with tempfile.TemporaryFile() as result:
        end = call_apart(
            functions,
            str(path),
            *arguments,
            limits=limits,
            readable=[path],
            content=content,
            result=result,
            progress=progress,
        )
        if end.code != 0:
            raise error(_explain(path.name, end))
        return read_arrays(result)


def serve_reader(reader: Reader, path: str, *arguments: str) -> Arrays:
    """Read a file in the worker process."""
    return reader(Path(path), *arguments)


def _explain(name: str, end: WorkerEnd) -> str:
    if end.code in (REFUSED, BAD_FILE):
        return end.last_line
    remedy = "check the file, which may be damaged"
    if end.out_of_time:
        return f"{name}: reading was stopped after {end.out_of_time}; {end.time_remedy or remedy}"
    if end.out_of_memory:
        return f"{name}: reading needed more than {end.memory_limit}; {end.memory_remedy or remedy}"
    return (
        f"{name}: the process that read it ended with code {end.code} ({end.last_line}); {remedy}"
    )
