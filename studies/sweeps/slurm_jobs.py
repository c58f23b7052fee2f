"""Commands as jobs of Slurm, a sweep as an array job: the script, what is on record of it, waiting
for it, and which task lacks which poses.
"""

import json
import shlex
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from headstock.geometry.errors import printable
from headstock.pipeline.storage.outputs import write_output
from headstock.scene.studies import Sweep, describe_positions
from headstock.studies.sweeps.slurm_tools import SlurmError, TaskState, read_states

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


@dataclass(frozen=True)
class ArrayJob:
    """Everything a job script is written from.

    Attributes:
        launcher: Words that start the program on the node: the launcher of the checkout that
            submits, which enters the private root there, or the Python of an installed package.
        key: Of everything a pose's result depends on: a task on a node that has another program or
            scene ends with an error.
        arguments: Further words of the command line: variant, overrides, retry.
        environment: Variables that are set in the script.
    """

    launcher: tuple[str, ...]
    scene: Path
    sweep: str
    folder: Path
    key: str
    options: SlurmOptions
    arguments: tuple[str, ...] = ()
    start_folder: Path = Path("/")
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Submission:
    """What is kept of a submitted array job, so that a later command finds it.

    Attributes:
        components_job: Of the job before it that reduces the components; empty without one.
        tasks: The array was split for.
    """

    key: str
    job: str
    components_job: str
    tasks: int
    submitted: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class CommandJob:
    """A command of which the whole is one task.

    Attributes:
        launcher: Words that start the program on the node.
        words: Of the command line, without those for the cluster and the ranks.
        folder: For script and log, absolute.
        environment: Variables that are set in the script.
    """

    launcher: tuple[str, ...]
    words: tuple[str, ...]
    folder: Path
    options: SlurmOptions
    start_folder: Path
    environment: Mapping[str, str]


class ScriptValueError(ValueError):
    """A value has no place in a job script."""


def render_script(job: ArrayJob) -> str:
    """The job script: the same for every array task, and for task 0, which only reduces the
    components.

    Raises:
        ScriptValueError: A value holds a line end or another control character, or a path or a
            setting holds a quote: sbatch would take what follows for lines or options of its own.
    """
    options = job.options
    _check_values(
        {"the sweep's name": job.sweep, **_name_places(job.folder, job.start_folder)},
        {
            "the scene": job.scene,
            "the launcher": shlex.join(job.launcher),
            "the sweep's key": job.key,
        },
        options,
        job.arguments,
        job.environment,
    )
    words = [
        *job.launcher,
        "sweep",
        str(job.scene),
        job.sweep,
        "-o",
        str(job.folder),
        *job.arguments,
    ]
    words += ["--ranks", str(options.ranks), "--key", job.key]
    exports = {"HEADSTOCK_THREADS": "1", **job.environment}
    return "\n".join(
        [
            "#!/bin/sh",
            f"# Sweep {job.sweep} in {options.tasks} array tasks, each with a journal of its own in poses/. Task {COMPONENTS_TASK} only",
            "# reduces the components; it comes first. Written by `headstock sweep --on slurm`, which submits and collects.",
            *_list_settings(
                f"headstock-{job.sweep}",
                f"1-{options.tasks}",
                job.folder,
                job.start_folder,
                options,
            ),
            *_list_exports(exports),
            f'exec {shlex.join(words)} --part "$SLURM_ARRAY_TASK_ID/{options.tasks}"',
            "",
        ]
    )


def render_command(job: CommandJob) -> str:
    """The job script of a command, which leaves the exit code beside it.

    Raises:
        ScriptValueError: As for an array job.
    """
    _check_values(
        _name_places(job.folder, job.start_folder),
        {"the launcher": shlex.join(job.launcher)},
        job.options,
        job.words,
        job.environment,
    )
    words = [*job.launcher, *job.words, "--ranks", str(job.options.ranks)]
    name = f"headstock-{job.words[0]}"
    return "\n".join(
        [
            "#!/bin/sh",
            f"# Written by `headstock {job.words[0]} --on slurm`, which submits, waits and shows the log.",
            *_list_settings(name, "1", job.folder, job.start_folder, job.options),
            *_list_exports(job.environment),
            f"code=0; {shlex.join(words)} || code=$?",
            f"echo $code >{shlex.quote(str(job.folder / FOLDER / CODE_FILE))}",
            "exit $code",
            "",
        ]
    )


