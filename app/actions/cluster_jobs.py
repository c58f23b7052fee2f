"""``--on slurm``: submits a sweep as an array job, waits for it and collects what its tasks computed;
submits another command as one job, waits and shows what it printed.
"""

import dataclasses
import hashlib
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import click

from headstock.app.terminal.console import counted, make_console
from headstock.app.terminal.guard import DONE
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.storage.content_keys import canonical_json
from headstock.pipeline.storage.outputs import claim_output, make_part, write_output
from headstock.pipeline.storage.provenance import PROJECT
from headstock.solvers.mpi import MPI
from headstock.studies.sweeps.journals import read_journals
from headstock.studies.sweeps.runs import SweepJob, sweep_key
from headstock.studies.sweeps.slurm import (
    CODE_FILE,
    COMMAND_FILE,
    COMPONENTS_TASK,
    FOLDER,
    SCRIPT_FILE,
    SUBMISSION_FILE,
    WRITTEN_OUT,
    ScriptValueError,
    SlurmError,
    SlurmJob,
    SlurmMissingError,
    SlurmOptions,
    Submission,
    TaskState,
    describe_missing,
    describe_states,
    is_waiting,
    list_missing_poses,
    log_file,
    read_states,
    read_submission,
    render_script,
    require_slurm,
    submit,
    wait_for_array,
    write_submission,
)

START_MODULE = "headstock.app.start"  # of an installed package
TASK = 1
FLAGS, VALUED = ("--no-wait",), ("--on", "--ranks", "--partition", "--time", "--sbatch")


@dataclasses.dataclass(frozen=True, kw_only=True)
class ClusterRequest:
    """What the command line asked of the cluster.

    Attributes:
        arguments: Words the tasks' command line gets besides: variant, overrides, retry.
        retry: Poses that failed are computed again.
        wait: Whether to wait for the array job and collect.
    """

    options: SlurmOptions
    arguments: tuple[str, ...]
    retry: bool
    wait: bool


def sweep_on_slurm(
    job: SweepJob, request: ClusterRequest, comm: MPI.Comm, collect: Callable[[], int]
) -> int:
    """Submit what is missing of a sweep, or find the array job that is still at it; wait; collect.

    Args:
        collect: Makes the files of a sweep whose poses are all computed, and returns the exit code.

    Raises:
        click.UsageError: There is no Slurm here.
        SlurmError: Slurm refuses the job, or tasks ended without their poses.
    """
    _require_cluster(comm.size)
    key = sweep_key(job.scene)
    with claim_output(job.folder, (SCRIPT_FILE,), (FOLDER,)):
        done = {
            result.positions.tobytes()
            for result in read_journals(job.folder, key).values()
            if not (request.retry and result.state == "failed")
        }
        tasks = min(request.options.tasks, len(job.sweep.positions))
        if missing := list_missing_poses(job.sweep, done, tasks):
            submission = _find_waiting(job.folder, key)
            if submission is None:
                folder, scene = job.folder.absolute(), str(job.scene.path.absolute())
                array = SlurmJob(
                    launcher=_find_launcher(),
                    words=("sweep", scene, job.sweep.name, "-o", str(folder), *request.arguments),
                    folder=folder,
                    options=dataclasses.replace(request.options, tasks=tasks),
                    start_folder=Path.cwd(),
                    environment=_passed_environment(),
                    sweep=job.sweep.name,
                    key=key,
                )
                elastic = any(stage.kind == "reduce" for stage in plan_scene(job.scene).stages)
                submission = _submit(array, key, tuple(missing), reduces=elastic and not done)
            if not request.wait:
                return _leave(submission, "wait for it and collect")
            states = _watch(submission)
            done = {each.positions.tobytes() for each in read_journals(job.folder, key).values()}
            if missing := list_missing_poses(job.sweep, done, submission.tasks):
                raise SlurmError(
                    describe_missing(job.folder, job.sweep, submission, missing, states)
                )
    return collect()


def _require_cluster(ranks: int) -> None:
    """Refuse to submit where that is not possible.

    Raises:
        click.UsageError: This is one of several ranks, or there is no Slurm.
    """
    if ranks > 1:
        raise click.UsageError(
            "--on slurm submits from one process; start it through ./headstock, which leaves --ranks to the job"
        )
    try:
        require_slurm()
    except SlurmMissingError as error:
        raise click.UsageError(str(error)) from error


def _find_launcher() -> tuple[str, ...]:
    """Words that start this program on a node: the launcher of a checkout, or of an installed package
    the Python that it is installed in.
    """
    launcher = PROJECT / "headstock"
    return (str(launcher),) if launcher.is_file() else (sys.executable, "-P", "-m", START_MODULE)


def _passed_environment() -> dict[str, str]:
    """What a job script sets of the environment it is submitted from."""
    return {name: os.environ[name] for name in WRITTEN_OUT if os.environ.get(name)}


