"""Commands as jobs of Slurm, a sweep as an array job: the script, Slurm's programs, what is on record
of a job, waiting for it, and which task lacks which poses.

The programs are called on PATH, or, from inside a private root, through the launcher that stayed
outside.
"""

import itertools
import json
import os
import shlex
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

from headstock.geometry.errors import HeadstockError, printable
from headstock.pipeline.storage.outputs import write_output
from headstock.scene.studies import Sweep, describe_positions

SCRIPT_FILE = "sweep.sbatch"
FOLDER = "slurm"
COMMAND_FILE = "job.sbatch"
SUBMISSION_FILE = "submission.json"
CODE_FILE = "exit_code"
LOG_PATTERN = "%A_%a.log"
# what a job takes along of the environment it is submitted from; all else is written out in the
# script
PASSED_ON = ("HOME", "USER", "LOGNAME", "PATH")
WRITTEN_OUT = (
    "HEADSTOCK_STORE", "HEADSTOCK_PYTHON", "HEADSTOCK_PRIVATE_ROOT", "HEADSTOCK_THREADS", "XDG_CACHE_HOME", "OMPI_MCA_btl_tcp_if_include",
    "OPENBLAS_CORETYPE",
)  # fmt: skip
COMPONENTS_TASK = 0
QUOTES = set("\"'`")
GOOD_END = "COMPLETED"
# a task that was put back into the queue shows one of the others for a moment
ENDS = (
    GOOD_END, "FAILED", "CANCELLED", "TIMEOUT", "OUT_OF_MEMORY", "NODE_FAIL", "BOOT_FAIL", "DEADLINE", "PREEMPTED", "REVOKED",
)  # fmt: skip
SHORTEST_SECONDS, LONGEST_SECONDS, GROWTH = 1.0, 15.0, 0.05
MOST_SILENCES = 20
POSES_NAMED = 3
LAST_LETTERS = 300
NEEDED = ("sbatch", "squeue")
# folder in which the launcher takes requests (environment/host_commands.sh)
HOST_VARIABLE = "HEADSTOCK_HOST_COMMANDS"
NOT_FOUND = 127
TOOL_SECONDS = 120.0
POLL_SECONDS = 0.02
UNKNOWN_JOB = "Invalid job id"
_numbers = itertools.count(1)


@dataclass(frozen=True)
class SlurmOptions:
    """What the user asks of the cluster.

    Attributes:
        tasks: Array tasks the poses are dealt out to.
        partition: None for the cluster's own choice.
        time_limit: Of each task, as ``sbatch --time`` takes it; None for the partition's.
        extra: Further options of ``sbatch``, each as it stands on a ``#SBATCH`` line.
    """

    tasks: int = 4
    ranks: int = 1
    partition: str | None = None
    time_limit: str | None = None
    extra: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SlurmJob:
    """Everything a job script is written from: of a command, or of a sweep in array tasks.

    Attributes:
        launcher: Words that start the program on the node: the launcher of the checkout that
            submits, which enters the private root there, or the Python of an installed package.
        words: Of the command line, without those for the cluster and the ranks.
        folder: For script and log, absolute.
        environment: Variables that are set in the script.
        sweep: Whose poses are dealt out to tasks; empty for a command that is one task.
        key: Of everything a pose's result depends on: a task on a node that has another program or
            scene ends with an error.
    """

    launcher: tuple[str, ...]
    words: tuple[str, ...]
    folder: Path
    options: SlurmOptions
    start_folder: Path = Path("/")
    environment: Mapping[str, str] = field(default_factory=dict)
    sweep: str = ""
    key: str = ""

    def check(self) -> None:
        """Refuse what would add lines or options to the script.

        Raises:
            ScriptValueError: A value holds a line end or another control character, or a path or a
                setting holds a quote: sbatch would take what follows for lines or options of its
                own.
        """
        # in lines for sbatch
        settings = {
            "the sweep's name": self.sweep,
            "the folder of results": str(self.folder),
            "the current folder": str(self.start_folder),
            "--partition": self.options.partition or "",
            "--time": self.options.time_limit or "",
        }
        # quotes in these are the user's own, or are quoted for the shell
        quoted = {"the launcher": shlex.join(self.launcher), "the sweep's key": self.key}
        quoted |= {f"--sbatch {number}": text for number, text in enumerate(self.options.extra, 1)}
        quoted |= {f"word {number} of the command": text for number, text in enumerate(self.words)}
        for what, text in {**settings, **quoted, **self.environment}.items():
            if printable(text) != text:
                raise ScriptValueError(
                    f"{what} {printable(text)!r} holds a control character, which has no place in a job script"
                )
            if what in settings and set(text) & QUOTES:
                raise ScriptValueError(
                    f"{what} {text!r} holds a quote, which has no place in the settings of a job script"
                )


