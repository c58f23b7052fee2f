"""Calling Slurm's programs: on PATH, or, from inside a private root, through the launcher that
stayed outside.
"""

import itertools
import os
import shutil
import subprocess
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from headstock.geometry.errors import HeadstockError

NEEDED = ("sbatch", "squeue")
# folder in which the launcher takes requests (environment/host_commands.sh)
HOST_VARIABLE = "HEADSTOCK_HOST_COMMANDS"
NOT_FOUND = 127
TOOL_SECONDS = 120.0
POLL_SECONDS = 0.02
UNKNOWN_JOB = "Invalid job id"
_numbers = itertools.count(1)


class SlurmError(HeadstockError):
    """Slurm refused a request, did not answer, or a task of an array job failed."""


class SlurmMissingError(SlurmError):
    """Slurm's programs are not to be found."""


@dataclass(frozen=True)
class TaskState:
    """What Slurm says of an array task.

    Attributes:
        state: As Slurm names it, such as ``RUNNING``.
        reason: Why it waits, or why it ended.
    """

    state: str
    reason: str


def require_slurm() -> None:
    """Try that Slurm's programs can be called.

    Raises:
        SlurmMissingError: They cannot; says what to do.
    """
    for tool in NEEDED:
        code, _, _ = _call([tool, "--version"])
        if code == NOT_FOUND:
            raise SlurmMissingError(
                f"there is no {tool} on PATH; start this on a login node of the cluster (perhaps after `module load slurm`), "
                "or leave --on slurm out to compute here"
            )


def submit(script: Path, tasks: Collection[int], *, after: str = "") -> str:
    """Submit array tasks of a job script.

    Args:
        after: Number of a job that has to succeed first.

    Returns:
        The job's number.

    Raises:
        SlurmError: Slurm refuses it.
    """
    words = ["sbatch", "--parsable", f"--array={','.join(str(task) for task in sorted(tasks))}"]
    words += [f"--dependency=afterok:{after}", "--kill-on-invalid-dep=yes"] if after else []
    code, said, complaint = _call([*words, str(script)])
    number = said.strip().partition(";")[0]
    if code or not number.isdecimal():
        raise SlurmError(
            f"sbatch did not take {script}: {(complaint or said).strip() or f'exit code {code}'}; "
            "--partition, --time and --sbatch set what this cluster asks for"
        )
    return number


def read_states(job: str) -> dict[int, TaskState]:
    """States of the array tasks of a job, ended ones among them for some minutes; empty when Slurm
    has forgotten the job.

    Raises:
        SlurmError: Slurm does not answer.
    """
    code, said, complaint = _call(
        ["squeue", "--noheader", "--array", "--states=all", f"--jobs={job}", "--format=%K|%T|%r"]
    )
    if code and UNKNOWN_JOB in complaint:
        return {}
    if code:
        raise SlurmError(f"squeue ended with {code}: {complaint.strip()}")
    states: dict[int, TaskState] = {}
    for line in said.splitlines():
        task, _, rest = line.strip().partition("|")
        state, _, reason = rest.partition("|")
        if task.isdecimal():
            states[int(task)] = TaskState(state, reason)
    return states


class _Reply(NamedTuple):
    """Exit code, standard output and standard error of a program."""

    code: int
    said: str
    complaint: str


def _call(words: Sequence[str]) -> _Reply:
    host = os.environ.get(HOST_VARIABLE)
    if host and shutil.which(words[0]) is None:
        return _call_outside(Path(host), words)
    try:
        done = subprocess.run(
            words,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TOOL_SECONDS,
            stdin=subprocess.DEVNULL,
        )
    except FileNotFoundError:
        return _Reply(NOT_FOUND, "", f"{words[0]}: not found")
    except subprocess.TimeoutExpired:
        return _Reply(1, "", f"no answer in {TOOL_SECONDS:.0f} s")
    return _Reply(done.returncode, done.stdout, done.stderr)


def _call_outside(host: Path, words: Sequence[str]) -> _Reply:
    name = f"{os.getpid()}-{next(_numbers)}"
    (host / f"{name}.words").write_text("".join(f"{word}\n" for word in words))
    with (host / "requests").open("w") as pipe:
        pipe.write(f"{name}\n")
    end = time.monotonic() + TOOL_SECONDS
    while not (host / f"{name}.code").exists():
        if time.monotonic() > end:
            return _Reply(1, "", f"no answer in {TOOL_SECONDS:.0f} s")
        time.sleep(POLL_SECONDS)
    code, said, complaint = (
        (host / f"{name}.{kind}").read_text(errors="replace") for kind in ("code", "out", "err")
    )
    return _Reply(int(code), said, complaint)
