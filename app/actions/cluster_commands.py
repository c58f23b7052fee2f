"""``--on slurm`` of commands that are one job: submitted, waited for, and shown what it printed."""

import hashlib
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from headstock.app.actions.cluster_sweeping import (
    LAUNCHER,
    find_waiting,
    passed_environment,
    require_cluster,
)
from headstock.app.terminal.console import make_console
from headstock.app.terminal.guard import DONE
from headstock.pipeline.storage.content_keys import canonical_json
from headstock.pipeline.storage.outputs import claim_output, make_part, write_output
from headstock.studies.sweeps.slurm_jobs import (
    CODE_FILE,
    COMMAND_FILE,
    FOLDER,
    SUBMISSION_FILE,
    CommandJob,
    ScriptValueError,
    SlurmOptions,
    Submission,
    describe_states,
    log_file,
    read_submission,
    render_command,
    wait_for_array,
    write_submission,
)
from headstock.studies.sweeps.slurm_tools import SlurmError, submit

TASK = 1
FLAGS, VALUED = ("--no-wait",), ("--on", "--ranks", "--partition", "--time", "--sbatch")


def leave_out_cluster(words: Sequence[str]) -> tuple[str, ...]:
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
        words: Of the command line.
        options: Of the cluster.
        ranks: Of this process: one alone submits.
        wait: Whether to wait for the job.

    Returns:
        The exit code of the command.

    Raises:
        click.UsageError: There is no Slurm here, or a word has no place in a script.
        SlurmError: Slurm refuses the job, or it ended without an exit code.
    """
    require_cluster(ranks)
    kept = leave_out_cluster(words)
    key = hashlib.sha256(canonical_json([*kept, str(Path.cwd())]).encode()).hexdigest()
    folder = (Path("results") / "slurm" / f"{kept[0]}-{key[:8]}").absolute()
    with claim_output(folder, (COMMAND_FILE,), (FOLDER,)):
        code_file = folder / FOLDER / CODE_FILE
        submission = read_submission(folder, key) if code_file.exists() else None
        submission = submission or find_waiting(folder, key) or _submit(kept, options, folder, key)
        if not wait:
            _say(
                f"to wait for it and see what it prints: the same command without --no-wait; to stop it: scancel {submission.job}"
            )
            return DONE
        return _wait(submission, folder)


def _submit(words: tuple[str, ...], options: SlurmOptions, folder: Path, key: str) -> Submission:
    job = CommandJob(
        launcher=LAUNCHER,
        words=words,
        folder=folder,
        options=options,
        start_folder=Path.cwd(),
        environment=passed_environment(),
    )
    try:
        text = render_command(job)
    except ScriptValueError as error:
        raise click.UsageError(
            f"--on slurm: {error}; rename it, or start from elsewhere"
        ) from error
    make_part(folder / FOLDER)
    write_output(folder / COMMAND_FILE, text.encode())
    number = submit(folder / COMMAND_FILE, [TASK])
    submission = Submission(key, number, "", TASK, (TASK,))
    write_submission(folder, submission)
    _say(f"submitted {shlex.quote(str(folder / COMMAND_FILE))} as job {number}")
    return submission


def _wait(submission: Submission, folder: Path) -> int:
    code_file, log = folder / FOLDER / CODE_FILE, log_file(folder, submission.job, TASK)
    try:
        states = wait_for_array(submission, lambda text: _say(f"job {submission.job}: {text}"))
    except KeyboardInterrupt:
        _say(
            f"job {submission.job} goes on; the same command again waits for it; to stop it: scancel {submission.job}"
        )
        raise
    if log.exists():
        sys.stdout.write(log.read_text(errors="replace"))
    try:
        code = int(code_file.read_text())
    except (OSError, ValueError) as error:
        raise SlurmError(
            f"job {submission.job} ended without an exit code ({describe_states(states) or 'forgotten by Slurm'}); "
            f"its log: {log}; the same command again submits it once more"
        ) from error
    # the same command again is a new job
    code_file.unlink()
    (folder / FOLDER / SUBMISSION_FILE).unlink()
    return code


def _say(text: str) -> None:
    make_console().print(text, markup=False, soft_wrap=True)