@dataclass(frozen=True)
class Submission:
    """What is kept of a submitted job, so that a later command finds it.

    Attributes:
        components_job: Of the job before it that reduces the components; empty without one.
        tasks: The array was split for.
    """

    key: str
    job: str
    components_job: str
    tasks: int
    submitted: tuple[int, ...]


@dataclass(frozen=True)
class TaskState:
    """State of an array task, such as ``RUNNING``, and why it waits or ended, as Slurm says it."""

    state: str
    reason: str


class ScriptValueError(ValueError):
    """A value has no place in a job script."""


class SlurmError(HeadstockError):
    """Slurm refused a request, did not answer, or a task of an array job failed."""


class SlurmMissingError(SlurmError):
    """Slurm's programs are not to be found."""


def render_script(job: SlurmJob) -> str:
    """Return the job script: of a sweep the same for every array task, and for task 0, which only
    reduces the components; a command leaves its exit code beside its log.

    Raises:
        ScriptValueError: A value has no place in it.
    """
    job.check()
    options, command = job.options, [*job.launcher, *job.words, "--ranks", str(job.options.ranks)]
    exports = dict(job.environment)
    if job.sweep:
        exports = {"HEADSTOCK_THREADS": "1", **exports}
        remarks = [
            f"# Sweep {job.sweep} in {options.tasks} array tasks, each with a journal of its own in poses/. Task {COMPONENTS_TASK} only",
            "# reduces the components; it comes first. Written by `headstock sweep --on slurm`, which submits and collects.",
        ]
        run = [
            f'exec {shlex.join([*command, "--key", job.key])} --part "$SLURM_ARRAY_TASK_ID/{options.tasks}"',
        ]
    else:
        remarks = [
            f"# Written by `headstock {job.words[0]} --on slurm`, which submits, waits and shows the log.",
        ]
        run = [
            f"code=0; {shlex.join(command)} || code=$?",
            f"echo $code >{shlex.quote(str(job.folder / FOLDER / CODE_FILE))}",
            "exit $code",
        ]
    log = f"{job.folder / FOLDER}".replace("\\", "\\\\").replace("%", "%%") + f"/{LOG_PATTERN}"
    settings = [
        f"--job-name=headstock-{job.sweep or job.words[0]}",
        f"--array={f'1-{options.tasks}' if job.sweep else '1'}",
        "--nodes=1",
        f"--ntasks={options.ranks}",
        "--cpus-per-task=1",
        f'--chdir="{job.start_folder}"',
        f'--output="{log}"',
        "--open-mode=append",
        "--requeue",
        f"--export={','.join(PASSED_ON)}",
    ]
    settings += [f"--partition={options.partition}"] if options.partition else []
    settings += [f"--time={options.time_limit}"] if options.time_limit else []
    lines = [
        "#!/bin/sh",
        *remarks,
        *(f"#SBATCH {setting}" for setting in (*settings, *options.extra)),
        *(f"export {name}={shlex.quote(value)}" for name, value in sorted(exports.items())),
        *run,
    ]
    return "\n".join(lines) + "\n"


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


def list_missing_poses(sweep: Sweep, done: Collection[bytes], tasks: int) -> dict[int, list[int]]:
    """Return the numbers of the poses that are not done, by array task from 1; tasks that have done
    theirs are left out.

    Args:
        done: Positions of finished poses, as bytes.
        tasks: How many share the poses.
    """
    missing: dict[int, list[int]] = {}
    for number, positions in enumerate(sweep.positions):
        if positions.tobytes() not in done:
            missing.setdefault(number % tasks + 1, []).append(number)
    return dict(sorted(missing.items()))


