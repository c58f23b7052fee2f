"""Runs a meshing job in a child process with a time and a memory limit."""

import dataclasses
import errno
import math
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from headstock.meshing.errors import MeshError
from headstock.meshing.mesh_job import MeshData, MeshJob, format_job, read_data
from headstock.meshing.mesh_worker import REFUSED

GMSH_WORKER = "headstock.meshing.gmsh_worker"
FOREIGN_WORKER = "headstock.meshing.foreign_worker"
MESH_FILES = {".msh": GMSH_WORKER, ".inp": FOREIGN_WORKER, ".bdf": FOREIGN_WORKER, ".nas": FOREIGN_WORKER}
# gmsh may be linked with MPI: a child that sees its parent's launcher variables would join the parent's job
LAUNCHER_PREFIXES = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
# What honest mesh files need, so that a small file that lies about its counts is stopped early. Measured on tets and hexes:
# readers take up to 40 times the file's size, and 0.25 GiB of address space to start; 1 to 2 s of CPU per 10 MB.
READING_BYTES = 640 << 20
READING_FACTOR = 100
READING_SECONDS = 8
READING_SECONDS_PER_MB = 1.0
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def run_job(job: MeshJob, *, what: str, time_limit: float) -> MeshData:
    """Run a job in a child process.

    Args:
        job: What to do.
        what: Names the component in messages.
        time_limit: Seconds after which the child is killed.

    Raises:
        MeshError: The child refused the job, ran out of time, memory or room on the disk, or crashed.
    """
    worker = GMSH_WORKER
    # the CPU limit also ends a child that nobody waits for
    job = dataclasses.replace(job, cpu_seconds=math.ceil(time_limit) + 5)
    if job.task == "file":
        path = Path(job.solid["path"])
        if path.suffix.lower() not in MESH_FILES:
            raise MeshError(f"{what}: {path.name}: mesh files end in .msh (gmsh), .inp (Abaqus) or .bdf (Nastran)")
        worker = MESH_FILES[path.suffix.lower()]
        job = _limit_reading(job, path)
    environment = {name: value for name, value in os.environ.items() if not name.startswith(LAUNCHER_PREFIXES)}
    environment |= {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    # without a name in the file system, so that nothing stays behind however this process ends
    with tempfile.TemporaryFile() as result:
        # -P: a module in the user's working folder must not stand in for ours
        command = [sys.executable, "-P", "-m", worker, str(os.getpid()), str(result.fileno())]
        try:
            done = subprocess.run(
                command,
                env=environment,
                timeout=time_limit,
                capture_output=True,
                text=True,
                errors="replace",
                input=format_job(job),
                pass_fds=[result.fileno()],
            )
        except subprocess.TimeoutExpired as timeout:
            size = "the default element size" if job.size is None else "this element size"
            raise MeshError(
                f"{what}: meshing with {size} was stopped after {time_limit:g} s; write a larger mesh size, or remove tiny faces "
                "and edges from the CAD model; a damaged file may take as long: export it again"
            ) from timeout
        if done.returncode == 0:
            result.seek(0)
            return read_data(result)
        raise _failure(done, job, what)


def _limit_reading(job: MeshJob, path: Path) -> MeshJob:
    try:
        size = path.stat().st_size
    except OSError:
        size = 0  # the child says that it is missing
    return dataclasses.replace(
        job,
        memory_bytes=min(job.memory_bytes, READING_BYTES + READING_FACTOR * size),
        cpu_seconds=min(job.cpu_seconds, math.ceil(READING_SECONDS + READING_SECONDS_PER_MB * size / 1e6)),
    )


def _failure(done: subprocess.CompletedProcess[str], job: MeshJob, what: str) -> MeshError:
    """Why a child failed; a disk without room is the cause of the error, so that nobody takes it for a fault of the mesh."""
    for lost in (code for code in NO_ROOM if os.strerror(code) in done.stderr):
        error = MeshError(f"{what}: the mesh could not be written: {os.strerror(lost)}; make room in {tempfile.gettempdir()}")
        error.__cause__ = OSError(lost, os.strerror(lost))
        return error
    return MeshError(f"{what}: {_explain(done, job)}")


def _explain(done: subprocess.CompletedProcess[str], job: MeshJob) -> str:
    last = [line for line in done.stderr.strip().splitlines() if line.strip()]
    message = last[-1] if last else "no message"
    if done.returncode == REFUSED:
        return message
    reading = job.task == "file"
    remedy = "check the file, which may be damaged" if reading else "write a larger mesh size"
    limit = f"{job.memory_bytes / 2**30:.3g} GiB of memory"
    if done.returncode == -signal.SIGXCPU:
        return f"{'reading the file' if reading else 'meshing'} took more than {job.cpu_seconds} s; {remedy}"
    if any(word in done.stderr for word in ("MemoryError", "bad_alloc", "Cannot allocate memory", "unable to map")):
        return f"{'reading the file' if reading else 'meshing'} needed more than the limit of {limit}; {remedy}"
    return f"the meshing process ended with code {done.returncode} ({message}); it may have met its limit of {limit}: {remedy}"
