"""Runs a meshing job in a worker process with limits of time and memory."""

import errno
import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.errors import (
    MeshError,
    MeshQualityError,
    MeshTimeError,
    PartFileError,
    PatchError,
)
from headstock.meshing.formats import find_format
from headstock.meshing.process.isolation import WorkerEnd, WorkerLimits
from headstock.meshing.process.job import MeshData, MeshJob, format_job, unpack_data
from headstock.meshing.process.strangers import PART, require_size
from headstock.meshing.process.worker import (
    BAD_FILE,
    BAD_MESH,
    BAD_PATCH,
    REFUSED,
    call_apart,
    read_arrays,
)

# functions that the worker process calls: on a job, and on one that reads a file
PERFORM_JOB = "headstock.meshing.process.job:perform_job"
MESH_SHAPE = "headstock.meshing.cad.meshing:mesh_shape"
SURVEY_SHAPE = "headstock.meshing.cad.faces:survey_shape"
READ_FILE = "headstock.meshing.files.cells:read_file"
MEMORY_BYTES = 8 << 30
# What honest mesh files need, so that a small file that lies about its counts is stopped early.
# Measured on tets and hexes: readers take up to 40 times the file's size, and 0.25 GiB of address
# space to start; 1 to 2 s of CPU per 10 MB.
READING_BYTES = 640 << 20
READING_FACTOR = 100
READING_SECONDS = 8
READING_SECONDS_PER_MB = 1.0
WALL_FACTOR = 4.0
LONGEST_LINE = 1_000_000
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def run_job(
    job: MeshJob, *, what: str, time_limit: float, memory_bytes: int = MEMORY_BYTES
) -> MeshData:
    """Run a job in a worker process.

    Args:
        what: Names the component in messages.
        time_limit: Processor time after which the worker is killed [s]; it waits for processors and
            disks at most four times as long.
        memory_bytes: Limit on the worker's address space.

    Raises:
        MeshError: The file is none, the worker refused the job, ran out of time, memory or room on
            the disk, or crashed.
    """
    functions = [PERFORM_JOB, SURVEY_SHAPE if job.task == "faces" else MESH_SHAPE]
    # processor time, so that the same part meshes on a busy machine; it also ends a worker that
    # nobody waits for
    limits = WorkerLimits(memory_bytes, math.ceil(time_limit), WALL_FACTOR * time_limit)
    readable = []
    if isinstance(job.solid, StepFile | MeshFile):
        path = job.solid.path
        readable.append(path)
        if not path.is_file():
            raise MeshError(
                f"{what}: {path} is no regular file"
                if path.exists()
                else f"{what}: there is no file {path}"
            )
        try:
            require_size(path, PART, PartFileError)
            if job.task == "file":
                form = find_format(path)
                functions = [READ_FILE, form.reader]
                if form.lines:
                    _require_lines(path)
        except MeshError as error:
            raise type(error)(f"{what}: {error}") from error
        if job.task == "file":
            if isinstance(job.solid, MeshFile):
                readable += job.solid.beside
            limits = _limit_reading(limits, readable)
    # without a name in the file system, so that nothing stays behind however this process ends
    with tempfile.TemporaryFile() as result:
        content = format_job(job).encode()
        end = call_apart(
            functions, limits=limits, readable=readable, content=content, result=result
        )
        if end.code == 0:
            return unpack_data(read_arrays(result))
        raise _failure(end, job, what)


def _require_lines(path: Path) -> None:
    """Refuse what is no text of lines before a reader takes all of it as one."""
    with path.open("rb") as file:
        start = file.read(LONGEST_LINE)
    if b"\0" in start or (len(start) == LONGEST_LINE and b"\n" not in start):
        raise PartFileError(
            f"{path.name} is no text: its first megabyte has zero bytes, or no end of a line; export it again"
        )


def _limit_reading(limits: WorkerLimits, readable: Sequence[Path]) -> WorkerLimits:
    size = sum(path.stat().st_size for path in readable if path.is_file())
    return WorkerLimits(
        min(limits.memory_bytes, READING_BYTES + READING_FACTOR * size),
        min(limits.cpu_seconds, math.ceil(READING_SECONDS + READING_SECONDS_PER_MB * size / 1e6)),
        limits.wall_seconds,
    )


def _failure(end: WorkerEnd, job: MeshJob, what: str) -> MeshError:
    """Return why a worker process failed; a disk without room is the cause of the error, so that
    nobody takes it for a fault of the mesh.
    """
    for lost in (code for code in NO_ROOM if os.strerror(code) in end.errors):
        error = MeshError(
            f"{what}: the mesh could not be written: {os.strerror(lost)}; make room in {tempfile.gettempdir()}"
        )
        error.__cause__ = OSError(lost, os.strerror(lost))
        return error
    if end.code == BAD_PATCH:
        group, _, text = end.last_line.partition(" ")
        return PatchError(f"{what}: {text}", group)
    reason = _explain(end, job)
    # a file is named once where it is all that is looked at
    text = reason if reason.startswith(what) else f"{what}: {reason}"
    if end.code == BAD_MESH:
        return MeshQualityError(text)
    if end.out_of_time:
        return MeshTimeError(text)
    return PartFileError(text) if end.code == BAD_FILE else MeshError(text)


def _explain(end: WorkerEnd, job: MeshJob) -> str:
    if end.code in (REFUSED, BAD_FILE, BAD_MESH):
        return end.last_line
    doing, remedy = "meshing", "write a larger mesh size"
    if isinstance(job.solid, StepFile):
        remedy += ", or leave out small features by mesh.leave_out and mesh.details"
    if job.task == "file":
        doing, remedy = "reading the file", "check the file, which may be damaged"
    if end.out_of_time:
        size = "the default element size" if job.size is None else "this element size"
        if job.task != "file":
            doing += f" with {size}"
            remedy += ", or remove tiny faces and edges from the CAD model; a damaged file may take as long: export it again"
        return f"{doing} was stopped after {end.out_of_time}; {end.time_remedy or remedy}"
    if end.out_of_memory:
        return f"{doing} needed more than {end.memory_limit}; {end.memory_remedy or remedy}"
    return f"the process ended with code {end.code} ({end.last_line}); it may have met {end.memory_limit}: {end.memory_remedy or remedy}"