def write_submission(folder: Path, submission: Submission) -> None:
    """Keep the numbers of a submitted job.

    Raises:
        OutputError: They cannot be written.
    """
    write_output(
        folder / FOLDER / SUBMISSION_FILE, json.dumps(asdict(submission), indent=1).encode()
    )


def read_submission(folder: Path, key: str) -> Submission | None:
    """The last array job submitted for this sweep from this folder, if there is one."""
    try:
        content = json.loads((folder / FOLDER / SUBMISSION_FILE).read_text())
        submission = Submission(**{**content, "submitted": tuple(content["submitted"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return submission if submission.key == key else None


def log_file(folder: Path, job: str, task: int) -> Path:
    """Return the path of what a task prints.

    Args:
        folder: Of the sweep's results.
        task: Number of the task, from 1.
    """
    return folder / FOLDER / f"{job}_{task}.log"


def is_waiting(states: Mapping[int, TaskState]) -> bool:
    """Tell whether a task is in the queue or runs."""
    return any(state.state not in ENDS for state in states.values())


def wait_for_array(
    submission: Submission, on_change: Callable[[str], None]
) -> dict[int, TaskState]:
    """Wait until no task is in the queue or runs.

    Args:
        on_change: Called with how many tasks are in which state, whenever that changes.

    Returns:
        The last state seen of each task.

    Raises:
        SlurmError: Slurm has not answered for minutes.
    """
    begin, silences, reported, ended = time.monotonic(), 0, "", False
    last: dict[int, TaskState] = {}
    while True:
        try:
            states = read_states(submission.job)
            silences = 0
        except SlurmError as error:
            silences += 1
            if silences > MOST_SILENCES:
                raise SlurmError(
                    f"job {submission.job} can no longer be watched: {error}; the same command again goes on"
                ) from error
            states = last
        last |= states
        if states and (text := describe_states(last)) != reported:
            reported = text
            on_change(text)
        if not is_waiting(states) and not silences:
            # seen twice, because a task that goes back into the queue may look ended in between
            if ended or all(state.state == GOOD_END for state in last.values()):
                return last
            ended = True
        else:
            ended = False
        time.sleep(min(LONGEST_SECONDS, SHORTEST_SECONDS + GROWTH * (time.monotonic() - begin)))


def describe_states(states: Mapping[int, TaskState]) -> str:
    """Return how many tasks are in which state, and why some wait."""
    counts = Counter(
        f"{task.state.lower()} ({task.reason})"
        if task.state == "PENDING" and task.reason not in ("", "None")
        else task.state.lower()
        for task in states.values()
    )
    return ", ".join(f"{count} {text}" for text, count in sorted(counts.items()))


def describe_missing(
    folder: Path,
    sweep: Sweep,
    submission: Submission,
    missing: Mapping[int, list[int]],
    states: Mapping[int, TaskState],
) -> str:
    """Return which tasks lack which poses, how they ended and where they wrote why.

    Args:
        folder: Folder of the sweep's results, with the logs of its tasks.
        submission: Numbers of the array job and of the job that made the components.
        missing: Task to the poses that it lacks.
        states: Task to how Slurm says it ended.
    """
    lines = [
        f"{sum(len(poses) for poses in missing.values())} of {len(sweep.positions)} poses are not computed:"
    ]
    begun = any(log_file(folder, submission.job, task).exists() for task in missing)
    if submission.components_job and not begun:
        log = log_file(folder, submission.components_job, COMPONENTS_TASK)
        lines.append(f"  job {submission.components_job} (components){_describe_log(log)}")
    for task, poses in missing.items():
        state = states[task].state.lower() if task in states else "forgotten by Slurm"
        named = "; ".join(describe_positions(sweep, number) for number in poses[:POSES_NAMED])
        more = f" and {len(poses) - POSES_NAMED} more" if len(poses) > POSES_NAMED else ""
        lines.append(
            f"  task {task} ({state}): {named}{more}{_describe_log(log_file(folder, submission.job, task))}"
        )
    lines.append("finished poses are kept; the same command again submits only these tasks")
    return "\n".join(lines)


def _describe_log(log: Path) -> str:
    try:
        lines = log.read_text(errors="replace").split("\n")
    except OSError:
        return f"; it left no log {log}"
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return f"; log {log}: {last[:LAST_LETTERS]}" if last else f"; log {log} is empty"