def _list_settings(
    name: str, array: str, folder: Path, start_folder: Path, options: SlurmOptions
) -> list[str]:
    """Lines for sbatch.

    Args:
        folder: Of the results, with one for the logs.
    """
    log = f"{folder / FOLDER}".replace("\\", "\\\\").replace("%", "%%") + f"/{LOG_PATTERN}"
    settings = [
        f"--job-name={name}",
        f"--array={array}",
        "--nodes=1",
        f"--ntasks={options.ranks}",
        "--cpus-per-task=1",
        f'--chdir="{start_folder}"',
        f'--output="{log}"',
        "--open-mode=append",
        "--requeue",
        f"--export={','.join(PASSED_ON)}",
    ]
    settings += [f"--partition={options.partition}"] if options.partition else []
    settings += [f"--time={options.time_limit}"] if options.time_limit else []
    return [f"#SBATCH {setting}" for setting in (*settings, *options.extra)]


def _list_exports(variables: Mapping[str, str]) -> list[str]:
    return [f"export {name}={shlex.quote(value)}" for name, value in sorted(variables.items())]


def _name_places(folder: Path, start_folder: Path) -> dict[str, object]:
    return {"the folder of results": folder, "the current folder": start_folder}


def _check_values(
    settings: Mapping[str, object],
    words: Mapping[str, object],
    options: SlurmOptions,
    arguments: Sequence[str],
    environment: Mapping[str, str],
) -> None:
    """Refuse what would add lines or options to a script.

    Args:
        settings: What stands in lines for sbatch, by what it is.
        words: What is quoted for the shell, by what it is.
        arguments: Further words of the command line, quoted for the shell.
    """
    settings = {
        **settings,
        "--partition": options.partition or "",
        "--time": options.time_limit or "",
    }
    # quotes in these are the user's own, or are quoted for the shell
    words = {**words, **environment}
    words |= {f"--sbatch {number}": option for number, option in enumerate(options.extra, 1)}
    words |= {f"argument {number} of the tasks": word for number, word in enumerate(arguments, 1)}
    for what, value in {**settings, **words}.items():
        text = str(value)
        if printable(text) != text:
            raise ScriptValueError(
                f"{what} {printable(text)!r} holds a control character, which has no place in a job script"
            )
        if what in settings and set(text) & QUOTES:
            raise ScriptValueError(
                f"{what} {text!r} holds a quote, which has no place in the settings of a job script"
            )


def _task_of(number: int, tasks: int) -> int:
    """The array task, from 1, that computes a pose."""
    return number % tasks + 1


def list_missing(sweep: Sweep, done: Collection[bytes], tasks: int) -> dict[int, list[int]]:
    """Numbers of the poses that are not done, by array task; tasks that have done theirs are left
    out.

    Args:
        done: Positions of finished poses, as bytes.
        tasks: How many share the poses.
    """
    missing: dict[int, list[int]] = {}
    for number, positions in enumerate(sweep.positions):
        if positions.tobytes() not in done:
            missing.setdefault(_task_of(number, tasks), []).append(number)
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
        found = Submission(**{**content, "submitted": tuple(content["submitted"])})
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return found if found.key == key else None


def log_file(folder: Path, job: str, task: int) -> Path:
    """Where a task writes what it prints.

    Args:
        folder: Of the sweep's results.
        task: Number of the task, from 1.
    """
    return folder / FOLDER / f"{job}_{task}.log"


def is_waiting(states: Mapping[int, TaskState]) -> bool:
    """Whether a task is in the queue or runs."""
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
    """How many tasks are in which state, and why some wait."""
    counts = Counter(_describe_state(state) for state in states.values())
    return ", ".join(f"{count} {text}" for text, count in sorted(counts.items()))


def describe_missing(
    folder: Path,
    sweep: Sweep,
    submission: Submission,
    missing: Mapping[int, list[int]],
    states: Mapping[int, TaskState],
) -> str:
    """Which tasks lack which poses, how they ended and where they wrote why.

    Args:
        folder: Folder of the sweep's results, with the logs of its tasks.
        submission: Numbers of the array job and of the job that made the components.
        missing: Task to the poses that it lacks.
        states: Task to how Slurm says it ended.
    """
    lines = [
        f"{sum(len(poses) for poses in missing.values())} of {len(sweep.positions)} poses are not computed:"
    ]
    if submission.components_job:
        log = log_file(folder, submission.components_job, COMPONENTS_TASK)
        if submission.components_job and not any(
            log_file(folder, submission.job, task).exists() for task in missing
        ):
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


def _describe_state(state: TaskState) -> str:
    waits = state.state == "PENDING" and state.reason not in ("", "None")
    return f"{state.state.lower()} ({state.reason})" if waits else state.state.lower()


def _describe_log(log: Path) -> str:
    try:
        lines = log.read_text(errors="replace").split("\n")
    except OSError:
        return f"; it left no log {log}"
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return f"; log {log}: {last[:LAST_LETTERS]}" if last else f"; log {log} is empty"