def _find_waiting(folder: Path, key: str) -> Submission | None:
    """The array job submitted before, when it is still in the queue or runs."""
    submission = read_submission(folder, key)
    if submission is None or not is_waiting(read_states(submission.job)):
        return None
    _say(f"array job {submission.job} is still at it")
    return submission


def _submit(
    job: SlurmJob, key: str, tasks: tuple[int, ...], *, reduces: bool = False
) -> Submission:
    """Write the script of a job and submit it.

    Args:
        reduces: A job before it reduces the components.

    Raises:
        click.UsageError: A name or word has no place in a script.
    """
    script = job.folder / (SCRIPT_FILE if job.sweep else COMMAND_FILE)
    try:
        text = render_script(job)
    except ScriptValueError as error:
        raise click.UsageError(
            f"--on slurm: {error}; rename it, or start from elsewhere"
        ) from error
    make_part(script.parent / FOLDER)
    write_output(script, text.encode())
    first = submit(script, [COMPONENTS_TASK]) if reduces else ""
    number = submit(script, tasks, after=first)
    submission = Submission(key, number, first, job.options.tasks, tasks)
    write_submission(job.folder, submission)
    kind = f"job {number}"
    if job.sweep:
        chosen = "" if len(tasks) == job.options.tasks else f" ({', '.join(map(str, tasks))})"
        before = f", after job {first}, which reduces the components" if first else ""
        kind = f"array job {number}: {counted(len(tasks), 'task')}{chosen}{before}"
    _say(f"submitted {shlex.quote(str(script))} as {kind}")
    return submission


def _leave(submission: Submission, purpose: str) -> int:
    """Say how to go on with a job that is not waited for."""
    _say(f"to {purpose}: the same command without --no-wait; to stop it: scancel {submission.job}")
    return DONE


def _watch(submission: Submission) -> dict[int, TaskState]:
    """Wait until a job has ended; the states of its tasks."""
    try:
        return wait_for_array(submission, lambda text: _say(f"job {submission.job}: {text}"))
    except KeyboardInterrupt:
        _say(
            f"job {submission.job} goes on; the same command again waits for it; to stop it: scancel {submission.job}"
        )
        raise


def _leave_out_cluster(words: Sequence[str]) -> tuple[str, ...]:
    """The words of a command line without the options of the cluster and the number of ranks."""
    kept: list[str] = []
    rest = iter(words)
    for word in rest:
        if word in VALUED:
            next(rest, None)
        elif word not in FLAGS and word.partition("=")[0] not in VALUED:
            kept.append(word)
    return tuple(kept)


def command_on_slurm(words: Sequence[str], options: SlurmOptions, ranks: int, *, wait: bool) -> int:
    """Submit a command, or find the job that is still at it; wait for it and show what it printed.

    Args:
        ranks: Of this process: one alone submits.

    Returns:
        The exit code of the command.

    Raises:
        click.UsageError: There is no Slurm here, or a word has no place in a script.
        SlurmError: Slurm refuses the job, or it ended without an exit code.
    """
    _require_cluster(ranks)
    kept = _leave_out_cluster(words)
    key = hashlib.sha256(canonical_json([*kept, str(Path.cwd())]).encode()).hexdigest()
    folder = (Path("results") / "slurm" / f"{kept[0]}-{key[:8]}").absolute()
    with claim_output(folder, (COMMAND_FILE,), (FOLDER,)):
        code_file = folder / FOLDER / CODE_FILE
        submission = read_submission(folder, key) if code_file.exists() else None
        submission = submission or _find_waiting(folder, key)
        if submission is None:
            job = SlurmJob(
                launcher=_find_launcher(),
                words=kept,
                folder=folder,
                options=dataclasses.replace(options, tasks=TASK),
                start_folder=Path.cwd(),
                environment=_passed_environment(),
            )
            submission = _submit(job, key, (TASK,))
        if not wait:
            return _leave(submission, "wait for it and see what it prints")
        return _await_command(submission, folder)


def _await_command(submission: Submission, folder: Path) -> int:
    code_file, log = folder / FOLDER / CODE_FILE, log_file(folder, submission.job, TASK)
    states = _watch(submission)
    if log.exists():
        sys.stdout.write(log.read_text(errors="replace"))
    try:
        code = int(code_file.read_text())
    except (OSError, ValueError) as error:
        raise SlurmError(
            f"job {submission.job} ended without an exit code ({describe_states(states) or 'forgotten by Slurm'}); "
            f"its log: {log}; the same command again submits it once more"
        ) from error
    make_part(folder / FOLDER)  # which is no link
    # the same command again is a new job
    code_file.unlink()
    (folder / FOLDER / SUBMISSION_FILE).unlink()
    return code


def _say(text: str) -> None:
    make_console().say(text, soft_wrap=True)
